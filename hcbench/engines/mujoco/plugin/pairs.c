/* Which geoms an instance's law is for, and the table that finds the law of a contact. */

static int masks_meet(const mjModel* m, int g1, int g2) {
  return (m->geom_contype[g1] & m->geom_conaffinity[g2]) || (m->geom_contype[g2] & m->geom_conaffinity[g1]);
}

/* Why MuJoCo makes no contact of two geoms; NULL where it does. */
static const char* why_never(const mjModel* m, int g1, int g2) {
  int b1 = m->geom_bodyid[g1], b2 = m->geom_bodyid[g2], w1 = m->body_weldid[b1], w2 = m->body_weldid[b2];
  int p1 = m->body_weldid[m->body_parentid[w1]], p2 = m->body_weldid[m->body_parentid[w2]];
  for (int k = 0; k < m->npair; k++) {
    int a = m->pair_geom1[k], b = m->pair_geom2[k];
    if ((a == g1 && b == g2) || (a == g2 && b == g1)) return NULL;
  }
  for (int k = 0; k < m->nexclude; k++) {
    if (m->exclude_signature[k] == (b1 << 16) + b2 || m->exclude_signature[k] == (b2 << 16) + b1) {
      return "an <exclude> of their bodies switches their contact off: remove it";
    }
  }
  if (w1 == w2) return "they are fixed to the same body: name others";
  if (w1 && w2 && (w1 == p2 || w2 == p1) && !(m->opt.disableflags & mjDSBL_FILTERPARENT)) {
    return "one's body is the parent of the other's: add a <pair> of both to <contact>, or the flag filterparent=\"disable\"";
  }
  if (!masks_meet(m, g1, g2)) return "contype and conaffinity keep them apart: set a bit that both share, or add a <pair> of both to <contact>";
  return NULL;
}

/* Whether MuJoCo makes contacts of two geoms itself. */
static int is_native(const mjModel* m, int g1, int g2) { return !why_never(m, g1, g2); }

/* The name of an element, or its number where it has none. */
static void describe(const mjModel* m, int type, int id, char out[NAME]) {
  const char* name = mj_id2name(m, type, id);
  if (name && *name) {
    snprintf(out, NAME, "\"%.*s\"", NAME - 3, name);
  } else {
    snprintf(out, NAME, "%d", id);
  }
}

static void add_pair(const mjModel* m, int i, instance* own, int g1, int g2) {
  if (m->body_weldid[m->geom_bodyid[g1]] == m->body_weldid[m->geom_bodyid[g2]]) {
    fail(m, i, "geoms \"%s\" and \"%s\" are fixed to the same body", mj_id2name(m, mjOBJ_GEOM, g1),
         mj_id2name(m, mjOBJ_GEOM, g2));
  }
  if (is_force(m, i) && is_native(m, g1, g2)) {
    const char *n1 = mj_id2name(m, mjOBJ_GEOM, g1), *n2 = mj_id2name(m, mjOBJ_GEOM, g2);
    fail(m, i, "MuJoCo's own contact of the geoms \"%s\" and \"%s\" is on as well: add <exclude body1=.. body2=..> "
         "to <contact>, or contype=\"0\" conaffinity=\"0\" to one", n1 ? n1 : "", n2 ? n2 : "");
  }
  int type1 = m->geom_type[g1], type2 = m->geom_type[g2], swap = type1 > type2;
  if (type1 == mjGEOM_PLANE && type2 == mjGEOM_PLANE) fail(m, i, "two planes have no contact");
  own->pair = realloc(own->pair, 2 * (own->pairs + 1) * sizeof(int));
  own->pair[2 * own->pairs] = swap ? g2 : g1; /* as collision functions want them */
  own->pair[2 * own->pairs++ + 1] = swap ? g1 : g2;
}

static void read_pairs(const mjModel* m, int i, instance* own) {
  own->pairs = 0;
  own->tendon = -1;
  if (*config(m, i, "tendon")) {
    own->tendon = read_id(m, i, "tendon", mjOBJ_TENDON, "tendon");
    if (is_force(m, i) == m->tendon_limited[own->tendon]) {
      fail(m, i, "tendon \"%s\" must have a range and limited=\"%s\"", config(m, i, "tendon"),
           is_force(m, i) ? "false: the force takes the place of its limit" : "true");
    }
  } else if (*config(m, i, "body1") || *config(m, i, "body2")) {
    int b1 = read_id(m, i, "body1", mjOBJ_BODY, "body"), b2 = read_id(m, i, "body2", mjOBJ_BODY, "body");
    for (int masked = 1; masked >= 0 && own->pairs == 0; masked--) { /* geoms that may meet, or else all */
      for (int k = 0; k < m->body_geomnum[b1] * m->body_geomnum[b2]; k++) {
        int g1 = m->body_geomadr[b1] + k / m->body_geomnum[b2], g2 = m->body_geomadr[b2] + k % m->body_geomnum[b2];
        int planes = m->geom_type[g1] == mjGEOM_PLANE && m->geom_type[g2] == mjGEOM_PLANE;
        if (!planes && (!masked || masks_meet(m, g1, g2))) add_pair(m, i, own, g1, g2);
      }
    }
    if (own->pairs == 0) fail(m, i, "the two bodies have no geoms that could meet");
  } else {
    int g1 = read_id(m, i, "geom1", mjOBJ_GEOM, "geom"), g2 = read_id(m, i, "geom2", mjOBJ_GEOM, "geom");
    add_pair(m, i, own, g1, g2);
  }
}

/* Names a pair of a restitution law of which MuJoCo never makes a contact, so that the law is for nothing. */
static void warn_of_no_contact(const mjModel* m, int i, const instance* own) {
  for (int k = 0; k < own->pairs; k++) {
    if (is_native(m, own->pair[2 * k], own->pair[2 * k + 1])) return;
  }
  if (own->pairs == 0) return; /* a tendon */
  char text[3][NAME];
  describe(m, mjOBJ_PLUGIN, i, text[0]);
  describe(m, mjOBJ_GEOM, own->pair[0], text[1]);
  describe(m, mjOBJ_GEOM, own->pair[1], text[2]);
  mju_warning("plugin hcbench.restitution, instance %s: the geoms %s and %s never meet, as %s", text[0], text[1], text[2],
              why_never(m, own->pair[0], own->pair[1]));
}

/* Whether MuJoCo finds contacts of two geoms so late and deep that bodies sink through, as a law's rows do not lift what is in. */
static int are_found_late(const mjModel* m, int g1, int g2) {
  int one = m->geom_type[g1], two = m->geom_type[g2], other = one == mjGEOM_HFIELD ? two : one;
  return (one == mjGEOM_HFIELD || two == mjGEOM_HFIELD) && (other == mjGEOM_MESH || other == mjGEOM_ELLIPSOID);
}

/* Names the first pair of a model whose law may let it sink. */
static void warn_of_late_contacts(const mjModel* m, const instance* own, instance* memory) {
  char text[2][NAME];
  for (int k = 0; k < own->pairs && !(memory->warned & WARNED_LATE); k++) {
    const int* pair = own->pair + 2 * k;
    if (!are_found_late(m, pair[0], pair[1]) || !is_native(m, pair[0], pair[1])) continue;
    for (int side = 0; side < 2; side++) describe(m, mjOBJ_GEOM, pair[side], text[side]);
    memory->warned |= WARNED_LATE;
    mju_warning("plugin %s: the geoms %s and %s are a mesh or an ellipsoid and a height field, whose contact MuJoCo finds late and deep: "
                "what lies there may sink through. Take MuJoCo's own contact for this pair, or spheres, capsules or boxes",
                RESTITUTION_NAME, text[0], text[1]);
  }
}

static int are_contacts_off(const mjModel* m) { return (m->opt.disableflags & (mjDSBL_CONTACT | mjDSBL_CONSTRAINT)) != 0; }

/* Names once a model that is loaded with contacts off, so that no law acts. A flag that is set later switches them off for a while.
   MuJoCo's compiler tries each model so for a step. */
static void warn_of_contacts_off(const mjModel* m, const mjData* d, instance* own) {
  int off = m->opt.disableflags & mjDSBL_CONTACT;
  if (!own->starts_off || d->time < 1.5 * m->opt.timestep) return;
  own->starts_off = 0;
  mju_warning("plugin %s: no pair meets, as the model has <flag %s=\"disable\"/>: enable it", own->is_force ? FORCE_NAME : RESTITUTION_NAME,
              off ? "contact" : "constraint");
}

typedef struct pair_entry {
  int geom[2], instance, id; /* the smaller geom first; id: which of the instance's pairs */
} pair_entry;

static int compare_pairs(const void* a, const void* b) {
  const pair_entry *x = a, *y = b;
  if (x->geom[0] != y->geom[0]) return x->geom[0] < y->geom[0] ? -1 : 1;
  if (x->geom[1] != y->geom[1]) return x->geom[1] < y->geom[1] ? -1 : 1;
  if (x->instance != y->instance) return x->instance < y->instance ? -1 : 1;
  return (x->id > y->id) - (x->id < y->id);
}

/* Refuses two instances that share a pair of geoms: a contact has one law. */
static void refuse_two_laws(const mjModel* m, const instance* memory) {
  for (int k = 1; k < memory->entries; k++) {
    const pair_entry *one = memory->table + k - 1, *two = memory->table + k;
    if (one->geom[0] != two->geom[0] || one->geom[1] != two->geom[1] || one->instance == two->instance) continue;
    char text[3][NAME];
    describe(m, mjOBJ_PLUGIN, one->instance, text[0]);
    describe(m, mjOBJ_GEOM, two->geom[0], text[1]);
    describe(m, mjOBJ_GEOM, two->geom[1], text[2]);
    fail(m, two->instance, "the geoms %s and %s have the law of instance %s as well: remove one of the two instances, or name geoms in "
         "place of bodies", text[1], text[2], text[0]);
  }
}

static void make_table(const mjModel* m, const mjData* d, int first) {
  instance* memory = instance_of(d, first);
  int count = 0;
  for (int i = first; i < m->nplugin; i++) {
    if (m->plugin[i] == m->plugin[first]) count += instance_of(d, i)->pairs;
  }
  memory->table = realloc(memory->table, (count + 1) * sizeof(pair_entry));
  memory->entries = 0;
  for (int i = first; i < m->nplugin; i++) {
    if (m->plugin[i] != m->plugin[first]) continue; /* it may not be there yet */
    const instance* own = instance_of(d, i);
    for (int k = 0; k < own->pairs; k++) {
      int a = own->pair[2 * k], b = own->pair[2 * k + 1];
      memory->table[memory->entries++] = (pair_entry){{a < b ? a : b, a < b ? b : a}, i, k};
    }
  }
  qsort(memory->table, memory->entries, sizeof(pair_entry), compare_pairs);
  refuse_two_laws(m, memory);
}

/* The first entry of two geoms in the table; NULL without one. */
static const pair_entry* entry_of(const instance* memory, int g1, int g2) {
  pair_entry key = {{g1 < g2 ? g1 : g2, g1 < g2 ? g2 : g1}, -1, -1};
  int low = 0, high = memory->entries;
  while (low < high) {
    int middle = (low + high) / 2;
    if (compare_pairs(memory->table + middle, &key) < 0) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  const pair_entry* e = memory->table + low;
  return low < memory->entries && e->geom[0] == key.geom[0] && e->geom[1] == key.geom[1] ? e : NULL;
}
