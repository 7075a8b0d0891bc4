/* Rates of contacts over the velocities of the parts that meet; memory and work are linear in the contacts. */

#ifndef HCB_CONTACT_ROWS_C
#define HCB_CONTACT_ROWS_C

#include <stddef.h>

/* The rates of a contact over the velocities v of the two parts (bodies, trees) that meet: u_k = J[0][k] v + J[1][k] v, of
   its normal (u > 0 parts) and two tangents; side s holds 3 rows of its part's velocities each. B = M^-1 J^T, row by row. */
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
  for (int side = 0; side < 2 && r->part[side] >= 0; side++) {
    int at = s->at[r->part[side]], size = s->at[r->part[side] + 1] - at;
    const double *row = r->J[side] + (size_t)k * size, *x = v + at;
    for (int j = 0; j < size; j++) sum += row[j] * x[j];
  }
  return sum;
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

/* J M^-1 J^T of one contact, 3 x 3. */
static void block_of(const hcb_system* s, int i, double* block) {
  const hcb_rows* r = s->rows + i;
  for (int k = 0; k < 9; k++) {
    double sum = 0;
    int row = k / 3, column = k % 3;
    if (column > row) continue;
    for (int side = 0; side < 2 && r->part[side] >= 0; side++) {
      int size = s->at[r->part[side] + 1] - s->at[r->part[side]];
      const double *a = r->J[side] + (size_t)row * size, *b = r->B[side] + (size_t)column * size;
      for (int j = 0; j < size; j++) sum += a[j] * b[j];
    }
    block[k] = block[3 * column + row] = sum;
  }
}

#endif
