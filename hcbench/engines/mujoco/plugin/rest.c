/* Rest after impacts: the rows that MuJoCo made for a law's contacts, rewritten before their reference acceleration is
   worked out to e = 0 with friction, or to silence for contacts that part. */

#define HCB_REST 1e-9      /* compliance of a resting row, in units of the pair's own inverse mass, under Newton; ... */
#define HCB_REST_CG 1e-3   /* ... under CG, which does not settle stiffer rows in its iterations; ... */
#define HCB_FORCE 1e-6     /* ... where the step takes the solver's forces and a pair has one contact; ... */
#define HCB_SHARED 1e3     /* ... where several share what they bear: this times Newton's tolerance, if it is more */
#define HCB_PUSH 0.05      /* of that speed: how fast at most depth that a landing has left is pushed out, ... */
#define HCB_SLOP 1         /* ... down to so many times what that speed moves in a step: no lower, no contact is lost */
#define HCB_SILENT -1e10   /* m/s^2: a row that never pushes */

typedef struct { /* a contact of a law: rows of the solver from `row` on */
  int instance, id, order, tendon, body[2], row, rows, dim, cone, touches, rests, several; /* of the pair */
  double rate[6], friction[5], slip, parting, x, depth; /* depth: of the pair's shallowest */
  const double *point, *frame;
  hcb_contact law;
} blow;

/* Whether the step takes M^-1 J^T efc_force in place of the solver's qacc (mj_dualFinish). */
static int is_dual(const mjModel* m) { return m->opt.solver == mjSOL_PGS || m->opt.noslip_iterations > 0; }

/* PGS and noslip use J M^-1 J^T + R, worked out before the passive forces: its diagonal follows R. */
static void add_to_AR(const mjModel* m, mjData* d, int row, double change) {
  if (!is_dual(m)) return;
  if (!mj_isSparse(m)) {
    d->efc_AR[(size_t)row * d->nefc + row] += change;
    return;
  }
  for (int k = d->efc_AR_rowadr[row]; k < d->efc_AR_rowadr[row] + d->efc_AR_rownnz[row]; k++) {
    if (d->efc_AR_colind[k] == row) d->efc_AR[k] += change;
  }
}

static void set_row(const mjModel* m, mjData* d, int row, double acceleration_, double compliance) {
  double *KBIP = d->efc_KBIP + 4 * row, before = d->efc_R[row];
  d->efc_R[row] = fmax(d->efc_R[row] * KBIP[2] / (1 - KBIP[2]) * compliance, mjMINVAL);
  d->efc_D[row] = 1 / d->efc_R[row];
  add_to_AR(m, d, row, d->efc_R[row] - before);
  KBIP[0] = 1; /* mj_referenceConstraint comes next and computes -B vel - K I (pos - margin) */
  KBIP[1] = 0;
  d->efc_margin[row] = d->efc_pos[row] + acceleration_ / KBIP[2];
#ifdef HCB_ISLAND_ROWS
  if (d->nisland > 0) {
    int island_row = d->map_efc2iefc[row];
    d->iefc_R[island_row] = d->efc_R[row];
    d->iefc_D[island_row] = d->efc_D[row];
  }
#endif
}

/* Whether the step takes the forces of Newton or CG in place of their qacc. */
static int takes_forces(const mjModel* m) {
  int damped = 0;
  for (int j = 0; j < m->nv && m->opt.integrator == mjINT_EULER; j++) damped |= m->dof_damping[j] != 0;
  return m->opt.integrator == mjINT_IMPLICIT || m->opt.integrator == mjINT_IMPLICITFAST ||
         (damped && !(m->opt.disableflags & mjDSBL_EULERDAMP));
}

/* The solver's qacc is right however stiff the rows are. Where the step takes its forces instead, their error is the root
   of tolerance over compliance (a cost within tolerance), and what a resting contact sinks is compliance times weight. */
static void rest_compliance(const mjModel* m, double* one, double* several) {
  *one = *several = m->opt.solver == mjSOL_CG ? HCB_REST_CG : HCB_REST;
  if (!is_dual(m) && !takes_forces(m)) return;
  *one = *several = HCB_FORCE;
  if (!is_dual(m)) *several = fmin(fmax(HCB_SHARED * m->opt.tolerance, HCB_FORCE), HCB_REST_CG);
}

static void set_rows(const mjModel* m, mjData* d, instance* memory, const blow* b, int stage, double compliance) {
  plan now = {.rows = b->rows}, *made = stage > 1 ? planned(memory, b->instance, b->id, b->order) : NULL;
  double h = m->opt.timestep, mu = b->friction[0];
  double push = fmin(HCB_PUSH * b->law.still, fmax(0, b->depth - HCB_SLOP * h * b->law.still) / h);
  if (compliance > HCB_REST) push = 0; /* forces that are not exact would turn what they lift */
  double closing = (stage ? fmax(0, b->parting) : 0) - push; /* RK4 moves on the way: back to where it was, for no work */
  for (int i = 0; i < b->rows; i++) {
    int k = b->cone ? 1 + i / 2 : i;
    double tangential = b->cone ? (i % 2 ? -1 : 1) * b->friction[k - 1] * b->rate[k] : 0;
    now.value[i] = i && !b->cone ? -b->rate[k] / h : (-b->rate[0] - tangential - mu * b->slip - closing) / h;
    if (!b->rests || stage > 1) now.value[i] = i && !b->cone ? 0 : HCB_SILENT; /* new ones wait for the next step */
  }
  if (stage == 1) {
    made = new_plan(memory, b->instance, b->id, b->order);
    made->rows = now.rows;
    memcpy(made->value, now.value, sizeof(now.value));
  }
  if (made && made->rows == now.rows) now = *made;
  if (b->cone) compliance /= fmax(2 * mu * mu, 1e-12); /* a pyramid's rows have 2 mu^2 in theirs */
  for (int i = 0; i < now.rows; i++) set_row(m, d, b->row + i, now.value[i], compliance);
}
