/* Bodies of a client: masses, states, and what a force at a point of a link does to all of its body's freedoms.
   Bullet's own mass matrix and Jacobian are not used: they are wrong for spherical joints and for axes that are not
   unit vectors, and need link frames, which the client has in single precision. */

typedef struct {
  b3DynamicsInfo info;
  int parent, joint;
  double axis[3], pivot[3]; /* of its joint, in the frame of its centre of mass */
  double lower, upper, position; /* of a joint; lower > upper: no limits. Bullet tells of a later change only by all bodies */
  double pose[7], motion[6];     /* position, quaternion; velocity, angular velocity */
  int q_index;
} link_state;

typedef struct {
  int id, links, stale, freedoms, is_tree, placed; /* no freedoms: it cannot move; placed: its position matters */
  long tick;
  double last[7], moved[6]; /* of the base: its pose after the last step, and how far it moved and turned in it (carried.c) */
  int is_followed, has_moved, unannounced, is_carried; /* unannounced: steps in a row; is_carried: named for that */
  long met;      /* the tick of its first impact, 0 before, ... */
  double landed; /* ... and how deep it was then (depth.c) */
  link_state *base, *link; /* base = link - 1 */
  /* of a tree: each freedom's link, and its twist (angular velocity, velocity at the origin) */
  int* owner;
  double (*twist_w)[3], (*twist_v)[3], *inverse_mass, *falling;
} body;

enum { NUMBERS_ROOM = 1 << 22 }; /* bytes, for the numbers of a million bodies and constraints */

typedef struct { /* what one step pushed, for the substeps that come after */
  int body, link;
  double arm[3], force[3];
} pushed;

typedef struct block {
  struct block* next;
  size_t used, room;
  double data[];
} block;

typedef struct { /* impacts, until the next ones */
  hcb_system system;
  const double *rate, *impulse; /* before them; of them */
  const int *part, *place;      /* of each body: see `held_parts` */
  struct law** struck;          /* of each part: a law that struck it, or NULL */
  int bodies;
  long tick;
} last_impacts;

typedef struct {
  void *client, *server;
  b3Status* status;
  int* numbers; /* of all bodies and constraints */
  b3State* state;
  body** bodies;
  struct law* laws;
  pushed* pushes;
  block* memory;
  struct contact* contacts;
  int body_count, law_count, next_id, push_count, push_room, contact_room, is_substep, substeps, iterations, outdated, is_erp_less, has_carried;
  last_impacts last;
  long tick;
  double h, gravity[3], contact_erp;
  char message[1024];
} world;

static double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double* a, const double* b, double* out) {
  double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
  out[0] = x, out[1] = y, out[2] = z;
}

/* By a unit quaternion (x, y, z, w); by its inverse for way -1. */
static void rotate(const double* q, const double* v, int way, double* out) {
  double twice[3], again[3];
  cross(q, v, twice);
  for (int i = 0; i < 3; i++) twice[i] *= 2 * way;
  cross(q, twice, again);
  for (int i = 0; i < 3; i++) out[i] = v[i] + q[3] * twice[i] + way * again[i];
}

static void add_block(world* w, size_t room) {
  block* made = malloc(sizeof(block) + room * sizeof(double));
  *made = (block){w->memory, 0, room};
  w->memory = made;
}

static double* take(world* w, size_t count) { /* until the tick's end */
  if (!w->memory || w->memory->room - w->memory->used < count) add_block(w, count > 1 << 15 ? count : 1 << 15);
  w->memory->used += count;
  return w->memory->data + w->memory->used - count;
}

static int* take_ints(world* w, size_t count) { return (int*)take(w, count / 2 + 1); }

/* What a tick needed in several blocks, the next one has in one. */
static void free_taken(world* w) {
  size_t room = 0;
  while (w->memory && (w->memory->next || room)) {
    block* next = w->memory->next;
    room += w->memory->room;
    free(w->memory);
    w->memory = next;
  }
  if (room) add_block(w, room);
  if (w->memory) w->memory->used = 0;
}

static void* send(const world* w, void* command) { return b3SubmitClientCommandAndWaitStatus(w->client, command); }

/* Past Bullet's client, which would copy or ask for much more: the server's answer into w->status and `stream`. */
static void process(const world* w, void* command, void* stream, int room) {
  typedef unsigned char (*processor)(void*, const void*, void*, char*, int);
  (*(processor**)w->server)[PROCESS_COMMAND](w->server, command, w->status, stream, room);
}

/* The state of a body into w->state. */
static int request_state(world* w, const body* b) {
  void* command = b3RequestActualStateCommandInit(w->client, b->id);
  b3RequestActualStateCommandComputeLinkVelocity(command, b->links > 0);
  b3RequestActualStateCommandComputeForwardKinematics(command, b->links > 0);
  process(w, command, w->state, sizeof(b3State));
  return b3GetStatusType(w->status) == STATE_COMPLETED;
}

/* Room for what each freedom has; a body without joints needs little, so that many lie close together. */
static void make_room(body* b, const int* owner) {
  size_t n = b->freedoms;
  free(b->falling);
  b->falling = calloc(b->is_tree ? n * n + 8 * n + 1 : 6, sizeof(double));
  if (!b->is_tree) return;
  b->twist_w = (double(*)[3])(b->falling + n);
  b->twist_v = b->twist_w + n;
  b->inverse_mass = b->falling + 7 * n;
  b->owner = (int*)(b->inverse_mass + n * n);
  memcpy(b->owner, owner, n * sizeof(int));
}

/* Masses and joints. 0 if there is no such body, or one of more links than Bullet reports. */
static int read_body(world* w, body* b) {
  b3JointInfo joint;
  b->links = b3GetNumJoints(w->client, b->id);
  free(b->base);
  b->base = calloc(b->links + 1, sizeof(link_state));
  b->link = b->base + 1;
  b->is_tree = 0;
  for (int i = -1; i < b->links; i++) {
    link_state* l = b->link + i;
    double back[3];
    if (!b3GetDynamicsInfo(send(w, b3GetDynamicsInfoCommandInit(w->client, b->id, i)), &l->info)) return 0;
    /* Of bodies of maximal coordinates Bullet does not tell it: the memory is what the command before left there. */
    if (l->info.type != MULTI_BODY) l->info.processing_threshold = INFINITY;
    if (i < 0) continue;
    b3GetJointInfo(w->client, b->id, i, &joint);
    l->joint = joint.type;
    l->parent = joint.parent;
    l->lower = joint.lower;
    l->upper = joint.upper;
    l->q_index = joint.q_index;
    memcpy(l->axis, joint.axis, sizeof(l->axis));
    for (int k = 0; k < 3; k++) back[k] = -l->info.frame[k];
    rotate(l->info.frame + 3, back, -1, l->pivot);
    b->is_tree |= joint.type != FIXED || b->base->info.mass > 0;
  }
  int owner[DOFS + 6];
  b->freedoms = b->base->info.mass > 0 && !b->base->info.dynamic_type ? 6 : 0;
  for (int i = 0; i < 6; i++) owner[i] = -1;
  for (int i = 0; i < b->links && b->links < DOFS; i++) {
    int many = b->link[i].joint == FIXED ? 0 : b->link[i].joint < SPHERICAL ? 1 : 3;
    for (int k = 0; k < many && b->freedoms < DOFS + 6; k++) owner[b->freedoms++] = i;
  }
  make_room(b, owner);
  b->stale = 0;
  return b->links < DOFS;
}

/* A body by its id, read when it is first asked for and after its masses have changed; NULL if there is none. */
static body* body_of(world* w, int id) {
  if (id < 0) return NULL;
  while (id >= w->body_count) {
    w->bodies = realloc(w->bodies, (w->body_count + 1) * sizeof(body*));
    w->bodies[w->body_count++] = NULL;
  }
  if (!w->bodies[id]) {
    if (w->outdated) send(w, b3InitSyncBodyInfoCommand(w->client)); /* the client would keep the joints of another body */
    w->outdated = 0;
    send(w, b3InitRequestBodyInfoCommand(w->client, id));
    w->bodies[id] = calloc(1, sizeof(body));
    *w->bodies[id] = (body){.id = id, .stale = 1, .tick = -1};
  }
  return w->bodies[id]->stale && !read_body(w, w->bodies[id]) ? NULL : w->bodies[id];
}

static void forget_body(world* w, int id) {
  w->outdated = 1;
  if (id < 0 || id >= w->body_count || !w->bodies[id]) return;
  free(w->bodies[id]->base);
  free(w->bodies[id]->falling);
  free(w->bodies[id]);
  w->bodies[id] = NULL;
}

static int carries(const body* b, int owner, int link) {
  while (link > owner) link = b->link[link].parent; /* a parent has the smaller number */
  return link == owner || owner < 0;
}

static void set_twist(body* b, int k, const double* axis, const double* through, int turns) {
  memcpy(turns ? b->twist_w[k] : b->twist_v[k], axis, 3 * sizeof(double));
  if (turns) cross(through, axis, b->twist_v[k]);
  if (!turns) memset(b->twist_w[k], 0, 3 * sizeof(double));
}

static void set_twists(body* b) {
  static const double unit[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  int k = 0;
  for (; k < b->freedoms && b->owner[k] < 0; k++) set_twist(b, k, unit[k % 3], b->base->pose, k < 3);
  while (k < b->freedoms) {
    const link_state* l = b->link + b->owner[k];
    double where[3], axis[3];
    rotate(l->pose + 3, l->pivot, 1, where);
    for (int i = 0; i < 3; i++) where[i] += l->pose[i];
    rotate(l->pose + 3, l->axis, 1, axis);
    if (l->joint < SPHERICAL) {
      set_twist(b, k++, axis, where, l->joint == REVOLUTE);
    } else {
      for (int i = 0; i < 3; i++) set_twist(b, k++, unit[i], where, 1);
    }
  }
}

/* The inverse of a symmetric positive matrix in its place; a freedom without inertia does not move. */
static void invert(double* a, int n) {
  for (int k = 0; k < n; k++) {
    double pivot = a[k * n + k] > 0 ? 1 / a[k * n + k] : 0;
    a[k * n + k] = 1;
    for (int j = 0; j < n; j++) a[k * n + j] *= pivot;
    for (int i = 0; i < n; i++) {
      if (i == k) continue;
      double factor = a[i * n + k];
      a[i * n + k] = 0;
      for (int j = 0; j < n; j++) a[i * n + j] -= factor * a[k * n + j];
    }
  }
}

/* M = sum of m Jv^T Jv + Jw^T I Jw over the links, inverted, and what gravity does. */
static void read_tree(world* w, body* b) {
  int n = b->freedoms;
  double force[DOFS + 6] = {0}, J[DOFS + 6][6];
  set_twists(b);
  memset(b->inverse_mass, 0, (size_t)n * n * sizeof(double));
  for (int l = -1; l < b->links; l++) {
    const link_state* one = b->link + l;
    for (int k = 0; k < n; k++) {
      memset(J[k], 0, sizeof(J[k]));
      if (!carries(b, b->owner[k], l)) continue;
      cross(b->twist_w[k], one->pose, J[k]);
      for (int i = 0; i < 3; i++) J[k][i] += b->twist_v[k][i];
      rotate(one->pose + 3, b->twist_w[k], -1, J[k] + 3);
      force[k] += one->info.mass * dot(J[k], w->gravity);
      for (int j = 0; j <= k; j++) {
        double sum = one->info.mass * dot(J[j], J[k]);
        for (int i = 0; i < 3; i++) sum += one->info.inertia[i] * J[j][3 + i] * J[k][3 + i];
        b->inverse_mass[k * n + j] += sum;
        if (j != k) b->inverse_mass[j * n + k] += sum;
      }
    }
  }
  invert(b->inverse_mass, n);
  for (int k = 0; k < n; k++) {
    b->falling[k] = 0;
    for (int j = 0; j < n; j++) b->falling[k] += b->inverse_mass[k * n + j] * force[j];
  }
}

/* A body with its state at this tick; NULL if it is gone. */
static body* refreshed(world* w, int id) {
  body* b = body_of(w, id);
  int is_still = b && b->freedoms == 0 && b->base->info.type != MULTI_BODY; /* whatever velocity it is given, Bullet heeds none */
  if (!b || b->tick == w->tick || (is_still && !b->placed)) return b;
  if (!request_state(w, b)) return NULL;
  memcpy(b->base->pose, w->state->q, sizeof(b->base->pose));
  memcpy(b->base->motion, w->state->qdot, sizeof(b->base->motion));
  if (is_still) memset(b->base->motion, 0, sizeof(b->base->motion));
  for (int i = 0; i < b->links; i++) {
    memcpy(b->link[i].pose, w->state->link[i], sizeof(b->base->pose));
    memcpy(b->link[i].motion, w->state->velocity[i], sizeof(b->base->motion));
    if (b->link[i].joint <= PRISMATIC) b->link[i].position = w->state->q[b->link[i].q_index];
  }
  if (b->is_tree) read_tree(w, b);
  if (!b->is_tree) memcpy(b->falling, w->gravity, sizeof(w->gravity));
  b->tick = w->tick;
  return b;
}

static void velocity_at(const body* b, int link, const double* point, double* out) {
  const link_state* l = b->link + link;
  double arm[3] = {point[0] - l->pose[0], point[1] - l->pose[1], point[2] - l->pose[2]};
  cross(l->motion + 3, arm, out);
  for (int i = 0; i < 3; i++) out[i] += l->motion[i];
}

/* The row of the Jacobian of a link's rate along a force on its centre of mass and a torque, times `sign`; and M^-1 times
   it. */
static void make_row(const body* b, int link, const double* force, const double* torque, double sign, double* row,
                     double* solved) {
  const link_state* l = b->link + link;
  int n = b->freedoms;
  double moment[3];
  if (!b->is_tree && n) {
    rotate(l->pose + 3, torque, -1, row + 3);
    for (int i = 0; i < 3; i++) {
      row[i] = sign * force[i];
      row[3 + i] *= sign;
      solved[i] = row[i] / l->info.mass;
      solved[3 + i] = l->info.inertia[i] > 0 ? row[3 + i] / l->info.inertia[i] : 0;
    }
    return;
  }
  cross(l->pose, force, moment);
  for (int i = 0; i < 3; i++) moment[i] += torque[i];
  for (int k = 0; k < n; k++) {
    double rate = dot(b->twist_v[k], force) + dot(b->twist_w[k], moment);
    row[k] = carries(b, b->owner[k], link) ? sign * rate : 0;
  }
  for (int k = 0; k < n; k++) {
    solved[k] = 0;
    for (int j = 0; j < n; j++) solved[k] += b->inverse_mass[k * n + j] * row[j];
  }
}

/* The same for the rate of a point along a direction. */
static void make_point_row(const body* b, int link, const double* point, const double* direction, double sign, double* row,
                           double* solved) {
  const double* centre = b->link[link].pose;
  double moment[3], arm[3] = {point[0] - centre[0], point[1] - centre[1], point[2] - centre[2]};
  cross(arm, direction, moment);
  make_row(b, link, direction, moment, sign, row, solved);
}
