/* The law of Hunt and Crossley over one time step of an engine: eq. (16), x'' = b - kappa x^n (1 + a x'), no tension,
   kappa = k/m, a = (3/2) alpha, x > 0 in contact, m an effective mass, b the acceleration by all else.

   A force sampled at the start of each step is of first order in the step, worst in the steps in which the bodies touch
   and part. Here the motion itself is advanced, through touch and parting; the force is the one with which the engine's
   own update arrives at its end:
   Semi-implicit Euler, v' = v + h A, x' = x + h v': positions can be exact, v is then the mean rate over the step
   before. hcb_euler_force finds the motion through x - h v and x (a secant search for the rate at x) and aims at its
   next position. In free flight v is the rate itself: speeds before and after an impact are exact at any step.
   Classical Runge-Kutta: v is the rate at the start; hcb_rk4_stage_forces chooses the forces of the stages so that
   position and rate come out exact.
   Nothing is remembered between steps. What is left is the error of advancing the motion: a Taylor series of order 8
   where touch and parting are far, else RK4 in s = sqrt(time from touch), in which x^n is smooth. The restitution is of
   order h^2.5 or better, down to some 1e-6 of eight sub-steps a contact. */

#ifndef HCB_EXACT_STEP_C
#define HCB_EXACT_STEP_C

#include <math.h>

#define HCB_SUBSTEP 0.2 /* largest sub-step, in units of 1/omega */
#define HCB_SUBSTEPS_AT_TOUCH 8 /* of a piece of the motion that begins or ends at touch */
#define HCB_MAX_ITERATIONS 16
#define HCB_TERMS 8
#define HCB_LEAST_SPEED 1e-9 /* m/s: slower impacts count as of this speed where a law depends on it */
#define HCB_FAR 2.5 /* steps from touch and parting, from where on the series is good */

/* chi not 0: each impact has its own a = chi/v_i, and `a` is what it has just now; e: what chi delivers; load:
   the b that v_i is worked out with; speed_min: the least v_i. */
typedef struct {
  double kappa, a, n, b, chi, e, load, speed_min;
} hcb_law;

#include "restitution.c"
#include "touch_speed.c"

/* The law of the impact that is at x with rate v. */
static void set_touch_speed(hcb_law* law, double x, double v) {
  if (law->chi == 0) return;
  double speed = hcb_touch_speed(law->kappa, law->n, law->chi, law->e, law->load, x, v);
  law->a = law->chi / fmax(speed, fmax(law->speed_min, HCB_LEAST_SPEED));
}

/* The law for a step h: speeds below what the load adds in one step count as rest. */
static hcb_law with_step(const hcb_law* law, double h) {
  hcb_law own = *law;
  if (own.chi != 0) own.speed_min = fmax(HCB_LEAST_SPEED, h * fabs(own.b));
  return own;
}

static double power(double x, double n) {
  return n == 1.5 ? x * sqrt(x) : n == 1.0 ? x : pow(x, n);
}

static double acceleration(const hcb_law* law, double x, double v) {
  if (x <= 0) return law->b;
  double push = 1 + law->a * v;
  return push > 0 ? law->b - law->kappa * power(x, law->n) * push : law->b;
}

static double frequency_squared(const hcb_law* law, double x) { /* omega^2 */
  return x > 0 ? law->kappa * law->n * (law->n == 1.5 ? sqrt(x) : pow(x, law->n - 1)) : 0;
}

static int substeps(double near, double piece) {
  double ratio = near / piece;
  return ratio < 1 ? HCB_SUBSTEPS_AT_TOUCH : ratio < 4 ? 6 : ratio < 16 ? 3 : 1;
}

/* RK4 in s with t = t0 + sign (s^2 - s0^2): smooth through the x^n at touch. */
static void rk4_in_root_of_time(const hcb_law* law, double* x, double* v, double s0, double s1, int sign, int count) {
  double ds = (s1 - s0) / count, X = *x, V = *v;
  for (int i = 0; i < count; i++) {
    double s = s0 + i * ds, w1 = 2 * sign * s, w2 = w1 + sign * ds, w4 = w1 + 2 * sign * ds;
    double x1 = w1 * V, v1 = w1 * acceleration(law, X, V);
    double V2 = V + 0.5 * ds * v1, x2 = w2 * V2, v2 = w2 * acceleration(law, X + 0.5 * ds * x1, V2);
    double V3 = V + 0.5 * ds * v2, x3 = w2 * V3, v3 = w2 * acceleration(law, X + 0.5 * ds * x2, V3);
    double V4 = V + ds * v3, x4 = w4 * V4, v4 = w4 * acceleration(law, X + ds * x3, V4);
    X += ds / 6 * (x1 + 2 * x2 + 2 * x3 + x4);
    V += ds / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
  }
  *x = X;
  *v = V;
}

/* RK4 in t, for where the body turns and any x. */
static void rk4_in_time(const hcb_law* law, double* x, double* v, double time, int count) {
  double dt = time / count, X = *x, V = *v;
  for (int i = 0; i < count; i++) {
    double v1 = acceleration(law, X, V);
    double V2 = V + 0.5 * dt * v1, v2 = acceleration(law, X + 0.5 * dt * V, V2);
    double V3 = V + 0.5 * dt * v2, v3 = acceleration(law, X + 0.5 * dt * V2, V3);
    double V4 = V + dt * v3, v4 = acceleration(law, X + dt * V3, V4);
    X += dt / 6 * (V + 2 * V2 + 2 * V3 + V4);
    V += dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
  }
  *x = X;
  *v = V;
}

static double slope(const hcb_law* law, double y, double v) {
  return 2 * y * acceleration(law, y * y, v) / v;
}

/* From x > 0, v < 0 to x = 0, in y = sqrt(x): the time it takes, or -1 if it turns before; v at parting. */
static double part(const hcb_law* law, double x, double* v) {
  double dy = -sqrt(x) / HCB_SUBSTEPS_AT_TOUCH, V = *v, time = 0;
  for (int i = HCB_SUBSTEPS_AT_TOUCH; i > 0; i--) {
    double y = -i * dy, ym = y + 0.5 * dy, ye = -(i - 1) * dy;
    double k1 = slope(law, y, V), V2 = V + 0.5 * dy * k1;
    if (V2 >= 0) return -1;
    double k2 = slope(law, ym, V2), V3 = V + 0.5 * dy * k2;
    if (V3 >= 0) return -1;
    double k3 = slope(law, ym, V3), V4 = V + dy * k3;
    if (V4 >= 0) return -1;
    double k4 = slope(law, ye, V4);
    time += dy / 6 * (2 * y / V + 4 * ym / V2 + 4 * ym / V3 + 2 * ye / V4);
    V += dy / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    if (V >= 0) return -1;
  }
  *v = V;
  return time;
}

/* Time until a body at x <= 0 touches; infinite if it never does. */
static double time_to_touch(const hcb_law* law, double x, double v) {
  if (x == 0) return v > 0 || (v == 0 && law->b > 0) ? 0 : law->b > 0 ? -2 * v / law->b : INFINITY;
  double square = v * v - 2 * law->b * x;
  double sum = square >= 0 ? v + sqrt(square) : -1;
  return sum > 0 ? -2 * x / sum : INFINITY;
}

/* The exact motion over `time` >= 0, through touch and parting. */
void hcb_advance(const hcb_law* given, double time, double* x, double* v) {
  hcb_law own = *given, *law = &own;
  double X = *x, V = *v;
  for (int round = 0; time > 0 && round < 10000; round++) {
    if (X <= 0) {
      double free = time_to_touch(law, X, V);
      if (!(free < time)) {
        X += (V + 0.5 * law->b * time) * time;
        V += law->b * time;
        break;
      }
      V += law->b * free;
      time -= free;
      X = 0;
      if (own.chi != 0) own.a = own.chi / fmax(V, own.speed_min);
      double rate = sqrt(frequency_squared(law, V * time + 0.5 * law->b * time * time));
      double piece = rate * time > HCB_SUBSTEP ? HCB_SUBSTEP / rate : time;
      if (V > 0) {
        rk4_in_root_of_time(law, &X, &V, 0, sqrt(piece), 1, HCB_SUBSTEPS_AT_TOUCH);
      } else {
        rk4_in_time(law, &X, &V, piece, HCB_SUBSTEPS_AT_TOUCH);
      }
      time -= piece;
      continue;
    }
    double rate = sqrt(frequency_squared(law, X + (V > 0 ? V * time : 0)));
    double piece = rate * time > HCB_SUBSTEP ? HCB_SUBSTEP / rate : time;
    double near = X / fabs(V); /* time since touch, or to parting */
    if (V < 0 && near < 2 * piece) {
      double out = V, left = part(law, X, &out);
      if (left >= 0 && left <= time) {
        X = 0;
        V = out;
        time -= left;
        continue;
      }
    }
    if (V > 0 && near < 1e6 * piece) {
      rk4_in_root_of_time(law, &X, &V, sqrt(near), sqrt(near + piece), 1, substeps(near, piece));
    } else if (V < 0 && near > 1.01 * piece && near < 1e6 * piece) {
      rk4_in_root_of_time(law, &X, &V, sqrt(near), sqrt(near - piece), -1, substeps(near - piece, piece));
    } else {
      rk4_in_time(law, &X, &V, piece, near < 1.01 * piece ? HCB_SUBSTEPS_AT_TOUCH : 1);
    }
    time -= piece;
  }
  *x = X;
  *v = V;
}

static const double reciprocal[] = {0, 1, 1. / 2, 1. / 3, 1. / 4, 1. / 5, 1. / 6, 1. / 7, 1. / 8};

/* Where touch and parting are far, the motion is its Taylor series: positions h before and h after. */
static void series(const hcb_law* law, double h, double x, double v, double* before, double* after) {
  double c[HCB_TERMS + 1] = {x, v * h}, u[HCB_TERMS] = {v}, y[HCB_TERMS]; /* of x, v, x^n; powers of t/h */
  double even = x, odd = c[1], inverse = 1 / x, scale = law->kappa * h, n1 = law->n + 1;
  for (int j = 0; j + 2 <= HCB_TERMS; j++) {
    double sum = 0, force = 0;
    for (int i = 1; i <= j; i++) sum += (n1 * i - j) * c[i] * y[j - i];
    y[j] = j ? sum * inverse * reciprocal[j] : power(x, law->n);
    for (int i = 0; i <= j; i++) force += y[i] * u[j - i];
    u[j + 1] = -scale * (y[j] + law->a * force) * reciprocal[j + 1];
    if (j == 0) u[1] += law->b * h;
    c[j + 2] = u[j + 1] * h * reciprocal[j + 2];
    if (j % 2) {
      odd += c[j + 2];
    } else {
      even += c[j + 2];
    }
  }
  *before = even - odd;
  *after = even + odd;
}

static void neighbours(const hcb_law* law, double h, int smooth, double x, double v, double* before, double* after) {
  if (smooth) {
    series(law, h, x, v, before, after);
    return;
  }
  hcb_law reverse = *law;
  reverse.a = -law->a;
  reverse.chi = -law->chi * law->e; /* run backwards, it comes in with -e v_i */
  reverse.speed_min = law->e * law->speed_min;
  double w = -v;
  *before = *after = x;
  hcb_advance(&reverse, h, before, &w);
}

/* F/m >= 0 over a step of semi-implicit Euler that starts at x and came there at the mean rate v over the step
   before: the force that carries x exactly onto the motion. late: NULL but for contacts that are seen only while they
   overlap; of that rate, what the last step's force came too late for. */
double hcb_euler_force(const hcb_law* given, double h, double x, double mean, const double* late) {
  hcb_law own = with_step(given, h), *law = &own;
  double ahead = late ? *late : 0, v = mean + ahead, before = x - h * v;
  if (x <= 0 && before <= 0 && x + h * (v + h * law->b) <= 0) return 0;
  set_touch_speed(law, x, v);
  double rate = h * h * frequency_squared(law, x > before ? x : before);
  double V = v + 0.5 * h * acceleration(law, x, v), V0 = 0, miss0 = 0, last = INFINITY, past, next;
  V = v + 0.5 * h * acceleration(law, x - h / 3 * V, V);
  int smooth = x > HCB_FAR * h * fabs(V) && rate < 0.25 && 1 + law->a * V > 0.5;
  for (int round = 0; round < HCB_MAX_ITERATIONS; round++) {
    set_touch_speed(law, x, V);
    neighbours(law, h, smooth, x, V, &past, &next);
    double miss = past - before, slope = round ? (miss - miss0) / (V - V0) : -h * (1 - fmin(rate / 6, 0.5));
    if (!(slope < -0.1 * h)) slope = -h;
    V0 = V;
    miss0 = miss;
    V -= miss / slope;
    double change = fabs(V - V0), scale = fabs(V) + fabs(v);
    if (change * last <= 1e-9 * scale * scale || change <= 1e-13 * scale) break;
    last = change;
  }
  if (smooth) {
    next += (V - V0) * h * (1 - rate / 6);
  } else {
    double W = V;
    next = x;
    hcb_advance(law, h, &next, &W);
    if (late && next <= 0) return fmax(0, (mean - W) / h + 1.5 * law->b); /* seen for the last time */
  }
  double force = law->b - ((next - before) / h - 2 * v + ahead) / h;
  return force > 0 ? force : 0;
}

/* The same where a contact is seen once it overlaps, after a step that should have had its force: onto the motion that
   began at touch. ahead: out, m/s, for the next step. */
double hcb_late_force(const hcb_law* given, double h, double x, double v, double* ahead) {
  hcb_law own = with_step(given, h);
  double now = x - h * v, next = now, V = v - 0.5 * h * own.b, W = V;
  hcb_advance(&own, h, &now, &V);
  hcb_advance(&own, 2 * h, &next, &W);
  *ahead = (x - now) / h;
  return fmax(0, own.b - ((next - x) / h - v) / h);
}

/* The same for the classical Runge-Kutta method, whose v is the rate at the start: F/m >= 0 at the first, the
   two middle and the last stage that carry x and v exactly onto the motion. */
void hcb_rk4_stage_forces(const hcb_law* given, double h, double x, double v, double stage[3]) {
  hcb_law own = with_step(given, h), *law = &own;
  double X = x, V = v;
  stage[0] = stage[1] = stage[2] = 0;
  if (x <= 0 && x + h * (v + fmax(0, h * law->b)) <= 0) return;
  set_touch_speed(law, x, v);
  double plain = law->b - acceleration(law, x, v);
  hcb_advance(law, 0.5 * h, &X, &V); /* in halves: sub-steps of half the size */
  set_touch_speed(law, X, V);
  hcb_advance(law, 0.5 * h, &X, &V);
  double moved = fmax(0, 6 / (h * h) * (x + h * (v + 0.5 * h * law->b) - X)); /* f1 + 2 f2 */
  double slowed = fmax(moved, 6 / h * (v + h * law->b - V));                  /* f1 + 4 f2 + f4 */
  stage[0] = fmin(fmax(plain, fmax(0, 2 * moved - slowed)), moved);
  stage[1] = 0.5 * (moved - stage[0]);
  stage[2] = slowed - 2 * moved + stage[0];
}

#endif
