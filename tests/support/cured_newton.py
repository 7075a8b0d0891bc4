"""Newton's solvers without what is named as the cause of a failed case: an adapter of the cases.

Newton's own Python runs it; the order of ENGINES is that of `CURED` in tests/cases/test_reasons.py.
"""

from __future__ import annotations

import runpy
from functools import partial
from pathlib import Path
from typing import Any

ADAPTER = Path(__file__).parents[2] / "hcbench" / "engines" / "newton" / "cases.py"
Best: Any = runpy.run_path(str(ADAPTER))["NewtonBodies"]
OPTIONS = {"enable_restitution": True, "iterations": 10}


class FromTheStart(Best):  # type: ignore[misc]
    """A ball that turns in a step leaves from where it was at its start, not from the floor."""

    def step(self) -> None:
        before = self.at.body_q.numpy()[:, 2].copy()
        falls = self.at.body_qd.numpy()[:, 2] < 0
        super().step()
        turned = falls & (self.at.body_qd.numpy()[:, 2] > 0)
        if turned.any():
            places = self.at.body_q.numpy().copy()
            places[turned, 2] = before[turned]
            self.at.body_q.assign(places)


class ShorterSteps(Best):  # type: ignore[misc]
    """Many steps of the solver in one of the world."""

    steps = 20

    def make(self, world: dict[str, Any]) -> None:
        super().make({**world, "timestep": world["timestep"] / self.steps})

    def step(self) -> None:
        for _ in range(self.steps):
            super().step()


class WholeFriction(ShorterSteps):
    """Friction's limit is of the whole impulse: times 1 + e, and over the part that is a push.

    The push is out of the floor, by the share of the last step that the ball has been in it: of a
    flight of 2.4625 steps of the world, 0.5375 of a step.
    """

    steps = 1
    share = 0.5375

    def make(self, world: dict[str, Any]) -> None:
        whole = world["friction"] * (1 + world["restitution"]) / self.share
        super().make({**world, "friction": whole})


class WholeFrictionInShorterSteps(WholeFriction):
    """The same with a twentieth of the turn in a step; 49.25 steps of flight, 0.75 in the floor."""

    steps = 20
    share = 0.75


class SoftSpring(Best):  # type: ignore[misc]
    """A spring so soft that it hardly throws back what the damper has stopped."""

    gains = dict.fromkeys(Best.gains, (2e-4, 1.0))


class MuchShorterSteps(ShorterSteps, SoftSpring):
    """The damper that stands for friction at rest may be stronger, the shorter the step is."""

    steps = 400


# SemiImplicit and Featherstone have the same contacts.
BY_FORCE = [
    partial(cured, solver, None, {"angular_damping": 0})
    for solver in ("SemiImplicit", "Featherstone")
    for cured in (MuchShorterSteps, SoftSpring)
]
ENGINES = [
    partial(cured, "XPBD", "average", OPTIONS)
    for cured in (FromTheStart, ShorterSteps, WholeFriction, WholeFrictionInShorterSteps)
] + BY_FORCE
