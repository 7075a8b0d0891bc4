"""Tunes pairs of a user's own model: settings of its engine tried in it,
under its own step and gravity.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.laws.conventions import AdamsImpact, NewtonSpring
from hcbench.laws.restitution import MeasuredRestitution, RestitutionCurve
from hcbench.measuring.curve import curve_of, impacts_of
from hcbench.measuring.measure import Job, run_job, source_of
from hcbench.measuring.request import LONGEST_LIMIT_S
from hcbench.sim import registry
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
from hcbench.sim.rest import WORSE, Standing
from hcbench.sim.simulate import impacts_in
from hcbench.system.errors import UserError
from hcbench.system.text import as_bound
from hcbench.terms.arguments import checked
from hcbench.terms.bounds import require
from hcbench.terms.impact import Floats, Impact, Launch, Status
from hcbench.tuning.answer import MAX_ERROR
from hcbench.tuning.landing import landing_as_it_is, tune_landing
from hcbench.tuning.tuned_model import (
    AS_IT_IS,
    GAINS,
    LandingChange,
    TunedModel,
    TunedPair,
    largest_error,
)

if TYPE_CHECKING:
    from hcbench.sim.engine import Engine
    from hcbench.sim.landing import DropTest
    from hcbench.terms.setting import Setting


# Time limit of one model, s: on an idle machine tuning takes some seconds.
LIMIT_S = 600.0
# Speeds and phases at which each setting is tried.
_TRIED_SPEEDS = 6
_TRIED_PHASES = 4
# Speeds that the search did not see.
_HELD_OUT_SPEEDS = 7
# The intervals about the worst of them are halved so often.
_HALVINGS = 1
# Phases of a speed before any are added.
_PHASES = 4
# Phases of the untuned model, at the ends and the middle of the band.
_BEFORE_PHASES = 2
# Pairs up to this multiple of the lightest mass share one stiffness and damping.
_SAME_MASS = 1.2
# Launches that judge the chosen setting, at speeds and phases that fill band and step evenly:
# multiples of these shares of both (M. Roberts, The unreasonable effectiveness of quasirandom
# sequences, 2018).
_EVEN_LAUNCHES = 160
_EVEN_SHARES = (0.7548776662466927, 0.5698402909980532)
# Then launches about each of the worst in several rounds, from this share of the band and of a step
# away; each round comes four times as near.
_WORST = 4
_NEAR_LAUNCHES = 6
_ROUNDS = 3
_NEARBY = 0.02
_SEED = 1609
# Angles from the normal, rad, at which a setting that friction may change is launched.
_ANGLES = (0.0, math.radians(45.0), math.radians(70.0))
# A setting whose error of e reaches this is tried no further.
_FAR = 0.2
_BOUNCES = "a pair that bounces at all speeds of its band"


@dataclass(frozen=True, slots=True)
class Rebound:
    """Target of a robot: how high its centre of mass rebounds from a drop of 10 cm, m."""

    height: float


@dataclass(frozen=True, slots=True)
class _TuneJob(Job):
    """A job of measuring, with what tuning needs besides.

    others: requests of further pairs.
    spring: what gives e, in place of `wanted`.
    rebound: of a robot, m, in place of an e.
    max_error: of e, within which the simplest setting will do.
    """

    others: tuple[Request, ...] = ()
    spring: AdamsImpact | NewtonSpring | None = None
    rebound: float | None = None
    max_error: float = MAX_ERROR
    output: Output = BESIDE


@checked
def tune_job(
    source: Any,
    requests: Sequence[Request],
    wanted: RestitutionCurve | AdamsImpact | NewtonSpring | Rebound,
    engine: str | None = None,
    max_error: float = MAX_ERROR,
    limit: float = LIMIT_S,
    output: Output = BESIDE,
) -> TunedModel:
    """Find the simplest setting whose e is within `max_error` of the target for all pairs at once,
    or the nearest.

    A model in a file is run in a worker. A loose box is tried on face, edge and vertex.

    source: the model.
    requests: one a pair; their speeds span the band.
    wanted: e over speed, what Adams or Newton state, or a robot's rebound.
    engine: its name; None for the one that opens the model.
    max_error: of e, within which the simplest setting will do.
    limit: s, after which the model counts as hung.
    output: where the texts are to be written.
    Raises UserError for a pair that cannot meet.
    """
    if len(requests) == 0:
        raise UserError("requests", "none", "one a pair")
    require("max_error", max_error, 0 <= max_error <= 1, "0 ... 1, a difference in e")
    require("limit", limit, 0 < limit <= LONGEST_LIMIT_S, f"above 0 s, up to {LONGEST_LIMIT_S:g} s")
    first, *others = requests
    curve: RestitutionCurve | None = None
    spring: AdamsImpact | NewtonSpring | None = None
    rebound: float | None = None
    if isinstance(wanted, RestitutionCurve):
        curve = wanted
    elif isinstance(wanted, Rebound):
        rebound = wanted.height
    else:
        spring = wanted
    job = _TuneJob(
        source=source,
        engine=engine,
        request=first,
        wanted=curve,
        tolerance=0.0,
        diagnose=False,
        others=tuple(others),
        spring=spring,
        rebound=rebound,
        max_error=max_error,
        output=output,
    )
    return run_job(_tuned, job, limit)


@dataclass(frozen=True, slots=True)
class _Try:
    """A setting that was tried.

    standing: how the model stands with it.
    error: its largest error of e, infinite where a launch has none.
    worse: how many quantities of the model at rest it makes worse.
    throws_up: it throws up bodies that slide, where the model as it is did not.
    pairs, landing: results at held-out launches and of a drop of the robot; None until judged.
    """

    setting: ModelSetting
    standing: Standing
    error: float
    worse: int
    throws_up: bool
    pairs: tuple[TunedPair, ...] | None = None
    landing: LandingChange | None = None

    @property
    def failure(self) -> str:
        """Sentence on a launch that has no e; "" where each of the judged pairs has one."""
        return next((pair.failure for pair in self.pairs or () if pair.failure), "")


def _require_known_version(engine: Engine, output: Output) -> None:
    """Raise UserError where the output is for another engine than the model's, or for a version of
    it with which hcbench was never tried.
    """
    if not output.version or engine.backend is None:
        return
    name = registry.base_name(engine.name)
    version = ".".join(map(str, output.version))
    got = f"{output.engine}@{version}"
    if output.engine != name:
        raise UserError("for", repr(got), f"a version of {name}, which opens this model")
    if engine.backend.untried(version):
        known = f"{name}@{engine.backend.oldest} ... {name}@{engine.backend.newest}"
        raise UserError("for", repr(got), known)


def _require_writable(engine: TunesModels, output: Output) -> None:
    """Raise UserError where files are to be written of an engine whose settings are lines of a script
    alone, before anything is measured.
    """
    asked = "--write-include" if output.include else "--write-model"
    is_asked = output.folder is not None or output.include
    if is_asked and not engine.writes_models:
        got = f"a model of {engine.title}, whose settings are lines of a script"
        advice = "Leave it out: hcbench prints the lines to paste; --json has them, too"
        raise UserError(asked, got, "a model whose engine writes it, such as MJCF", advice)


def _tuned(job: Job) -> TunedModel:
    """Try the engine's settings, the simplest first; return the first that will do, or else the
    nearest, or the model as it is where that is nearer still.

    A setting will do if e is within the job's `max_error` for all pairs, and all that stands still
    stands as still as before. One that throws up what slides comes after all others.
    Raises UserError for an engine that tunes no models, for a file that it cannot write, and where
    every setting has a launch without an e.
    """
    assert isinstance(job, _TuneJob)
    requests = (job.request, *job.others)
    engine, source, rebuild = source_of(job)
    if not isinstance(engine, TunesModels):
        expected = "an engine that tunes models of users"
        raise UserError("engine", repr(engine.name), expected, f"{source!r}")
    _require_known_version(engine, job.output)
    _require_writable(engine, job.output)

    if job.rebound is not None:
        was = engine.landing(source, requests)
        return tune_landing(engine, source, requests, was, job.rebound, job.output)
    landed = landing_as_it_is(engine, source, requests)
    if landed is not None and _stops(job):
        # A foot that stops does not stop the robot.
        return tune_landing(engine, source, requests, landed, 0.0, job.output)

    def as_it_was(request: Request) -> ModelUnderTest:
        return engine.open(rebuild() if rebuild else source, request, rebuild)

    wanted = job.wanted or _of_spring(job, requests, as_it_was)
    attitudes: list[tuple[str, Request]] = []
    for request in requests:
        attitudes += engine.attitudes(source, request)
    before = engine.standing(source, None, requests)
    search = _TuneSearch(
        engine=engine,
        source=source,
        requests=requests,
        attitudes=attitudes,
        wanted=wanted,
        max_error=job.max_error,
        as_it_was=as_it_was,
        before=before,
        landed=landed,
    )
    settings = engine.model_settings(
        source, search.alike, wanted, before, rebuild, job.output.version
    )
    tries = _tries(search, settings)
    untuned = _measured(as_it_was, attitudes, wanted, held_out=False)
    as_it_is = ModelSetting(AS_IT_IS, (), as_it_was, lambda *_: Texts(""))
    stays = _Try(as_it_is, standing=before, error=largest_error(untuned), worse=0, throws_up=False)
    order = _in_order(tries, stays, search.alike, wanted, job.max_error)
    limit = max(job.max_error, GAINS * largest_error(untuned))
    enough = min(job.max_error, MAX_ERROR)
    best = _best(search, order, limit, enough)
    setting = best.setting
    pairs = best.pairs or ()
    # A dict keeps each note once, in order.
    notes = dict.fromkeys(setting.notes)
    for pair in pairs:
        notes |= dict.fromkeys(pair.facts.notes)
    launched = list(zip(search.alike, pairs, strict=True))
    promises = [_promise(setting.name, request, wanted, launched) for request in requests]
    return TunedModel(
        name=setting.name,
        texts=setting.texts(promises, job.output),
        notes=tuple(notes),
        pairs=pairs,
        untuned=untuned,
        before=before,
        after=best.standing,
        enough=enough,
        landing=best.landing,
    )


@dataclass(frozen=True, slots=True)
class _TuneSearch:
    """The model and the target that settings are tried for.

    requests: one a pair.
    attitudes: each pair in each way that its body can lie (face, edge, vertex): that way's name,
    and the request.
    wanted: e over speed.
    max_error: of e, within which a setting will do.
    as_it_was: opens the model without a setting, for a request.
    before: how the model stands without a setting.
    landed: how the robot of the pairs lands without one; None for a model without a robot.
    """

    engine: TunesModels
    source: Any
    requests: Sequence[Request]
    attitudes: Sequence[tuple[str, Request]]
    wanted: RestitutionCurve
    max_error: float
    as_it_was: Callable[[Request], ModelUnderTest]
    before: Standing
    landed: DropTest | None

    @property
    def alike(self) -> list[Request]:
        """One request for each attitude of each pair: a setting has to hold in all of them."""
        return [request for _, request in self.attitudes]


def _tries(search: _TuneSearch, settings: Iterable[ModelSetting]) -> list[_Try]:
    """Try settings, in their order, up to the first that will do; one or more.

    Raises UserError for a single pair that does not touch with the first, nor in the model as it
    is.
    """
    tries: list[_Try] = []
    for setting in settings:
        error = _tried(setting, search.alike, search.wanted, search.max_error)
        if not tries and math.isinf(error) and len(search.requests) == 1:
            _require_touches(setting, search.as_it_was, search.attitudes, search.wanted)
        is_nearest = all(error < tried.error for tried in tries)
        # Sliding takes more launches: a setting that others surpass is not worth them.
        if setting.slides and is_nearest:
            error = max(error, _excess_lift(search, setting))
        after = search.engine.standing(search.source, setting, search.requests)
        worse = len(list(after.worse_than(search.before)))
        pairs = None
        if error <= search.max_error and not worse:
            # Few launches may have missed the worst.
            pairs = _measured(setting.open, search.attitudes, search.wanted, held_out=True)
            error = max(error, largest_error(pairs))
        tries.append(
            _Try(
                setting=setting,
                standing=after,
                error=error,
                worse=worse,
                throws_up=after.throws_up(search.before),
                pairs=pairs,
            )
        )
        if error <= search.max_error and not worse:
            break
    return tries


def _excess_lift(search: _TuneSearch, setting: ModelSetting) -> float:
    """Change of e by sliding with a setting, see `_lift`; 0 where it is within the error that is
    allowed, or hardly more than in the model as it is.
    """
    lift = _lift(setting.open, search.alike)
    if lift > max(search.max_error, WORSE * _lift(search.as_it_was, search.alike)):
        return lift
    return 0.0


def _in_order(
    tries: Sequence[_Try],
    stays: _Try,
    requests: Sequence[Request],
    wanted: RestitutionCurve,
    max_error: float,
) -> list[_Try]:
    """The tries, the best first, and among them the model as it is.

    tries: at least one.
    stays: the model as it is.
    wanted: e over speed.
    max_error: of e; nearer than that counts alike.
    The model as it is comes first if the best try's error is not below its own (or its own is near
    enough, where the best try makes something worse); else last, or nowhere if it has no e.
    """
    # What throws up a body that slides gives it energy: the nearest of the others is better.
    order = sorted(
        tries, key=lambda tried: (tried.throws_up, max(tried.error, max_error), tried.worse)
    )
    nearest = order[0].error
    if order[0].worse or order[0].throws_up:
        nearest = max(nearest, min(max_error, MAX_ERROR))
    # `stays.error` is of few launches, enough to see that a model is far from its target; a model
    # that looks near is launched as the tries were.
    if stays.error <= nearest and _tried(stays.setting, requests, wanted, nearest) <= nearest:
        return [stays, *order]
    return [*order, stays] if math.isfinite(stays.error) else order


def _best(search: _TuneSearch, order: Sequence[_Try], limit: float, enough: float) -> _Try:
    """The first try, in order, with which a robot lands no worse and no launch gains energy, if its
    error is within a limit; else the first that bounces at all, those that gain energy last.

    order: the tries, the best first, and among them the model as it is.
    limit: error of e that is allowed with a setting.
    enough: error of e that is allowed of the model as it is.
    Raises UserError where each has a launch without an e.
    """
    # In order: what lands worse, then the first that lands no worse but is not near enough.
    others: list[_Try] = []
    gaining: list[_Try] = []
    # Why those that were launched do not bounce.
    silent: list[str] = []
    for without_landing in order:
        # The landing of the first that lands worse may be shown, of the others one drop may do.
        tried = _dropped(search, without_landing, until_worse=bool(others))
        # A landing costs less than launches that no search saw: these only where it is good.
        if tried.landing is not None and tried.landing.worse:
            others.append(without_landing if others else tried)
            continue
        is_own = tried.setting.name == AS_IT_IS
        if is_own and tried.error > enough:
            # More launches, which cost as much as a search, find no smaller error.
            others.append(tried)
            break
        judged = _judged_try(tried, search)
        if judged.failure:
            silent.append(judged.failure)
            continue
        assert judged.pairs is not None
        if not is_own and max(pair.max_e for pair in judged.pairs) > MOST_E:
            gaining.append(judged)
            continue
        if largest_error(judged.pairs) <= (enough if is_own else limit):
            return judged
        others.append(judged)
        break
    for tried in others + gaining:
        judged = _judged_try(tried, search)
        if not judged.failure:
            if judged.landing is None:
                judged = _dropped(search, judged)
            return judged
        silent.append(judged.failure)
    got = f"with the setting {order[0].setting.name!r}, {silent[0]}"
    raise UserError("pair", got, _BOUNCES, "Try other --speeds, or a smaller --timestep")


def _dropped(search: _TuneSearch, tried: _Try, until_worse: bool = False) -> _Try:
    """Drop a robot with the setting of a try, and return the try with its landing; the try itself
    without a robot.

    until_worse: one drop is enough where something is worse in it.
    """
    landed = search.landed
    if landed is None:
        return tried
    after = landed
    # The setting that leaves the model as it is has no model of its own.
    if tried.setting.source is not None:
        after = search.engine.landing(tried.setting.source, search.requests, landed, until_worse)
    return dataclasses.replace(tried, landing=LandingChange(landed, after))


def _require_touches(
    setting: ModelSetting,
    as_it_was: Callable[[Request], ModelUnderTest],
    attitudes: Sequence[tuple[str, Request]],
    wanted: RestitutionCurve,
) -> None:
    """Refuse a pair with a launch that touches neither in the model as it is nor with a setting, by
    UserError: servos hold it back, and the search would take minutes to find no e.

    as_it_was: opens the model as it is.
    attitudes: of the pair as it can lie, with their names.
    """
    if all(pair.touches for pair in _measured(setting.open, attitudes, wanted, held_out=False)):
        return
    for pair in _measured(as_it_was, attitudes, wanted, held_out=False):
        if not pair.touches:
            advice = "Try other --speeds, another --key or --qpos, or --no-actuators"
            raise UserError("pair", pair.failure, _BOUNCES, advice)


def _judged_try(tried: _Try, search: _TuneSearch) -> _Try:
    """Measure the pairs with the setting of a try, unless that was done, and return the try with
    what they do.
    """
    pairs = tried.pairs
    if not pairs:
        pairs = _measured(tried.setting.open, search.attitudes, search.wanted, held_out=True)
    return dataclasses.replace(tried, pairs=pairs)


def _stops(job: _TuneJob) -> bool:
    """Say whether the target is an e of 0 over the whole band."""
    if job.wanted is None:
        return False
    speeds = job.request.speeds
    return job.wanted.best_constant(min(speeds), max(speeds)) == 0.0


def _promise(
    name: str,
    request: Request,
    wanted: RestitutionCurve,
    launched: Sequence[tuple[Request, TunedPair]],
) -> Promise:
    """The promise of a setting for the pair of a request, over its band of speeds, m/s.

    name: of the setting.
    wanted: e over speed.
    launched: what was asked and measured of all pairs, in each of their attitudes.
    """
    theirs = [measured for asked, measured in launched if asked.pair == request.pair]
    band = min(request.speeds), max(request.speeds)
    bound = float(as_bound(largest_error(theirs)))
    return Promise(name, rows=1, curve=wanted, error=bound, speeds=band)


def _of_spring(
    job: _TuneJob, requests: Sequence[Request], opened: Callable[[Request], ModelUnderTest]
) -> RestitutionCurve:
    """The curve e(v) of a contact by stiffness and damping (`job.spring`) between bodies of the
    pairs' effective mass, over the band of all requests.

    opened: opens the model for the request of a pair.
    Raises UserError for pairs of different effective masses, on which that e depends.
    """
    assert job.spring is not None
    masses: list[float] = []
    speeds: list[float] = []
    for request in requests:
        speeds += request.speeds
        with opened(request) as model:
            masses.append(model.facts().effective_mass)
    if max(masses) > _SAME_MASS * min(masses):
        got = (
            f"effective masses of {min(masses):.3g} to {max(masses):.3g} kg, on which its e depends"
        )
        raise UserError("pair", got, "pairs of one mass", "Tune them one by one")
    return MeasuredRestitution(job.spring.points(float(np.mean(masses)), min(speeds), max(speeds)))


def _tried(
    setting: ModelSetting, requests: Sequence[Request], wanted: RestitutionCurve, enough: float
) -> float:
    """The largest error of e in a few launches of each pair with a setting; infinite where one has
    no e.

    requests: one a pair.
    wanted: e over speed.
    enough: error of e that is near enough. After a pair with a far larger error the pairs that are
    left are not launched: the result is a lower bound.
    """
    worst = 0.0
    for request in requests:
        speeds = _speeds(request, held_out=False)
        worst = max(
            worst, _measured_pair(setting.open, request, speeds, _TRIED_PHASES, wanted).max_error
        )
        if worst > max(enough, _FAR):
            break
    return worst


def _lift(opened: Callable[[Request], ModelUnderTest], requests: Sequence[Request]) -> float:
    """The largest difference of e between launches that slide and those that do not, of one speed
    along the normal; infinite where one has no e or cannot slide.

    opened: opens the model for a request.
    requests: one a pair.
    """
    largest = 0.0
    phases = tuple((i + 0.5) / _TRIED_PHASES for i in range(_TRIED_PHASES))
    for request in requests:
        ends = tuple(dict.fromkeys((min(request.speeds), max(request.speeds))))
        sent = dataclasses.replace(request, speeds=ends, phases=phases, angle=_ANGLES)
        try:
            with opened(request) as model:
                impacts = impacts_in(model, sent.launches())
        except UserError:
            return math.inf
        # e of the launch straight down, by speed along the normal and phase.
        straight = {}
        for impact in impacts:
            if not impact.launch.is_oblique:
                straight[impact.launch.speed, impact.launch.phase] = impact.restitution
        for impact in impacts:
            lift = abs(impact.restitution - straight[impact.launch.speed, impact.launch.phase])
            if math.isnan(lift):
                lift = math.inf
            largest = max(largest, lift)
    return largest


def _measured(
    opened: Callable[[Request], ModelUnderTest],
    attitudes: Sequence[tuple[str, Request]],
    wanted: RestitutionCurve,
    held_out: bool,
) -> tuple[TunedPair, ...]:
    """Measure e(v) of each pair in each attitude, in this order.

    opened: opens the model for a request.
    attitudes: (name, request) of each pair in each way that its body can lie.
    wanted: e over speed.
    held_out: whether to measure at speeds and phases that no search used, and nearer and nearer to
    the worst; else at three speeds of the band, enough to see that a setting is far off.
    """
    pairs = []
    for attitude, request in attitudes:
        speeds = _speeds(request, held_out=True)
        if held_out:
            pair = _measured_pair(opened, request, speeds, _PHASES, wanted, _HALVINGS)
        else:
            few = list(dict.fromkeys([speeds[0], speeds[len(speeds) // 2], speeds[-1]]))
            pair = _measured_pair(opened, request, few, _BEFORE_PHASES, wanted)
        pairs.append(dataclasses.replace(pair, attitude=attitude))
    return tuple(pairs)


def _speeds(request: Request, held_out: bool) -> list[float]:
    """Speeds over the band of a request, m/s, rising, evenly over their logarithm.

    held_out: the ends of the band, and speeds that lie between those that a search uses.
    """
    low = min(request.speeds)
    high = max(request.speeds)
    count = _TRIED_SPEEDS
    if held_out:
        count = 2 * _HELD_OUT_SPEEDS + 1
    speeds = np.geomspace(low, high, count)
    # Its ends may be off in the last digit.
    speeds[0] = low
    speeds[-1] = high
    kept = speeds.tolist()
    if held_out:
        kept = [low, *kept[1::2], high]
    # A band of one speed has equal ends: each speed once.
    return list(map(float, dict.fromkeys(kept)))


def _measured_pair(
    opened: Callable[[Request], ModelUnderTest],
    request: Request,
    speeds: Sequence[float],
    phases: int,
    wanted: RestitutionCurve,
    halvings: int = 0,
) -> TunedPair:
    """Measure one pair: e(v) and the errors of e at these speeds, each at phases over the whole
    step.

    opened: opens the model for a request.
    speeds: m/s.
    phases: how many a speed.
    wanted: e over speed.
    halvings: how often speeds between the worst one and its neighbours are added, to look for a
    larger error; each speed is then launched at the phases between which e differs, too, as
    `measure` does, and the setting is also judged by launches that no search saw.
    """
    # Where in a step the bodies touch, 0 to 1.
    shares = tuple((i + 0.4) / phases for i in range(phases))
    by_speed: dict[float, list[Impact]] = {}
    with opened(request) as model:
        for halving in range(halvings + 1):
            new = tuple(speeds)
            if halving:
                new = tuple(_about_worst(by_speed, wanted))
            sent = dataclasses.replace(
                request, speeds=new, phases=shares, adapt_phases=halvings > 0
            )
            impacts = impacts_of(model, sent)
            for speed in new:
                by_speed[speed] = [i for i in impacts if i.launch.speed == speed]
        every: list[Impact] = []
        for speed in sorted(by_speed):
            every += by_speed[speed]
        # The part of e that other forces take after the contact's force has ended.
        taken = 0.0
        for impact in every:
            share = impact.restitution_after_force - impact.restitution
            if impact.restitution > 0.0 and math.isfinite(share) and abs(share) > abs(taken):
                taken = share
        curve = curve_of(every, lambda impact: float(wanted.at(impact.speed_in)))
        judged: list[Impact] = []
        if halvings:
            judged = _judged(model, request, every, wanted)
        facts = model.facts()
        return TunedPair(
            facts,
            curve,
            taken=taken,
            launches=len(every) + len(judged),
            beyond=_error(judged, wanted),
            highest=max((impact.restitution for impact in judged), default=0.0),
            failure=_failure(facts, [*every, *judged]),
            touches=all(impact.status is not Status.NO_TOUCH for impact in every),
        )


def _failure(facts: Facts, impacts: Sequence[Impact]) -> str:
    """Clause on the first impact without an e; "" where each has one.

    facts: of the pair.
    """
    failed = next((impact for impact in impacts if not impact.is_measured), None)
    if failed is None:
        return ""
    pair = " on ".join(facts.pair)
    return f"{pair} launched at {failed.launch.speed:.3g} m/s has no e: {failed.reason}"


def _judged(
    model: ModelUnderTest, request: Request, before: Sequence[Impact], wanted: RestitutionCurve
) -> list[Impact]:
    """Impacts that no search saw: evenly over the band and the step, then ever nearer to the worst.

    model: opened for the pair.
    request: its speeds span the band.
    wanted: the target, by which the worst are known.
    before: impacts of the same setting, one of which may be the worst.
    """
    low = min(request.speeds)
    high = max(request.speeds)
    # Of the band, in logarithms: 0 for a band of one speed.
    width = math.log(high / low)

    def launched(shares: Floats, phases: Floats) -> list[Impact]:
        """Impacts at shares of the band's logarithm, cut at 0 and 1, and at phases, modulo 1."""
        speeds = low * np.exp(width * np.clip(shares, 0.0, 1.0))
        places = zip(speeds.tolist(), (phases % 1.0).tolist(), strict=True)
        return impacts_in(model, [Launch(v, phase, request.height) for v, phase in places])

    even = np.arange(1, _EVEN_LAUNCHES + 1)[:, None] * np.array(_EVEN_SHARES) % 1.0
    impacts = launched(even[:, 0], even[:, 1])
    random = np.random.default_rng(_SEED)
    for closer in range(_ROUNDS):
        by_error = sorted([*before, *impacts], key=lambda impact: _error([impact], wanted))
        worst = [impact.launch for impact in by_error[-_WORST:]]
        reach = _NEARBY / 4.0**closer
        # Random steps away from each of the worst, in the band and in the phase.
        along_band, along_step = reach * random.uniform(-1.0, 1.0, (2, _NEAR_LAUNCHES, len(worst)))
        shares = [0.0] * len(worst)
        if width:
            shares = [math.log(launch.speed / low) / width for launch in worst]
        phases = [launch.phase for launch in worst]
        impacts += launched((shares + along_band).ravel(), (phases + along_step).ravel())
    return impacts


def _error(impacts: Sequence[Impact], wanted: RestitutionCurve) -> float:
    """The largest error of e; infinite where an impact has none."""
    largest = 0.0
    for impact in impacts:
        error = abs(impact.restitution - float(wanted.at(impact.speed_in)))
        if math.isnan(error):
            return math.inf
        largest = max(largest, error)
    return largest


def _about_worst(at: dict[float, list[Impact]], wanted: RestitutionCurve) -> list[float]:
    """Speeds half-way from the one with the largest error to its neighbours, m/s."""
    speeds = sorted(at)
    worst = max(range(len(speeds)), key=lambda i: _error(at[speeds[i]], wanted))
    near = speeds[max(0, worst - 1) : worst + 2]
    return [math.sqrt(a * b) for a, b in pairwise(near)]


def snippet(setting: Setting, form: str) -> str:
    """Return the text of a setting to paste; "" if nothing is set. Options of an unknown engine
    come as JSON.

    form: the scene's, "plane" or "cup".
    """
    if registry.base_name(setting.engine) not in registry.names():
        return setting.options_text
    return registry.engine(setting.engine).snippet(setting, form)
