/* hcbench.restitution: impacts are worked out from the velocities at the start of the step, all at once (impacts.c),
   and enter as a force over this step. The rows that MuJoCo made for these contacts then only let rest: they are
   rewritten, before their reference acceleration is worked out, to e = 0 with friction, or to silence for contacts
   that part. So resting loads, stacks and friction at rest are the solver's. */

#define HCB_STILL 1.1      /* steps of falling whose speed counts as rest */
#define HCB_CREEPS 3e-3    /* of that speed: contacts that rest and slip no faster stick, as the slip of others is known no better */
#define HCB_FAST 0.1       /* rad a step: bodies that turn faster gain energy by MuJoCo's own step */
#define HCB_COARSE_STEP 0.125 /* of a contact's time constant: from there on limbs sink deeper in a step than MuJoCo's contact, ... */
#define HCB_COARSE_FREE 0.3    /* ... and free bodies from there on, ... */
#define HCB_DEEPER 1e-3    /* ... named where that may be more, m */
#define HCB_NAMED 5        /* pairs that are deep, of each kind */
#define HCB_ITERATIONS 5   /* of the solver Newton, without which robots sink; ... */
#define HCB_ITERATIONS_OTHERS 20 /* ... of CG and PGS */

#include "advance.c"
#include "stability.c"
#include "velocity_forces.c"
#include "again.c"
#include "rest.c"

/* Speed that gravity gives in a step to one of the bodies alone, which the other may bear. */
static double fall(const mjModel* m, const int body[2], const double* normal) {
  double g[3], most = 0;
  for (int side = 0; side < 2; side++) {
    gravity_on(m, body[side], g);
    most = larger(most, (side ? -1 : 1) * dot(g, normal));
  }
  return m->opt.timestep * most;
}

static hcb_contact law_of_contact(const mjModel* m, const instance* own, double friction, double fall_) {
  int kind = own->asked_for_e ? HCB_CONSTANT : own->linear ? HCB_LINEAR : HCB_LAW;
  return (hcb_contact){kind, value_of(m, own->asked_for_e ? &own->e : &own->alpha), friction, HCB_STILL * fall_ + 1e-9, 0, 0};
}

static void read_contact(const mjModel* m, const mjData* d, const instance* memory, const mjContact* c, blow* b) {
  double v1[3], v2[3], turn[3], moved[2][3], turned[2][3], lead[2][3];
  b->body[0] = m->geom_bodyid[c->geom[0]];
  b->body[1] = m->geom_bodyid[c->geom[1]];
  b->tendon = -1;
  b->point = c->pos;
  b->frame = c->frame;
  b->dim = c->dim;
  b->cone = c->dim > 1 && m->opt.cone == mjCONE_PYRAMIDAL;
  b->row = c->efc_address;
  b->rows = b->cone ? 2 * (c->dim - 1) : c->dim;
  b->x = c->includemargin - c->dist;
  b->touches = b->x >= 0;
  b->constant = c->solref[0];
  for (int i = 0; i < 5; i++) b->friction[i] = c->dim > 1 ? c->friction[i] : 0;
  velocity_at(m, d, b->body[0], c->pos, v1);
  velocity_at(m, d, b->body[1], c->pos, v2);
  for (int side = 0; side < 2; side++) {
    mocap_velocity(m, memory, b->body[side], c->pos, moved[side], turned[side]);
    lead_of(m, d, b->body[side], lead[side]);
  }
  for (int i = 0; i < 3; i++) {
    v2[i] += moved[1][i] - moved[0][i] - v1[i];
    lead[1][i] -= lead[0][i];
    turn[i] = d->cvel[6 * b->body[1] + i] - d->cvel[6 * b->body[0] + i] + turned[1][i] - turned[0][i];
  }
  for (int side = 0; side < 2; side++) {
    const double* w = d->cvel + 6 * b->body[side];
    b->swing += m->opt.timestep * dot(w, w) * mju_dist3(c->pos, d->xipos + 3 * b->body[side]);
  }
  for (int i = 0; i < 3; i++) {
    b->rate[i] = dot(v2, c->frame + 3 * i);
    b->rate[3 + i] = dot(turn, c->frame + 3 * i);
    b->lead[i] = dot(lead[1], c->frame + 3 * i);
#ifdef HCB_SURFACE_VELOCITY
    b->rate[i] += i ? c->surfacevel[i - 1] : 0;
#endif
  }
}

/* Adds contact k of MuJoCo, which is of entry `e` of the table, after those of the same pair. */
static void add_contact(const mjModel* m, const mjData* d, const instance* memory, int k, int i, int id, blow* b, int is_next) {
  const mjContact* c = d->contact + k;
  int order = is_next ? b[-1].order + 1 : 0;
  mju_zero((double*)b, sizeof(*b) / sizeof(double)); /* faster than an initializer, which compilers make a slow instruction of */
  b->instance = i, b->id = id, b->order = order, b->contact = k;
  read_contact(m, d, memory, c, b);
  double falls = fall(m, b->body, c->frame), most = mju_norm3(m->opt.gravity) * m->opt.timestep;
  b->law = law_of_contact(m, instance_of(d, i), b->friction[0], falls);
  b->steep = falls < HCB_STEEP * most;
  set_lift(m, b, HCB_STILL * most);
}

static int add_limit(const mjModel* m, const mjData* d, int i, blow* all) {
  const instance* own = instance_of(d, i);
  int count = 0;
  for (int k = 0; k < d->nefc && own->tendon >= 0; k++) {
    if (d->efc_type[k] != mjCNSTR_LIMIT_TENDON || d->efc_id[k] != own->tendon) continue;
    double length = d->ten_length[own->tendon], *range = m->tendon_range + 2 * own->tendon;
    if (range[1] - length != d->efc_pos[k]) continue; /* the lower limit */
    blow* b = all + count++;
    *b = (blow){.instance = i, .tendon = own->tendon, .row = k, .rows = 1, .dim = 1};
    b->x = length - range[1];
    b->touches = b->x >= 0;
    b->rate[0] = -d->ten_velocity[own->tendon];
    b->law = law_of_contact(m, own, 0, 0);
  }
  return count;
}

/* Contacts of MuJoCo that have a law, by instance, in MuJoCo's order within each; how many. */
static int gather(const mjModel* m, mjData* d, int first, blow* all) {
  const instance* memory = instance_of(d, first);
  int count = 0, kept = 0, size = d->ncon + 1;
  mj_markStack(d);
  int *start = ints(d, m->nplugin + 1), *of = ints(d, size), *id = ints(d, size), *sorted = ints(d, size);
  memset(start, 0, (m->nplugin + 1) * sizeof(int));
  for (int k = 0; k < d->ncon; k++) {
    const mjContact* c = d->contact + k;
    int is_of_geoms = c->efc_address >= 0 && c->geom[0] >= 0 && c->geom[1] >= 0;
    const pair_entry* e = is_of_geoms ? entry_of(memory, c->geom[0], c->geom[1]) : NULL;
    of[k] = e ? e->instance : -1;
    id[k] = e ? e->id : -1;
    if (e) start[e->instance + 1]++, kept++;
  }
  for (int i = 0; i < m->nplugin; i++) start[i + 1] += start[i];
  for (int k = 0; k < d->ncon; k++) {
    if (of[k] >= 0) sorted[start[of[k]]++] = k; /* start[i] is then where i ends */
  }
  for (int i = first, k = 0; i < m->nplugin; i++) {
    if (m->plugin[i] != m->plugin[first]) continue;
    for (int begin = k; k < kept && of[sorted[k]] == i; k++, count++) {
      add_contact(m, d, memory, sorted[k], i, id[sorted[k]], all + count, k > begin && id[sorted[k - 1]] == id[sorted[k]]);
    }
    count += add_limit(m, d, i, all + count);
  }
  mj_freeStack(d);
  return count;
}

#include "starts.c"

/* The forces of gravity and of springs, which change by the place alone, so that flight keeps their energy; whether there are any.
   Impacts keep it where they know of them: one against a spring that is not known of would gain energy at coarse steps. */
static int force_in_flight(const mjModel* m, const mjData* d, double* force) {
  int any = gravity_force(m, d, force);
  for (int j = 0; j < m->nv; j++) {
    force[j] += d->qfrc_spring[j];
    any |= d->qfrc_spring[j] != 0;
  }
  return any;
}

/* The rows of a contact, and in u its rates without what its velocities and those of the equalities it meets differ by. */
static hcb_rows rows_of(const mjModel* m, mjData* d, const tree_parts* t, const blow* b, double* u) {
  hcb_rows r = {.part = {-1, -1}};
  double *J[2] = {NULL, NULL}, *B[2] = {NULL, NULL};
  if (b->tendon >= 0) {
    tendon_row(m, d, t, b->tendon, r.part, NULL);
  } else {
    set_parts(m, t, b->body, r.part);
  }
  for (int s = 0; s < 2 && r.part[s] >= 0; s++) {
    size_t size = 3 * (size_t)part_size(t, r.part[s]);
    r.J[s] = J[s] = stack(d, size);
    r.B[s] = B[s] = stack(d, size);
    memset(J[s], 0, size * sizeof(double));
  }
  if (b->tendon >= 0) {
    tendon_row(m, d, t, b->tendon, r.part, J[0]);
  } else {
    make_rows(m, d, t, b->body, b->point, b->frame, b->dim > 1 ? 3 : 1, r.part, J);
  }
  for (int k = 0; k < 3; k++) u[k] = k && b->dim == 1 ? 0 : b->rate[k] + b->lead[k];
  hold_rows(t, d, r.part, J, d->qvel, u);
  for (int s = 0; s < 2 && r.part[s] >= 0; s++) {
    memcpy(B[s], J[s], 3 * (size_t)part_size(t, r.part[s]) * sizeof(double));
    solve_three(m, d, t, r.part[s], B[s]);
  }
  return r;
}

/* Contacts that touch, as what impacts.c works on; `of`: which of all, `u`: rates, `gains`: what gravity and springs add to them in
   the step, `calm`: the speed that counts as rest. */
static hcb_system make_system(const mjModel* m, mjData* d, const tree_parts* t, blow** of, int n, const double* falls,
                              double* u, double* gains, double* calm) {
  double h = m->opt.timestep;
  hcb_rows* rows = mj_stackAllocByte(d, (n + 1) * sizeof(hcb_rows), sizeof(double));
  hcb_contact* c = mj_stackAllocByte(d, (n + 1) * sizeof(hcb_contact), sizeof(double));
  for (int i = 0; i < n; i++) {
    rows[i] = rows_of(m, d, t, of[i], u + 3 * i);
    c[i] = of[i]->law;
    memset(gains + 3 * i, 0, 3 * sizeof(double));
    if (falls) along_rows(t, rows[i].part, rows[i].B, falls, gains + 3 * i);
    for (int k = 0; k < 3; k++) gains[3 * i + k] *= h;
    double gained = -gains[3 * i];
    if (of[i]->tendon >= 0) c[i].still += HCB_STILL * fmax(0, gained);
    calm[i] = c[i].still;
    hcb_under_gravity(c + i, of[i]->x, -u[3 * i], gained / h, h, m->opt.integrator == mjINT_RK4);
  }
  return (hcb_system){n, t->parts, t->at, rows, c};
}

/* How fast a contact slips, along the direction of (u1, u2), and by how much MuJoCo's cones part it for that: each edge of a
   pyramid by its own friction times its rate, an elliptic cone by the norm of these; of turning as of sliding. */
static void set_slip(blow* b, double u1, double u2, double slip) {
  double fastest = length(u1, u2), share = fastest > 0 ? slip / fastest : 0;
  double rate[5] = {share * u1, share * u2, b->turn[0], b->turn[1], b->turn[2]}, most = 0, sum = 0;
  for (int k = 0; k < b->dim - 1; k++) {
    double parts = fabs(b->friction[k] * rate[k]);
    most = larger(most, parts);
    sum += parts * parts;
  }
  b->slip = slip;
  b->dilation = b->cone ? most : sqrt(sum);
}

/* Adds to the rates at which contacts with friction against turning turn what impulses change them by. */
static void add_turning(const mjModel* m, mjData* d, blow** of, int n, const double* impulse) {
  int any = 0;
  for (int i = 0; i < n; i++) any |= of[i]->dim > 3;
  if (!any) return;
  double* change = stack(d, m->nv);
  mj_solveM(m, d, change, impulse, 1);
  for (int i = 0; i < n; i++) {
    for (int side = 0; side < 2 && of[i]->dim > 3; side++) {
      int body = m->body_weldid[of[i]->body[side]];
      for (int j = m->body_dofadr[body] + m->body_dofnum[body] - 1; j >= 0; j = m->dof_parentid[j]) {
        for (int k = 0; k < 3; k++) of[i]->turn[k] += (side ? 1 : -1) * change[j] * dot(d->cdof + 6 * j, of[i]->frame + 3 * k);
      }
    }
  }
}

/* Impacts of contacts that touch, into `impulse`; which of them rest then, and slip how fast. impulse: NULL where none collides;
   falls: force_in_flight, NULL without. Whether the impacts came to an end. */
static int collide(const mjModel* m, mjData* d, int first, blow* all, int count, double* impulse, const double* falls) {
  int n = 0;
  mj_markStack(d);
  blow** of = mj_stackAllocByte(d, (count + 1) * sizeof(blow*), sizeof(double));
  for (int i = 0; i < count; i++) {
    if (all[i].touches) of[n++] = all + i;
  }
  tree_parts t = make_parts(m, d, first, 1);
  factor_held(m, d, &t);
  size_t rows = 3 * (size_t)n;
  double *u = stack(d, 4 * rows + n), *p = u + rows, *gains = p + rows, *slip = gains + rows, *calm = slip + rows;
  hcb_system s = make_system(m, d, &t, of, n, falls, u, gains, calm);
  double* work = stack(d, hcb_impacts_work(n, t.parts, m->nv));
  double within = m->opt.integrator == mjINT_RK4 ? 0 : 0.5; /* of the step, where impacts are (hcb_under_gravity) */
  for (size_t i = 0; i < rows; i++) u[i] += within * gains[i];
  int ended = !impulse || hcb_impacts(&s, u, p, work) < hcb_most_rounds(n), *rests = ints(d, n);
  for (int i = 0; i < (int)rows; i++) {
    u[i] -= within * gains[i];
    gains[i] += u[i];
    const hcb_rows* r = s.rows + i / 3;
    for (int side = 0; side < 2 && r->part[side] >= 0 && impulse && p[i] != 0; side++) {
      part_add(&t, r->part[side], r->J[side] + (size_t)(i % 3) * part_size(&t, r->part[side]), p[i], impulse);
    }
  }
  for (int i = 0; i < n; i++) rests[i] = of[i]->rests = u[3 * i] <= calm[i];
  hcb_resting_slip(&s, gains, rests, slip, work);
  if (impulse) add_turning(m, d, of, n, impulse);
  for (int i = 0; i < n; i++) {
    of[i]->parting = u[3 * i];
    double slides = length(u[3 * i + 1], u[3 * i + 2]);
    set_slip(of[i], u[3 * i + 1], u[3 * i + 2], rests[i] ? fmin(slip[i], slides) : slides);
  }
  mj_freeStack(d);
  return ended;
}

/* Flags under which energy was measured, by MuJoCo's names: their bits differ between versions. */
static const char* const tried_flags =
    " Constraint Equality Frictionloss Limit Contact Passive Spring Damper Gravity Clampctrl Warmstart Filterparent Actuation"
    " Refsafe Sensor Midphase Eulerdamp AutoReset NativeCCD Island MultiCCD Energy Fwdinv InvDiscrete Sleep DiagExact"
    " Speculative ";

static void warn_of_flags(int flags, const char* const* names, int count) {
  for (int k = 0; k < 31; k++) {
    char name[NAME];
    if (!(flags & (1 << k))) continue;
    snprintf(name, sizeof(name), " %s ", k < count ? names[k] : "without a name");
    if (!strstr(tried_flags, name)) mju_warning("plugin %s was never tried with the flag%s", RESTITUTION_NAME, name);
  }
}

/* Names once a solver that stops before bodies which joints drive can rest. */
static void warn_of_iterations(const mjModel* m, const mjData* d, instance* memory) {
  int least = m->opt.solver == mjSOL_NEWTON ? HCB_ITERATIONS : HCB_ITERATIONS_OTHERS;
  if (memory->iterations == m->opt.iterations || !is_loaded(m, d)) return;
  memory->iterations = m->opt.iterations;
  if (m->opt.iterations >= least) return;
  mju_warning("plugin %s: the solver stops after iterations=\"%d\", before robots rest: they may move on, and their feet sink, as on "
              "MuJoCo's own contact. Set at least %d", RESTITUTION_NAME, m->opt.iterations, least);
}

/* How far the joint turns in a step, rad. */
static double turn_of(const mjModel* m, const double* velocity, int joint) {
  const double* v = velocity + m->jnt_dofadr[joint];
  int type = m->jnt_type[joint];
  if (type == mjJNT_SLIDE) return 0;
  return m->opt.timestep * (type == mjJNT_HINGE ? fabs(v[0]) : mju_norm3(type == mjJNT_FREE ? v + 3 : v));
}

static void warn_of_turn(const mjModel* m, instance* memory, int body, double turn, int wild) {
  int kind = wild ? WARNED_WILD : WARNED_FAST;
  if (!(turn > HCB_FAST) || memory->warned & kind) return;
  double h = m->opt.timestep, finer = h * HCB_FAST / turn, digit = pow(10, floor(log10(finer)));
  double count = floor(finer / digit);
  /* The logarithm of what is just below a power of ten may be that of the power. */
  if (count < 1) {
    digit /= 10;
    count = 9;
  }
  const char* name = mj_id2name(m, mjOBJ_BODY, body);
  memory->warned |= kind | WARNED_FAST;
  mju_warning("plugin %s: body %d \"%s\" %s by %.2g rad in a step of %g s, in which MuJoCo's own step may gain energy: set a "
              "timestep of %g", RESTITUTION_NAME, body, name ? name : "",
              wild ? "has MuJoCo's own contact, as after the impact it would turn" : "turns", turn, h,
              digit * count);
}

/* Names once a body whose joint turns so far in a step that MuJoCo's own step gains energy; free bodies that nothing holds
   do so only where they roll. */
static void warn_of_turns(const mjModel* m, const mjData* d, const blow* all, int count, instance* memory) {
  double fastest = HCB_FAST / m->opt.timestep;
  if (memory->warned & WARNED_FAST) return;
  for (int j = 0; j < m->njnt && count; j++) {
    if (d->ne > 0 || !is_lone(m, m->jnt_dofadr[j])) warn_of_turn(m, memory, m->jnt_bodyid[j], turn_of(m, d->qvel, j), 0);
  }
  for (int i = 0; i < count; i++) {
    for (int side = 0; side < 2 && all[i].rests; side++) {
      int body = all[i].body[side];
      const double* w = d->cvel + 6 * body;
      if (dot(w, w) > fastest * fastest) warn_of_turn(m, memory, body, m->opt.timestep * mju_norm3(w), 0);
    }
  }
}

/* The joint of a tree (-1: of any) that turns furthest in a step at these velocities, without free bodies that nothing holds;
   -1: none by more than HCB_FAST. */
static int furthest_joint(const mjModel* m, const mjData* d, const double* velocity, int tree) {
  double most = HCB_FAST;
  int found = -1;
  for (int j = 0; j < m->njnt; j++) {
    int dof = m->jnt_dofadr[j];
    double turn = turn_of(m, velocity, j);
    if (turn <= most || (d->ne == 0 && is_lone(m, dof)) || (tree >= 0 && m->dof_treeid[dof] != tree)) continue;
    most = turn;
    found = j;
  }
  return found;
}

/* Marks trees that impacts would let turn so fast that MuJoCo's own step gains energy without end, and names one once; whether
   there are any. In them a step's Coriolis and centrifugal forces change the velocities, in the norm of kinetic energy, by
   more than that share, less what the tree has as a whole; those of bodies that equalities hold are in the equalities, so
   there the angle stands for it. A wheel may turn as fast as it likes. */
static int find_wild(const mjModel* m, mjData* d, instance* memory, const double* change) {
  int nv = m->nv, found = 0;
  mj_markStack(d);
  double *after = stack(d, nv), *momentum = stack(d, nv), *force = stack(d, nv), *acceleration_ = stack(d, nv);
  mju_add(after, d->qvel, change, nv);
  if (furthest_joint(m, d, after, -1) >= 0) {
    double* still = momentum;
    mju_copy(acceleration_, d->qvel, nv);
    mju_zero(still, nv);
    bias_at(m, d, still, force);
    mju_scl(still, force, -1, nv);
    bias_at(m, d, after, force);
    mju_addTo(force, still, nv);
    mju_copy(d->qvel, acceleration_, nv);
    mj_comVel(m, d);
    mj_mulM(m, d, momentum, after);
    mj_solveM(m, d, acceleration_, force, 1);
    for (int tree = 0; tree < m->ntree; tree++) {
      int joint = furthest_joint(m, d, after, tree);
      double before = 0, bends = 0, share = HCB_FAST / m->opt.timestep;
      for (int k = 0; k < nv; k++) {
        if (m->dof_treeid[k] != tree) continue;
        before += momentum[k] * after[k];
        bends += force[k] * acceleration_[k];
        if (m->jnt_type[m->dof_jntid[k]] != mjJNT_FREE || k - m->jnt_dofadr[m->dof_jntid[k]] >= 3) continue;
        before -= momentum[k] * momentum[k] / m->body_subtreemass[m->dof_bodyid[k]]; /* of the tree as a whole */
      }
      if (memory->wild[tree] || joint < 0 || (d->ne == 0 && bends <= share * share * before)) continue;
      memory->wild[tree] = found = 1;
      warn_of_turn(m, memory, m->jnt_bodyid[joint], turn_of(m, after, joint), 1);
    }
  }
  mj_freeStack(d);
  return found;
}

static void keep_blow(blow* all, int to, int from) {
  if (to != from) all[to] = all[from];
}

/* Leaves out contacts of trees that are marked; how many are left. */
static int leave_out_wild(const mjModel* m, const instance* memory, blow* all, int count) {
  int left = 0;
  for (int i = 0; i < count; i++) {
    int wild = 0;
    for (int side = 0; side < 2 && all[i].tendon < 0; side++) {
      int tree = m->body_treeid[all[i].body[side]];
      wild |= tree >= 0 && memory->wild[tree];
    }
    if (!wild) keep_blow(all, left++, i);
  }
  return left;
}

/* Names once a mocap body that has moved unevenly in several steps, not one that has begun to move or was put elsewhere. */
static void warn_of_jumps(const mjModel* m, const mjData* d, instance* memory, int body) {
  const char* name = mj_id2name(m, mjOBJ_BODY, body);
  if (++memory->jumps < HCB_JUMPS || memory->warned & WARNED_UNEVEN) return;
  memory->warned |= WARNED_UNEVEN;
  mju_warning("plugin %s: mocap body %d \"%s\" still moves unevenly at %g s, so its contacts are MuJoCo's own in such steps: move it "
              "in every step, by little more or less than in the last", RESTITUTION_NAME, body, name ? name : "", d->time);
}

/* Leaves out contacts with mocap bodies that move unevenly; how many are left. */
static int leave_out_uneven(const mjModel* m, const mjData* d, instance* memory, blow* all, int count) {
  int left = 0, uneven = -1;
  for (int i = 0; i < count; i++) {
    int is_even_ = 1;
    for (int side = 0; side < 2 && all[i].tendon < 0; side++) {
      const mocap* own = moving_of(m, memory, all[i].body[side]);
      if (!own || !own->uneven) continue;
      is_even_ = 0;
      if (all[i].touches) uneven = all[i].body[side];
    }
    if (is_even_) keep_blow(all, left++, i);
  }
  if (uneven >= 0) warn_of_jumps(m, d, memory, uneven);
  return left;
}

/* Refuses what it is wrong under, and names once what it was never tried with: an option of a later MuJoCo. */
static void check_options(const mjModel* m, instance* memory, int first) {
#ifdef HCB_MIDPOINT
  int midpoint = 0, implicit = m->opt.integrator == mjINT_IMPLICIT || m->opt.integrator == mjINT_IMPLICITFAST;
  for (int j = 0; j < m->nv && implicit; j++) midpoint |= is_lone(m, j);
  if (midpoint && !(m->opt.enableflags & mjENBL_INVDISCRETE)) {
    fail(m, first, "this version of MuJoCo turns free bodies by a rule of its own under implicit integrators: set the flag "
         "invdiscrete=\"enable\", which changes no other step, or integrator=\"Euler\" or \"RK4\"");
  }
#endif
  if (m->opt.solver == mjSOL_CG && is_dual(m)) {
    fail(m, first, "noslip_iterations takes the forces of the solver CG, which do not settle: set solver=\"Newton\", or "
         "noslip_iterations=\"0\"");
  }
#ifdef HCB_SLEEP
  if (m->opt.enableflags & mjENBL_SLEEP && m->opt.integrator == mjINT_RK4 && m->opt.solver != mjSOL_NEWTON) {
    fail(m, first, "under RK4 the flag sleep wakes what sleeps every few steps, and the solvers CG and PGS then let it sink: set "
         "solver=\"Newton\", or the flag sleep=\"disable\"");
  }
#endif
  if (m->opt.integrator > mjINT_IMPLICITFAST) fail(m, first, "the integrator must be Euler, implicit, implicitfast or RK4");
  if (m->opt.solver > mjSOL_NEWTON) fail(m, first, "the solver must be Newton, CG or PGS");
  if (m->opt.cone > mjCONE_ELLIPTIC) fail(m, first, "the cone must be pyramidal or elliptic");
  if (m->opt.enableflags & mjENBL_OVERRIDE) fail(m, first, "the flag override must be off");
  if (memory->flags[0] == m->opt.enableflags && memory->flags[1] == m->opt.disableflags) return;
  memory->flags[0] = m->opt.enableflags;
  memory->flags[1] = m->opt.disableflags;
  warn_of_flags(m->opt.enableflags, mjENABLESTRING, mjNENABLE);
  warn_of_flags(m->opt.disableflags, mjDISABLESTRING, mjNDISABLE);
}

/* Names once a landing that may end deeper than on MuJoCo's own contact: bodies go in by up to a step's travel before they meet
   their impact, and on MuJoCo's contact by about a third of the travel in its time constant; limbs by less, as others stop them. */
static void warn_of_depth(const mjModel* m, const blow* all, int count, instance* memory) {
  double h = m->opt.timestep;
  for (int i = 0; i < count && !(memory->warned & WARNED_DEEPER); i++) {
    const blow* b = all + i;
    if (b->tendon >= 0 || !b->touches || b->constant <= 0 || !(-h * b->rate[0] > HCB_DEEPER)) continue;
    for (int side = 0; side < 2; side++) {
      int body = m->body_weldid[b->body[side]], dof = m->body_dofadr[m->body_rootid[body]];
      if (body == 0 || m->body_dofnum[body] == 0) continue;
      double share = dof >= 0 && is_lone(m, dof) ? HCB_COARSE_FREE : HCB_COARSE_STEP;
      if (h <= share * b->constant) continue;
      const char* name = mj_id2name(m, mjOBJ_BODY, body);
      memory->warned |= WARNED_DEEPER;
      mju_warning("plugin %s: body %d \"%s\" may land more than %g mm deeper than on MuJoCo's own contact, whose time constant is "
                  "%g s: set a timestep of at most %g", RESTITUTION_NAME, body, name ? name : "", 1e3 * HCB_DEEPER, b->constant,
                  share * b->constant);
      return;
    }
  }
}

/* Once a step: lowers how deep pairs may be after a landing, as it is lifted. */
static void lower_what_is_let(const mjModel* m, const mjData* d, int first) {
  double h = m->opt.timestep, lifted = HCB_LIFTS * HCB_STILL * mju_norm3(m->opt.gravity) * h * h;
  if (instance_of(d, first)->seen == d->time) return;
  for (int i = first; i < m->nplugin; i++) {
    if (m->plugin[i] == m->plugin[first]) instance_of(d, i)->lets = fmax(0, instance_of(d, i)->lets - lifted);
  }
}

static void warn_of_one_sunk(const mjModel* m, const mjData* d, const blow* b, int starts) {
  int side = m->body_treeid[b->body[1]] >= 0;
  char name[2][NAME];
  describe(m, mjOBJ_BODY, b->body[side], name[0]);
  describe(m, mjOBJ_BODY, b->body[!side], name[1]);
  if (starts) {
    mju_warning("plugin %s: body %s starts %.3g mm inside body %s. It is lifted where it rests, slowly, and stays so elsewhere; "
                "MuJoCo's own contact would throw it out: start it outside", RESTITUTION_NAME, name[0], 1e3 * b->x, name[1]);
  } else {
    mju_warning("plugin %s: body %s is %.2g mm deep in body %s at %g s, more than %g mm deeper than its speed and its weight would take "
                "it on MuJoCo's own contact: set a finer timestep than %g s, let nothing crush it, or give this pair MuJoCo's own "
                "contact", RESTITUTION_NAME, name[0], 1e3 * b->x, name[1], d->time, 1e3 * HCB_DEEPER, m->opt.timestep);
  }
}

/* Names each pair that sank, or started inside, once; of many the first few. */
static void warn_of_sunk_pair(const mjModel* m, const mjData* d, instance* memory, const blow* b, int starts) {
  instance* own = instance_of(d, b->instance);
  int kind = starts ? WARNED_INSIDE : WARNED_SUNK, *named = memory->sunk_pairs + starts;
  if (own->warned & kind || *named > HCB_NAMED) return;
  own->warned |= kind;
  if (++*named <= HCB_NAMED) {
    warn_of_one_sunk(m, d, b, starts);
  } else {
    mju_warning("plugin %s: more than %d pairs %s: the others are not named", RESTITUTION_NAME, HCB_NAMED,
                starts ? "start inside each other" : "are deeper than on MuJoCo's own contact");
  }
}

/* Names pairs that are deeper than MuJoCo's own contact would let them: after an approach u about a third of u in its time constant,
   at rest about g times the square of a third of that. A state that does not follow the last one may be as deep as it is: what is as
   deep a step later has started inside. */
static void warn_of_sunk(const mjModel* m, const mjData* d, const blow* all, int count, instance* memory) {
  double h = m->opt.timestep;
  int follows = memory->seen == d->time || is_next(m, d, memory);
  const blow* deepest[2] = {NULL, NULL}; /* of a pair: that sank, and that started inside */
  for (int i = 0; i < count; i++) {
    const blow* b = all + i;
    if (b->tendon >= 0) continue;
    instance* own = instance_of(d, b->instance);
    double third = third_of_constant(m, b);
    own->lets = larger(own->lets, follows ? -b->rate[0] * third : fabs(b->rate[0]) * fmax(third, h));
    own->starts_in = larger(own->starts_in, follows ? 0 : b->x);
    if (follows && b->x > larger(own->lets, own_depth(m, third)) + HCB_DEEPER) {
      const blow** one = deepest + (b->x <= own->starts_in + HCB_DEEPER);
      if (!*one || b->x > (*one)->x) *one = b;
    }
    if (i + 1 < count && all[i + 1].instance == b->instance) continue;
    for (int starts = 0; starts < 2; starts++) {
      if (deepest[starts]) warn_of_sunk_pair(m, d, memory, deepest[starts], starts);
      deepest[starts] = NULL;
    }
  }
}

/* Names once a mocap body that presses others against what cannot move, as it goes on whatever it meets. */
static void warn_of_jam(const mjModel* m, const mjData* d, instance* memory, const blow* b) {
  int side = mocap_of(m, b->body[0]) < 0;
  char name[2][NAME];
  if (memory->warned & WARNED_JAM) return;
  memory->warned |= WARNED_JAM;
  for (int k = 0; k < 2; k++) describe(m, mjOBJ_BODY, b->body[k ? !side : side], name[k]);
  mju_warning("plugin %s: mocap body %s jams body %s at %g s, so that impacts come to no end: contact is MuJoCo's own in such steps. "
              "Stop it earlier, or weld a free body to it, which pushes in its place", RESTITUTION_NAME, name[0], name[1], d->time);
}

/* Whether all of a vector is finite, and no larger than what MuJoCo takes. */
static int is_sound(const double* x, int n) {
  for (int k = 0; k < n; k++) {
    if (mju_isBad(x[k])) return 0;
  }
  return 1;
}

/* The first contact of a mocap body that moves; NULL: none. */
static const blow* moved_contact(const mjModel* m, const instance* memory, const blow* all, int count) {
  for (int i = 0; i < count; i++) {
    for (int side = 0; side < 2 && all[i].touches && all[i].tendon < 0; side++) {
      const mocap* own = moving_of(m, memory, all[i].body[side]);
      if (own && mju_norm(own->speed, 6) > 0) return all + i;
    }
  }
  return NULL;
}

/* Impulses of contacts that touch, without trees that they would let turn too fast, and in `change` what they change the velocities
   by; how many contacts are left: 0 where a mocap body jams others, so that impacts come to no end. */
static int collide_tame(const mjModel* m, mjData* d, int first, blow* all, int count, double* impulse, double* change) {
  instance* memory = instance_of(d, first);
  double* falls = stack(d, m->nv);
  int any = force_in_flight(m, d, falls), ended = 1;
  for (int wild = 1; wild && ended;) {
    mju_zero(impulse, m->nv);
    ended = collide(m, d, first, all, count, impulse, any ? falls : NULL) || !moved_contact(m, memory, all, count);
    mj_solveM(m, d, change, impulse, 1);
    wild = ended && !memory->is_again && find_wild(m, d, memory, change);
    if (ended) count = leave_out_wild(m, memory, all, count);
  }
  if (ended) return count;
  warn_of_jam(m, d, memory, moved_contact(m, memory, all, count));
  for (int tree = 0; tree < m->ntree; tree++) memory->wild[tree] = 1; /* in the stages of RK4, too */
  return 0;
}

/* Adds to the passive forces what lets contacts collide, over the step. Where that is without bound nothing is added, and it
   says so once. How many contacts are left. */
static int add_impulses(const mjModel* m, mjData* d, int first, int stage, blow* all, int count) {
  instance* memory = instance_of(d, first);
  int nv = m->nv;
  double *impulse = stage ? memory->impulse : stack(d, nv), *without = stack(d, nv), *change = stack(d, nv);
  mju_copy(without, d->qfrc_passive, nv);
  count = collide_tame(m, d, first, all, count, impulse, change);
  int sound = count > 0 && is_sound(impulse, nv);
  if (sound) {
    mju_addToScl(d->qfrc_passive, impulse, 1 / m->opt.timestep, nv);
    shift_bias(m, d, impulse, change, d->qfrc_passive);
    if (!stage) shift_velocity_forces(m, d, change, d->qfrc_passive);
  }
  if (!sound || !is_sound(d->qfrc_passive, nv)) {
    mju_zero(impulse, nv);
    mju_copy(d->qfrc_passive, without, nv);
    if (count > 0 && !(memory->warned & WARNED_UNSOUND)) {
      mju_warning("plugin %s: impacts at %g s came out without bound, so contact is MuJoCo's own in such steps: masses or speeds are "
                  "too far apart", RESTITUTION_NAME, d->time);
      memory->warned |= WARNED_UNSOUND;
    }
    return 0;
  }
  if (stage) start_again(m, d, memory, change); /* RK4 has the velocities after the impulse in all its rows then */
  if (!stage) shift_own_contacts(m, d, change, all, count);
  return count;
}

static void add_impacts(const mjModel* m, mjData* d, int first) {
  instance* memory = instance_of(d, first);
  int stage = stage_of(m, d, memory), nv = m->nv, collides = 0, slides = 0;
  double h = m->opt.timestep;
  check_options(m, memory, first);
  warn_of_iterations(m, d, memory);
  warn_of_servos(m, d, memory);
  mj_markStack(d);
  blow* all = mj_stackAllocByte(d, (d->ncon + d->nefc + 1) * sizeof(blow), sizeof(double));
  if (stage < 2) follow_mocaps(m, d, memory);
  int count = leave_out_uneven(m, d, memory, all, gather(m, d, first, all));
  memory->stand = 0;
  if (stage < 2) {
    for (int i = 0; i < count; i++) {
      blow* b = all + i;
      b->rests = b->touches && b->rate[0] <= b->law.still;
      b->parting = b->rate[0];
      mju_copy3(b->turn, b->rate + 3);
      set_slip(b, b->rate[1], b->rate[2], b->rests ? 0 : length(b->rate[1], b->rate[2]));
      double slow = HCB_CREEPS * b->law.still, *u = b->rate;
      slides |= b->rests && b->friction[0] > 0 && u[1] * u[1] + u[2] * u[2] > slow * slow;
      collides |= b->touches && (-b->rate[0] > b->law.still || b->tendon >= 0);
    }
    warn_of_turns(m, d, all, count, memory);
    warn_of_depth(m, all, count, memory);
    lower_what_is_let(m, d, first);
    warn_of_sunk(m, d, all, count, memory);
    memory->seen = d->time;
    if (memory->trees != m->ntree) memory->wild = realloc(memory->wild, ((memory->trees = m->ntree) + 1) * sizeof(int));
    if (!memory->is_again) memset(memory->wild, 0, m->ntree * sizeof(int));
    if (stage) {
      if (memory->dofs < nv) memory->impulse = realloc(memory->impulse, (memory->dofs = nv) * sizeof(double));
      mju_zero(memory->impulse, nv);
      memory->starts = 0;
    }
    if (collides) {
      count = add_impulses(m, d, first, stage, all, count);
    } else if (slides) {
      double* falls = stack(d, nv);
      collide(m, d, first, all, count, NULL, force_in_flight(m, d, falls) ? falls : NULL);
    }
  } else {
    count = leave_out_wild(m, memory, all, count);
    for (int j = 0; j < nv; j++) d->qfrc_passive[j] += memory->impulse[j] / h;
    if (stage < 4) { /* which has half of the change in its velocities */
      double* change = stack(d, nv);
      mj_solveM(m, d, change, memory->impulse, 1);
      mju_scl(change, change, 0.5, nv);
      shift_bias(m, d, memory->impulse, change, d->qfrc_passive);
    }
  }
  int loaded = is_loaded(m, d), wedged = 0;
  for (int i = 0; i < count; i++) wedged |= all[i].steep && all[i].touches;
  for (int i = 0; i < count; i++) {
    all[i].held = (loaded || all[i].steep) && all[i].touches && !all[i].rests;
    int is_new = stage < 2 || !planned(memory, all[i].instance, all[i].id, all[i].order);
    if (!is_new || !is_lifted(m, memory, all + i)) set_rows(m, d, memory, all + i, stage, loaded, wedged);
  }
  start_from_last(m, d, memory, all, count);
  mj_freeStack(d);
}
