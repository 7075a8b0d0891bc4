/* Forces that the solver PGS starts from: those of the last step. It takes them from the accelerations of that step, as -D (J qacc - aref)
   where that is above 0, and rows as stiff as those of rest.c leave no trace of their forces in these. Started from 0, PGS uses up its
   iterations on every step, with MuJoCo's own contact as well. So those accelerations are lowered by free fall, by which contacts close,
   and each row's D is what gives its force of the last step then: of a law's contacts as kept here, of others as MuJoCo would take it.
   Nothing else of a step reads D under PGS. An elliptic cone gives forces of each row by its own D where it is closed at once, even
   against the row where D is below 0; and where it slides, all forces by the D of its normal. MuJoCo writes the accelerations anew at the step's end; a call that does not end a step,
   mj_forward or a stage of RK4, finds them lowered. */

typedef struct borne { /* the forces of a law's contact in the last step */
  int instance, id, order, rows;
  double force[ROWS];
} borne;

static int starts_from_last(const mjModel* m, const mjData* d) {
  return starts_at_rest(m, d) && !(m->opt.disableflags & mjDSBL_WARMSTART);
}

static int are_equal(const double* a, const double* b, int n) {
  for (int k = 0; k < n; k++) {
    if (a[k] != b[k]) return 0;
  }
  return 1;
}

static void make_room(instance* memory, int count, int nv) {
  if (memory->room_to_bear < count) memory->borne = realloc(memory->borne, (memory->room_to_bear = count) * sizeof(borne));
  if (memory->warm_dofs != nv) memory->warm = realloc(memory->warm, 3 * ((memory->warm_dofs = nv) + 1) * sizeof(double));
}

/* After a step: what the law's contacts bore in it, and the accelerations that this was with. */
static void keep_forces(const mjModel* m, mjData* d, int first) {
  instance* memory = instance_of(d, first);
  memory->bornes = 0;
  if (!starts_from_last(m, d)) return;
  mj_markStack(d);
  blow* all = mj_stackAllocByte(d, (d->ncon + d->nefc + 1) * sizeof(blow), sizeof(double));
  int count = gather(m, d, first, all), nv = m->nv;
  make_room(memory, count, nv);
  for (int i = 0; i < count; i++) {
    borne* b = memory->borne + i;
    *b = (borne){.instance = all[i].instance, .id = all[i].id, .order = all[i].order, .rows = all[i].rows};
    mju_copy(b->force, d->efc_force + all[i].row, b->rows);
  }
  memory->bornes = count;
  mju_copy(memory->warm, d->qacc, nv);
  mju_fill(memory->warm + nv, NAN, 2 * nv);
  mj_freeStack(d);
}

/* A copy goes on as the original does. */
static void copy_forces(instance* own, const instance* other) {
  int count = other->bornes, nv = other->warm_dofs;
  own->bornes = 0;
  if (count == 0) return;
  make_room(own, count, nv);
  memcpy(own->borne, other->borne, count * sizeof(borne));
  memcpy(own->warm, other->warm, 3 * (size_t)nv * sizeof(double));
  own->bornes = count;
}

/* The forces of a contact in the last step; NULL where it was not. Contacts ask in the order in which they were kept. */
static const double* borne_by(const instance* memory, const blow* b, int* next) {
  for (int i = 0; i < memory->bornes; i++) {
    const borne* one = memory->borne + (*next + i) % memory->bornes;
    if (one->instance != b->instance || one->id != b->id || one->order != b->order || one->rows != b->rows) continue;
    *next = (int)(one - memory->borne) + 1;
    return one->force;
  }
  return NULL;
}

/* Lowers the accelerations that the solver starts from by free fall, once a step; those that MuJoCo gave into `from`. Whether the
   forces that were kept are of these. */
static int lower_start(const mjModel* m, mjData* d, instance* memory, const double** from) {
  int nv = m->nv;
  if (memory->bornes == 0 || memory->warm_dofs != nv) return 0;
  double *kept = memory->warm, *own = kept + nv, *low = own + nv;
  if (!are_equal(d->qacc_warmstart, low, nv)) {
    if (!are_equal(d->qacc_warmstart, kept, nv) || !gravity_force(m, d, low)) return 0;
    mju_copy(own, kept, nv);
    mj_solveM(m, d, low, low, 1);
    mju_addTo(low, own, nv);
    mju_copy(d->qacc_warmstart, low, nv);
  }
  *from = own;
  return 1;
}

/* How fast a row would open at these accelerations, beyond what it asks for. */
static double opens_at(const mjModel* m, const mjData* d, int row, const double* acceleration_) {
  const double* KBIP = d->efc_KBIP + 4 * row;
  double asks = -KBIP[1] * along_solver_row(m, d, row, d->qvel) - KBIP[0] * KBIP[2] * (d->efc_pos[row] - d->efc_margin[row]);
  return along_solver_row(m, d, row, acceleration_) - asks;
}

enum { OPEN, CLOSED, SLIDES }; /* zones of an elliptic cone */

/* The zone in which a cone is whose rows open at these accelerations, and in `slip` how fast it slips, over its friction. */
static int zone_of(const mjContact* c, const double* opens, double* slip) {
  double normal = c->mu * opens[0], sum = 0;
  for (int k = 1; k < c->dim; k++) sum += c->friction[k - 1] * c->friction[k - 1] * opens[k] * opens[k];
  *slip = sqrt(sum);
  if (normal >= c->mu * *slip) return OPEN;
  return c->mu * normal + *slip <= 0 ? CLOSED : SLIDES;
}

/* The normal force of a cone that slips, for a D of 1 of its normal row. */
static double sliding_force(const mjContact* c, double opens, double slip) {
  return c->mu * (c->mu * slip - c->mu * opens) / (c->mu * c->mu * (1 + c->mu * c->mu));
}

/* The forces of an elliptic cone that MuJoCo would start from; D: of its rows. */
static void cone_forces(const mjContact* c, const double* D, const double* opens, double* force) {
  double slip;
  int zone = zone_of(c, opens, &slip);
  for (int k = 0; k < c->dim; k++) force[k] = zone == CLOSED ? -D[k] * opens[k] : 0;
  if (zone != SLIDES) return;
  force[0] = D[0] * sliding_force(c, opens[0], slip);
  for (int k = 1; k < c->dim; k++) force[k] = -force[0] / slip * c->friction[k - 1] * c->friction[k - 1] * opens[k];
}

/* D of an elliptic cone's rows, so that it starts from these forces; where it cannot, from none. */
static void set_cone(const mjContact* c, const double* opens, const double* force, double* D) {
  double slip;
  int zone = zone_of(c, opens, &slip);
  for (int k = 0; k < c->dim; k++) D[k] = HCB_NO_FORCE;
  if (zone == OPEN || !(force[0] > 0)) return;
  if (zone == SLIDES) D[0] = force[0] / sliding_force(c, opens[0], slip);
  for (int k = 0; k < c->dim && zone == CLOSED; k++) {
    if (opens[k] != 0) D[k] = -force[k] / opens[k];
  }
}

/* The contact whose elliptic cone has its first row here; NULL: none. */
static const mjContact* cone_at(const mjData* d, int row) {
  return d->efc_type[row] == mjCNSTR_CONTACT_ELLIPTIC ? d->contact + d->efc_id[row] : NULL;
}

/* Lets PGS start from the forces of the last step. Rows of equalities and of friction in joints, which push both ways, start as they
   come at the lowered accelerations. */
static void start_from_last(const mjModel* m, mjData* d, instance* memory, const blow* all, int count) {
  const double* from;
  int next = 0, others = d->ne + d->nf;
  if (!starts_from_last(m, d) || !lower_start(m, d, memory, &from)) return;
  mj_markStack(d);
  double *force = stack(d, d->nefc), *opens = stack(d, d->nefc);
  for (int k = others; k < d->nefc; k++) {
    opens[k] = opens_at(m, d, k, from);
    force[k] = -d->efc_D[k] * opens[k];
  }
  for (int k = others; k < d->nefc; k += cone_at(d, k) ? cone_at(d, k)->dim : 1) {
    if (cone_at(d, k)) cone_forces(cone_at(d, k), d->efc_D + k, opens + k, force + k);
  }
  for (int i = 0; i < count; i++) {
    const double* kept = borne_by(memory, all + i, &next);
    if (kept) mju_copy(force + all[i].row, kept, all[i].rows);
  }
  for (int k = others; k < d->nefc; k++) opens[k] = opens_at(m, d, k, d->qacc_warmstart);
  for (int k = others; k < d->nefc; k += cone_at(d, k) ? cone_at(d, k)->dim : 1) {
    if (cone_at(d, k)) {
      set_cone(cone_at(d, k), opens + k, force + k, d->efc_D + k);
    } else {
      d->efc_D[k] = opens[k] < 0 && force[k] > 0 ? -force[k] / opens[k] : HCB_NO_FORCE;
    }
  }
  for (int k = others; k < d->nefc; k++) copy_to_island(d, k);
  mj_freeStack(d);
}
