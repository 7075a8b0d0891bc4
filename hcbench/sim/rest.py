"""Rest of one body on another, slopes and grasps: read from the steps of any engine."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from hcbench.terms.impact import Floats, Launch

if TYPE_CHECKING:
    from hcbench.sim.world import World
    from hcbench.terms.impact import Floats


# Rest of one body on another, read from the steps of any engine: penetration, drift, vibration,
# force noise.

# A body that rests sinks more slowly than this, m/s.
_SINKING_MAX = 1e-5
# It lies less deep than this share of its radius, or than so many m for a step of 1 s.
_DEPTH_MAX = 1e-3
_DEPTH_STEP = 0.2
# It vibrates by less than this, m/s (rms), or by less than this share of what it did before.
VIBRATION_MAX = 1e-4
_DECAY_MAX = 0.95
# Simulated time, s, and steps until a body is taken to lie as it will.
_SECONDS = 4.0
_STEPS_MAX = 4000
# Height from which it is let down, m.
_LET_DOWN = 1e-9


@dataclass(frozen=True, slots=True)
class Rest:
    """A body at rest, over the last of two equal spans of time.

    penetration: the greatest, m.
    sinking: m/s, > 0 into the plate.
    drift: along the plate, m/s; NaN where that was not measured.
    vibration: rms rate about the sinking, m/s.
    decay: vibration over that of the span before.
    force_noise: standard deviation of the contact force over its mean; NaN without force.
    """

    penetration: float
    sinking: float
    vibration: float
    decay: float
    force_noise: float = math.nan
    drift: float = math.nan

    @property
    def dies_away(self) -> bool:
        """True if the vibration decays."""
        return self.decay < _DECAY_MAX

    @property
    def text(self) -> str:
        """Phrase of the penetration in mm, the vibration in m/s, and, if known, the force noise."""
        if math.isnan(self.penetration):
            return "it diverges"
        noise = (
            "" if math.isnan(self.force_noise) else f", force noise {100 * self.force_noise:.2g} %"
        )
        depth = f"penetration {1e3 * self.penetration:.3g} mm"
        return f"{depth}, vibration {self.vibration:.2g} m/s (rms){noise}"

    def failures(self, radius: float, timestep: float) -> list[str]:
        """Reasons why a body does not count as resting, in words; [] if it rests.

        radius: R, of the body, m.
        timestep: s.
        It rests if it sinks more slowly than 1e-5 m/s, lies less deep than 1e-3 R or 0.2 mm per ms
        of step, and its vibration is below 1e-4 m/s or decaying.
        """
        if math.isnan(self.penetration):
            return ["it diverges"]
        failures = []
        if not abs(self.sinking) < _SINKING_MAX:
            verb = "sinks" if self.sinking > 0 else "rises"
            failures.append(f"it still {verb} at {abs(self.sinking):.1e} m/s when the test ends")
        if not self.penetration < max(_DEPTH_MAX * radius, _DEPTH_STEP * timestep):
            share = 100 * self.penetration / radius
            failures.append(f"it rests {self.penetration:.1e} m deep, {share:.2g} % of the radius")
        if not (self.vibration < VIBRATION_MAX or self.dies_away):
            failures.append(f"it keeps on moving at {self.vibration:.1e} m/s (rms)")
        return failures


DIVERGED = Rest(math.nan, math.nan, math.nan, math.nan)


def rest_of(
    time: Floats,
    penetration: Floats,
    rate: Floats,
    force: Floats | None = None,
    along: Floats | None = None,
) -> Rest:
    """Measure how a body rests from its path: how deep it lies, sinks, vibrates and drifts in the
    second half, when the path has calmed. DIVERGED if a penetration or rate is not finite.

    time (s), penetration (m), rate (m/s) and force (N, or None): (n,) each.
    along: its position along the plate, m, (n, k), or None. `force_noise` and `drift` of the result
    are NaN without them.
    """
    if not (np.isfinite(penetration).all() and np.isfinite(rate).all()):
        return DIVERGED
    half = len(time) // 2
    first_half = slice(half)
    last_half = slice(half, None)
    # The slope of a straight line through the penetrations, m/s.
    sinking, _ = np.polyfit(time[last_half], penetration[last_half], 1).tolist()
    vibration = _rms(rate[last_half] - sinking)
    earlier = _rms(rate[first_half] - sinking)
    decay = 0.0
    if earlier > 0:
        decay = vibration / earlier
    noise = math.nan
    if force is not None:
        mean = float(force[last_half].mean())
        if mean > 0.0:
            noise = float(force[last_half].std()) / mean
    drift = math.nan
    if along is not None:
        velocity, _ = np.polyfit(time[last_half], along[last_half], 1)
        drift = float(np.linalg.norm(velocity))
    return Rest(
        penetration=float(penetration[last_half].max()),
        sinking=sinking,
        vibration=vibration,
        decay=decay,
        force_noise=noise,
        drift=drift,
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def last_half(path: Floats) -> Floats:
    """Second half of a path, in which a body is taken to have calmed; along the first axis."""
    return path[len(path) // 2 :]


def let_down(world: World) -> Rest | None:
    """Lay a body on the plate, simulate it for 4 s or _STEPS_MAX steps, and judge how it lies in the
    last quarter of them; None without gravity, or if the plate does not push.

    DIVERGED where a number of the simulation is not finite.
    """
    if not world.gravity > 0.0:
        return None
    steps = min(_STEPS_MAX, round(_SECONDS / world.timestep))
    # Penetration, rate and force, shape (3, n), of some steps each.
    rows: list[Floats] = []
    left = steps
    with closing(world.follow(Launch(0.0, height=_LET_DOWN))) as simulation:
        while left > 0:
            part = simulation.advance(left).rows()[:3, 0]
            if not np.isfinite(part).all():
                return DIVERGED
            rows.append(part)
            left -= part.shape[1]
    # `rest_of` judges the second half of these, and the vibration by both.
    x, v, f = map(last_half, np.concatenate(rows, axis=1))
    if not f.any():
        return None
    time = np.arange(float(len(x))) * world.timestep
    return rest_of(time, x, v, f)


# Rest, slope and grasp of a model: quantities that a setting of its contacts may not make worse.

# Times what it was: more than that is worse.
WORSE = 1.2


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity to compare.

    si: of what is printed.
    enough: below it, as printed, any number will do; infinite for what is printed but not judged.
    """

    key: str
    title: str
    unit: str
    si: float
    enough: float

    def is_worse(self, was: float, now: float) -> bool:
        """Say whether a value, SI, grew by more than a fifth and is not small.

        was, now: NaN for what was not measured: never worse if that was so before, else worse.
        """
        if math.isnan(was):
            return False
        return math.isnan(now) or now > max(WORSE * was, self.enough * self.si)

    def change(self, was: float, now: float) -> str:
        """Both values, SI, in words."""
        words = f"{self.title} {was / self.si:.3g} -> {self.shown(now)}"
        return words if math.isnan(now) else f"{words} {self.unit}"

    def shown(self, value: float) -> str:
        """A value, SI, in the printed unit; NaN is that of a body that does not come to rest."""
        return "no rest" if math.isnan(value) else f"{value / self.si:.3g}"


_HOP = Quantity("hop_m", "hop of a slide", "mm", 1e-3, 0.1)
QUANTITIES = (
    Quantity("penetration_m", "penetration at rest", "mm", 1e-3, 0.1),
    Quantity("drift_m_per_s", "drift on a slope", "mm/s", 1e-3, 0.1),
    Quantity("hold_m_per_s", "drift in a grasp", "mm/s", 1e-3, 0.1),
    Quantity("vibration_m_per_s", "vibration at rest", "m/s", 1.0, 1e-5),
    _HOP,
    Quantity("solver_iterations", "solver iterations", "a step", 1.0, 2.0),
    # No two runs have the same, so no choice may hang on it.
    Quantity("step_time_s", "time of a step", "µs", 1e-6, math.inf),
)


@dataclass(frozen=True, slots=True)
class Standing:
    """A model at rest under its own gravity, on a slope and in a
    grasp, SI; NaN for what it has not.

    penetration: m.
    drift: along a slope of 10 degrees, or of two thirds of the friction angle where that is less,
    m/s.
    hold: of a body held by two others, m/s.
    vibration: rms, m/s.
    hop: how far a body rises that is laid down as it slides, m.
    iterations: of the solver, in each step.
    step_time: of CPU, s.
    force_noise: standard deviation of the contact force over its mean.
    slope: rad.
    falls: true for a model that falls over on the level; its drift and vibration are NaN.
    """

    penetration: float
    drift: float
    hold: float
    vibration: float
    hop: float
    iterations: float
    step_time: float
    force_noise: float = math.nan
    slope: float = math.nan
    falls: bool = field(default=False, kw_only=True)

    @classmethod
    def of(
        cls,
        rest: Rest,
        on_slope: Rest,
        hold: float,
        hop: float,
        cost: tuple[float, float],
        slope: float,
        falls: bool = False,
    ) -> Standing:
        """Join what was measured of a model at rest.

        rest: on the level.
        on_slope: on a slope, of which the drift alone counts.
        hold: drift in a grasp, m/s.
        hop: how far a body rises that is laid down as it slides, m.
        cost: (iterations of the solver in a step, CPU time of a step, s).
        slope: its angle, rad.
        falls: whether the model falls over on the level.
        """
        iterations, step_time = cost
        return cls(
            penetration=rest.penetration,
            drift=on_slope.drift,
            hold=hold,
            vibration=rest.vibration,
            hop=hop,
            iterations=iterations,
            step_time=step_time,
            force_noise=rest.force_noise,
            slope=slope,
            falls=falls,
        )

    @property
    def _values(self) -> dict[str, float]:
        """The value of each of QUANTITIES, SI, by its key and in their order."""
        return {
            "penetration_m": self.penetration,
            "drift_m_per_s": self.drift,
            "hold_m_per_s": self.hold,
            "vibration_m_per_s": self.vibration,
            "hop_m": self.hop,
            "solver_iterations": self.iterations,
            "step_time_s": self.step_time,
        }

    @property
    def record(self) -> dict[str, float]:
        """The numbers as JSON and the table have them, by key."""
        return {**self._values, "force_noise": self.force_noise}

    def worse_than(self, before: Standing) -> Iterator[str]:
        """Quantities that grew by more than a fifth and are not small, in words."""
        for quantity in QUANTITIES:
            was = before._values[quantity.key]
            now = self._values[quantity.key]
            if quantity.is_worse(was, now):
                yield quantity.change(was, now)

    def rests_worse_than(self, before: Standing, timestep: float) -> Iterator[str]:
        """Yield phrases of what is worse than before in how a model rests: it creeps or slips more,
        lies deeper than before and than the time step allows, or vibrates more than before and than
        a body at rest may.

        before: the model to compare with.
        timestep: s.
        """
        # Of each quantity that is judged the value, SI, up to which any will do.
        limits = {
            "drift_m_per_s": 0.0,
            "hold_m_per_s": 0.0,
            "penetration_m": _DEPTH_STEP * timestep,
            "vibration_m_per_s": VIBRATION_MAX,
        }
        quantity_of = {quantity.key: quantity for quantity in QUANTITIES}
        for key, enough in limits.items():
            quantity = quantity_of[key]
            was = before._values[key]
            now = self._values[key]
            if quantity.is_worse(was, now) and not now <= enough:
                yield quantity.change(was, now)

    def throws_up(self, before: Standing) -> bool:
        """Say whether a body that slides hops higher than before."""
        return _HOP.is_worse(before.hop, self.hop)


UNKNOWN = Standing(*[math.nan] * 7)


# A contact under loads: how deep it lies, what friction holds, and how hard a landing hits.

# How every engine loads a contact.

# Multiples of the force at rest under which a contact is measured: what a robot's feet bear in
# standing, walking, running and landing.
LOADS = (1.0, 2.0, 5.0, 10.0)
# Time for which a pair is pressed, s, and the last part of it, over which a mean is taken.
PRESSED_S = 1.0
LAST = 0.2
# Bounds the time of a press at short steps.
PRESSED_STEPS = 5000
# A pair bears a load if the contact's force is within this share of it, and varies by less.
_BEARS = 0.1
# A push along the plate is so many times the friction that the model asks for: the pair slides.
_PUSH = 2.0
# Steps in which a push finds the limit of friction: a soft contact takes some.
PUSHED_STEPS = 20
# A slope, rad; it is this share of the friction angle where that is less: the body has to hold.
_SLOPE = math.radians(10.0)
_OF_FRICTION = 2.0 / 3.0
# A body rolls if its turning makes up more than this share of its speed.
_ROLLS = 0.5
# One that rolls down a slope is faster, m/s: what is slower creeps, and may turn on its place.
_SLOWEST_ROLL = 1e-3


def slope_of(friction: float) -> float:
    """Slope, rad, on which a body of a friction μ is laid; 0 without friction."""
    return min(_SLOPE, _OF_FRICTION * math.atan(friction or 0.0))


def push_of(friction: float, load: float) -> float:
    """Push along the plate, N, that a contact of friction μ under a load, N, does not hold."""
    return _PUSH * (1.0 + friction) * load


def creep_of(drift: float, spin: float, lever: float) -> float:
    """Creep of a body that drifts down a slope, m/s; NaN where it rolls.

    drift: speed of its centre along the slope, m/s.
    spin: mean angular speed, rad/s.
    lever: from its contact point to its centre, m.
    """
    rolls = drift > _SLOWEST_ROLL and spin * lever > _ROLLS * drift
    return math.nan if rolls else drift


@dataclass(frozen=True, slots=True)
class BorneLoad:
    """A pair at rest, pressed together along its normal.

    times: of the force at rest.
    force: that the contact bears, N.
    penetration: m.
    NaN where the pair did not bear it.
    """

    times: float
    force: float
    penetration: float


def rests(rest: Rest) -> bool:
    """Say whether a body lies still: a contact that hammers has a mean force, and no depth at it."""
    return not rest.force_noise > _BEARS


def borne(times: float, own: float, rows: Floats) -> BorneLoad:
    """The load that a contact bears when pressed by a multiple of its force at rest, from its last
    steps: mean force and penetration; both NaN where the force differs from `times` `own` by more
    than a tenth, or varies (standard deviation) by more than a tenth of itself.

    times: the multiple.
    own: force at rest, N.
    rows: force, N, and penetration, m, of the steps, (n, 2).
    """
    force, penetration = rows.mean(axis=0).tolist()
    noise = float(rows[:, 0].std())
    if not (abs(force / (times * own) - 1.0) < _BEARS and noise < _BEARS * force):
        return BorneLoad(times, math.nan, math.nan)
    return BorneLoad(times, force, penetration)


@dataclass(frozen=True, slots=True)
class Carried:
    """Loads that the contact of a pair carries at rest, SI; NaN for what was not measured.

    loads: rising, the first the pair's own; () where the two do not rest on each other.
    friction: the largest friction over the normal force, in the way in which the contact holds
    most; weakest: in that in which it holds least.
    slope: rad, and creep: on it, along it, m/s; of a ball, which rolls, its rolling.
    """

    loads: tuple[BorneLoad, ...] = ()
    friction: float = math.nan
    weakest: float = math.nan
    slope: float = math.nan
    creep: float = math.nan

    @property
    def load(self) -> float:
        """Force of the contact at rest, N."""
        return self.loads[0].force if self.loads else math.nan

    @property
    def stiffness(self) -> float:
        """Force at rest over penetration at rest, N/m; NaN where the contact does not yield."""
        if not self.loads or not self.loads[0].penetration > 0.0:
            return math.nan
        return self.loads[0].force / self.loads[0].penetration

    @property
    def holds(self) -> float:
        """Angle of the steepest slope, rad, on which friction holds in every direction."""
        return math.atan(self.weakest)

    @property
    def holds_most(self) -> float:
        """The same, rad, in the direction in which friction holds most."""
        return math.atan(self.friction)


@dataclass(frozen=True, slots=True)
class LandingPeak:
    """Peak forces of landings from a height, m, over the body's weight: the lowest and the highest,
    as the touch falls into a time step.
    """

    height: float
    lowest: float
    highest: float
