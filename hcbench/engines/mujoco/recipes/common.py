"""What the recipes of MuJoCo's own contact share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.tune.recipe import Integrators

if TYPE_CHECKING:
    from hcbench.engines.mujoco.rows import ConstraintRow

DAMPED_STEP = Integrators(("Euler", "implicit", "implicitfast", "RK4"), "its damping is off by the step")


def rows_options(integrator: str, *rows: ConstraintRow) -> dict[str, Any]:
    """A setting's options with these rows as contact."""
    return {"integrator": integrator, "rows": [row.option() for row in rows]}
