/* The speed v_i at which an impact began, from any state within it: what F = k x^n (1 + chi x'/v_i) needs, and need
   not be remembered. With u = x'/v_i, a contact under this force alone has

     v_i^2 (H(1) - H(u)) = kappa x^(n+1)/(n+1),   H(u) = (chi u - ln(1 + chi u))/chi^2,

   whose left side rises with v_i. A constant acceleration b towards contact does the work b times the integral of
   dx/(1 + chi u), which is taken off the right side: found on the path without b, to first order, and at most 3/4 of
   the stored energy, so that the damping of a body at rest stays finite. With steel under its own weight e is wrong by up
   to 1e-6 at 0.5 m/s, 7e-6 at 0.1, 2e-4 at 0.025. Other loads are not seen. */

static const double gauss_nodes[] = {0.06943184420297371, 0.33000947820757187, 0.6699905217924281,
                                   0.9305681557970263};
static const double gauss_weights[] = {0.17392742256872692, 0.32607257743127307, 0.32607257743127307,
                                     0.17392742256872692};

static double energy_ratio(double chi, double u) { return power_terms(chi * u, 0.3) / (chi * chi); }

static double speed_for_energy(double stored, double chi, double e, double v) {
  double one = energy_ratio(chi, 1), lowest = v >= 0 ? v : fmax(-v / e, -v * chi * (1 + 1e-12));
  double speed = fmax(sqrt(fmax(stored + 0.5 * v * v, 0) / one), lowest);
  for (int round = 0; round < 60 && speed > 1e-150; round++) {
    double u = v / speed, left = one - energy_ratio(chi, u), before = speed;
    double step = (speed * speed * left - stored) / (speed * (2 * left + u * u / (1 + chi * u)));
    speed = fmax(speed - step, lowest);
    if (fabs(before - speed) <= 1e-15 * speed) break;
  }
  return speed;
}

/* A part of the work in or out, way +-1, over w = sqrt(1 - x/x_m). */
static double work_of_leg(double n, double chi, double e, double one, double w0, double w1, int way) {
  double total = 0;
  for (int i = 0; i < 4; i++) {
    double w = w0 + (w1 - w0) * gauss_nodes[i], share = 1 - pow(1 - w * w, n + 1);
    double u = way > 0 ? sqrt(share) : -e * sqrt(share);
    for (int round = 0; round < 8 && u != 0; round++) {
      double change = (energy_ratio(chi, u) - share * one) * (1 + chi * u) / u;
      u = fmax(u - change, -e);
      if (fabs(change) <= 1e-9) break;
    }
    total -= gauss_weights[i] * 2 * w * (w1 - w0) / fmax(1 + chi * u, 1e-12);
  }
  return total;
}

static double work_of_load(double kappa, double n, double chi, double e, double x, double v, double speed) {
  double one = energy_ratio(chi, 1), deepest = pow((n + 1) * speed * speed * one / kappa, 1 / (n + 1));
  if (deepest < x) deepest = x;
  double now = sqrt(1 - x / deepest);
  if (v >= 0) return deepest * work_of_leg(n, chi, e, one, 1, now, 1);
  return deepest * (work_of_leg(n, chi, e, one, 1, 0, 1) + work_of_leg(n, chi, e, one, 0, now, -1));
}

double hcb_touch_speed(double kappa, double n, double chi, double e, double load, double x, double v) {
  if (x <= 0) {
    double square = v > 0 ? v * v - 2 * load * x : v * v + 2 * load * x;
    return sqrt(fmax(square, 0)) * (v > 0 ? 1 : 1 / e);
  }
  double stored = kappa * pow(x, n + 1) / (n + 1), speed = speed_for_energy(stored, chi, e, v);
  for (int round = 0; round < 2 && load != 0; round++) {
    double work = load * work_of_load(kappa, n, chi, e, x, v, speed);
    speed = speed_for_energy(stored - fmin(work, 0.75 * stored), chi, e, v);
  }
  return speed;
}
