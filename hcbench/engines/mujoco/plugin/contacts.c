/* What both plug-ins need of a contact: velocities, rows of the Jacobian, gravity, and the stages of RK4. */

#if mjVERSION_HEADER == 3007000 || mjVERSION_HEADER == 3008000
#define HCB_MIDPOINT /* these give free bodies a velocity of their own after the step (mj_midpoint), in contact, too */
#endif
#define HCB_TURNS 8 /* rounds in which what an integrator adds of Coriolis forces enters */
#define HCB_TURN 60 /* of its small steps in which a body turns freely, how many a radian */

static double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static double row_dot(int nv, const double* a, const double* b) {
  double sum = 0;
  for (int j = 0; j < nv; j++) sum += a[j] * b[j];
  return sum;
}

static void velocity_at(const mjModel* m, const mjData* d, int body, const double* p, double* out) {
  const double *w = d->cvel + 6 * body, *com = d->subtree_com + 3 * m->body_rootid[body];
  double x = p[0] - com[0], y = p[1] - com[1], z = p[2] - com[2];
  out[0] = w[3] + w[1] * z - w[2] * y;
  out[1] = w[4] + w[2] * x - w[0] * z;
  out[2] = w[5] + w[0] * y - w[1] * x;
}

static double* stack(mjData* d, size_t count) { return mj_stackAllocByte(d, (count + 1) * sizeof(double), sizeof(double)); }

/* Coriolis and gyroscopic forces and gravity at these velocities; comVel of the data is of them from then on. */
static void bias_at(const mjModel* m, mjData* d, const double* velocity, double* bias) {
  mju_copy(d->qvel, velocity, m->nv);
  mj_comVel(m, d);
  mj_rne(m, d, 0, bias);
}

/* Whether a degree of freedom is one of a single free body. */
static int is_lone(const mjModel* m, int dof) {
  int root = m->body_rootid[m->dof_bodyid[dof]], first = m->body_dofadr[root], next = first + 6;
  if (m->body_jntnum[root] != 1 || m->jnt_type[m->body_jntadr[root]] != mjJNT_FREE) return 0;
  return next == m->nv || m->dof_treeid[next] != m->dof_treeid[first];
}

/* Gyroscopic and centrifugal forces of a free body with all that is fixed to it, at velocities v of its six dofs. */
static void lone_bias(const mjData* d, int body, const double* v, double* bias) {
  const double *R = d->xmat + 9 * body, *I = d->crb + 10 * body; /* I: about its centre of mass, along world axes */
  double w[3], r[3], spin[3], torque[3], arm[3];
  mju_mulMatVec3(w, R, v + 3);
  mju_sub3(r, d->subtree_com + 3 * body, d->xpos + 3 * body);
  for (int i = 0; i < 3; i++) spin[i] = I[i] * w[i];
  spin[0] += I[3] * w[1] + I[4] * w[2];
  spin[1] += I[3] * w[0] + I[5] * w[2];
  spin[2] += I[4] * w[0] + I[5] * w[1];
  mju_cross(torque, w, spin);
  mju_cross(arm, w, r);
  mju_cross(bias, w, arm);
  mju_scl3(bias, bias, I[9]);
  mju_cross(arm, r, bias);
  mju_addTo3(torque, arm);
  mju_mulMatTVec3(bias + 3, R, torque);
}

/* Whether the integrator adds to the Coriolis forces what is linear in a change of the velocities. */
static int is_linear(const mjModel* m, int lone) {
  if (m->opt.integrator == mjINT_IMPLICIT) return 1;
  return lone && m->opt.integrator == mjINT_IMPLICITFAST && mjVERSION_HEADER >= 3011000;
}

/* The inverse of a symmetric matrix, shape (3, 3). */
static void invert(const double* a, double* out) {
  double rows[3][3];
  mju_cross(rows[0], a + 3, a + 6);
  mju_cross(rows[1], a + 6, a);
  mju_cross(rows[2], a, a + 3);
  for (int i = 0; i < 9; i++) out[i] = rows[i / 3][i % 3] / mju_dot3(a, rows[0]);
}

/* R^T A R, a matrix in the body's axes; shapes (3, 3). MuJoCo's own products of 3 x 3 matrices are not public. */
static void in_body_axes(const double* R, const double* A, double* out) {
  double half[9];
  for (int i = 0; i < 9; i++) half[i] = R[i / 3] * A[i % 3] + R[3 + i / 3] * A[3 + i % 3] + R[6 + i / 3] * A[6 + i % 3];
  for (int i = 0; i < 9; i++) {
    const double* row = half + i / 3 * 3;
    out[i] = row[0] * R[i % 3] + row[1] * R[3 + i % 3] + row[2] * R[6 + i % 3];
  }
}

/* w x (w x r): the centripetal acceleration of a free body's centre of mass about its frame; w: at its velocities v. */
static void centripetal(const mjData* d, int body, const double* v, double* out) {
  double w[3], r[3], arm[3];
  mju_sub3(r, d->subtree_com + 3 * body, d->xpos + 3 * body);
  mju_mulMatVec3(w, d->xmat + 9 * body, v + 3);
  mju_cross(arm, w, r);
  mju_cross(out, w, arm);
}

/* What half a step adds to the velocity of every point of a lone body, shape (3,): MuJoCo's velocities lag its places by that
   much, and the frame of a body whose mass is off it is accelerated by its turning alone. 0 of others, and in RK4. */
static void lead_of(const mjModel* m, const mjData* d, int body, double* lead) {
  int root = m->body_weldid[body], dof = m->body_dofadr[root];
  mju_zero3(lead);
  if (m->opt.integrator == mjINT_RK4 || dof < 0 || !is_lone(m, dof)) return;
  centripetal(d, root, d->qvel + dof, lead);
  mju_scl3(lead, lead, -0.5 * m->opt.timestep);
}

/* The change x of a free body's six velocities while it turns freely for a step from velocities v, which were `before` until an
   impact in the middle of the step: the angular ones by Euler's equations in small Runge-Kutta steps, the linear ones so that its
   centre of mass keeps its speed from place to place. */
static void turn_freely(const mjModel* m, const mjData* d, int body, const double* before, const double* v, double* x) {
  const double *R = d->xmat + 9 * body, *I = d->crb + 10 * body;
  double world[9] = {I[0], I[3], I[4], I[3], I[1], I[5], I[4], I[5], I[2]}, J[9], inverse[9];
  double w[3] = {v[3], v[4], v[5]}, r[3], spin[3], arm[3], at[3], rate[4][3], h = m->opt.timestep;
  int steps = 1 + (int)fmin(1000, HCB_TURN * h * mju_norm3(w));
  in_body_axes(R, world, J);
  invert(J, inverse);
  for (int step = 0; step < steps; step++) {
    for (int stage = 0; stage < 4; stage++) {
      double part = (stage == 0 ? 0 : stage == 3 ? 1 : 0.5) * h / steps;
      for (int i = 0; i < 3; i++) at[i] = w[i] + (stage ? part * rate[stage - 1][i] : 0);
      mju_mulMatVec3(spin, J, at);
      mju_cross(arm, spin, at);
      mju_mulMatVec3(rate[stage], inverse, arm);
    }
    for (int i = 0; i < 3; i++) w[i] += h / steps / 6 * (rate[0][i] + 2 * rate[1][i] + 2 * rate[2][i] + rate[3][i]);
  }
  mju_sub3(x + 3, w, v + 3);
  mju_sub3(r, d->subtree_com + 3 * body, d->xpos + 3 * body);
  mju_mulMatVec3(spin, R, x + 3);
  mju_cross(x, r, spin);
  centripetal(d, body, before, at);
  mju_addToScl3(x, at, -0.5 * h);
  centripetal(d, body, v, at);
  mju_addToScl3(x, at, -0.5 * h);
}

/* Of lone bodies. One is to change by y, that of the impulse and of free turning (turn_freely). Euler integrates
   M y = h (p/h + force - f(v)), and implicit integrators (M - h D) y, where D y = f(v) + f(y) - f(v + y) as f is quadratic. */
static void shift_lone(const mjModel* m, mjData* d, const double* impulse, const double* change, double* force) {
  int nv = m->nv, rk4 = m->opt.integrator == mjINT_RK4, linear = !rk4 && is_linear(m, 1);
  double *turn = stack(d, nv), *turned = stack(d, nv), after[6], y[6], f[6];
  mju_zero(turn, nv);
  for (int j = 0; j < nv; j++) {
    int body = m->dof_bodyid[j];
    if (!is_lone(m, j) || j != m->body_dofadr[body] || mju_norm(impulse + j, 6) == 0) continue;
    mju_add(after, d->qvel + j, change + j, 6);
    if (!rk4) turn_freely(m, d, body, d->qvel + j, after, turn + j);
    mju_add(y, change + j, turn + j, 6);
    mju_addTo(after, turn + j, 6);
    lone_bias(d, body, linear ? after : d->qvel + j, f);
    mju_addTo(force + j, f, 6);
    lone_bias(d, body, linear ? y : after, f);
    if (linear || rk4) mju_subFrom(force + j, f, 6);
  }
  mj_mulM(m, d, turned, turn);
  mju_addToScl(force, turned, 1 / m->opt.timestep, nv);
}

/* What is linear both in x and y of the bias forces: bias(x + y) - bias(x) - bias(y) + bias(0), as they are quadratic. */
static void cross_bias(const mjModel* m, mjData* d, const double* x, const double* y, double* out) {
  int nv = m->nv;
  double *at = stack(d, nv), *one = stack(d, nv);
  mju_add(at, x, y, nv);
  bias_at(m, d, at, out);
  bias_at(m, d, x, one);
  mju_subFrom(out, one, nv);
  bias_at(m, d, y, one);
  mju_subFrom(out, one, nv);
  mju_zero(at, nv);
  bias_at(m, d, at, one);
  mju_addTo(out, one, nv);
}

/* How the velocities `after` an impact change in a step of the integrator implicit, (M - h D) x = h force with D of `after`:
   about, as what acts within the step is not yet known. Rounds shrink the error by the angle that bodies turn in a step. */
static void coast(const mjModel* m, mjData* d, const double* impulse, const double* after, double* x) {
  int nv = m->nv;
  double *force = stack(d, nv), *bias = stack(d, nv), *turned = stack(d, nv);
  bias_at(m, d, after, bias);
  mju_sub(force, d->qfrc_passive, bias, nv);
  mju_addToScl(force, impulse, -1 / m->opt.timestep, nv);
  mju_zero(turned, nv);
  for (int round = 0; round < HCB_TURNS; round++) {
    mju_sub(x, force, turned, nv);
    mj_solveM(m, d, x, x, 1);
    mju_scl(x, x, m->opt.timestep, nv);
    cross_bias(m, d, after, x, turned);
  }
}

/* Of bodies with joints: f(v) - f(v + dv), less what the integrator implicit adds of it, D dv. That has D of v, where a step
   from v + dv has D of v + dv: the difference times the change x in the step is added. */
static void shift_jointed(const mjModel* m, mjData* d, const double* impulse, const double* change, double* force) {
  int nv = m->nv, linear = is_linear(m, 0);
  double *velocity = stack(d, nv), *from = stack(d, nv), *after = stack(d, nv);
  mju_copy(velocity, d->qvel, nv);
  if (linear) {
    double *x = stack(d, nv), *turned = stack(d, nv);
    mju_add(after, velocity, change, nv);
    coast(m, d, impulse, after, x);
    cross_bias(m, d, change, x, turned);
    mju_zero(from, nv);
    bias_at(m, d, change, after);
    mju_addTo(after, turned, nv);
    bias_at(m, d, from, from);
    mju_copy(d->qvel, velocity, nv);
    mj_comVel(m, d);
  } else {
    double *v = stack(d, 6 * (size_t)m->nbody), *turning = stack(d, 6 * (size_t)nv); /* of the step's velocities, as comVel left them */
    mju_copy(v, d->cvel, 6 * m->nbody);
    mju_copy(turning, d->cdof_dot, 6 * nv);
    mj_rne(m, d, 0, from);
    mju_add(after, velocity, change, nv);
    bias_at(m, d, after, after);
    mju_copy(d->qvel, velocity, nv);
    mju_copy(d->cvel, v, 6 * m->nbody);
    mju_copy(d->cdof_dot, turning, 6 * nv);
  }
  for (int j = 0; j < nv; j++) force[j] += is_lone(m, j) ? 0 : from[j] - after[j];
}

/* Adds to `force` what makes the step go on from the velocities after an impulse, as an impact does; `change`: what of the
   impulse's change of velocity is not in qvel yet. A step of Euler would turn by the velocities before the impact, and
   RK4's second and third stage by those halfway: a spinning corner would part at the wrong speed. */
static void shift_bias(const mjModel* m, mjData* d, const double* impulse, const double* change, double* force) {
  int jointed = 0, lone = 0;
  for (int j = 0; j < m->nv; j++) {
    lone |= impulse[j] != 0 && is_lone(m, j);
    jointed |= impulse[j] != 0 && !is_lone(m, j);
  }
  mj_markStack(d);
  if (lone) shift_lone(m, d, impulse, change, force);
  if (jointed) shift_jointed(m, d, impulse, change, force);
  mj_freeStack(d);
}

static void gravity_on(const mjModel* m, int body, double* out) {
  int off = (m->opt.disableflags & mjDSBL_GRAVITY) || m->body_weldid[body] == 0;
  for (int i = 0; i < 3; i++) out[i] = off ? 0 : m->opt.gravity[i] * (1 - m->body_gravcomp[body]);
}

/* The rate at which a point, at r from the centre of mass of the whole tree, moves with a degree of freedom. */
static void moved_by(const mjData* d, int dof, const double* r, double v[3]) {
  const double* w = d->cdof + 6 * dof;
  v[0] = w[3] + (w[1] * r[2] - w[2] * r[1]);
  v[1] = w[4] + (w[2] * r[0] - w[0] * r[2]);
  v[2] = w[5] + (w[0] * r[1] - w[1] * r[0]);
}

/* The force of gravity alone, shape (nv,); whether there is any. A degree of freedom moves its body and all that hangs on it. */
static int gravity_force(const mjModel* m, const mjData* d, double* force) {
  double g[3], r[3], v[3];
  int any = 0;
  memset(force, 0, m->nv * sizeof(double));
  for (int j = 0; j < m->nv && !m->ngravcomp; j++) {
    int body = m->dof_bodyid[j];
    gravity_on(m, body, g);
    if (!dot(g, g) || !m->body_subtreemass[body]) continue;
    mju_sub3(r, d->subtree_com + 3 * body, d->subtree_com + 3 * m->body_rootid[body]);
    moved_by(d, j, r, v);
    force[j] = m->body_subtreemass[body] * dot(v, g);
    any = 1;
  }
  if (!m->ngravcomp) return any;
  for (int body = 1; body < m->nbody; body++) {
    int b = m->body_weldid[body];
    gravity_on(m, body, g);
    if (!dot(g, g) || !m->body_mass[body]) continue;
    mju_sub3(r, d->xipos + 3 * body, d->subtree_com + 3 * m->body_rootid[body]);
    for (int i = 0; i < 3; i++) g[i] *= m->body_mass[body];
    for (int j = m->body_dofadr[b] + m->body_dofnum[b] - 1; j >= 0; j = m->dof_parentid[j]) {
      moved_by(d, j, r, v);
      force[j] += dot(v, g);
    }
    any = 1;
  }
  return any;
}

/* Which stage of a Runge-Kutta step this is, 1 ... 4; 0 for other integrators. */
static int stage_of(const mjModel* m, const mjData* d, instance* memory) {
  double h = m->opt.timestep;
  if (m->opt.integrator != mjINT_RK4) return 0;
  int stage = memory->step == h ? memory->stage : 0;
  if (stage && stage != 3 && d->time == memory->time + 0.5 * h) {
    memory->stage = stage == 2 ? 3 : 2;
  } else if (stage == 3 && d->time == memory->time + h) {
    memory->stage = 4;
  } else {
    memory->step = h;
    memory->time = d->time;
    memory->stage = 1;
    memory->plans = 0;
  }
  return memory->stage;
}

/* Stages ask in the order in which plans were made, so that the search begins where the last one ended. */
static plan* planned(instance* memory, int instance_, int id, int order) {
  for (int i = 0; i < memory->plans; i++) {
    plan* p = memory->planned + (memory->next_plan + i) % memory->plans;
    if (p->instance != instance_ || p->id != id || p->order != order) continue;
    memory->next_plan = (int)(p - memory->planned) + 1;
    return p;
  }
  return NULL;
}

static plan* new_plan(instance* memory, int instance_, int id, int order) {
  if (memory->plans == memory->room) {
    memory->room = memory->room ? 2 * memory->room : 16;
    memory->planned = realloc(memory->planned, memory->room * sizeof(plan));
  }
  plan* made = memory->planned + memory->plans++;
  *made = (plan){.instance = instance_, .id = id, .order = order};
  return made;
}
