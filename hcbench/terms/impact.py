"""Records of one impact, the same for every engine and the reference: launch, trajectory, results.

Signs throughout: penetration x > 0 in contact (x < 0 is the gap), rate v = dx/dt > 0 on approach,
normal force F > 0 pushes the bodies apart. SI units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbench.system.errors import QuantityError
from hcbench.system.text import shown
from hcbench.terms.units import is_real

Floats = NDArray[np.float64]


# Words on files that were written before e was the speed ratio at the touch plane for every engine.
FORMER_E = (
    "whose e has an earlier definition: speeds at a step's start or end, not at the touch plane"
)
# Speeds and slips determine an angle, rad, to so many decimals.
_ANGLE_DIGITS = 12


class Status(StrEnum):
    """Outcome of an impact."""

    # Touched and left: the restitution is meaningful.
    PARTED = "parted"
    # Touched and came to rest in contact: the restitution counts as 0.
    RESTED = "rested"
    # Touched, and neither left nor came to rest in the simulated time.
    UNFINISHED = "unfinished"
    # Never felt a contact force.
    NO_TOUCH = "no-touch"
    # Not finite, through the plate, or with far more energy than a bounce can give.
    DIVERGED = "diverged"
    # The engine died or hung.
    CRASHED = "crashed"


@dataclass(frozen=True)
class Launch:
    """Initial state of a body that is launched at the plate.

    speed: approach speed along the normal at release, m/s.
    phase: where in a time step the touch falls, 0 <= phase < 1. With a clearance of (whole steps + phase)
        steps of flight, engines that only look at step boundaries see the touch up to one step late.
    height: clearance at release, m. None: two to three steps of flight, so that no time is spent in the air.
    slip: velocity of the body along the plate at release, m/s: along the direction that it is sent in (x in a
        scene), and across it.
    spin: angular velocity at release, rad/s, about these two and about the normal away from the plate. With
        spin[1] > 0 the body rolls on: its contact point slides by slip[0] - R spin[1].
    """

    speed: float
    phase: float = 0.5
    height: float | None = None
    slip: tuple[float, float] = (0.0, 0.0)
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Raise QuantityError for what is not a finite number, for another count of numbers in slip
        or spin, for a speed or height below 0, and for a phase outside 0 up to below 1.
        """
        numbers: dict[str, object] = {"speed": self.speed, "phase": self.phase}
        if self.height is not None:
            numbers["height"] = self.height
        for slot, number in numbers.items():
            _require_real(slot, number)
        vectors: tuple[tuple[str, Any, int], ...] = (("slip", self.slip, 2), ("spin", self.spin, 3))
        for slot, vector, count in vectors:
            is_vector = isinstance(vector, tuple | list) and len(vector) == count
            if not (is_vector and all(map(is_real, vector))):
                raise QuantityError(slot, shown(vector), f"{count} numbers")
            if not all(abs(each) < math.inf for each in vector):
                raise QuantityError(slot, shown(vector), f"{count} finite numbers")
            # A list has no hash, and launches are keys.
            object.__setattr__(self, slot, tuple(vector))
        if not 0.0 <= self.speed < math.inf:
            raise QuantityError("speed", f"{self.speed!r} m/s", "0 m/s or more, towards the plate")
        if not 0.0 <= self.phase < 1.0:
            raise QuantityError("phase", f"{self.phase!r}", "0 up to below 1, of a time step")
        if self.height is not None and not 0.0 <= self.height < math.inf:
            raise QuantityError("height", f"{self.height!r} m", "0 m or more over the plate")

    @classmethod
    def dropped(
        cls, speed: float, phase: float, timestep: float, gravity: float, share: float = 0.5
    ) -> Launch:
        """Drop a body so that it touches at `speed`, m/s, in a step's `phase`.

        It starts at rest, or with less than one step's gain in speed; without gravity it is
        launched at its speed.
        timestep: s.
        gravity: into the plate, m/s².
        share: see `touching`.
        Raises QuantityError for numbers that `Launch` refuses.
        """
        return cls.touching(speed, phase, timestep, gravity, steps_most=math.inf, share=share)

    @classmethod
    def touching(
        cls,
        speed: float,
        phase: float,
        timestep: float,
        gravity: float,
        slip: tuple[float, float] = (0.0, 0.0),
        spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
        steps_most: float = 2.0,
        share: float = 0.5,
    ) -> Launch:
        """Launch a body so that it touches at `speed`, m/s, in a
        step's `phase`, under gravity, m/s².

        A plain `Launch` arrives faster than its speed, and at fewer phases. The flight takes
        `steps_most` whole steps and the phase, or fewer, so that the body is never thrown upwards;
        if no whole step fits, it falls from rest, at the phase that results.

        timestep: h, s. gravity: g into the plate, m/s²; 0 gives a plain `Launch`.
        slip, spin: at release, m/s and rad/s, in the directions of `Launch`.
        share: by how much of g h the engine's steps differ from exact flight. They conserve
            (v + share g h)² + 2 g z, z the height, m: 0.5 for semi-implicit Euler, 0 for RK4.
        Raises QuantityError for numbers that `Launch` refuses.
        """
        if gravity <= 0.0:
            return cls(speed=speed, phase=phase, height=None, slip=slip, spin=spin)
        # Speed that gravity gives in a step, m/s.
        gain = gravity * timestep
        # Whole steps of flight before that of the touch.
        steps = min(steps_most, math.floor(speed / gain - share - phase))
        if steps < 0:
            # From rest, at the height that gives the speed: (share g h)² + 2 g z = speed².
            fallen = max(0.0, speed * speed - (share * gain) * (share * gain))
            return cls(
                speed=0.0, phase=phase, height=fallen / (2.0 * gravity), slip=slip, spin=spin
            )
        start = max(0.0, speed - gain * (steps + phase + share))
        flight = timestep * (steps + phase)
        return cls(
            speed=start,
            phase=phase,
            height=flight * (speed - 0.5 * gravity * flight),
            slip=slip,
            spin=spin,
        )

    @classmethod
    def at_angle(
        cls,
        angle: float,
        speed: float,
        phase: float = 0.5,
        height: float | None = None,
        spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Launch:
        """A launch at an angle from the normal, rad: its slip, along the direction that it is sent
        in, is tan(angle) times the speed, which is along the normal, m/s.

        phase, height, spin: as of `Launch`. Raises QuantityError as `Launch`, and for an angle that
        does not lie between -90 and 90 deg.
        """
        _require_real("angle", angle)
        _require_real("speed", speed)
        rounded = angle
        if math.isfinite(angle):
            rounded = round(angle, _ANGLE_DIGITS)
        # From 90 deg on the tangent has the other sign. NaN fails, too.
        if not abs(rounded) < math.pi / 2.0:
            raise QuantityError("angle", f"{angle!r} rad", "between -90 and 90 deg from the normal")
        return cls(
            speed=speed,
            phase=phase,
            height=height,
            slip=(speed * math.tan(rounded), 0.0),
            spin=spin,
        )

    @property
    def at_any_phase(self) -> Launch:
        """The launch at phase 0: the same for all launches that differ in phase only."""
        return replace(self, phase=0.0)

    @property
    def angle(self) -> float:
        """Between the velocity at release and the normal, rad; the same at each speed."""
        return round(math.atan2(math.hypot(*self.slip), self.speed), _ANGLE_DIGITS)

    @property
    def is_oblique(self) -> bool:
        """True if the body has slip or spin; False if it arrives straight along the normal."""
        return any(self.slip) or any(self.spin)

    def clearance(self, timestep: float) -> float:
        """Distance to the plate at release, m, for a step of `timestep`
        s (gravity neglected over it).
        """
        return (
            self.height if self.height is not None else (2.0 + self.phase) * timestep * self.speed
        )

    def clearance_in_phase(self, timestep: float, gravity: float) -> float:
        """Distance to the plate at release, m, so that the touch falls into the phase of a step.

        A height that was given is changed by up to half of the way of one step; at phase 0.5, and
        where no height was given, the distance is `clearance`.

        timestep: s.
        gravity: into the plate, m/s².
        """
        if self.height is None:
            return self.clearance(timestep)
        way = timestep * self.touch_speed(timestep, gravity)
        return self.height + (self.phase - 0.5) * min(way, self.height)

    def touch_speed(self, timestep: float, gravity: float) -> float:
        """Approach speed at touch, m/s: sqrt(v² + 2 g clearance).

        timestep: s.
        gravity: into the plate, m/s².
        """
        if gravity == 0.0:
            return abs(self.speed)
        return math.sqrt(
            max(0.0, self.speed * self.speed + 2.0 * gravity * self.clearance(timestep))
        )

    def flight_time(self, timestep: float, gravity: float) -> float:
        """Time from release to touch, s; infinite where the body does not arrive.

        timestep: s.
        gravity: into the plate, m/s².
        """
        clearance = self.clearance(timestep)
        if clearance <= 0.0:
            return 0.0
        # The mean speed of a fall is that of its ends.
        both = self.speed + self.touch_speed(timestep, gravity)
        return 2.0 * clearance / both if both > 0.0 else math.inf


def _require_real(slot: str, value: object) -> None:
    if not is_real(value):
        raise QuantityError(slot, shown(value), "a number")


# Not frozen, for the same speed as Impact below.
@dataclass(slots=True, repr=False)
class Trajectory:
    """States at each step of a simulation; arrays of shape (n,), SI.

    `force[i]` is the normal contact force that acts from the state `(penetration[i],
    rate[i])` on: the one that the step from i to i + 1 integrates. `time` is 0 at release; in
    the loop of an impact, at touch.
    """

    time: Floats
    penetration: Floats
    rate: Floats
    force: Floats

    def __repr__(self) -> str:
        lasts = self.time[-1] - self.time[0] if len(self.time) else 0.0
        return f"{type(self).__name__} of {len(self.time)} states over {lasts:.4g} s"

    def thinned(self, most: int) -> Trajectory:
        """A trajectory of at most `most` steps, evenly chosen, both ends among them."""
        count = len(self.time)
        every = np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int))
        return self._at(every)

    def simplified(self, tolerance: float) -> Trajectory:
        """The steps that matter, by the algorithm of Douglas and Peucker (1973).

        Straight lines over time between the kept steps pass all others within `tolerance` times the
        largest penetration, rate and force. Both ends stay. It has one step or more.
        """
        columns = np.array([self.penetration, self.rate, self.force])
        largest = np.abs(columns).max(axis=1, keepdims=True)
        columns = columns / np.where(largest > 0.0, largest, 1.0)
        last = len(self.time) - 1
        # Indices of the steps that stay, and stretches between two of them that may be split.
        kept = {0, last}
        waiting = [(0, last)]
        while waiting:
            start, end = waiting.pop()
            # Distance of the steps between from the straight line over time.
            share = (self.time[start + 1 : end] - self.time[start]) / (
                self.time[end] - self.time[start]
            )
            line = columns[:, [start]] + share * (columns[:, [end]] - columns[:, [start]])
            off = np.abs(columns[:, start + 1 : end] - line).max(axis=0, initial=0.0)
            if (off > tolerance).any():
                worst = start + 1 + int(off.argmax())
                kept.add(worst)
                waiting += [(start, worst), (worst, end)]
        return self._at(np.array(sorted(kept)))

    def _at(self, which: NDArray[np.int_]) -> Trajectory:
        return Trajectory(
            self.time[which], self.penetration[which], self.rate[which], self.force[which]
        )


# Rows of what is recorded along the plate at each step, in the directions of `Launch`:
# velocity of the contact point over it, m/s; spin, rad/s; friction on the body, N; kinetic
# energy but for the rate's, J.
SLIP = slice(0, 2)
SPIN = slice(2, 5)
FRICTION = slice(5, 7)
ENERGY = 7
TANGENTIAL_ROWS = 8


@dataclass(frozen=True, slots=True)
class Tangential:
    """Slip, spin, impulse and energy of an oblique impact along the plate, in the directions of
    `Launch`.

    slip_in, slip_out: velocity of the contact point over the plate, before and after, m/s.
    spin_in, spin_out: angular velocity, rad/s.
    impulse: of friction on the body, N s.
    normal_impulse: N s.
    energy_in, energy_out: kinetic energy of the whole motion, J.
    """

    slip_in: tuple[float, ...]
    slip_out: tuple[float, ...]
    spin_in: tuple[float, ...]
    spin_out: tuple[float, ...]
    impulse: tuple[float, ...]
    normal_impulse: float
    energy_in: float
    energy_out: float

    @property
    def impulse_ratio(self) -> float:
        """Impulse of friction over that of the normal force: by Coulomb's law at most μ."""
        return math.hypot(*self.impulse) / self.normal_impulse

    @property
    def energy_lost(self) -> float:
        """Share of the kinetic energy that was lost, below 0 where some was gained."""
        return 1.0 - self.energy_out / self.energy_in


# A figure shows no smaller difference of a simplified loop.
LOOP_TOLERANCE = 2e-3
# The loop of a contact: its states alone, force over penetration.
Loop = Trajectory


# Not frozen: thousands are made each second, each in a quarter of a frozen one's time.
@dataclass(slots=True)
class Impact:
    """One impact. Speeds are >= 0, m/s; NaN only where `status` says that there is nothing to
    report.

    reason: why it ended so, in words; "" for one that parted.
    speed_in, speed_out: at the touch plane.
    duration: of the contact, s. penetration_max, m; force_max, N.
    samples: steps in which the contact force acted.
    loop: None where it was not recorded.
    tangential: motion along the plate, of a measured impact with an oblique launch; else None.
    speed_after_force: of a user's model, in the first state that the contact force no longer acts
    in, from where joints and servos act on until the bodies part; else NaN.
    """

    launch: Launch
    status: Status
    reason: str = ""
    speed_in: float = np.nan
    speed_out: float = np.nan
    duration: float = np.nan
    penetration_max: float = np.nan
    force_max: float = np.nan
    samples: int = 0
    loop: Loop | None = None
    tangential: Tangential | None = None
    speed_after_force: float = np.nan

    @property
    def is_measured(self) -> bool:
        """True if it has a restitution: it parted or came to rest."""
        return self.status in (Status.PARTED, Status.RESTED)

    @property
    def restitution(self) -> float:
        """e = v_o / v_i, eq. (1) of Hunt & Crossley 1975, of a body that parted; 0 for one that
        rested, NaN for any other end.
        """
        if self.status is Status.RESTED:
            return 0.0
        measured = self.status is Status.PARTED and self.speed_in > 0
        return self.speed_out / self.speed_in if measured else np.nan

    @property
    def restitution_after_force(self) -> float:
        """The ratio of speeds once the contact force has ceased; NaN where it was not recorded."""
        return self.speed_after_force / self.speed_in if self.is_measured else np.nan

    @property
    def energy_lost(self) -> float:
        """Share of the kinetic energy, below 0 where some was gained; NaN where it is not known."""
        if self.tangential is not None:
            return self.tangential.energy_lost
        return np.nan if self.launch.is_oblique else 1.0 - self.restitution**2


def not_finite(x: Floats, v: Floats, f: Floats) -> NDArray[np.bool_]:
    """Mask of the places at which any of three arrays, x, v and f, of one shape, is not finite; of
    shape () if all numbers are finite.
    """
    # The sum is finite nearly always, and takes a tenth of the time.
    if np.isfinite(x.sum() + v.sum() + f.sum()):
        return np.zeros((), bool)
    return ~np.isfinite(x + v + f)
