/* Under RK4 a step with impacts is made again, from the velocities after them: an impulse that acts as a force in four
   stages would meet bodies that have turned and joints that have moved meanwhile. The velocities cannot be changed before
   the stages, as mj_forward alone leaves the state as it is; so the step is gone back on once it has ended. */

/* Keeps where the step starts, with the velocities after the impulse, which changes them so. */
static void start_again(const mjModel* m, const mjData* d, instance* memory, const double* change) {
  if (memory->is_again || mju_norm(change, m->nv) == 0) return;
  memory->start = realloc(memory->start, (m->nq + m->nv + m->na) * sizeof(double));
  memory->starts = 1;
  double *velocity = memory->start + m->nq, *act = velocity + m->nv;
  mju_copy(memory->start, d->qpos, m->nq);
  mju_add(velocity, d->qvel, change, m->nv);
  mju_copy(act, d->act, m->na);
}

/* Makes the step again where it had impacts. */
static void take_again(const mjModel* m, mjData* d, int first) {
  instance* memory = instance_of(d, first);
  if (!memory->starts || memory->stage != 4) return;
  const double *velocity = memory->start + m->nq, *act = velocity + m->nv;
  d->time = memory->time;
  mju_copy(d->qpos, memory->start, m->nq);
  mju_copy(d->qvel, velocity, m->nv);
  mju_copy(d->act, act, m->na);
  memory->starts = 0;
  memory->is_again = 1;
  mj_forwardSkip(m, d, mjSTAGE_NONE, 1);
  mj_RungeKutta(m, d, 4);
  memory->is_again = 0;
}
