/* Pairs that overlap by more than when they first met, as on Bullet's own contact: they land once more, deeper, as Bullet sees many
   shapes only once they overlap; or they sink, as Bullet's solver stops before it has stopped them. */

#define HCB_DEEPER 1e-3 /* m: more is named */
#define HCB_SOLVES 200  /* of Bullet's iterations, with which stacks of bodies of like mass stand */
#define HCB_JUMP 4      /* steps of falling: what rests sinks by less in a step */

/* How deep a pair was in the last tick; below all where it was not seen then. */
static double depth_before(const world* w, law* l, double depth) {
  if (l->seen_at[1] != w->tick) {
    l->seen_at[0] = l->seen_at[1], l->depth[0] = l->depth[1];
    l->seen_at[1] = w->tick, l->depth[1] = depth;
  }
  l->depth[1] = fmax(l->depth[1], depth);
  return l->seen_at[0] == w->tick - 1 ? l->depth[0] : -INFINITY;
}

/* Keeps how deep a pair lands, and names it once where it is deeper than it landed before. */
static void name_deeper(world* w, const contact* c, int collides) {
  law* l = c->of;
  double depth = -c->distance, before = depth_before(w, l, depth), deepest = l->landed;
  int is_put = depth - before > HCB_JUMP * w->h * w->h * sqrt(dot(w->gravity, w->gravity)); /* there by a script */
  if (collides && !l->met) l->met = w->tick;
  if (collides || is_put) l->landed = fmax(deepest, depth);
  if (l->met == w->tick || depth <= deepest + HCB_DEEPER) return;
  if (collides && !l->deep++) {
    fail(w, "restitution, law %d: bodies %d and %d meet %.2g mm deep, as Bullet sees their shapes only once they overlap: take a step of %.1g s",
         l->id, c->body[0]->id, c->body[1]->id, 1e3 * depth, w->h * HCB_DEEPER / depth);
  }
  if (!collides && !is_put && !l->sunk++) {
    fail(w, "restitution, law %d: bodies %d and %d sink into each other, now by %.2g mm, as Bullet's solver stops after %d iterations: set "
         "numSolverIterations=%d, more numSubSteps, or a shorter step", l->id, c->body[0]->id, c->body[1]->id, 1e3 * depth, w->iterations,
         HCB_SOLVES);
  }
}
