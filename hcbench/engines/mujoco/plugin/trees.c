/* Rows of contacts over the dofs of the kinematic trees that meet, and M^-1 of those trees alone: work and memory are
   linear in contacts and dofs. Trees that a tendon of a law or a rigid equality ties are one part. */

#define HCB_RIGID 0.5        /* impedance from which on an equality answers an impact within it */
#define HCB_REDUNDANT 1e-10 /* of an equality's own inverse mass */

#ifndef HCB_M_ROWS /* number of entries, addresses and columns of the rows of qLD */
#define HCB_M_ROWS m->M_rownnz, m->M_rowadr, m->M_colind
#endif

typedef struct {
  int parts, *at;       /* part q has the dofs at[q] ... at[q + 1] - 1 of `dof` */
  int *dof, *place;     /* of the model; of a dof its place in its part */
  int *of_tree;         /* part of each tree */
  int *held, *held_at;  /* rows of rigid equalities, by part */
  double **E, **EB, **K; /* of each part: its equalities' rows, M^-1 of them, and the Cholesky factor of E M^-1 E^T */
} tree_parts;

static int* ints(mjData* d, size_t count) { return mj_stackAllocByte(d, (count + 1) * sizeof(int), sizeof(int)); }

static int top_of(int* above, int tree) {
  while (above[tree] != tree) tree = above[tree] = above[above[tree]];
  return tree;
}

/* Ties all trees of a sparse row together; returns the first. */
static int tie(const mjModel* m, int* above, int count, const int* column) {
  int first = -1;
  for (int k = 0; k < count; k++) {
    int tree = top_of(above, m->dof_treeid[column[k]]);
    if (first >= 0 && tree != first) above[tree > first ? tree : first] = tree > first ? first : tree;
    first = first < 0 || tree < first ? tree : first;
  }
  return first;
}

/* The columns of row k of a matrix that is dense or sparse, and how many. */
static int columns_of(const mjModel* m, const double* J, const int* nnz, const int* adr, const int* colind, int sparse, int k,
                      int* column, double* value) {
  int count = 0;
  for (int j = 0; j < (sparse ? nnz[k] : m->nv); j++) {
    double one = J[sparse ? (size_t)adr[k] + j : (size_t)k * m->nv + j];
    if (one != 0) column[count] = sparse ? colind[adr[k] + j] : j, value[count++] = one;
  }
  return count;
}

static int tendon_columns(const mjModel* m, const mjData* d, int tendon, int* column, double* value) {
#ifdef HCB_TENDON_ROWS_IN_MODEL
  return columns_of(m, d->ten_J, m->ten_J_rownnz, m->ten_J_rowadr, m->ten_J_colind, 1, tendon, column, value);
#else
  int sparse = m->opt.jacobian == mjJAC_SPARSE || (m->opt.jacobian == mjJAC_AUTO && m->nv >= 60);
  return columns_of(m, d->ten_J, d->ten_J_rownnz, d->ten_J_rowadr, d->ten_J_colind, sparse, tendon, column, value);
#endif
}

static int equality_columns(const mjModel* m, const mjData* d, int k, int* column, double* value) {
  return columns_of(m, d->efc_J, d->efc_J_rownnz, d->efc_J_rowadr, d->efc_J_colind, mj_isSparse(m), k, column, value);
}

/* Numbers the parts and their dofs from who is tied to whom. */
static void number_parts(const mjModel* m, mjData* d, int* above, tree_parts* t) {
  int *size = ints(d, m->ntree + 1), nv = m->nv;
  t->of_tree = ints(d, m->ntree);
  t->parts = 0;
  for (int k = 0; k < m->ntree; k++) {
    int top = top_of(above, k);
    t->of_tree[k] = top == k ? t->parts++ : t->of_tree[top];
  }
  t->at = ints(d, t->parts + 1);
  t->dof = ints(d, nv);
  t->place = ints(d, nv);
  memset(size, 0, (t->parts + 1) * sizeof(int));
  for (int j = 0; j < nv; j++) t->place[j] = size[t->of_tree[m->dof_treeid[j]]]++;
  t->at[0] = 0;
  for (int q = 0; q < t->parts; q++) t->at[q + 1] = t->at[q] + size[q];
  for (int j = 0; j < nv; j++) t->dof[t->at[t->of_tree[m->dof_treeid[j]]] + t->place[j]] = j;
}

static int part_size(const tree_parts* t, int part) { return t->at[part + 1] - t->at[part]; }

static int part_of_body(const mjModel* m, const tree_parts* t, int body) {
  int tree = m->body_treeid[body];
  return tree < 0 ? -1 : t->of_tree[tree];
}

/* x = M^-1 x over a part's dofs, of `count` vectors, from M = L^T D L: mj_solveM of trees alone, as each row of L has
   ancestors only. Vectors side by side keep the processor busy: each sum waits for itself. */
static inline void solve_vectors(const mjModel* m, const mjData* d, const tree_parts* t, int part, const double* L,
                                 const double* inverse, double* x, int count) {
  (void)d;
  const int* const rows[] = {HCB_M_ROWS};
  const int *nnz = rows[0], *adr = rows[1], *colind = rows[2], *dof = t->dof + t->at[part];
  int n = part_size(t, part);
  for (int i = n - 1; i >= 0; i--) {
    int a = adr[dof[i]], moves = 0;
    for (int c = 0; c < count; c++) moves |= x[c * n + i] != 0;
    for (int k = 0; k < nnz[dof[i]] - 1 && moves; k++) {
      double* at = x + t->place[colind[a + k]];
      for (int c = 0; c < count; c++) at[c * n] -= L[a + k] * x[c * n + i];
    }
  }
  for (int i = 0; i < n; i++) {
    int a = adr[dof[i]];
    double sum[3] = {0};
    for (int c = 0; c < count; c++) x[c * n + i] *= inverse[dof[i]];
    for (int k = 0; k < nnz[dof[i]] - 1; k++) {
      const double* at = x + t->place[colind[a + k]];
      for (int c = 0; c < count; c++) sum[c] += L[a + k] * at[c * n];
    }
    for (int c = 0; c < count; c++) x[c * n + i] -= sum[c];
  }
}

static void solve_factored(const mjModel* m, const mjData* d, const tree_parts* t, int part, const double* L,
                           const double* inverse, double* x) {
  solve_vectors(m, d, t, part, L, inverse, x, 1);
}

static void solve_part(const mjModel* m, const mjData* d, const tree_parts* t, int part, double* x) {
  solve_vectors(m, d, t, part, d->qLD, d->qLDiagInv, x, 1);
}

static void solve_three(const mjModel* m, const mjData* d, const tree_parts* t, int part, double* x) {
  solve_vectors(m, d, t, part, d->qLD, d->qLDiagInv, x, 3);
}

/* Rows of b2's velocity minus b1's at a point along `count` directions, over the dofs of each side's part. */
static void make_rows(const mjModel* m, const mjData* d, const tree_parts* t, const int body[2], const double* point,
                      const double* directions, int count, const int part[2], double* const rows[2]) {
  for (int s = 0; s < 2 && part[s] >= 0; s++) memset(rows[s], 0, (size_t)count * part_size(t, part[s]) * sizeof(double));
  for (int side = 0; side < 2; side++) {
    int b = m->body_weldid[body[side]], own = part_of_body(m, t, body[side]);
    if (own < 0) continue;
    const double* com = d->subtree_com + 3 * m->body_rootid[b];
    double r[3] = {point[0] - com[0], point[1] - com[1], point[2] - com[2]}, *row = rows[own == part[0] ? 0 : 1];
    for (int j = m->body_dofadr[b] + m->body_dofnum[b] - 1; j >= 0; j = m->dof_parentid[j]) {
      double v[3];
      moved_by(d, j, r, v);
      for (int k = 0; k < count; k++) {
        double along = dot(directions + 3 * k, v);
        row[(size_t)k * part_size(t, own) + t->place[j]] += side ? along : -along;
      }
    }
  }
}

/* The parts of two bodies, the lower one first; -1 for what cannot move, and for the second where it is the same. */
static void set_parts(const mjModel* m, const tree_parts* t, const int body[2], int part[2]) {
  int a = part_of_body(m, t, body[0]), b = part_of_body(m, t, body[1]);
  part[0] = a < 0 ? b : b < 0 || a < b ? a : b;
  part[1] = a < 0 || b < 0 || a == b ? -1 : a < b ? b : a;
}

/* The row of the rate at which a tendon leaves its upper limit, over its one part. */
static void tendon_row(const mjModel* m, mjData* d, const tree_parts* t, int tendon, int part[2], double* row) {
  mj_markStack(d);
  int* column = ints(d, m->nv);
  double* value = stack(d, m->nv);
  int count = tendon_columns(m, d, tendon, column, value);
  part[0] = count ? t->of_tree[m->dof_treeid[column[0]]] : -1;
  part[1] = -1;
  if (row && count) memset(row, 0, part_size(t, part[0]) * sizeof(double));
  for (int k = 0; row && k < count; k++) row[t->place[column[k]]] = -value[k];
  mj_freeStack(d);
}

/* A row over the parts of a contact, times a vector over all dofs. */
static double along_row(const tree_parts* t, const int part[2], const double* const rows[2], const double* full) {
  double sum = 0;
  for (int s = 0; s < 2 && part[s] >= 0; s++) {
    for (int j = 0; j < part_size(t, part[s]); j++) sum += rows[s][j] * full[t->dof[t->at[part[s]] + j]];
  }
  return sum;
}

/* Three rows over the parts of a contact, times a vector over all dofs. */
static void along_rows(const tree_parts* t, const int part[2], const double* const rows[2], const double* full, double* out) {
  out[0] = out[1] = out[2] = 0;
  for (int s = 0; s < 2 && part[s] >= 0; s++) {
    int size = part_size(t, part[s]);
    const double* row = rows[s];
    for (int j = 0; j < size; j++) {
      double x = full[t->dof[t->at[part[s]] + j]];
      for (int k = 0; k < 3; k++) out[k] += row[k * size + j] * x;
    }
  }
}

static void part_add(const tree_parts* t, int part, const double* x, double scale, double* full) {
  for (int j = 0; j < part_size(t, part); j++) full[t->dof[t->at[part] + j]] += scale * x[j];
}

/* The parts of a model, of which the tendons of a plug-in's instances tie trees, and rigid equalities if asked. */
static tree_parts make_parts(const mjModel* m, mjData* d, int first, int equalities) {
  tree_parts t = {0};
  int *above = ints(d, m->ntree), *column = ints(d, m->nv), held = 0, *row, *top;
  double* value = stack(d, m->nv);
  for (int k = 0; k < m->ntree; k++) above[k] = k;
  for (int i = first; i < m->nplugin; i++) {
    int tendon = m->plugin[i] == m->plugin[first] ? instance_of(d, i)->tendon : -1;
    if (tendon >= 0) tie(m, above, tendon_columns(m, d, tendon, column, value), column);
  }
  row = ints(d, d->ne);
  top = ints(d, d->ne);
  for (int k = 0; k < d->ne && equalities; k++) {
    if (d->efc_KBIP[4 * k + 2] < HCB_RIGID) continue;
    top[held] = tie(m, above, equality_columns(m, d, k, column, value), column);
    if (top[held] >= 0) row[held++] = k;
  }
  number_parts(m, d, above, &t);
  t.held = ints(d, held);
  t.held_at = ints(d, t.parts + 1);
  memset(t.held_at, 0, (t.parts + 1) * sizeof(int));
  for (int k = 0; k < held; k++) t.held_at[t.of_tree[top[k]] + 1]++;
  for (int q = 0; q < t.parts; q++) t.held_at[q + 1] += t.held_at[q];
  int* fill = ints(d, t.parts);
  memcpy(fill, t.held_at, t.parts * sizeof(int));
  for (int k = 0; k < held; k++) t.held[fill[t.of_tree[top[k]]]++] = row[k];
  return t;
}

/* Takes from the rows of contacts what the equalities of their parts hold: an impulse p along such a row, with those by
   which they answer it, is J^T p, and changes no rate of theirs. Kinetic energy then changes by p.(u before + u after)/2
   with u = J v, for any rates of the equalities. Softer ones act as forces, in the solver alone. This prepares. */
static void factor_held(const mjModel* m, mjData* d, tree_parts* t) {
  t->E = mj_stackAllocByte(d, 3 * (t->parts + 1) * sizeof(double*), sizeof(double*));
  t->EB = t->E + t->parts;
  t->K = t->EB + t->parts;
  for (int q = 0; q < t->parts; q++) {
    int n = t->held_at[q + 1] - t->held_at[q], size = part_size(t, q), *column;
    if (n == 0) continue;
    t->E[q] = stack(d, (size_t)n * size);
    t->EB[q] = stack(d, (size_t)n * size);
    double *E = t->E[q], *B = t->EB[q], *K = t->K[q] = stack(d, (size_t)n * n);
    mj_markStack(d);
    column = ints(d, m->nv);
    double* value = stack(d, m->nv);
    memset(E, 0, (size_t)n * size * sizeof(double));
    for (int k = 0; k < n; k++) {
      int count = equality_columns(m, d, t->held[t->held_at[q] + k], column, value);
      for (int j = 0; j < count; j++) E[(size_t)k * size + t->place[column[j]]] = value[j];
    }
    mj_freeStack(d);
    memcpy(B, E, (size_t)n * size * sizeof(double));
    for (int k = 0; k < n; k++) solve_part(m, d, t, q, B + (size_t)k * size);
    for (int i = 0; i < n; i++) {
      for (int k = 0; k < n; k++) K[i * n + k] = row_dot(size, E + (size_t)i * size, B + (size_t)k * size);
      K[i * n + i] = K[i * n + i] * (1 + HCB_REDUNDANT) + mjMINVAL; /* several may hold the same */
    }
    mju_cholFactor(K, n, mjMINVAL);
  }
}

static int held_in(const tree_parts* t, int part) { return t->held_at[part + 1] - t->held_at[part]; }

static void hold(const tree_parts* t, mjData* d, int part, double* row) {
  int n = held_in(t, part), size = part_size(t, part);
  mj_markStack(d);
  double* y = stack(d, n);
  for (int k = 0; k < n; k++) y[k] = row_dot(size, t->EB[part] + (size_t)k * size, row);
  mju_cholSolve(y, t->K[part], y, n);
  for (int k = 0; k < n; k++) mju_addToScl(row, t->E[part] + (size_t)k * size, -y[k], size);
  mj_freeStack(d);
}

/* Three rows of a contact without what equalities hold of them, and their rates u at these velocities. */
static void hold_rows(const tree_parts* t, mjData* d, const int part[2], double* const rows[2], const double* velocity, double* u) {
  double before[3], after[3];
  int held = 0;
  for (int s = 0; s < 2 && part[s] >= 0; s++) held += held_in(t, part[s]);
  if (!held) return;
  along_rows(t, part, (const double* const*)rows, velocity, before);
  for (int s = 0; s < 2 && part[s] >= 0; s++) {
    for (int k = 0; k < 3 && held_in(t, part[s]); k++) hold(t, d, part[s], rows[s] + (size_t)k * part_size(t, part[s]));
  }
  along_rows(t, part, (const double* const*)rows, velocity, after);
  for (int k = 0; k < 3; k++) u[k] += after[k] - before[k];
}
