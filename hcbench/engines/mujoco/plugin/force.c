/* hcbench.hunt_crossley: MuJoCo's collision functions say where pairs touch, from before touch on, and each contact
   gets the force that carries it along the law's motion over the step. */

#define HCB_COARSE 1.0 /* (omega h)^2 beyond which a step is too coarse */

typedef struct {
  int instance, id, order, body[2];
  double x, v, inverse_mass, force, point[3], normal[3], slip[3], *row[2], *solved[2];
  int part[2]; /* whose dofs row and solved are over */
  hcb_law law;
} touch;

typedef struct {
  int instance, id, geom1, geom2;
  double reach;
} candidate;

/* How far a geom's surface can move in a step, m. */
static double travel(const mjModel* m, const mjData* d, int geom) {
  int body = m->geom_bodyid[geom];
  double v[3];
  const double* w = d->cvel + 6 * body;
  if (m->body_weldid[body] == 0) return 1e-12;
  velocity_at(m, d, body, d->geom_xpos + 3 * geom, v);
  double turning = m->geom_type[geom] == mjGEOM_PLANE ? 0 : sqrt(dot(w, w)) * m->geom_rbound[geom];
  return m->opt.timestep * (sqrt(dot(v, v)) + turning) + 1e-12;
}

static int apart(const mjModel* m, const mjData* d, int g1, int g2, double reach) {
  const double *c1 = d->geom_xpos + 3 * g1, *c2 = d->geom_xpos + 3 * g2, *R = d->geom_xmat + 9 * g1;
  double r1 = m->geom_rbound[g1], r2 = m->geom_rbound[g2];
  double between[3] = {c2[0] - c1[0], c2[1] - c1[1], c2[2] - c1[2]};
  if (m->geom_type[g1] == mjGEOM_PLANE) {
    return r2 > 0 && between[0] * R[2] + between[1] * R[5] + between[2] * R[8] > r2 + reach;
  }
  double sum = r1 + r2 + reach;
  return r1 > 0 && r2 > 0 && dot(between, between) > sum * sum;
}

/* Pairs that may touch within the step; returns how many, of at most `room`. */
static int near_pairs(const mjModel* m, mjData* d, int first, candidate* near) {
  int count = 0;
  for (int i = first; i < m->nplugin; i++) {
    const instance* own = instance_of(d, i);
    if (m->plugin[i] != m->plugin[first]) continue;
    if (own->tendon >= 0) {
      double reach = m->opt.timestep * fabs(d->ten_velocity[own->tendon]) + 1e-12;
      if (d->ten_length[own->tendon] + reach >= m->tendon_range[2 * own->tendon + 1]) {
        near[count++] = (candidate){i, 0, -1, -1, reach};
      }
    }
    for (int k = 0; k < own->pairs; k++) {
      int g1 = own->pair[2 * k], g2 = own->pair[2 * k + 1];
      double reach = travel(m, d, g1) + travel(m, d, g2);
      if (!apart(m, d, g1, g2, reach)) near[count++] = (candidate){i, k, g1, g2, reach};
    }
  }
  return count;
}

/* MuJoCo's own contacts of a pair, from `reach` before touch on. */
static int narrow_phase(const mjModel* m, mjData* d, const candidate* near, touch* out) {
  mjfCollision function = mjCOLLISIONFUNC[m->geom_type[near->geom1]][m->geom_type[near->geom2]];
  if (!function) return 0;
#ifdef HCB_PRECONTACT
  mjPreContact found[mjMAXCONPAIR];
#else
  mjContact found[mjMAXCONPAIR];
#endif
  int count = function(m, d, found, near->geom1, near->geom2, near->reach);
  for (int i = 0; i < count; i++) {
    touch* c = out + i;
    double v1[3], v2[3];
#ifdef HCB_PRECONTACT
    const double* normal = found[i].normal;
#else
    const double* normal = found[i].frame;
#endif
    *c = (touch){.instance = near->instance, .id = near->id, .order = i, .x = -found[i].dist};
    memcpy(c->point, found[i].pos, sizeof(c->point));
    memcpy(c->normal, normal, sizeof(c->normal));
    c->body[0] = m->geom_bodyid[near->geom1];
    c->body[1] = m->geom_bodyid[near->geom2];
    velocity_at(m, d, c->body[0], c->point, v1);
    velocity_at(m, d, c->body[1], c->point, v2);
    for (int j = 0; j < 3; j++) c->slip[j] = v2[j] - v1[j];
    c->v = -dot(c->slip, c->normal);
    for (int j = 0; j < 3; j++) c->slip[j] += c->v * c->normal[j];
  }
  return count;
}

static hcb_law law_of(const mjModel* m, const instance* own, double inverse_mass, double b) {
  hcb_law law = {value_of(m, &own->stiffness) * inverse_mass, 1.5 * value_of(m, &own->alpha), own->exponent, b, 0, 1, 0, 0};
  if (own->asked_for_e) {
    law.a = 0;
    law.chi = hcb_chi(own->law, value_of(m, &own->e));
    law.e = hcb_restitution(law.chi);
    law.load = b;
  }
  return law;
}

static double couple_of(const tree_parts* t, const touch* a, const touch* b) {
  double sum = 0;
  for (int k = 0; k < 4; k++) {
    int own = a->part[k / 2], other = b->part[k % 2];
    if (own >= 0 && own == other) sum += row_dot(part_size(t, own), a->row[k / 2], b->solved[k % 2]);
  }
  return sum;
}

/* What the other contacts do to the approach of one, to first order, enters as an acceleration. Only those that share a
   part do: each part has a list of its contacts, in ascending order. */
static void couple(mjData* d, const tree_parts* t, touch* all, int count) {
  mj_markStack(d);
  int *head = ints(d, t->parts), *next = ints(d, 2 * (size_t)count);
  for (int q = 0; q < t->parts; q++) head[q] = -1;
  for (int i = count - 1; i >= 0; i--) {
    hcb_law own = all[i].law;
    own.b = 0;
    all[i].force = -acceleration(&own, all[i].x, all[i].v) / all[i].inverse_mass;
    for (int s = 0; s < 2 && all[i].part[s] >= 0; s++) {
      next[2 * i + s] = head[all[i].part[s]];
      head[all[i].part[s]] = 2 * i + s;
    }
  }
  for (int i = 0; i < count; i++) {
    int list[2];
    for (int s = 0; s < 2; s++) list[s] = all[i].part[s] >= 0 ? head[all[i].part[s]] : -1;
    while (list[0] >= 0 || list[1] >= 0) {
      int a = list[0] >= 0 ? list[0] / 2 : count, b = list[1] >= 0 ? list[1] / 2 : count, j = a < b ? a : b;
      if (a == j) list[0] = next[list[0]];
      if (b == j) list[1] = next[list[1]];
      if (i != j && all[j].force != 0) all[i].law.b -= couple_of(t, all + i, all + j) * all[j].force;
    }
  }
  mj_freeStack(d);
}

/* Rows of a contact along a direction and M^-1 of them, and its inverse mass along it. */
static double solve_rows(const mjModel* m, mjData* d, const tree_parts* t, const touch* c, const double* along,
                         double* const row[2], double* const solved[2]) {
  double sum = 0;
  make_rows(m, d, t, c->body, c->point, along, 1, c->part, row);
  for (int s = 0; s < 2 && c->part[s] >= 0; s++) {
    int size = part_size(t, c->part[s]);
    memcpy(solved[s], row[s], size * sizeof(double));
    solve_part(m, d, t, c->part[s], solved[s]);
    for (int j = 0; j < size; j++) sum += row[s][j] * solved[s][j];
  }
  return sum;
}

static void allot(mjData* d, const tree_parts* t, const int part[2], double* row[2], double* solved[2]) {
  for (int s = 0; s < 2 && part[s] >= 0; s++) {
    row[s] = stack(d, part_size(t, part[s]));
    solved[s] = stack(d, part_size(t, part[s]));
  }
}

static void push(const mjModel* m, mjData* d, const tree_parts* t, const touch* c) {
  const instance* own = instance_of(d, c->instance);
  double slip = sqrt(dot(c->slip, c->slip)), *row[2], *solved[2];
  for (int s = 0; s < 2 && c->part[s] >= 0; s++) part_add(t, c->part[s], c->row[s], c->force, d->qfrc_passive);
  if (own->tendon >= 0 || own->static_friction == 0 || slip == 0) return;
  double along[3] = {c->slip[0] / slip, c->slip[1] / slip, c->slip[2] / slip};
  mj_markStack(d);
  allot(d, t, c->part, row, solved);
  /* A step can stop the slip, never turn it around. */
  double most = slip / (m->opt.timestep * solve_rows(m, d, t, c, along, row, solved));
  double drag = fmin(hcb_friction(own->static_friction, own->dynamic_friction, own->slip_speed, slip) * c->force, most);
  for (int s = 0; s < 2 && c->part[s] >= 0; s++) part_add(t, c->part[s], row[s], -drag, d->qfrc_passive);
  mj_freeStack(d);
}

static void set_force(const mjModel* m, instance* memory, touch* c, int stage) {
  double h = m->opt.timestep, plain = 0;
  c->force = 0;
  if (!isfinite(c->x) || !isfinite(c->v) || !(c->inverse_mass > 0)) return;
  double deep = fmax(c->x, c->x + h * c->v); /* a coarse step goes through the contact at once */
  if (h * h * frequency_squared(&c->law, deep) > HCB_COARSE && !memory->warned) {
    memory->warned = 1;
    mju_warning("plugin %s, instance \"%s\": the step of %g s is too coarse for this contact; take a shorter one, or "
                "%s", FORCE_NAME, mj_id2name(m, mjOBJ_PLUGIN, c->instance), h, RESTITUTION_NAME);
  }
  if (stage > 1) {
    plan* made = planned(memory, c->instance, c->id, c->order);
    c->force = made ? made->value[stage == 4 ? 2 : 1] : 0;
    return;
  }
  if (!stage) {
    plain = hcb_euler_force(&c->law, h, c->x, c->v, NULL);
  } else {
    double stages[3];
    hcb_rk4_stage_forces(&c->law, h, c->x, c->v, stages);
    plan* made = new_plan(memory, c->instance, c->id, c->order);
    for (int i = 0; i < 3; i++) made->value[i] = stages[i] / c->inverse_mass;
    plain = stages[0];
  }
  c->force = plain / c->inverse_mass;
}

/* Rows, masses and laws of what was found. */
static void prepare(const mjModel* m, mjData* d, const tree_parts* t, touch* all, int count) {
  double* gravity = stack(d, m->nv);
  int falls = gravity_force(m, d, gravity);
  for (int i = 0; i < count; i++) {
    touch* c = all + i;
    const instance* own = instance_of(d, c->instance);
    if (own->tendon >= 0) {
      tendon_row(m, d, t, own->tendon, c->part, NULL);
    } else {
      set_parts(m, t, c->body, c->part);
    }
    allot(d, t, c->part, c->row, c->solved);
    if (own->tendon < 0) {
      c->inverse_mass = solve_rows(m, d, t, c, c->normal, c->row, c->solved);
    } else if (c->part[0] >= 0) {
      tendon_row(m, d, t, own->tendon, c->part, c->row[0]);
      memcpy(c->solved[0], c->row[0], part_size(t, c->part[0]) * sizeof(double));
      solve_part(m, d, t, c->part[0], c->solved[0]);
      c->inverse_mass = row_dot(part_size(t, c->part[0]), c->row[0], c->solved[0]);
    }
    const double* const solved[2] = {c->solved[0], c->solved[1]};
    c->law = law_of(m, own, c->inverse_mass, falls ? -along_row(t, c->part, solved, gravity) : 0);
    if (c->x > 0) set_touch_speed(&c->law, c->x, c->v);
  }
}

/* What touches of the near pairs, in mjData's stack; `count` of them. */
static touch* find_touches(const mjModel* m, mjData* d, const candidate* near, int pairs, int* count) {
  touch *all = NULL, found[mjMAXCONPAIR];
  int room = 0;
  *count = 0;
  for (int k = 0; k < pairs; k++) {
    int tendon = instance_of(d, near[k].instance)->tendon, n = 1;
    if (tendon < 0) {
      n = narrow_phase(m, d, near + k, found);
    } else {
      double x = d->ten_length[tendon] - m->tendon_range[2 * tendon + 1];
      found[0] = (touch){.instance = near[k].instance, .x = x, .v = d->ten_velocity[tendon]};
    }
    if (*count + n > room) { /* twice as much, so that what is left behind is no more than what is used */
      room = 2 * (*count + n) + 4 * pairs;
      touch* more = mj_stackAllocByte(d, room * sizeof(touch), sizeof(double));
      if (*count) memcpy(more, all, *count * sizeof(touch));
      all = more;
    }
    if (n) memcpy(all + *count, found, n * sizeof(touch));
    *count += n;
  }
  return all;
}

static void add_forces(const mjModel* m, mjData* d, int first) {
  instance* memory = instance_of(d, first);
  int stage = stage_of(m, d, memory), pairs = 0, count;
  for (int i = first; i < m->nplugin; i++) {
    if (m->plugin[i] == m->plugin[first]) pairs += 1 + instance_of(d, i)->pairs;
  }
  mj_markStack(d);
  candidate* near = mj_stackAllocByte(d, pairs * sizeof(candidate), sizeof(double));
  touch* all = find_touches(m, d, near, near_pairs(m, d, first, near), &count);
  if (count) {
    tree_parts t = make_parts(m, d, first, 0);
    prepare(m, d, &t, all, count);
    if (count > 1 && stage < 2) couple(d, &t, all, count);
    for (int i = 0; i < count; i++) {
      set_force(m, memory, all + i, stage);
      if (all[i].force > 0) push(m, d, &t, all + i);
    }
  }
  mj_freeStack(d);
}
