"""The search that all identifications here use."""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import optimize

from hcbench.terms.impact import Floats


def least(
    function: Callable[[Floats], float], start: Floats, step: float, evaluations: int | None = None
) -> tuple[Floats, float]:
    """Minimize a function of some unknowns by Nelder and Mead; return the minimum's place and
    value.

    step: by which the first simplex differs from the start, in each unknown.
    """
    simplex = np.vstack([start, start + step * np.eye(len(start))])
    options: Any = {"initial_simplex": simplex, "maxfev": evaluations}
    best: Any = optimize.minimize(function, start, method="Nelder-Mead", options=options)
    return best.x, float(best.fun)
