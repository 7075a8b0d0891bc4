/* e of eq. (16) over d = (3/2) alpha v, to the last digits. */

static double power_terms(double z, double limit) { /* z^2/2 - z^3/3 + ... = z - ln(1 + z), |z| <= limit */
  double term = z, sum = 0;
  if (fabs(z) > limit) return z - log1p(z);
  for (int k = 2; k < 80 && fabs(term) > 1e-18 * fabs(sum); k++) {
    term *= -z;
    sum -= term / k;
  }
  return sum;
}

static double exponential_terms(double w) { /* w - 1 + exp(-w) */
  double term = -w, sum = 0;
  if (w > 0.5) return w + expm1(-w);
  for (int k = 2; k < 30; k++) {
    term *= -w / k;
    sum += term;
  }
  return sum;
}

/* e of (16) where d = (3/2) alpha v: d e = 1 - exp(-w) with w - 1 + exp(-w) = d - ln(1 + d). */
double hcb_restitution(double d) {
  if (!(d > 0)) return 1;
  double c = power_terms(d, 0.3), w = c > 1 ? c + 1 : sqrt(2 * c) + c / 3;
  for (int round = 0; round < 60; round++) {
    double change = (exponential_terms(w) - c) / -expm1(-w);
    w -= change;
    if (fabs(change) <= 1e-9 * w) break; /* the error left is of its square */
  }
  return -expm1(-w) / d;
}
