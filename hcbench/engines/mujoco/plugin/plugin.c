/* The law as callbacks of MuJoCo: mjcb_contactfilter takes attached pairs out of the engine's own contact,
   mjcb_passive adds the law's force (or rewrites the constraint rows of a restitution law). Compiled against
   the headers of the installed mujoco; a model says which table of pairs is its own by a mark in opt.o_margin,
   which its copies carry along. */

#include <mujoco/mujoco.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "../../../laws/exact_step.c"

enum { FORCE = 1, RESTITUTION = 2, LINEAR = 1, CONSTANT = 2, FIXED = 0, FREE = 1, JOINTED = 2, TABLES = 4096, ROWS = 10 };
#define MARK 1e-305 /* opt.o_margin = MARK * table: no margin at all, should anybody use it */
#define HCB_REPORT 12
#define HCB_COARSE 1.0 /* (omega h)^2 beyond which a step is too coarse */
#define HCB_STILL 1.1 /* steps of falling whose speed counts as rest */
#define HCB_RIGID 1e-9 /* compliance of a restitution row, in units of the pair's own inverse mass */

typedef struct { /* mirrored by _native.Pair */
  int kind, geom1, geom2, tendon, side, slot, reading, own;
  double stiffness, alpha, exponent, static_friction, dynamic_friction, slip_speed;
} hcb_pair;

typedef struct { /* mirrored by _native.Table */
  int pairs, geom_pairs, restitution_pairs, unused; /* sorted by geoms; tendons last */
  const hcb_pair* pair;
  const int* body; /* FIXED, FREE or JOINTED */
  long long not_finite, too_coarse;
} hcb_table;

typedef struct {
  int pair, order, body[2], dense;
  double x, v, inverse_mass, force, point[3], normal[3], slip[3], *row, *solved;
  hcb_law law;
} touch;

typedef struct {
  int pair, order, rows, cone;
  double value[ROWS], compliance, force;
} plan;

static hcb_table* tables[TABLES];
static mjfGeneric passive_before;
static mjfConFilt filter_before;
static mjfCollision (*collide)[mjNGEOMTYPES];
static void (*apply_ft)(const mjModel*, mjData*, const mjtNum*, const mjtNum*, const mjtNum*, int, mjtNum*);
static void (*jacobian)(const mjModel*, const mjData*, mjtNum*, mjtNum*, const mjtNum*, int);
static void (*solve)(const mjModel*, mjData*, mjtNum*, const mjtNum*, int);
static void (*mark_stack)(mjData*);
static void (*free_stack)(mjData*);
static void* (*stack)(mjData*, size_t, size_t);

/* What the stages of a Runge-Kutta step share: the first one plans, the others carry out. */
static _Thread_local struct {
  const mjData* data;
  double time, step;
  int stage, count, room;
  plan* plans;
} memory;

void hcb_connect(void** f) {
  collide = (mjfCollision(*)[mjNGEOMTYPES])f[0];
  *(void**)&apply_ft = f[1];
  *(void**)&jacobian = f[2];
  *(void**)&solve = f[3];
  *(void**)&mark_stack = f[4];
  *(void**)&free_stack = f[5];
  *(void**)&stack = f[6];
}

void hcb_chain(void* passive, void* filter) {
  *(void**)&passive_before = passive;
  *(void**)&filter_before = filter;
}

void hcb_set_table(int id, hcb_table* table) { tables[id] = table; }

/* Values that the loader compares with what the Python bindings say: the layout is right or unused. */
void hcb_probe(const mjModel* m, const mjData* d, double* out) {
  double values[] = {mjVERSION_HEADER, sizeof(mjContact), m->nq, m->nv, m->nbody, m->ngeom, m->ntendon,
                     m->opt.timestep, m->opt.o_margin, m->opt.o_friction[4], m->opt.integrator,
                     m->opt.enableflags, m->geom_rbound[m->ngeom - 1], m->body_mass[m->nbody - 1],
                     (double)(size_t)m->body_inertia, (double)(size_t)m->geom_bodyid,
                     (double)(size_t)d->qpos, (double)(size_t)d->qvel, (double)(size_t)d->qfrc_passive,
                     (double)(size_t)d->geom_xpos, (double)(size_t)d->ximat, (double)(size_t)d->cvel,
                     (double)(size_t)d->subtree_com, (double)(size_t)d->ten_length, d->ncon, d->nefc, d->time,
                     (double)(size_t)d->efc_KBIP, (double)(size_t)d->efc_pos, (double)(size_t)d->efc_margin,
                     (double)(size_t)d->efc_R, (double)(size_t)d->efc_D, d->ncon ? d->contact[0].dist : 0,
                     d->ncon ? d->contact[0].efc_address : 0, d->ncon ? d->contact[0].friction[0] : 0};
  memcpy(out, values, sizeof(values));
}

static hcb_table* table_of(const mjModel* m) {
  double id = m->opt.o_margin / MARK;
  if (!(id > 0.5 && id < TABLES)) return NULL;
  int k = (int)(id + 0.5);
  return m->opt.o_margin == k * MARK ? tables[k] : NULL;
}

static int find(const hcb_table* t, int g1, int g2) {
  int low = 0, high = t->geom_pairs - 1;
  if (g1 > g2) {
    int g = g1;
    g1 = g2;
    g2 = g;
  }
  while (low <= high) {
    int k = (low + high) / 2;
    const hcb_pair* p = t->pair + k;
    if (p->geom1 == g1 && p->geom2 == g2) return k;
    if (p->geom1 < g1 || (p->geom1 == g1 && p->geom2 < g2)) {
      low = k + 1;
    } else {
      high = k - 1;
    }
  }
  return -1;
}

int hcb_filter(const mjModel* m, mjData* d, int g1, int g2) {
  const hcb_table* t = table_of(m);
  int k = t ? find(t, g1, g2) : -1;
  if (k >= 0 && t->pair[k].kind == FORCE) return 1;
  if (filter_before) return filter_before(m, d, g1, g2);
  return !((m->geom_contype[g1] & m->geom_conaffinity[g2]) || (m->geom_contype[g2] & m->geom_conaffinity[g1]));
}

static double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(double* out, const double* a, const double* b) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

static void velocity_at(const mjModel* m, const mjData* d, int body, const double* p, double* out) {
  const double *w = d->cvel + 6 * body, *com = d->subtree_com + 3 * m->body_rootid[body];
  double arm[3] = {p[0] - com[0], p[1] - com[1], p[2] - com[2]};
  cross(out, w, arm);
  for (int i = 0; i < 3; i++) out[i] += w[3 + i];
}

/* Acceleration along n at p of a free body under a unit force along N at P. */
static double mobility(const mjModel* m, const mjData* d, int body, const double* p, const double* n,
                       const double* P, const double* N) {
  const double *c = d->xipos + 3 * body, *R = d->ximat + 9 * body, *I = m->body_inertia + 3 * body;
  double arm[3] = {p[0] - c[0], p[1] - c[1], p[2] - c[2]}, Arm[3] = {P[0] - c[0], P[1] - c[1], P[2] - c[2]};
  double t[3], T[3], sum = dot(n, N) / m->body_mass[body];
  cross(t, arm, n);
  cross(T, Arm, N);
  for (int i = 0; i < 3; i++) {
    sum += (R[i] * t[0] + R[3 + i] * t[1] + R[6 + i] * t[2]) * (R[i] * T[0] + R[3 + i] * T[1] + R[6 + i] * T[2]) / I[i];
  }
  return sum;
}

static void gravity_on(const mjModel* m, int body, double* out) {
  for (int i = 0; i < 3; i++) {
    out[i] = m->opt.disableflags & mjDSBL_GRAVITY ? 0 : m->opt.gravity[i] * (1 - m->body_gravcomp[body]);
  }
}

/* The law of a pair. Its slot is two inert fields of mjOption, a factor on k and alpha, that copies can vary. */
static hcb_law law_of(const mjModel* m, const hcb_pair* p, double inverse_mass, double b) {
  const double* slots[] = {m->opt.o_solref, m->opt.o_solimp, m->opt.o_solimp + 2, m->opt.o_friction,
                           m->opt.o_friction + 2};
  const double own[] = {1, p->alpha}, *s = p->slot < 0 ? own : slots[p->slot];
  hcb_law law = {p->stiffness * s[0] * inverse_mass, 1.5 * s[1], p->exponent, b, 0, 1, 0, 0};
  if (p->own && s[1] > 0) {
    law.a = 0;
    law.chi = 1.5 * s[1];
    law.e = hcb_restitution(law.chi);
    law.load = b;
  }
  return law;
}

static int stage_of(const mjModel* m, const mjData* d) {
  double h = m->opt.timestep;
  if (m->opt.integrator != mjINT_RK4) return 0;
  int stage = memory.data == d && memory.step == h ? memory.stage : 0;
  if (stage && stage != 3 && d->time == memory.time + 0.5 * h) {
    memory.stage = stage == 2 ? 3 : 2;
  } else if (stage == 3 && d->time == memory.time + h) {
    memory.stage = 4;
  } else {
    memory.data = d;
    memory.step = h;
    memory.time = d->time;
    memory.stage = 1;
    memory.count = 0;
  }
  return memory.stage;
}

static plan* planned(int pair, int order) {
  for (int i = 0; i < memory.count; i++) {
    if (memory.plans[i].pair == pair && memory.plans[i].order == order) return memory.plans + i;
  }
  return NULL;
}

static plan* new_plan(int pair, int order) {
  if (memory.count == memory.room) {
    int room = memory.room ? 2 * memory.room : 16;
    plan* more = realloc(memory.plans, room * sizeof(plan));
    if (!more) return NULL;
    memory.plans = more;
    memory.room = room;
  }
  plan* made = memory.plans + memory.count++;
  made->pair = pair;
  made->order = order;
  return made;
}

#include "touch.c"

#include "force.c"
#include "restitution.c"

void hcb_passive(const mjModel* m, mjData* d) {
  if (passive_before) passive_before(m, d);
  hcb_table* t = table_of(m);
  if (!t || m->opt.disableflags & (mjDSBL_CONTACT | mjDSBL_CONSTRAINT)) return;
  /* MuJoCo resets what is not finite before we see it, and keeps count. */
  if (d->warning[mjWARN_BADQPOS].number || d->warning[mjWARN_BADQVEL].number || d->warning[mjWARN_BADQACC].number) {
    __atomic_add_fetch(&t->not_finite, 1, __ATOMIC_RELAXED);
  }
  int stage = stage_of(m, d);
  add_forces(m, d, t, stage, NULL, NULL);
  rewrite_rows(m, d, t, stage);
}

/* Contacts of the force law at the present state: rows of HCB_REPORT numbers; at most `room`. */
int hcb_report(const mjModel* m, mjData* d, double* out, int room) {
  hcb_table* t = table_of(m);
  if (!t) return 0;
  add_forces(m, d, t, m->opt.integrator == mjINT_RK4 ? 1 : 0, out, &room);
  return room;
}
