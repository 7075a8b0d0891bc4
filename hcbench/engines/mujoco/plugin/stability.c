/* Dampers, springs and servos that are too fast for the step, so that MuJoCo's own step gains energy, with any contact or none.

   Of M x'' = -(De + Di) x' - K x a step takes De and K at its start and the damping Di at its end:

     (M + h Di) v+ = (M - h De) v - h K x,   x+ = x + h v+.

   With x+ = z x, and m, de, di, k of a mode y as y.M y, y.De y, y.Di y, y.K y, that is

     (m + h di) z^2 - (2 m + h di - h de - h^2 k) z + m - h de = 0,

   whose roots stay within the unit circle (Jury's criterion) up to z = -1, where 4 m + 2 h di - 2 h de - h^2 k = 0. So the step
   is stable where (2 h De + h^2 K) y = r (4 M + 2 h Di) y has no r above 1. Euler has the damping of joints in Di, unless eulerdamp
   is off, and that of servos in De; implicit integrators have all in Di. RK4, all in De, takes a mode with (z y, h y) of
   z^2 + h de/m z + h^2 k/m = 0 by 1 + z + z^2/2 + z^3/6 + z^4/24, which is to be no longer than 1. */

#define HCB_MODES 60    /* rounds in which the fastest mode is found, */
#define HCB_LARGEST 300 /* in trees of no more dofs; */
#define HCB_CHECKED 256 /* steps after which it is found again, as inertias change with the pose */

#ifdef HCB_ACTUATORS
#define HCB_ACTUATOR_ROW(i) m->actuator_outadr[i]
#else
#define HCB_ACTUATORS m->nu
#define HCB_ACTUATOR_ROW(i) (i)
#endif

typedef struct { /* of a tree: dofs first ... first + n - 1; matrices of shape (n, n) */
  int first, n;
  double *mass, *explicit_damping, *implicit_damping, *stiffness, *factor;
} mode_matrices;

/* Adds scale J^T J, for J a row of columns and values, where all of it is in the tree. */
static void add_square(const mode_matrices* t, int count, const int* column, const double* value, double scale, double* out) {
  for (int i = 0; i < count; i++) {
    if (column[i] < t->first || column[i] >= t->first + t->n) return;
  }
  for (int i = 0; i < count; i++) {
    for (int j = 0; j < count; j++) out[(column[i] - t->first) * t->n + column[j] - t->first] += scale * value[i] * value[j];
  }
}

static void add_joints(const mjModel* m, const mode_matrices* t, double* damping) {
  for (int j = t->first; j < t->first + t->n; j++) {
    int joint = m->dof_jntid[j], type = m->jnt_type[joint], place = (j - t->first) * (t->n + 1);
    damping[place] += joint_damping(m, j);
    if (type == mjJNT_HINGE || type == mjJNT_SLIDE) t->stiffness[place] += m->jnt_stiffness[joint];
  }
}

/* Servos: those whose force is gain u + bias(length, velocity), linear in these. */
static void add_servos(const mjModel* m, const mjData* d, const mode_matrices* t, double* damping) {
  for (int i = 0; i < HCB_ACTUATORS && !(m->opt.disableflags & mjDSBL_ACTUATION); i++) {
    const double* bias = m->actuator_biasprm + mjNBIAS * i;
    int row = HCB_ACTUATOR_ROW(i), adr = d->moment_rowadr[row];
    if (m->actuator_biastype[i] != mjBIAS_AFFINE) continue;
    add_square(t, d->moment_rownnz[row], d->moment_colind + adr, d->actuator_moment + adr, -bias[1], t->stiffness);
    add_square(t, d->moment_rownnz[row], d->moment_colind + adr, d->actuator_moment + adr, -bias[2], damping);
  }
}

static void add_tendons(const mjModel* m, mjData* d, const mode_matrices* t, double* damping) {
  mj_markStack(d);
  int* column = ints(d, m->nv);
  double* value = stack(d, m->nv);
  for (int k = 0; k < m->ntendon; k++) {
    if (m->tendon_damping[k] == 0 && m->tendon_stiffness[k] == 0) continue;
    int count = tendon_columns(m, d, k, column, value);
    add_square(t, count, column, value, m->tendon_stiffness[k], t->stiffness);
    add_square(t, count, column, value, m->tendon_damping[k], damping);
  }
  mj_freeStack(d);
}

static void fill_matrices(const mjModel* m, mjData* d, const mode_matrices* t) {
  int n = t->n, euler = m->opt.integrator == mjINT_EULER, rk4 = m->opt.integrator == mjINT_RK4;
  double* others = euler || rk4 ? t->explicit_damping : t->implicit_damping;
  mj_markStack(d);
  double *unit = stack(d, m->nv), *column = stack(d, m->nv);
  mju_zero(unit, m->nv);
  for (int j = 0; j < n; j++) {
    unit[t->first + j] = 1;
    mj_mulM(m, d, column, unit);
    unit[t->first + j] = 0;
    mju_copy(t->mass + j * n, column + t->first, n);
  }
  mj_freeStack(d);
  add_joints(m, t, euler && takes_forces(m) ? t->implicit_damping : others);
  add_servos(m, d, t, others);
  add_tendons(m, d, t, others);
}

/* y.A y */
static double square_of(const double* A, const double* y, int n) {
  double sum = 0;
  for (int i = 0; i < n; i++) sum += y[i] * row_dot(n, A + i * n, y);
  return sum;
}

/* By how much a step of RK4 makes a mode longer; damping and stiffness over its mass. */
static double growth_under_rk4(double h, double damping, double stiffness) {
  double half = 0.5 * h * damping, inside = half * half - h * h * stiffness, most = 0;
  for (int sign = -1; sign <= 1; sign += 2) {
    double re = -half + (inside > 0 ? sign * sqrt(inside) : 0), im = inside > 0 ? 0 : sqrt(-inside);
    double sum_re = 1, sum_im = 0;
    for (int k = 4; k > 0; k--) { /* 1 + z (1 + z/2 (1 + z/3 (1 + z/4))) */
      double next = 1 + (re * sum_re - im * sum_im) / k;
      sum_im = (re * sum_im + im * sum_re) / k;
      sum_re = next;
    }
    most = fmax(most, hypot(sum_re, sum_im));
  }
  return most;
}

/* The longest step, s, in which a mode does not grow; INFINITY where it never does. */
static double longest_step(const mjModel* m, const mode_matrices* t, const double* y) {
  double mass = square_of(t->mass, y, t->n), stiffness = square_of(t->stiffness, y, t->n) / mass;
  double damping = (square_of(t->explicit_damping, y, t->n) - square_of(t->implicit_damping, y, t->n)) / mass;
  if (m->opt.integrator != mjINT_RK4) { /* h^2 k + 2 h (de - di) = 4 m */
    if (stiffness <= 0) return damping > 0 ? 2 / damping : INFINITY;
    return 4 / (sqrt(damping * damping + 4 * stiffness) + damping); /* a difference would be 0 for a little stiffness */
  }
  double low = 0, high = m->opt.timestep;
  if (growth_under_rk4(high, damping, stiffness) <= 1 + 1e-9) return INFINITY;
  for (int round = 0; round < 50; round++) {
    double middle = 0.5 * (low + high);
    *(growth_under_rk4(middle, damping, stiffness) <= 1 + 1e-9 ? &low : &high) = middle;
  }
  return low;
}

/* The mode of a tree that is the fastest for the step, by powers; y: shape (n,). */
static void find_fastest(const mjModel* m, const mode_matrices* t, double* y, double* next) {
  int n = t->n;
  double h = m->opt.timestep;
  for (int k = 0; k < n * n; k++) t->factor[k] = 4 * t->mass[k] + 2 * h * t->implicit_damping[k];
  mju_cholFactor(t->factor, n, mjMINVAL);
  for (int i = 0; i < n; i++) y[i] = 1 + 0.1 * (i % 7); /* along no symmetry of a robot */
  for (int round = 0; round < HCB_MODES; round++) {
    for (int i = 0; i < n; i++) {
      next[i] = 2 * h * row_dot(n, t->explicit_damping + i * n, y) + h * h * row_dot(n, t->stiffness + i * n, y);
    }
    mju_cholSolve(y, t->factor, next, n);
    if (mju_normalize(y, n) < mjMINVAL) return;
  }
}

/* Names a joint that is damped or driven too fast for the step. */
static void warn_of_fast_mode(const mjModel* m, instance* memory, const mode_matrices* t, const double* y) {
  double longest = longest_step(m, t, y), h = m->opt.timestep;
  if (!(longest < h)) return;
  memory->warned |= WARNED_UNSTABLE;
  int most = 0;
  for (int i = 1; i < t->n; i++) {
    if (fabs(y[i]) > fabs(y[most])) most = i;
  }
  char name[NAME];
  describe(m, mjOBJ_JOINT, m->dof_jntid[t->first + most], name);
  double digit = pow(10, floor(log10(longest)) - 1);
  mju_warning("plugin %s: joint %s is damped or driven too fast for a step of %g s, so that MuJoCo's own step may gain energy, with "
              "any contact or none: set a timestep of %g%s", RESTITUTION_NAME, name, h, digit * floor(longest / digit),
              m->opt.integrator == mjINT_EULER ? ", or the integrator implicitfast for damping" : "");
}

/* At the first step, after a change of the step or of what it takes implicitly, and now and then. */
static void warn_of_servos(const mjModel* m, mjData* d, instance* memory) {
  int kind = 1 + m->opt.integrator + 16 * takes_forces(m);
  int same = memory->timed == m->opt.timestep && memory->timed_kind == kind;
  if (same && (memory->warned & WARNED_UNSTABLE || ++memory->timed_steps % HCB_CHECKED)) return;
  memory->timed = m->opt.timestep;
  memory->timed_kind = kind;
  for (int tree = 0; tree < m->ntree && !(same && memory->warned & WARNED_UNSTABLE); tree++) {
    mode_matrices t = {.first = m->tree_dofadr[tree], .n = m->tree_dofnum[tree]};
    size_t square = (size_t)t.n * t.n;
    if (t.n > HCB_LARGEST) continue;
    double* room = calloc(5 * square + 2 * t.n, sizeof(double));
    if (!room) return;
    t.mass = room;
    t.explicit_damping = room + square;
    t.implicit_damping = room + 2 * square;
    t.stiffness = room + 3 * square;
    t.factor = room + 4 * square;
    fill_matrices(m, d, &t);
    find_fastest(m, &t, room + 5 * square, room + 5 * square + t.n);
    warn_of_fast_mode(m, memory, &t, room + 5 * square);
    free(room);
  }
}
