"""Contact rows for a pair in a robot, of the mass and the weight that its contact feels there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.mujoco.backend import backend, has_feature
from hcbench.engines.mujoco.recipes.common import SPRING_SOLIMP, nonnegative_fit
from hcbench.engines.mujoco.recipes.compliant_fit import half_period_steps, spring_and_damper_rows
from hcbench.engines.mujoco.scene.rows import STIFF_SOLIMP, ConstraintRow
from hcbench.laws.restitution import MeasuredRestitution

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.engines.mujoco.model.place import PairAtTouch
    from hcbench.impact import Impact
    from hcbench.laws.restitution import RestitutionCurve

    Rows = tuple[ConstraintRow, ...]
    Band = tuple[float, float]

_RK4_STEPS = 8  # in contact, of a spring and damper
_STOP = 0.005  # K h² of a contact that stops a body: it pushes out what is inside, and no more
_NO_BOUNCE = 0.02  # e below it is a stop
_LEAST_E = 1e-3  # that a spring and damper are made for
_LEAST_AIM, _MOST_AIM = 0.02, 0.98  # e that two rows are made for
_GAIN = 0.7  # of what e is wrong by: how much the aim is moved
_FEWEST = 3  # impacts with a loop, from which what a contact feels is read


@dataclass(frozen=True, slots=True)
class Load:
    """The load on a contact, and the integrator that steps it.

    strength: what all its points together do, over what one does on a free ball: MuJoCo scales a soft row by
        an estimate of the mass (body_invweight0), at each point. gravity: of the approach, m/s².
    points: of contact. timestep: s. rk4: the integrator. slides: whether it has friction.
    carried: damping (1/s) and stiffness (1/s²) by which the rest of the robot, which keeps its momentum,
        drags the contact along.
    """

    strength: float
    points: int
    gravity: float
    timestep: float
    rk4: bool
    slides: bool
    carried: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def at_touch(cls, place: PairAtTouch, timestep: float, rk4: bool, slides: bool) -> Load:
        """Of a pair that just touches."""
        mobility = estimated_mobility(place.pair.model, place.pair.first.body, place.pair.second.body)
        points = len(place.contact.rows)
        strength = points / (mobility * place.effective_mass) if mobility > 0 else 1.0
        return cls(strength, points, place.gravity, timestep, rk4, slides)

    def with_measured_load(self, impacts: Sequence[Impact], effective_mass: float) -> Load:
        """This load, of a pair that just touches, as impacts felt it: in each step of a contact, by least
        squares,

            deceleration + gravity = mobility * force - damping (u - v) - stiffness (y - x)

        with u and y the speed and depth that the point would have without contact. Friction, joints and other
        contacts are in it. effective_mass: at touch, kg.
        """
        loops = [i.loop for i in impacts if i.loop is not None and i.samples > 1]
        if len(loops) < _FEWEST:
            return self
        parts = []
        for loop in loops:
            time = np.arange(len(loop.rate)) * self.timestep
            slower = loop.rate[0] + self.gravity * time - loop.rate
            behind = np.cumsum(slower) * self.timestep
            terms = np.stack([loop.force, -slower, -behind], axis=1)
            terms = (terms[1:] + terms[:-1]) / 2 if self.rk4 else terms[:-1]
            change = self.gravity - np.diff(loop.rate) / self.timestep
            parts.append(np.column_stack([terms, change]) / abs(loop.rate[0]))
        columns = np.concatenate(parts)
        (mobility, damping, stiffness), _ = nonnegative_fit(columns[:, :3], columns[:, 3])
        return replace(
            self, strength=self.strength * float(mobility) * effective_mass, carried=(damping, stiffness)
        )


def estimated_mobility(model: object, first: int, second: int) -> float:
    """What MuJoCo takes for 1/mass of a contact of two bodies, 1/kg."""
    return float(sum(model.body_invweight0[body][0] for body in (first, second)))  # type: ignore[attr-defined]


def row_choices(goal: RestitutionCurve, band: Band, load: Load) -> Iterator[tuple[str, Rows]]:
    """(name, rows), the simplest first: a stop or one step, a spring and damper of one e, two rows whose e
    depends on speed as the target does, gravity included.
    """
    h, e = load.timestep, goal.at(np.geomspace(*band, 50))
    constant = goal.best_constant(*band)
    if constant < _NO_BOUNCE:
        yield "stop", (ConstraintRow.direct(_STOP / h**2, 1.0 / h, STIFF_SOLIMP),)
    elif not load.slides and not load.rk4:
        yield "one step", (ConstraintRow.direct(min(1e4, 1e-3 / h**2), (1.0 + constant) / h, STIFF_SOLIMP),)
    steps = _RK4_STEPS if load.rk4 else half_period_steps(load.points)
    yield f"spring of {steps} steps", (_spring(constant, steps, load),)
    if e.min() > _NO_BOUNCE and e.max() < 1.0:
        yield "spring and damper", Aim(goal, load).rows(band)


def _spring(e: float, steps: int, load: Load) -> ConstraintRow:
    """One row with a half period of whole steps; under RK4, which follows continuous time, as long."""
    loss, lasts = -math.log(max(e, _LEAST_E)), steps * load.timestep
    if load.rk4:
        stiffness, damping = (math.pi**2 + loss**2) / lasts**2, 2.0 * loss / lasts
    else:
        c = math.exp(-2.0 * loss / steps)
        stiffness = (1.0 + c - 2.0 * math.sqrt(c) * math.cos(math.pi / steps)) / load.timestep**2
        damping = (1.0 - c) / load.timestep
    return ConstraintRow.direct(stiffness / load.strength, damping / load.strength, SPRING_SOLIMP)


@dataclass(frozen=True, slots=True)
class Aim:
    """What two rows are made for, so that in the model they do what is wanted."""

    goal: RestitutionCurve
    load: Load

    def rows(self, band: Band) -> Rows:
        """A spring, and a damper whose strength grows with depth: two <pair>s of the same two geoms."""
        load = self.load
        numbers = (load.strength, *load.carried)
        strength, damping, stiffness = (float(f"{number:.3g}") for number in numbers)  # alike for two feet
        return _searched(
            self.goal,
            band,
            replace(load, strength=strength, gravity=round(load.gravity, 2), carried=(damping, stiffness)),
        )

    def with_measured_load(self, impacts: Sequence[Impact], effective_mass: float) -> Aim:
        """For the load that impacts felt."""
        return replace(self, load=self.load.with_measured_load(impacts, effective_mass))

    def off_by(self, impacts: Sequence[Impact], wanted: RestitutionCurve) -> Aim:
        """Moved by what the e of impacts is wrong by."""
        points = []
        for speed in dict.fromkeys(i.launch.speed for i in impacts):
            felt = [i for i in impacts if i.launch.speed == speed and i.is_measured]
            v = float(np.mean([i.speed_in for i in felt])) if felt else speed
            off = float(np.mean([i.restitution - wanted.at(i.speed_in) for i in felt])) if felt else 0.0
            points.append((v, float(np.clip(self.goal.at(v) - _GAIN * off, _LEAST_AIM, _MOST_AIM))))
        return replace(self, goal=MeasuredRestitution(tuple(points)))


def max_error(impacts: Sequence[Impact], wanted: RestitutionCurve) -> float:
    """Of e; 1 for an impact without one."""
    return max(abs(i.restitution - float(wanted.at(i.speed_in))) if i.is_measured else 1.0 for i in impacts)


@lru_cache(maxsize=16)
def _searched(goal: RestitutionCurve, band: Band, load: Load) -> Rows:
    rows = spring_and_damper_rows(
        goal,
        band,
        load.timestep,
        load.gravity,
        load.strength,
        has_feature(backend(), "adhesion"),
        load.rk4,
        load.carried,
        load.points,
    )
    return tuple(rows)
