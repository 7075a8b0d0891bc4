/* Forces of dampers, fluids and servos, of the velocities after an impact. A step without impacts is v+ = v + A^-1 h f(v), where A
   is M, or M - h D with what the integrator takes implicitly, D of df/dv. An impact p comes first: v' = v + M^-1 p, and the step
   then is v+ = v' + A^-1 h f(v'). MuJoCo works f out of v, after the plug-in, and takes p as a force p/h. What is missing is

     A (v' - v)/h + f(v') - p/h - f(v) = f(v') - f(v) - D (v' - v).

   Of a damper that is not implicit, D = 0: it would go on as before the impact, and leave -e v - (h d/m) v of v, which is faster
   than v where e + h d/m > 1. A servo at the end of its forcerange has D = 0 too, and would push on as it pushed before. */

#define HCB_NEAR 1e-6 /* share of a change of velocity from which D of the integrator is read */

static _Thread_local int evaluating; /* forces at other velocities are worked out: MuJoCo calls this plug-in for them, too */

/* Forces that change with velocities, at these; all of the data that depends on velocities is of them from then on. */
static void forces_at(const mjModel* m, mjData* d, const double* velocity, double* force) {
  mju_copy(d->qvel, velocity, m->nv);
  evaluating = 1;
  mj_fwdVelocity(m, d);
  mj_fwdActuation(m, d);
  evaluating = 0;
  mju_add(force, d->qfrc_damper, d->qfrc_fluid, m->nv);
  mju_addTo(force, d->qfrc_actuator, m->nv);
}

/* Whether an actuator's force is not linear in its velocity, or, where nothing of it is implicit, changes with it at all. */
static int is_shifted(const mjModel* m, int actuator, int implicit) {
  int gain = m->actuator_gaintype[actuator], bias = m->actuator_biastype[actuator];
  if (gain != mjGAIN_FIXED || (bias != mjBIAS_NONE && bias != mjBIAS_AFFINE)) return 1;
  int damped = bias == mjBIAS_AFFINE && m->actuator_biasprm[mjNBIAS * actuator + 2] != 0;
  return damped && (!implicit || m->actuator_forcelimited[actuator]);
}

/* Whether forces of the model change with velocities by what the integrator does not take. */
static int has_velocity_forces(const mjModel* m) {
  int implicit = m->opt.integrator != mjINT_EULER, any = m->nflex > 0 || m->opt.density > 0 || m->opt.viscosity > 0;
  for (int i = 0; i < HCB_ACTUATORS && !any; i++) any = is_shifted(m, i, implicit);
  for (int j = 0; j < m->njnt && !any; j++) any = implicit && m->nu > 0 && m->jnt_actfrclimited[j];
  for (int j = 0; j < m->nv && !any; j++) any = !implicit && m->dof_damping[j] != 0 && !takes_forces(m);
  for (int k = 0; k < m->ntendon && !any; k++) any = !implicit && m->tendon_damping[k] != 0;
#ifdef HCB_ACTUATOR_DAMPING
  for (int j = 0; j < m->njnt && !any; j++) any = !implicit && m->jnt_actuatorid[j] >= 0 && !takes_forces(m);
  for (int j = 0; j < mjNPOLY * m->nv && !any; j++) any = m->dof_dampingpoly[j] != 0;
#endif
  return any;
}

/* Whether the damping of joints is not linear, and can be told from that of tendons and flexes, which Euler does not take. */
static int has_curved_damping(const mjModel* m) {
  int curved = 0;
#ifdef HCB_ACTUATOR_DAMPING
  for (int j = 0; j < m->njnt && !curved; j++) curved = m->jnt_actuatorid[j] >= 0; /* may be so, too */
  for (int j = 0; j < mjNPOLY * m->nv && !curved; j++) curved = m->dof_dampingpoly[j] != 0;
#endif
  for (int k = 0; k < m->ntendon && curved; k++) curved = m->tendon_damping[k] == 0;
  return curved && m->nflex == 0;
}

/* D times a change of the velocities, of the integrator: of Euler the damping of joints, or nothing. */
static void implicit_forces(const mjModel* m, mjData* d, const double* velocity, const double* change, double* out) {
  int nv = m->nv, euler = m->opt.integrator == mjINT_EULER;
  mju_zero(out, nv);
  if (euler && !takes_forces(m)) return;
  if (euler && !has_curved_damping(m)) {
    for (int j = 0; j < nv; j++) out[j] = -joint_damping(m, j) * change[j];
    return;
  }
  double *near = stack(d, nv), *damper = stack(d, nv), *before = stack(d, nv);
  forces_at(m, d, velocity, before);
  mju_copy(damper, d->qfrc_damper, nv);
  mju_addScl(near, velocity, change, HCB_NEAR, nv);
  forces_at(m, d, near, out);
  if (euler) {
    mju_sub(out, d->qfrc_damper, damper, nv);
  } else {
    mju_subFrom(out, before, nv);
  }
  mju_scl(out, out, 1 / HCB_NEAR, nv);
}

/* Whether all that changes with velocities, and that Euler takes at the step's start, is linear in them: joints, tendons and servos
   without limits of force. */
static int is_linear_under_euler(const mjModel* m) {
  int off = m->opt.disableflags & (mjDSBL_ACTUATION | mjDSBL_EULERDAMP), bent = m->nflex > 0 || m->opt.density > 0 || m->opt.viscosity > 0;
#ifdef HCB_DAMPER
  off |= m->opt.disableflags & mjDSBL_DAMPER;
#else
  off |= m->opt.disableflags & mjDSBL_PASSIVE;
#endif
  if (m->opt.integrator != mjINT_EULER || off || m->opt.disableactuator) return 0;
  for (int i = 0; i < HCB_ACTUATORS && !bent; i++) {
    int bias = m->actuator_biastype[i];
    bent = m->actuator_gaintype[i] != mjGAIN_FIXED || (bias != mjBIAS_NONE && bias != mjBIAS_AFFINE) || m->actuator_forcelimited[i];
  }
  for (int j = 0; j < m->njnt && !bent; j++) bent = m->nu > 0 && m->jnt_actfrclimited[j];
  for (int k = 0; k < m->ntendon && !bent; k++) bent = m->nu > 0 && m->tendon_actfrclimited[k];
#ifdef HCB_ACTUATOR_DAMPING
  for (int j = 0; j < m->njnt && !bent; j++) bent = m->jnt_actuatorid[j] >= 0;
  for (int j = 0; j < mjNPOLY * m->nv && !bent; j++) bent = m->dof_dampingpoly[j] != 0;
  for (int k = 0; k < mjNPOLY * m->ntendon && !bent; k++) bent = m->tendon_dampingpoly[k] != 0;
#endif
  return !bent;
}

/* Adds -c J^T J x for a sparse row J. */
static void damp_along(int count, const int* column, const double* row, double c, const double* x, double* force) {
  double rate = 0;
  for (int k = 0; k < count; k++) rate += row[k] * x[column[k]];
  for (int k = 0; k < count; k++) force[column[k]] -= c * rate * row[k];
}

/* Adds to `force` what a change of the velocities changes of linear forces that Euler takes at the step's start: those of tendons
   and servos, as joints are damped at its end. */
static void shift_linear(const mjModel* m, mjData* d, const double* change, double* force) {
  mj_markStack(d);
  int* column = ints(d, m->nv);
  double* value = stack(d, m->nv);
  for (int i = 0; i < HCB_ACTUATORS; i++) {
    const double* bias = m->actuator_biasprm + mjNBIAS * i;
    int row = HCB_ACTUATOR_ROW(i), adr = d->moment_rowadr[row];
    if (m->actuator_biastype[i] != mjBIAS_AFFINE) continue;
    damp_along(d->moment_rownnz[row], d->moment_colind + adr, d->actuator_moment + adr, -bias[2], change, force);
  }
  for (int k = 0; k < m->ntendon; k++) {
    if (m->tendon_damping[k] == 0) continue;
    int count = tendon_columns(m, d, k, column, value);
    damp_along(count, column, value, m->tendon_damping[k], change, force);
  }
  mj_freeStack(d);
}

/* Adds to `force` what makes the step's dampers, fluids and servos those of the velocities after an impulse, which changes them so. */
static void shift_velocity_forces(const mjModel* m, mjData* d, const double* change, double* force) {
  int nv = m->nv;
  if (!has_velocity_forces(m) || m->opt.integrator == mjINT_RK4) return; /* RK4: again.c */
  if (is_linear_under_euler(m)) {
    shift_linear(m, d, change, force);
    return;
  }
  mj_markStack(d);
  double *velocity = stack(d, nv), *moved = stack(d, nv), *before = stack(d, nv), *after = stack(d, nv);
  double *taken = stack(d, nv), *passive = stack(d, nv);
  mju_copy(velocity, d->qvel, nv);
  mju_copy(passive, d->qfrc_passive, nv);
  mju_add(moved, velocity, change, nv);
  implicit_forces(m, d, velocity, change, taken);
  forces_at(m, d, moved, after);
  forces_at(m, d, velocity, before); /* the last: all is of the velocities of the step again */
  mju_copy(d->qfrc_passive, passive, nv);
  for (int j = 0; j < nv; j++) force[j] += after[j] - before[j] - taken[j];
  mj_freeStack(d);
}
