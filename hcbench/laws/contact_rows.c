/* Rates of contacts over the velocities of the parts that meet; memory and work are linear in the contacts. */

#ifndef HCB_CONTACT_ROWS_C
#define HCB_CONTACT_ROWS_C

#include <stddef.h>
#include <string.h>

/* The rates of a contact over the velocities v of the two parts (bodies, trees) that meet: u_k = J[0][k] v + J[1][k] v, of
   its normal (u > 0 parts) and two tangents; side s holds 3 rows of its part's velocities each. B = M^-1 J^T, row by row.
   J[0] NULL: the velocities of the one part are the rates of all contacts, and B is J M^-1 J^T. */
typedef struct {
  int part[2]; /* the lower one first; -1: none */
  const double *J[2], *B[2];
} hcb_rows;

/* n contacts between parts; part q has the velocities at[q] ... at[q + 1] - 1 of all. */
typedef struct {
  int n, parts;
  const int* at;
  const hcb_rows* rows;
  const struct hcb_contact* c;
} hcb_system;

static double rate_of(const hcb_system* s, int i, int k, const double* v) {
  const hcb_rows* r = s->rows + i;
  double sum = 0;
  if (r->part[0] >= 0 && !r->J[0]) return v[3 * i + k];
  for (int side = 0; side < 2 && r->part[side] >= 0; side++) {
    int at = s->at[r->part[side]], size = s->at[r->part[side] + 1] - at;
    const double *row = r->J[side] + (size_t)k * size, *x = v + at;
    for (int j = 0; j < size; j++) sum += row[j] * x[j];
  }
  return sum;
}

/* Both tangents' rates at once: two sums, each in the order of `rate_of`, that do not wait for each other. */
static void tangent_rates(const hcb_system* s, int i, const double* v, double* out) {
  const hcb_rows* r = s->rows + i;
  double one = 0, two = 0;
  if (r->part[0] >= 0 && !r->J[0]) {
    out[0] = v[3 * i + 1], out[1] = v[3 * i + 2];
    return;
  }
  for (int side = 0; side < 2 && r->part[side] >= 0; side++) {
    int at = s->at[r->part[side]], size = s->at[r->part[side] + 1] - at;
    const double *row = r->J[side] + size, *x = v + at;
    for (int j = 0; j < size; j++) one += row[j] * x[j], two += row[size + j] * x[j];
  }
  out[0] = one, out[1] = two;
}

static void push_system(const hcb_system* s, int i, int k, double impulse, double* v) {
  const hcb_rows* r = s->rows + i;
  for (int side = 0; side < 2 && r->part[side] >= 0; side++) {
    int at = s->at[r->part[side]], size = s->at[r->part[side] + 1] - at;
    const double* row = r->B[side] + (size_t)k * size;
    double* x = v + at;
    for (int j = 0; j < size; j++) x[j] += row[j] * impulse;
  }
}

static void push_tangents(const hcb_system* s, int i, const double* impulse, double* v) {
  const hcb_rows* r = s->rows + i;
  for (int side = 0; side < 2 && r->part[side] >= 0; side++) {
    int at = s->at[r->part[side]], size = s->at[r->part[side] + 1] - at;
    const double* row = r->B[side] + size;
    double* x = v + at;
    for (int j = 0; j < size; j++) x[j] = x[j] + row[j] * impulse[0] + row[size + j] * impulse[1];
  }
}

/* J of contact i times B of contact j: 3 x 3. */
static void couple_contacts(const hcb_system* s, int i, int j, double* block) {
  memset(block, 0, 9 * sizeof(double));
  for (int side = 0; side < 4; side++) {
    int q = s->rows[i].part[side / 2];
    if (q < 0 || q != s->rows[j].part[side % 2]) continue;
    int n = s->at[q + 1] - s->at[q];
    const double *x = s->rows[i].J[side / 2], *y = s->rows[j].B[side % 2];
    for (int d = 0; d < n; d++) {
      double a[3] = {x[d], x[n + d], x[2 * n + d]}, b[3] = {y[d], y[n + d], y[2 * n + d]};
      if (a[0] == 0 && a[1] == 0 && a[2] == 0) continue; /* most dofs of a tree do not move a foot */
      for (int k = 0; k < 9; k++) block[k] += a[k / 3] * b[k % 3];
    }
  }
}

/* J M^-1 J^T of one contact, 3 x 3. */
static void block_of(const hcb_system* s, int i, double* block) {
  couple_contacts(s, i, i, block);
  for (int k = 0; k < 9; k++) block[k] = block[k / 3 > k % 3 ? k : k % 3 * 3 + k / 3];
}

#endif
