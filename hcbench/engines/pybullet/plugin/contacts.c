/* Pairs that a law is for, where they touch, and what a force there does. */

#define HCB_ROUNDING 1e-12 /* of the inverse of a mass */

enum { CUP = 100, ANY = -2 }; /* a shape, beside SPHERE and PLANE; any link */

typedef struct law {
  int id, is_force, body[2], link[2]; /* link -2: any */
  hcb_law motion;                     /* of a force law, but for the mass; kappa: the stiffness */
  hcb_contact impact;                 /* of a restitution law */
  double friction, dynamic_friction, slip_speed; /* friction below 0: the product of the bodies' own */
  /* What was named: a fast body, an overlap lifted, a constraint, a motor or limit, deep impacts, what sinks. */
  int warned, lifted, held, pressed, deep, sunk;
  double landed;               /* how deep the pair was in its first impact, or was named to be (depth.c) */
  double depth[2], approach[2]; /* of the pair in the last two ticks in which it was seen */
  long seen_at[2], met, hit;    /* those ticks; that of its first impact, 0 before, and of its last one */
  char text[1024];                    /* of the command that added it */
  int shape[2];                       /* SPHERE, PLANE, BOX or CUP where the distance is worked out here, else 0 */
  double radius[2], axis[3], size[2]; /* axis: a plane's normal, a box's half sizes, a cup's centre */
  double force;                       /* normal force of the last step, N */
  long seen;                          /* the last tick with a contact, of a force law; ... */
  int is_new, is_one, is_late;        /* ... none in the tick before; one only; first seen when it overlapped */
  double ahead;                       /* see hcb_late_force */
} law;

typedef struct contact {
  law* of;
  body* body[2];
  int link[2];
  double at[3], frame[3][3], distance, rate[3]; /* the normal points at the first body; rate > 0 parts */
  double *row[2][3], *solved[2][3], inverse_mass, fall, weight;
} contact;

static double sign_of(int side) { return side ? -1 : 1; }

static int moves(const contact* c, int side) { return c->body[side]->freedoms > 0; }

/* Relative acceleration along one row by a unit force along another, 1/kg. */
static double coupling(const contact* a, int i, const contact* b, int j) {
  double sum = 0;
  for (int s = 0; s < 4; s++) {
    if (a->body[s / 2] != b->body[s % 2]) continue;
    const double *row = a->row[s / 2][i], *solved = b->solved[s % 2][j];
    for (int k = 0; k < a->body[s / 2]->freedoms; k++) sum += row[k] * solved[k];
  }
  return sum;
}

static void add_rows(world* w, contact* c, int first, int count) {
  for (int side = 0; side < 2; side++) {
    int n = c->body[side]->freedoms;
    for (int k = first; k < first + count; k++) {
      c->row[side][k] = take(w, 2 * (size_t)n);
      c->solved[side][k] = c->row[side][k] + n;
      double *row = c->row[side][k], *solved = c->solved[side][k];
      make_point_row(c->body[side], c->link[side], c->at, c->frame[k], sign_of(side), row, solved);
    }
  }
}

/* Acceleration by gravity against the direction of a row. */
static double falling(const contact* c, int k) {
  double sum = 0;
  for (int side = 0; side < 2; side++) {
    for (int j = 0; j < c->body[side]->freedoms; j++) sum -= c->row[side][k][j] * c->body[side]->falling[j];
  }
  return sum;
}

/* Rates along the normal and two tangents, the normal's row, and what gravity does. */
static void complete(world* w, contact* c) {
  double *n = c->frame[0], *t = c->frame[1], slip[3] = {0, 0, 0}, size;
  int axis = fabs(n[0]) < 0.6 ? 0 : 1;
  for (int i = 0; i < 3; i++) t[i] = (i == axis) - n[axis] * n[i];
  size = sqrt(dot(t, t));
  for (int i = 0; i < 3; i++) t[i] /= size;
  cross(n, t, c->frame[2]);
  c->weight = 0;
  add_rows(w, c, 0, 1);
  for (int side = 0; side < 2; side++) {
    double v[3];
    velocity_at(c->body[side], c->link[side], c->at, v);
    for (int i = 0; i < 3; i++) slip[i] += sign_of(side) * v[i];
    if (moves(c, side)) c->weight = fmax(c->weight, -sign_of(side) * dot(w->gravity, n));
  }
  for (int k = 0; k < 3; k++) c->rate[k] = dot(slip, c->frame[k]);
  c->fall = falling(c, 0);
  c->inverse_mass = coupling(c, 0, c, 0);
}

static double friction_of(const contact* c) {
  double own = c->body[0]->link[c->link[0]].info.friction * c->body[1]->link[c->link[1]].info.friction;
  return c->of->friction >= 0 ? c->of->friction : own;
}

static void apply(const world* w, int id, int link, const double* force, const double* point) {
  void* command = b3ApplyExternalForceCommandInit(w->client);
  b3ApplyExternalForce(command, id, link, force, point, WORLD_FRAME);
  send(w, command);
}

/* A force for the (sub)step that comes next. */
static void push(world* w, const body* b, int link, const double* point, const double* force) {
  if (b->freedoms == 0) return;
  apply(w, b->id, link, force, point);
  if (w->substeps < 2) return;
  if (w->push_count == w->push_room) {
    w->push_room = 2 * w->push_room + 16;
    w->pushes = realloc(w->pushes, w->push_room * sizeof(pushed));
  }
  pushed* made = w->pushes + w->push_count++;
  *made = (pushed){.body = b->id, .link = link};
  for (int i = 0; i < 3; i++) made->arm[i] = point[i] - b->link[link].pose[i];
  memcpy(made->force, force, sizeof(made->force));
}

/* Bullet keeps external forces over all substeps of a step: take back those of the substep before. */
static void take_back(world* w) {
  for (int k = 0; k < w->push_count && w->is_substep; k++) {
    const pushed* p = w->pushes + k;
    const body* b = refreshed(w, p->body);
    double point[3], back[3];
    for (int i = 0; b && i < 3; i++) {
      point[i] = b->link[p->link].pose[i] + p->arm[i];
      back[i] = -p->force[i];
    }
    if (b) apply(w, p->body, p->link, back, point);
  }
  w->push_count = 0;
}

/* A force on the first body, and its opposite on the second. */
static void push_both(world* w, const contact* c, const double* force) {
  double back[3] = {-force[0], -force[1], -force[2]};
  push(w, c->body[0], c->link[0], c->at, force);
  push(w, c->body[1], c->link[1], c->at, back);
}

static contact* room_for(world* w, int count) {
  if (count > w->contact_room) {
    w->contact_room = 2 * count;
    w->contacts = realloc(w->contacts, w->contact_room * sizeof(contact));
  }
  return w->contacts;
}

/* Across the axes of their joints two bodies move by rounding alone, which a force would divide by. */
static int can_part(const contact* c) {
  double lightest = INFINITY;
  for (int side = 0; side < 2; side++) {
    double mass = c->body[side]->link[c->link[side]].info.mass;
    if (moves(c, side) && mass > 0) lightest = fmin(lightest, mass);
  }
  return c->inverse_mass * lightest > HCB_ROUNDING;
}

/* Of a point that Bullet or `exact_point` found; forces act in one place, on the surface of the body that moves. */
static int set_contact(world* w, law* of, const b3Contact* p, contact* c) {
  c->of = of;
  c->distance = p->distance;
  memcpy(c->frame[0], p->normal, sizeof(p->normal));
  for (int side = 0; side < 2; side++) {
    c->link[side] = p->link[side];
    if (!(c->body[side] = refreshed(w, p->body[side]))) return 0;
  }
  double share = moves(c, 0) ? moves(c, 1) ? 0.5 : 1 : 0;
  for (int i = 0; i < 3; i++) c->at[i] = share * p->on[0][i] + (1 - share) * p->on[1][i];
  complete(w, c);
  return isfinite(c->distance) && isfinite(c->rate[0]) && can_part(c);
}

/* The unit vector out of a box with half sizes `size` to a point in its frame; the distance, below 0 inside. */
static double way_out(const double* size, const double* at, double* n) {
  double inside = -INFINITY, square = 0;
  int axis = 0;
  for (int i = 0; i < 3; i++) {
    double over = fabs(at[i]) - size[i];
    if (over > inside) inside = over, axis = i;
    n[i] = copysign(fmax(0, over), at[i]);
    square += n[i] * n[i];
  }
  for (int i = 0; i < 3; i++) n[i] = square > 0 ? n[i] / sqrt(square) : i == axis ? copysign(1, at[i]) : 0;
  return square > 0 ? sqrt(square) : inside;
}

/* Distance, points and normal of a sphere and a plane, a box, a sphere, or the cup that it lies in. */
static int exact_point(world* w, const law* l, b3Contact* p) {
  int ball = l->shape[0] == SPHERE ? 0 : 1, other = !ball;
  const body* b[2];
  for (int side = 0; side < 2; side++) {
    p->body[side] = l->body[side];
    p->link[side] = l->link[side];
    if (!(b[side] = refreshed(w, l->body[side]))) return 0;
  }
  const double *at = b[ball]->link[l->link[ball]].pose, *pose = b[other]->link[l->link[other]].pose;
  double away[3], n[3], distance, size;
  for (int i = 0; i < 3; i++) away[i] = at[i] - pose[i];
  rotate(pose + 3, away, -1, away);
  if (l->shape[other] == PLANE) {
    memcpy(n, l->axis, sizeof(n));
    distance = dot(away, n);
  } else if (l->shape[other] == BOX) {
    distance = way_out(l->axis, away, n);
  } else {
    int inside = l->shape[other] == CUP ? -1 : 1;
    for (int i = 0; i < 3 && inside < 0; i++) away[i] -= l->axis[i];
    size = sqrt(dot(away, away));
    distance = inside * (size - l->radius[other]);
    for (int i = 0; i < 3; i++) n[i] = size > 0 ? inside * away[i] / size : i == 2;
  }
  rotate(pose + 3, n, 1, n);
  p->distance = distance - l->radius[ball];
  for (int i = 0; i < 3; i++) {
    p->normal[i] = ball ? -n[i] : n[i];
    p->on[ball][i] = at[i] - l->radius[ball] * n[i];
    p->on[other][i] = at[i] - distance * n[i];
  }
  return 1;
}
