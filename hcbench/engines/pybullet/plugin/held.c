/* Parts of an impact: a body, or bodies that constraints (createConstraint) hold together, which bounce with the mass of
   all of them. The rows are those of Bullet's own solver, so that an impact leaves it nothing to correct. */

#define HCB_FIRM 500        /* N: Bullet's maxForce of a constraint, with which it does not yield, unless a user changes it */
#define HCB_REDUNDANT 1e-10 /* of a row's own inverse mass, what of it the rows before leave free */

typedef struct {
  int parts, *at;     /* part q has the velocities at[q] ... at[q + 1] - 1 */
  int *part, *place;  /* of each body: its part, -1 without one; where its freedoms begin in it */
  int* count;         /* of each part: its independent rows ... */
  double ***E, ***EB; /* ... and M^-1 of each, so that E M^-1 E^T = 1 */
  double **drift;     /* E v: what bodies that turn have moved out of the rows since Bullet's last step */
} held_parts;

static int size_of(const held_parts* t, int part) { return t->at[part + 1] - t->at[part]; }

/* All constraints of the world at this moment: Bullet does not tell when one is made, changed or removed. How many. */
static int read_constraints(world* w, b3Constraint** all) {
  process(w, b3InitSyncBodyInfoCommand(w->client), w->numbers, NUMBERS_ROOM);
  int count = w->status->of.counts.constraints, known = 0;
  const int* numbers = w->numbers + w->status->of.counts.bodies;
  *all = (b3Constraint*)take(w, count * sizeof(b3Constraint) / sizeof(double) + 1);
  for (int i = 0; i < count; i++) {
    b3Command* command = b3InitGetUserConstraintStateCommand(w->client, numbers[i]);
    command->flags = CONSTRAINT_INFO;
    process(w, command, w->state, sizeof(b3State));
    const b3Constraint* c = &w->status->of.constraint;
    /* Of what holds a soft body it tells nothing. */
    if (c->id == numbers[i]) (*all)[known++] = *c;
  }
  return known;
}

static body* held_body(world* w, const b3Constraint* c, int side) { return refreshed(w, c->body[2 * side]); }

/* Whether a constraint can have a part in impacts. Bullet does not tell the ratio of a gear. */
static int is_firm(world* w, const b3Constraint* c) {
  body* parent = held_body(w, c, 0);
  if (c->type != POINT_TO_POINT && c->type != FIXED && c->type != PRISMATIC) return 0;
  /* Between bodies of maximal coordinates it does not obey maxForce. */
  return parent && (c->max_force >= HCB_FIRM || parent->base->info.type != MULTI_BODY);
}

static int top_of(int* above, int id) {
  while (above[id] != id) id = above[id] = above[above[id]];
  return id;
}

/* Numbers the parts by their first contact, and the freedoms of their bodies. */
static held_parts number_parts(world* w, int n, const b3Constraint* held, int held_count) {
  for (int i = 0; i < 2 * held_count; i++) held_body(w, held + i / 2, i % 2); /* so that all bodies are known */
  int bodies = w->body_count, *above = take_ints(w, bodies), *number = take_ints(w, bodies);
  held_parts t = {.part = take_ints(w, bodies), .place = take_ints(w, bodies), .at = take_ints(w, 2 * (size_t)n + 1)};
  for (int k = 0; k < bodies; k++) above[k] = k, number[k] = t.part[k] = -1;
  for (int i = 0; i < held_count; i++) {
    const body *one = held_body(w, held + i, 0), *two = held_body(w, held + i, 1);
    if (one && two && one->freedoms && two->freedoms) above[top_of(above, one->id)] = top_of(above, two->id);
  }
  for (int i = 0; i < 2 * n; i++) {
    const body* b = w->contacts[i / 2].body[i % 2];
    int top = top_of(above, b->id);
    if (b->freedoms && number[top] < 0) number[top] = t.parts++;
  }
  memset(t.at, 0, (t.parts + 1) * sizeof(int));
  for (int k = 0; k < bodies; k++) {
    if (!w->bodies[k] || !w->bodies[k]->freedoms || (t.part[k] = number[top_of(above, k)]) < 0) continue;
    t.place[k] = t.at[t.part[k] + 1];
    t.at[t.part[k] + 1] += w->bodies[k]->freedoms;
  }
  for (int q = 0; q < t.parts; q++) t.at[q + 1] += t.at[q];
  return t;
}

/* Takes from a vector of a part's velocities what its constraints do not let happen. */
static void hold(const held_parts* t, int part, double* v) {
  int size = size_of(t, part);
  for (int k = 0; k < t->count[part]; k++) {
    double along = 0;
    for (int j = 0; j < size; j++) along += t->E[part][k][j] * v[j];
    for (int j = 0; j < size; j++) v[j] -= along * t->EB[part][k][j];
  }
}

/* Adds a row, of a force on both bodies' pivots and a torque, to those of its part, unless they hold what it holds. */
static void add_row(world* w, held_parts* t, int part, const b3Constraint* c, const double (*pivot)[3], const double* force,
                    const double* torque) {
  int size = size_of(t, part), k = t->count[part];
  double *e = take(w, 2 * (size_t)size), *b = e + size, own = 0, left = 0, drift = 0;
  memset(e, 0, 2 * (size_t)size * sizeof(double));
  for (int side = 0; side < 2; side++) {
    const body* one = held_body(w, c, side);
    if (!one || !one->freedoms) continue;
    double *row = take(w, 2 * (size_t)one->freedoms), *solved = row + one->freedoms, arm[3], moment[3], rate[3];
    int link = c->body[2 * side + 1], place = t->place[one->id];
    velocity_at(one, link, pivot[side], rate);
    drift += (side ? -1 : 1) * (dot(force, rate) + dot(torque, one->link[link].motion + 3));
    for (int i = 0; i < 3; i++) arm[i] = pivot[side][i] - one->link[link].pose[i];
    cross(arm, force, moment);
    for (int i = 0; i < 3; i++) moment[i] += torque[i];
    make_row(one, link, force, moment, side ? -1 : 1, row, solved);
    for (int j = 0; j < one->freedoms; j++) e[place + j] += row[j], b[place + j] += solved[j];
  }
  for (int j = 0; j < size; j++) own += e[j] * b[j];
  for (int i = 0; i < k; i++) {
    double along = 0;
    for (int j = 0; j < size; j++) along += e[j] * t->EB[part][i][j];
    for (int j = 0; j < size; j++) e[j] -= along * t->E[part][i][j], b[j] -= along * t->EB[part][i][j];
    drift -= along * t->drift[part][i];
  }
  for (int j = 0; j < size; j++) left += e[j] * b[j];
  if (!(left > HCB_REDUNDANT * own)) return;
  for (int j = 0; j < size; j++) e[j] /= sqrt(left), b[j] /= sqrt(left);
  t->E[part][k] = e;
  t->EB[part][k] = b;
  t->drift[part][k] = drift / sqrt(left);
  t->count[part]++;
}

/* Adds the rows of a constraint: its pivots keep together, but along the axis of a slide, and turn together. */
static void add_rows_of(world* w, held_parts* t, int part, const b3Constraint* c) {
  static const double none[3] = {0, 0, 0}, unit[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  double pivot[2][3], axis[3], across[2][3];
  memcpy(pivot[1], c->frame[1], sizeof(pivot[1])); /* in the world, for which there is no body */
  for (int side = 0; side < 2; side++) {
    const body* b = held_body(w, c, side);
    if (!b) continue;
    const double* pose = b->link[c->body[2 * side + 1]].pose;
    rotate(pose + 3, c->frame[side], 1, pivot[side]);
    for (int i = 0; i < 3; i++) pivot[side][i] += pose[i];
    if (side == 0) rotate(pose + 3, c->axis, 1, axis);
  }
  if (c->type == PRISMATIC) {
    int least = fabs(axis[0]) < fabs(axis[1]) ? 0 : 1;
    cross(axis, unit[least], across[0]);
    cross(axis, across[0], across[1]);
  }
  for (int i = 0; i < 3 && c->type != POINT_TO_POINT; i++) add_row(w, t, part, c, pivot, none, unit[i]);
  for (int i = 0; i < 3 && c->type != PRISMATIC; i++) add_row(w, t, part, c, pivot, unit[i], none);
  for (int i = 0; i < 2 && c->type == PRISMATIC; i++) add_row(w, t, part, c, pivot, across[i], none);
}

/* The parts of n contacts, and what holds them together. */
static held_parts find_parts(world* w, int n, const b3Constraint* held, int held_count) {
  held_parts t = number_parts(w, n, held, held_count);
  t.count = take_ints(w, t.parts);
  t.E = (double***)take(w, 2 * (size_t)t.parts);
  t.EB = t.E + t.parts;
  t.drift = (double**)take(w, t.parts);
  memset(t.count, 0, t.parts * sizeof(int));
  for (int way = 0; way < 2; way++) { /* counts the rows, then takes room for them and makes them */
    for (int i = 0; i < held_count; i++) {
      for (int side = 0, done = 0; side < 2 && !done; side++) {
        const body* b = held_body(w, held + i, side);
        int part = b ? t.part[b->id] : -1;
        if (part < 0) continue;
        done = 1;
        if (way) add_rows_of(w, &t, part, held + i);
        if (!way) t.count[part] += 6;
      }
    }
    for (int q = 0; q < t.parts && !way; q++) {
      t.E[q] = (double**)take(w, 2 * (size_t)t.count[q]);
      t.EB[q] = t.E[q] + t.count[q];
      t.drift[q] = take(w, t.count[q]);
      t.count[q] = 0;
    }
  }
  return t;
}

/* Adds to a part's velocities what brings it back into its rows, as Bullet's solver will: an impact from drifted velocities
   could gain energy, by the work of what holds. */
static void bring_back(const held_parts* t, int part, double* v) {
  for (int k = 0; k < t->count[part]; k++) {
    for (int j = 0; j < size_of(t, part); j++) v[j] -= t->drift[part][k] * t->EB[part][k][j];
  }
}

/* Pushes a body by an impulse on each of its freedoms: on joints as a pair, on the link and the one that carries it. */
static void push_freedoms(world* w, const body* b, const double* impulse) {
  double(*wrench)[6] = (double(*)[6])take(w, 6 * ((size_t)b->links + 1));
  memset(wrench, 0, ((size_t)b->links + 1) * sizeof(*wrench));
  if (!b->is_tree) {
    memcpy(wrench[0], impulse, 3 * sizeof(double));
    rotate(b->base->pose + 3, impulse + 3, 1, wrench[0] + 3);
  }
  for (int k = 0; k < b->freedoms && b->is_tree; k++) {
    int link = b->owner[k], carrier = link < 0 ? -1 : b->link[link].parent, turns = dot(b->twist_w[k], b->twist_w[k]) > 0;
    const double *along = turns ? b->twist_w[k] : b->twist_v[k], *on = b->link[link].pose, *from = b->link[carrier].pose;
    double arm[3] = {on[0] - from[0], on[1] - from[1], on[2] - from[2]}, moment[3];
    cross(arm, along, moment);
    for (int i = 0; i < 3; i++) {
      wrench[link + 1][3 * turns + i] += impulse[k] * along[i];
      if (link >= 0) wrench[carrier + 1][3 * turns + i] -= impulse[k] * along[i];
      if (link >= 0 && !turns) wrench[carrier + 1][3 + i] -= impulse[k] * moment[i];
    }
  }
  for (int i = -1; i < b->links; i++) {
    for (int k = 0; k < 6; k++) wrench[i + 1][k] /= w->h;
    push_wrench(w, b, i, wrench[i + 1]);
  }
}

/* Pushes the bodies of a part by what holds them together when they are given an impulse on their freedoms. */
static void push_held(world* w, const held_parts* t, int part, const double* impulse) {
  int size = size_of(t, part);
  double* answer = take(w, size);
  if (t->count[part] == 0) return;
  memset(answer, 0, size * sizeof(double));
  for (int k = 0; k < t->count[part]; k++) {
    double along = 0;
    for (int j = 0; j < size; j++) along += t->EB[part][k][j] * impulse[j];
    for (int j = 0; j < size; j++) answer[j] -= (t->drift[part][k] + along) * t->E[part][k][j];
  }
  for (int id = 0; id < w->body_count; id++) {
    if (w->bodies[id] && w->bodies[id]->freedoms && t->part[id] == part) push_freedoms(w, w->bodies[id], answer + t->place[id]);
  }
}
