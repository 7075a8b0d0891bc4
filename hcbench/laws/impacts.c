/* Impacts of rigid bodies in one instant, several contacts at once, with friction; the kinetic energy never grows.

   INTERFACE (no engine's types; include this file, which brings collision.c, contact_rows.c and exact_step.c along):

     hcb_contact c[n]   what each contact is: e over its approach speed, friction, what counts as rest
     hcb_rows r[n]      rates of the contacts u = J v over the velocities of the (at most two) parts that meet, and M^-1 J^T
     int at[parts + 1]  part q, a body or tree, has the velocities at[q] ... at[q + 1] - 1; one not touched has none
     hcb_system s = {n, parts, at, r, c}
     double u[3n]       rates before the impacts, without what this step's forces add; after: rates after them
     double p[3n]       out: impulses along the rows, N s; v after = v + sum of p[k] B[k]
     double work[hcb_impacts_work(n, parts, at[parts])]   room; nothing is allocated
     rounds = hcb_impacts(&s, u, p, work)

   Then give the bodies the impulses p, before the step's own forces act, and let contacts that are left without
   approach, or with no more than `still`, rest by the engine's own contact with e = 0. Bodies that cannot move
   have no part in J. A one-sided limit is a contact with friction 0 and e 0, its tangent rows 0.

   RULE. Contacts that approach faster than `still` collide, in rounds, until none is left; those that share no
   part do so independently. In a round:
     1. impulses without friction: no contact approaches any more, and each that has an impulse parts at the e of its
        own approach in this round; the others, which those push, part faster. That loses energy for any e;
     2. Coulomb friction with the parting speeds of 1 held, scaled by one th <= 1 if it would add energy.
   Smith, Kaufman, Vouga, Tamstorf and Grinspun (ACM TOG 31(4) 106, 2012) collide the approaching set in rounds
   with one e for all; here each contact has its own, and energy is bounded as the work of the impulses,
   p.(u before + u after)/2, which needs no masses. That frictional Poisson impacts can gain energy: Glocker
   (Multibody Syst. Dyn. 29, 2013). Rounds are limited to 4n + 40 (hcb_most_rounds): what then still approaches is
   left to rest. Energy bounds it, but for a body that is moved against one that cannot move: each round adds what it works. */

#ifndef HCB_IMPACTS_C
#define HCB_IMPACTS_C

#include "collision.c"

#define HCB_RESTING_SWEEPS 10
#define HCB_RESTING_SETTLED 1e-3 /* of the fastest rate: slip is worked out about */
#define HCB_FEW 8 /* contacts of a group whose rates stand for its velocities */

typedef struct { /* room, as `work` is divided */
  double *block, *first, *total, *group;
  int *of, *part, *next, *taken, *head, *seen;
} hcb_room;

size_t hcb_impacts_work(int n, int parts, int nv) {
  return (35 + 3 * HCB_KEPT) * (size_t)n + 4 * ((size_t)nv + 3) + (5 * (size_t)n + 3 * (size_t)parts) / 2 + 2;
}

/* Rounds after which the impacts of n contacts came to no end. */
int hcb_most_rounds(int n) { return 4 * n + 40; }

static hcb_room divide(const hcb_system* s, double* work) {
  int n = s->n, nv = s->at[s->parts];
  hcb_room r = {.block = work, .first = work + 9 * (size_t)n, .total = work + 12 * (size_t)n};
  r.group = r.total + nv + 3;
  r.of = (int*)(r.group + (23 + 3 * HCB_KEPT) * (size_t)n + 3 * ((size_t)nv + 3));
  r.next = r.of + n;
  r.taken = r.next + 2 * (size_t)n;
  r.part = r.taken + n;
  r.head = r.part + s->parts;
  r.seen = r.head + s->parts;
  for (int i = 0; i < n; i++) block_of(s, i, r.block + 9 * (size_t)i);
  return r;
}

/* The contacts r->of, n of them, which touch `parts` of r->part; room as for all. */
static hcb_group group_of(const hcb_system* s, const hcb_room* r, int n, int parts, const double* u) {
  hcb_group g = {.s = s, .n = n, .parts = parts, .of = r->of, .part = r->part};
  size_t nv = s->at[s->parts] + 3, rows = 3 * (size_t)n;
  double **threes[] = {&g.base, &g.before, &g.p, &g.best_p}, **velocities[] = {&g.v, &g.add, &g.best_v}, *next = r->group;
  for (int k = 0; k < 4; k++, next += rows) *threes[k] = next;
  for (int k = 0; k < 3; k++, next += nv) *velocities[k] = next;
  g.block = next;
  g.lam = g.block + 9 * (size_t)n;
  g.target = g.lam + n;
  g.kept_p = g.target + n;
  for (int i = 0; i < n; i++) {
    memcpy(g.before + 3 * i, u + 3 * r->of[i], 3 * sizeof(double));
    memcpy(g.block + 9 * i, r->block + 9 * (size_t)r->of[i], 9 * sizeof(double));
  }
  memcpy(g.base, g.before, rows * sizeof(double));
  clear(&g, g.v);
  return g;
}

typedef struct { /* a few contacts, whose velocities are their rates: no dofs come between them */
  hcb_system s;
  hcb_rows rows[HCB_FEW];
  hcb_contact c[HCB_FEW];
  double B[9 * HCB_FEW * HCB_FEW];
  int at[2], of[HCB_FEW], part;
} hcb_few;

/* Lets the velocities of a group of few contacts be their rates, where there are not more of these than dofs. */
static void make_few(hcb_group* g, hcb_few* few) {
  int n = g->n, dofs = 0, size = 3 * n;
  for (int q = 0; q < g->parts; q++) dofs += g->s->at[g->part[q] + 1] - g->s->at[g->part[q]];
  if (n != 1 && (n == 0 || n > HCB_FEW || size > dofs)) return;
  few->at[0] = few->part = 0;
  few->at[1] = size;
  for (int i = 0; i < n; i++) {
    double* own = few->B + 3 * i * size;
    for (int j = 0; j < i; j++) {
      double block[9];
      couple_contacts(g->s, g->of[j], g->of[i], block);
      for (int k = 0; k < 9; k++) {
        own[k % 3 * size + 3 * j + k / 3] = few->B[(3 * j + k / 3) * size + 3 * i + k % 3] = block[k];
      }
    }
    for (int k = 0; k < 9; k++) own[k / 3 * size + 3 * i + k % 3] = g->block[9 * i + k];
    few->rows[i] = (hcb_rows){{0, -1}, {NULL, NULL}, {own, NULL}};
    few->c[i] = g->s->c[g->of[i]];
    few->of[i] = i;
  }
  few->s = (hcb_system){n, 1, few->at, few->rows, few->c};
  g->s = &few->s;
  g->of = few->of;
  g->part = &few->part;
  g->parts = 1;
  clear(g, g->v);
  if (n > 1) return;
  memset(g->base, 0, 3 * sizeof(double));
  memcpy(g->v, g->before, 3 * sizeof(double));
}

static void collide_group(const hcb_system* s, const hcb_room* r, int n, int parts, double* u, double* p) {
  hcb_group g = group_of(s, r, n, parts, u);
  hcb_few few;
  make_few(&g, &few);
  bounce(&g);
  rub(&g);
  for (int i = 0; i < 3 * n; i++) {
    p[3 * r->of[i / 3] + i % 3] += g.p[i];
    if (g.p[i] != 0) push_system(s, r->of[i / 3], i % 3, g.p[i], r->total);
  }
  if (s->n == 1) memcpy(u, g.v, 3 * sizeof(double));
}

/* Takes into r->of the contacts that are joined to the first one of r->of by parts, in ascending order from each; how many. */
static int take_group(const hcb_system* s, const hcb_room* r, int* parts) {
  int n = 1;
  r->taken[r->of[0]] = 1;
  *parts = 0;
  for (int k = 0; k < n; k++) {
    int list[2] = {-1, -1};
    for (int side = 0; side < 2; side++) {
      int q = s->rows[r->of[k]].part[side];
      if (q < 0 || r->seen[q]) continue;
      r->seen[q] = 1;
      r->part[(*parts)++] = q;
      list[side] = r->head[q];
    }
    while (list[0] >= 0 || list[1] >= 0) {
      int side = list[0] < 0 || (list[1] >= 0 && list[1] / 2 < list[0] / 2), i = list[side] / 2;
      list[side] = r->next[list[side]];
      if (!r->taken[i]) r->taken[i] = 1, r->of[n++] = i;
    }
  }
  return n;
}

/* Contacts that approach into the lists of their parts; how many. */
static int list_approaching(const hcb_system* s, const hcb_room* r, const double* u) {
  int left = 0;
  for (int q = 0; q < s->parts; q++) r->head[q] = -1, r->seen[q] = 0;
  for (int i = s->n - 1; i >= 0; i--) {
    r->taken[i] = !(-u[3 * i] > fmax(s->c[i].still, 0) && r->block[9 * (size_t)i] > 0);
    for (int side = 0; side < 2 && !r->taken[i]; side++) {
      int q = s->rows[i].part[side];
      if (q >= 0) r->next[2 * i + side] = r->head[q], r->head[q] = 2 * i + side;
    }
    left += !r->taken[i];
  }
  return left;
}

/* How fast contacts that rest will slip: about, by a few sweeps with e = 0 from the rates u that they would have
   without each other. rests[i]: which ones; slip[i] of the others is 0. */
void hcb_resting_slip(const hcb_system* s, const double* u, const int* rests, double* slip, double* work) {
  double fastest = 0;
  int count = 0;
  for (int i = 0; i < s->n; i++) slip[i] = 0, count += rests[i] != 0;
  if (count == 0) return; /* most steps in which bodies land: all part */
  count = 0;
  hcb_room r = divide(s, work);
  hcb_few few;
  for (int q = 0; q < s->parts; q++) r.part[q] = q;
  for (int i = 0; i < s->n; i++) {
    if (rests[i] && r.block[9 * (size_t)i] > 0) r.of[count++] = i;
  }
  hcb_group g = group_of(s, &r, count, s->parts, u);
  make_few(&g, &few);
  memset(g.p, 0, 3 * count * sizeof(double));
  memset(g.target, 0, count * sizeof(double));
  set_steps(&g);
  for (int i = 0; i < 3 * count; i++) fastest = larger(fastest, fabs(g.before[i]));
  for (int sweep = 0; sweep < HCB_RESTING_SWEEPS; sweep++) {
    if (friction_sweep(&g, 1, 1) <= HCB_RESTING_SETTLED * fastest) break;
  }
  for (int i = 0; i < count; i++) slip[r.of[i]] = length(rate_in(&g, i, 1, g.v), rate_in(&g, i, 2, g.v));
}

/* See the top of the file. Contacts whose normal row cannot move are left alone. */
int hcb_impacts(const hcb_system* s, double* u, double* p, double* work) {
  hcb_room r = divide(s, work);
  int n = s->n, round;
  memset(p, 0, 3 * (size_t)n * sizeof(double));
  memset(r.total, 0, s->at[s->parts] * sizeof(double));
  memcpy(r.first, u, 3 * (size_t)n * sizeof(double));
  for (round = 0; round < hcb_most_rounds(n) && list_approaching(s, &r, u) > 0; round++) {
    for (int i = 0; i < n; i++) {
      int parts, count;
      if (r.taken[i]) continue;
      r.of[0] = i;
      count = take_group(s, &r, &parts);
      collide_group(s, &r, count, parts, u, p);
    }
    for (int k = 0; n > 1 && k < 3 * n; k++) u[k] = r.first[k] + rate_of(s, k / 3, k % 3, r.total);
  }
  return round;
}

#endif
