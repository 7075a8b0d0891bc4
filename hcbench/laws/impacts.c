/* Impacts of rigid bodies in one instant, several contacts at once, with friction; the kinetic energy never grows.

   INTERFACE (no engine's types; include this file, which brings exact_step.c along):

     hcb_contact c[n]   what each contact is: e over its approach speed, friction, what counts as rest
     double J[3n][nv]   rates of the contacts u = J v: row 3i of the normal (u > 0 parts, u < 0 approaches),
                        rows 3i+1, 3i+2 of two tangents perpendicular to it and to each other
     double B[3n][nv]   M^-1 J^T, row by row: B[k] is what an impulse of 1 along row k adds to v
     hcb_coupling(n, nv, J, B, G)            G[3n][3n] = J M^-1 J^T (or fill G yourself)
     double u[3n]       rates before the impacts, without what this step's forces add; after: rates after them
     double p[3n]       out: impulses along the rows, N s; v after = v + sum of p[k] B[k]
     double work[hcb_impacts_work(n)]        room; nothing is allocated
     rounds = hcb_impacts(n, G, c, u, p, work)

   Then give the bodies the impulses p, before the step's own forces act, and let contacts that are left without
   approach, or with no more than `still`, rest by the engine's own contact with e = 0. Bodies that cannot move
   have no part in J. A one-sided limit is a contact with friction 0 and e 0, its tangent rows 0.

   RULE. Contacts that approach faster than `still` collide, in rounds, until none is left; those that share no
   coupling in G do so independently. In a round:
     1. compression without friction: impulses lam >= 0, no contact approaches any more;
     2. restitution: impulses e_i lam_i more, e_i of the contact's own approach in this round, all scaled by one
        s <= 1 if they would add energy together (never for a single contact);
     3. Coulomb friction with the parting speeds of 2 held, scaled by one th <= 1 if it would add energy.
   Smith, Kaufman, Vouga, Tamstorf and Grinspun (ACM TOG 31(4) 106, 2012) collide the approaching set in rounds
   with one e for all; here each contact has its own, and energy is bounded as the work of the impulses,
   p.(u before + u after)/2, which needs no masses. That frictional Poisson impacts can gain energy: Glocker
   (Multibody Syst. Dyn. 29, 2013). Rounds are limited to 4n + 40: what then still approaches is left to rest. */

#ifndef HCB_IMPACTS_C
#define HCB_IMPACTS_C

#include <string.h>

#include "exact_step.c"

#define HCB_SWEEPS 200
#define HCB_RESTING_SWEEPS 30
#define HCB_SETTLED 1e-12 /* of the approach: a sweep that changes less is the last */
#define HCB_LEAST_FRICTION 1e-9

enum { HCB_LAW = 0, HCB_LINEAR = 1, HCB_CONSTANT = 2 };

/* kind, value: e is that of eq. (16) for alpha = value, or 1 - value v, or value. friction: Coulomb's coefficient.
   still: m/s, approaches up to it are no impacts. bonus: m/s added to the parting speed, as far as e <= 1 (what
   gravity takes in the step, where speeds at the step's end are meant). */
typedef struct {
  int kind;
  double value, friction, still, bonus;
} hcb_contact;

/* e at an approach of `speed` > 0 m/s. */
double hcb_contact_restitution(const hcb_contact* c, double speed) {
  double e = c->kind == HCB_CONSTANT ? c->value
             : c->kind == HCB_LINEAR ? 1 - c->value * speed
                                     : hcb_restitution(1.5 * c->value * speed);
  return fmin(1, fmax(0, e) + fmax(0, c->bonus) / speed);
}

size_t hcb_impacts_work(int n) { return 9 * (size_t)n * n + 21 * (size_t)n; }

void hcb_coupling(int n, int nv, const double* J, const double* B, double* G) {
  for (int i = 0; i < 3 * n; i++) {
    for (int j = 0; j <= i; j++) {
      double sum = 0;
      for (int k = 0; k < nv; k++) sum += J[(size_t)i * nv + k] * B[(size_t)j * nv + k];
      G[(size_t)i * 3 * n + j] = G[(size_t)j * 3 * n + i] = sum;
    }
  }
}

/* Contacts that collide together, as local arrays: m rows are 3 each. G is symmetric. */
typedef struct {
  int n, m;
  double *G, *before, *lam, *add, *target, *p, *v, *best_p, *best_v;
} hcb_group;

static void add_impulse(const hcb_group* g, int row, double impulse, double* v) {
  const double* column = g->G + (size_t)row * g->m;
  if (impulse == 0) return;
  for (int j = 0; j < g->m; j++) v[j] += column[j] * impulse;
}

/* Work of impulses that take the rates from u to v: the change of the kinetic energy. */
static double work_of(int m, const double* p, const double* u, const double* v) {
  double sum = 0;
  for (int i = 0; i < m; i++) sum += p[i] * (u[i] + v[i]);
  return 0.5 * sum;
}

/* The share t of 0 ... 1 up to which e0 + lin t + quad t^2 stays below 0; e0 <= 0 <= quad. */
static double share_within(double e0, double lin, double quad) {
  double root = sqrt(fmax(0, lin * lin - 4 * quad * fmin(0, e0)));
  double t = lin > 0 ? -2 * fmin(0, e0) / (lin + root) : quad > 0 ? (root - lin) / (2 * quad) : 0;
  return fmin(1, fmax(0, t));
}

static double diagonal(const hcb_group* g, int row) { return g->G[(size_t)row * g->m + row]; }

/* 1/largest eigenvalue of a contact's tangential block. */
static double tangential_step(const hcb_group* g, int i) {
  double a = diagonal(g, 3 * i + 1), b = g->G[(size_t)(3 * i + 1) * g->m + 3 * i + 2], d = diagonal(g, 3 * i + 2);
  double largest = 0.5 * (a + d) + sqrt(0.25 * (a - d) * (a - d) + b * b);
  return largest > 0 ? 1 / largest : 0;
}

/* Frictionless compression into p and v; lam keeps its normal impulses. */
static void compress(hcb_group* g) {
  double fastest = 0, lin = 0, quad = 0;
  memcpy(g->v, g->before, g->m * sizeof(double));
  for (int i = 0; i < g->n; i++) {
    double u = g->before[3 * i];
    g->lam[i] = -u / diagonal(g, 3 * i);
    fastest = fmax(fastest, -u);
    add_impulse(g, 3 * i, g->lam[i], g->v);
  }
  if (g->n == 1) {
    g->v[0] = 0;
    return;
  }
  for (int round = 0; round < 2; round++) { /* the same share of all, then sweeps; the last scaling bounds energy */
    for (int sweep = 0; round && sweep < HCB_SWEEPS; sweep++) {
      double change = 0;
      for (int i = 0; i < g->n; i++) {
        double W = diagonal(g, 3 * i), d = fmax(-g->lam[i], -g->v[3 * i] / W);
        g->lam[i] += d;
        add_impulse(g, 3 * i, d, g->v);
        change = fmax(change, fabs(d) * W);
      }
      if (change < HCB_SETTLED * fastest) break;
    }
    lin = quad = 0;
    for (int i = 0; i < g->n; i++) {
      lin -= g->lam[i] * g->before[3 * i];
      quad += g->lam[i] * (g->v[3 * i] - g->before[3 * i]);
    }
    double scale = quad > 0 ? lin / quad : 0;
    for (int i = 0; i < g->n; i++) g->lam[i] *= scale;
    for (int j = 0; j < g->m; j++) g->v[j] = g->before[j] + scale * (g->v[j] - g->before[j]);
  }
}

/* What each contact gives back, as far as the energy of the compression reaches; p and v are after it. */
static void restitute(hcb_group* g, const hcb_contact* c, const int* of) {
  double loss = 0, lin = 0, quad = 0, s = 1;
  memset(g->p, 0, g->m * sizeof(double));
  memset(g->add, 0, g->m * sizeof(double));
  for (int i = 0; i < g->n; i++) {
    g->p[3 * i] = hcb_contact_restitution(c + of[i], -g->before[3 * i]) * g->lam[i];
    add_impulse(g, 3 * i, g->p[3 * i], g->add);
    loss -= 0.5 * g->lam[i] * (g->before[3 * i] + g->v[3 * i]);
  }
  for (int i = 0; i < g->n; i++) {
    lin += g->p[3 * i] * g->v[3 * i];
    quad += g->p[3 * i] * g->add[3 * i];
  }
  if (g->n > 1 && 0.5 * quad + lin > loss) s = share_within(-loss, lin, 0.5 * quad);
  for (int i = 0; i < g->n; i++) g->p[3 * i] = g->lam[i] + s * g->p[3 * i];
  for (int j = 0; j < g->m; j++) g->v[j] += s * g->add[j];
}

/* One sweep of Coulomb's law with the parting speeds held, tangential steps scaled by `scale`; largest change. */
static double friction_sweep(hcb_group* g, const hcb_contact* c, const int* of, double scale, int tangents) {
  double change = 0;
  for (int i = 0; i < g->n; i++) {
    double W = diagonal(g, 3 * i), *p = g->p + 3 * i, *v = g->v + 3 * i, d = fmax(-p[0], (g->target[i] - v[0]) / W);
    p[0] += d;
    add_impulse(g, 3 * i, d, g->v);
    change = fmax(change, fabs(d) * W);
    double step = scale * tangential_step(g, i), limit = c[of[i]].friction * p[0];
    if (!tangents || step == 0) continue;
    double t1 = p[1] - step * v[1], t2 = p[2] - step * v[2], size = hypot(t1, t2), share = size > limit ? limit / size : 1;
    double d1 = share * t1 - p[1], d2 = share * t2 - p[2];
    p[1] += d1;
    p[2] += d2;
    add_impulse(g, 3 * i + 1, d1, g->v);
    add_impulse(g, 3 * i + 2, d2, g->v);
    change = fmax(change, hypot(d1, d2) / step * scale);
  }
  return change;
}

static int cones_kept(const hcb_group* g, const hcb_contact* c, const int* of) {
  for (int i = 0; i < g->n; i++) {
    if (hypot(g->p[3 * i + 1], g->p[3 * i + 2]) > 1.01 * c[of[i]].friction * g->p[3 * i]) return 0;
  }
  return 1;
}

/* The same start for all contacts at once, so that what is symmetric stays so. */
static void start_friction(hcb_group* g, const hcb_contact* c, const int* of) {
  double lin = 0, quad = 0;
  memset(g->add, 0, g->m * sizeof(double));
  for (int i = 0; i < g->n; i++) {
    double step = tangential_step(g, i), *t = g->p + 3 * i, limit = c[of[i]].friction * t[0], *v = g->v + 3 * i;
    double size = step * hypot(v[1], v[2]), share = size > limit ? limit / size : 1;
    for (int k = 1; k < 3; k++) {
      t[k] = -share * step * v[k];
      add_impulse(g, 3 * i + k, t[k], g->add);
      lin -= t[k] * v[k];
    }
  }
  for (int i = 0; i < g->n; i++) {
    for (int k = 1; k < 3; k++) quad += g->p[3 * i + k] * g->add[3 * i + k];
  }
  double scale = quad > 0 ? fmin(1, lin / quad) : 0;
  for (int i = 0; i < g->n; i++) {
    for (int k = 1; k < 3; k++) g->p[3 * i + k] *= scale;
  }
  for (int j = 0; j < g->m; j++) g->v[j] += scale * g->add[j];
}

static void rub(hcb_group* g, const hcb_contact* c, const int* of) {
  double most = 0, fastest = 0, change = INFINITY, e0, e1, lin = 0, quad = 0, th = 1;
  for (int i = 0; i < g->n; i++) {
    if (g->p[3 * i] > 0) most = fmax(most, c[of[i]].friction);
    for (int k = 0; k < 3; k++) fastest = fmax(fastest, fabs(g->before[3 * i + k]));
  }
  if (most < HCB_LEAST_FRICTION) return;
  memcpy(g->best_p, g->p, g->m * sizeof(double));
  memcpy(g->best_v, g->v, g->m * sizeof(double));
  for (int i = 0; i < g->n; i++) g->target[i] = g->p[3 * i] > 0 ? g->v[3 * i] : fmin(g->v[3 * i], 0);
  if (g->n > 1) start_friction(g, c, of);
  double settled = HCB_SETTLED * fastest;
  for (double scale = 1; scale > 0.1 && change > settled; scale *= 0.5) {
    for (int sweep = 0; sweep < HCB_SWEEPS && change > settled; sweep++) change = friction_sweep(g, c, of, scale, 1);
  }
  for (int sweep = 0; sweep < HCB_SWEEPS && change > 0.01 * settled; sweep++) {
    change = friction_sweep(g, c, of, 1, 0); /* the parting speeds come last: they are exact, the cones nearly */
    if (g->n == 1) break;
  }
  e0 = work_of(g->m, g->best_p, g->before, g->best_v);
  e1 = work_of(g->m, g->p, g->before, g->v);
  if (!(change <= 1e-6 * fastest || g->n == 1) || !cones_kept(g, c, of)) th = 0;
  for (int j = 0; j < g->m; j++) {
    lin += (g->p[j] - g->best_p[j]) * g->best_v[j];
    quad += 0.5 * (g->p[j] - g->best_p[j]) * (g->v[j] - g->best_v[j]);
  }
  if (e1 > 0 && th > 0) th = share_within(e0, lin, quad);
  for (int j = 0; th < 1 && j < g->m; j++) {
    g->p[j] = g->best_p[j] + th * (g->p[j] - g->best_p[j]);
    g->v[j] = g->best_v[j] + th * (g->v[j] - g->best_v[j]);
  }
}

static int coupled(const double* G, int rows, int i, int j) {
  for (int k = 0; k < 9; k++) {
    if (G[(size_t)(3 * i + k / 3) * rows + 3 * j + k % 3] != 0) return 1;
  }
  return 0;
}

/* Takes from `waiting` the contacts that are coupled to its last one, directly or by others; into `of`. */
static int take_group(const double* G, int rows, int* waiting, int* left, int* of) {
  int n = 1;
  of[0] = waiting[--*left];
  for (int k = 0; k < n; k++) {
    for (int j = *left - 1; j >= 0; j--) {
      if (!coupled(G, rows, of[k], waiting[j])) continue;
      of[n++] = waiting[j];
      memmove(waiting + j, waiting + j + 1, (--*left - j) * sizeof(int));
    }
  }
  return n;
}

static hcb_group group_of(int n, const int* of, const double* G, int rows, const double* u, double* work) {
  int m = 3 * n;
  hcb_group g = {.n = n, .m = m, .G = work};
  double** arrays[] = {&g.before, &g.add, &g.p, &g.v, &g.best_p, &g.best_v};
  double* next = work + (size_t)m * m;
  for (int k = 0; k < 6; k++, next += m) *arrays[k] = next;
  g.lam = next;
  g.target = next + n;
  for (int i = 0; i < m; i++) {
    int row = 3 * of[i / 3] + i % 3;
    g.before[i] = u[row];
    for (int j = 0; j < m; j++) g.G[(size_t)i * m + j] = G[(size_t)row * rows + 3 * of[j / 3] + j % 3];
  }
  return g;
}

static void collide_group(int n, const int* of, const double* G, int rows, const hcb_contact* c, double* u, double* p,
                          double* work) {
  hcb_group g = group_of(n, of, G, rows, u, work);
  compress(&g);
  restitute(&g, c, of);
  rub(&g, c, of);
  for (int i = 0; i < g.m; i++) {
    int row = 3 * of[i / 3] + i % 3;
    p[row] += g.p[i];
    for (int j = 0; j < rows && g.p[i] != 0; j++) u[j] += G[(size_t)row * rows + j] * g.p[i];
  }
}

/* How fast contacts that rest will slip: about, by a few sweeps with e = 0 from the rates u that they would have
   without each other. rests[i]: which ones; slip[i] of the others is 0. */
void hcb_resting_slip(int n, const double* G, const hcb_contact* c, const double* u, const int* rests, double* slip,
                      double* work) {
  int *of = (int*)(work + 9 * (size_t)n * n + 20 * (size_t)n), count = 0;
  for (int i = 0; i < n; i++) {
    slip[i] = 0;
    if (rests[i] && G[(size_t)9 * n * i + 3 * i] > 0) of[count++] = i;
  }
  hcb_group g = group_of(count, of, G, 3 * n, u, work);
  memset(g.p, 0, g.m * sizeof(double));
  memset(g.target, 0, count * sizeof(double));
  memcpy(g.v, g.before, g.m * sizeof(double));
  for (int sweep = 0; sweep < HCB_RESTING_SWEEPS; sweep++) friction_sweep(&g, c, of, 1, 1);
  for (int i = 0; i < count; i++) slip[of[i]] = hypot(g.v[3 * i + 1], g.v[3 * i + 2]);
}

/* See the top of the file. Contacts whose normal row cannot move (G 0) are left alone. */
int hcb_impacts(int n, const double* G, const hcb_contact* c, double* u, double* p, double* work) {
  int rows = 3 * n, round, *waiting = (int*)(work + 9 * (size_t)n * n + 20 * (size_t)n), *of = waiting + n;
  memset(p, 0, rows * sizeof(double));
  for (round = 0; round < 4 * n + 40; round++) {
    int left = 0;
    for (int i = n - 1; i >= 0; i--) {
      if (-u[3 * i] > fmax(c[i].still, 0) && G[(size_t)3 * i * rows + 3 * i] > 0) waiting[left++] = i;
    }
    if (left == 0) break;
    while (left > 0) collide_group(take_group(G, rows, waiting, &left, of), of, G, rows, c, u, p, work);
  }
  return round;
}

#endif
