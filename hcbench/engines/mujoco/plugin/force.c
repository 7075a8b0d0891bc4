/* The force law: the force over the step of each contact, equal and opposite on its bodies. */

/* What the other contacts do to the approach of one, to first order, enters as an acceleration. */
static void couple(const mjModel* m, const mjData* d, const hcb_table* t, touch* all, int count, int* uses) {
  memset(uses, 0, m->nbody * sizeof(int));
  for (int i = 0; i < count; i++) {
    uses[m->body_rootid[all[i].body[0]]]++;
    uses[m->body_rootid[all[i].body[1]]]++;
  }
  uses[0] = 0;
  for (int i = 0; i < count; i++) {
    hcb_law own = all[i].law;
    own.b = 0;
    all[i].force = -acceleration(&own, all[i].x, all[i].v) / all[i].inverse_mass;
  }
  for (int i = 0; i < count; i++) {
    touch* c = all + i;
    int shared = uses[m->body_rootid[c->body[0]]] > 1 || uses[m->body_rootid[c->body[1]]] > 1;
    if (!shared && !c->dense) continue;
    for (int j = 0; j < count; j++) {
      touch* o = all + j;
      if (i == j || o->force == 0) continue;
      double sum = c->dense && o->dense ? row_dot(m->nv, c->row, o->solved) : 0;
      for (int s = 0; s < 4; s++) {
        int body = c->body[s / 2];
        if (t->body[body] != FREE || o->body[s % 2] != body) continue;
        double both = mobility(m, d, body, c->point, c->normal, o->point, o->normal);
        sum += s / 2 == s % 2 ? both : -both;
      }
      c->law.b -= sum * o->force;
    }
  }
}

static double friction_at(const hcb_pair* p, double slip) {
  double s = slip / p->slip_speed, static_ = p->static_friction, dynamic = p->dynamic_friction;
  if (s >= 3) return dynamic;
  if (s >= 1) {
    double z = (s - 1) / 2;
    return static_ - (static_ - dynamic) * z * z * z * (10 + z * (6 * z - 15));
  }
  return static_ * s * s * s * (10 + s * (6 * s - 15));
}

static void push(const mjModel* m, mjData* d, int kind, int body, const double* point, const double* force) {
  const double zero[3] = {0, 0, 0}, *R = d->xmat + 9 * body, *origin = d->xpos + 3 * body;
  if (kind == FIXED) return;
  if (kind == JOINTED) {
    apply_ft(m, d, force, zero, point, body, d->qfrc_passive);
    return;
  }
  double arm[3] = {point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]}, torque[3];
  double* q = d->qfrc_passive + m->body_dofadr[body];
  cross(torque, arm, force);
  for (int i = 0; i < 3; i++) {
    q[i] += force[i];
    q[3 + i] += R[i] * torque[0] + R[3 + i] * torque[1] + R[6 + i] * torque[2];
  }
}

static void push_pair(const mjModel* m, mjData* d, const hcb_table* t, const touch* c, double* work) {
  const hcb_pair* p = t->pair + c->pair;
  if (p->tendon >= 0) {
    for (int j = 0; j < m->nv; j++) d->qfrc_passive[j] += c->force * c->row[j];
    return;
  }
  double force[3], opposite[3], slip = sqrt(dot(c->slip, c->slip)), drag = 0;
  if (p->static_friction > 0 && slip > 0) {
    double along[3] = {c->slip[0] / slip, c->slip[1] / slip, c->slip[2] / slip};
    double inverse_mass = free_mobility(m, d, t->body, c, along);
    if (c->dense) {
      double *row = work, *solved = work + m->nv;
      make_row(m, d, t->body, c, along, row, solved, work + 2 * m->nv);
      inverse_mass += row_dot(m->nv, row, solved);
    }
    /* A step can stop the slip, never turn it around. */
    drag = fmin(friction_at(p, slip) * c->force, slip / (m->opt.timestep * inverse_mass)) / slip;
  }
  for (int i = 0; i < 3; i++) {
    force[i] = c->force * c->normal[i] - drag * c->slip[i];
    opposite[i] = -force[i];
  }
  push(m, d, t->body[c->body[1]], c->body[1], c->point, force);
  push(m, d, t->body[c->body[0]], c->body[0], c->point, opposite);
}

static void set_force(const mjModel* m, hcb_table* t, touch* c, int stage) {
  double h = m->opt.timestep, plain = 0, stages[3];
  if (!isfinite(c->x) || !isfinite(c->v) || !isfinite(c->inverse_mass)) {
    __atomic_add_fetch(&t->not_finite, 1, __ATOMIC_RELAXED);
    c->force = 0;
    return;
  }
  if (h * h * frequency_squared(&c->law, c->x) > HCB_COARSE) __atomic_add_fetch(&t->too_coarse, 1, __ATOMIC_RELAXED);
  if (!stage) {
    plain = hcb_euler_force(&c->law, h, c->x, c->v);
  } else if (stage == 1) {
    hcb_rk4_stage_forces(&c->law, h, c->x, c->v, stages);
    plan* made = stages[0] > 0 || stages[1] > 0 || stages[2] > 0 ? new_plan(c->pair, c->order) : NULL;
    for (int i = 0; made && i < 3; i++) made->value[i] = stages[i] / c->inverse_mass;
    plain = stages[0];
  } else {
    plan* made = planned(c->pair, c->order);
    c->force = made ? made->value[stage == 4 ? 2 : 1] : 0;
    return;
  }
  c->force = plain / c->inverse_mass;
}

/* pair, x, v, F, effective mass, point, normal, law's a. */
static void write_report(const touch* c, double* out) {
  const double row[HCB_REPORT] = {c->pair, c->x, c->v, c->force, 1 / c->inverse_mass, c->point[0], c->point[1],
                                  c->point[2], c->normal[0], c->normal[1], c->normal[2], c->law.a};
  memcpy(out, row, sizeof(row));
}

static void add_forces(const mjModel* m, mjData* d, hcb_table* t, int stage, double* report, int* reported) {
  int room, dense, nv = m->nv;
  mark_stack(d);
  candidate* near = stack(d, (t->pairs + 1) * sizeof(candidate), sizeof(double));
  double* travels = stack(d, m->ngeom * sizeof(double), sizeof(double));
  memset(travels, 0, m->ngeom * sizeof(double));
  int pairs = near_pairs(m, d, t, near, travels, &room, &dense);
  if (pairs) {
    touch* all = stack(d, (room + mjMAXCONPAIR) * sizeof(touch), sizeof(double));
    double* rows = stack(d, (2 * dense + 6) * (size_t)nv * sizeof(double), sizeof(double));
    double* work = rows + 2 * (size_t)dense * nv;
    int count = gather(m, d, t, near, pairs, all, rows, work);
    if (count > 1 && stage < 2) couple(m, d, t, all, count, stack(d, m->nbody * sizeof(int), sizeof(int)));
    for (int i = 0; i < count; i++) {
      set_force(m, t, all + i, stage);
      if (report) {
        if (i < *reported) write_report(all + i, report + HCB_REPORT * i);
      } else if (all[i].force > 0) {
        push_pair(m, d, t, all + i, work);
      }
    }
    if (reported && *reported > count) *reported = count;
  } else if (reported) {
    *reported = 0;
  }
  free_stack(d);
}
