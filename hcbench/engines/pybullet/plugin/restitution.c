/* restitution: impacts are worked out from the velocities at the start of the (sub)step, all at once (impacts.c), and
   enter as forces over it. Bullet's own contact, with its restitution 0, then lets rest what is left without approach.

   Bullet stops what would touch within the step, before it touches, so that is when it collides here: a contact at a
   distance d that approaches faster than d/h, gravity of the step included. */

#define HCB_STILL 1.1 /* steps of falling whose speed counts as rest */
#define HCB_NEAR 4    /* contacts farther than so many steps of the fastest one have no part in what happens */

static law* law_of(const world* w, const b3Contact* p) {
  for (int i = 0; i < w->law_count; i++) {
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
  for (int i = 0; i < found.count; i++) {
    law* l = law_of(w, found.points + i);
    if (l && !l->shape[0]) count = add_contact(w, l, found.points + i, count);
  }
  return count;
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
    hcb_contact* impact = laws + *near;
    *impact = c->of->impact;
    impact->friction = friction_of(c);
    impact->still = HCB_STILL * w->h * c->weight + 1e-9;
    hcb_under_gravity(impact, -c->distance, -c->rate[0], c->fall, w->h, 0);
    impact->still = fmax(impact->still, d - w->h * c->fall / 2);
    busy |= w->h * c->fall / 2 - c->rate[0] > impact->still;
    w->contacts[(*near)++] = *c;
  }
  return busy;
}

static void add_impacts(world* w) {
  int n = 0, count = find_contacts(w);
  if (count == 0) return;
  hcb_contact* c = (hcb_contact*)take(w, (size_t)count * sizeof(hcb_contact) / sizeof(double) + 1);
  if (!sort_out(w, count, c, &n)) return;
  size_t rows = 3 * (size_t)n;
  double *G = take(w, rows * rows), *u = take(w, rows), *p = take(w, rows), *work = take(w, hcb_impacts_work(n));
  contact* all = w->contacts;
  for (int i = 0; i < n; i++) add_rows(w, all + i, 1, 2);
  for (size_t i = 0; i < rows; i++) {
    u[i] = all[i / 3].rate[i % 3] - w->h / 2 * falling(all + i / 3, i % 3);
    for (size_t j = 0; j <= i; j++) {
      G[i * rows + j] = G[j * rows + i] = coupling(all + i / 3, i % 3, all + j / 3, j % 3);
    }
  }
  hcb_impacts(n, G, c, u, p, work);
  for (int i = 0; i < n; i++) {
    double force[3] = {0, 0, 0};
    if (p[3 * i] == 0) continue;
    for (int k = 0; k < 9; k++) force[k % 3] += p[3 * i + k / 3] / w->h * all[i].frame[k / 3][k % 3];
    push_both(w, all + i, force);
    all[i].of->force += p[3 * i] / w->h;
  }
}
