/* hcbench.restitution: impacts are worked out from the velocities at the start of the step, all at once (impacts.c),
   and enter as a force over this step. The rows that MuJoCo made for these contacts then only let rest: they are
   rewritten, before their reference acceleration is worked out, to e = 0 with friction, or to silence for contacts
   that part. So resting loads, stacks and friction at rest are the solver's. */

#define HCB_STILL 1.1      /* steps of falling whose speed counts as rest */
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

/* Speed that gravity gives in a step to one of the bodies alone, which the other may bear. */
static double fall(const mjModel* m, const int body[2], const double* normal) {
  double g[3], most = 0;
  for (int side = 0; side < 2; side++) {
    gravity_on(m, body[side], g);
    most = fmax(most, (side ? -1 : 1) * dot(g, normal));
  }
  return m->opt.timestep * most;
}

static hcb_contact law_of_contact(const mjModel* m, const instance* own, double friction, double fall_) {
  int kind = own->asked_for_e ? HCB_CONSTANT : own->linear ? HCB_LINEAR : HCB_LAW;
  return (hcb_contact){kind, value_of(m, own->asked_for_e ? &own->e : &own->alpha), friction, HCB_STILL * fall_ + 1e-9, 0};
}

static void read_contact(const mjModel* m, const mjData* d, const mjContact* c, blow* b) {
  double v1[3], v2[3], turn[3];
  b->body[0] = m->geom_bodyid[c->geom[0]];
  b->body[1] = m->geom_bodyid[c->geom[1]];
  b->tendon = -1;
  b->point = c->pos;
  b->frame = c->frame;
  b->dim = c->dim;
  b->cone = c->dim > 1 && m->opt.cone == mjCONE_PYRAMIDAL;
  b->row = c->efc_address;
  b->rows = b->cone ? 2 * (c->dim - 1) : c->dim;
  b->x = b->depth = -c->dist;
  b->touches = c->dist <= 0;
  for (int i = 0; i < 5; i++) b->friction[i] = c->dim > 1 ? c->friction[i] : 0;
  velocity_at(m, d, b->body[0], c->pos, v1);
  velocity_at(m, d, b->body[1], c->pos, v2);
  for (int i = 0; i < 3; i++) {
    v2[i] -= v1[i];
    turn[i] = d->cvel[6 * b->body[1] + i] - d->cvel[6 * b->body[0] + i];
  }
  for (int i = 0; i < 3; i++) {
    b->rate[i] = dot(v2, c->frame + 3 * i);
    b->rate[3 + i] = dot(turn, c->frame + 3 * i);
#ifdef HCB_SURFACE_VELOCITY
    b->rate[i] += i ? c->surfacevel[i - 1] : 0;
#endif
  }
}

static int pair_of(const instance* own, int g1, int g2) {
  for (int k = 0; k < own->pairs; k++) {
    int a = own->pair[2 * k], b = own->pair[2 * k + 1];
    if ((a == g1 && b == g2) || (a == g2 && b == g1)) return k;
  }
  return -1;
}

static int gather(const mjModel* m, mjData* d, int first, blow* all) {
  int count = 0;
  for (int i = first; i < m->nplugin; i++) {
    const instance* own = instance_of(d, i);
    int order = 0;
    if (m->plugin[i] != m->plugin[first]) continue;
    for (int k = 0; k < d->ncon && own->tendon < 0; k++) {
      const mjContact* c = d->contact + k;
      int id = c->efc_address >= 0 && c->geom[0] >= 0 && c->geom[1] >= 0 ? pair_of(own, c->geom[0], c->geom[1]) : -1;
      if (id < 0) continue;
      blow* b = all + count;
      order = count && all[count - 1].instance == i && all[count - 1].id == id ? order + 1 : 0;
      *b = (blow){.instance = i, .id = id, .order = order};
      read_contact(m, d, c, b);
      b->law = law_of_contact(m, own, b->friction[0], fall(m, b->body, c->frame));
      count++;
      for (int j = order; j > 0; j--) { /* pushed evenly: no tilt */
        b[-j].depth = b->depth = fmin(b->depth, b[-j].depth);
        b[-j].several = b->several = 1;
      }
    }
    for (int k = 0; k < d->nefc && own->tendon >= 0; k++) {
      if (d->efc_type[k] != mjCNSTR_LIMIT_TENDON || d->efc_id[k] != own->tendon) continue;
      double length = d->ten_length[own->tendon], *range = m->tendon_range + 2 * own->tendon;
      if (range[1] - length != d->efc_pos[k]) continue; /* the lower limit */
      blow* b = all + count++;
      *b = (blow){.instance = i, .tendon = own->tendon, .row = k, .rows = 1, .dim = 1};
      b->x = b->depth = length - range[1];
      b->touches = b->depth >= 0;
      b->rate[0] = -d->ten_velocity[own->tendon];
      b->law = law_of_contact(m, own, 0, 0);
    }
  }
  return count;
}

/* Impacts of contacts that touch, into d->qfrc_passive and `impulse`; which of them rest then, and slip how fast. */
static void collide(const mjModel* m, mjData* d, blow* all, int count, double* impulse, const double* gravity,
                    int falls) {
  int n = 0, nv = m->nv, *rests;
  double h = m->opt.timestep;
  size_t rows = 3 * (size_t)count;
  mj_markStack(d);
  hcb_contact* c = mj_stackAllocByte(d, count * sizeof(hcb_contact), sizeof(double));
  blow** of = mj_stackAllocByte(d, count * sizeof(blow*), sizeof(double));
  for (int i = 0; i < count; i++) {
    if (all[i].touches) of[n++] = all + i;
  }
  rests = mj_stackAllocByte(d, count * sizeof(int), sizeof(double));
  double* calm = stack(d, count);
  double* J = malloc((2 * rows * nv + rows * rows + hcb_impacts_work(count) + 4 * rows) * sizeof(double));
  double *B = J + rows * nv, *G = B + rows * nv, *u = G + rows * rows, *p = u + rows, *slip = p + rows;
  double *free_ = slip + rows, *work = free_ + rows;
  for (int i = 0; i < n; i++) {
    const blow* b = of[i];
    double* row = J + 3 * (size_t)i * nv;
    memset(row, 0, 3 * (size_t)nv * sizeof(double));
    if (b->tendon >= 0) {
      tendon_row(m, d, b->tendon, row);
    } else {
      make_rows(m, d, b->body, b->point, b->frame, b->dim > 1 ? 3 : 1, row);
    }
    for (int k = 0; k < 3; k++) u[3 * i + k] = k && b->dim == 1 ? 0 : b->rate[k] - row_dot(nv, row + k * nv, d->qvel);
    c[i] = b->law;
  }
  hold_equalities(m, d, 3 * n, J);
  for (int i = 0; i < 3 * n; i++) u[i] += row_dot(nv, J + (size_t)i * nv, d->qvel);
  mj_solveM(m, d, B, J, 3 * n);
  hcb_coupling(n, nv, J, B, G);
  for (int i = 0; i < 3 * n; i++) free_[i] = falls ? h * row_dot(nv, B + (size_t)i * nv, gravity) : 0;
  for (int i = 0; i < n; i++) {
    double gained = -free_[3 * i];
    if (of[i]->tendon >= 0) c[i].still += HCB_STILL * fmax(0, gained);
    calm[i] = c[i].still;
    hcb_under_gravity(c + i, of[i]->x, -u[3 * i], gained / h, h, m->opt.integrator == mjINT_RK4);
  }
  for (int i = 0; i < 3 * n; i++) u[i] += free_[i] / 2;
  hcb_impacts(n, G, c, u, p, work);
  for (int i = 0; i < 3 * n; i++) {
    u[i] -= free_[i] / 2;
    free_[i] += u[i];
    for (int j = 0; j < nv && p[i] != 0; j++) impulse[j] += p[i] * J[(size_t)i * nv + j];
  }
  for (int i = 0; i < n; i++) rests[i] = of[i]->rests = u[3 * i] <= calm[i];
  hcb_resting_slip(n, G, c, free_, rests, slip, work);
  for (int i = 0; i < n; i++) {
    of[i]->parting = u[3 * i];
    of[i]->slip = fmin(slip[i], hypot(u[3 * i + 1], u[3 * i + 2]));
  }
  free(J);
  mj_freeStack(d);
}

static void check_options(const mjModel* m, int first) {
  if (m->opt.solver == mjSOL_CG && !is_dual(m) && takes_forces(m)) {
    fail(m, first, "the solver CG does not settle the forces that implicit integrators and joint damping take: set "
         "solver=\"Newton\", or integrator=\"Euler\" with the flag eulerdamp off");
  }
  if (m->opt.integrator > mjINT_IMPLICITFAST) fail(m, first, "the integrator must be Euler, implicit, implicitfast or RK4");
  if (m->opt.enableflags & mjENBL_OVERRIDE) fail(m, first, "the flag override must be off");
}

static void add_impacts(const mjModel* m, mjData* d, int first) {
  instance* memory = instance_of(d, first);
  int stage = stage_of(m, d, memory), nv = m->nv, busy = 0;
  double h = m->opt.timestep;
  check_options(m, first);
  mj_markStack(d);
  blow* all = mj_stackAllocByte(d, (d->ncon + d->nefc + 1) * sizeof(blow), sizeof(double));
  int count = gather(m, d, first, all);
  if (stage < 2) {
    for (int i = 0; i < count; i++) {
      blow* b = all + i;
      b->rests = b->touches && b->rate[0] <= b->law.still;
      b->parting = b->rate[0];
      double slow = 1e-6 * b->law.still, *u = b->rate;
      int slides = b->rests && b->friction[0] > 0 && u[1] * u[1] + u[2] * u[2] > slow * slow;
      busy |= b->touches && (-b->rate[0] > b->law.still || slides || b->tendon >= 0);
    }
    if (stage) {
      memory->impulse = realloc(memory->impulse, (nv + 1) * sizeof(double));
      mju_zero(memory->impulse, nv);
    }
    if (busy) {
      double *impulse = stage ? memory->impulse : stack(d, nv), *gravity = stack(d, nv);
      mju_zero(impulse, nv);
      collide(m, d, all, count, impulse, gravity, gravity_force(m, d, gravity));
      for (int j = 0; j < nv; j++) d->qfrc_passive[j] += impulse[j] / h;
      shift_bias(m, d, impulse, 1, d->qfrc_passive);
    }
  } else {
    for (int j = 0; j < nv; j++) d->qfrc_passive[j] += memory->impulse[j] / h;
    shift_bias(m, d, memory->impulse, stage == 4 ? 0 : 0.5, d->qfrc_passive);
  }
  double one, several;
  rest_compliance(m, &one, &several);
  for (int i = 0; i < count; i++) set_rows(m, d, memory, all + i, stage, all[i].several ? several : one);
  mj_freeStack(d);
}
