/* restitution: impacts are worked out from the velocities at the start of the (sub)step, all at once (impacts.c), and
   enter as forces over it. Bullet's own contact, with its restitution 0, then lets rest what is left without approach.

   Bullet stops what would touch within the step, before it touches, so that is when it collides here: a contact at a
   distance d that approaches faster than d/h, gravity of the step included. */

#define HCB_STILL 1.1 /* steps of falling whose speed counts as rest */
#define HCB_CUT 100   /* rad/s, where Bullet cuts the rates of jointed bodies, unless maxJointVelocity is larger */
#define HCB_LIFT 0.05 /* m/s: where contactERP lifts an overlap more slowly, it seldom gains 0.1 % of the energy */
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

/* Names a pair once whose overlap Bullet lifts, with energy that comes from nowhere. */
static void name_lifted(world* w, const contact* c) {
  if (-w->contact_erp * c->distance <= HCB_LIFT * w->h || c->of->lifted++) return;
  fail(w, "restitution, law %d: bodies %d and %d overlap by %.2g m, and contactERP %g lifts them, which gains energy: set"
       " contactERP=0", c->of->id, c->body[0]->id, c->body[1]->id, -c->distance, w->contact_erp);
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
    name_lifted(w, c);
    double d = fmax(0, c->distance) / w->h;
    if (d > HCB_NEAR * fastest + w->h * fabs(c->fall)) continue;
    hcb_contact* impact = laws + *near;
    *impact = c->of->impact;
    impact->friction = friction_of(c);
    impact->still = HCB_STILL * w->h * c->weight + 1e-9;
    hcb_under_gravity(impact, -c->distance, -c->rate[0], c->fall, w->h, 0);
    impact->still = fmax(impact->still, d - w->h * c->fall / 2);
    busy |= w->h * c->fall / 2 - c->rate[0] > impact->still;
    if (w->contacts + *near != c) w->contacts[*near] = *c;
    ++*near;
  }
  return busy;
}

/* Numbers the bodies that can move by their first contact; at[q]: where the velocities of part q begin. How many. */
static int number_parts(const world* w, int n, int* part_of, int* at) {
  int parts = 0;
  for (int i = 0; i < w->body_count; i++) part_of[i] = -1;
  at[0] = 0;
  for (int i = 0; i < 2 * n; i++) {
    const body* b = w->contacts[i / 2].body[i % 2];
    if (b->freedoms == 0 || part_of[b->id] >= 0) continue;
    part_of[b->id] = parts++;
    at[parts] = at[parts - 1] + b->freedoms;
  }
  return parts;
}

/* The rows of a contact over its bodies; of two links of one body as one part. */
static hcb_rows rows_of(world* w, const contact* c, const int* part_of) {
  hcb_rows r = {.part = {-1, -1}};
  int own[2] = {part_of[c->body[0]->id], part_of[c->body[1]->id]}, lower = own[1] >= 0 && (own[0] < 0 || own[1] < own[0]);
  for (int k = 0, s = 0; k < 2; k++) {
    int side = k ? !lower : lower, size = c->body[side]->freedoms, again = s && own[side] == r.part[0];
    if (own[side] < 0) continue;
    double *J = take(w, 6 * (size_t)size), *B = J + 3 * (size_t)size;
    memcpy(J, c->row[side][0], size * sizeof(double));
    memcpy(B, c->solved[side][0], size * sizeof(double));
    for (int row = 1; row < 3; row++) {
      const double* along = c->frame[row];
      make_row(c->body[side], c->link[side], c->at, along, sign_of(side), J + row * size, B + row * size);
    }
    for (int j = 0; again && j < 3 * size; j++) J[j] += r.J[0][j], B[j] += r.B[0][j];
    s -= again;
    r.part[s] = own[side];
    r.J[s] = J;
    r.B[s++] = B;
  }
  return r;
}

static double fall_along(const contact* c, const hcb_rows* r, int k, const int* part_of) {
  double sum = 0;
  for (int side = 0; side < 2; side++) {
    const body* b = c->body[side];
    int s = part_of[b->id] == r->part[0] ? 0 : 1;
    if (part_of[b->id] < 0 || (side && b == c->body[0])) continue;
    for (int j = 0; j < b->freedoms; j++) sum -= r->J[s][k * b->freedoms + j] * b->falling[j];
  }
  return sum;
}

/* Names a body at its first impact if a constraint holds it: the solver meets that in the step, after the impacts. */
static void name_held(world* w, const law* l, body* b) {
  int held = b->struck++ ? -1 : constraint_of(w, b->id);
  if (held < 0) return;
  fail(w, "restitution, law %d: body %d is held by constraint %d, which has no part in impacts: e may differ, and energy"
       " may be gained; a joint has its part", l->id, b->id, held);
}

/* Lets struck bodies go on from their velocities after the impacts p; names those that turn too fast for Bullet's step. */
static void go_on(world* w, const hcb_system* s, const double* p, const int* part_of) {
  double* change = take(w, s->at[s->parts]);
  int* done = take_ints(w, s->parts);
  memset(change, 0, s->at[s->parts] * sizeof(double));
  memset(done, 0, s->parts * sizeof(int));
  for (int i = 0; i < 3 * s->n; i++) {
    if (p[i] != 0) push_system(s, i / 3, i % 3, p[i], change);
  }
  for (int i = 0; i < 2 * s->n; i++) {
    body* b = w->contacts[i / 2].body[i % 2];
    law* l = w->contacts[i / 2].of;
    if (part_of[b->id] < 0 || p[3 * (i / 2)] == 0 || done[part_of[b->id]]++) continue;
    name_held(w, l, b);
    double rate = 0, turn = go_on_from(w, b, change + s->at[part_of[b->id]], &rate);
    if ((turn <= HCB_FAST && rate <= HCB_CUT) || l->warned) continue;
    l->warned = 1;
    if (turn <= HCB_FAST) {
      fail(w, "restitution, law %d: body %d turns by %.3g rad/s, and Bullet cuts the rates of joints at %d rad/s: set a"
           " larger maxJointVelocity by changeDynamics", l->id, b->id, rate, HCB_CUT);
      continue;
    }
    fail(w, "restitution, law %d: body %d turns by %.2g rad in a step of %g s, too far for Bullet's joints: take %.1g s", l->id,
         b->id, turn, w->h, w->h * HCB_FAST / turn);
  }
}

static void add_impacts(world* w) {
  int n = 0, count = find_contacts(w);
  if (count == 0) return;
  hcb_contact* c = (hcb_contact*)take(w, (size_t)count * sizeof(hcb_contact) / sizeof(double) + 1);
  if (!sort_out(w, count, c, &n)) return;
  contact* all = w->contacts;
  int *part_of = take_ints(w, w->body_count), *at = take_ints(w, 2 * (size_t)n + 1), parts = number_parts(w, n, part_of, at);
  hcb_rows* rows = (hcb_rows*)take(w, (size_t)n * sizeof(hcb_rows) / sizeof(double) + 1);
  hcb_system s = {n, parts, at, rows, c};
  double *u = take(w, 6 * (size_t)n), *p = u + 3 * (size_t)n;
  for (int i = 0; i < n; i++) {
    rows[i] = rows_of(w, all + i, part_of);
    for (int k = 0; k < 3; k++) u[3 * i + k] = all[i].rate[k] - w->h / 2 * fall_along(all + i, rows + i, k, part_of);
  }
  hcb_impacts(&s, u, p, take(w, hcb_impacts_work(n, parts, at[parts])));
  for (int i = 0; i < n; i++) {
    double force[3] = {0, 0, 0};
    if (p[3 * i] == 0) continue;
    for (int k = 0; k < 9; k++) force[k % 3] += p[3 * i + k / 3] / w->h * all[i].frame[k / 3][k % 3];
    push_both(w, all + i, force);
    all[i].of->force += p[3 * i] / w->h;
  }
  go_on(w, &s, p, part_of);
}
