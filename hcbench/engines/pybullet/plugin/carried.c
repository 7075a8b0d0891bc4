/* Bases that no force moves, of mass 0 or fixed, which a script moves. Bullet meets them by the velocity that resetBaseVelocity gave
   them, which moves them, too. One that is put elsewhere before each step has none: what lies on it would sink into it. */

#define HCB_UNANNOUNCED 3 /* steps in a row without that velocity: in one a script puts up a scene, and in two it turns a body around */
#define HCB_MOVED 1e-9    /* m or rad a step: less is rounding */

static int has_fixed_base(const body* b) { return !(b->base->info.mass > 0) || b->base->info.dynamic_type; }

static int has_moved(const double* way) { return dot(way, way) > HCB_MOVED * HCB_MOVED; }

/* After a step, from Bullet's own word: how far a fixed base has moved and turned since the step before. */
static void follow_base(world* w, body* b, const double* pose) {
  const double *now = pose + 3, *before = b->last + 3;
  double turned[3], sign = dot(now, before) + now[3] * before[3] < 0 ? -1 : 1; /* q and -q are one attitude */
  cross(now, before, turned);
  for (int i = 0; i < 3; i++) {
    b->moved[i] = b->is_followed ? pose[i] - b->last[i] : 0;
    b->moved[3 + i] = b->is_followed ? 2 * sign * (before[3] * now[i] - now[3] * before[i] - turned[i]) : 0;
  }
  memcpy(b->last, pose, sizeof(b->last));
  b->is_followed = 1;
  b->has_moved = has_moved(b->moved) || has_moved(b->moved + 3);
  if (!b->has_moved) b->unannounced = 0;
  w->has_carried |= b->has_moved;
}

/* Whether a way of a step is not that of the velocity. */
static int is_unannounced(const world* w, const double* way, const double* velocity) {
  double step = w->h * (w->substeps > 1 ? w->substeps : 1), missing[3];
  for (int i = 0; i < 3; i++) missing[i] = way[i] - step * velocity[i];
  return has_moved(way) && dot(missing, missing) > 0.25 * dot(way, way);
}

/* Before a step: in how many steps until now each fixed base has moved without its velocity. */
static void count_unannounced(world* w) {
  for (int id = 0; id < w->body_count && w->has_carried; id++) {
    const body* b = w->bodies[id] && w->bodies[id]->has_moved ? refreshed(w, id) : NULL;
    if (!b) continue;
    const double* v = b->base->motion;
    int is_without = is_unannounced(w, b->moved, v) || is_unannounced(w, b->moved + 3, v + 3);
    w->bodies[id]->unannounced = is_without ? b->unannounced + 1 : 0;
    w->bodies[id]->has_moved = 0;
  }
  w->has_carried = 0;
}

/* Names a body once that is moved so and has reached a contact. */
static void name_carried(world* w, const contact* c) {
  for (int side = 0; side < 2; side++) {
    body* b = w->bodies[c->body[side]->id];
    if (b->unannounced < HCB_UNANNOUNCED || b->is_carried || c->distance > sqrt(dot(b->moved, b->moved))) continue;
    b->is_carried = 1;
    fail(w, "%s, law %d: a script moves body %d, which has no such velocity, so what it meets bounces as if it stood, and sinks into it: "
         "%sset its velocity by resetBaseVelocity before each step, which moves it, too",
         c->of->is_force ? "hunt_crossley" : "restitution", c->of->id, b->id,
         b->base->info.type == MULTI_BODY ? "" : "create it without useMaximalCoordinates, and ");
  }
}
