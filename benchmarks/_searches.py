"""A user's own way without hcbench: search solref and solimp of one contact by a Python loop."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from _bounces import bounce, mujoco_model
from scipy.optimize import differential_evolution

SPEEDS, PHASES = np.geomspace(0.1, 3.0, 6), (0.15, 0.4, 0.65, 0.9)
# log10 stiffness, log10 damping, d0, dwidth, log10 width, midpoint, power
LOW = np.array([2.0, 0.0, 1e-4, 0.05, -4.0, 0.1, 1.0])
HIGH = np.array([6.0, 4.0, 0.9999, 0.9999, -1.0, 0.9, 5.0])
START = np.array(
    [5.0, 2.0, 0.9, 0.95, -3.0, 0.5, 2.0]
)  # a spring-damper with MuJoCo's default solimp


class OutOfTimeError(Exception):
    """The search has had its budget."""


def paste(x: np.ndarray, timestep: float) -> str:
    """The contact of seven numbers, to be pasted."""
    k, b, d0, dw, width, midpoint, power = (float(v) for v in x)
    solimp = f"{min(d0, dw)} {dw} {10**width} {midpoint} {power}"
    return (
        f'<option timestep="{timestep}"/>\n<pair geom1="ball" geom2="plate" condim="1"'
        f' solref="{-(10**k)} {-(10**b)}" solimp="{solimp}"/>'
    )


@dataclass
class StepLoop:
    """Errors of e by a Python loop over mj_step; keeps the best, stops at the deadline."""

    wanted: Any
    timestep: float
    deadline: float

    def __post_init__(self) -> None:
        self.calls, self.best = 0, (np.inf, START)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        if time.perf_counter() > self.deadline:
            raise OutOfTimeError
        self.calls += 1
        model = mujoco_model(paste(x, self.timestep))
        off = np.array(
            [bounce(model, v, p).e - float(self.wanted.at(v)) for v in SPEEDS for p in PHASES]
        )
        if np.abs(off).max() < self.best[0]:
            self.best = (float(np.abs(off).max()), np.array(x))
        return off


def by_evolution(loop: StepLoop) -> None:
    bounds = list(zip(LOW, HIGH, strict=True))
    differential_evolution(
        lambda x: np.abs(loop(x)).max(), bounds, seed=1, x0=START, popsize=10, tol=0
    )


def by_sysid(loop: StepLoop) -> None:
    from mujoco import sysid

    parameters = sysid.ParameterDict()
    parameters.add(sysid.Parameter("contact", START, LOW, HIGH))

    def residual(x: np.ndarray, _: object) -> tuple[list[np.ndarray], None, None]:
        # One column a trial.
        return [np.stack([loop(column) for column in np.atleast_2d(x.T)], axis=1)], None, None

    sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False)


def searched(
    method: Callable[[StepLoop], None], wanted: Any, timestep: float, budget: float
) -> StepLoop:
    """The loop after a search of so many seconds, with what it has found."""
    loop = StepLoop(wanted, timestep, time.perf_counter() + budget)
    with suppress(OutOfTimeError):
        method(loop)
    return loop


def methods() -> dict[str, Callable[[StepLoop], None]]:
    """mujoco.sysid where it is installed, and SciPy."""
    candidates = {"scipy differential_evolution, Python step loop": by_evolution}
    try:
        from mujoco import sysid

        sysid.optimize  # noqa: B018 - there only with the extra installed
    except (ImportError, AttributeError):
        print('mujoco.sysid is left out: pip install "mujoco[sysid]"')
        return candidates
    return {"mujoco.sysid optimize, Python step loop": by_sysid, **candidates}
