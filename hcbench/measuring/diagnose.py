"""Diagnosis of a pair that does not bounce as asked: every suspect is tried in copies of the model.

All suspects are fixed together first. Then each fix is left out in turn, the least likely first,
and stays out if the cure is as good without it; the suspects that are left are the causes. So fixes
that help only together are found, and one that changes nothing is not blamed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.laws.restitution import RestitutionCurve
from hcbench.measuring.measurement import NOTABLE_GAIN, TOLERANCE, Cause
from hcbench.sim import simulate
from hcbench.sim.model_under_test import Suspect
from hcbench.system.errors import HcbenchError
from hcbench.system.text import time_step
from hcbench.terms.impact import Impact, Launch, Status
from hcbench.terms.resolution import STEPS_BY_CHANCE

# Suspects that need no engine: what may keep any pair from bouncing as expected, read from its
# impacts.

# A speed gained in a step or a contact, as a share of the impact speed, shifts e by as much.
NOTABLE_GRAVITY = TOLERANCE
# Only the user's own model has this cause, not a copy with fixes.
ENERGY_GAIN = "energy-gain"
# A contact that begins but exerts no force.
NO_PUSH = "no-push"
# The e that a fix is written for where no target is given.
BOUNCY = 0.9


@dataclass(frozen=True, slots=True)
class StepFix:
    """Means to set an engine's time step, for fixes.

    timestep: s, the model's own. text: what to write, with {} for the step. apply: called with a model and
        `timestep`, sets it there.
    """

    timestep: float
    text: str
    apply: Callable[..., None]

    def to(self, timestep: float) -> tuple[str, Callable[[Any], None]]:
        """(text, apply) of the fix that sets this step, s."""
        return self.text.format(f"{timestep:.6g}"), partial(self.apply, timestep=timestep)


def speeds_of(impacts: Sequence[Impact]) -> list[float]:
    """Launch speeds, m/s; at touch of bodies that fall from a height."""
    speeds = []
    for impact in impacts:
        falls = impact.launch.height is not None and math.isfinite(impact.speed_in)
        speeds.append(impact.speed_in if falls else impact.launch.speed)
    return speeds


def constant_e(impacts: Sequence[Impact], wanted: RestitutionCurve | None) -> float | None:
    """The one e for a fix that is constant in speed, within 0 ... 1; None without a target.

    It is the mean of the target at the lowest and at the highest speed of the impacts.
    """
    if wanted is None:
        return None
    speeds = speeds_of(impacts)
    ends = wanted.at(np.array([min(speeds), max(speeds)]))
    return float(np.clip(ends.mean(), 0.0, 1.0))


def energy_gain(impacts: Sequence[Impact], step: StepFix) -> Iterator[Suspect]:
    """Yield the suspect of a step that does not resolve the contact, where a body leaves faster
    than it came; at most one.

    impacts: of the model as it is. step: the engine's way to set a step; the fix takes a twentieth
    of it or less.
    """
    gain, samples = _gain(impacts)
    if gain <= 1 + NOTABLE_GAIN:
        return
    # So that the shortest contact takes 200 steps.
    text, apply = step.to(step.timestep * min(0.05, max(samples, 1) / 200))
    yield Suspect(
        ENERGY_GAIN,
        "The contact adds energy: the step does not resolve it.",
        f"e up to {gain:.4g} with {samples} steps in contact",
        text,
        apply,
    )


def few_steps(impacts: Sequence[Impact], step: StepFix, softer: str) -> Iterator[Suspect]:
    """Yield the suspect of too few steps in contact, where no energy is gained; at most one.

    impacts: of the model as it is. step: the engine's way to set a step. softer: what else would
    help, as text to paste.
    """
    gain, samples = _gain(impacts)
    if gain > 1 + NOTABLE_GAIN or not 0 < samples <= STEPS_BY_CHANCE:
        return
    # So that the shortest contact takes 60 steps, well above the 20 that are needed.
    text, apply = step.to(step.timestep * samples / 60)
    yield Suspect(
        "few-steps",
        "Too few steps in contact: e depends on where in a step the contact starts, by chance.",
        f"{samples} steps in contact at {time_step(step.timestep)} s; 20 or more are needed",
        f"{text} or {softer}",
        apply,
    )


def _gain(impacts: Sequence[Impact]) -> tuple[float, int]:
    """(largest e, fewest steps in contact) of the impacts that parted; (0, 0) without any.

    Of a body that slides or spins it is the e that would change the energy as much.
    """
    parted = [impact for impact in impacts if impact.status is Status.PARTED]
    largest = 0.0
    for impact in parted:
        if not math.isnan(impact.energy_lost):
            # A normal impact keeps the share e² of its energy.
            kept = max(0.0, 1.0 - impact.energy_lost)
            largest = max(largest, math.sqrt(kept))
    fewest = min((impact.samples for impact in parted), default=0)
    return largest, fewest


def gravity(
    impacts: Sequence[Impact],
    acceleration: Sequence[float],
    timestep: float,
    fix: Callable[[float], str],
    apply: Callable[[Any], None],
) -> Iterator[Suspect]:
    """Yield the suspect of gravity, where it changes the speed much within a step or a contact; at
    most one.

    impacts: their slowest impact speed and their longest contact count. acceleration: vector,
    m/s^2. timestep: s.
    fix: makes what to write, of the longest contact (s) that gravity leaves alone.
    apply: takes gravity away in a model.
    """
    g = float(np.linalg.norm(acceleration))
    slowest = min((i.speed_in for i in impacts if math.isfinite(i.speed_in)), default=0.0)
    longest = max([timestep, *(i.duration for i in impacts if math.isfinite(i.duration))])
    if g == 0 or slowest == 0 or g * longest < NOTABLE_GRAVITY * slowest:
        return
    yield Suspect(
        "gravity",
        "Gravity changes the speed during a step or a contact by a large share of the impact speed.",
        f"g h = {g * timestep:.3g} m/s a step, {g * longest:.3g} m/s a contact, against {slowest:.3g} m/s",
        fix(NOTABLE_GRAVITY * slowest / g),
        apply,
    )


def other_contacts(names: Iterable[str]) -> Iterator[Suspect]:
    """Yield the suspect of other things that touch the pair during the impact; nothing without
    names.

    names: theirs. The suspect has no fix to try, and is reported in any case.
    """
    if others := ", ".join(names):
        yield Suspect(
            "other-contacts",
            "Other things touch the two at the same time: e is not that of the pair alone.",
            others,
            "a pair that meets before anything else, or a model of the two alone",
            always_reported=True,
        )


if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.sim.model_under_test import ModelUnderTest, Suspect

    Goal = Callable[[float], float]

# Phases of a speed at which a trial launches.
_PROBE_PHASES = 4
# Cost of a step, over a ball's, from which on one phase is tried where e hardly depends on it.
_COSTLY = 3.0
# e hardly depends on the phase if it differs by no more than this over the phases.
_ALIKE = 1e-3
# Steps in contact, for all probes of one trial: slow contacts get fewer probes.
_PROBE_STEPS = 20_000
# A fix must take away this share of the error if that is less than the tolerance.
_HALF = 0.5
# A fix must take away this share of the error in any case.
_NOTABLE = 0.05
# Error of e of a pair that has no bounce, or bounces fully where it should not at all.
_NO_BOUNCE = 1.0
_NO_FIX = "No fix that hcbench knows helps: with all of them made, some launches still have no restitution."
# Grades of strength: causes of one grade keep the order of the suspects.
_GRADES = 4
# A contact whose e spans less than this share of the target's span has one e for all speeds.
_FLAT = 0.1


def goal_of(
    asked: Sequence[float], speeds: Sequence[float], wanted: RestitutionCurve | None
) -> Goal:
    """Make the function from approach speed (m/s) to the e that a bounce should have: the user's
    target, else what the model itself asks for, else NaN.

    asked: e that the model asks for at each of `speeds`, m/s; () for none. wanted: the user's
    target, or None.
    """
    if wanted is not None:
        return lambda speed: float(wanted.at(speed))
    if not len(asked):
        return lambda _: math.nan
    # np.interp needs rising speeds.
    order = np.argsort(speeds)
    rising = np.asarray(speeds)[order]
    e = np.clip(np.asarray(asked)[order], 0.0, 1.0)
    return lambda speed: float(np.interp(speed, rising, e))


def diagnose(
    model: ModelUnderTest,
    impacts: Sequence[Impact],
    goal: Goal,
    wanted: RestitutionCurve | None = None,
    tolerance: float = TOLERANCE,
) -> tuple[tuple[Cause, ...], str]:
    """Find the causes of a bounce that is not as it should be.

    Returns the causes, the strongest first, and sentences on what is left when all are fixed.

    impacts: of the model as it is.
    goal: e over approach speed, m/s, that the bounce should have; NaN for none.
    wanted: the user's target, or None.
    tolerance: |e - goal| up to which a bounce is as it should be.
    Without an error there are only causes that are always reported, and "". A copy that cannot be
    measured counts as an error of 1; other errors of the engine are raised.
    """
    touched = [impact for impact in impacts if impact.status is not Status.NO_TOUCH]
    # Of launches that all missed, suspects are named all the same.
    impacts = touched or impacts
    suspects = model.suspects(impacts, wanted)
    if not touched and NO_PUSH not in _codes(suspects):
        # Something stopped the bodies before the contact could act.
        return (), ""

    assumed = _assumed_e(suspects)
    if assumed is not None:
        goal = _constant_goal(assumed)
    if not _is_off(impacts, goal, tolerance):
        return _always_reported(suspects), ""
    if suspects and not _fixable(suspects):
        return tuple(map(_cause, suspects)), "None of these could be tried on this model."

    trials = _Trials(model, _probe_launches(impacts, goal, model.step_cost), goal)
    suspects += _hidden_suspects(suspects, trials, wanted, tolerance)
    fixable = _fixable(suspects)
    causes = _tried_causes(fixable, trials, tolerance)
    causes += [_cause(s) for s in suspects if s.apply is None and s.always_reported]
    codes = _codes(causes)
    fixes = [s for s in fixable if s.code in codes]
    remaining = trials.max_error(fixes)
    if fixes and remaining >= _NO_BOUNCE:
        return _always_reported(suspects), _NO_FIX

    hint = ""
    if remaining > tolerance:
        hint = _constant_e_hint(impacts, goal, tolerance)
    if not causes:
        return (), hint or "No cause was found among those that hcbench knows."
    sentences = [_summary(fixes, trials, tolerance)]
    if assumed is not None:
        sentences.append(f"No target e is given: e = {assumed:.4g} is assumed.")
    if hint:
        sentences.append(hint)
    return tuple(causes), " ".join(sentences)


def _assumed_e(suspects: Sequence[Suspect]) -> float | None:
    """The e that a suspect takes for the target where the user gave none; of several the likeliest
    suspect's, None where no suspect takes one.
    """
    for suspect in suspects:
        if suspect.assumed_e is not None:
            return suspect.assumed_e
    return None


def _constant_goal(e: float) -> Goal:
    return lambda _: e


def _always_reported(suspects: Sequence[Suspect]) -> tuple[Cause, ...]:
    return tuple(_cause(s) for s in suspects if s.always_reported)


def _codes(found: Iterable[Suspect | Cause]) -> frozenset[str]:
    return frozenset(item.code for item in found)


def _without(fixes: Sequence[Suspect], left_out: Suspect) -> list[Suspect]:
    """All fixes but one, in their order."""
    return [fix for fix in fixes if fix is not left_out]


def _fixable(suspects: Sequence[Suspect]) -> list[Suspect]:
    return [s for s in suspects if s.apply is not None]


class _Trials:
    """The probe launches simulated with some fixes made; each set of fixes once.

    model: without fixes. launches: the probes. goal: e over approach speed, m/s; NaN for none.
    """

    def __init__(self, model: ModelUnderTest, launches: Sequence[Launch], goal: Goal) -> None:
        self.model = model
        self.launches = launches
        self.goal = goal
        # By the codes of the fixes that were made.
        self._impacts: dict[frozenset[str], list[Impact]] = {}

    def impacts(self, fixes: Sequence[Suspect]) -> list[Impact]:
        """Impacts of the probe launches, one each, in a copy of the model with these fixes made;
        empty where the pair cannot be measured then.
        """
        key = _codes(fixes)
        if key not in self._impacts:
            try:
                with self.model.fixed(fixes) as fixed:
                    self._impacts[key] = simulate.impacts_in(fixed, self.launches)
            except HcbenchError:
                self._impacts[key] = []
        return self._impacts[key]

    def max_error(self, fixes: Sequence[Suspect]) -> float:
        """The largest error of e; 1 for a pair that cannot be measured."""
        errors = [_error(impact, self.goal) for impact in self.impacts(fixes)]
        return max(errors, default=1.0)

    def keeps(self, fixes: Sequence[Suspect], is_small: Callable[[float], bool]) -> bool:
        """Say whether the largest error of e is small with these fixes made.

        is_small: of an error; true of each below one of which it is true. The launch that is most
        wrong without fixes goes first: alone it shows most sets of fixes that do not help.
        """
        if _codes(fixes) not in self._impacts:
            errors = [_error(impact, self.goal) for impact in self.impacts([])]
            worst = self.launches[errors.index(max(errors))] if errors else self.launches[0]
            with suppress(HcbenchError), self.model.fixed(fixes) as fixed:
                (impact,) = simulate.impacts_in(fixed, [worst])
                if not is_small(_error(impact, self.goal)):
                    return False
        return is_small(self.max_error(fixes))


def _error(impact: Impact, goal: Goal) -> float:
    """|e - goal|; 1 for an impact without an e; without a goal the part of e that is above 1.

    goal: e over approach speed, m/s; NaN for none.
    """
    e = impact.restitution
    if math.isnan(e):
        return 1.0
    error = abs(e - goal(impact.speed_in))
    # Without a target only a gain of energy is surely wrong.
    if math.isnan(error):
        return max(0.0, e - 1.0)
    return error


def _is_off(impacts: Sequence[Impact], goal: Goal, tolerance: float) -> bool:
    """Say whether an impact has no e, misses the goal by more than `tolerance`, or gains energy."""
    for impact in impacts:
        e = impact.restitution
        if math.isnan(e) or e > 1 + NOTABLE_GAIN:
            return True
        if _error(impact, goal) > tolerance:
            return True
    return False


def _probe_launches(impacts: Sequence[Impact], goal: Goal, step_cost: float) -> list[Launch]:
    """Launches to try fixes on: some phases of the worst speed, the lowest and the highest; as many
    as can be afforded of the worst speed alone, where all would take too many steps.

    impacts: of the model as it is, one or more. goal: e over approach speed, m/s; NaN for none.
    step_cost: time of a step over that of a ball on a plane.
    """

    def badness(impact: Impact) -> tuple[bool, float]:
        return math.isnan(impact.restitution), _error(impact, goal)

    worst = max(impacts, key=badness).launch.speed
    by_speed: dict[float, list[Impact]] = {}
    for impact in impacts:
        by_speed.setdefault(impact.launch.speed, []).append(impact)
    probes: list[Launch] = []
    for speed in sorted({worst, min(by_speed), max(by_speed)}):
        probes += _probe_phases(by_speed[speed], step_cost)

    # Steps in contact of the longest impact.
    longest = max(10, *(impact.samples for impact in impacts))
    affordable = max(1, int(_PROBE_STEPS / (step_cost * longest)))
    if affordable >= len(probes):
        return probes
    return [probe for probe in probes if probe.speed == worst][:affordable]


def _probe_phases(impacts: Sequence[Impact], step_cost: float) -> list[Launch]:
    """Launches of one speed at _PROBE_PHASES phases or fewer, evenly chosen; at one phase alone
    where steps cost much and all phases have the same e.

    impacts: of that speed, one or more, by phase. step_cost: time of a step over that of a ball on
    a plane.
    """
    e = [impact.restitution for impact in impacts]
    # False where one of them is NaN.
    are_alike = max(e) - min(e) <= _ALIKE
    count = 1 if step_cost >= _COSTLY and are_alike else _PROBE_PHASES
    launches = [impact.launch for impact in impacts]
    stride = max(1, len(launches) // count)
    return launches[::stride][:count]


def _hidden_suspects(
    suspects: Sequence[Suspect], trials: _Trials, wanted: RestitutionCurve | None, tolerance: float
) -> list[Suspect]:
    """Suspects that a copy with all fixes made shows for the first time, if these fixes do not cure
    the pair; else none.

    suspects: of the model as it is. trials: measures copies with fixes. wanted: the user's target,
    or None. tolerance: error of e up to which a pair counts as cured.
    """
    fixes = _fixable(suspects)
    impacts = trials.impacts(fixes)
    if not fixes or not impacts or trials.max_error(fixes) <= tolerance:
        return []
    # The fixes may bring a gain of energy that the model itself does not have.
    known = _codes(suspects) | {ENERGY_GAIN}
    with trials.model.fixed(fixes) as fixed:
        return [s for s in fixed.suspects(impacts, wanted) if s.code not in known]


def _tried_causes(fixes: Sequence[Suspect], trials: _Trials, tolerance: float) -> list[Cause]:
    """Causes among the suspects: the fewest fixes that together cure as well as all do, the
    strongest first; or, if all together cure nothing, each that helps alone.

    Suspects that are always reported are among the causes. The strength of a fix is the error of e
    that comes back if it alone is left out.
    fixes: suspects that can be tried, the likeliest first. trials: measures copies with fixes.
    tolerance: error of e up to which a bounce is as it should be.
    """
    before = trials.max_error([])
    after = trials.max_error(fixes)
    # The least change of the error that tells two sets of fixes apart.
    notable = max(min(tolerance, _HALF * before), _NOTABLE * before)

    def helps(fix: Suspect) -> bool:
        return trials.keeps([fix], lambda error: before - error > notable)

    def halves(fix: Suspect) -> bool:
        return trials.keeps([fix], lambda error: before - error >= _HALF * before)

    if after > before - notable:
        helpful = [s for s in fixes if s.always_reported or helps(s)]
        return [_cause(s, trials.max_error([s])) for s in helpful]

    needed = _minimal_fixes(fixes, trials, after + notable)
    needed += [s for s in fixes if s.named_if_half and halves(s)]
    reported = [s for s in fixes if s.always_reported or s in needed]
    error_without: dict[str, float] = {}
    for suspect in reported:
        error_without[suspect.code] = trials.max_error(_without(reported, suspect))
    largest = max(error_without.values(), default=0.0) or 1.0

    def strength(suspect: Suspect) -> int:
        # In few grades, so that round-off does not decide the order of nearly equal ones.
        return round(_GRADES * error_without[suspect.code] / largest)

    # The sort is stable: among equals the likeliest stays first.
    reported.sort(key=lambda s: -strength(s))
    return [_cause(s, trials.max_error([s]), error_without[s.code]) for s in reported]


def _minimal_fixes(fixes: Sequence[Suspect], trials: _Trials, allowed: float) -> list[Suspect]:
    """The fixes that are needed to keep the largest error of e within `allowed`: they are left out one
    after the other, the least likely first, as long as the error stays within.

    fixes: the likeliest first. trials: measures copies with fixes.
    """
    needed = list(fixes)
    for suspect in reversed(fixes):
        others = _without(needed, suspect)
        if trials.keeps(others, lambda error: error <= allowed):
            needed = others
    return needed


def _cause(suspect: Suspect, alone: float = math.nan, without: float = math.nan) -> Cause:
    """A suspect as a cause. alone: error of e with its fix alone; without: with all but its fix."""
    return Cause(
        code=suspect.code,
        title=suspect.title,
        evidence=suspect.evidence,
        fix=suspect.fix,
        alone=alone,
        without=without,
    )


def _summary(fixes: Sequence[Suspect], trials: _Trials, tolerance: float) -> str:
    """A sentence on what remains with all causes fixed: the mean e and the largest error, or that
    the error is not explained.

    fixes: of the causes. trials: measures copies with fixes. The error counts as explained if what
    remains is within `tolerance`, or is half of that of the model as it is, or less.
    """
    before = trials.max_error([])
    after = trials.max_error(fixes)
    e = [impact.restitution for impact in trials.impacts(fixes)]
    finite = [value for value in e if math.isfinite(value)]
    if not finite or after > max(tolerance, _HALF * before):
        return f"These do not explain all of it: with all of them fixed e is still wrong by {after:.2g}."
    mean = float(np.mean(finite))
    return f"With these fixed e = {mean:.4g} at the speeds that were worst, wrong by {after:.2g}."


def _constant_e_hint(impacts: Sequence[Impact], goal: Goal, tolerance: float) -> str:
    """A sentence if this contact has the same e at every speed, but the target's e varies by more
    than one e can be right for; "" otherwise.

    goal: e over approach speed, m/s. tolerance: error of e that is allowed.
    """
    parted = [impact for impact in impacts if impact.status is Status.PARTED]
    e = [impact.restitution for impact in parted]
    wanted = [goal(impact.speed_in) for impact in parted]
    if not parted or any(map(math.isnan, wanted)):
        return ""
    highest = max(wanted)
    lowest = min(wanted)
    span = highest - lowest
    if span <= 2 * tolerance or max(e) - min(e) > _FLAT * span:
        return ""
    longest = max(impact.samples for impact in parted)
    in_one_step = ""
    if longest <= 1:
        in_one_step = "takes one step and "
    mean = float(np.mean(e))
    return (
        f"This contact {in_one_step}gives the same e at every speed, {mean:.4g}, but the target is"
        f" {highest:.4g} ... {lowest:.4g}. The best constant e is wrong by {span / 2:.2g};"
        " `hcbench tune` makes contacts whose e falls with speed."
    )
