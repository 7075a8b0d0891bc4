/* Contacts that collide together in one instant: compression, restitution and friction, the RULE of impacts.c. */

#ifndef HCB_COLLISION_C
#define HCB_COLLISION_C

#include <string.h>

#include "contact_rows.c"
#include "exact_step.c"

#define HCB_SWEEPS 200
#define HCB_SETTLED 1e-12 /* of the approach: a sweep that changes less is the last, */
#define HCB_RUBBED 1e-9   /* and of several contacts' friction */
#define HCB_FOLLOWED 10 /* sweeps of normal impulses after which one is followed on; */
#define HCB_LEAP 6 /* sweeps of friction after which those to come are guessed, */
#define HCB_KEPT 4 /* from the last of them; */
#define HCB_ALIKE 1e-10 /* of a sweep's change: what is as near to those before is the same */
#define HCB_STALLED 0.9995 /* where they shrink by no less than that; else they lead nowhere, */
#define HCB_NOWHERE 1e-5 /* by no more than that of the approach; */
#define HCB_NO_LESS 0.9  /* nor do those of friction that shrink by no less from leap to leap */
#define HCB_LEAST_FRICTION 1e-9
#define HCB_CONE_ROUNDING 1e-6

enum { HCB_LAW = 0, HCB_LINEAR = 1, HCB_CONSTANT = 2 };

/* kind, value: e is that of eq. (16) for alpha = value, or 1 - value v, or value. friction: Coulomb's coefficient.
   still: m/s, approaches up to it do not count as impacts. lift, (m/s)^2, and lag, m/s: e is of the speeds
   U = sqrt(u^2 - lift) - lag where the rates here are u; hcb_under_gravity sets them. */
typedef struct hcb_contact {
  int kind;
  double value, friction, still, lift, lag;
} hcb_contact;

/* e at an approach of `speed` > 0 m/s. */
double hcb_contact_restitution(const hcb_contact* c, double speed) {
  double at_plane = c->lift ? sqrt(fmax(0, speed * speed - c->lift)) : fmax(0, speed - c->lag);
  double e = c->kind == HCB_CONSTANT ? c->value
             : c->kind == HCB_LINEAR ? 1 - c->value * at_plane
                                     : hcb_restitution(1.5 * c->value * at_plane);
  double out = fmin(1, fmax(0, e)) * at_plane;
  return fmin(1, (c->lift ? sqrt(fmax(0, out * out + c->lift)) : fmax(0, out - c->lag)) / speed);
}

/* A contact at depth x with approach v that gravity accelerates by b towards contact; `still` as a speed v. Steps that
   move by the new velocity, v' = v + h b, x' = x + h v', keep u^2 - 2 b x in flight, u = v + b h/2: its root at x = 0 is
   the speed at the touch plane, which e is of, and impacts are between rates u. As none parts faster than it came, what
   flight keeps never grows: the kinetic energy of the rates u, less the work of gravity. Steps that are exact in flight
   keep v^2 - 2 b x, and u is v. In contacts that touched before this step e is of v. */
void hcb_under_gravity(hcb_contact* c, double x, double v, double b, double h, int exact_flight) {
  double half = exact_flight ? 0 : b * h / 2, still = c->still + half;
  if (x > h * v * (1 + 1e-9)) {
    c->lag = half;
    c->still = still;
    return;
  }
  c->lift = 2 * b * x;
  c->still = sqrt(fmax(0, still * still + fmin(0, c->lift))); /* turned before touch: as fast there */
}

/* Contacts `of` a system that collide together, and the parts they touch. Rates are base + J v, with velocities v as
   long as the system's, of which those of `part` count. */
typedef struct {
  const hcb_system* s;
  int n, parts;
  const int *of, *part;
  double *base, *before, *block, *lam, *target, *p, *best_p, *v, *add, *best_v, *kept_p; /* block: J M^-1 J^T, 9 each;
      kept_p: HCB_KEPT times as long as p */
} hcb_group;

/* fmax is a call, as it asks of a and b whether they are numbers: of b alone here. */
static double larger(double a, double b) { return b > a ? b : a; }

static double length(double x, double y) { return sqrt(x * x + y * y); } /* hypot is five times as dear */

static double rate_in(const hcb_group* g, int i, int k, const double* v) {
  return g->base[3 * i + k] + rate_of(g->s, g->of[i], k, v);
}

static void add_impulse(const hcb_group* g, int i, int k, double impulse, double* v) {
  if (impulse != 0) push_system(g->s, g->of[i], k, impulse, v);
}

/* v = from + share (to - from) over the group's parts; from NULL: 0. */
static void blend(const hcb_group* g, double* v, const double* from, const double* to, double share) {
  for (int q = 0; q < g->parts; q++) {
    for (int j = g->s->at[g->part[q]]; j < g->s->at[g->part[q] + 1]; j++) {
      v[j] = from ? from[j] + share * (to[j] - from[j]) : share * to[j];
    }
  }
}

static void clear(const hcb_group* g, double* v) {
  for (int q = 0; q < g->parts; q++) {
    memset(v + g->s->at[g->part[q]], 0, (g->s->at[g->part[q] + 1] - g->s->at[g->part[q]]) * sizeof(double));
  }
}

static double work_of(const hcb_group* g, const double* p, const double* v) {
  double sum = 0;
  for (int i = 0; i < 3 * g->n; i++) sum += p[i] * (g->before[i] + rate_in(g, i / 3, i % 3, v));
  return 0.5 * sum;
}

/* The share t of 0 ... 1 up to which e0 + lin t + quad t^2 stays below 0; e0 <= 0 <= quad. */
static double share_within(double e0, double lin, double quad) {
  double root = sqrt(fmax(0, lin * lin - 4 * quad * fmin(0, e0)));
  double t = lin > 0 ? -2 * fmin(0, e0) / (lin + root) : quad > 0 ? (root - lin) / (2 * quad) : 0;
  return fmin(1, fmax(0, t));
}

/* Into lam, which only compression and restitution need: 1/largest eigenvalue of each contact's tangential block. */
static void set_steps(hcb_group* g) {
  for (int i = 0; i < g->n; i++) {
    const double* block = g->block + 9 * i;
    double a = block[4], b = block[5], d = block[8];
    double largest = 0.5 * (a + d) + sqrt(0.25 * (a - d) * (a - d) + b * b);
    g->lam[i] = largest > 0 ? 1 / largest : 0;
  }
}

/* Goes on as in the sweep from kept_p, which changed `ratio` of what the one before did: to where such sweeps lead, or until the first
   impulse ends. Contacts of one face whose parting speeds no motion of it can all have push against each other, by about as much in
   each sweep, until one lets go. */
static void follow_sweep(hcb_group* g, double ratio) {
  double most = ratio < 1 ? ratio / (1 - ratio) : INFINITY;
  for (int i = 0; i < g->n; i++) {
    double less = g->kept_p[i] - g->lam[i];
    if (less > 0) most = fmin(most, g->lam[i] / less);
  }
  for (int i = 0; i < g->n && most < INFINITY; i++) {
    double more = fmax(-g->lam[i], most * (g->lam[i] - g->kept_p[i]));
    g->lam[i] += more;
    add_impulse(g, i, 0, more, g->v);
  }
}

/* Normal impulses into p, lam and v, so that no contact approaches any more and each that has one parts at the e of its own
   approach: 0 <= lam, W lam + (1 + e) u >= 0, one of them 0. Its kinetic energy changes by lam.(1 - e) u/2 <= 0, for
   any e, as u < 0. */
static void bounce(hcb_group* g) {
  double fastest = 0;
  memset(g->p, 0, 3 * g->n * sizeof(double));
  if (g->n == 1) { /* its velocities are its rates (make_few in impacts.c): it stops, exactly, and is sent back */
    double u = g->before[0], stop = -u / g->block[0], back = hcb_contact_restitution(g->s->c + g->of[0], -u) * stop;
    add_impulse(g, 0, 0, stop, g->v);
    g->v[0] = 0;
    add_impulse(g, 0, 0, back, g->v);
    g->p[0] = stop + back;
    return;
  }
  for (int i = 0; i < g->n; i++) {
    double u = g->before[3 * i];
    g->target[i] = -u * hcb_contact_restitution(g->s->c + g->of[i], -u);
    g->lam[i] = (g->target[i] - u) / g->block[9 * i];
    fastest = fmax(fastest, -u);
    add_impulse(g, i, 0, g->lam[i], g->v);
  }
  for (int round = 0; round < 2; round++) { /* the same share of all, then sweeps; the last scaling bounds energy */
    double lin = 0, quad = 0, last = INFINITY;
    for (int sweep = 1; round && sweep <= HCB_SWEEPS; sweep++) {
      double change = 0;
      int follows = sweep % HCB_FOLLOWED == 0;
      if (follows) memcpy(g->kept_p, g->lam, g->n * sizeof(double));
      for (int i = 0; i < g->n; i++) {
        double W = g->block[9 * i], d = fmax(-g->lam[i], (g->target[i] - rate_in(g, i, 0, g->v)) / W);
        g->lam[i] += d;
        add_impulse(g, i, 0, d, g->v);
        change = fmax(change, fabs(d) * W);
      }
      if (change < HCB_SETTLED * fastest) break;
      if (follows) follow_sweep(g, change / last);
      last = change;
    }
    for (int i = 0; i < g->n; i++) {
      lin += g->lam[i] * (g->target[i] - g->before[3 * i]);
      quad += g->lam[i] * (rate_in(g, i, 0, g->v) - g->before[3 * i]);
    }
    double scale = quad > 0 ? lin / quad : 0;
    for (int i = 0; i < g->n; i++) g->lam[i] *= scale;
    blend(g, g->v, NULL, g->v, scale);
  }
  for (int i = 0; i < g->n; i++) g->p[3 * i] = g->lam[i];
}

/* One sweep of Coulomb's law with the parting speeds held, tangential steps scaled by `scale`; largest change. */
static double friction_sweep(hcb_group* g, double scale, int tangents) {
  double change = 0;
  for (int i = 0; i < g->n; i++) {
    double W = g->block[9 * i], *p = g->p + 3 * i, d = larger(-p[0], (g->target[i] - rate_in(g, i, 0, g->v)) / W);
    p[0] += d;
    add_impulse(g, i, 0, d, g->v);
    change = larger(change, fabs(d) * W);
    double step = scale * g->lam[i], limit = g->s->c[g->of[i]].friction * p[0], u[2], dt[2];
    if (!tangents || step == 0) continue;
    tangent_rates(g->s, g->of[i], g->v, u);
    double t1 = p[1] - step * (g->base[3 * i + 1] + u[0]), t2 = p[2] - step * (g->base[3 * i + 2] + u[1]);
    double size = length(t1, t2), share = size > limit ? limit / size : 1;
    dt[0] = share * t1 - p[1], dt[1] = share * t2 - p[2];
    p[1] += dt[0];
    p[2] += dt[1];
    if (dt[0] != 0 || dt[1] != 0) push_tangents(g->s, g->of[i], dt, g->v);
    change = larger(change, length(dt[0], dt[1]) / step * scale);
  }
  return change;
}

/* Whether friction is within Coulomb's, but for a rounding of the largest: a contact that is about to part, as that at the back of a
   box that nearly tips, bears next to nothing. */
static int cones_kept(const hcb_group* g) {
  double largest = 0;
  for (int i = 0; i < g->n; i++) largest = larger(largest, g->p[3 * i]);
  for (int i = 0; i < g->n; i++) {
    double limit = g->s->c[g->of[i]].friction * g->p[3 * i];
    if (length(g->p[3 * i + 1], g->p[3 * i + 2]) > 1.01 * limit + HCB_CONE_ROUNDING * largest) return 0;
  }
  return 1;
}

/* The same start for all contacts at once, so that what is symmetric stays so. */
static void start_friction(hcb_group* g) {
  double lin = 0, quad = 0;
  clear(g, g->add);
  for (int i = 0; i < g->n; i++) {
    double step = g->lam[i], *t = g->p + 3 * i, limit = g->s->c[g->of[i]].friction * t[0];
    double u[3] = {0, rate_in(g, i, 1, g->v), rate_in(g, i, 2, g->v)};
    double size = step * length(u[1], u[2]), share = size > limit ? limit / size : 1;
    for (int k = 1; k < 3; k++) {
      t[k] = -share * step * u[k];
      add_impulse(g, i, k, t[k], g->add);
      lin -= t[k] * u[k];
    }
  }
  for (int i = 0; i < g->n; i++) {
    for (int k = 1; k < 3; k++) quad += g->p[3 * i + k] * rate_of(g->s, g->of[i], k, g->add);
  }
  double scale = quad > 0 ? fmin(1, lin / quad) : 0;
  for (int i = 0; i < g->n; i++) {
    for (int k = 1; k < 3; k++) g->p[3 * i + k] *= scale;
  }
  for (int q = 0; q < g->parts; q++) {
    for (int j = g->s->at[g->part[q]]; j < g->s->at[g->part[q] + 1]; j++) g->v[j] += scale * g->add[j];
  }
}

static double squared_change(const double* from, const double* to, int count) {
  double sum = 0;
  for (int j = 0; j < count; j++) sum += (to[j] - from[j]) * (to[j] - from[j]);
  return sum;
}

/* The sweeps to come at once, from the impulses before each of the last ones: contacts of one face bear what they bear in many
   ways, and sweeps settle slowly along these. Of all means of the last impulses this takes the one whose sweep would change least,
   were sweeps linear (reduced rank extrapolation: Eddy, in Information Linkage between Applied Mathematics and Industry, 1979).
   What leaves the cones by that the next sweep puts back, and how much a sweep changes tells as before whether they have settled. */
static void leap(hcb_group* g) {
  int rows = 3 * g->n;
  double L[HCB_KEPT][HCB_KEPT], share[HCB_KEPT], sum = 0;
  const double* x[HCB_KEPT + 1];
  for (int i = 0; i <= HCB_KEPT; i++) x[i] = i < HCB_KEPT ? g->kept_p + i * rows : g->p;
  for (int i = 0; i < HCB_KEPT; i++) {
    for (int k = 0; k <= i; k++) {
      double product = 0;
      for (int j = 0; j < rows; j++) product += (x[i + 1][j] - x[i][j]) * (x[k + 1][j] - x[k][j]);
      for (int j = 0; j < k; j++) product -= L[i][j] * L[k][j];
      L[i][k] = i == k ? sqrt(fmax(product, 0) + HCB_ALIKE * squared_change(x[i], x[i + 1], rows)) : product / L[k][k];
    }
    if (!(L[i][i] > 0)) return;
  }
  for (int i = 0; i < HCB_KEPT; i++) { /* L L^T share = 1 */
    share[i] = 1;
    for (int j = 0; j < i; j++) share[i] -= L[i][j] * share[j];
    share[i] /= L[i][i];
  }
  for (int i = HCB_KEPT - 1; i >= 0; i--) {
    for (int j = i + 1; j < HCB_KEPT; j++) share[i] -= L[j][i] * share[j];
    share[i] /= L[i][i];
    sum += share[i];
  }
  if (!(sum > 0)) return;
  for (int j = 0; j < rows; j++) {
    double mean = 0;
    for (int i = 0; i < HCB_KEPT; i++) mean += share[i] / sum * x[i + 1][j];
    g->p[j] = mean;
  }
  clear(g, g->v);
  for (int k = 0; k < rows; k++) add_impulse(g, k / 3, k % 3, g->p[k], g->v);
}

/* Sweeps until one changes no more than `settled`; the change of the last, 0 where more would lead nowhere. */
static double sweep_until(hcb_group* g, double scale, int tangents, double fastest, double settled) {
  double change = INFINITY, before = INFINITY; /* before: at the last leap */
  for (int sweep = 1; sweep <= HCB_SWEEPS && change > settled; sweep++) {
    int leaps = g->n > 1 && sweep % HCB_LEAP == 0 && sweep < HCB_SWEEPS, kept = (sweep - 1) % HCB_LEAP - HCB_LEAP + HCB_KEPT;
    double last = change;
    if (g->n > 1 && kept >= 0) memcpy(g->kept_p + 3 * g->n * kept, g->p, 3 * g->n * sizeof(double));
    change = friction_sweep(g, scale, tangents);
    if (leaps && change > settled && change < HCB_STALLED * last) leap(g);
    if (leaps && change >= HCB_STALLED * last && change < HCB_NOWHERE * fastest) return 0; /* impulses of a face against each other */
    if (leaps && tangents && change >= HCB_NO_LESS * before && change < HCB_NOWHERE * fastest) return 0; /* rounding, which leaps keep up */
    if (leaps) before = change;
    if (g->n == 1 && !tangents) break;
  }
  return change;
}

/* Sweeps until they settle; whether they did, and the cones are kept. */
static int settle(hcb_group* g, double fastest) {
  double change = INFINITY, rubbed = (g->n > 1 ? HCB_RUBBED : HCB_SETTLED) * fastest;
  for (double scale = 1; scale > 0.1 && change > rubbed; scale *= 0.5) change = sweep_until(g, scale, 1, fastest, rubbed);
  /* The parting speeds come last: they are exact, the cones nearly. */
  if (g->n > 1 || change > 0.01 * rubbed) change = sweep_until(g, 1, 0, fastest, HCB_SETTLED * fastest);
  return (change <= 1e-6 * fastest || g->n == 1) && cones_kept(g);
}

static void rub(hcb_group* g) {
  double most = 0, fastest = 0, lin = 0, quad = 0, th = 1;
  for (int i = 0; i < g->n; i++) {
    if (g->p[3 * i] > 0) most = fmax(most, g->s->c[g->of[i]].friction);
    for (int k = 0; k < 3; k++) fastest = fmax(fastest, fabs(g->before[3 * i + k]));
  }
  if (most < HCB_LEAST_FRICTION) return;
  set_steps(g);
  memcpy(g->best_p, g->p, 3 * g->n * sizeof(double));
  blend(g, g->best_v, NULL, g->v, 1);
  for (int i = 0; i < g->n; i++) {
    double u = rate_in(g, i, 0, g->v);
    g->target[i] = g->p[3 * i] > 0 ? u : fmin(u, 0);
  }
  if (g->n > 1) start_friction(g);
  if (!settle(g, fastest)) th = 0;
  double e0 = work_of(g, g->best_p, g->best_v), e1 = work_of(g, g->p, g->v);
  for (int i = 0; i < 3 * g->n; i++) {
    double held = rate_in(g, i / 3, i % 3, g->best_v), rubbed = rate_in(g, i / 3, i % 3, g->v);
    lin += (g->p[i] - g->best_p[i]) * held;
    quad += 0.5 * (g->p[i] - g->best_p[i]) * (rubbed - held);
  }
  if (e1 > 0 && th > 0) th = share_within(e0, lin, quad);
  if (th >= 1) return;
  for (int i = 0; i < 3 * g->n; i++) g->p[i] = g->best_p[i] + th * (g->p[i] - g->best_p[i]);
  blend(g, g->v, g->best_v, g->v, th);
}

#endif
