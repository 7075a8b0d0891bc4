/* After an impact Bullet would turn a body for the step by its velocities before: its gyroscopic and Coriolis forces are
   of the step's start. So a spinning corner would part at the wrong speed, and joints would gain energy. Pushes on the
   links make the step go on from the velocities after the impact; a body without joints turns exactly then. */

#define HCB_TURN 60  /* of its small steps in which a body turns freely, how many a radian */
#define HCB_FAST 0.1 /* rad a step: a jointed body that turns faster gains energy by Bullet's own step */

/* Adds the acceleration of a point at `arm` from one that is accelerated, on a body that turns. */
static void add_arm(const double* spin, const double* gain, const double* arm, double* out) {
  double turn[3], inward[3], along[3];
  cross(spin, arm, turn);
  cross(spin, turn, inward);
  cross(gain, arm, along);
  for (int k = 0; k < 3; k++) out[k] += inward[k] + along[k];
}

/* What a link's accelerations are, linear and angular, if no force acts along any freedom. */
static void coast(const body* b, int link, double (*motion)[6], double (*gain)[6]) {
  const link_state* l = b->link + link;
  double *own = gain[link + 1], pivot[3], arm[3], turn[3];
  memset(own, 0, sizeof(gain[0]));
  if (link < 0) return;
  const double *m = motion[link + 1], *above = motion[l->parent + 1], *from = b->link[l->parent].pose;
  memcpy(own, gain[l->parent + 1], sizeof(gain[0]));
  cross(above + 3, m + 3, turn);
  rotate(l->pose + 3, l->pivot, 1, pivot);
  for (int k = 0; k < 3; k++) {
    own[3 + k] += turn[k];
    arm[k] = l->pose[k] - from[k] + (l->joint == PRISMATIC ? 0 : pivot[k]);
  }
  add_arm(above + 3, gain[l->parent + 1] + 3, arm, own);
  if (l->joint != PRISMATIC) {
    for (int k = 0; k < 3; k++) arm[k] = -pivot[k];
    add_arm(m + 3, own + 3, arm, own);
  } else {
    cross(above + 3, arm, turn);
    for (int k = 0; k < 3; k++) arm[k] = m[k] - above[k] - turn[k];
    cross(above + 3, arm, turn);
    for (int k = 0; k < 3; k++) own[k] += 2 * turn[k];
  }
}

/* Adds `sign` times the force and torque that this takes, of each link. */
static void add_inertial(world* w, const body* b, double (*motion)[6], double sign, double (*wrench)[6]) {
  double(*gain)[6] = (double(*)[6])take(w, 6 * ((size_t)b->links + 1));
  for (int i = -1; i < b->links; i++) {
    const link_state* l = b->link + i;
    const double* I = l->info.inertia;
    double spin[3], rate[3], torque[3];
    coast(b, i, motion, gain);
    rotate(l->pose + 3, motion[i + 1] + 3, -1, spin);
    rotate(l->pose + 3, gain[i + 1] + 3, -1, rate);
    for (int k = 0; k < 3; k++) {
      int y = (k + 1) % 3, z = (k + 2) % 3;
      torque[k] = I[k] * rate[k] + (I[z] - I[y]) * spin[y] * spin[z];
    }
    rotate(l->pose + 3, torque, 1, torque);
    for (int k = 0; k < 3; k++) {
      wrench[i + 1][k] += sign * l->info.mass * gain[i + 1][k];
      wrench[i + 1][3 + k] += sign * torque[k];
    }
  }
}

/* How a body without joints turns in a step, in its own frame: the change of its spin. */
static void turn_freely(const world* w, const double* I, const double* spin, double* change) {
  int steps = 1 + (int)fmin(1000, HCB_TURN * w->h * sqrt(dot(spin, spin)));
  double now[3] = {spin[0], spin[1], spin[2]}, at[3], rate[5][3] = {{0}}, h = w->h / steps;
  for (int step = 0; step < steps; step++) {
    for (int stage = 1; stage <= 4; stage++) {
      double part = stage == 1 ? 0 : stage == 4 ? h : h / 2;
      for (int k = 0; k < 3; k++) at[k] = now[k] + part * rate[stage - 1][k];
      for (int k = 0; k < 3; k++) {
        int y = (k + 1) % 3, z = (k + 2) % 3;
        rate[stage][k] = I[k] > 0 ? (I[y] - I[z]) * at[y] * at[z] / I[k] : 0;
      }
    }
    for (int k = 0; k < 3; k++) now[k] += h / 6 * (rate[1][k] + 2 * rate[2][k] + 2 * rate[3][k] + rate[4][k]);
  }
  for (int k = 0; k < 3; k++) change[k] = now[k] - spin[k];
}

/* The same, as Bullet's step has it: for bodies of maximal coordinates one Newton step of the implicit rule. */
static void turn_as_bullet(const world* w, const body* b, const double* spin, double* change) {
  const double* I = b->base->info.inertia;
  double h = w->h, slope[9];
  for (int k = 0; k < 3; k++) {
    int y = (k + 1) % 3, z = (k + 2) % 3;
    change[k] = I[k] > 0 ? h * (I[y] - I[z]) * spin[y] * spin[z] / I[k] : 0;
    slope[4 * k] = 1;
    slope[3 * k + y] = I[k] > 0 ? h * (I[z] - I[y]) * spin[z] / I[k] : 0;
    slope[3 * k + z] = I[k] > 0 ? h * (I[z] - I[y]) * spin[y] / I[k] : 0;
  }
  if (b->base->info.type == MULTI_BODY) return;
  double first[3] = {change[0], change[1], change[2]};
  invert(slope, 3);
  for (int k = 0; k < 3; k++) change[k] = dot(slope + 3 * k, first);
}

/* Adds the torque by which a body without joints turns freely from its spin after an impact. */
static void add_free_turn(const world* w, const body* b, const double* change, double* wrench) {
  const double *q = b->base->pose + 3, *I = b->base->info.inertia;
  double spin[3], after[3], free_[3], own[3], torque[3];
  rotate(q, b->base->motion + 3, -1, spin);
  for (int k = 0; k < 3; k++) after[k] = spin[k] + change[3 + k];
  turn_freely(w, I, after, free_);
  turn_as_bullet(w, b, spin, own);
  for (int k = 0; k < 3; k++) torque[k] = I[k] * (free_[k] - own[k]) / w->h;
  rotate(q, torque, 1, torque);
  for (int k = 0; k < 3; k++) wrench[3 + k] += torque[k];
}

/* How far a body without joints turns in a step after an impact, rad. */
static double free_turn_of(const world* w, const body* b, const double* change) {
  double spin[3];
  rotate(b->base->pose + 3, b->base->motion + 3, -1, spin);
  for (int k = 0; k < 3; k++) spin[k] += change[3 + k];
  return w->h * sqrt(dot(spin, spin));
}

/* Adds to the velocities of a jointed body's link what a change of the freedoms does. */
static void add_motion(const body* b, int link, const double* change, double* motion) {
  double turn[3];
  for (int q = 0; q < b->freedoms; q++) {
    if (!carries(b, b->owner[q], link)) continue;
    cross(b->twist_w[q], b->link[link].pose, turn);
    for (int k = 0; k < 3; k++) {
      motion[k] += (turn[k] + b->twist_v[q][k]) * change[q];
      motion[3 + k] += b->twist_w[q][k] * change[q];
    }
  }
}

/* A force at a link's centre of mass, and a torque: as two forces, as Bullet takes torques in different frames. */
static void push_wrench(world* w, const body* b, int link, const double* wrench) {
  const double *torque = wrench + 3, *centre = b->link[link].pose;
  double force[3] = {wrench[0], wrench[1], wrench[2]}, along[3] = {0}, arm[3], at[3], pull[3];
  along[fabs(torque[0]) < fabs(torque[1]) ? 0 : 1] = 1;
  cross(torque, along, arm);
  double size = sqrt(dot(arm, arm));
  if (size > 0) {
    for (int k = 0; k < 3; k++) arm[k] /= size, at[k] = centre[k] + arm[k];
    cross(torque, arm, pull);
    for (int k = 0; k < 3; k++) force[k] -= pull[k];
    push(w, b, link, at, pull);
  }
  if (dot(force, force) > 0) push(w, b, link, centre, force);
}

/* How far a jointed body turns in a step, rad. */
static double turn_of(const world* w, const body* b, double (*motion)[6]) {
  double most = 0;
  for (int i = 0; i < b->links; i++) {
    const double *own = motion[i + 1] + 3, *above = motion[b->link[i].parent + 1] + 3;
    double turn[3] = {own[0] - above[0], own[1] - above[1], own[2] - above[2]};
    most = fmax(most, fmax(dot(own, own), dot(turn, turn)));
  }
  return w->h * sqrt(most);
}

/* The fastest that the base or a joint of a body turns, rad/s. */
static double rate_of_joints(const body* b, double (*motion)[6]) {
  double most = dot(motion[0] + 3, motion[0] + 3);
  for (int i = 0; i < b->links; i++) {
    const double *own = motion[i + 1] + 3, *above = motion[b->link[i].parent + 1] + 3;
    double turn[3] = {own[0] - above[0], own[1] - above[1], own[2] - above[2]};
    most = fmax(most, dot(turn, turn));
  }
  return sqrt(most);
}

/* Pushes a body so that its step goes on from the velocities after an impact, which changes its freedoms; how far it then
   turns in a step if it has joints, rad; rate: as `rate_of_joints`. */
static double go_on_from(world* w, const body* b, const double* change, double* rate) {
  size_t links = (size_t)b->links + 1;
  double(*motion)[6] = (double(*)[6])take(w, 12 * links), (*wrench)[6] = motion + links;
  memset(wrench, 0, links * sizeof(*wrench));
  if (!b->is_tree) {
    add_free_turn(w, b, change, wrench[0]);
    push_wrench(w, b, -1, wrench[0]);
    return 0;
  }
  for (int i = -1; i < b->links; i++) memcpy(motion[i + 1], b->link[i].motion, sizeof(*motion));
  add_inertial(w, b, motion, 1, wrench);
  for (int i = -1; i < b->links; i++) add_motion(b, i, change, motion[i + 1]);
  add_inertial(w, b, motion, -1, wrench);
  for (int i = -1; i < b->links; i++) push_wrench(w, b, i, wrench[i + 1]);
  *rate = rate_of_joints(b, motion);
  return turn_of(w, b, motion);
}
