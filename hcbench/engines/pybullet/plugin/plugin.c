/* A plug-in of Bullet's own kind, for any script:

     plugin = pybullet.loadPlugin(path)
     pybullet.executePluginCommand(plugin, "hunt_crossley stiffness=3.4e10 alpha=0.315", [ball, -1, plate, -1])
     pybullet.executePluginCommand(plugin, "restitution alpha=0.315", [ball, -1, plate, -1])

   returns the law's number, or -1 with a message on stderr; docs/reference/plugins.md lists the commands and their keys. Laws act
   before each (sub)step, by external forces; each client has its own. resetSimulation ends them all, as ids mean other
   bodies then. Text, because Bullet hands numbers over in single precision. Never unload: Bullet's next loadPlugin
   would crash; `remove` ends a law. */

#include "bullet.c"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../../laws/friction.c"
#include "../../../laws/impacts.c"
#include "../../../laws/published.c"

#include "bodies.c"
#include "contacts.c"

#include "options.c"

#include "carried.c"
#include "force.c"
#include "inertia.c"
#include "held.c"
#include "motors.c"
#include "depth.c"
#include "restitution.c"

/* A single sphere, plane or box in the middle of its link: what `exact_point` can do. */
static int simple_shape(world* w, law* l, int side) {
  b3Shapes found = {0, NULL};
  /* Bullet tells the shapes of no others. */
  if (l->link[side] == ANY || body_of(w, l->body[side])->base->info.type != MULTI_BODY) return 0;
  send(w, b3InitRequestCollisionShapeInformation(w->client, l->body[side], l->link[side]));
  b3GetCollisionShapeInformation(w->client, &found);
  if (found.count != 1) return 0;
  const b3Shape* s = found.shapes;
  if (dot(s->frame, s->frame) > 0 || fabs(s->frame[6]) < 1) return 0;
  if (s->type == SPHERE) l->radius[side] = s->size[0];
  for (int i = 0; i < 3 && s->type != SPHERE; i++) l->axis[i] = s->type == BOX ? s->size[i] / 2 : s->size[i];
  return s->type == SPHERE || s->type == BOX || s->type == PLANE ? s->type : 0;
}

static int read_shapes(world* w, const char* cup, law* l) {
  double *c = l->axis, low[3], high[3];
  char rest;
  for (int side = 0; side < 2; side++) l->shape[side] = side && *cup ? CUP : simple_shape(w, l, side);
  if (*cup && sscanf(cup, "%lf,%lf,%lf,%lf%c", l->radius + 1, c, c + 1, c + 2, &rest) != 4) {
    return fail(w, "cup=%s: needs radius,x,y,z: of the cup and its centre in the second body's frame, m", cup);
  }
  if (*cup && (l->shape[0] != SPHERE || l->radius[1] <= l->radius[0])) {
    return fail(w, "cup=%s: the first body must be a smaller sphere", cup);
  }
  int known = l->shape[0] && l->shape[1] && (l->shape[0] == SPHERE || l->shape[1] == SPHERE);
  if (!known) l->shape[0] = l->shape[1] = 0;
  for (int side = 0; side < 2; side++) { /* of what Bullet finds */
    if (l->shape[0]) body_of(w, l->body[side])->placed = 1;
    b3GetStatusAABB(send(w, b3RequestCollisionInfoCommandInit(w->client, l->body[side])), -1, low, high);
    for (int i = 0; i < 3; i++) low[i] -= high[i];
    l->size[side] = sqrt(dot(low, low));
  }
  return 1;
}

static void collide(world* w, const law* l, int enable) {
  for (int k = 0; l->is_force && k < 2; k++) {
    if (!body_of(w, l->body[k])) return;
  }
  for (int i = -1; l->is_force && i < body_of(w, l->body[0])->links; i++) {
    for (int j = -1; j < body_of(w, l->body[1])->links; j++) {
      if ((l->link[0] != ANY && l->link[0] != i) || (l->link[1] != ANY && l->link[1] != j)) continue;
      void* command = b3CollisionFilterCommandInit(w->client);
      b3SetCollisionFilterPair(command, l->body[0], l->body[1], i, j, enable);
      send(w, command);
    }
  }
}

#define HCB_MARGINS 3e-3 /* m: larger than the box around a link without a shape */

/* Whether a link has a shape. Bullet does not tell those of all kinds; but around a link without one its box is a margin's. */
static int has_shape(world* w, const body* b, int link) {
  double low[3], high[3], largest = 0;
  b3Shapes found = {0, NULL};
  b3GetStatusAABB(send(w, b3RequestCollisionInfoCommandInit(w->client, b->id)), link, low, high);
  for (int i = 0; i < 3; i++) largest = fmax(largest, high[i] - low[i]);
  if (largest > HCB_MARGINS || b->base->info.type != MULTI_BODY) return largest > 0;
  send(w, b3InitRequestCollisionShapeInformation(w->client, b->id, link));
  b3GetCollisionShapeInformation(w->client, &found);
  return found.count > 0;
}

/* Refuses a side of a pair that nothing could meet, and so the law that would never act. */
static int require_shape(world* w, const body* b, int link) {
  int found = 0;
  for (int i = -1; i < b->links && !found; i++) found = (link == ANY || link == i) && has_shape(w, b, i);
  if (found) return 1;
  if (link == ANY) return fail(w, "body %d has no collision shape, so nothing meets it", b->id);
  return fail(w, "link %d of body %d has no collision shape, so nothing meets it: name a link that has one, or -2 for any", link, b->id);
}

static int covers(const law* l, int side, int body, int link) {
  return l->body[side] == body && (l->link[side] == link || l->link[side] == ANY || link == ANY);
}

/* Refuses a second law for links that have one: which of the two acts would be a question of their order. */
static int refuse_two_laws(world* w, const law* l) {
  for (int i = 0; i < w->law_count; i++) {
    const law* other = w->laws + i;
    int same = covers(other, 0, l->body[0], l->link[0]) && covers(other, 1, l->body[1], l->link[1]);
    int swapped = covers(other, 1, l->body[0], l->link[0]) && covers(other, 0, l->body[1], l->link[1]);
    if (!same && !swapped) continue;
    return fail(w, "link %d of body %d and link %d of body %d (-1: base, -2: any) have law %d: remove it first", other->link[0], other->body[0],
                other->link[1], other->body[1], other->id);
  }
  return 1;
}

static int read_pair(world* w, const b3Arguments* given, law* l) {
  body* b[2];
  if (given->ints != 4) return fail(w, "%d integers, needs body, link, body, link (-1: base, -2: any)", given->ints);
  for (int side = 0; side < 2; side++) {
    l->body[side] = given->value[2 * side];
    l->link[side] = given->value[2 * side + 1];
    if (!(b[side] = body_of(w, l->body[side]))) return fail(w, "no body %d", l->body[side]);
    if (l->link[side] < ANY || l->link[side] >= b[side]->links) {
      return fail(w, "body %d has no link %d", l->body[side], l->link[side]);
    }
    for (int i = 0; i < b[side]->links; i++) {
      if (b[side]->link[i].joint != PLANAR) continue;
      return fail(w, "body %d has a planar joint, whose axis Bullet does not tell", b[side]->id);
    }
  }
  if (b[0] == b[1] && l->link[0] == l->link[1]) return fail(w, "body %d is given twice", b[0]->id);
  if (!b[0]->freedoms && !b[1]->freedoms) return fail(w, "neither body %d nor body %d can move", b[0]->id, b[1]->id);
  return require_shape(w, b[0], l->link[0]) && require_shape(w, b[1], l->link[1]) && refuse_two_laws(w, l);
}

static int add_law(world* w, const b3Arguments* given_, int is_force) {
  law l = {.id = w->next_id, .is_force = is_force};
  options o;
  if (!read_pair(w, given_, &l) || !read_options(w, given_->text, is_force ? 'h' : 'r', &o)) return -1;
  if (!(is_force ? read_force : read_restitution)(w, &o, &l) || !read_shapes(w, o.word[IN_CUP], &l)) return -1;
  l.friction = given(&o, FRICTION, -1);
  snprintf(l.text, sizeof(l.text), "%s", given_->text);
  collide(w, &l, 0);
  w->laws = realloc(w->laws, (w->law_count + 1) * sizeof(law));
  w->laws[w->law_count++] = l;
  return w->next_id++;
}

static void drop(world* w, int i) { memmove(w->laws + i, w->laws + i + 1, (--w->law_count - i) * sizeof(law)); }

/* The place of a pair's law, given as body, link, body, link, in either order; -1 without one. */
static int place_of(const world* w, const b3Arguments* given) {
  const int* g = given->value;
  for (int i = 0; given->ints == 4 && i < w->law_count; i++) {
    const law* l = w->laws + i;
    if (covers(l, 0, g[0], g[1]) && covers(l, 1, g[2], g[3])) return i;
    if (covers(l, 1, g[0], g[1]) && covers(l, 0, g[2], g[3])) return i;
  }
  return -1;
}

static int number_of(world* w, const b3Arguments* given) {
  for (int i = 0; given->ints == 1 && i < w->law_count; i++) {
    if (w->laws[i].id == given->value[0]) return i;
  }
  fail(w, "\"%s\": needs the number of a law of this client", given->text);
  return -1;
}

int initPlugin(b3Context* context) {
  const char* missing = find_functions(__builtin_return_address(0));
  if (missing) {
    fprintf(stderr, "hcbench: this Bullet has no %s\n", missing);
    return 0;
  }
  world* w = calloc(1, sizeof(world));
  w->client = context->client;
  w->server = context->server;
  w->status = calloc(1, 1 << 20);
  w->numbers = malloc(NUMBERS_ROOM);
  w->state = calloc(1, sizeof(b3State));
  context->user = w;
  return PROTOCOL;
}

void exitPlugin(b3Context* context) {
  world* w = context->user;
  if (!w) return;
  for (int i = 0; i < w->body_count; i++) forget_body(w, i);
  free_taken(w);
  free(w->memory);
  free(w->contacts);
  free(w->pushes);
  free(w->bodies);
  free(w->laws);
  free(w->status);
  free(w->numbers);
  free(w->state);
  free(w);
  context->user = NULL;
}

/* Steps, and position, velocity and angular velocity of each body after each of them, one after the other; 0 if a body
   is gone. To be called between commands, with what the command `world` tells. */
int hcbench_record(world* w, int steps, const int* ids, int count, double* out) {
  body b = {0};
  for (int i = 0; i < steps; i++) {
    send(w, b3InitStepSimulationCommand(w->client));
    for (int k = 0; k < count; k++, out += 9) {
      b.id = ids[k];
      if (!request_state(w, &b)) return 0;
      memcpy(out, w->state->q, 3 * sizeof(double));
      memcpy(out + 3, w->state->qdot, 6 * sizeof(double));
    }
  }
  return 1;
}

/* Returns a law's number, 0, or -1; `force`, `message`, `world` and `find` bring data along. */
int executePluginCommand(b3Context* context, const b3Arguments* given) {
  static const char* const known[] = {"hunt_crossley", "restitution", "remove", "force",
                                      "message",       "world",       "find"};
  world* w = context->user;
  static _Thread_local b3Data data;
  size_t length = strcspn(given->text, " ");
  int which = 0;
  while (which < 7 && (strlen(known[which]) != length || strncmp(known[which], given->text, length))) which++;
  if (which < 2) return add_law(w, given, which == 0);
  if (which == 4) {
    data = (b3Data){1, strlen(w->message) + 1, w->message};
    context->data = &data;
    return 0;
  }
  if (which == 5) {
    data = (b3Data){0, sizeof(world*), (const char*)&context->user};
    context->data = &data;
    return 0;
  }
  if (which == 7) {
    const char* all = "hunt_crossley, restitution, remove, force, message, find";
    return fail(w, "no command \"%.*s\", only: %s", (int)length, given->text, all) - 1;
  }
  int i = which == 6 ? place_of(w, given) : number_of(w, given);
  if (i < 0) return -1;
  if (which == 6) {
    data = (b3Data){1, strlen(w->laws[i].text) + 1, w->laws[i].text};
    context->data = &data;
    return w->laws[i].id;
  }
  if (which == 2) {
    collide(w, w->laws + i, 1);
    drop(w, i);
  } else {
    data = (b3Data){0, sizeof(double), (const char*)&w->laws[i].force};
    context->data = &data;
  }
  return 0;
}

int preTickPluginCallback(b3Context* context) {
  world* w = context->user;
  b3Parameters now;
  if (!w || w->law_count == 0) return 0;
  b3GetStatusPhysicsSimulationParameters(send(w, b3InitRequestPhysicsParamCommand(w->client)), &now);
  w->substeps = now.substeps;
  w->iterations = now.iterations;
  w->h = now.time_step / (now.substeps > 1 ? now.substeps : 1);
  w->contact_erp = now.contact_erp;
  memcpy(w->gravity, now.gravity, sizeof(w->gravity));
  w->tick++;
  free_taken(w);
  for (int i = 0; i < w->law_count; i++) w->laws[i].force = 0;
  count_unannounced(w);
  take_back(w);
  add_forces(w);
  add_impacts(w);
  w->is_substep = 1;
  return 0;
}

int postTickPluginCallback(b3Context* context) {
  world* w = context->user;
  if (!w || w->law_count == 0) return 0;
  restore_contact_erp(w);
  name_motors(w);
  return 0;
}

/* Bullet tells of these after each command, before the next. */
int processNotifications(b3Context* context) {
  world* w = context->user;
  for (int k = 0; w && k < context->count; k++) {
    const b3Notification* n = context->notifications + k;
    if (n->type == SIMULATION_STEPPED) w->is_substep = 0;
    int known = n->of.body >= 0 && n->of.body < w->body_count; /* -1 of a changeDynamics that changes nothing */
    if (n->type == LINK_DYNAMICS_CHANGED && known && w->bodies[n->of.body]) w->bodies[n->of.body]->stale = 1;
    body* b = n->type == TRANSFORM_CHANGED && known && n->of.moved.link < 0 ? w->bodies[n->of.body] : NULL;
    if (b && has_fixed_base(b)) follow_base(w, b, n->of.moved.pose);
    for (int i = w->law_count - 1; n->type == BODY_REMOVED && i >= 0; i--) {
      if (w->laws[i].body[0] == n->of.body || w->laws[i].body[1] == n->of.body) drop(w, i);
    }
    if (n->type == BODY_REMOVED) forget_body(w, n->of.body);
    if (n->type != SIMULATION_RESET) continue;
    w->law_count = 0;
    for (int i = 0; i < w->body_count; i++) forget_body(w, i);
  }
  return 0;
}
