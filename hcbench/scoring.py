"""Impacts in, scores out: pure functions, no engine, no files.

Two truths are kept apart by name everywhere: `law`, the restitution that eq. (16) delivers, and
`linear`, e = 1 - α v_i of eq. (2). They part ways as α v_i grows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.solvers import minimum
from hcbench.terms.arguments import checked
from hcbench.terms.bounds import positive, require
from hcbench.terms.impact import Floats, Impact, Launch, Loop, Status
from hcbench.terms.resolution import ROUND_OFF_SUM, STEPS_AT_ITS_ENDS, STEPS_TO_COMPARE

# Comparison of an impact's force loop with the law's.

_REFERENCE_POINTS = 2001


@dataclass(frozen=True, slots=True)
class LoopScore:
    """One loop against the law's loop at the same impact speed; ratios are engine / law.

    rms: distance in force at equal penetration and branch, root mean square over the loop's path in
        x, over the law's largest force.
    area_ratio: of the energy lost; NaN for a law without damping, which encloses no area.
    force_ratio, penetration_ratio: of the largest of each. duration_ratio: of the times in contact.
    touch_force, parting_force: the force at x = 0 that the first and last two samples point to,
        over the largest.
    tension_share: the share of the impulse that pulls.
    samples: steps in contact.
    """

    rms: float
    area_ratio: float
    force_ratio: float
    penetration_ratio: float
    duration_ratio: float
    touch_force: float
    parting_force: float
    tension_share: float
    samples: int


# All settings are launched at the same few speeds.
@lru_cache(maxsize=64)
def _law_loop(law: HuntCrossley, mass: float, speed: float) -> Loop:
    return closed_form.loop(law, mass, speed, _REFERENCE_POINTS)


def score_loop(impact: Impact, law: HuntCrossley, mass: float) -> LoopScore | None:
    """Compare one impact's loop with the law's at the same speed: ratios and shares, pure numbers.

    mass: effective, kg. None for an impact that did not part, has no loop, or whose loop has fewer
    steps than STEPS_TO_COMPARE.
    """
    loop = impact.loop
    if loop is None or impact.status is not Status.PARTED or impact.samples < STEPS_TO_COMPARE:
        return None
    speed = impact.speed_in
    truth = _law_loop(law, mass, speed)
    law_force_max = float(closed_form.force_max(law, mass, speed))
    force = loop.force
    largest = float(force.max())
    impulse = np.abs(force).sum()
    area_ratio = math.nan
    # A law without damping encloses no area.
    if law.alpha > 0:
        area_ratio = loop_area(loop) / float(closed_form.energy_loss(law, mass, speed))
    return LoopScore(
        rms=_force_distance(loop, truth) / law_force_max,
        area_ratio=area_ratio,
        force_ratio=largest / law_force_max,
        penetration_ratio=impact.penetration_max
        / float(closed_form.penetration_max(law, mass, speed)),
        duration_ratio=impact.duration / float(closed_form.duration(law, mass, speed)),
        touch_force=abs(_at_surface(loop.penetration[:2], force[:2])) / largest,
        parting_force=abs(_at_surface(loop.penetration[-2:], force[-2:])) / largest,
        tension_share=float(-force[force < 0].sum() / impulse),
        samples=impact.samples,
    )


def _at_surface(x: Floats, f: Floats) -> float:
    """Force at which the line through two samples meets x = 0, N.

    x: m, f: N, shape (2,).
    """
    if x[1] == x[0]:
        return float(f[0])
    return float(f[0] - x[0] * (f[1] - f[0]) / (x[1] - x[0]))


def loop_area(loop: Loop) -> float:
    """∮ F dx, J, the energy that the contact takes: from the surface, by trapezoids, to where the
    force has gone.

    Before the first sample the force is what the first two point to at x = 0;
    after the last it ends in a step. NaN for fewer than two samples.
    """
    x = loop.penetration
    f = loop.force
    if len(x) < 2:
        return math.nan
    at_touch = float(np.clip(_at_surface(x[:2], f[:2]), 0.0, max(f[0], 0.0)))
    # Penetration one step after the last sample, or the surface if that comes first, m.
    gone = max(0.0, float(x[-1] + loop.rate[-1] * (loop.time[-1] - loop.time[-2])))
    before = (at_touch + float(f[0])) / 2 * float(x[0])
    inside = float(np.sum((f[1:] + f[:-1]) / 2 * np.diff(x)))
    after = float(f[-1]) / 2 * (gone - float(x[-1]))
    return before + inside + after


def _force_distance(loop: Loop, truth: Loop) -> float:
    """Root mean square of F - F_law at equal penetration on the same branch,
    N, weighted by path length in x.

    truth: the law's loop at the same impact speed. Up to its largest penetration a loop goes in,
    from there on it comes out. Past the law's own largest penetration its two branches end in one
    point, whose force stands in.
    """
    x = loop.penetration
    top = int(x.argmax())
    law_x = truth.penetration
    law_top = int(law_x.argmax())
    going_in = np.interp(x, law_x[: law_top + 1], truth.force[: law_top + 1])
    # Reversed, as `interp` takes x that rise.
    coming_out = np.interp(x, law_x[law_top:][::-1], truth.force[law_top:][::-1])
    wrong = loop.force - np.where(np.arange(len(x)) <= top, going_in, coming_out)
    # With equal weights the many slow steps near the top would decide.
    weight = np.abs(np.gradient(x))
    return math.sqrt(float(np.sum(wrong**2 * weight) / np.sum(weight)))


# A force below this share of the largest counts as zero.
_NEAR_ZERO = 0.005
# Largest difference of the exponent of ΔE from the law's own.
_EXPONENT_SLACK = 0.15
# Speed gained beyond round-off, as a share.
_GAIN = 1e-9
_Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Score:
    """Errors of one setting at one step over a band of speeds and phases, against one α.

    parted, rested, failed: numbers of impacts by how they ended.
    max_error_..., rms_error_...: of e, against the law (`law`) and against 1 - α v (`linear`).
    worst_speed_law: impact speed of the largest error, m/s.
    constant_...: the best constant e over the band, and its largest errors.
    phase_spread: largest change of e with the phase of the touch.
    alpha_fit, alpha_fit_rms: α of the law nearest to the impacts, s/m, and what it leaves of e.
    energy_exponent: p of the energy lost ∝ v^p.
    energy_exponent_law: of the law.
    energy_gained: whether an impact returned more than it got.
    samples_min: fewest steps in contact. loops, loop_rms ...
    tension_share: number of loops, and the worst of each figure of `LoopScore`; NaN if none was
    resolved.
    The last four are claims, see CLAIMS: True, False, or None for "not resolved".
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
    launch: a number that launches share which differ in phase only.
    parted, rested: whether it ended so; an impact that is neither has failed, and counts for no
    error.
    speed_in: m/s.
    energy_lost: a share of the kinetic energy. These and e are NaN where there is none.
    samples: steps in contact.
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

        law: to score against.
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
        # Of e: against the law, and against 1 - α v.
        self._off_law = _Errors()
        self._off_linear = _Errors()
        # Largest range over the phases: of e, and of its error.
        self._spreads = np.full(2, math.nan)
        # Of the energy lost over speed: as measured, and by the law.
        self._loss = _Slope()
        self._law_loss = _Slope()
        # True where an impact returned more than it got.
        self._gained = False
        # Fewest steps in contact of an impact.
        self._samples = 0
        self._loops: list[LoopScore] = []

    def add_loops(self, loops: Iterable[LoopScore]) -> None:
        """Add the scores of loops of some of the impacts."""
        self._loops += loops

    def add(self, some: Measured) -> None:
        """Add one or more impacts; all phases of a launch have to come in one call.

        some: columns of shape (n,), speeds in m/s. Impacts that neither parted nor came to rest are
        counted, and change no other figure than the lowest and the highest launch speed.
        """
        good = some.parted | some.rested
        speed_in = some.speed_in[good]
        e = some.e[good]
        launch = some.launch[good]
        self._counts += [len(good), some.parted.sum(), some.rested.sum()]
        lowest, highest = self._ends
        self._ends = np.array([min(lowest, some.speed.min()), max(highest, some.speed.max())])
        # The kinetic energy goes with e²: a gain of e by _GAIN is one of energy by twice as much.
        self._gained |= some.gained or bool((some.energy_lost[good] < -2 * _GAIN).any())
        if not len(e):
            return
        law = self._law
        off_law = e - closed_form.restitution(law.alpha, speed_in)
        self._off_law.add(off_law, speed_in)
        self._off_linear.add(e - (1 - law.alpha * speed_in), speed_in)
        spreads = np.array([_spread_over_phases(launch, e), _spread_over_phases(launch, off_law)])
        self._spreads = np.fmax(self._spreads, spreads)
        self._loss.add(speed_in, 0.5 * self._mass * speed_in**2 * (1 - e**2))
        self._law_loss.add(speed_in, np.asarray(closed_form.energy_loss(law, self._mass, speed_in)))
        fewest = int(some.samples[good].min())
        self._samples = min(self._samples, fewest) if self._pairs else fewest
        self._pairs.append((speed_in, e))

    def score(self) -> Score:
        """Score all impacts that were added, at least one. A number that they do not determine is
        NaN.
        """
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
            # In a fall the phase changes the impact speed too, and e with it: the smaller of the
            # two ranges, of e and of its error, is what the speed does not explain.
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
        """Add errors of e and the impact speeds at which they occurred, m/s; both of shape (n,),
        n > 0.
        """
        worst = int(np.abs(errors).argmax())
        size = abs(float(errors[worst]))
        # Also true where either is NaN, and so for the first errors.
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
        # ln v and ln ΔE, less those of the first impact.
        x, y = points - self._first[:, None]
        self._sums += [len(x), x.sum(), y.sum(), (x * x).sum(), (x * y).sum()]
        self._slowest = min(self._slowest, float(speeds.min()))
        self._fastest = max(self._fastest, float(speeds.max()))

    def value(self) -> float:
        """The exponent p of ΔE ∝ v^p; NaN for fewer than three losses above 0, and where the
        fastest is below 1.5 times the slowest: too near one another for a slope.
        """
        n, x, y, xx, xy = self._sums.tolist()
        if n < 3 or not self._fastest >= 1.5 * self._slowest:
            return math.nan
        slope: float = (n * xy - x * y) / (n * xx - x * x)
        return slope


def _spread_over_phases(launch: NDArray[np.int64], values: Floats) -> float:
    """The largest difference between values of one launch at its phases; NaN if each launch has one
    value.

    launch: number of each value's launch, shape (n,).
    values: shape (n,).
    """
    # By launch, and its values rising: the first and last of each launch are its extremes.
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
    """The least-squares α (s/m) of measured pairs, and the root mean square of the errors of e that
    are left.

    pairs: arrays of impact speeds (m/s) and of e, of the same shape; at least one number in all.
    """
    count = sum(len(speed_in) for speed_in, _ in pairs)
    mean_speed = sum(float(np.sum(speed_in)) for speed_in, _ in pairs) / count

    def misfit(log_alpha: float) -> float:
        alpha = math.exp(log_alpha)
        total = 0.0
        for speed_in, e in pairs:
            off = closed_form.restitution(alpha, speed_in) - e
            total += float(np.sum(off**2))
        return total / count

    # The search, over ln α, spans α v from hardly any loss to hardly any bounce.
    log_alpha, mean_square = minimum(
        misfit, math.log(1e-6 / mean_speed), math.log(1e3 / mean_speed)
    )
    return math.exp(log_alpha), math.sqrt(mean_square)


def best_constant(alpha: float, speeds: Floats) -> tuple[float, float]:
    """The one constant e that is least wrong over `speeds` (m/s), and
    its largest error against the law (16).

    alpha: of the law, s/m. e of (16) falls with speed, so the minimax constant is half-way between
    the ends of the band; only the lowest and the highest speed count.
    """
    ends = closed_form.restitution(alpha, np.array([np.min(speeds), np.max(speeds)]))
    return float(ends.mean()), float(abs(ends[0] - ends[1]) / 2)


def _of_loops(loops: list[LoopScore]) -> dict[str, Any]:
    """Figures of all loops together, by the names that `Score` has for them: the worst of each.

    The worst ratio is the one furthest from 1. Without loops all are NaN, but their number.
    """
    worst: dict[str, Any] = {"loops": len(loops)}
    worst["loop_rms"] = max((loop.rms for loop in loops), default=math.nan)
    for ratio in ("area_ratio", "force_ratio", "penetration_ratio", "duration_ratio"):
        worst[ratio] = _furthest([getattr(loop, ratio) for loop in loops])
    for share in ("touch_force", "tension_share"):
        worst[share] = max((getattr(loop, share) for loop in loops), default=math.nan)
    return worst


def _claims(loops: list[LoopScore], exponent: float, law_exponent: float) -> dict[str, Any]:
    """Judge the paper's claims about a sound contact model, by the names of CLAIMS; None for one
    that is not resolved.

    loops: of all scored impacts; each claim about the force needs STEPS_AT_ITS_ENDS in every one.
    exponent, law_exponent: p of the energy lost ∝ v^p, measured and by the law; NaN where unknown.
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
    """The ratio furthest from 1, either way by its factor: 1/2 is as far as 2. NaN without any.

    A ratio that is not above 0 is the furthest of all; NaN is passed over.
    """

    def distance(ratio: float) -> float:
        return abs(math.log(ratio)) if ratio > 0 else math.inf

    known = [ratio for ratio in ratios if not math.isnan(ratio)]
    return max(known, key=distance, default=math.nan)


@checked
def score(impacts: Sequence[Impact], law: HuntCrossley, mass: float) -> Score:
    """Everything there is to say about one setting at one step against one law.

    impacts: one or more, over speeds and phases; a launch is one (speed, phase).
    mass: effective mass, kg.

    Raises UserError for no impacts, and for a mass that is not above 0.
    """
    require("impacts", list(impacts), bool(impacts), "one or more")
    positive("mass", mass, "kg")
    total = Tally(law, mass)
    total.add(_columns(impacts))
    loops = []
    for impact in impacts:
        loop = score_loop(impact, law, mass)
        if loop is not None:
            loops.append(loop)
    total.add_loops(loops)
    return total.score()


def _columns(impacts: Sequence[Impact]) -> Measured:
    """Impacts as columns of shape (n,): speeds in m/s, energies lost over the kinetic energy
    before.

    Launches that differ in phase alone share a number. What an impact does not have is NaN.
    """
    count = len(impacts)
    launch = np.zeros(count, dtype=np.int64)
    samples = np.zeros(count, dtype=np.int64)
    parted = np.zeros(count, dtype=bool)
    rested = np.zeros(count, dtype=bool)
    numbers = np.zeros((4, count))
    number_of: dict[Launch, int] = {}
    for i, impact in enumerate(impacts):
        launch[i] = number_of.setdefault(impact.launch.at_any_phase, len(number_of))
        samples[i] = impact.samples
        parted[i] = impact.status is Status.PARTED
        rested[i] = impact.status is Status.RESTED
        numbers[:, i] = (
            impact.launch.speed,
            impact.speed_in,
            impact.restitution,
            impact.energy_lost,
        )
    speed, speed_in, e, energy_lost = numbers
    return Measured(
        speed=speed,
        launch=launch,
        parted=parted,
        rested=rested,
        speed_in=speed_in,
        e=e,
        energy_lost=energy_lost,
        samples=samples,
        # A launch that diverged has no e to tell it by: the engine's own error may name it.
        gained=any("energy" in impact.reason for impact in impacts),
    )
