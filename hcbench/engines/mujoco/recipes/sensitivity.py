"""Sensitivity of e to small errors of a contact's force: a formula, no simulation."""

import numpy as np

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.terms.impact import Floats

# Points of the law's path, dense where the body turns round.
_POINTS = 501


def restitution_sensitivity(law: HuntCrossley, mass: float, speed: float, grid: Floats) -> Floats:
    """Weights K, (n,), with which an error of a contact's damping changes e: δe = K @ (g - a
    f)(grid).

    law, mass (kg): of the impact. speed: at touch, m/s. grid: penetrations, m, (n,), rising.
    K is in 1/(N s/m).

    f(x), N, and g(x), N s/m, make a force f + g v near that of the law, for which g = a f with a =
    (3/2) α. Only the ratio of g to f matters. With the work U = ∫ f dx as the path, d(v²/2)/dU =
    -(1 + v g/f)/m, and to first order around eq. (16) the integrating factors are 1/(1 + a v) on
    the way in and 1/(1 - a s) on the way out at speed s:

        δe = -(1 - a e v_i)/(m e v_i²) ∫ (v/(1 + a v) + s/(1 - a s)) (g - a f) dx
    """
    a = law.dissipation
    e = float(closed_form.restitution(law.alpha, speed))
    # Dense where v turns.
    x = closed_form.penetration_max(law, mass, speed) * np.sin(np.linspace(0.0, np.pi / 2, _POINTS))
    v = closed_form.rate_at(law, mass, speed, x, "approach")
    s = -closed_form.rate_at(law, mass, speed, x, "rebound")
    integrand = v / (1.0 + a * v) + s / (1.0 - a * s)
    share = (integrand[1:] + integrand[:-1]) / 2.0 * np.diff(x)
    middle = (x[1:] + x[:-1]) / 2.0
    left = np.clip(np.searchsorted(grid, middle) - 1, 0, len(grid) - 2)
    beyond = np.clip((middle - grid[left]) / (grid[left + 1] - grid[left]), 0.0, 1.0)
    weights = np.zeros(len(grid))
    np.add.at(weights, left, share * (1.0 - beyond))
    np.add.at(weights, left + 1, share * beyond)
    return np.asarray(-(1.0 - a * e * speed) / (mass * e * speed**2) * weights)
