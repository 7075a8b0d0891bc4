"""What one impact is, whoever made it: frozen records that engines and the reference hand back.

Signs throughout: penetration x > 0 in contact (x < 0 is the gap), rate v = dx/dt > 0 on approach,
normal force F > 0 pushes the bodies apart. SI units.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


class Status(StrEnum):
    """How an impact ended."""

    PARTED = "parted"  # touched and left: restitution is meaningful
    RESTED = "rested"  # touched and did not leave within the time simulated: restitution counts as 0
    NO_TOUCH = "no-touch"  # never felt a contact force
    DIVERGED = "diverged"  # not finite, through the plate, or with far more energy than a bounce can give
    CRASHED = "crashed"  # the engine died or hung on it


@dataclass(frozen=True, slots=True)
class Launch:
    """How a body is sent at the plate.

    speed: approach speed at release, m/s.
    phase: where in a time step the touch falls, 0 <= phase < 1. With a gap of (whole steps + phase) steps
        of flight, engines that only look at step boundaries see the touch up to one step late.
    height: clearance at release, m. None: two to three steps of flight, so that no time is spent in the air.
    """

    speed: float
    phase: float = 0.5
    height: float | None = None

    def gap(self, timestep: float) -> float:
        """Clearance at release, m, for a step of `timestep` s (gravity neglected over these few steps)."""
        return self.height if self.height is not None else (2.0 + self.phase) * timestep * self.speed


@dataclass(frozen=True, slots=True)
class Trajectory:
    """What an engine saw at each step; arrays of shape (n,), SI.

    `force[i]` is the normal contact force that acts from the state `(penetration[i], rate[i])` on: the one
    that the step from i to i + 1 integrates. `time` is 0 at release.
    """

    time: Floats
    penetration: Floats
    rate: Floats
    force: Floats


@dataclass(frozen=True, slots=True)
class Loop:
    """Force over penetration while in contact; arrays of shape (n,), SI; `time` is 0 at touch."""

    time: Floats
    penetration: Floats
    rate: Floats
    force: Floats


@dataclass(frozen=True, slots=True)
class Impact:
    """One impact. Speeds are >= 0, m/s; NaN only where `status` says that there is nothing to report."""

    launch: Launch
    status: Status
    reason: str = ""
    speed_in: float = np.nan
    speed_out: float = np.nan
    duration: float = np.nan
    penetration_max: float = np.nan
    force_max: float = np.nan
    samples: int = 0  # steps in which the contact force acted
    loop: Loop | None = None

    @property
    def restitution(self) -> float:
        """e = v_o / v_i, eq. (1) of Hunt & Crossley 1975; 0 for a body that rested, NaN unless parted."""
        if self.status is Status.RESTED:
            return 0.0
        return self.speed_out / self.speed_in if self.status is Status.PARTED else np.nan


def impact_of(launch: Launch, trajectory: Trajectory) -> Impact:
    """Read one impact off a trajectory; `impacts_of` says how."""
    t, x, v, f = trajectory.time, trajectory.penetration, trajectory.rate, trajectory.force
    return impacts_of([launch], t, x[None], v[None], f[None], np.array([len(x)]))[0]


def not_finite(x: Floats, v: Floats, f: Floats) -> NDArray[np.bool_]:
    """Where any of three arrays of one shape is not finite; of shape () where all of it is."""
    if np.isfinite(x.sum() + v.sum() + f.sum()):  # as nearly always, and told in a tenth of the time
        return np.zeros((), bool)
    return ~np.isfinite(x + v + f)


def impacts_of(
    launches: Sequence[Launch], time: Floats, x: Floats, v: Floats, f: Floats, counts: NDArray[np.intp]
) -> list[Impact]:
    """Read impacts off trajectories that share their times, shape (n,), even.

    x, v, f: penetration, rate and force as in `Trajectory`, shape (b, n); of each, the first `counts` steps
    are its own, shape (b,).
    Contact is the run of steps in which the force acts. The speed in is the last one that no contact force
    has touched, the speed out the first after the force has ceased for good: so under gravity the
    restitution is that of the contact alone, not of the flight before and after it.
    """
    step = np.arange(x.shape[1], dtype=np.int32)
    counts = counts.astype(np.int32)
    own = step < counts[:, None]
    with np.errstate(all="ignore"):
        broken = np.any(not_finite(x, v, f) & own, axis=1)
        acting = (f != 0.0) & own
        touched, first = acting.any(axis=1), acting.argmax(axis=1).astype(np.int32)
        apart = (x <= 0.0) & (v < 0.0) & ~acting & own & (step >= first[:, None])
        parted = apart.any(axis=1)
        end = np.where(parted, apart.argmax(axis=1), counts)
        acting &= step < end[:, None]
        stops = x.shape[1] - acting[:, ::-1].argmax(axis=1).astype(np.int32)
        inside = (step >= first[:, None]) & (step < stops[:, None])
        deepest = np.where(inside, x, -np.inf).max(axis=1).tolist()
        hardest = np.where(inside, f, -np.inf).max(axis=1).tolist()
    each = np.arange(len(x))
    v_in = v[each, first].tolist()
    v_out = (-v[each, np.minimum(stops, counts - 1)]).tolist()
    h = float(time[1] - time[0]) if len(time) > 1 else 0.0
    clock = time - time[0]
    found = []
    for i, (launch, start, stop, n) in enumerate(
        zip(launches, first.tolist(), stops.tolist(), counts.tolist(), strict=True)
    ):
        if broken[i]:
            found.append(Impact(launch, Status.DIVERGED, "position, velocity or force is not finite"))
        elif not touched[i]:
            found.append(Impact(launch, Status.NO_TOUCH, f"no contact force within {time[n - 1]:.3g} s"))
        else:
            contact, left = slice(start, stop), bool(parted[i])
            open_s = time[n - 1] - time[start]
            impact = Impact(
                launch=launch,
                status=Status.PARTED if left else Status.RESTED,
                reason="" if left else f"still in contact {open_s:.3g} s after touch",
                speed_in=v_in[i],
                speed_out=v_out[i] if left else 0.0,
                duration=h * (stop - start),
                penetration_max=deepest[i],
                force_max=hardest[i],
                samples=stop - start,
                loop=Loop(clock[: stop - start], x[i, contact], v[i, contact], f[i, contact]),
            )
            found.append(impact)
    return found
