"""Adds up the scores of impacts, in parts of any size."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.scoring.loops import LoopScore
from hcbench.terms.impact import Floats
from hcbench.terms.resolution import ROUND_OFF_SUM, STEPS_AT_ITS_ENDS

# A force below this share of the largest counts as zero.
_NEAR_ZERO = 0.005
# Largest difference of the exponent of ΔE from the law's own.
_EXPONENT_SLACK = 0.15
# Energy gained beyond round-off, as a share.
_GAIN = 1e-9
_Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Score:
    """Errors of one setting at one step over a band of speeds and phases, against one α.

    Figures of loops are the worst of the loops given, NaN if none was resolved. Claims: True,
    False, or None for "not resolved".
    """

    impacts: int
    parted: int
    rested: int
    failed: int
    max_error_law: float
    rms_error_law: float
    worst_speed_law: float
    max_error_linear: float
    rms_error_linear: float
    constant_restitution: float
    constant_error_law: float
    constant_error_linear: float
    phase_spread: float
    alpha_fit: float
    alpha_fit_rms: float
    energy_exponent: float
    energy_exponent_law: float
    energy_gained: bool
    samples_min: int
    loops: int
    loop_rms: float
    area_ratio: float
    force_ratio: float
    penetration_ratio: float
    duration_ratio: float
    touch_force: float
    tension_share: float
    starts_at_zero: bool | None
    no_tension: bool | None
    sharp_at_origin: bool | None
    cubic_loss: bool | None


CLAIMS = {
    "starts_at_zero": "the force starts at zero",
    "no_tension": "the bodies never pull on each other",
    "sharp_at_origin": "the loop comes to a sharp point at the origin",
    "cubic_loss": "the energy lost grows with the impact speed as it does by the law",
}


SCORE_FIELDS = tuple(f.name for f in fields(Score))


@dataclass(frozen=True, slots=True)
class Measured:
    """Impacts as columns, shape (n,).

    speed: asked for, m/s.
    launch: a number that launches share which differ in phase only. speed_in, m/s, e and
    energy_lost (a share) are NaN where there is none.
    gained: whether any is known to have gained energy.
    """

    speed: Floats
    launch: NDArray[np.int64]
    parted: _Flags
    rested: _Flags
    speed_in: Floats
    e: Floats
    energy_lost: Floats
    samples: NDArray[np.int64]
    gained: bool


class Tally:
    """Adds up impacts of one setting at one step, and scores them against one law.

    It keeps the speed and e of each impact, 16 bytes, as α is fitted to
    all of them; all else is summed.
    """

    def __init__(self, law: HuntCrossley, mass: float) -> None:
        """A tally without impacts yet.

        mass: effective mass, kg.
        """
        self._law = law
        self._mass = mass
        # Numbers of impacts, of those that parted, and of those that came to rest.
        self._counts = np.zeros(3, dtype=np.int64)
        # Lowest and highest launch speed, m/s.
        self._ends = np.array([math.inf, -math.inf])
        # Pairs of (impact speeds, m/s; e).
        self._pairs: list[tuple[Floats, Floats]] = []
        self._off_law = _Errors()
        self._off_linear = _Errors()
        # Largest range over the phases: of e, and of its error.
        self._spreads = np.full(2, math.nan)
        self._loss = _Slope()
        self._law_loss = _Slope()
        self._gained = False
        self._samples = 0
        self._loops: list[LoopScore] = []

    def add_loops(self, loops: Iterable[LoopScore]) -> None:
        """Add the scores of loops of some of the impacts."""
        self._loops += loops

    def add(self, some: Measured) -> None:
        """Add one or more impacts; all phases of a launch have to come in one call.

        some: columns of shape (n,), speeds in m/s.
        """
        good = some.parted | some.rested
        speed_in = some.speed_in[good]
        e = some.e[good]
        launch = some.launch[good]
        self._counts += [len(good), some.parted.sum(), some.rested.sum()]
        lowest, highest = self._ends
        self._ends = np.array([min(lowest, some.speed.min()), max(highest, some.speed.max())])
        self._gained |= some.gained or bool((some.energy_lost[good] < -2 * _GAIN).any())
        if not len(e):
            return
        law = self._law
        off_law = e - closed_form.restitution(law.alpha, speed_in)
        self._off_law.add(off_law, speed_in)
        self._off_linear.add(e - (1 - law.alpha * speed_in), speed_in)
        spreads = np.array([phase_spread(launch, e), phase_spread(launch, off_law)])
        self._spreads = np.fmax(self._spreads, spreads)
        self._loss.add(speed_in, 0.5 * self._mass * speed_in**2 * (1 - e**2))
        self._law_loss.add(speed_in, np.asarray(closed_form.energy_loss(law, self._mass, speed_in)))
        fewest = int(some.samples[good].min())
        self._samples = min(self._samples, fewest) if self._pairs else fewest
        self._pairs.append((speed_in, e))

    def score(self) -> Score:
        """Score all impacts that were added. A number that they do not determine is NaN."""
        impacts, parted, rested = self._counts.tolist()
        constant, constant_error = best_constant(self._law.alpha, self._ends)
        exponent = self._loss.value()
        law_exponent = self._law_loss.value()
        alpha_fit = math.nan
        alpha_fit_rms = math.nan
        if parted + rested > 1:
            alpha_fit, alpha_fit_rms = _fitted_alpha(self._pairs)
        return Score(
            impacts=impacts,
            parted=parted,
            rested=rested,
            failed=impacts - parted - rested,
            max_error_law=self._off_law.largest,
            rms_error_law=self._off_law.rms(),
            worst_speed_law=self._off_law.worst_speed,
            max_error_linear=self._off_linear.largest,
            rms_error_linear=self._off_linear.rms(),
            constant_restitution=constant,
            constant_error_law=constant_error,
            constant_error_linear=float(self._law.alpha * np.ptp(self._ends) / 2),
            # Phases of a fall change the speed too: what e, or its error, does not owe to that.
            phase_spread=float(self._spreads.min()),
            alpha_fit=alpha_fit,
            alpha_fit_rms=alpha_fit_rms,
            energy_exponent=exponent,
            energy_exponent_law=law_exponent,
            energy_gained=self._gained,
            samples_min=self._samples,
            **_of_loops(self._loops),
            **_claims(self._loops, exponent, law_exponent),
        )


class _Errors:
    """Adds up errors, NaN as long as there is none.

    worst_speed: where the first largest is, m/s.
    """

    def __init__(self) -> None:
        self.largest = math.nan
        self.worst_speed = math.nan
        self._squares = 0.0
        self._count = 0

    def add(self, errors: Floats, speeds: Floats) -> None:
        """Add errors of e and the speeds at which they occurred, m/s; both of shape (n,), n > 0."""
        worst = int(np.abs(errors).argmax())
        size = abs(float(errors[worst]))
        # Also true where the size is NaN.
        if not size <= self.largest:
            self.largest = size
            self.worst_speed = float(speeds[worst])
        self._squares += float(np.sum(errors**2))
        self._count += len(errors)

    def rms(self) -> float:
        """Root mean square of the errors added so far; NaN without any."""
        return math.sqrt(self._squares / self._count) if self._count else math.nan


class _Slope:
    """p of ΔE ∝ v_i^p, the least-squares slope in log-log: by sums about the first point."""

    def __init__(self) -> None:
        # ln v and ln ΔE of the first impact: sums about it keep their digits.
        self._first = np.zeros(2)
        self._slowest = math.inf  # m/s
        self._fastest = 0.0
        # Sums of 1, x, y, x² and x y.
        self._sums = np.zeros(5)

    def add(self, speed_in: Floats, loss: Floats) -> None:
        """Add impact speeds, m/s, and energy losses, J; both of shape (n,). Losses of 0 are left
        out.
        """
        lossy = loss > 0
        if not lossy.any():
            return
        speeds = speed_in[lossy]
        points = np.array([np.log(speeds), np.log(loss[lossy])])
        if not self._sums[0]:
            self._first = points[:, 0].copy()
        x, y = points - self._first[:, None]
        self._sums += [len(x), x.sum(), y.sum(), (x * x).sum(), (x * y).sum()]
        self._slowest = min(self._slowest, float(speeds.min()))
        self._fastest = max(self._fastest, float(speeds.max()))

    def value(self) -> float:
        """NaN unless the losses span speeds a factor of 1.5 apart."""
        n, x, y, xx, xy = self._sums.tolist()
        if n < 3 or not self._fastest >= 1.5 * self._slowest:
            return math.nan
        slope: float = (n * xy - x * y) / (n * xx - x * x)
        return slope


def phase_spread(launch: NDArray[np.int64], values: Floats) -> float:
    """The largest difference between values of one launch at its phases; NaN if each launch has one
    value.

    launch: number of each value's launch, shape (n,).
    values: shape (n,).
    """
    order = np.lexsort((values, launch))
    _, first, count = np.unique(launch[order], return_index=True, return_counts=True)
    has_several = count > 1
    if not has_several.any():
        return math.nan
    ordered = values[order]
    spans = ordered[first + count - 1] - ordered[first]
    return float(spans[has_several].max())


def fit_alpha(speed_in: Floats, restitution: Floats) -> tuple[float, float]:
    """α (s/m) whose e of (16) is nearest to measured pairs by least
    squares, and what is left (rms).
    """
    return _fitted_alpha([(speed_in, restitution)])


def _fitted_alpha(pairs: Sequence[tuple[Floats, Floats]]) -> tuple[float, float]:
    """α (s/m) and what is left (rms, of e), by pairs of impact speeds
    (m/s) and e; at least one number.
    """
    # Imported here: simulating without scoring needs no SciPy optimizer.
    from scipy.optimize import minimize_scalar

    count = sum(len(speed_in) for speed_in, _ in pairs)
    mean_speed = sum(float(np.sum(speed_in)) for speed_in, _ in pairs) / count

    def misfit(log_alpha: float) -> float:
        alpha = math.exp(log_alpha)
        total = 0.0
        for speed_in, e in pairs:
            off = closed_form.restitution(alpha, speed_in) - e
            total += float(np.sum(off**2))
        return total / count

    # The search spans α from hardly any loss to hardly any bounce.
    bounds = (math.log(1e-6 / mean_speed), math.log(1e3 / mean_speed))
    best = minimize_scalar(misfit, bounds=bounds, method="bounded")
    return math.exp(best.x), math.sqrt(best.fun)


def best_constant(alpha: float, speeds: Floats) -> tuple[float, float]:
    """The one constant e that is least wrong over `speeds` (m/s), and
    its largest error against (16).

    e of (16) falls with speed, so the minimax constant is half-way between the ends of the band.
    """
    ends = closed_form.restitution(alpha, np.array([np.min(speeds), np.max(speeds)]))
    return float(ends.mean()), float(abs(ends[0] - ends[1]) / 2)


def _of_loops(loops: list[LoopScore]) -> dict[str, Any]:
    """Figures of all loops together: the worst of each."""
    worst: dict[str, Any] = {"loops": len(loops)}
    worst["loop_rms"] = max((loop.rms for loop in loops), default=math.nan)
    for ratio in ("area_ratio", "force_ratio", "penetration_ratio", "duration_ratio"):
        worst[ratio] = _furthest([getattr(loop, ratio) for loop in loops])
    for share in ("touch_force", "tension_share"):
        worst[share] = max((getattr(loop, share) for loop in loops), default=math.nan)
    return worst


def _claims(loops: list[LoopScore], exponent: float, law_exponent: float) -> dict[str, Any]:
    """Judge the paper's claims about a sound contact model by the measured loops; None if not
    resolved.
    """
    claims: dict[str, bool | None] = dict.fromkeys(CLAIMS)
    if loops and min(s.samples for s in loops) >= STEPS_AT_ITS_ENDS:
        starts_at_zero = all(s.touch_force < _NEAR_ZERO for s in loops)
        ends_at_zero = all(s.parting_force < _NEAR_ZERO for s in loops)
        claims["starts_at_zero"] = starts_at_zero
        claims["no_tension"] = all(s.tension_share < ROUND_OFF_SUM for s in loops)
        claims["sharp_at_origin"] = starts_at_zero and ends_at_zero
    if not math.isnan(exponent) and not math.isnan(law_exponent):
        claims["cubic_loss"] = abs(exponent - law_exponent) < _EXPONENT_SLACK
    return claims


def _furthest(ratios: list[float]) -> float:
    """The ratio furthest from 1, either way."""

    def distance(ratio: float) -> float:
        return abs(math.log(ratio)) if ratio > 0 else math.inf

    known = [ratio for ratio in ratios if not math.isnan(ratio)]
    return max(known, key=distance, default=math.nan)
