"""Suspects that may keep a pair in a MuJoCo model from bouncing as asked, with fixes."""

from hcbench.engines.mujoco.model.causes.contact import (
    mixing,
    refsafe,
    sliding_lift,
    solimp,
    solref,
)
from hcbench.engines.mujoco.model.causes.context import Context
from hcbench.engines.mujoco.model.causes.motion import (
    drives,
    gravity,
    integrator,
    limits,
    losses,
    margin,
    resolution,
    servo_damping,
    solver,
)
from hcbench.sim.model_under_test import Suspect

CHECKS = (
    sliding_lift,
    mixing,
    refsafe,
    solref,
    integrator,
    solimp,
    solver,
    resolution,
    gravity,
    losses,
    limits,
    servo_damping,
    drives,
    margin,
)


def find_suspects(context: Context) -> list[Suspect]:
    """Everything that may matter here, likeliest first."""
    suspects: list[Suspect] = []
    for check in CHECKS:
        suspects += check(context)
    return suspects
