/* Impacts of rigid bodies in one instant, several contacts at once, with friction; the kinetic energy never grows.

   INTERFACE (no engine's types; include this file, which brings collision.c and exact_step.c along):

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

#include "collision.c"

#define HCB_RESTING_SWEEPS 30

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
