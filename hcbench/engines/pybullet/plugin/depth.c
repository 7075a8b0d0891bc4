/* Pairs that overlap by more than in their first impact, as on Bullet's own contact: they land once more, deeper, as Bullet sees many
   shapes only once they overlap; or they sink, as Bullet's solver stops before it has stopped them. */

#define HCB_DEEPER 1e-3 /* m: more is named */
#define HCB_SOLVES 200  /* of Bullet's iterations, with which stacks of bodies of like mass stand */
#define HCB_JUMP 4      /* steps of falling: what moves further into another body was put there by a script */

/* Keeps how deep a pair is in this tick and how fast it approaches. */
static void follow_depth(const world* w, const contact* c) {
  law* l = c->of;
  double approach = fmax(0, -c->rate[0]);
  int is_new = l->seen_at[1] != w->tick;
  if (is_new) l->seen_at[0] = l->seen_at[1], l->depth[0] = l->depth[1], l->approach[0] = l->approach[1];
  l->seen_at[1] = w->tick;
  l->depth[1] = is_new ? -c->distance : fmax(l->depth[1], -c->distance);
  l->approach[1] = is_new ? approach : fmax(l->approach[1], approach);
}

/* How deep a pair may be in its first impact: as it is where its bodies have theirs, too, as on Bullet's own contact; or as those that
   have had one were in that. */
static double first_landing(const world* w, const contact* c) {
  double depth = fmax(0, -c->distance), most = 0;
  int has_met = 0;
  for (int side = 0; side < 2; side++) {
    body* b = w->bodies[c->body[side]->id];
    if (!b->freedoms) continue;
    if (!b->met) b->met = w->tick;
    if (b->met == w->tick) b->landed = fmax(b->landed, depth);
    if (b->met == w->tick) continue;
    has_met = 1;
    most = fmax(most, b->landed);
  }
  return has_met ? most : depth;
}

/* Names a pair once that lands deeper, and once that sinks. collides: whether the contact has an impact in this step. */
static void name_deeper(world* w, const contact* c, int collides) {
  law* l = c->of;
  double depth = -c->distance, falls = w->h * w->h * sqrt(dot(w->gravity, w->gravity));
  follow_depth(w, c);
  int is_put = l->seen_at[0] != w->tick - 1 || depth > l->depth[0] + w->h * l->approach[0] + HCB_JUMP * falls;
  if (collides) l->hit = w->tick;
  if (collides && !l->met) l->met = w->tick;
  if (collides && l->met == w->tick) l->landed = fmax(l->landed, first_landing(w, c));
  if (is_put && !collides) l->landed = fmax(l->landed, depth);
  if (depth <= l->landed + HCB_DEEPER) return;
  l->landed = depth;
  if (l->hit && l->hit >= w->tick - 1) {
    if (!l->deep++) {
      fail(w, "restitution, law %d: bodies %d and %d meet %.2g mm deep, as Bullet sees their shapes only once they overlap: take a step of"
           " %.1g s", l->id, c->body[0]->id, c->body[1]->id, 1e3 * depth, w->h * HCB_DEEPER / depth);
    }
  } else if (!l->sunk++) {
    fail(w, "restitution, law %d: bodies %d and %d sink into each other, now by %.2g mm, as Bullet's solver stops after %d iterations: set "
         "numSolverIterations=%d, more numSubSteps, or a shorter step", l->id, c->body[0]->id, c->body[1]->id, 1e3 * depth, w->iterations,
         HCB_SOLVES);
  }
}

/* What constraints hold together meets together, as links of one body do: from then on the others land as deep as the first. */
static void meet_together(world* w, const held_parts* t) {
  for (int i = 0; i < w->body_count; i++) {
    const body* first = w->bodies[i];
    if (!first || first->met != w->tick || t->part[i] < 0) continue;
    for (int k = 0; k < w->body_count; k++) {
      body* other = w->bodies[k];
      if (other && !other->met && t->part[k] == t->part[i]) other->met = w->tick, other->landed = first->landed;
    }
  }
}
