// Drops in the model of a setting's rows: what _Drops._run_by_arrays of judge.py does, a drop after
// the other. Sums and products are in the order of NumPy's, so both have the same bits where NumPy's
// power is the C library's.

#include <math.h>

// One row; the fields of judge.py's _Row.
typedef struct {
  double onset, d0, dw, width, midpoint, power;
  // What divides the powers of the impedance's two branches, up to the midpoint and from it on.
  double early, late;
  // Of the reference: stiffness, what it is divided by, and damping over dw.
  double stiffness, squared, damping;
  double may_pull;
} Row;

// The fields of judge.py's _Goal.
typedef struct {
  double h, g;
  // g h / 2, 2 g, g h and g h², as Python rounds them.
  double half_gain, twice_g, gain, fall;
  // A larger e gains energy.
  double most_e;
  // A drop ends after so many s, or after so many steps in contact without a parting.
  double lasts, rested;
  int rows;
  int most_steps;
  // True where a drop ends with its first rebound.
  int is_single;
} Goal;

// The most rows that a setting can have here; judge.py's _MOST_ROWS.
enum { MOST_ROWS = 64 };

// As `impedance` of scene/rows.py.
static double impedance(const Row* row, double depth) {
  double u = fmin(fmax(depth / row->width, 0.0), 1.0);
  if (row->power == 1.0) return row->d0 + (row->dw - row->d0) * u;
  double sigmoid = u <= row->midpoint ? pow(u, row->power) / row->early
                                      : 1.0 - pow(1.0 - u, row->power) / row->late;
  return row->d0 + (row->dw - row->d0) * sigmoid;
}

// As `acceleration` of scene/rows.py.
static double acceleration(const Goal* goal, const Row* rows, double x, double v) {
  double reference[MOST_ROWS], weight[MOST_ROWS];
  for (int i = 0; i < goal->rows; i++) {
    const Row* row = rows + i;
    double depth = x - row->onset;
    weight[i] = 0.0;
    reference[i] = 0.0;
    // Without a weight no row acts.
    if (!(depth > 0.0)) continue;
    double d = impedance(row, depth);
    weight[i] = d / (1.0 - d);
    reference[i] = d * row->stiffness / row->squared * depth + row->damping * v;
  }
  for (;;) {
    double pushed = 0.0, weights = 0.0;
    for (int i = 0; i < goal->rows; i++) {
      pushed += weight[i] * reference[i];
      weights += weight[i];
    }
    double a = (pushed - goal->g) / (1.0 + weights);
    int is_pulled = 0;
    for (int i = 0; i < goal->rows; i++) {
      if (!(reference[i] < a && weight[i] > 0.0) || rows[i].may_pull) continue;
      weight[i] = 0.0;
      is_pulled = 1;
    }
    if (!is_pulled) return a;
  }
}

// Simulate `count` drops of penetration x, m, rate v and speed at the last touch, m/s, each (count);
// all three are changed. `rebounds`, (count), takes the speed of the last touch of those that bounce
// on at the end, 0 of the others; `extremes` the largest e, and the fastest touch that gained energy.
void run_drops(const Goal* goal, const Row* rows, int count, double* x, double* v, double* speed,
               double* rebounds, double* extremes) {
  extremes[0] = extremes[1] = 0.0;
  for (int i = 0; i < count; i++) {
    double clock = 0.0, still = 0.0;
    rebounds[i] = 0.0;
    for (int k = 0; k < goal->most_steps; k++) {
      v[i] -= goal->h * acceleration(goal, rows, x[i], v[i]);
      x[i] += goal->h * v[i];
      clock += goal->h;
      still += 1.0;
      if (x[i] <= 0.0 && v[i] < 0.0) {
        double half = v[i] + goal->half_gain;
        double squared = half * half - goal->twice_g * x[i];
        double out = sqrt(squared > 0.0 ? squared : 0.0);
        double e = out / speed[i];
        if (e > extremes[0]) extremes[0] = e;
        if (e > goal->most_e && speed[i] > extremes[1]) extremes[1] = speed[i];
        if (goal->is_single) break;
        speed[i] = out;
        still = 0.0;
        // The flight to the first state in contact, in closed form.
        double steps = floor((-half + sqrt(squared)) / goal->gain) + 1.0;
        x[i] = x[i] + steps * goal->h * half + goal->fall * (steps * steps) / 2.0;
        v[i] = v[i] + goal->gain * steps;
        clock += steps * goal->h;
      }
      if (clock <= goal->lasts && still < goal->rested) continue;
      if (clock > goal->lasts) rebounds[i] = speed[i];
      break;
    }
  }
}
