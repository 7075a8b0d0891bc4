"""Why a pair does not bounce as asked: every suspect is tried in copies of the model.

All suspects are fixed together first, and then those are let go without which the cure is as good. What is
left are the causes: so fixes that only help together are found, and one that changes nothing is not blamed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hcbench.errors import HcbenchError
from hcbench.impact import Status
from hcbench.measure.measurement import NOTABLE_GAIN, TOLERANCE, Cause
from hcbench.sim import simulate
from hcbench.sim.model_under_test import Suspect

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.impact import Impact, Launch
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.sim.model_under_test import ModelUnderTest

_SHIFT = 0.5  # of the error: how much of it a fix must take away, where that is less than the tolerance
_PROBE_PHASES = 4
_PROBE_STEPS = 20_000  # in contact, for all probes of one trial: slow contacts get fewer probes
_GRADES = 4  # of strength: among equals the order is that of the suspects
_FLAT = 0.1  # of the span of e that is wanted: contacts whose own e spans less have one for all speeds
_SHARE = 0.05  # of what the strongest cause moves: less is not worth a reader's time


def goal_of(
    asked: Sequence[float], speeds: Sequence[float], wanted: RestitutionCurve | None
) -> Callable[[float], float]:
    """e that a bounce at an approach speed should have; NaN where nobody said."""
    if wanted is not None:
        return lambda v: float(wanted.at(v))
    if not len(asked):
        return lambda _: math.nan
    order = np.argsort(speeds)
    at, e = np.asarray(speeds)[order], np.clip(np.asarray(asked)[order], 0.0, 1.0)
    return lambda v: float(np.interp(v, at, e))


def diagnose(
    model: ModelUnderTest,
    impacts: Sequence[Impact],
    goal: Callable[[float], float],
    wanted: RestitutionCurve | None = None,
    tolerance: float = TOLERANCE,
) -> tuple[tuple[Cause, ...], str]:
    """(causes, the strongest first; one sentence on what is left when all of them are fixed).

    goal: e over approach speed that the bounce is held against.
    """
    suspects = model.suspects(impacts, wanted)
    aim = next((c.assumed_e for c in suspects if c.assumed_e is not None), None)
    held: Callable[[float], float] = goal if aim is None else (lambda _: aim)
    certain = [c for c in suspects if c.always_reported]
    if not _wrong(impacts, held, tolerance):
        return tuple(_cause(c) for c in certain), ""
    trial = _Trial(model, _probes(impacts, held, model.step_cost), held)
    triable = [c for c in suspects if c.apply is not None]
    if not triable and suspects:
        return tuple(_cause(c) for c in suspects), "None of these could be tried on this model."
    if triable and trial.off(triable) > tolerance:  # a fix may bring out what it hid
        known = {c.code for c in suspects}
        fixed = model.fixed(triable)
        more = [c for c in fixed.suspects(trial.fly(triable), wanted) if c.code not in known]
        fixed.close()
        suspects += more
        triable += [c for c in more if c.apply is not None]
    causes = _convicted(triable, trial, tolerance) + [
        _cause(c) for c in suspects if c.apply is None and c.always_reported
    ]
    named = [c for c in triable if c.code in {cause.code for cause in causes}]
    remedy = _remedy(causes, trial.off([]), trial.off(named), trial.mean(named), tolerance)
    one = _one_for_all(impacts, held, tolerance) if trial.off(named) > tolerance else ""
    return tuple(causes), one if one and not causes else f"{remedy} {one}".rstrip()


def _convicted(triable: Sequence[Suspect], trial: _Trial, tolerance: float) -> list[Cause]:
    """The fewest fixes that cure as well as all of them do, the strongest first; of two that cure the same
    the likelier stays. Where all together cure nothing, those that help alone.
    """
    before, after = trial.off([]), trial.off(triable)
    least = max(min(tolerance, _SHIFT * before), _SHARE * before)
    if after > before - least:
        kept = [c for c in triable if before - trial.off([c]) > least]
        return [_cause(c, trial.off([c])) for c in triable if c in kept or c.always_reported]
    kept = list(triable)
    for suspect in reversed(triable):
        rest = [c for c in kept if c is not suspect]
        if trial.off(rest) - after <= least:
            kept = rest
    named = [c for c in triable if c in kept or c.always_reported]
    left_out = {c.code: trial.off([k for k in named if k is not c]) for c in named}
    strongest = max(left_out.values(), default=0.0) or 1.0
    named.sort(key=lambda c: -round(_GRADES * left_out[c.code] / strongest))  # stable: likeliest first
    return [_cause(c, trial.off([c]), left_out[c.code]) for c in named]


def _wrong(impacts: Sequence[Impact], goal: Callable[[float], float], tolerance: float) -> bool:
    for impact in impacts:
        if impact.status not in (Status.PARTED, Status.RESTED):
            return True
        off = abs(impact.restitution - goal(impact.speed_in))
        if off > tolerance or impact.restitution > 1 + NOTABLE_GAIN:
            return True
    return False


def _probes(impacts: Sequence[Impact], goal: Callable[[float], float], weight: float) -> list[Launch]:
    """Launches to try fixes on: a few phases of the worst speed, the lowest and the highest.

    weight: of a step, so that heavy models are tried less often.
    """

    def off(impact: Impact) -> float:
        wrong = abs(impact.restitution - goal(impact.speed_in))
        if math.isnan(wrong):
            return 0.0 if impact.status in (Status.PARTED, Status.RESTED) else math.inf
        return wrong

    worst = max(impacts, key=off).launch.speed
    speeds = sorted({i.launch.speed for i in impacts})
    chosen = {worst, speeds[0], speeds[-1]}
    kept: list[Launch] = []
    for speed in sorted(chosen):
        launches = [i.launch for i in impacts if i.launch.speed == speed]
        every = max(1, len(launches) // _PROBE_PHASES)
        kept += launches[::every][:_PROBE_PHASES]
    steps = weight * max(10, *(i.samples for i in impacts))
    few = max(1, int(_PROBE_STEPS / steps))
    mine = [launch for launch in kept if launch.speed == worst]
    return kept if few >= len(kept) else mine[:few]


class _Trial:
    """Flies the probes with some fixes made; each set of fixes once."""

    def __init__(self, model: ModelUnderTest, launches: list[Launch], goal: Callable[[float], float]) -> None:
        self.model, self.launches, self.goal = model, launches, goal
        self.known: dict[tuple[str, ...], list[Impact]] = {}

    def fly(self, fixes: Sequence[Suspect]) -> list[Impact]:
        key = tuple(sorted(c.code for c in fixes))
        if key not in self.known:
            try:
                with self.model.fixed(fixes) as changed:
                    self.known[key] = simulate.impacts_in(changed, self.launches)
            except HcbenchError:  # a fix that makes the pair unmeasurable helps nobody
                self.known[key] = []
        return self.known[key]

    def mean(self, fixes: Sequence[Suspect]) -> float:
        good = [i.restitution for i in self.fly(fixes) if math.isfinite(i.restitution)]
        return float(np.mean(good)) if good else math.nan

    def off(self, fixes: Sequence[Suspect]) -> float:
        """The largest |e - goal|; a failed impact counts 1, and without a goal what is above 1 counts."""
        impacts = self.fly(fixes)
        out = []
        for impact in impacts:
            wrong = abs(impact.restitution - self.goal(impact.speed_in))
            if math.isnan(impact.restitution):
                wrong = 1.0
            elif math.isnan(wrong):
                wrong = max(0.0, impact.restitution - 1.0)
            out.append(wrong)
        return max(out, default=1.0)


def _cause(suspect: Suspect, alone: float = math.nan, without: float = math.nan) -> Cause:
    return Cause(suspect.code, suspect.title, suspect.evidence, suspect.fix, alone, without)


def _one_for_all(impacts: Sequence[Impact], goal: Callable[[float], float], tolerance: float) -> str:
    """That this contact has one e and several are wanted; "" where that is not what is wrong."""
    parted = [i for i in impacts if i.status is Status.PARTED]
    e, wanted = [i.restitution for i in parted], [goal(i.speed_in) for i in parted]
    if not parted or any(map(math.isnan, wanted)):
        return ""
    span = max(wanted) - min(wanted)
    if span <= 2 * tolerance or max(e) - min(e) > _FLAT * span:
        return ""
    one = "takes one step and " if max(i.samples for i in parted) <= 1 else ""
    return (
        f"This contact {one}has one e for all speeds, {float(np.mean(e)):.4g}, and wanted are"
        f" {max(wanted):.4g} ... {min(wanted):.4g}. No constant comes nearer than {span / 2:.2g};"
        " `hcbench tune` makes contacts whose e falls with speed."
    )


def _remedy(causes: Sequence[Cause], before: float, after: float, mean: float, tolerance: float) -> str:
    if not causes:
        return "No cause was found among those that hcbench knows."
    if math.isnan(mean) or after > max(tolerance, 0.5 * before):
        return f"These do not explain all of it: with all of them fixed e is still off by {after:.2g}."
    return f"With these fixed e = {mean:.4g} at the speeds that were worst, off by {after:.2g}."
