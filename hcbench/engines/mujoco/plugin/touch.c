/* Contacts of the force law: the engine's own collision functions, asked from before touch on, and what a
   unit force does along each. */

/* How far a geom's surface can move in a step, m; kept in `known`, whose zeros are to be found out. */
static double travel(const mjModel* m, const mjData* d, int geom, double* known) {
  if (known[geom] > 0) return known[geom];
  int body = m->geom_bodyid[geom];
  double v[3], *w = d->cvel + 6 * body;
  velocity_at(m, d, body, d->geom_xpos + 3 * geom, v);
  double turning = m->geom_type[geom] == mjGEOM_PLANE ? 0 : sqrt(dot(w, w)) * m->geom_rbound[geom];
  return known[geom] = m->opt.timestep * (sqrt(dot(v, v)) + turning) + 1e-12;
}

typedef struct {
  int pair, geom1, geom2;
  double reach;
} candidate;

static int apart(const mjModel* m, const mjData* d, int g1, int g2, double reach) {
  const double *c1 = d->geom_xpos + 3 * g1, *c2 = d->geom_xpos + 3 * g2, *R = d->geom_xmat + 9 * g1;
  double r1 = m->geom_rbound[g1], r2 = m->geom_rbound[g2];
  double between[3] = {c2[0] - c1[0], c2[1] - c1[1], c2[2] - c1[2]};
  if (m->geom_type[g1] == mjGEOM_PLANE) {
    return r2 > 0 && between[0] * R[2] + between[1] * R[5] + between[2] * R[8] > r2 + reach;
  }
  double sum = r1 + r2 + reach;
  if (fabs(between[0]) > sum && r1 > 0 && r2 > 0) return 1; /* most of many pairs end here */
  return r1 > 0 && r2 > 0 && dot(between, between) > sum * sum;
}

/* The engine's own contacts of a pair, from `reach` before touch on; geom1 is the one of the lower type. */
static int narrow_phase(const mjModel* m, mjData* d, const candidate* near, touch* out, int room) {
  int g1 = near->geom1, g2 = near->geom2;
  mjfCollision function = collide[m->geom_type[g1]][m->geom_type[g2]];
  if (!function) return 0;
#ifdef HCB_PRECONTACT
  mjPreContact found[mjMAXCONPAIR];
#else
  mjContact found[mjMAXCONPAIR];
#endif
  int count = function(m, d, found, g1, g2, near->reach);
  if (count > room) count = room;
  for (int i = 0; i < count; i++) {
    touch* c = out + i;
    double v1[3], v2[3];
    c->order = i;
    c->x = -found[i].dist;
    memcpy(c->point, found[i].pos, sizeof(c->point));
#ifdef HCB_PRECONTACT
    memcpy(c->normal, found[i].normal, sizeof(c->normal));
#else
    memcpy(c->normal, found[i].frame, sizeof(c->normal));
#endif
    c->body[0] = m->geom_bodyid[g1];
    c->body[1] = m->geom_bodyid[g2];
    velocity_at(m, d, c->body[0], c->point, v1);
    velocity_at(m, d, c->body[1], c->point, v2);
    for (int j = 0; j < 3; j++) c->slip[j] = v2[j] - v1[j];
    c->v = -dot(c->slip, c->normal);
    for (int j = 0; j < 3; j++) c->slip[j] += c->v * c->normal[j];
  }
  return count;
}

/* Rows of jointed bodies only: free ones have their mobility in closed form. */
static void make_row(const mjModel* m, mjData* d, const int* kind, const touch* c, const double* n, double* row,
                     double* solved, double* work) {
  int nv = m->nv;
  memset(row, 0, nv * sizeof(double));
  for (int side = 0; side < 2; side++) {
    int body = c->body[side];
    if (kind[body] != JOINTED) continue;
    jacobian(m, d, work, NULL, c->point, body);
    for (int j = 0; j < nv; j++) {
      double along = n[0] * work[j] + n[1] * work[nv + j] + n[2] * work[2 * nv + j];
      row[j] += side ? along : -along;
    }
  }
  solve(m, d, solved, row, 1);
}

static double row_dot(int nv, const double* a, const double* b) {
  double sum = 0;
  for (int j = 0; j < nv; j++) sum += a[j] * b[j];
  return sum;
}

static double free_mobility(const mjModel* m, const mjData* d, const int* kind, const touch* c, const double* n) {
  double sum = 0;
  for (int side = 0; side < 2; side++) {
    int body = c->body[side];
    if (kind[body] == FREE) sum += mobility(m, d, body, c->point, n, c->point, n);
  }
  return sum;
}

static void tendon_row(const mjModel* m, const mjData* d, int tendon, double sign, double* row) {
  memset(row, 0, m->nv * sizeof(double));
#ifdef HCB_TENDON_ROWS_IN_MODEL
  const int *count = m->ten_J_rownnz, *start = m->ten_J_rowadr, *column = m->ten_J_colind;
#else
  const int *count = d->ten_J_rownnz, *start = d->ten_J_rowadr, *column = d->ten_J_colind;
  int sparse = m->opt.jacobian == mjJAC_SPARSE || (m->opt.jacobian == mjJAC_AUTO && m->nv >= 60);
  if (!sparse) {
    for (int j = 0; j < m->nv; j++) row[j] = sign * d->ten_J[(size_t)tendon * m->nv + j];
    return;
  }
#endif
  for (int j = 0; j < count[tendon]; j++) row[column[start[tendon] + j]] = sign * d->ten_J[start[tendon] + j];
}

static double gravity_on_row(const mjModel* m, const hcb_table* t, const double* row) {
  double sum = 0, g[3];
  for (int body = 1; body < m->nbody; body++) {
    if (t->body[body] != FREE) continue;
    gravity_on(m, body, g);
    sum -= dot(g, row + m->body_dofadr[body]);
  }
  return sum;
}

/* A tendon's limit as a contact: the penetration is the length beyond it. */
static int tendon_touch(const mjModel* m, mjData* d, const hcb_table* t, const hcb_pair* p, touch* c) {
  double length = d->ten_length[p->tendon], *range = m->tendon_range + 2 * p->tendon;
  c->order = 0;
  c->x = p->side > 0 ? length - range[1] : range[0] - length;
  c->v = p->side * d->ten_velocity[p->tendon];
  c->body[0] = c->body[1] = 0;
  memset(c->slip, 0, sizeof(c->slip));
  tendon_row(m, d, p->tendon, -p->side, c->row);
  solve(m, d, c->solved, c->row, 1);
  c->inverse_mass = row_dot(m->nv, c->row, c->solved);
  c->law.b = gravity_on_row(m, t, c->row);
  return c->inverse_mass > 0;
}

/* Pairs that may touch within the step, and how many contacts they can report: *dense of them need rows. */
static int near_pairs(const mjModel* m, const mjData* d, const hcb_table* t, candidate* out, double* travels,
                      int* room, int* dense) {
  int count = 0;
  double h = m->opt.timestep, fall = h * h * sqrt(dot(m->opt.gravity, m->opt.gravity));
  *room = *dense = 0;
  for (int k = 0; k < t->pairs; k++) {
    const hcb_pair* p = t->pair + k;
    candidate c = {k, p->geom1, p->geom2, 0};
    int most = 1, rows = 1;
    if (p->kind != FORCE) continue;
    if (p->tendon < 0) {
      if (m->geom_type[p->geom1] > m->geom_type[p->geom2]) {
        c.geom1 = p->geom2;
        c.geom2 = p->geom1;
      }
      c.reach = 1.01 * (travel(m, d, c.geom1, travels) + travel(m, d, c.geom2, travels) + fall) + 1e-9;
      if (apart(m, d, c.geom1, c.geom2, c.reach)) continue;
      int round = m->geom_type[c.geom1] == mjGEOM_SPHERE || m->geom_type[c.geom2] == mjGEOM_SPHERE;
      most = round ? 1 : mjMAXCONPAIR;
      rows = t->body[m->geom_bodyid[c.geom1]] == JOINTED || t->body[m->geom_bodyid[c.geom2]] == JOINTED;
    }
    *room += most;
    if (rows) *dense += most;
    out[count++] = c;
  }
  return count;
}

static void prepare(const mjModel* m, mjData* d, const hcb_table* t, touch* c, double* work) {
  double g[3], b = 0;
  for (int side = 0; side < 2; side++) {
    if (t->body[c->body[side]] != FREE) continue;
    gravity_on(m, c->body[side], g);
    b += (side ? -1 : 1) * dot(g, c->normal);
  }
  c->inverse_mass = free_mobility(m, d, t->body, c, c->normal);
  if (c->dense) {
    make_row(m, d, t->body, c, c->normal, c->row, c->solved, work);
    c->inverse_mass += row_dot(m->nv, c->row, c->solved);
  }
  c->law.b = b;
}

static int gather(const mjModel* m, mjData* d, const hcb_table* t, const candidate* near, int pairs, touch* all,
                  double* rows, double* work) {
  int count = 0;
  for (int k = 0; k < pairs; k++) {
    const hcb_pair* p = t->pair + near[k].pair;
    touch* first = all + count;
    int found = p->tendon >= 0 ? 1 : narrow_phase(m, d, near + k, first, mjMAXCONPAIR);
    for (int i = 0; i < found; i++) {
      touch* c = first + i;
      c->pair = near[k].pair;
      c->dense = p->tendon >= 0 || t->body[c->body[0]] == JOINTED || t->body[c->body[1]] == JOINTED;
      c->row = c->dense ? rows : NULL;
      c->solved = c->dense ? rows + m->nv : NULL;
      if (c->dense) rows += 2 * m->nv;
      if (p->tendon >= 0) {
        tendon_touch(m, d, t, p, c);
      } else {
        prepare(m, d, t, c, work);
      }
      c->law = law_of(m, p, c->inverse_mass, c->law.b);
      if (c->x > 0) set_touch_speed(&c->law, c->x, c->v);
    }
    count += found;
  }
  return count;
}
