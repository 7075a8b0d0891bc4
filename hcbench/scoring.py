"""Impacts in, scores out: pure functions, no engine, no files.

Two truths are kept apart by name everywhere: `law`, the restitution that eq. (16) delivers, and `linear`,
e = 1 - α v_i of eq. (2). They part ways as α v_i grows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np

from hcbench._arguments import checked
from hcbench.impact import Floats, Impact, Launch, Loop, Status
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.require import positive, require
from hcbench.resolution import ROUND_OFF_SUM, STEPS_AT_ITS_ENDS, STEPS_TO_COMPARE

_NEAR_ZERO = 0.005  # of the largest force: what counts as zero
_EXPONENT_SLACK = 0.15  # how far the exponent of ΔE may be from the law's own
_REFERENCE_POINTS = 2001
_GAIN = 1e-9  # relative: restitution above 1 by more than round-off


@dataclass(frozen=True, slots=True)
class LoopScore:
    """One loop against the law's loop at the same impact speed; ratios are engine / law.

    rms: distance in force at equal penetration and branch, root mean square over the loop's path in x, over
        the law's largest force. touch_force, parting_force: the force at x = 0 that the first and last two
        samples point to, over the largest. tension_share: the share of the impulse that pulls.
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


@dataclass(frozen=True, slots=True)
class Score:
    """How one setting at one step did over a band of speeds and phases, against one α. Loop figures are the
    worst over the loops given, NaN where none was resolved. Claims: True, False, or None for "not resolved".
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


def best_constant(alpha: float, speeds: Floats) -> tuple[float, float]:
    """The one constant e that is least wrong over `speeds` (m/s), and its largest error against (16).

    e of (16) falls with speed, so the minimax constant is half-way between the ends of the band.
    """
    ends = closed_form.restitution(alpha, np.array([np.min(speeds), np.max(speeds)]))
    return float(ends.mean()), float(abs(ends[0] - ends[1]) / 2)


def energy_exponent(speed_in: Floats, loss: Floats) -> float:
    """p of ΔE ∝ v_i^p, the least-squares slope in log-log.

    NaN unless the losses span speeds a factor of 1.5 apart.
    """
    lossy = loss > 0
    if lossy.sum() < 3 or speed_in[lossy].max() < 1.5 * speed_in[lossy].min():
        return math.nan
    return float(np.polyfit(np.log(speed_in[lossy]), np.log(loss[lossy]), 1)[0])


def fit_alpha(speed_in: Floats, restitution: Floats) -> tuple[float, float]:
    """α (s/m) whose e of (16) is nearest to measured pairs by least squares, and what is left (rms)."""
    from scipy.optimize import minimize_scalar  # here, as simulating without scoring needs none of it

    def misfit(log_alpha: float) -> float:
        return float(np.mean((closed_form.restitution(math.exp(log_alpha), speed_in) - restitution) ** 2))

    scale = float(speed_in.mean())
    best = minimize_scalar(misfit, bounds=(math.log(1e-6 / scale), math.log(1e3 / scale)), method="bounded")
    return math.exp(best.x), math.sqrt(best.fun)


@lru_cache(maxsize=64)  # as every setting is launched at the same few speeds
def _law_loop(law: HuntCrossley, mass: float, speed: float) -> Loop:
    return closed_form.loop(law, mass, speed, _REFERENCE_POINTS)


def score_loop(impact: Impact, law: HuntCrossley, mass: float) -> LoopScore | None:
    """One impact's loop against the law's at the same speed in; None where there is no resolved loop."""
    loop = impact.loop
    if loop is None or impact.status is not Status.PARTED or impact.samples < STEPS_TO_COMPARE:
        return None
    speed = impact.speed_in
    truth = _law_loop(law, mass, speed)
    force_max, force = float(closed_form.force_max(law, mass, speed)), loop.force
    largest = float(force.max())
    impulse = np.abs(force).sum()
    return LoopScore(
        rms=_force_distance(loop, truth) / force_max,
        area_ratio=loop_area(loop) / float(closed_form.energy_loss(law, mass, speed))
        if law.alpha > 0
        else math.nan,
        force_ratio=largest / force_max,
        penetration_ratio=impact.penetration_max / float(closed_form.penetration_max(law, mass, speed)),
        duration_ratio=impact.duration / float(closed_form.duration(law, mass, speed)),
        touch_force=abs(_at_surface(loop.penetration[:2], force[:2])) / largest,
        parting_force=abs(_at_surface(loop.penetration[-2:], force[-2:])) / largest,
        tension_share=float(-force[force < 0].sum() / impulse),
        samples=impact.samples,
    )


def _at_surface(x: Floats, f: Floats) -> float:
    """Force at which the line through two samples meets x = 0, N."""
    return float(f[0] - x[0] * (f[1] - f[0]) / (x[1] - x[0])) if x[1] != x[0] else float(f[0])


def loop_area(loop: Loop) -> float:
    """∮ F dx, J: from the surface, by trapezoids, to where the force has gone.

    Before the first sample the force is what the first two point to at x = 0; after the last it ends in a
    step.
    """
    x, f = loop.penetration, loop.force
    if len(x) < 2:
        return math.nan
    at_touch = float(np.clip(_at_surface(x[:2], f[:2]), 0.0, max(f[0], 0.0)))
    gone = max(0.0, float(x[-1] + loop.rate[-1] * (loop.time[-1] - loop.time[-2])))
    inside = float(np.sum((f[1:] + f[:-1]) / 2 * np.diff(x)))
    return (at_touch + float(f[0])) / 2 * float(x[0]) + inside + float(f[-1]) / 2 * (gone - float(x[-1]))


def _force_distance(loop: Loop, truth: Loop) -> float:
    """Root mean square of F - F_law at equal penetration on the same branch, weighted by path length in x.

    Past the law's own largest penetration its two branches end in one point, whose force stands in.
    """
    peak, top = int(truth.penetration.argmax()), int(loop.penetration.argmax())
    x, f = loop.penetration, loop.force
    going_in = np.interp(x, truth.penetration[: peak + 1], truth.force[: peak + 1])
    coming_out = np.interp(x, truth.penetration[peak:][::-1], truth.force[peak:][::-1])
    wrong = f - np.where(np.arange(len(x)) <= top, going_in, coming_out)
    weight = np.abs(np.gradient(x))
    return math.sqrt(float(np.sum(wrong**2 * weight) / np.sum(weight)))


@checked
def score(impacts: Sequence[Impact], law: HuntCrossley, mass: float) -> Score:
    """Everything there is to say about one setting at one step against one law.

    impacts: one or more, over speeds and phases; a launch is one (speed, phase). mass: effective mass, kg.
    """
    require("impacts", list(impacts), bool(impacts), "one or more")
    positive("mass", mass, "kg")
    good = [i for i in impacts if i.is_measured]
    speed_in = np.array([i.speed_in for i in good])
    e = np.array([i.restitution for i in good])
    nominal = np.array([i.launch.speed for i in impacts])
    constant, constant_error = best_constant(law.alpha, nominal)
    off_law, off_linear = e - closed_form.restitution(law.alpha, speed_in), e - (1 - law.alpha * speed_in)
    loss = 0.5 * mass * speed_in**2 * (1 - e**2)
    law_loss = np.asarray(closed_form.energy_loss(law, mass, speed_in))
    exponent, law_exponent = energy_exponent(speed_in, loss), energy_exponent(speed_in, law_loss)
    alpha_fit, alpha_fit_rms = fit_alpha(speed_in, e) if len(good) > 1 else (math.nan, math.nan)
    loops = [s for s in (score_loop(i, law, mass) for i in good) if s is not None]
    return Score(
        impacts=len(impacts),
        parted=sum(i.status is Status.PARTED for i in impacts),
        rested=sum(i.status is Status.RESTED for i in impacts),
        failed=len(impacts) - len(good),
        max_error_law=_largest(off_law),
        rms_error_law=_rms(off_law),
        worst_speed_law=float(speed_in[np.abs(off_law).argmax()]) if good else math.nan,
        max_error_linear=_largest(off_linear),
        rms_error_linear=_rms(off_linear),
        constant_restitution=constant,
        constant_error_law=constant_error,
        constant_error_linear=float(law.alpha * np.ptp(nominal) / 2),
        # Phases of a fall change the speed too: what e, or its error, does not owe to that.
        phase_spread=min(phase_spread(good), phase_spread(good, off_law)),
        alpha_fit=alpha_fit,
        alpha_fit_rms=alpha_fit_rms,
        energy_exponent=exponent,
        energy_exponent_law=law_exponent,
        energy_gained=_gains_energy(impacts),
        samples_min=min((i.samples for i in good), default=0),
        **_of_loops(loops),
        **_claims(loops, exponent, law_exponent),
    )


def _gains_energy(impacts: Sequence[Impact]) -> bool:
    lost = (i.energy_lost for i in impacts if i.is_measured)
    return any(loss < -2 * _GAIN for loss in lost) or any("energy" in i.reason for i in impacts)


def _of_loops(loops: list[LoopScore]) -> dict[str, Any]:
    """Figures of all loops together: the worst of each."""
    return {
        "loops": len(loops),
        "loop_rms": max((s.rms for s in loops), default=math.nan),
        "area_ratio": _furthest([s.area_ratio for s in loops]),
        "force_ratio": _furthest([s.force_ratio for s in loops]),
        "penetration_ratio": _furthest([s.penetration_ratio for s in loops]),
        "duration_ratio": _furthest([s.duration_ratio for s in loops]),
        "touch_force": max((s.touch_force for s in loops), default=math.nan),
        "tension_share": max((s.tension_share for s in loops), default=math.nan),
    }


def _claims(loops: list[LoopScore], exponent: float, law_exponent: float) -> dict[str, Any]:
    """The paper's claims about a sound contact model, judged on what was measured."""
    seen = bool(loops) and min(s.samples for s in loops) >= STEPS_AT_ITS_ENDS
    zero = all(s.touch_force < _NEAR_ZERO for s in loops)
    sharp = zero and all(s.parting_force < _NEAR_ZERO for s in loops)
    cubic = abs(exponent - law_exponent) < _EXPONENT_SLACK
    return {
        "starts_at_zero": zero if seen else None,
        "no_tension": all(s.tension_share < ROUND_OFF_SUM for s in loops) if seen else None,
        "sharp_at_origin": sharp if seen else None,
        "cubic_loss": None if math.isnan(exponent) or math.isnan(law_exponent) else cubic,
    }


def phase_spread(impacts: Sequence[Impact], off: Floats | None = None) -> float:
    """The largest difference in e between launches that differ in phase only; NaN with nothing to compare.

    off: of each impact e less what its own speed in would have, where phases of a fall change that speed.
    """
    by_launch: dict[Launch, list[float]] = {}
    for impact, e in zip(impacts, [i.restitution for i in impacts] if off is None else off, strict=True):
        by_launch.setdefault(impact.launch.at_any_phase, []).append(float(e))
    return max((max(e) - min(e) for e in by_launch.values() if len(e) > 1), default=math.nan)


def _largest(values: Floats) -> float:
    return float(np.abs(values).max()) if values.size else math.nan


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def _furthest(ratios: list[float]) -> float:
    """The ratio furthest from 1, either way."""
    known = [r for r in ratios if not math.isnan(r)]
    return max(known, key=lambda r: abs(math.log(r)) if r > 0 else math.inf, default=math.nan)


SCORE_FIELDS = tuple(f.name for f in fields(Score))
