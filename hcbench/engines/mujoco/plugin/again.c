/* Under RK4 a step with impacts is made again, from the velocities after them: an impulse that acts as a force in four
   stages would meet bodies that have turned and joints that have moved meanwhile. The plug-in cannot change the velocities
   before the stages, for mj_forward is to leave the state as it is; so a second mjData makes the step, and its end is taken
   once the first one has ended. */

/* Keeps where the step starts, with the velocities after the impulse. */
static void start_again(const mjModel* m, mjData* d, instance* memory, const double* impulse) {
  if (memory->is_again || mju_norm(impulse, m->nv) == 0) return;
  memory->start = realloc(memory->start, (m->nq + m->nv + m->na) * sizeof(double));
  memory->starts = 1;
  double *velocity = memory->start + m->nq, *act = velocity + m->nv;
  mju_copy(memory->start, d->qpos, m->nq);
  mj_solveM(m, d, velocity, impulse, 1);
  mju_addTo(velocity, d->qvel, m->nv);
  mju_copy(act, d->act, m->na);
}

/* The second mjData, with all inputs of the first one and the state where its step starts. */
static mjData* started_again(const mjModel* m, mjData* d, int first) {
  instance* memory = instance_of(d, first);
  if (!memory->again) {
    memory->again = mj_makeData(m);
    instance_of(memory->again, first)->is_again = 1;
  }
  mjData* again = memory->again;
  mj_markStack(d);
  double *state = stack(d, mj_stateSize(m, mjSTATE_INTEGRATION)), *velocity = memory->start + m->nq;
  mj_getState(m, d, state, mjSTATE_INTEGRATION);
  mj_setState(m, again, state, mjSTATE_INTEGRATION);
  mj_freeStack(d);
  again->time = memory->time;
  mju_copy(again->qpos, memory->start, m->nq);
  mju_copy(again->qvel, velocity, m->nv);
  mju_copy(again->act, velocity + m->nv, m->na);
  return again;
}

static void take_again(const mjModel* m, mjData* d, int first) {
  instance* memory = instance_of(d, first);
  if (!memory->starts || memory->stage != 4) return;
  memory->starts = 0;
  mjData* again = started_again(m, d, first);
  memset(again->warning, 0, sizeof(again->warning));
  mj_step(m, again);
  if (again->warning[mjWARN_BADQPOS].number || again->warning[mjWARN_BADQVEL].number) return;
  if (again->warning[mjWARN_BADQACC].number) return;
  mju_copy(d->qpos, again->qpos, m->nq);
  mju_copy(d->qvel, again->qvel, m->nv);
  for (int i = 0; i < m->nu; i++) { /* other plug-ins' own advance theirs */
    if (m->actuator_plugin[i] < 0 && m->actuator_actnum[i] > 0) {
      mju_copy(d->act + m->actuator_actadr[i], again->act + m->actuator_actadr[i], m->actuator_actnum[i]);
    }
  }
}
