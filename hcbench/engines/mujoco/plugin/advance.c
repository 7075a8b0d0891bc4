/* After a step of hcbench.restitution: implicit integrators, and Euler with joint damping, move by the solver's forces.
   Rows that are stiff enough to rest make those wrong by the root of tolerance times stiffness, though the solver's
   accelerations are right: a row that opens or closes in its last iteration is enough. So what rests would vibrate. */

#ifndef HCB_D_ROWS /* diagonal, addresses and columns of the rows of qLU, and their number of entries */
#define HCB_D_ROWS m->D_diag, m->D_rowadr, m->D_colind, m->D_rownnz
#endif

/* Whether the step takes M^-1 J^T efc_force in place of the solver's qacc (mj_dualFinish). */
static int is_dual(const mjModel* m) { return m->opt.solver == mjSOL_PGS || m->opt.noslip_iterations > 0; }

/* Whether Newton stops before its end as a rule. */
static int stops_early(const mjModel* m) { return m->opt.solver == mjSOL_NEWTON && m->opt.iterations < HCB_ITERATIONS; }

/* The linear damping of a degree of freedom by its joint, and by an actuator that has some for it. */
static double joint_damping(const mjModel* m, int dof) {
#ifdef HCB_ACTUATOR_DAMPING
  int actuator = m->jnt_actuatorid[m->dof_jntid[dof]];
  return m->dof_damping[dof] + (actuator < 0 ? 0 : m->actuator_damping[actuator]);
#else
  return m->dof_damping[dof];
#endif
}

/* Whether the integrator takes the solver's forces in place of qacc. */
static int takes_forces(const mjModel* m) {
  int damped = 0, off = m->opt.disableflags & mjDSBL_EULERDAMP;
  if (m->opt.integrator != mjINT_EULER) return m->opt.integrator != mjINT_RK4;
#ifdef HCB_DAMPER
  off |= m->opt.disableflags & mjDSBL_DAMPER;
#endif
  for (int j = 0; j < m->nv && !off; j++) {
    damped |= m->dof_damping[j] > 0;
#ifdef HCB_ACTUATOR_DAMPING
    damped |= m->jnt_actuatorid[m->dof_jntid[j]] != -1;
    for (int k = 0; k < mjNPOLY; k++) damped |= m->dof_dampingpoly[mjNPOLY * j + k] != 0;
#endif
  }
  return damped;
}

/* x = (M - h D)^-1 x, from the sparse LU factors that the integrator implicit has left: unit upper, then lower rows. */
static void solve_unsymmetric(const mjModel* m, const mjData* d, const tree_parts* t, int part, double* x) {
  const int* const rows[] = {HCB_D_ROWS};
  const int *diag = rows[0], *adr = rows[1], *colind = rows[2], *nnz = rows[3], *dof = t->dof + t->at[part];
  int n = part_size(t, part);
  for (int i = n - 1; i >= 0; i--) {
    for (int k = diag[dof[i]] + 1; k < nnz[dof[i]]; k++) {
      x[i] -= d->qLU[adr[dof[i]] + k] * x[t->place[colind[adr[dof[i]] + k]]];
    }
  }
  for (int i = 0; i < n; i++) {
    int a = adr[dof[i]], k;
    for (k = 0; k < diag[dof[i]]; k++) x[i] -= d->qLU[a + k] * x[t->place[colind[a + k]]];
    x[i] /= d->qLU[a + k];
  }
}

/* x = (M - h D)^-1 x of a lone body under implicitfast, which adds its gyroscopic derivative D to what qH has of it. Rounds
   shrink the error by the angle that the body turns in a step. */
static void solve_lone(const mjModel* m, const mjData* d, const tree_parts* t, int part, double* x) {
  int body = m->dof_bodyid[t->dof[t->at[part]]];
  double v[6] = {0}, after[6], force[6], f[3][6], share = is_linear(m, 1) ? m->opt.timestep : 0;
  memcpy(force, x, sizeof(force));
  mju_mulMatTVec3(v + 3, d->xmat + 9 * body, d->cvel + 6 * body);
  lone_bias(d, body, v, f[0]);
  for (int round = 0; round < HCB_TURNS; round++) {
    solve_factored(m, d, t, part, d->qH, d->qHDiagInv, x);
    if (share == 0 || round == HCB_TURNS - 1) return;
    mju_add(after, v, x, 6);
    lone_bias(d, body, after, f[1]);
    lone_bias(d, body, x, f[2]);
    for (int k = 0; k < 6; k++) x[k] = force[k] - share * (f[1][k] - f[0][k] - f[2][k]);
  }
}

/* x = M^-1 x over a part's dofs, or (M - h D)^-1 x where the step moves bodies by that. */
static void solve_step(const mjModel* m, const mjData* d, const tree_parts* t, int part, int damped, double* x) {
  int lone = part_size(t, part) == 6 && is_lone(m, t->dof[t->at[part]]);
  if (!damped) {
    solve_part(m, d, t, part, x);
  } else if (m->opt.integrator == mjINT_IMPLICIT) {
    solve_unsymmetric(m, d, t, part, x);
  } else if (m->opt.integrator == mjINT_IMPLICITFAST && lone) {
    solve_lone(m, d, t, part, x);
  } else {
    solve_factored(m, d, t, part, d->qH, d->qHDiagInv, x);
  }
}

static int has_contact(const mjModel* m, const mjData* d, int first) {
  const instance* memory = instance_of(d, first);
  for (int k = 0; k < d->ncon; k++) {
    const mjContact* c = d->contact + k;
    if (c->efc_address >= 0 && c->geom[0] >= 0 && c->geom[1] >= 0 && entry_of(memory, c->geom[0], c->geom[1])) return 1;
  }
  for (int i = first; i < m->nplugin; i++) {
    if (m->plugin[i] == m->plugin[first] && instance_of(d, i)->tendon >= 0) return d->nefc > 0;
  }
  return 0;
}

/* Whether the solver stops early, and no contact, limit or equality pushes but contacts of a law: those can be solved without
   the solver (strays.c). The forces of others are then stiff springs' at accelerations that are wrong: they are of no use. */
static int is_unsolved(const mjModel* m, const mjData* d, int first) {
  int others = !stops_early(m) || is_dual(m);
  for (int k = 0; k < d->nefc && !others; k++) {
    int type = d->efc_type[k], is_friction = type == mjCNSTR_FRICTION_DOF || type == mjCNSTR_FRICTION_TENDON;
    if (is_friction || d->efc_force[k] == 0) continue;
    const mjContact* c = type >= mjCNSTR_CONTACT_FRICTIONLESS ? d->contact + d->efc_id[k] : NULL;
    others = !c || c->geom[0] < 0 || c->geom[1] < 0 || !entry_of(instance_of(d, first), c->geom[0], c->geom[1]);
  }
  return !others;
}

/* Whether constraints push at all: where contacts part in an impact none does. */
static int any_pushed(const mjModel* m, const mjData* d) {
  for (int j = 0; j < m->nv; j++) {
    if (d->qfrc_constraint[j] != 0) return 1;
  }
  return 0;
}

/* What the accelerations give beyond the forces, m/s^2: (M - h D)^-1 of M qacc - qfrc_smooth - qfrc_constraint. */
static void beyond_forces(const mjModel* m, mjData* d, const tree_parts* t, double* out) {
  mj_markStack(d);
  double* x = stack(d, m->nv);
  mj_mulM(m, d, out, d->qacc);
  for (int q = 0; q < t->parts; q++) {
    const int* dof = t->dof + t->at[q];
    int n = part_size(t, q), pushed = 0;
    for (int i = 0; i < n; i++) {
      pushed |= d->qfrc_constraint[dof[i]] != 0;
      x[i] = out[dof[i]] - d->qfrc_smooth[dof[i]] - d->qfrc_constraint[dof[i]];
    }
#ifdef HCB_SLEEP
    for (int i = 0; i < n; i++) pushed &= d->tree_awake[m->dof_treeid[dof[i]]];
#endif
    for (int i = 0; i < n && !pushed; i++) x[i] = 0;
    if (pushed) solve_step(m, d, t, q, takes_forces(m), x);
    for (int i = 0; i < n; i++) out[dof[i]] = x[i];
  }
  mj_freeStack(d);
}

/* Whether bodies have moved by the accelerations once take_accelerations has been. */
static int moves_by_accelerations(const mjModel* m, const mjData* d, int first) {
  return !is_dual(m) && m->opt.integrator != mjINT_RK4 && !m->nflex && !is_unsolved(m, d, first);
}

/* Adds to the new velocities and positions what the accelerations give beyond the forces. Of a solver that stops before its end the
   forces are the better: accelerations that no force gives would gain energy, and strays.c puts other forces of contacts in their
   place. There it takes that away. */
static void take_accelerations(const mjModel* m, mjData* d, int first) {
  double h = m->opt.timestep;
  int early = is_unsolved(m, d, first), forces = takes_forces(m);
  if (is_dual(m) || forces == early || m->opt.integrator == mjINT_RK4 || m->nflex || !any_pushed(m, d) || !has_contact(m, d, first)) return;
  mj_markStack(d);
  tree_parts t = make_parts(m, d, first, 0);
  double* missing = stack(d, m->nv);
  beyond_forces(m, d, &t, missing);
  mju_scl(missing, missing, early ? -h : h, m->nv);
  mju_addTo(d->qvel, missing, m->nv);
  mj_integratePos(m, d->qpos, missing, h);
  mj_freeStack(d);
}
