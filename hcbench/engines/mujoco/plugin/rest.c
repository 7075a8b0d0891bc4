/* Rest after impacts: the rows that MuJoCo made for a law's contacts, rewritten before their reference acceleration is
   worked out: to e = 0 with friction for what rests, or to silence for contacts that part. Where something may press what
   parts (is_loaded), its row does not let the contact close again within the step: a servo presses a foot with many times
   its weight, and each step of that would be an impact, whose push nothing bears. */

/* Compliances of a resting row, in units of the pair's own inverse mass. */
#define HCB_REST 1e-9          /* under Newton; */
#define HCB_REST_MOVING 3e-7   /* under Newton while an elliptic cone rolls or slides, or its line search, which ends early in
                                  stiffer rows, leaves bodies a torque that no contact gives; */
#define HCB_REST_LOADED 1e-4   /* under Newton at most, on feet of robots; */
#define HCB_REST_GIVES 0.05    /* there: of how the contact has accelerated in the last step, over gravity. The solver starts from
                                  that step's accelerations, and rows that push must differ from those that do not by more than
                                  what these change by; */
#define HCB_REST_BELOW 0.1     /* there: least share of gravity along the normal */
#define HCB_REST_STEEP 1e-3    /* under Newton where gravity hardly closes a contact: what is wedged in stiffer rows bears any force; */
#define HCB_REST_CG 1e-3       /* under CG, which does not settle stiffer rows in its iterations; */
#define HCB_REST_FORCES 1e-6   /* under PGS and noslip, whose forces the step takes; */
#define HCB_FORCES_MOVING 1e-5 /* under these in motion: of 200 thrown boxes one met a force 30 times too high */
#define HCB_STANDS 1e-5        /* m/s and rad/s, up to which a contact stands still */
#define HCB_LIFTS 0.5       /* of the speed that counts as rest, at which what rests too deep is lifted; */
#define HCB_RETURNS 0.9     /* of the speed at which it turns in, besides: two ends of a body that send each other down gain nothing */
#define HCB_LIFT_STEPS 2    /* in which it is, or more; */
#define HCB_STEEP 0.2       /* of gravity along the normal, below which others close a contact, as a slope does a wall's; */
#define HCB_STEEP_STEPS 3   /* of its approach, from which depth on what comes there as slowly as a step's fall is at rest */
#define HCB_STRAYS 1e-2 /* of the speed that counts as rest, up to which contacts may move that are to stand (strays.c) */
#define HCB_NO_FORCE 1e-40    /* D of a row whose force starts from 0 */
#define HCB_SILENT -1e10       /* m/s^2: a row that never pushes */

typedef struct { /* a contact of a law: rows of the solver from `row` on */
  int instance, id, order, contact, tendon, body[2], row, rows, dim, cone, touches, rests, held, steep; /* held: parts, and must not
                                            close; steep: gravity hardly closes it */
  double rate[6], lead[3], turn[3], friction[5]; /* lead: of the first three of the rates, by half a step; turn: of
                                            the last three, after the impact */
  double slip, dilation, parting, swing, x, constant, lift; /* dilation: speed at which the slip parts MuJoCo's cones; swing: at most what
                                                         turning adds to the rate in a step; constant: solref's first number; lift: m/s, where it rests */
  const double *point, *frame;
  hcb_contact law;
} blow;

/* PGS and noslip use J M^-1 J^T + R, worked out before the passive forces: its diagonal follows R. */
static void add_to_AR(const mjModel* m, mjData* d, int row, double change) {
  if (!is_dual(m) || !d->efc_AR) return; /* inverse dynamics has none */
  if (!mj_isSparse(m)) {
    d->efc_AR[(size_t)row * d->nefc + row] += change;
    return;
  }
  for (int k = d->efc_AR_rowadr[row]; k < d->efc_AR_rowadr[row] + d->efc_AR_rownnz[row]; k++) {
    if (d->efc_AR_colind[k] == row) d->efc_AR[k] += change;
  }
}

/* Whether forces of rewritten rows start from 0: PGS takes them from the last step's accelerations times D, which for rows as stiff
   is noise, for which it would give up all forces that it starts from. Nothing else of a step reads D under PGS. D is too small for
   any force: from one above mjMINVAL PGS goes on along a ray of its elliptic cone, which it gives up where the force's square is
   below mjMINVAL, so that the contact would never bear anything. */
static int starts_at_rest(const mjModel* m, const mjData* d) {
  return m->opt.solver == mjSOL_PGS && d->efc_AR && !(m->opt.enableflags & mjENBL_FWDINV);
}

static void copy_to_island(mjData* d, int row) {
#ifdef HCB_ISLAND_ROWS
  if (d->nisland > 0) {
    int island_row = d->map_efc2iefc[row];
    d->iefc_R[island_row] = d->efc_R[row];
    d->iefc_D[island_row] = d->efc_D[row];
  }
#else
  (void)d, (void)row;
#endif
}

static void set_row(const mjModel* m, mjData* d, int row, double acceleration_, double compliance) {
  double *KBIP = d->efc_KBIP + 4 * row, before = d->efc_R[row];
  d->efc_R[row] = fmax(d->efc_R[row] * KBIP[2] / (1 - KBIP[2]) * compliance, mjMINVAL);
  d->efc_D[row] = starts_at_rest(m, d) ? HCB_NO_FORCE : 1 / d->efc_R[row];
  add_to_AR(m, d, row, d->efc_R[row] - before);
  KBIP[0] = 1; /* mj_referenceConstraint comes next and computes -B vel - K I (pos - margin) */
  KBIP[1] = 0;
  d->efc_margin[row] = d->efc_pos[row] + acceleration_ / KBIP[2];
  copy_to_island(d, row);
}

/* Whether forces other than gravity and contact may press bodies together: of joints and what drives them, of equalities and
   tendons between free bodies, or applied. */
static int is_loaded(const mjModel* m, const mjData* d) {
  int loaded = d->ne > 0 || m->ntendon > 0 || m->nu > 0;
  for (int j = 0; j < m->nv && !loaded; j++) loaded = d->qfrc_applied[j] != 0 || !is_lone(m, j);
  for (int k = 6; k < 6 * m->nbody && !loaded; k++) loaded = d->xfrc_applied[k] != 0;
  return loaded;
}

/* A row of the solver times a vector over all dofs. */
static double along_solver_row(const mjModel* m, const mjData* d, int row, const double* full) {
  int sparse = mj_isSparse(m), count = sparse ? d->efc_J_rownnz[row] : m->nv;
  size_t at = sparse ? (size_t)d->efc_J_rowadr[row] : (size_t)row * m->nv;
  double sum = 0;
  for (int j = 0; j < count; j++) sum += d->efc_J[at + j] * full[sparse ? d->efc_J_colind[at + j] : j];
  return sum;
}

/* How a contact accelerates along its rows, at most, by the accelerations that the solver starts from. */
static double change_of(const mjModel* m, const mjData* d, const blow* b) {
  const double* a = d->qacc_warmstart;
  double most = 0;
  int row = b->row, end = b->row + b->rows;
  for (; row + 1 < end && !mj_isSparse(m); row += 2) { /* two at once: a sum waits for itself */
    const double *one = d->efc_J + (size_t)row * m->nv, *two = one + m->nv;
    double sums[2] = {0, 0};
    for (int j = 0; j < m->nv; j++) sums[0] += one[j] * a[j], sums[1] += two[j] * a[j];
    most = larger(larger(most, fabs(sums[0])), fabs(sums[1]));
  }
  for (; row < end; row++) most = larger(most, fabs(along_solver_row(m, d, row, a)));
  return most;
}

static double rest_compliance(const mjModel* m, const mjData* d, const blow* b, int loaded) {
  double fastest = 0, gravity = mju_norm3(m->opt.gravity), falls = HCB_REST_BELOW * HCB_STILL * gravity * m->opt.timestep;
  for (int k = 0; k < 6; k++) fastest = larger(fastest, fabs(b->rate[k]));
  int moves = fastest > HCB_STANDS;
  if (is_dual(m)) return moves ? HCB_FORCES_MOVING : HCB_REST_FORCES;
  if (m->opt.solver == mjSOL_CG) return HCB_REST_CG;
  if (b->steep) return HCB_REST_STEEP;
  double least = moves && m->opt.cone == mjCONE_ELLIPTIC ? HCB_REST_MOVING : HCB_REST;
  if (!loaded || gravity == 0 || b->law.still <= falls) return least;
  return fmax(least, fmin(HCB_REST_LOADED, HCB_REST_GIVES * change_of(m, d, b) / gravity));
}

/* Whether a contact that is to stand is solved again after the step where it does not (strays.c): one that turns against friction;
   one that slides, or is pressed by other forces than rest.c knows, or moves on in the stages of RK4, but for Newton where only
   one is so; and each where others press a contact that gravity hardly closes (wedged), as they may press each other at will. */
static int may_stray(const mjModel* m, const blow* b, int loaded, int wedged) {
  double slow = HCB_STRAYS * b->law.still;
  int slides = larger(b->slip, length(b->rate[1], b->rate[2])) > slow, turns = b->dim > 3 && b->dilation > slow;
  int reasons = loaded + (m->opt.solver != mjSOL_NEWTON) + (m->opt.integrator == mjINT_RK4) + slides;
  return b->tendon < 0 && (b->rests || b->held) && (turns || wedged || reasons > 1 || stops_early(m));
}

/* Marks a contact of MuJoCo as one that is to stand after the step (`standing`). */
static void let_stand(instance* memory, int contact, double closing) {
  if (memory->stand == memory->room_to_stand) {
    memory->room_to_stand = memory->room_to_stand ? 2 * memory->room_to_stand : 16;
    memory->stands = realloc(memory->stands, memory->room_to_stand * sizeof(standing));
  }
  memory->stands[memory->stand++] = (standing){contact, closing};
}

/* Whether MuJoCo's own rows are to push what a mocap body has jumped into, as they do by depth; the mocap body stands still now.
   After an impact that parts with e v, a contact is as deep as v times the step at most; one that is deeper as it parts, for e of
   1/4 and more, is being pushed. */
static int is_lifted(const mjModel* m, const instance* memory, const blow* b) {
  int jumped = 0;
  for (int side = 0; side < 2 && b->tendon < 0; side++) {
    const mocap* own = moving_of(m, memory, b->body[side]);
    jumped |= own && own->jumped && mju_norm(own->speed, 6) == 0;
  }
  int approaches = -b->rate[0] > b->law.still, parts = b->rate[0] > b->law.still;
  return jumped && b->touches && !approaches && (!parts || b->x > 4 * b->rate[0] * m->opt.timestep);
}

/* An elliptic cone as of impratio 1. Soft rows slip less by a larger one; rows that are as stiff as these slip by nothing, and an
   uneven cone stops the line search of Newton where it starts: what a gripper holds would go on at its speed, whatever drives it. */
static void even_cone(const mjModel* m, mjData* d, const blow* b) {
  for (int k = b->row + 1; k < b->row + b->rows; k++) {
    double before = d->efc_R[k];
    d->efc_R[k] *= m->opt.impratio;
    if (!starts_at_rest(m, d)) d->efc_D[k] = 1 / d->efc_R[k];
    add_to_AR(m, d, k, d->efc_R[k] - before);
    copy_to_island(d, k);
  }
  d->contact[b->contact].mu = b->friction[0] * sqrt(d->efc_R[b->row + 1] / d->efc_R[b->row]); /* MuJoCo makes it of its own rows so */
}

/* About a third of the time constant of MuJoCo's own contact, s: after an approach u it goes as deep as u times that. */
static double third_of_constant(const mjModel* m, const blow* b) {
  double least = m->opt.disableflags & mjDSBL_REFSAFE ? 0 : 2 * m->opt.timestep;
  return HCB_COARSE_FREE * (b->constant > 0 ? fmax(b->constant, least) : 1 / sqrt(fmax(-b->constant, mjMINVAL)));
}

/* How deep a body stands at rest on MuJoCo's own contact, m, for a third of its time constant. */
static double own_depth(const mjModel* m, double third) { return mju_norm3(m->opt.gravity) * third * third; }

/* Sets the speed at which a contact is lifted where it rests deeper than on MuJoCo's own contact. Rows hold velocities, and what turns
   sinks by more than these say: the point at which a disc touches runs on, and the next one comes down at a speed u that the last step
   did not stop. As it comes down by u h/2 within a step, speeds of -u and u at its two ends keep the depth and the energy; 0 at the end
   loses both, and so does an impact. What comes down that slowly in a deep contact is at rest, then; what has just landed is as deep as
   it came in the step, and is not meant. What a landing left goes at a speed that the next step's fall takes back, so that nothing hops.
   Where gravity hardly closes a contact, as at a wall or in front of a hand, others bring it as fast as they fall in a step, and it is
   at rest, too, once it is in. falls: the speed that counts as rest where gravity closes a contact in full. */
static void set_lift(const mjModel* m, blow* b, double falls) {
  double h = m->opt.timestep, third = third_of_constant(m, b), approach = fmax(0, -b->rate[0]);
  double calm = b->steep ? falls : b->law.still;
  if (b->steep && approach <= calm && b->x > HCB_STEEP_STEPS * approach * h) b->law.still = fmax(b->law.still, approach);
  double excess = b->x - own_depth(m, third) - approach * h, most = excess / (HCB_LIFT_STEPS * h);
  if (excess <= 0 || falls == 0) return;
  int turns_in = approach <= most;
  b->lift = fmin(most, HCB_LIFTS * calm + (turns_in ? HCB_RETURNS * approach : 0));
  if (turns_in) b->law.kind = HCB_CONSTANT, b->law.value = 0;
  if (turns_in && m->opt.integrator == mjINT_RK4) b->law.still = fmax(b->law.still, approach); /* its step is not made again */
}

static void set_rows(const mjModel* m, mjData* d, instance* memory, const blow* b, int stage, int loaded, int wedged) {
  plan now = {.rows = b->rows}, *made = stage > 1 ? planned(memory, b->instance, b->id, b->order) : NULL;
  double h = m->opt.timestep, mu = b->friction[0], compliance = rest_compliance(m, d, b, loaded);
  int stands = may_stray(m, b, loaded, wedged);
  /* Back as fast, at the same depth and for no work: what turning has parted, and all in RK4, which moves on the way. */
  double closing = fmax(0, b->held ? 0 : stage ? b->parting : fmin(fmin(b->parting, b->rate[0]), b->swing)) - (b->rests ? b->lift : 0);
  double slip = length(b->rate[1], b->rate[2]), back = 0; /* a point that sticks and runs on: at -u and u, as what is lifted (set_lift) */
  int runs_on = stage == 0 && !loaded && !is_dual(m) && b->rests && b->slip < HCB_STANDS; /* PGS settles that slowly */
  if (runs_on && slip > 0) back = HCB_RETURNS * fmin(1, b->swing / slip);
  for (int i = 0; i < b->rows; i++) {
    int k = b->cone ? 1 + i / 2 : i;
    double rate = (k == 1 || k == 2 ? 1 + back : 1) * b->rate[k];
    double tangential = b->cone ? (i % 2 ? -1 : 1) * b->friction[k - 1] * rate : 0;
    now.value[i] = i && !b->cone ? -rate / h : (-b->rate[0] - tangential - b->dilation - closing) / h;
    if ((!b->rests && !b->held) || stage > 1) now.value[i] = i && !b->cone ? 0 : HCB_SILENT; /* new ones wait for the next step */
  }
  if (stage == 1) {
    made = new_plan(memory, b->instance, b->id, b->order);
    made->rows = now.rows;
    made->stands = stands;
    made->closing = closing;
    memcpy(made->value, now.value, sizeof(now.value));
  }
  if (made && made->rows == now.rows) now = *made;
  if (stage == 0 && stands) let_stand(memory, b->contact, closing);
  if (stage == 4 && made && made->stands) let_stand(memory, b->contact, made->closing);
  if (b->cone) compliance /= fmax(2 * mu * mu, 1e-12); /* a pyramid's rows have 2 mu^2 in theirs */
  for (int i = 0; i < now.rows; i++) set_row(m, d, b->row + i, now.value[i], compliance);
  if (b->tendon < 0 && b->dim > 1 && !b->cone) even_cone(m, d, b);
}

/* Lets MuJoCo's own contacts go on from the velocities after the impulses of others. Their rows ask for an acceleration from the
   velocity at the step's start, and the impulse is part of what accelerates: so a row would hold the speed from before the impact,
   for any energy that takes. With v + dv in place of v, for dv = M^-1 p, the row asks for J dv/h - B J dv more. */
static void shift_own_contacts(const mjModel* m, mjData* d, const double* change, const blow* all, int count) {
  mj_markStack(d);
  int *has_law = ints(d, d->ncon), own = d->ncon;
  memset(has_law, 0, d->ncon * sizeof(int));
  for (int i = 0; i < count; i++) {
    if (all[i].tendon >= 0 || has_law[all[i].contact]) continue;
    has_law[all[i].contact] = 1;
    own--;
  }
  if (own == 0) { /* each contact has a law */
    mj_freeStack(d);
    return;
  }
  for (int k = 0; k < d->nefc; k++) {
    if (d->efc_type[k] < mjCNSTR_CONTACT_FRICTIONLESS || has_law[d->efc_id[k]]) continue;
    double *KBIP = d->efc_KBIP + 4 * k, more = (1 / m->opt.timestep - KBIP[1]) * along_solver_row(m, d, k, change);
    if (KBIP[0] == 0) KBIP[0] = 1, d->efc_margin[k] = d->efc_pos[k]; /* friction, which asks nothing of the position */
    d->efc_margin[k] += more / (KBIP[0] * KBIP[2]);
  }
  mj_freeStack(d);
}
