// Launches of a user's model, stepped and read: what MujocoFlight of simulation.py does in
// Python for launches without RK4, plug-in or motion along the plate. Sums and products are those
// of MuJoCo's own mju_ functions, or one after the other, in both: so both have the same bits.

#include <math.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <mujoco/mujoco.h>

// Causes of a change of speed, in the order of NAMES of speed_shares.py.
enum { CONTACT, OTHERS, LIMITS, EQUALITIES, FRICTION, ACTUATORS, PASSIVE, ADHESION, WEIGHT, CAUSES };

// Numbers that `advance` returns in place of a count of steps.
enum { FATAL_ERROR = -1, NO_MEMORY = -2 };

// The two parts that meet; the fields of simulation.py's _Pair.
typedef struct {
  // Of each geom: 1 for the first part's, 2 for the second's, else 0.
  const int8_t* sides;
  // Of each geom: true for those of the trees of bodies that the two belong to.
  const uint8_t* in_trees;
  // Geoms of the first part, then of the second.
  const int32_t* geoms;
  int32_t firsts;
  int32_t seconds;
  int32_t bodies[2];
  // True where causes of a change of speed are added up.
  int32_t has_causes;
  // Steps of the way to the touch plane within which distances are measured.
  double near;
  // Distance at which the force begins to act, and at which the two touch; m.
  double onset;
  double gap;
  // Distance that MuJoCo reports for all that is farther apart, m.
  double reach;
} Pair;

// One launch under way; the fields of simulation.py's _Launch.
typedef struct {
  // Of the last contact: the mean of its points, and the normal from the first part.
  double point[3];
  double normal[3];
  // Penetration, m, and approach rate, m/s, of the last step.
  double x;
  double rate;
  int32_t steps;
  // The first step with a force; -1 before.
  int32_t first_force;
  // True from where the motion does not belong to the impact any more.
  int32_t is_apart;
  // Of each geom: the first step in which it touched the two, -1 for none.
  int32_t* first_touch;
} Launch;

// Memory for the steps of one call; pointers of (nv), but for `jacobian`, (3, nv), and
// `of_rows`, (2, room).
typedef struct {
  mjtNum *velocity, *row, *other, *moved, *jacobian, *of_rows;
  size_t room;
} Work;

// The pair in one state.
typedef struct {
  int touches;  // a contact of the pair
  int others;   // contacts besides
  double penetration, rate, force;
} Reading;

static _Thread_local jmp_buf* on_error = NULL;
static _Thread_local char error_text[512];
static void (*handler_before)(const char*);

static void caught(const char* text) {
  if (!on_error) {
    if (handler_before) handler_before(text);
    exit(EXIT_FAILURE);  // as MuJoCo does without a handler
  }
  strncpy(error_text, text, sizeof error_text - 1);
  longjmp(*on_error, 1);
}

// From here to `end_catching` MuJoCo's fatal errors of this thread jump to `here`.
static void begin_catching(jmp_buf* here) {
  handler_before = mju_user_error == caught ? handler_before : mju_user_error;
  mju_user_error = caught;
  on_error = here;
}

static void end_catching(void) {
  on_error = NULL;
  mju_user_error = handler_before;
}

// The words of the error that ended the last call of this thread.
const char* fatal_error(void) { return error_text; }

static int side_of(const Pair* pair, int geom) { return geom < 0 ? 0 : pair->sides[geom]; }

static int is_of_pair(const Pair* pair, const mjContact* contact) {
  // A geom of the first counts 1, one of the second 2: only one of each add up to 3.
  return side_of(pair, contact->geom[0]) + side_of(pair, contact->geom[1]) == 3;
}

// Jacobian of the approach rate at the last contact, into work->row.
static void approach_row(const mjModel* m, const mjData* d, const Pair* pair, const Launch* launch,
                         Work* work) {
  int nv = (int)m->nv;
  mj_jac(m, d, work->jacobian, NULL, launch->point, pair->bodies[0]);
  mju_mulMatTVec(work->row, work->jacobian, launch->normal, 3, nv);
  if (!pair->bodies[1]) return;
  mj_jac(m, d, work->jacobian, NULL, launch->point, pair->bodies[1]);
  mju_mulMatTVec(work->other, work->jacobian, launch->normal, 3, nv);
  mju_subFrom(work->row, work->other, nv);
}

// Penetration, approach rate and force of the state in `d`, whose velocity work->velocity has;
// point and normal of the contact go into `launch`.
static Reading read_pair(const mjModel* m, mjData* d, const Pair* pair, Launch* launch,
                         Work* work) {
  Reading read = {0};
  double distance = INFINITY, parting = 0.0;
  double point[3] = {0};
  int mine = 0, acting = 0;
  for (int i = 0; i < (int)d->ncon; i++) {
    const mjContact* contact = d->contact + i;
    if (!is_of_pair(pair, contact)) continue;
    for (int k = 0; k < 3; k++) point[k] = mine ? point[k] + contact->pos[k] : contact->pos[k];
    if (!mine) {
      int is_turned = side_of(pair, contact->geom[0]) == 2;
      for (int k = 0; k < 3; k++) launch->normal[k] = is_turned ? -contact->frame[k] : contact->frame[k];
    }
    mine++;
    if (contact->dist < distance) distance = contact->dist;
    int address = (int)contact->efc_address;
    // A contact without a constraint row has no force.
    if (address < 0) continue;
    mjtNum wrench[6];
    mj_contactForce(m, d, i, wrench);
    read.force += wrench[0];
    double rate = d->efc_vel[address];
    // As the engine has it: the two edges of a pyramid lie evenly about the normal.
    if (m->opt.cone == mjCONE_PYRAMIDAL && contact->dim > 1) {
      rate = 0.5 * (rate + d->efc_vel[address + 1]);
    }
    parting += rate;
    acting++;
  }
  read.others = mine < (int)d->ncon;
  read.touches = mine;
  if (mine) {
    read.penetration = pair->onset - distance;
    for (int k = 0; k < 3; k++) launch->point[k] = mine > 1 ? point[k] / mine : point[k];
  }
  if (acting) {
    read.rate = -parting / acting;
  } else {
    approach_row(m, d, pair, launch, work);
    read.rate = mju_dot(work->row, work->velocity, (int)m->nv);
  }
  return read;
}

// Distance of the two parts, m; infinite where MuJoCo can compute none.
static double nearest(const mjModel* m, mjData* d, const Pair* pair) {
  double least = INFINITY;
  mjtNum ends[6];
  for (int a = 0; a < pair->firsts; a++) {
    for (int b = 0; b < pair->seconds; b++) {
      int second = pair->geoms[pair->firsts + b];
      double distance = mj_geomDistance(m, d, pair->geoms[a], second, pair->reach, ends);
      if (distance < (least < pair->reach ? least : pair->reach)) least = distance;
    }
  }
  return least;
}

// Penetration, m, in a state without a contact, from that of the step before.
static double depth_in_flight(const mjModel* m, mjData* d, const Pair* pair, const Launch* launch,
                              double rate) {
  if (launch->steps == 1) return launch->x;
  double h = m->opt.timestep;
  double x = launch->x + h * rate;
  double fastest = fmax(fabs(rate), fabs(launch->rate));
  if (fabs(x) < pair->near * h * fastest && isfinite(pair->gap)) x = pair->gap - nearest(m, d, pair);
  // Without a force the body has left the touch plane.
  return launch->first_force >= 0 && x > 0.0 ? 0.0 : x;
}

// Accelerations of the approach by each cause, m/s², into `parts`; 0 where there is no memory.
static int accelerations(const mjModel* m, mjData* d, const Pair* pair, const Launch* launch,
                         int others, Work* work, double* parts) {
  int nv = (int)m->nv, rows = (int)d->nefc;
  approach_row(m, d, pair, launch, work);
  // M^-1 J^T, the motion by a unit push along the normal.
  mj_solveM(m, d, work->moved, work->row, 1);
  memset(parts, 0, CAUSES * sizeof *parts);
  parts[ACTUATORS] = mju_dot(work->moved, d->qfrc_actuator, nv);
  parts[PASSIVE] = mju_dot(work->moved, d->qfrc_passive, nv);
#ifdef HCB_ADHESION
  // MuJoCo counts the pull of contacts among the passive forces.
  if (m->flg_adhesion) {
    parts[ADHESION] = mju_dot(work->moved, d->qfrc_adhesion, nv);
    parts[PASSIVE] -= parts[ADHESION];
  }
#endif
  // The bias is on the other side of the equation of motion.
  parts[WEIGHT] = -mju_dot(work->moved, d->qfrc_bias, nv);
  if (!(others || d->ne || d->nf || d->nl)) {
    parts[CONTACT] = mju_dot(work->moved, d->qfrc_constraint, nv);
    return 1;
  }
  if ((size_t)rows > work->room) {
    mjtNum* larger = realloc(work->of_rows, 2 * (size_t)rows * sizeof *larger);
    if (!larger) return 0;
    work->of_rows = larger;
    work->room = (size_t)rows;
  }
  mjtNum* by_row = work->of_rows;
  mjtNum* by_others = by_row + work->room;
  mj_mulJacVec(m, d, by_row, work->moved);
  for (int i = 0; i < rows; i++) by_row[i] *= d->efc_force[i];
  // MuJoCo's order of rows: equalities, friction, limits, contacts.
  int friction = (int)d->ne, limits = friction + (int)d->nf, contacts = limits + (int)d->nl;
  parts[EQUALITIES] = mju_sum(by_row, friction);
  parts[FRICTION] = mju_sum(by_row + friction, limits - friction);
  parts[LIMITS] = mju_sum(by_row + limits, contacts - limits);
  int mine = 0, theirs = 0;
  for (int i = contacts; i < rows; i++) {
    if (is_of_pair(pair, d->contact + d->efc_id[i])) {
      by_row[contacts + mine++] = by_row[i];
    } else {
      by_others[theirs++] = by_row[i];
    }
  }
  parts[CONTACT] = mju_sum(by_row + contacts, mine);
  parts[OTHERS] = mju_sum(by_others, theirs);
  return 1;
}

// Note the geoms that touch either one's tree of bodies, besides the pair's own contact.
static void note_others(const mjData* d, const Pair* pair, Launch* launch) {
  for (int i = 0; i < (int)d->ncon; i++) {
    const mjContact* contact = d->contact + i;
    const int* geom = contact->geom;
    // A geom of -1 is none: the contact is that of a flex.
    if (contact->efc_address < 0 || geom[0] < 0 || geom[1] < 0 || is_of_pair(pair, contact)) continue;
    int inside[2] = {pair->in_trees[geom[0]], pair->in_trees[geom[1]]};
    if (!inside[0] && !inside[1]) continue;
    for (int k = 0; k < 2; k++) {
      // The geom outside the trees; both, where the trees touch themselves.
      if (inside[k] && !inside[1 - k]) continue;
      if (launch->first_touch[geom[k]] < 0) launch->first_touch[geom[k]] = launch->steps - 1;
    }
  }
}

static int was_reset(const mjData* d, double time_before, int steps) {
  // MuJoCo sets the time back where it resets an unstable state; in a first step it does not show.
  if (d->time <= time_before) return 1;
  if (steps > 1) return 0;
  for (int i = mjWARN_BADQPOS; i <= mjWARN_BADQACC; i++) {
    if (d->warning[i].number) return 1;
  }
  return 0;
}

// Take up to `steps` steps, and stop `after` steps after the two have parted, or where they turn
// back without a touch; -1: all steps. Of each step, `read` has penetration, rate and force in the
// state before it, (steps, 3), NaN where MuJoCo reset it; `parts` the accelerations by each cause,
// (steps, CAUSES), where `is_counted`, (steps), is true. Returns the steps taken, or NO_MEMORY.
static int take_steps(const mjModel* m, mjData* d, const Pair* pair, Launch* launch, int steps,
                      int after, double* read, double* parts, uint8_t* is_counted, Work* work) {
  for (int n = 0; n < steps; n++) {
    double time_before = d->time;
    mju_copy(work->velocity, d->qvel, (int)m->nv);
    mj_step(m, d);
    launch->steps++;
    if (was_reset(d, time_before, launch->steps)) {
      for (int k = 0; k < 3; k++) read[3 * n + k] = NAN;
      return n + 1;
    }
    Reading now = read_pair(m, d, pair, launch, work);
    double x = now.touches ? now.penetration : depth_in_flight(m, d, pair, launch, now.rate);
    int touched = launch->first_force >= 0;
    if (pair->has_causes) {
      launch->is_apart |= touched && now.force == 0.0 && x <= 0.0 && now.rate < 0.0;
      is_counted[n] = !launch->is_apart && (now.force != 0.0 || !touched);
      if (is_counted[n] &&
          !accelerations(m, d, pair, launch, now.others, work, parts + CAUSES * n)) {
        return NO_MEMORY;
      }
    }
    if (now.force != 0.0 && !touched) launch->first_force = launch->steps - 1;
    if (now.others) note_others(d, pair, launch);
    launch->x = x;
    launch->rate = now.rate;
    read[3 * n] = x;
    read[3 * n + 1] = now.rate;
    read[3 * n + 2] = now.force;
    if (!isfinite(now.rate)) return n + 1;
    if (after < 0 || now.force != 0.0 || now.rate >= 0.0) continue;
    if (launch->first_force < 0) return n + 1;
    if (x <= 0.0) {
      if (n + 1 + after < steps) steps = n + 1 + after;
      after = -1;
    }
  }
  return steps;
}

// `take_steps` of several launches that take turns in `d`, one after the other: each goes on from
// its state in `states`, where the state after it is left. Arrays have a row of `steps` for each
// launch; into `taken` go the steps that each took. Returns 0, NO_MEMORY, or FATAL_ERROR where
// MuJoCo would end the process; `fatal_error` has its words.
int advance(const mjModel* m, mjData* d, const Pair* pair, int count, Launch** launches,
            mjtNum** states, int steps, int after, double* read, double* parts,
            uint8_t* is_counted, int32_t* taken) {
  size_t nv = (size_t)m->nv;
  mjtNum* memory = malloc((7 * nv + 1) * sizeof *memory);
  if (!memory) return NO_MEMORY;
  // Static: a jump leaves local variables that changed undefined.
  static _Thread_local Work work;
  static _Thread_local int result;
  work = (Work){memory, memory + nv, memory + 2 * nv, memory + 3 * nv, memory + 4 * nv, NULL, 0};
  jmp_buf here;
  begin_catching(&here);
  result = FATAL_ERROR;
  if (!setjmp(here)) {
    int least = 0;
    for (int i = 0; i < count && least >= 0; i++) {
      size_t row = (size_t)i * (size_t)steps;
      mj_setState(m, d, states[i], mjSTATE_INTEGRATION);
      taken[i] = take_steps(m, d, pair, launches[i], steps, after, read + 3 * row,
                            parts + CAUSES * row, is_counted + row, &work);
      if (taken[i] < least) least = taken[i];
      mj_getState(m, d, states[i], mjSTATE_INTEGRATION);
    }
    result = least;
  } else {
    result = FATAL_ERROR;
  }
  end_catching();
  free(work.of_rows);
  free(memory);
  return result;
}

// Step a free body, the only one of its model. Of each step: into `contacts` the number of contacts
// in the step before, and into `speeds`, (steps, 6), qvel at its start; into `heights` the body's
// height after it, m. Returns 0, or FATAL_ERROR as `advance`.
int follow(const mjModel* m, mjData* d, int steps, int32_t* contacts, double* speeds,
           double* heights) {
  jmp_buf here;
  begin_catching(&here);
  int result = FATAL_ERROR;
  if (!setjmp(here)) {
    for (int k = 0; k < steps; k++) {
      contacts[k] = (int32_t)d->ncon;
      memcpy(speeds + 6 * (size_t)k, d->qvel, 6 * sizeof *speeds);
      mj_step(m, d);
      heights[k] = d->qpos[2];
    }
    result = 0;
  }
  end_catching();
  return result;
}

static int is_of(const uint8_t* part, int geom) { return geom >= 0 && part[geom]; }

// Read the step just taken: the contacts with a force between a robot, of base `root`, and its
// floor, and into `centre` the Jacobian of the robot's centre of mass, (3, nv). Of each contact, as
// far as there is `room`: geoms, MuJoCo's wrench, (6), frame, (9), and distance, and the Jacobian of
// the robot's material there, (3, nv). Returns the number of contacts, or -1 for a state that MuJoCo
// reset.
int read_floor(const mjModel* m, mjData* d, int root, const uint8_t* of_robot,
               const uint8_t* of_floor, int room, int32_t* geoms, double* wrench, double* frame,
               double* distance, double* jacobian, double* centre) {
  for (int i = mjWARN_BADQPOS; i <= mjWARN_BADQACC; i++) {
    if (d->warning[i].number) return -1;
  }
  size_t size = 3 * (size_t)m->nv;
  int count = 0;
  for (int i = 0; i < (int)d->ncon; i++) {
    const mjContact* contact = d->contact + i;
    int one = contact->geom[0], two = contact->geom[1];
    if (contact->efc_address < 0) continue;
    if (!is_of(of_robot, one) && !is_of(of_robot, two)) continue;
    if (!is_of(of_floor, one) && !is_of(of_floor, two)) continue;
    size_t n = (size_t)count++;
    if (count > room) continue;
    geoms[2 * n] = one;
    geoms[2 * n + 1] = two;
    mj_contactForce(m, d, i, wrench + 6 * n);
    mju_copy(frame + 9 * n, contact->frame, 9);
    distance[n] = contact->dist;
    int body = m->geom_bodyid[is_of(of_robot, two) ? two : one];
    mj_jac(m, d, jacobian + size * n, NULL, contact->pos, body);
  }
  mj_jacSubtreeCom(m, d, centre, root);
  return count;
}
