"""Tunes pairs of a user's own model: settings of its engine tried in it, under its own step and gravity."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench._arguments import checked
from hcbench.errors import EngineFailed, UserError
from hcbench.laws.require import require
from hcbench.laws.restitution import RestitutionCurve
from hcbench.measuring.measure import LONGEST_LIMIT_S, Job, run_job, source_of
from hcbench.sim import simulate
from hcbench.sim.capabilities import TunesModels
from hcbench.sim.model_under_test import (
    BESIDE,
    Facts,
    ModelSetting,
    ModelUnderTest,
    Output,
    Request,
    Texts,
)
from hcbench.sim.passivity import MOST_E
from hcbench.sim.promise import Promise
from hcbench.sim.standing import Standing
from hcbench.tuning.tune import MAX_ERROR

LIMIT_S = 600.0  # for one model, which takes some seconds on an idle machine
_TRIED_SPEEDS, _TRIED_PHASES = 6, 4
_HELD_OUT_SPEEDS, _HELD_OUT_PHASES = 7, 8
_POINTS = "points of contact"  # among `Facts.settings`
_BEFORE_PHASES = 2  # of the model as it was, at the band's ends and middle
_FAR = 0.2  # an error of e, from which on a setting is tried no further
_GAINS = 0.95  # of the error as it was: what a setting that is worth writing stays below


@dataclass(frozen=True, slots=True)
class TunedPair:
    """How a setting does for one pair.

    points: (mean speed at touch m/s, e wanted there, lowest e, highest e) at held-out speeds, 8 phases each.
    max_error: the largest |e - wanted| of these; infinite where an impact has no e. attitude: of the body,
    such as "edge"; "" where it has but one. taken: how much of the speed at touch, at most, joints and
    servos take between the contact's last force and the touch plane.
    """

    facts: Facts
    max_error: float
    points: tuple[tuple[float, float, float, float], ...]
    attitude: str = ""
    taken: float = 0.0


@dataclass(frozen=True, slots=True)
class TunedModel:
    """A setting for pairs in their own model, and how it does there.

    texts: of the setting; its `written` is "" where the engine has no such text. pairs: in each attitude.
    untuned: the same of the model as it was. before, after: how it stands without and with the setting.
    enough: error of e, within which a setting will do.
    """

    name: str
    texts: Texts
    notes: tuple[str, ...]
    pairs: tuple[TunedPair, ...]
    untuned: tuple[TunedPair, ...]
    before: Standing
    after: Standing
    enough: float = MAX_ERROR

    @property
    def paste(self) -> str:
        """Lines for the model or script."""
        return self.texts.paste

    @property
    def written(self) -> str:
        """The whole model with the lines."""
        return self.texts.written

    @property
    def max_error(self) -> float:
        """The largest of all pairs."""
        return _largest(self.pairs)

    @property
    def worse(self) -> list[str]:
        """What the setting makes worse than it may, in words."""
        return list(self.after.worse_than(self.before))

    @property
    def gains(self) -> bool:
        """Whether e is near enough to the target, or nearer than in the model as it was."""
        return self.max_error <= max(self.enough, _GAINS * _largest(self.untuned))

    @property
    def flat(self) -> bool | None:
        """Whether a body that meets on faces never gains energy; None where none does."""
        flat = [pair for pair in self.pairs if pair.attitude or pair.facts.settings.get(_POINTS, 1) > 1]
        return all(most <= MOST_E for pair in flat for *_, most in pair.points) if flat else None

    @property
    def taken(self) -> float:
        """What joints and servos take of the speed at touch, at most, after the contact's last force."""
        return max(pair.taken for pair in self.pairs)


def _largest(pairs: Sequence[TunedPair]) -> float:
    return max(pair.max_error for pair in pairs)


@dataclass(frozen=True, slots=True)
class _TuneJob(Job):
    """others: requests of further pairs. max_error: of e, within which the simplest setting will do."""

    others: tuple[Request, ...] = ()
    max_error: float = MAX_ERROR
    output: Output = BESIDE


@checked
def tune_model(
    source: Any,
    requests: Sequence[Request],
    wanted: RestitutionCurve,
    engine: str | None = None,
    max_error: float = MAX_ERROR,
    limit: float = LIMIT_S,
    output: Output = BESIDE,
) -> TunedModel:
    """The simplest of the engine's settings whose e is within `max_error` of what is wanted, for all pairs at
    once; or else the nearest.

    requests: one a pair; their speeds span the band. A loose box is tried on face, edge and vertex. output:
    where the texts are to be written. Files are run in a worker. UserError for a pair that cannot meet.
    """
    if len(requests) == 0:
        raise UserError("requests", "none", "one a pair")
    require("max_error", max_error, 0 <= max_error <= 1, "0 ... 1, a difference in e")
    require("limit", limit, 0 < limit <= LONGEST_LIMIT_S, f"above 0 s, up to {LONGEST_LIMIT_S:g} s")
    first, *others = requests
    job = _TuneJob(
        source=source,
        engine=engine,
        request=first,
        wanted=wanted,
        tolerance=0.0,
        diagnose=False,
        others=tuple(others),
        max_error=max_error,
        output=output,
    )
    return run_job(_tuned, job, limit)


def _tuned(job: Job) -> TunedModel:
    assert isinstance(job, _TuneJob)
    assert job.wanted is not None
    wanted, requests = job.wanted, (job.request, *job.others)
    engine, source, rebuild = source_of(job)
    if not isinstance(engine, TunesModels):
        expected = "an engine that tunes models of users"
        raise UserError("engine", repr(engine.name), expected, f"{source!r}")
    each = [way for request in requests for way in engine.attitudes(source, request)]
    before = engine.standing(source, None, requests)
    tries: list[
        tuple[float, float, ModelSetting, Standing]
    ] = []  # how much too large an error is, what is worse
    alike = [request for _, request in each]
    for setting in engine.model_settings(source, alike, wanted, rebuild, job.output.version):
        error = _tried(setting, alike, wanted, job.max_error)
        after = engine.standing(source, setting, requests)
        worse = len(list(after.worse_than(before)))
        tries.append((max(error, job.max_error), worse, setting, after))
        if error <= job.max_error and not worse:
            break
    _, _, setting, after = min(tries, key=lambda each: each[:2])
    pairs = _measured(setting.open, each, wanted, held_out=True)
    if not all(math.isfinite(pair.max_error) for pair in pairs):
        got = f"launches with the setting {setting.name!r} gave no restitution"
        raise EngineFailed("model", got, "a bounce from each", "Try other --speeds, or a smaller --timestep")
    notes = dict.fromkeys((*setting.notes, *(note for pair in pairs for note in pair.facts.notes)))
    promises = []
    for request in requests:
        theirs = [pair for pair, (_, each_) in zip(pairs, each, strict=True) if each_.pair == request.pair]
        band = min(request.speeds), max(request.speeds)
        promises.append(Promise(setting.name, 1, wanted, _largest(theirs), band))

    def as_it_was(request: Request) -> ModelUnderTest:
        return engine.open(rebuild() if rebuild else source, request, rebuild)

    return TunedModel(
        setting.name,
        setting.texts(promises, job.output),
        tuple(notes),
        pairs,
        _measured(as_it_was, each, wanted, held_out=False),
        before,
        after,
        min(job.max_error, MAX_ERROR),
    )


def _tried(
    setting: ModelSetting, requests: Sequence[Request], wanted: RestitutionCurve, enough: float
) -> float:
    """The largest error of e in some launches of each; of fewer where it is far too large already."""
    worst = 0.0
    for request in requests:
        speeds = _speeds(request, held_out=False)
        worst = max(worst, _measured_pair(setting.open, request, speeds, _TRIED_PHASES, wanted).max_error)
        if worst > max(enough, _FAR):
            break
    return worst


def _measured(
    opened: Callable[[Request], ModelUnderTest],
    each: Sequence[tuple[str, Request]],
    wanted: RestitutionCurve,
    held_out: bool,
) -> tuple[TunedPair, ...]:
    """Each pair in each attitude, at both ends of its band too; less finely where not held out."""
    phases, pairs = _HELD_OUT_PHASES if held_out else _BEFORE_PHASES, []
    for attitude, request in each:
        speeds = _speeds(request, held_out=True)
        speeds = (
            speeds if held_out else list(dict.fromkeys([speeds[0], speeds[len(speeds) // 2], speeds[-1]]))
        )
        pair = _measured_pair(opened, request, speeds, phases, wanted)
        pairs.append(dataclasses.replace(pair, attitude=attitude))
    return tuple(pairs)


def _speeds(request: Request, held_out: bool) -> list[float]:
    """Speeds over the band of a request, m/s; held out: its ends, and those that lie between others."""
    low, high = min(request.speeds), max(request.speeds)
    speeds = np.geomspace(low, high, 2 * _HELD_OUT_SPEEDS + 1 if held_out else _TRIED_SPEEDS)
    speeds[0], speeds[-1] = low, high
    return [float(v) for v in dict.fromkeys([low, *speeds[1::2], high] if held_out else speeds)]


def _measured_pair(
    opened: Callable[[Request], ModelUnderTest],
    request: Request,
    speeds: Sequence[float],
    phases: int,
    wanted: RestitutionCurve,
) -> TunedPair:
    """Launched at these speeds, at phases over the whole step."""
    each = tuple((i + 0.4) / phases for i in range(phases))
    worst, taken, points = 0.0, 0.0, []
    with opened(request) as model:
        for speed in speeds:
            launches = dataclasses.replace(request, speeds=(speed,), phases=each).launches()
            impacts = simulate.impacts_in(model, launches)
            restitutions = [i.restitution for i in impacts]
            touched = [i.speed_in for i in impacts if math.isfinite(i.speed_in)]
            v = float(np.mean(touched)) if touched else speed
            points.append((v, float(wanted.at(v)), min(restitutions), max(restitutions)))
            errors = [abs(i.restitution - float(wanted.at(i.speed_in))) for i in impacts]
            worst = max(worst, *(math.inf if math.isnan(error) else error for error in errors))
            lost = [i.restitution_after_force - i.restitution for i in impacts if i.restitution > 0.0]
            taken = max([taken, *(share for share in lost if math.isfinite(share))])
        return TunedPair(model.facts(), worst, tuple(points), taken=taken)
