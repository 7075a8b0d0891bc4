/* The restitution law: the rows of a contact that MuJoCo found get the acceleration that makes this very
   step end at e(v) of this very approach, or at rest. The solver does the rest: friction, several contacts,
   resting loads. */

/* Implicit integrators take qfrc_constraint, whose rounding grows as 1/compliance; others take qacc. */
static int takes_forces(const mjModel* m) {
  if (m->opt.integrator == mjINT_IMPLICIT || m->opt.integrator == mjINT_IMPLICITFAST) return 1;
  if (m->opt.integrator != mjINT_EULER || m->opt.disableflags & mjDSBL_EULERDAMP) return 0;
  for (int j = 0; j < m->nv; j++) {
    if (m->dof_damping[j] != 0) return 1;
  }
  return 0;
}

/* A row that yields by `compliance` times its own share is asked for as much more as it will yield. */
static void set_row(mjData* d, int row, double acceleration_, double compliance, double force) {
  double* KBIP = d->efc_KBIP + 4 * row;
  d->efc_R[row] = fmax(d->efc_R[row] * KBIP[2] / (1 - KBIP[2]) * compliance, mjMINVAL);
  d->efc_D[row] = 1 / d->efc_R[row];
  /* mj_referenceConstraint comes next and computes -B vel - K I (pos - margin). */
  KBIP[0] = 1;
  KBIP[1] = 0;
  d->efc_margin[row] = d->efc_pos[row] + (acceleration_ + d->efc_R[row] * force) / KBIP[2];
#ifdef HCB_ISLAND_ROWS
  if (d->nisland > 0) {
    int island_row = d->map_efc2iefc[row];
    d->iefc_R[island_row] = d->efc_R[row];
    d->iefc_D[island_row] = d->efc_D[row];
  }
#endif
}

/* Approach of a contact by gravity, and by gravity on one of its bodies alone, which the other may bear. */
static void gravity_along(const mjModel* m, const hcb_table* t, const mjContact* c, double* both, double* most) {
  double g[3];
  *both = *most = 0;
  for (int side = 0; side < 2; side++) {
    int body = m->geom_bodyid[c->geom[side]];
    if (t->body[body] == FIXED) continue;
    gravity_on(m, body, g);
    double one = (side ? -1 : 1) * dot(g, c->frame);
    *both += one;
    *most = fmax(*most, one);
  }
}

/* Whether the bodies of a contact have no other: then its force is known beforehand. */
static int alone(const mjModel* m, const mjData* d, const mjContact* c) {
  int r1 = m->body_rootid[m->geom_bodyid[c->geom[0]]], r2 = m->body_rootid[m->geom_bodyid[c->geom[1]]], count = 0;
  for (int i = 0; i < d->ncon; i++) {
    const mjContact* o = d->contact + i;
    if (o->efc_address < 0 || o->geom[0] < 0 || o->geom[1] < 0) continue;
    for (int side = 0; side < 2; side++) {
      int root = m->body_rootid[m->geom_bodyid[o->geom[side]]];
      count += root && (root == r1 || root == r2);
    }
  }
  return count == (r1 != 0) + (r2 != 0);
}

static double compliance_of(const mjModel* m, int known) {
  return !takes_forces(m) ? HCB_RIGID : known ? 1e-3 : 1e-8;
}

static double inverse_mass_at(const mjModel* m, mjData* d, const hcb_table* t, const mjContact* c) {
  touch at = {0};
  memcpy(at.point, c->pos, sizeof(at.point));
  at.body[0] = m->geom_bodyid[c->geom[0]];
  at.body[1] = m->geom_bodyid[c->geom[1]];
  double sum = free_mobility(m, d, t->body, &at, c->frame);
  if (t->body[at.body[0]] != JOINTED && t->body[at.body[1]] != JOINTED) return sum;
  mark_stack(d);
  double* work = stack(d, 5 * (size_t)m->nv * sizeof(double), sizeof(double));
  make_row(m, d, t->body, &at, c->frame, work, work + m->nv, work + 2 * m->nv);
  sum += row_dot(m->nv, work, work + m->nv);
  free_stack(d);
  return sum;
}

/* The speed to leave with. What one step of falling gives is no impact that steps can tell from rest. */
static double parting_speed(const mjModel* m, const hcb_pair* p, double approach, double gravity) {
  double alpha = law_of(m, p, 1, 0).a / 1.5;
  if (!(approach > fmax(0, HCB_STILL * m->opt.timestep * gravity))) return 0;
  if (p->reading == CONSTANT) return approach * alpha;
  return approach * (p->reading == LINEAR ? fmax(0, 1 - alpha * approach) : hcb_restitution(1.5 * alpha * approach));
}

/* Accelerations of a contact's rows, and the force that they will take. */
static void targets(const mjModel* m, mjData* d, const hcb_table* t, const hcb_pair* p, const mjContact* c,
                    plan* out) {
  int b1 = m->geom_bodyid[c->geom[0]], b2 = m->geom_bodyid[c->geom[1]];
  double v1[3], v2[3], rate[6], turn[3], h = m->opt.timestep;
  velocity_at(m, d, b1, c->pos, v1);
  velocity_at(m, d, b2, c->pos, v2);
  for (int i = 0; i < 3; i++) {
    v2[i] -= v1[i];
    turn[i] = d->cvel[6 * b2 + i] - d->cvel[6 * b1 + i];
  }
  for (int i = 0; i < 3; i++) {
    rate[i] = dot(v2, c->frame + 3 * i);
    rate[3 + i] = dot(turn, c->frame + 3 * i);
  }
#ifdef HCB_SURFACE_VELOCITY
  for (int i = 0; i < 3; i++) rate[1 + i] += c->surfacevel[i];
#endif
  double gravity, most;
  gravity_along(m, t, c, &gravity, &most);
  double parting = parting_speed(m, p, -rate[0], most);
  int rows = out->cone ? 2 * (c->dim - 1) : c->dim;
  for (int i = 0; i < rows; i++) {
    int k = out->cone ? 1 + i / 2 : i;
    double sign = i % 2 ? -1 : 1;
    if (out->cone) {
      out->value[i] = (parting - rate[0] - sign * c->friction[k - 1] * rate[k]) / h;
    } else {
      out->value[i] = ((i ? 0 : parting) - rate[i]) / h;
    }
  }
  double slip = fabs(rate[1]) + fabs(rate[2]);
  out->rows = rows;
  out->compliance = compliance_of(m, parting > 0 && (c->dim == 1 || slip <= 1e-6 * parting) && alone(m, d, c));
  out->force = fmax(0, (parting - rate[0]) / h + gravity) / inverse_mass_at(m, d, t, c) / (out->cone ? rows : 1);
}

/* All stages of a Runge-Kutta step push alike; what touches only between stages waits for the next step. */
static void set_rows(mjData* d, hcb_table* t, int stage, plan* now, int row) {
  if (!isfinite(now->value[0])) __atomic_add_fetch(&t->not_finite, 1, __ATOMIC_RELAXED);
  plan* made = NULL;
  if (stage == 1) {
    made = new_plan(now->pair, now->order);
    if (made) *made = *now;
  } else if (stage > 1) {
    made = planned(now->pair, now->order);
    if (!made || made->rows != now->rows) {
      made = NULL;
      now->force = 0;
      for (int j = 0; j < now->rows; j++) now->value[j] = j && !now->cone ? 0 : -1e10;
    }
  }
  if (!made) made = now;
  for (int j = 0; j < made->rows; j++) {
    set_row(d, row + j, made->value[j], made->compliance, j && !made->cone ? 0 : made->force);
  }
}

static int tendon_pair(const mjModel* m, const mjData* d, const hcb_table* t, int row) {
  int tendon = d->efc_id[row];
  double length = d->ten_length[tendon], *range = m->tendon_range + 2 * tendon;
  for (int k = t->geom_pairs; k < t->pairs; k++) {
    const hcb_pair* p = t->pair + k;
    double left = p->side > 0 ? range[1] - length : length - range[0];
    if (p->kind == RESTITUTION && p->tendon == tendon && left == d->efc_pos[row]) return k;
  }
  return -1;
}

static void rewrite_tendon_rows(const mjModel* m, mjData* d, hcb_table* t, int stage) {
  for (int i = 0; i < d->nefc; i++) {
    int k = d->efc_type[i] == mjCNSTR_LIMIT_TENDON ? tendon_pair(m, d, t, i) : -1;
    if (k < 0) continue;
    const hcb_pair* p = t->pair + k;
    double approach = p->side * d->ten_velocity[p->tendon], h = m->opt.timestep;
    mark_stack(d);
    double *row = stack(d, 2 * (size_t)m->nv * sizeof(double), sizeof(double)), *solved = row + m->nv;
    tendon_row(m, d, p->tendon, -p->side, row);
    solve(m, d, solved, row, 1);
    double gravity = gravity_on_row(m, t, row), parting = parting_speed(m, p, approach, gravity);
    plan now = {.pair = k, .rows = 1, .value = {(parting + approach) / h}};
    now.compliance = compliance_of(m, parting > 0);
    now.force = fmax(0, now.value[0] + gravity) / row_dot(m->nv, row, solved);
    free_stack(d);
    set_rows(d, t, stage, &now, i);
  }
}

static void rewrite_rows(const mjModel* m, mjData* d, hcb_table* t, int stage) {
  int before = -1, order = 0;
  if (t->restitution_pairs == 0) return;
  for (int i = 0; i < d->ncon; i++) {
    const mjContact* c = d->contact + i;
    int k = c->efc_address >= 0 && c->geom[0] >= 0 && c->geom[1] >= 0 ? find(t, c->geom[0], c->geom[1]) : -1;
    if (k < 0 || t->pair[k].kind != RESTITUTION) continue;
    order = k == before ? order + 1 : 0;
    before = k;
    plan now = {.pair = k, .order = order, .cone = c->dim > 1 && m->opt.cone == mjCONE_PYRAMIDAL};
    targets(m, d, t, t->pair + k, c, &now);
    set_rows(d, t, stage, &now, c->efc_address);
  }
  if (t->pairs > t->geom_pairs) rewrite_tendon_rows(m, d, t, stage);
}
