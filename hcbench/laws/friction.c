/* Coulomb friction regularised around rest, as `contact_law.Friction` in Python: rises smoothly to `still` at
   `slip_speed` (m/s), falls to `sliding` at thrice that. */

static double hcb_friction(double still, double sliding, double slip_speed, double slip) {
  double s = slip / slip_speed, z = (s - 1) / 2;
  if (s >= 3) return sliding;
  if (s >= 1) return still - (still - sliding) * z * z * z * (10 + z * (6 * z - 15));
  return still * s * s * s * (10 + s * (6 * s - 15));
}
