// Errors of settings of a spring row and a damper row: what RowFit._errors of row_pair.py does, a
// launch after the other, so that a setting is left where it is worse than its limit. Sums and
// products are in the order of NumPy's, so both have the same bits.

#include <math.h>

// The numbers of `_Rows` of row_pair.py for one setting, in its units.
typedef struct {
  double stiffness, damping, damper, dmax, width, midpoint, rise, level;
} Rows;

// The goal of a fit, a RowFit; the fields of row_pair.py's _Goal.
typedef struct {
  // Of each launch: speed, where in a step it starts, and e, NaN where any e will do.
  const double* speeds;
  const double* phases;
  const double* target;
  int launches;
  // Steps for which a launch is followed.
  int steps;
  int adhesive;
  int rk4;
  double fall;
  double corners;
  // Weight of the spring in MuJoCo's sums, and the impedance at touch.
  double spring_weight;
  double least_impedance;
  // Depth and e above which errors grow, and by how much they grow with e.
  double deepest;
  double largest_e;
  double costs;
} Goal;

// The larger of two, NaN where one is NaN: np.maximum.
static double larger(double a, double b) { return isnan(a) || a > b ? a : b; }

// As RowFit._acceleration.
static double acceleration(const Goal* goal, const Rows* rows, double x, double v) {
  if (x <= 0.0) return -goal->fall;
  double u = x / rows->width;
  if (u > 1.0) u = 1.0;
  int is_early = u <= rows->midpoint;
  double sigmoid = is_early ? u : 1.0 - u;
  sigmoid *= sigmoid;
  sigmoid *= sigmoid;
  sigmoid *= is_early ? rows->rise : rows->level;
  double d = is_early ? goal->least_impedance + sigmoid : rows->dmax - sigmoid;
  double weight = goal->corners * d / (1.0 - d);
  double spring = rows->stiffness * x + rows->damping * v;
  double damper = rows->damper * v;
  double a = (spring + weight * damper - goal->fall) / (1.0 + goal->spring_weight + weight);
  if (!goal->adhesive && damper < a) {
    weight = 0.0;
    a = (spring + weight * damper - goal->fall) / (1.0 + goal->spring_weight + weight);
  }
  if (spring < goal->spring_weight * a) a = (weight * damper - goal->fall) / (1.0 + weight);
  return a;
}

// As RowFit._step.
static void step(const Goal* goal, const Rows* rows, double* x, double* v) {
  if (!goal->rk4) {
    *v -= acceleration(goal, rows, *x, *v);
    *x += *v;
    return;
  }
  double one = -acceleration(goal, rows, *x, *v);
  double two = -acceleration(goal, rows, *x + *v / 2, *v + one / 2);
  double three = -acceleration(goal, rows, *x + *v / 2 + one / 4, *v + two / 2);
  double four = -acceleration(goal, rows, *x + *v + two / 2, *v + three);
  *x = *x + *v + (one + two + three) / 6;
  *v = *v + (one + 2 * two + 2 * three + four) / 6;
}

// e of one launch, 0 where it has not parted; its largest penetration goes to `deepest`.
static double launched(const Goal* goal, const Rows* rows, int i, double* deepest) {
  double g = goal->fall, speed = goal->speeds[i];
  double later = goal->rk4 ? -goal->phases[i] : 1.0 - goal->phases[i];
  double ahead = goal->rk4 ? 0.0 : 0.5;
  double x = speed * later + g * (later * later) / 2;
  double v = speed + g * (later - ahead);
  *deepest = x;
  for (int k = 0; k < goal->steps; k++) {
    step(goal, rows, &x, &v);
    *deepest = larger(*deepest, x);
    if (!(x <= 0.0 && v < 0.0)) continue;
    double half = v + g * ahead;
    double squared = half * half - 2 * g * x;
    return sqrt(larger(0.0, squared)) / speed;
  }
  return 0.0;
}

// Errors of `count` settings into `errors`; of one whose error is above its limit, any number that
// is, too.
void row_errors(const Goal* goal, const Rows* rows, int count, const double* limits,
                double* errors) {
  for (int k = 0; k < count; k++) {
    double off = 0.0, deep = -INFINITY, largest = -INFINITY;
    for (int i = 0; i < goal->launches; i++) {
      double deepest;
      double e = launched(goal, rows + k, i, &deepest);
      largest = larger(largest, e);
      if (!isnan(goal->target[i])) {
        off = larger(off, fabs(e - goal->target[i]));
        deep = larger(deep, deepest);
      }
      double gained = larger(0.0, largest - goal->largest_e);
      errors[k] = off + (larger(0.0, deep - goal->deepest) + goal->costs * gained);
      if (errors[k] > limits[k]) break;
    }
  }
}
