"""Functions shared by the recipes of MuJoCo's own contact."""

from typing import Any

import numpy as np

from hcbench.engines.mujoco.scene.rows import MIN_IMPEDANCE, ConstraintRow
from hcbench.recipes.recipe import Integrators
from hcbench.terms.impact import Floats

# Of springs that start at a depth of their own: the least impedance throughout.
SPRING_SOLIMP = (MIN_IMPEDANCE, MIN_IMPEDANCE, 1.0, 0.5, 1.0)
# Notes of contacts that are softened where the law's would be too short for the step.
SOFTENED = "Use a softened spring without gravity only: under gravity slow bodies sink, swing or never part."
WEAK_FRICTION = (
    "Friction is far too weak: up to 95 % below Coulomb's law. Restitution is unaffected."
)
DAMPED_STEP = Integrators(
    ("Euler", "implicit", "implicitfast", "RK4"), "it changes the damping with the step"
)


def nonnegative_fit(columns: Floats, goal: Floats) -> tuple[Floats, float]:
    """Non-negative least squares: the x >= 0, (k,), with the least |columns x - goal|, and that
    misfit.

    columns: (n, k), each in a unit of its own: they are scaled to length 1 for the solver.
    goal: (n,). x is 0 for a column of zeros.
    """
    # SciPy's optimisation is slow to import, and few recipes need it.
    from scipy.optimize import nnls

    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0.0] = 1.0
    x, misfit = nnls(columns / norms, goal, maxiter=10_000)
    return x / norms, float(misfit)


def rows_options(integrator: str, *rows: ConstraintRow) -> dict[str, Any]:
    """A setting's options with these rows as contact."""
    return {"integrator": integrator, "rows": [row.option() for row in rows]}
