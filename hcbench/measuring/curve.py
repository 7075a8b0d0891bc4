"""e over speed: the impacts of each launch speed and angle, all phases of the time step in one point."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hcbench.sim.tangential import ALONG_COLUMNS, AlongPlate, along_plate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from hcbench.impact import Floats, Impact, Launch


_UNKNOWN = AlongPlate(*(math.nan,) * len(ALONG_COLUMNS))


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """All phases of one launch speed and angle; NaN where nothing parted or rested.

    A mean weighs each phase by the share of the time step that it stands for.

    speed: at launch, m/s. speed_in: mean at touch, m/s; gravity makes the two differ. restitution: mean e.
    lowest, highest: e. target: mean of the e wanted at each impact's speed; NaN without a target.
    worst_phase: e - target of the one impact in which it is largest, with its sign.
    samples: fewest steps in contact. failed: impacts without an e. angle: from the normal, rad.
    restitution_after_force: mean of the ratio once the contact force has ceased; e differs where joints or
    servos act until the bodies part. along: means of what it does along the plate; NaN if not known.
    """

    speed: float
    speed_in: float
    restitution: float
    lowest: float
    highest: float
    target: float
    worst_phase: float
    samples: int
    failed: int
    angle: float
    restitution_after_force: float = math.nan
    along: AlongPlate = _UNKNOWN

    @property
    def error(self) -> float:
        """Mean e less the mean target."""
        return self.restitution - self.target

    @property
    def spread(self) -> float:
        """Difference between the highest and the lowest e."""
        return self.highest - self.lowest

    @property
    def place(self) -> str:
        """Speed, and the angle of an oblique launch, in words."""
        angle = f" and {math.degrees(self.angle):.4g} deg" if self.angle else ""
        return f"{self.speed_in:.4g} m/s{angle}"

    def record(self, is_oblique: bool) -> dict[str, Any]:
        """The point as JSON and data frames have it. is_oblique: whether any launch of the curve is."""
        record: dict[str, Any] = {
            "speed_m_per_s": self.speed,
            "speed_in_m_per_s": self.speed_in,
            "restitution": self.restitution,
            "restitution_min": self.lowest,
            "restitution_max": self.highest,
            "restitution_after_force": self.restitution_after_force,
            "target": self.target,
            "error": self.error,
            "error_worst_phase": self.worst_phase,
            "samples": self.samples,
            "failed": self.failed,
        }
        if is_oblique:
            record["angle_rad"] = self.angle
            record |= zip(ALONG_COLUMNS, self.along, strict=True)
        return record


def curve_of(impacts: Iterable[Impact], wanted: Callable[[Impact], float] | None = None) -> list[CurvePoint]:
    """One point for each launch speed and angle, in the order of the launches.

    wanted: e that an impact should have; NaN for an impact that is held against nothing.
    """
    groups: dict[Launch, list[Impact]] = {}
    for impact in impacts:
        groups.setdefault(impact.launch.at_any_phase, []).append(impact)
    return [_point(launch, group, wanted) for launch, group in groups.items()]


def worst_of(points: Iterable[CurvePoint]) -> CurvePoint | None:
    """The point with the largest error of any phase; None where no point has one."""
    known = [point for point in points if not math.isnan(point.worst_phase)]
    return max(known, key=lambda point: abs(point.worst_phase), default=None)


def _point(launch: Launch, impacts: Sequence[Impact], wanted: Callable[[Impact], float] | None) -> CurvePoint:
    good = [impact for impact in impacts if impact.is_measured]
    targets = [math.nan if wanted is None else wanted(impact) for impact in good]
    return point_of(
        launch.speed,
        launch.angle,
        phase=np.array([impact.launch.phase for impact in good]),
        speed_in=np.array([impact.speed_in for impact in good]),
        restitution=np.array([impact.restitution for impact in good]),
        target=np.array(targets),
        samples=np.array([impact.samples for impact in good], dtype=int),
        failed=len(impacts) - len(good),
        after_force=np.array([impact.restitution_after_force for impact in good]),
        along=np.array([along_plate(impact) for impact in good or impacts[:1]]),
    )


def point_of(
    speed: float,
    angle: float,
    *,
    phase: Floats,
    speed_in: Floats,
    restitution: Floats,
    target: Floats,
    samples: NDArray[np.int_],
    failed: int,
    after_force: Floats | None = None,
    along: Floats | None = None,
) -> CurvePoint:
    """The point of the impacts that have an e, as columns of shape (n,); n may be 0.

    phase: share of a step. speed_in: m/s. target: NaN where an impact is held against nothing.
    samples: steps in contact. along: shape (n, 6), of `AlongPlate`.
    """
    plate = _UNKNOWN if along is None else AlongPlate(*np.mean(along, axis=0).tolist())
    if not phase.size:
        nothing = math.nan
        return CurvePoint(
            *(speed, nothing, nothing, nothing, nothing, nothing, nothing),
            samples=0,
            failed=failed,
            angle=angle,
            along=plate,
        )
    held = ~np.isnan(target)
    # A baseline may lack some phases. e and target are means over the same ones, so that they compare.
    chosen = held if held.any() else ~held
    share = step_shares(phase[chosen])
    e = restitution[chosen]
    error = e - target[chosen]
    if along is not None:
        plate = AlongPlate(*_mean(along[chosen], share).tolist())
    return CurvePoint(
        speed=speed,
        speed_in=float(_mean(speed_in[chosen], share)),
        restitution=float(_mean(e, share)),
        lowest=float(e.min()),
        highest=float(e.max()),
        target=float(_mean(target[chosen], share)),
        worst_phase=float(error[np.abs(error).argmax()]),
        samples=int(samples.min()),
        failed=failed,
        angle=angle,
        restitution_after_force=math.nan if after_force is None else float(_mean(after_force[chosen], share)),
        along=plate,
    )


def _mean(values: Floats, share: Floats) -> Floats:
    """Mean of values, shape (n,) or (n, k), by the share of the step that each stands for, shape (n,)."""
    # About the first one: the mean of equal values is their value, to the last bit.
    mean: Floats = values[0] + share @ (values - values[0])
    return mean


def step_shares(phases: Floats) -> Floats:
    """The share of a step that each phase stands for: half of the gaps on both sides; they add up to 1.

    `measure` launches at more phases where e differs between neighbours, so the phases are not even.
    """
    order = np.argsort(phases)
    ordered = phases[order]
    # The step after the last phase is that of the first again.
    gaps = np.diff(np.append(ordered, ordered[0] + 1.0))
    shares = np.empty(len(ordered))
    shares[order] = (gaps + np.roll(gaps, 1)) / 2
    return shares
