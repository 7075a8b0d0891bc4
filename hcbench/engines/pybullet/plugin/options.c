/* The text of a command that adds a law: what it says of the law itself. */

static int fail(world* w, const char* format, ...) {
  va_list values;
  va_start(values, format);
  vsnprintf(w->message, sizeof(w->message), format, values);
  va_end(values);
  fprintf(stderr, "hcbench: %s\n", w->message);
  return 0;
}

/* What stands after "name" in "name key=value key=value": numbers (NAN: not given), and words as they are. */
enum { STIFFNESS, EXPONENT, ALPHA, RESTITUTION, FRICTION, DYNAMIC_FRICTION, SLIP_SPEED, NUMBERS };
enum { LAW, READING, IN_CUP, WORDS };

typedef struct {
  double number[NUMBERS];
  char word[WORDS][128];
} options;

static const struct {
  const char *name, *of; /* of: "h" hunt_crossley, "r" restitution */
  double low, high;
} keys[NUMBERS + WORDS] = {
    {"stiffness", "h", 0, INFINITY}, {"exponent", "h", 1, 100}, {"alpha", "hr", 0, INFINITY},
    {"restitution", "hr", 0, 1}, {"friction", "hr", 0, INFINITY}, {"dynamic_friction", "h", 0, INFINITY},
    {"slip_speed", "h", 1e-300, INFINITY}, {"law", "h", 0, 0}, {"reading", "r", 0, 0}, {"cup", "hr", 0, 0}};

static int set_option(world* w, int k, const char* value, options* o) {
  char* end;
  if (k >= NUMBERS) return snprintf(o->word[k - NUMBERS], sizeof(o->word[0]), "%s", value) + 1;
  double number = o->number[k] = strtod(value, &end);
  if (end == value || *end) return fail(w, "%s=%s: no number", keys[k].name, value);
  if (number >= keys[k].low && number <= keys[k].high) return 1;
  return fail(w, "%s=%g: needs %g ... %g", keys[k].name, number, keys[k].low, keys[k].high);
}

/* The key by its name of today; an earlier one is named on stderr. */
static const char* key_of_today(const char* name, char kind) {
  if (kind != 'r' || strcmp(name, "constant")) return name;
  fprintf(stderr, "hcbench: the key constant= is restitution= now, as in MuJoCo: write that\n");
  return "restitution";
}

static int read_options(world* w, const char* text, char kind, options* o) {
  char copy[1024], *rest, known[256] = "";
  snprintf(copy, sizeof(copy), "%s", text);
  for (int k = 0; k < NUMBERS; k++) o->number[k] = NAN;
  for (int k = 0; k < WORDS; k++) o->word[k][0] = 0;
  for (int k = 0; k < NUMBERS + WORDS; k++) {
    if (strchr(keys[k].of, kind)) strcat(strcat(known, " "), keys[k].name);
  }
  strtok_r(copy, " ", &rest);
  for (char* token; (token = strtok_r(NULL, " ", &rest));) {
    char* value = strchr(token, '=');
    int k = 0;
    if (!value) return fail(w, "needs key=value after \"%s\"", token);
    *value++ = 0;
    const char* name = key_of_today(token, kind);
    while (k < NUMBERS + WORDS && (strcmp(keys[k].name, name) || !strchr(keys[k].of, kind))) k++;
    if (k == NUMBERS + WORDS) return fail(w, "no key \"%s\", only:%s", token, known);
    if (!set_option(w, k, value, o)) return 0;
  }
  return 1;
}

static double given(const options* o, int key, double otherwise) {
  return isnan(o->number[key]) ? otherwise : o->number[key];
}

static int read_force(world* w, const options* o, law* l) {
  hcb_law* motion = &l->motion;
  int asked_for_e = o->word[LAW][0] != 0;
  if (isnan(o->number[STIFFNESS])) return fail(w, "hunt_crossley: stiffness= is missing");
  if (asked_for_e == !isnan(o->number[ALPHA]) || asked_for_e == isnan(o->number[RESTITUTION])) {
    return fail(w, "hunt_crossley: needs either alpha=, or law= and restitution=");
  }
  l->dynamic_friction = given(o, DYNAMIC_FRICTION, -1);
  l->slip_speed = given(o, SLIP_SPEED, 1e-3);
  *motion = (hcb_law){o->number[STIFFNESS], 1.5 * given(o, ALPHA, 0), given(o, EXPONENT, 1.5), 0, 0, 1, 0, 0};
  if (!asked_for_e) return 1;
  motion->chi = hcb_chi(o->word[LAW], o->number[RESTITUTION]);
  if (isnan(motion->chi)) return fail(w, "there is no law \"%s\", only: %s", o->word[LAW], HCB_PUBLISHED);
  if (isinf(motion->chi)) return fail(w, "restitution=0: the law \"%s\" needs one above 0", o->word[LAW]);
  motion->e = hcb_restitution(motion->chi);
  return 1;
}

static int read_restitution(world* w, const options* o, law* l) {
  int constant = !isnan(o->number[RESTITUTION]), linear = !strcmp(o->word[READING], "linear");
  if (constant == !isnan(o->number[ALPHA])) return fail(w, "restitution: needs either alpha= or restitution=");
  if (o->word[READING][0] && !linear && strcmp(o->word[READING], "law")) {
    return fail(w, "reading=%s: needs law or linear", o->word[READING]);
  }
  l->impact.kind = constant ? HCB_CONSTANT : linear ? HCB_LINEAR : HCB_LAW;
  l->impact.value = o->number[constant ? RESTITUTION : ALPHA];
  return 1;
}
