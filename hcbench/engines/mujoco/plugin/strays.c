/* After a step: contacts that were to stand, or not to close again, and do not, are solved again, as impacts of e = 0 with
   friction in place of the solver's forces. These are wrong where
     - bodies slide or turn against friction: MuJoCo's cones part a contact by its friction times its slip, which rest.c takes back
       for a slip that it works out before the solver, without servos and limits, and as if equalities were kept, which the solver
       takes their time constant to correct. Feet would sink as long as they slide;
     - PGS lets a contact with an elliptic cone go: its normal row, which it solves first and alone, needs no force as long as
       less approach is left than rest.c has taken back, and without that there is no friction;
     - joints are damped much: the solver's forces are for M, and the step then moves bodies by (M - h D)^-1 of them;
     - bodies are wedged between surfaces that rub: forces that undo each other bear any load, so that Newton stops where it is;
     - the solver stops early.
   These impacts are between bodies as they are, without equalities: one that is broken pulls a body down faster than what all
   of it would do together. */

/* The rate of a contact along one of its axes at the velocities of the data. */
static double rate_along(const mjModel* m, const mjData* d, const instance* memory, const mjContact* c, int axis) {
  double sum = 0, moved[3], turned[3];
  const double* n = c->frame + 3 * axis;
  for (int side = 0; side < 2; side++) {
    int b = m->body_weldid[m->geom_bodyid[c->geom[side]]];
    double r[3], arm[3], rate = 0;
    mju_sub3(r, c->pos, d->subtree_com + 3 * m->body_rootid[b]);
    mju_cross(arm, r, n);
    for (int j = m->body_dofadr[b] + m->body_dofnum[b] - 1; j >= 0; j = m->dof_parentid[j]) {
      rate += d->qvel[j] * (dot(d->cdof + 6 * j, arm) + dot(d->cdof + 6 * j + 3, n));
    }
    mocap_velocity(m, memory, m->geom_bodyid[c->geom[side]], c->pos, moved, turned);
    rate += dot(moved, n);
    sum += side ? rate : -rate;
  }
#ifdef HCB_SURFACE_VELOCITY
  sum += axis ? c->surfacevel[axis - 1] : 0;
#endif
  return sum;
}

static double strays_from(const mjModel* m, const mjContact* c) {
  int body[2] = {m->geom_bodyid[c->geom[0]], m->geom_bodyid[c->geom[1]]};
  double least = HCB_STEEP * mju_norm3(m->opt.gravity) * m->opt.timestep;
  return HCB_STRAYS * HCB_STILL * fmax(fall(m, body, c->frame), least) + 1e-9;
}

/* The solver's forces of a contact over the step, N; none of RK4, which has four. */
static void solver_force(const mjModel* m, const mjData* d, int contact, double force[6]) {
  mju_zero(force, 6);
  if (m->opt.integrator != mjINT_RK4) mj_contactForce(m, d, contact, force);
}

/* Whether a contact that is to stand approaches (1), or parts by the solver's force (2), or both (3). */
static int strays(const mjModel* m, const mjData* d, int first) {
  const instance* memory = instance_of(d, first);
  int found = memory->stand && is_unsolved(m, d, first) ? 3 : 0;
  for (int i = 0; i < memory->stand && found < 3; i++) {
    int k = memory->stands[i].contact;
    double rate = rate_along(m, d, memory, d->contact + k, 0), closing = memory->stands[i].closing, force[6];
    double slow = strays_from(m, d->contact + k);
    int approaches = -rate - fmax(0, closing) > slow, parts = rate + closing > slow;
    if (parts) solver_force(m, d, k, force);
    found |= (approaches ? 1 : 0) | (parts && force[0] > 0 ? 2 : 0);
  }
  return found;
}

/* Rows of a contact, and of them what the step makes of a force, in place of M^-1 alone. */
static hcb_rows rows_in_step(const mjModel* m, mjData* d, const instance* memory, const tree_parts* t, const mjContact* c,
                             int damped, double* u) {
  blow b = {.tendon = -1, .dim = c->dim, .point = c->pos, .frame = c->frame};
  for (int side = 0; side < 2; side++) b.body[side] = m->geom_bodyid[c->geom[side]];
  for (int k = 0; k < 3; k++) b.rate[k] = rate_along(m, d, memory, c, k);
  hcb_rows r = rows_of(m, d, t, &b, u);
  for (int side = 0; side < 2 && r.part[side] >= 0 && damped; side++) {
    int size = part_size(t, r.part[side]);
    double* B = stack(d, 3 * (size_t)size);
    memcpy(B, r.J[side], 3 * (size_t)size * sizeof(double));
    for (int k = 0; k < 3; k++) solve_step(m, d, t, r.part[side], damped, B + (size_t)k * size);
    r.B[side] = B;
  }
  return r;
}

/* Adds to a change of the velocities what impulses along a contact's rows make of them. */
static void push_change(const tree_parts* t, const hcb_rows* r, const double* p, double scale, double* change) {
  for (int side = 0; side < 2 && r->part[side] >= 0; side++) {
    int size = part_size(t, r->part[side]);
    for (int k = 0; k < 3; k++) part_add(t, r->part[side], r->B[side] + (size_t)k * size, scale * p[k], change);
  }
}

/* The share of 0 ... 1 of a change of the velocities up to which it does not add kinetic energy. */
static double share_that_takes(const mjModel* m, mjData* d, const double* change) {
  mj_markStack(d);
  double* momentum = stack(d, m->nv);
  mj_mulM(m, d, momentum, change);
  double share = share_within(0, mju_dot(momentum, d->qvel, m->nv), 0.5 * mju_dot(momentum, change, m->nv));
  mj_freeStack(d);
  return share;
}

/* What lets contacts that are to stand do so, into `change` of the velocities, and the share of it that adds no kinetic energy:
   impacts of e = 0 from the rates u, shape (n, 3); `anew`: from those without what the solver made of these contacts, its forces and
   what its accelerations give beyond them, as Newton's are of rows as stiff as these. */
static double change_to_stand(const mjModel* m, mjData* d, int first, const tree_parts* t, const hcb_system* s, const double* u,
                              int anew, double* change) {
  const instance* memory = instance_of(d, first);
  int n = s->n;
  mj_markStack(d);
  double *rates = stack(d, 3 * n), *p = stack(d, 3 * n), *work = stack(d, hcb_impacts_work(n, t->parts, m->nv));
  mju_zero(change, m->nv);
  if (anew && moves_by_accelerations(m, d, first)) beyond_forces(m, d, t, change);
  mju_scl(change, change, -m->opt.timestep, m->nv);
  for (int i = 0; i < n && anew; i++) {
    double force[6];
    solver_force(m, d, memory->stands[i].contact, force);
    push_change(t, s->rows + i, force, -m->opt.timestep, change);
  }
  for (int i = 0; i < n; i++) {
    along_rows(t, s->rows[i].part, s->rows[i].J, change, rates + 3 * i);
    mju_addTo3(rates + 3 * i, u + 3 * i);
    rates[3 * i] += anew ? memory->stands[i].closing : fmax(0, memory->stands[i].closing);
  }
  hcb_impacts(s, rates, p, work);
  for (int i = 0; i < n; i++) push_change(t, s->rows + i, p + 3 * i, 1, change);
  double share = is_sound(change, m->nv) ? share_that_takes(m, d, change) : 0;
  mj_freeStack(d);
  return share;
}

static void hold_still(const mjModel* m, mjData* d, int first, int anew) {
  instance* memory = instance_of(d, first);
  int n = memory->stand, nv = m->nv, damped = takes_forces(m);
  double h = m->opt.timestep;
  memory->stand = 0;
  mj_markStack(d);
  tree_parts t = make_parts(m, d, first, 0);
  hcb_rows* rows = mj_stackAllocByte(d, (n + 1) * sizeof(hcb_rows), sizeof(double));
  hcb_contact* laws = mj_stackAllocByte(d, (n + 1) * sizeof(hcb_contact), sizeof(double));
  double *u = stack(d, 3 * n), *change = stack(d, nv);
  for (int i = 0; i < n; i++) {
    const mjContact* c = d->contact + memory->stands[i].contact;
    rows[i] = rows_in_step(m, d, memory, &t, c, damped, u + 3 * i);
    laws[i] = (hcb_contact){HCB_CONSTANT, 0, c->dim > 1 ? c->friction[0] : 0, strays_from(m, c), 0, 0};
  }
  hcb_system s = {n, t.parts, t.at, rows, laws};
  double share = change_to_stand(m, d, first, &t, &s, u, anew, change);
  if (anew && share < 1) share = change_to_stand(m, d, first, &t, &s, u, 0, change); /* the solver's forces drive others, too */
  if (share > 0) {
    mju_scl(change, change, share, nv);
    mju_addTo(d->qvel, change, nv);
    mj_integratePos(m, d->qpos, change, m->opt.integrator == mjINT_RK4 ? h / 2 : h);
  }
  mj_freeStack(d);
}

static void stop_strays(const mjModel* m, mjData* d, int first) {
  int found = strays(m, d, first);
  if (found) hold_still(m, d, first, found > 1);
}
