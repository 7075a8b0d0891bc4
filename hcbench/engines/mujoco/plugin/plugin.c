/* Two plug-ins of MuJoCo's own kind (mjpPlugin, passive forces):

     hcbench.hunt_crossley   the contact force of a law, for steps that resolve the contact; MuJoCo's own contact of
                             the pair must be off
     hcbench.restitution     e(v) of each impact, for steps of any length; MuJoCo's own contact of the pair stays on

   Each instance is one pair: of geoms, of bodies, or the upper limit of a tendon. All there is to know stands in
   the instance's config; docs/reference/plugins.md lists the keys. A number may be the name of a <numeric> instead, whose
   value is then read in every step. All instances of a plug-in are worked out together, by the first one. */

#include <mujoco/mujoco.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../../laws/friction.c"
#include "../../../laws/impacts.c"
#include "../../../laws/published.c"

enum { ROWS = 10, NAME = 64 };
enum { WARNED_FAST = 1, WARNED_WILD = 2, WARNED_UNSOUND = 4, WARNED_DEEPER = 8, WARNED_UNEVEN = 16, WARNED_SUNK = 32, WARNED_UNSTABLE = 64, WARNED_LATE = 128, WARNED_INSIDE = 256, WARNED_JAM = 512 }; /* of hcbench.restitution */

static const char* const FORCE_NAME = "hcbench.hunt_crossley";
static const char* const RESTITUTION_NAME = "hcbench.restitution";
static const char* const force_keys[] = {"geom1", "geom2", "body1", "body2", "tendon", "stiffness", "exponent", "alpha",
                                         "law", "restitution", "friction", "dynamic_friction", "slip_speed"};
static const char* const restitution_keys[] = {"geom1", "geom2", "body1", "body2", "tendon", "alpha", "reading",
                                               "restitution"};

typedef struct { /* a number of the config, or where in numeric_data it is */
  double value;
  int numeric;
} number;

typedef struct { /* what stages of a Runge-Kutta step share of one contact */
  int instance, id, order, rows, stands;
  double value[ROWS], closing;
} plan;

typedef struct { /* a contact of MuJoCo that is to stand after a step, but for an approach of `closing`; below 0: one that is lifted */
  int contact;
  double closing;
} standing;

typedef struct { /* an instance, in mjData.plugin_data */
  int is_force, tendon, pairs, *pair, linear, asked_for_e, warned, starts_off; /* starts_off: made with contacts off */
  char law[NAME];
  number stiffness, alpha, e;
  double exponent, static_friction, dynamic_friction, slip_speed;
  int sunk_pairs[2]; /* of the first instance: how many sank, and how many started inside, up to the last that is named */
  double lets, starts_in; /* how deep MuJoCo's contact would have gone, and its pair was where states do not follow one another, m */
  /* of the first instance: what all instances were read from (is_read), size bytes */
  char* source;
  size_t size;
  /* of the first instance: the Runge-Kutta step that is under way */
  double time, step, *impulse;
  int stage, plans, next_plan, room, dofs, flags[2], iterations;
  plan* planned;
  /* of the first instance: the state from which a step with impacts is made again (again.c) */
  double* start;
  int starts, is_again;
  int trees, *wild; /* of the first instance: which trees turn too far in a step for impacts */
  int stand, room_to_stand; /* of the first instance: how many contacts stand after the step (strays.c) */
  standing* stands;
  int bornes, room_to_bear, warm_dofs; /* of the first instance: what PGS starts from (starts.c) */
  struct borne* borne;
  double* warm; /* accelerations, warm_dofs of each: with what was borne, of the step's start, and these lowered */
  int mocaps, jumps; /* of the first instance: how mocap bodies move (mocap.c) */
  double seen; /* of the first instance: time of the last step; NAN: none */
  double timed; /* of the first instance: the step and the integrator that servos were held against (stability.c) */
  int timed_kind, timed_steps;
  struct mocap* moving;
  struct pair_entry* table; /* of the first instance: the pairs of all, sorted */
  int entries;
} instance;

static instance* instance_of(const mjData* d, int i) { return (instance*)d->plugin_data[i]; }

static const char* config(const mjModel* m, int i, const char* key) {
  const char* text = mj_getPluginConfig(m, i, key);
  return text ? text : "";
}

static int is_force(const mjModel* m, int i) { return !strcmp(mjp_getPluginAtSlot(m->plugin[i])->name, FORCE_NAME); }

/* Stops with a message that names the instance. */
static void fail(const mjModel* m, int i, const char* format, ...) {
  char text[512];
  const char* name = mj_id2name(m, mjOBJ_PLUGIN, i);
  va_list values;
  va_start(values, format);
  vsnprintf(text, sizeof(text), format, values);
  va_end(values);
  mju_error("plugin %s, instance \"%s\": %s", is_force(m, i) ? FORCE_NAME : RESTITUTION_NAME, name ? name : "", text);
}

static double value_of(const mjModel* m, const number* n) { return n->numeric < 0 ? n->value : m->numeric_data[n->numeric]; }

/* The number under `key`, of low ... high; NAN for `otherwise` where it must be given. */
static number read_number(const mjModel* m, int i, const char* key, double otherwise, double low, double high) {
  const char* text = config(m, i, key);
  char* end;
  number read = {otherwise, -1};
  if (!*text && isnan(otherwise)) fail(m, i, "config \"%s\" is missing", key);
  if (!*text) return read;
  read.value = strtod(text, &end);
  if (end == text || *end) {
    int id = mj_name2id(m, mjOBJ_NUMERIC, text);
    if (id < 0) fail(m, i, "config \"%s\": \"%s\" is not a number, and there is no <numeric> of that name", key, text);
    read.numeric = m->numeric_adr[id];
  }
  if (!(value_of(m, &read) >= low && value_of(m, &read) <= high)) {
    fail(m, i, "config \"%s\": %g, needs %g ... %g", key, value_of(m, &read), low, high);
  }
  return read;
}

static int read_id(const mjModel* m, int i, const char* key, int type, const char* kind) {
  const char* text = config(m, i, key);
  int id = *text ? mj_name2id(m, type, text) : -1;
  if (!*text) fail(m, i, "config \"%s\" is missing: give geom1 and geom2, body1 and body2, or tendon", key);
  if (id < 0) fail(m, i, "config \"%s\": there is no %s \"%s\"", key, kind, text);
  return id;
}

#include "pairs.c"

static void read_force(const mjModel* m, int i, instance* own) {
  int named = *config(m, i, "law") != 0;
  own->stiffness = read_number(m, i, "stiffness", NAN, 0, INFINITY);
  own->exponent = read_number(m, i, "exponent", 1.5, 1, 100).value;
  snprintf(own->law, NAME, "%s", config(m, i, "law"));
  if (named == (*config(m, i, "alpha") != 0)) fail(m, i, "needs \"alpha\", or \"law\" and \"restitution\"");
  if (named) {
    own->e = read_number(m, i, "restitution", NAN, 0, 1);
    double chi = hcb_chi(own->law, value_of(m, &own->e));
    if (isnan(chi)) fail(m, i, "there is no law \"%s\", only: %s", own->law, HCB_PUBLISHED);
    if (isinf(chi)) fail(m, i, "config \"restitution\": the law \"%s\" needs one above 0", own->law);
  } else {
    own->alpha = read_number(m, i, "alpha", NAN, 0, INFINITY);
  }
  own->asked_for_e = named;
  own->static_friction = read_number(m, i, "friction", 0, 0, INFINITY).value;
  own->dynamic_friction = read_number(m, i, "dynamic_friction", own->static_friction, 0, own->static_friction).value;
  own->slip_speed = read_number(m, i, "slip_speed", 1e-3, 1e-300, INFINITY).value;
}

static void read_restitution(const mjModel* m, int i, instance* own) {
  const char* reading = config(m, i, "reading");
  own->asked_for_e = *config(m, i, "restitution") != 0;
  if (own->asked_for_e == (*config(m, i, "alpha") != 0)) fail(m, i, "needs either \"alpha\" or \"restitution\"");
  if (own->asked_for_e) {
    own->e = read_number(m, i, "restitution", NAN, 0, 1);
  } else {
    own->alpha = read_number(m, i, "alpha", NAN, 0, INFINITY);
  }
  own->linear = !strcmp(reading, "linear");
  if (*reading && !own->linear && strcmp(reading, "law")) fail(m, i, "config \"reading\": \"%s\", needs law or linear", reading);
}

static void read_instance(const mjModel* m, int i, instance* own) {
  read_pairs(m, i, own);
  if (is_force(m, i)) {
    read_force(m, i, own);
  } else {
    read_restitution(m, i, own);
  }
}

/* Whether all that `read_instance` heeds, names and what they stand for, is as at the last call. `rollout` steps other models with
   the same mjData, and a model may lie where another one was: addresses tell nothing. */
static int is_read(const mjModel* m, instance* memory) {
#define PART(array, count) {m->array, (size_t)(count) * sizeof(*m->array)}
  const struct {
    const void* at;
    size_t size;
  } parts[] = {
      PART(plugin_attr, m->npluginattr),      PART(plugin_attradr, m->nplugin),   PART(names, m->nnames),
      PART(name_bodyadr, m->nbody),           PART(name_geomadr, m->ngeom),       PART(name_tendonadr, m->ntendon),
      PART(name_numericadr, m->nnumeric),     PART(numeric_adr, m->nnumeric),     PART(tendon_limited, m->ntendon),
      PART(body_weldid, m->nbody),            PART(body_parentid, m->nbody),      PART(body_geomadr, m->nbody),
      PART(body_geomnum, m->nbody),           PART(geom_bodyid, m->ngeom),        PART(geom_type, m->ngeom),
      PART(geom_contype, m->ngeom),           PART(geom_conaffinity, m->ngeom),   PART(pair_geom1, m->npair),
      PART(pair_geom2, m->npair),             PART(exclude_signature, m->nexclude),
  };
#undef PART
  enum { PARTS = sizeof(parts) / sizeof(*parts) };
  size_t size = 0, at = 0;
  for (int k = 0; k < PARTS; k++) size += parts[k].size;
  int same = memory->source && memory->size == size;
  if (!same) memory->source = realloc(memory->source, size);
  memory->size = size;
  for (int k = 0; k < PARTS; at += parts[k++].size) {
    if (!parts[k].size || (same && !memcmp(memory->source + at, parts[k].at, parts[k].size))) continue;
    memcpy(memory->source + at, parts[k].at, parts[k].size);
    same = 0;
  }
  return same;
}

static int first_of(const mjModel* m, int i) {
  for (int j = 0; j < i; j++) {
    if (m->plugin[j] == m->plugin[i]) return j;
  }
  return i;
}

static int is_first(const mjModel* m, int i) { return first_of(m, i) == i; }

static int is_last(const mjModel* m, int i) {
  for (int j = i + 1; j < m->nplugin; j++) {
    if (m->plugin[j] == m->plugin[i]) return 0;
  }
  return 1;
}

/* Refuses flags under which MuJoCo computes no passive force, of plug-ins neither. */
static void require_passive(const mjModel* m, int i) {
#ifdef HCB_DAMPER
  int both = mjDSBL_SPRING | mjDSBL_DAMPER;
  if ((m->opt.disableflags & both) != both) return;
  fail(m, i, "the flags spring and damper are both \"disable\": MuJoCo then calls no plug-in of passive forces. Enable one, and set "
       "the stiffness or damping of the model to 0 instead");
#else
  if (!(m->opt.disableflags & mjDSBL_PASSIVE)) return;
  fail(m, i, "the flag passive is \"disable\": MuJoCo then calls no plug-in of passive forces. Enable it, and set the stiffness and "
       "damping of the model to 0 instead");
#endif
}

#include "contacts.c"
#include "trees.c"

#include "force.c"
#include "mocap.c"
#include "restitution.c"
#include "strays.c"

static void compute(const mjModel* m, mjData* d, int i, int capability) {
  (void)capability;
  if (evaluating || !is_first(m, i)) return;
  if (are_contacts_off(m)) {
    warn_of_contacts_off(m, d, instance_of(d, i));
    return;
  }
  if (!is_read(m, instance_of(d, i))) {
    for (int j = i; j < m->nplugin; j++) {
      if (m->plugin[j] == m->plugin[i]) read_instance(m, j, instance_of(d, j));
    }
    make_table(m, d, i);
  }
  if (instance_of(d, i)->is_force) {
    add_forces(m, d, i);
  } else {
    add_impacts(m, d, i);
  }
}

static void advance(const mjModel* m, mjData* d, int i) {
  if (!is_first(m, i) || is_force(m, i)) return;
  require_passive(m, i); /* flags may change after the model is loaded */
  take_accelerations(m, d, i);
  take_again(m, d, i);
  stop_strays(m, d, i);
  keep_forces(m, d, i);
}

static int init(const mjModel* m, mjData* d, int i) {
  instance* own = calloc(1, sizeof(instance));
  if (!own) return -1;
  d->plugin_data[i] = (uintptr_t)own;
  own->is_force = is_force(m, i);
  own->seen = NAN;
  require_passive(m, i);
  read_instance(m, i, own);
  own->starts_off = are_contacts_off(m);
  if (!own->is_force) {
    warn_of_no_contact(m, i, own);
    warn_of_late_contacts(m, own, instance_of(d, first_of(m, i)));
  }
  if (is_last(m, i)) make_table(m, d, first_of(m, i)); /* refuses two laws for one pair */
  return 0;
}

static void destroy(mjData* d, int i) {
  instance* own = instance_of(d, i);
  if (!own) return;
  free(own->pair);
  free(own->table);
  free(own->source);
  free(own->impulse);
  free(own->planned);
  free(own->start);
  free(own->wild);
  free(own->stands);
  free(own->borne);
  free(own->warm);
  free(own->moving);
  free(own);
  d->plugin_data[i] = 0;
}

/* Ends the step that is under way, and forgets what was before. */
static void forget(instance* own) {
  own->stage = own->starts = own->stand = own->mocaps = own->bornes = 0;
  own->lets = own->starts_in = 0;
  own->seen = NAN;
}

/* How deep contacts went, how mocap bodies move and what contacts bore outlives a step; a copy has all else from its own init. */
static void copy(mjData* to, const mjModel* m, const mjData* from, int i) {
  instance *own = instance_of(to, i), *other = instance_of(from, i);
  size_t size = other->mocaps * sizeof(struct mocap);
  (void)m;
  forget(own);
  own->lets = other->lets;
  own->starts_in = other->starts_in;
  own->seen = other->seen;
  copy_forces(own, other);
  if (!size) return;
  own->moving = realloc(own->moving, size);
  memcpy(own->moving, other->moving, size);
  own->mocaps = other->mocaps;
}

static void reset(const mjModel* m, mjtNum* state, void* data, int i) {
  (void)m, (void)state, (void)i;
  if (data) forget(data);
}

static int no_state(const mjModel* m, int i) {
  (void)m, (void)i;
  return 0;
}

/* Runs when the library is loaded; a copy in MuJoCo's own folder may have been before. */
__attribute__((constructor)) static void register_plugins(void) {
  mjpPlugin plugin;
  if (mjp_getPlugin(FORCE_NAME, NULL)) return;
  mjp_defaultPlugin(&plugin);
  plugin.capabilityflags = mjPLUGIN_PASSIVE;
  plugin.nstate = no_state;
  plugin.init = init;
  plugin.destroy = destroy;
  plugin.copy = copy;
  plugin.reset = reset;
  plugin.compute = compute;
  plugin.name = FORCE_NAME;
  plugin.attributes = force_keys;
  plugin.nattribute = sizeof(force_keys) / sizeof(*force_keys);
  mjp_registerPlugin(&plugin);
  plugin.advance = advance;
  plugin.name = RESTITUTION_NAME;
  plugin.attributes = restitution_keys;
  plugin.nattribute = sizeof(restitution_keys) / sizeof(*restitution_keys);
  mjp_registerPlugin(&plugin);
}
