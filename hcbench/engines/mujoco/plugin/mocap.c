/* Speeds of mocap bodies. MuJoCo has none: a mocap body stands still wherever the user moves it, and native contact pushes what it
   has moved into. Here a mocap body that moves evenly has the speed of its last step: what rests on it goes with it, as impacts
   are of the speed between both. One that jumps, moves in some steps only, or has just begun to, has MuJoCo's own contact. */

#define HCB_EVEN 0.1 /* of a step's travel: how much the next step's may differ; g h^2 anyway, which no contact can follow */

#define HCB_JUMPS 10 /* uneven steps with contact from which on it is named */

typedef struct mocap { /* how a mocap body moves: since the last step, then as a speed; each linear, then angular */
  double pos[3], quat[4], travel[6], speed[6];
  int steps, uneven, jumped; /* steps: how many in a row were seen, up to 2; jumped: has ever been uneven */
} mocap;

/* The mocap body that a body is, or is fixed to; -1: none. Before MuJoCo 4 these are welded to the world, since then to it. */
static int mocap_of(const mjModel* m, int body) {
  int root = m->body_rootid[body], weld = m->body_weldid[body];
  return weld == 0 || weld == root ? m->body_mocapid[root] : -1;
}

/* Whether two travels differ by no more than an even motion may. */
static int is_even(const mjModel* m, const double* one, const double* next) {
  double change[3], falls = mju_norm3(m->opt.gravity) * m->opt.timestep * m->opt.timestep;
  mju_sub3(change, next, one);
  return mju_norm3(change) <= fmax(HCB_EVEN * mju_norm3(next), falls);
}

/* Whether this step follows the last one that was seen. */
static int is_next(const mjModel* m, const mjData* d, const instance* memory) {
  return fabs(d->time - memory->seen - m->opt.timestep) < 1e-6 * m->opt.timestep;
}

static void follow_mocap(const mjModel* m, const mjData* d, int id, int next, mocap* own) {
  double travel[6], back[4], turn[4];
  const double *pos = d->mocap_pos + 3 * id, *quat = d->mocap_quat + 4 * id;
  mju_sub3(travel, pos, own->pos);
  mju_negQuat(back, own->quat);
  mju_mulQuat(turn, quat, back);
  mju_quat2Vel(travel + 3, turn, 1);
  own->steps = next ? (own->steps < 2 ? own->steps + 1 : 2) : 0;
  int moves = own->steps > 0 && mju_norm(travel, 6) > 0, moved = own->steps > 1 && mju_norm(own->travel, 6) > 0;
  int even = own->steps > 1 && is_even(m, own->travel, travel) && is_even(m, own->travel + 3, travel + 3);
  own->uneven = (moves || moved) && !even;
  own->jumped |= own->uneven;
  mju_scl(own->speed, travel, even ? 1 / m->opt.timestep : 0, 6);
  mju_copy(own->travel, travel, 6);
  mju_copy3(own->pos, pos);
  mju_copy4(own->quat, quat);
}

/* At the start of a step. Nothing changes where the time is that of the last call. */
static void follow_mocaps(const mjModel* m, const mjData* d, instance* memory) {
  int is_new = memory->mocaps != m->nmocap;
  if (m->nmocap == 0 || (!is_new && memory->seen == d->time)) return;
  if (is_new) {
    memory->moving = realloc(memory->moving, m->nmocap * sizeof(mocap));
    memset(memory->moving, 0, m->nmocap * sizeof(mocap));
    memory->mocaps = m->nmocap;
  }
  for (int id = 0; id < m->nmocap; id++) follow_mocap(m, d, id, !is_new && is_next(m, d, memory), memory->moving + id);
}

/* The mocap that a body is or is fixed to, as the first instance knows it; NULL: none. */
static const mocap* moving_of(const mjModel* m, const instance* memory, int body) {
  int id = mocap_of(m, body);
  return id >= 0 && id < memory->mocaps ? memory->moving + id : NULL;
}

/* Velocity at a point of a body that is, or is fixed to, a mocap body, and its angular velocity; else 0. */
static void mocap_velocity(const mjModel* m, const instance* memory, int body, const double* point, double v[3], double w[3]) {
  const mocap* own = moving_of(m, memory, body);
  double arm[3];
  mju_zero(v, 3);
  mju_zero(w, 3);
  if (!own) return;
  mju_copy3(w, own->speed + 3);
  mju_sub3(arm, point, own->pos);
  mju_cross(v, w, arm);
  mju_addTo3(v, own->speed);
}
