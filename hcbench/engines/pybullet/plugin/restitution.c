/* restitution: impacts are worked out from the velocities at the start of the (sub)step, all at once (impacts.c), and
   enter as forces over it. Bullet's own contact, with its restitution 0, then lets rest what is left without approach.

   Bullet stops what would touch within the step, before it touches, so that is when it collides here: a contact at a
   distance d that approaches faster than d/h, gravity of the step included. */

#define HCB_STILL 1.1 /* steps of falling whose speed counts as rest */
#define HCB_CUT 100   /* rad/s, where Bullet cuts the rates of jointed bodies, unless maxJointVelocity is larger */
#define HCB_THROW 0.05 /* m/s: where contactERP lifts an overlap more slowly, it seldom gains 0.1 % of the energy */
#define HCB_SAG 4     /* steps of falling that what rests may overlap by */
#define HCB_LIFT 3e-4 /* m/s: what contactERP lifts so slowly gains g times that a second, 3e-3 J/kg */
#define HCB_NEAR 4    /* contacts farther than so many steps of the fastest one have no part in what happens */

typedef struct { /* the laws of each body that is the later one of its pair, in their order */
  int *head, *next;
} law_lists;

static law_lists list_laws(world* w) {
  law_lists lists = {take_ints(w, w->body_count), take_ints(w, w->law_count)};
  for (int k = 0; k < w->body_count; k++) lists.head[k] = -1;
  for (int i = w->law_count - 1; i >= 0; i--) {
    const law* l = w->laws + i;
    int* head = lists.head + (l->body[0] > l->body[1] ? l->body[0] : l->body[1]);
    lists.next[i] = *head;
    *head = i;
  }
  return lists;
}

static law* law_of(const world* w, const law_lists* lists, const b3Contact* p) {
  int later = p->body[0] > p->body[1] ? p->body[0] : p->body[1];
  for (int i = later < w->body_count ? lists->head[later] : -1; i >= 0; i = lists->next[i]) {
    law* l = w->laws + i;
    for (int s = 0; s < 2 && !l->is_force; s++) {
      int fits = l->body[s] == p->body[0] && l->body[!s] == p->body[1];
      fits = fits && (l->link[s] == ANY || l->link[s] == p->link[0]);
      if (fits && (l->link[!s] == ANY || l->link[!s] == p->link[1])) return l;
    }
  }
  return NULL;
}

/* Adds a contact unless Bullet would not act on it either; how many there are then. */
static int add_contact(world* w, law* l, const b3Contact* p, int count) {
  contact* c = room_for(w, count + 1) + count;
  if (!set_contact(w, l, p, c)) return count;
  for (int s = 0; s < 2; s++) {
    if (c->distance > c->body[s]->link[c->link[s]].info.processing_threshold) return count;
  }
  name_carried(w, c);
  return count + 1;
}

/* Contacts of pairs that have a law, at the present positions: of spheres worked out here, others Bullet's. */
static int find_contacts(world* w) {
  b3Contacts found;
  const law* only = NULL;
  int count = 0, others = 0;
  for (int i = 0; i < w->law_count; i++) {
    law* l = w->laws + i;
    b3Contact exact;
    if (!l->is_force && !l->shape[0]) others++, only = l;
    if (!l->is_force && l->shape[0] && exact_point(w, l, &exact)) count = add_contact(w, l, &exact, count);
  }
  if (!others) return count;
  send(w, b3InitPerformCollisionDetectionCommand(w->client));
  void* query = b3InitRequestContactPointInformation(w->client);
  if (others == 1) {
    b3SetContactFilterBodyA(query, only->body[0]);
    b3SetContactFilterBodyB(query, only->body[1]);
  }
  send(w, query);
  b3GetContactPointInformation(w->client, &found);
  law_lists lists = list_laws(w);
  for (int i = 0; i < found.count; i++) {
    law* l = law_of(w, &lists, found.points + i);
    if (l && !l->shape[0]) count = add_contact(w, l, found.points + i, count);
  }
  return count;
}

/* The speed at which contactERP lifts what is `distance` apart, m/s. */
static double lift_of(const world* w, double distance) { return -w->contact_erp * distance / w->h; }

/* Whether contactERP lifts a pair that has no law. */
static int lifts_others(world* w) {
  b3Contacts found;
  send(w, b3InitRequestContactPointInformation(w->client));
  b3GetContactPointInformation(w->client, &found);
  law_lists lists = list_laws(w);
  for (int i = 0; i < found.count; i++) {
    const b3Contact* p = found.points + i;
    if (lift_of(w, p->distance) > HCB_LIFT && !law_of(w, &lists, p)) return 1;
  }
  return 0;
}

static void set_contact_erp(world* w, double value) {
  void* command = b3InitPhysicsParamCommand(w->client);
  b3PhysicsParamSetDefaultContactERP(command, value);
  send(w, command);
}

/* contactERP throws pairs with a law out of a deep overlap, by energy that comes from nowhere: lets it lift them slowly. Bullet
   has one for all pairs: so it is smaller for this (sub)step, where it lifts no pair without a law, and as it was before
   anyone can ask. Stacks need it whole, and overlap by about a step of falling. Names a pair once where it stays whole. */
static void lift_slowly(world* w, int count) {
  const contact* deepest = w->contacts;
  for (int i = 1; i < count; i++) {
    if (w->contacts[i].distance < deepest->distance) deepest = w->contacts + i;
  }
  double fastest = lift_of(w, deepest->distance), shallow = HCB_SAG * w->h * w->h * sqrt(dot(w->gravity, w->gravity));
  if (-deepest->distance <= shallow || fastest <= HCB_LIFT) return;
  if (!lifts_others(w)) {
    set_contact_erp(w, w->contact_erp * HCB_LIFT / fastest);
    w->is_erp_less = 1;
  } else if (fastest > HCB_THROW && !deepest->of->lifted++) {
    fail(w, "restitution, law %d: bodies %d and %d overlap by %.2g m, and contactERP %g lifts them and pairs without a law,"
         " which gains energy: set contactERP=0", deepest->of->id, deepest->body[0]->id, deepest->body[1]->id,
         -deepest->distance, w->contact_erp);
  }
}

/* After the (sub)step, in which Bullet has read it. */
static void restore_contact_erp(world* w) {
  if (w->is_erp_less) set_contact_erp(w, w->contact_erp);
  w->is_erp_less = 0;
}

/* What a contact is in an impact, and whether it collides. */
static int set_impact(const world* w, const contact* c, hcb_contact* impact) {
  double d = fmax(0, c->distance) / w->h;
  *impact = c->of->impact;
  impact->friction = friction_of(c);
  impact->still = HCB_STILL * w->h * c->weight + 1e-9;
  hcb_under_gravity(impact, -c->distance, -c->rate[0], c->fall, w->h, 0);
  impact->still = fmax(impact->still, d - w->h * c->fall / 2);
  return w->h * c->fall / 2 - c->rate[0] > impact->still;
}

/* Whether any contact collides in this step; `near` of them, the first ones then, may take part. */
static int sort_out(world* w, int count, hcb_contact* laws, int* near) {
  double fastest = 0;
  int busy = 0;
  *near = 0;
  for (int i = 0; i < count; i++) {
    const double* u = w->contacts[i].rate;
    fastest = fmax(fastest, sqrt(dot(u, u)));
  }
  for (int i = 0; i < count; i++) {
    contact* c = w->contacts + i;
    double d = fmax(0, c->distance) / w->h;
    if (d > HCB_NEAR * fastest + w->h * fabs(c->fall)) continue;
    int collides = set_impact(w, c, laws + *near);
    busy |= collides;
    name_deeper(w, c, collides);
    if (w->contacts + *near != c) w->contacts[*near] = *c;
    ++*near;
  }
  return busy;
}

/* J M^-1 J^T of one row of a contact. */
static double own_mobility(const held_parts* t, const hcb_rows* r, int direction) {
  double sum = 0;
  for (int s = 0; s < 2 && r->part[s] >= 0; s++) {
    int size = size_of(t, r->part[s]);
    for (int j = direction * size; j < (direction + 1) * size; j++) sum += r->J[s][j] * r->B[s][j];
  }
  return sum;
}

/* Takes from a row of a contact what constraints do not let happen: all of it, where they leave but rounding. */
static void hold_row(const held_parts* t, const hcb_rows* r, double** J, double** B, int direction) {
  double free_ = own_mobility(t, r, direction);
  for (int s = 0; s < 2 && r->part[s] >= 0; s++) hold(t, r->part[s], B[s] + direction * size_of(t, r->part[s]));
  if (own_mobility(t, r, direction) > HCB_REDUNDANT * free_) return;
  for (int s = 0; s < 2 && r->part[s] >= 0; s++) {
    size_t size = size_of(t, r->part[s]);
    memset(J[s] + direction * size, 0, size * sizeof(double));
    memset(B[s] + direction * size, 0, size * sizeof(double));
  }
}

/* The rows of a contact over its parts; of two bodies of one part as one. */
static hcb_rows rows_of(world* w, const contact* c, const held_parts* t) {
  hcb_rows r = {.part = {-1, -1}};
  double *J[2], *B[2];
  int own[2] = {t->part[c->body[0]->id], t->part[c->body[1]->id]}, lower = own[1] >= 0 && (own[0] < 0 || own[1] < own[0]);
  for (int k = 0, s = 0; k < 2; k++) {
    int side = k ? !lower : lower, part = own[side], many = c->body[side]->freedoms, again = s && part == r.part[0];
    if (part < 0) continue;
    int size = size_of(t, part), place = t->place[c->body[side]->id];
    s -= again;
    if (!again) {
      J[s] = take(w, 6 * (size_t)size);
      B[s] = J[s] + 3 * (size_t)size;
      memset(J[s], 0, 6 * (size_t)size * sizeof(double));
    }
    double *row = take(w, 2 * (size_t)many), *solved = row + many;
    for (int direction = 0; direction < 3; direction++) {
      const double* along = c->frame[direction];
      make_point_row(c->body[side], c->link[side], c->at, along, sign_of(side), row, solved);
      for (int j = 0; j < many; j++) {
        J[s][direction * size + place + j] += row[j];
        B[s][direction * size + place + j] += solved[j];
      }
    }
    r.part[s] = part;
    r.J[s] = J[s];
    r.B[s] = B[s];
    s++;
  }
  for (int direction = 0; direction < 3; direction++) hold_row(t, &r, J, B, direction);
  return r;
}

/* What gravity does to all velocities, of bodies that are held together. */
static double* falling_of(world* w, const held_parts* t) {
  double* all = take(w, t->at[t->parts]);
  for (int id = 0; id < w->body_count; id++) {
    const body* b = w->bodies[id];
    if (b && b->freedoms && t->part[id] >= 0) {
      memcpy(all + t->at[t->part[id]] + t->place[id], b->falling, b->freedoms * sizeof(double));
    }
  }
  for (int q = 0; q < t->parts; q++) hold(t, q, all + t->at[q]);
  return all;
}

/* Names a pair once of which a constraint holds a body without a part in impacts: Bullet's solver meets it after them. */
static void name_held(world* w, int n, const b3Constraint* c) {
  for (int i = 0; i < 2 * n; i++) {
    const body* b = w->contacts[i / 2].body[i % 2];
    law* l = w->contacts[i / 2].of;
    if (!b->freedoms || (b->id != c->body[0] && b->id != c->body[2]) || l->held++) continue;
    fail(w, "restitution, law %d: body %d is held by constraint %d, a gear or one with a maxForce below %d N, which has no"
         " part in impacts: e may differ, and energy may be gained", l->id, b->id, c->id, HCB_FIRM);
  }
}

/* Names a body that turns too fast for Bullet's step, once. */
static void name_fast(world* w, law* l, const body* b, double turn, double rate) {
  if ((turn <= HCB_FAST && rate <= HCB_CUT) || l->warned++) return;
  if (turn <= HCB_FAST) {
    fail(w, "restitution, law %d: body %d turns by %.3g rad/s, and Bullet cuts the rates of joints at %d rad/s: set a"
         " larger maxJointVelocity by changeDynamics", l->id, b->id, rate, HCB_CUT);
    return;
  }
  fail(w, "restitution, law %d: body %d turns by %.2g rad in a step of %g s, too far for Bullet's joints and constraints: take %.1g s", l->id,
       b->id, turn, w->h, w->h * HCB_FAST / turn);
}

/* Lets struck bodies go on from their velocities after the impacts p, of rates u before, held together as they are. */
static void go_on(world* w, const hcb_system* s, const double* u, const double* p, const held_parts* t) {
  size_t size = t->at[t->parts];
  double *change = take(w, 2 * size), *impulse = change + size;
  law** by = (law**)take(w, t->parts);
  memset(change, 0, 2 * size * sizeof(double));
  memset(by, 0, t->parts * sizeof(law*));
  for (int i = 0; i < 3 * s->n; i++) {
    const hcb_rows* r = s->rows + i / 3;
    if (p[i] == 0) continue;
    push_system(s, i / 3, i % 3, p[i], change);
    for (int side = 0; side < 2 && r->part[side] >= 0; side++) {
      int part = r->part[side], many = size_of(t, part);
      const double* row = r->J[side] + i % 3 * many;
      for (int j = 0; j < many; j++) impulse[t->at[part] + j] += p[i] * row[j];
      if (!by[part]) by[part] = w->contacts[i / 3].of;
    }
  }
  for (int q = 0; q < t->parts; q++) {
    if (!by[q]) continue;
    bring_back(t, q, change + t->at[q]);
    push_held(w, t, q, impulse + t->at[q]);
  }
  w->last = (last_impacts){*s, u, p, t->part, t->place, by, w->body_count, w->tick};
  for (int id = 0; id < w->body_count; id++) {
    const body* b = w->bodies[id];
    law* l = b && b->freedoms && t->part[id] >= 0 ? by[t->part[id]] : NULL;
    if (!l) continue;
    const double* own = change + t->at[t->part[id]] + t->place[id];
    double rate = 0, turn = go_on_from(w, b, own, &rate);
    /* Bullet solves constraints, as joints, by the positions of the step's start. */
    if (!b->is_tree && t->count[t->part[id]] > 0) turn = free_turn_of(w, b, own);
    name_fast(w, l, b, turn, rate);
    if (b->is_tree) name_stops(w, b, own);
  }
}

/* Leaves the firm constraints of `all`; names the others. How many. */
static int firm_constraints(world* w, int n, b3Constraint* all, int count) {
  int firm = 0;
  for (int i = 0; i < count; i++) {
    if (is_firm(w, all + i)) {
      all[firm++] = all[i];
    } else {
      name_held(w, n, all + i);
    }
  }
  return firm;
}

static void add_impacts(world* w) {
  int n = 0, count = find_contacts(w);
  if (count == 0) return;
  lift_slowly(w, count);
  hcb_contact* c = (hcb_contact*)take(w, (size_t)count * sizeof(hcb_contact) / sizeof(double) + 1);
  if (!sort_out(w, count, c, &n)) return;
  contact* all = w->contacts;
  b3Constraint* held;
  int held_count = read_constraints(w, &held);
  held_count = firm_constraints(w, n, held, held_count);
  held_parts t = find_parts(w, n, held, held_count);
  if (held_count) meet_together(w, &t);
  hcb_rows* rows = (hcb_rows*)take(w, (size_t)n * sizeof(hcb_rows) / sizeof(double) + 1);
  hcb_system s = {n, t.parts, t.at, rows, c};
  double *u = take(w, 6 * (size_t)n), *p = u + 3 * (size_t)n, *falling = falling_of(w, &t), *back = take(w, t.at[t.parts]);
  memset(back, 0, t.at[t.parts] * sizeof(double));
  for (int q = 0; q < t.parts; q++) bring_back(&t, q, back + t.at[q]);
  for (int i = 0; i < n; i++) {
    rows[i] = rows_of(w, all + i, &t);
    all[i].fall = -rate_of(&s, i, 0, falling);
    for (int k = 0; k < 3; k++) {
      int is_free = own_mobility(&t, rows + i, k) > 0;
      all[i].rate[k] = is_free ? all[i].rate[k] + rate_of(&s, i, k, back) : 0;
      u[3 * i + k] = all[i].rate[k] + w->h / 2 * rate_of(&s, i, k, falling);
    }
    if (held_count) set_impact(w, all + i, c + i);
  }
  double* came = take(w, 3 * (size_t)n);
  memcpy(came, u, 3 * (size_t)n * sizeof(double));
  hcb_impacts(&s, u, p, take(w, hcb_impacts_work(n, t.parts, t.at[t.parts])));
  for (int i = 0; i < n; i++) {
    double force[3] = {0, 0, 0};
    if (p[3 * i] == 0) continue;
    for (int k = 0; k < 9; k++) force[k % 3] += p[3 * i + k / 3] / w->h * all[i].frame[k / 3][k % 3];
    push_both(w, all + i, force);
    all[i].of->force += p[3 * i] / w->h;
  }
  go_on(w, &s, came, p, &t);
}
