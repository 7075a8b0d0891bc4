/* Motors and limits of joints are rows of Bullet's solver, which acts within the step, after the impacts: they change the rate
   at which a contact parts by J M^-1 times their impulse, and so its e. Bullet does not tell how strong a motor may get,
   only what it has done: so they have no part in the impacts, and are named where e has changed by much. */

#define HCB_ANOTHER_E 0.05 /* change of e that is named */
#define HCB_HARD 30        /* steps of falling whose speed a contact needs to be named: slower ones soon rest, on motors */

/* The rate at which contact i of the last impacts parts, as an impulse on a freedom of a body changes it. */
static double rate_by(const world* w, int i, const body* b, int freedom) {
  const hcb_rows* r = w->last.system.rows + i;
  int part = w->last.part[b->id], side = r->part[0] == part ? 0 : 1;
  return r->part[side] == part ? r->B[side][w->last.place[b->id] + freedom] : 0;
}

/* A joint's own limit within the step, which its rate after an impact would pass: what impulse stops it there. */
static double stop_of(const world* w, const body* b, int freedom, double rate) {
  const link_state* l = b->link + b->owner[freedom];
  if (l->lower > l->upper) return 0;
  double least = (l->lower - l->position) / w->h, most = (l->upper - l->position) / w->h;
  double excess = rate < least ? rate - least : rate > most ? rate - most : 0;
  double mobility = b->inverse_mass[freedom * b->freedoms + freedom];
  return mobility > 0 ? -excess / mobility : 0;
}

/* The rate of a joint of one freedom. */
static double rate_of_joint(const body* b, int freedom) {
  int link = b->owner[freedom];
  const link_state *own = b->link + link, *above = b->link + own->parent;
  const double* axis = b->twist_w[freedom];
  double turn[3], at[3];
  if (own->joint == REVOLUTE) {
    for (int k = 0; k < 3; k++) turn[k] = own->motion[3 + k] - above->motion[3 + k];
    return dot(turn, axis);
  }
  velocity_at(b, own->parent, own->pose, at);
  for (int k = 0; k < 3; k++) at[k] = own->motion[k] - at[k];
  return dot(at, b->twist_v[freedom]);
}

/* Names a pair once whose e motors or limits of a body have changed by much: `impulse` of each freedom. */
static void name_changed(world* w, const body* b, const double* impulse, const char* what, const char* cure) {
  for (int i = 0; i < w->last.system.n; i++) {
    law* l = w->contacts[i].of;
    double change = 0, came = -w->last.rate[3 * i];
    if (w->last.impulse[3 * i] == 0 || l->pressed || !(came > HCB_HARD * w->h * w->contacts[i].weight)) continue;
    for (int k = 0; k < b->freedoms; k++) change += rate_by(w, i, b, k) * impulse[k];
    if (fabs(change) <= HCB_ANOTHER_E * came) continue;
    l->pressed = 1;
    fail(w, "restitution, law %d: %s of body %d changes e of an impact by %.2g within the step: %s", l->id, what, b->id,
         change / came, cure);
  }
}

/* Before the step: the stops that joints meet with their rates after the impacts. */
static void name_stops(world* w, const body* b, const double* change) {
  double* impulse = take(w, b->freedoms);
  int any = 0;
  memset(impulse, 0, b->freedoms * sizeof(double));
  for (int k = 0; k < b->freedoms && b->is_tree; k++) {
    if (b->owner[k] < 0 || b->link[b->owner[k]].joint > PRISMATIC) continue;
    impulse[k] = stop_of(w, b, k, rate_of_joint(b, k) + change[k]);
    any |= impulse[k] != 0;
  }
  if (any) name_changed(w, b, impulse, "a joint's limit", "it has no part in impacts");
}

/* After the step: what the motors have done in it. */
static void name_motors(world* w) {
  int bodies = w->last.tick == w->tick ? w->last.bodies : 0;
  for (int id = 0; id < bodies; id++) {
    const body* b = w->bodies[id];
    if (!b || !b->is_tree || w->last.part[id] < 0 || !w->last.struck[w->last.part[id]]) continue;
    double* impulse = take(w, b->freedoms);
    int any = 0;
    process(w, b3RequestActualStateCommandInit(w->client, id), w->state, sizeof(b3State));
    for (int k = 0; k < b->freedoms; k++) {
      int is_driven = b->owner[k] >= 0 && b->link[b->owner[k]].joint <= PRISMATIC;
      /* Bullet divides the impulse of a substep by the time of all. */
      impulse[k] = is_driven ? w->state->motor[b->owner[k]] * w->h * (w->substeps > 1 ? w->substeps : 1) : 0;
      any |= impulse[k] != 0;
    }
    if (any) name_changed(w, b, impulse, "a motor", "take a smaller force, or a shorter step");
  }
}
