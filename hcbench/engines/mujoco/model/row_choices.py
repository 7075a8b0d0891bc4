"""Load on a contact of a user's model, and rows for it that need no search in the model."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.mujoco.recipes.common import SPRING_SOLIMP
from hcbench.engines.mujoco.recipes.compliant_fit import half_period_steps, spring_and_damper_rows
from hcbench.engines.mujoco.scene.rows import STIFF_SOLIMP, ConstraintRow

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.engines.mujoco.model.place import PairAtTouch
    from hcbench.laws.restitution import RestitutionCurve

    Rows = tuple[ConstraintRow, ...]
    Band = tuple[float, float]

# Name of the row that turns a body back in one step.
ONE_STEP = "one step"
# Steps of a spring and damper in contact under RK4.
_RK4_STEPS = 8
# K h² of a contact that stops a body: it pushes out what is inside, and no more.
_STOP = 0.005
# A target e below this is met by a stop.
NO_BOUNCE = 0.02
# No spring and damper is made for a smaller e.
_LEAST_E = 1e-3


@dataclass(frozen=True, slots=True)
class Load:
    """The load on a contact, and the integrator that steps it.

    strength: what all its points together do, over what one does on a free ball: MuJoCo scales a soft row by
        an estimate of the mass (body_invweight0), at each point. gravity: of the approach, m/s².
    points: of contact. timestep: s. rk4: the integrator. slides: whether it has friction.
    """

    strength: float
    points: int
    gravity: float
    timestep: float
    rk4: bool
    slides: bool

    @classmethod
    def at_touch(cls, place: PairAtTouch, timestep: float, rk4: bool, slides: bool) -> Load:
        """The load on the contact of a pair that just touches."""
        mobility = estimated_mobility(
            place.pair.model, place.pair.first.body, place.pair.second.body
        )
        points = len(place.contact.rows)
        strength = points / (mobility * place.effective_mass) if mobility > 0 else 1.0
        return cls(strength, points, place.gravity, timestep, rk4, slides)


def estimated_mobility(model: object, first: int, second: int) -> float:
    """MuJoCo's estimate of 1/mass of a contact of two bodies, 1/kg."""
    weights = model.body_invweight0  # type: ignore[attr-defined]
    return float(weights[first][0] + weights[second][0])


def row_choices(
    goal: RestitutionCurve, band: Band, load: Load, adhesive: bool
) -> Iterator[tuple[str, Rows]]:
    """(name, rows), the simplest first: a stop or one step, a spring and damper of one e, two rows
    whose e depends on speed as the target does, gravity included, and the same two without pulling.

    adhesive: whether they may pull.
    """
    h = load.timestep
    constant = goal.best_constant(*band)
    if constant < NO_BOUNCE:
        stop = ConstraintRow.direct(_STOP / h**2, 1.0 / h, STIFF_SOLIMP)
        yield "stop", (stop,)
    elif not load.slides and not load.rk4:
        yield ONE_STEP, one_step(constant, h)
    steps = _RK4_STEPS if load.rk4 else half_period_steps(load.points)
    yield f"spring of {steps} steps", (_spring(constant, steps, load),)
    e = goal.at(np.geomspace(*band, 50))
    if e.min() > NO_BOUNCE and e.max() < 1.0:
        # Two digits: two feet whose loads differ by rounding share one fit.
        strength = float(f"{load.strength:.2g}")
        rounded = replace(load, strength=strength)
        # The fit of rows that pull may end farther from the target than that of rows that do not.
        if adhesive:
            yield "spring and damper", _fitted(goal, band, rounded, True)
        yield "spring and damper", _fitted(goal, band, rounded, False)


def one_step(e: float, timestep: float) -> Rows:
    """A row that turns a body back in one step (s), as `check` advises.

    Its spring hardly changes e, but lifts a body that lies too deep.
    """
    spring = min(1e4, 1e-3 / timestep**2)
    return (ConstraintRow.direct(spring, (1.0 + e) / timestep, STIFF_SOLIMP),)


def _spring(e: float, steps: int, load: Load) -> ConstraintRow:
    """One row with a half period of whole steps; under RK4, which follows continuous time, as long."""
    loss = -math.log(max(e, _LEAST_E))
    lasts = steps * load.timestep
    if load.rk4:
        stiffness = (math.pi**2 + loss**2) / lasts**2
        damping = 2.0 * loss / lasts
    else:
        c = math.exp(-2.0 * loss / steps)
        stiffness = (1.0 + c - 2.0 * math.sqrt(c) * math.cos(math.pi / steps)) / load.timestep**2
        damping = (1.0 - c) / load.timestep
    return ConstraintRow.direct(stiffness / load.strength, damping / load.strength, SPRING_SOLIMP)


@lru_cache(maxsize=16)
def _fitted(goal: RestitutionCurve, band: Band, load: Load, adhesive: bool) -> Rows:
    """A spring, and a damper whose strength grows with depth: two <pair>s of the same two geoms."""
    h = load.timestep
    gravity = round(load.gravity, 2)
    rows = spring_and_damper_rows(
        goal, band, h, gravity, load.strength, adhesive, load.rk4, points=load.points
    )
    return tuple(rows)
