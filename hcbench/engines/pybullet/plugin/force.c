/* hunt_crossley: each contact gets the force that carries it along the law's motion over the step. Bullet's own
   contact of the pair is off. */

#define HCB_COARSE 1.0 /* (omega h)^2 beyond which a step is too coarse */

/* How far a link's surface can move in a step, m. */
static double travel(world* w, const law* l, int side) {
  const body* b = refreshed(w, l->body[side]);
  double fastest = 0, fall = b && b->freedoms ? w->h * w->h * sqrt(dot(w->gravity, w->gravity)) : 0;
  for (int i = -1; b && i < b->links; i++) {
    const double* m = b->link[i].motion;
    if (l->link[side] != ANY && l->link[side] != i) continue;
    fastest = fmax(fastest, sqrt(dot(m, m)) + l->size[side] * sqrt(dot(m + 3, m + 3)));
  }
  return 1.01 * (w->h * fastest + fall) + 1e-9;
}

/* Contacts of one law into w->contacts, from a step before touch on; how many there are then. */
static int find_touches(world* w, law* l, int count) {
  b3Contact exact;
  b3Contacts found = {1, &exact};
  if (l->shape[0]) {
    if (!exact_point(w, l, &exact)) return count;
  } else {
    double reach = travel(w, l, 0) + travel(w, l, 1); /* before the query: there is one command at a time */
    void* query = b3InitClosestDistanceQuery(w->client);
    b3SetClosestDistanceFilterBodyA(query, l->body[0]);
    b3SetClosestDistanceFilterBodyB(query, l->body[1]);
    if (l->link[0] != ANY) b3SetClosestDistanceFilterLinkA(query, l->link[0]);
    if (l->link[1] != ANY) b3SetClosestDistanceFilterLinkB(query, l->link[1]);
    b3SetClosestDistanceThreshold(query, reach);
    send(w, query);
    b3GetContactPointInformation(w->client, &found);
  }
  for (int i = 0; i < found.count; i++) {
    contact* c = room_for(w, count + 1) + count;
    int is_sound = set_contact(w, l, found.points + i, c);
    if (is_sound) name_carried(w, c);
    count += is_sound;
  }
  l->is_new = l->seen != w->tick - 1; /* Bullet sees some meshes once they overlap */
  l->is_one = found.count == 1;
  if (found.count) l->seen = w->tick;
  return count;
}

static hcb_law motion_of(const contact* c) {
  hcb_law motion = c->of->motion;
  motion.kappa *= c->inverse_mass;
  motion.b = c->fall;
  if (motion.chi != 0) motion.load = c->fall;
  if (motion.chi != 0 && c->distance < 0) set_touch_speed(&motion, -c->distance, -c->rate[0]);
  return motion;
}

/* What the other contacts do to the approach of each, to first order, enters as an acceleration. Only those of the same
   bodies do: each body that can move has a list of its contacts, in ascending order. */
static void couple(world* w, contact* all, int count, hcb_law* motions, double* plain) {
  int *head = take_ints(w, w->body_count), *next = take_ints(w, 2 * (size_t)count);
  for (int k = 0; k < w->body_count; k++) head[k] = -1;
  for (int i = count - 1; i >= 0; i--) {
    hcb_law own = motions[i];
    own.b = 0;
    plain[i] = -acceleration(&own, -all[i].distance, -all[i].rate[0]) / all[i].inverse_mass;
    for (int s = 0; s < 2; s++) {
      if (!moves(all + i, s)) continue;
      next[2 * i + s] = head[all[i].body[s]->id];
      head[all[i].body[s]->id] = 2 * i + s;
    }
  }
  for (int i = 0; i < count; i++) {
    int list[2];
    for (int s = 0; s < 2; s++) list[s] = moves(all + i, s) ? head[all[i].body[s]->id] : -1;
    while (list[0] >= 0 || list[1] >= 0) {
      int a = list[0] >= 0 ? list[0] / 2 : count, b = list[1] >= 0 ? list[1] / 2 : count, j = a < b ? a : b;
      while (list[0] >= 0 && list[0] / 2 == j) list[0] = next[list[0]];
      while (list[1] >= 0 && list[1] / 2 == j) list[1] = next[list[1]];
      if (i != j && plain[j] != 0) motions[i].b -= coupling(all + i, 0, all + j, 0) * plain[j];
    }
  }
}

/* Coulomb's friction against the slip; a step can stop the slip, never turn it around. */
static double drag_of(world* w, contact* c, double slip, double force) {
  const law* l = c->of;
  double still = friction_of(c), sliding = l->dynamic_friction >= 0 ? l->dynamic_friction : still, along[3];
  if (slip == 0 || still == 0) return 0;
  for (int i = 0; i < 3; i++) along[i] = (c->rate[1] * c->frame[1][i] + c->rate[2] * c->frame[2][i]) / slip;
  memcpy(c->frame[1], along, sizeof(along));
  add_rows(w, c, 1, 1);
  double most = slip / (w->h * coupling(c, 1, c, 1));
  return fmin(hcb_friction(still, sliding, l->slip_speed, slip) * force, most);
}

static void add_force(world* w, contact* c, const hcb_law* motion) {
  double x = -c->distance, v = -c->rate[0], slip = hypot(c->rate[1], c->rate[2]);
  if (w->h * w->h * frequency_squared(motion, fmax(x, x + w->h * v)) > HCB_COARSE && !c->of->warned) {
    c->of->warned = 1;
    fprintf(stderr, "hcbench: hunt_crossley, law %d: the step of %g s is too coarse for this contact; take a shorter"
            " one, or the law restitution\n", c->of->id, w->h);
  }
  law* l = c->of;
  int starts = l->is_one && l->is_new && x > 0 && x <= w->h * v;
  double ahead = l->ahead, force, vector[3];
  l->ahead = 0;
  l->is_late = l->is_one && (l->is_new ? starts : l->is_late);
  force = starts ? hcb_late_force(motion, w->h, x, v, &l->ahead)
                 : hcb_euler_force(motion, w->h, x, v, l->is_late ? &ahead : NULL);
  force /= c->inverse_mass;
  if (!(force > 0)) return;
  double drag = drag_of(w, c, slip, force);
  for (int i = 0; i < 3; i++) vector[i] = force * c->frame[0][i] - drag * c->frame[1][i];
  push_both(w, c, vector);
  c->of->force += force;
}

static void add_forces(world* w) {
  int count = 0;
  for (int i = 0; i < w->law_count; i++) {
    if (w->laws[i].is_force) count = find_touches(w, w->laws + i, count);
  }
  if (count == 0) return;
  hcb_law* motions = (hcb_law*)take(w, (size_t)count * (sizeof(hcb_law) / sizeof(double)));
  for (int i = 0; i < count; i++) motions[i] = motion_of(w->contacts + i);
  if (count > 1) couple(w, w->contacts, count, motions, take(w, count));
  for (int i = 0; i < count; i++) add_force(w, w->contacts + i, motions + i);
}
