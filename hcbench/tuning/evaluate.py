"""Evaluation of a setting: run by the engine itself at speeds and phases that no recipe has used."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from hcbench import scoring
from hcbench.laws import closed_form
from hcbench.laws.coulomb import friction_impulse
from hcbench.recipes.target import Target, minimax_constant
from hcbench.sim import registry
from hcbench.sim.engine import Engine, SteppedEngine
from hcbench.sim.remote import adapter_of
from hcbench.sim.rest import Rest, last_half, rest_of
from hcbench.sim.scripted import ScriptedEngine
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Floats, Impact, Launch
from hcbench.terms.scene import Scene
from hcbench.terms.setting import Setting
from hcbench.terms.units import STANDARD_GRAVITY

# Speeds and phases of the grid of launches that shows how e varies with the phase.
_SPEEDS = 9
_PHASES = 8
# Launches at random.
_RANDOM = 400
# Phases of touches just after a step's start and just before its end.
_STEP_ENDS = (0.001, 0.999)
# Launches about the worst one in each of _ROUNDS rounds.
_NEAR = 24
_ROUNDS = 3
# Distance of those launches from the worst one, as a share of the band and of a step.
_NEARBY = 0.02
_SEED = 1609
_GOLDEN = (math.sqrt(5) - 1) / 2
# Bounds of the steps of a test at rest.
_REST_STEPS_MIN = 200
_REST_STEPS_MAX = 400_000
# s: after this time a swing that the law damps at steel's α or more has visibly died.
_REST_CONTROLLED = 0.4
# A contact deeper than so many times v h, at the highest speed, is deep.
DEEPEST_STEPS = 2.5
# A contact is also allowed this multiple of the law's own depth.
_AS_LAW = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """Errors and extremes of a setting, run in the target's conditions: gravity, friction.

    max_error: largest |e - target|, at random launches and about the worst of them.
    at_speed: where, m/s.
    constant, constant_error: the best constant e.
    launches: how many.
    steps_min, steps_max: steps in contact.
    penetration_max: m.
    force_max: N.
    deep: whether that is deeper than the step and the law ask for.
    friction_error: largest error of the impulse of friction, over μ times the normal impulse; NaN
    without.
    phase_spread: largest difference in e between phases of one speed; NaN where a phase has no e.
    loop_rms: distance of the loops from the law's over its largest force; NaN where no loop is
    resolved.
    failed: impacts that gave no restitution, with the first reason.
    max_e: the largest e of all.
    mean_error: mean of e - target, which says on which side of the target a setting lies.
    below: share of the launches whose e lies below the target.
    """

    max_error: float = math.nan
    at_speed: float = math.nan
    constant: float
    constant_error: float
    phase_spread: float
    steps_min: int = 0
    steps_max: int = 0
    penetration_max: float = math.nan
    force_max: float = math.nan
    loop_rms: float
    failed: int
    reason: str
    launches: int
    friction_error: float
    deep: bool = False
    max_e: float = math.nan
    mean_error: float = math.nan
    below: float = math.nan


# Each setting of an answer is tried by the same launches.
@lru_cache(maxsize=2)
def held_out_launches(target: Target) -> Sequence[Launch]:
    """Launches that judge a setting: 9 speeds, each at 8 phases of the step, then 400 at random.

    A phase is where in a step the body touches, 0 to 1. Speeds are those at touch, both ends of
    the band among them; with friction, random launches slip up to the band's highest speed. One
    target always has the same launches.
    Raises SettingError for a band that begins at a speed that gravity gives within half a step.
    """
    # Multiples of the golden ratio, modulo 1, are spread evenly, and no search has just these.
    inside = np.sort((np.arange(1, _SPEEDS - 1) * _GOLDEN) % 1.0)
    speeds_of_grid = target.speed_min + _width(target) * np.concatenate([[0.0], inside, [1.0]])
    phases_of_grid = (np.arange(_PHASES) + _GOLDEN) / _PHASES
    # Each speed at each phase, phases of one speed after another.
    grid_speeds = np.repeat(speeds_of_grid, _PHASES)
    grid_phases = np.tile(phases_of_grid, _SPEEDS)
    random = np.random.default_rng(_SEED)
    shares = random.uniform(size=_RANDOM)
    # Squares crowd towards the low end: slow impacts are the hard ones.
    shares[::2] **= 2
    random_speeds = target.speed_min + _width(target) * shares
    random_phases = random.uniform(0.001, 0.999, _RANDOM)
    random_slips = random.uniform(size=_RANDOM) * target.speed_max
    return tuple(
        _launches(
            target,
            speeds=np.concatenate([grid_speeds, random_speeds]),
            phases=np.concatenate([grid_phases, random_phases]),
            slips=np.concatenate([np.zeros(grid_speeds.size), random_slips]),
        )
    )


def corner_launches(target: Target) -> list[Launch]:
    """Four launches: at the lowest and the highest speed of the band, touching at the start and at
    the end of a step.

    Over the phase e is a sawtooth, over the speed it is furthest off at an end: few launches at
    random come near such a corner.
    Raises SettingError for a band that begins at a speed that gravity gives within half a step.
    """
    speeds = np.repeat([target.speed_min, target.speed_max], len(_STEP_ENDS))
    return _launches(target, speeds, np.tile(_STEP_ENDS, 2), np.zeros(speeds.size))


def _width(target: Target) -> float:
    return target.speed_max - target.speed_min


def _launches(target: Target, speeds: Floats, phases: Floats, slips: Floats) -> list[Launch]:
    """Launches that touch at given speeds and phases, n of them.

    speeds: at touch, m/s, shape (n,).
    phases: where in a step they touch, 0 to 1, (n,).
    slips: along the plate, m/s, (n,); 0 is taken for a target without friction.

    Raises SettingError for a band that begins at a speed that gravity alone gives in half a step:
    a body so slow is never in free fall for the whole step before it touches.
    """
    # What gravity adds in half a step, m/s.
    gained = 0.5 * target.gravity * target.timestep
    if target.speed_min <= gained:
        got = f"from {target.speed_min:.3g} m/s"
        expected = f"above {gained:.3g} m/s, which gravity adds in half a step"
        raise SettingError("speeds", got, expected, "Take a smaller step, or faster impacts")
    if not target.friction:
        slips = np.zeros_like(slips)
    launches = []
    for v, phase, slip in zip(speeds.tolist(), phases.tolist(), slips.tolist(), strict=True):
        launch = Launch.touching(v, phase, target.timestep, target.gravity, slip=(slip, 0.0))
        launches.append(launch)
    return launches


_Measure = Callable[[Sequence[Impact], Target, Scene], Floats]


def evaluate(engine: Engine, scene: Scene, setting: Setting, target: Target) -> Evaluation:
    """Run a setting at speeds and phases that no search used, then ever nearer to the worst of
    them, and compare every impact with the target.

    With friction bodies slide and spin, too: in the engine itself, or in the one whose contact it
    has. An engine without steps, or one that controls its error, gets each speed of the grid at one
    phase, and each eighth of the random launches.
    A setting that leaves a launch of the grid without an e is of no use: it is judged by the grid
    alone.

    Raises SettingError for a setting that the engine cannot have and for a band that begins at a
    speed that gravity gives within half a step; SceneError, EngineMissing and EngineFailed of the
    engine.
    """
    oblique: Setting | None = None
    if target.friction:
        oblique = engine.oblique_setting(setting)
    if oblique is None:
        # Nothing can be launched at an angle.
        target = replace(target, friction=0.0)

    def run(launches: Sequence[Launch]) -> list[Impact]:
        """Impacts of launches; those at an angle come last where another engine has them."""
        if oblique is None or oblique.engine == engine.name:
            return engine.run(scene, setting, launches)
        straight = [launch for launch in launches if not launch.is_oblique]
        others = [launch for launch in launches if launch.is_oblique]
        at_an_angle = registry.engine(oblique.engine).run(scene, oblique, others)
        return engine.run(scene, setting, straight) + at_an_angle

    launches = [*held_out_launches(target)]
    if oblique is not None and oblique.engine != engine.name:
        # Random launches with friction slide, and run in the other engine. As many straight down
        # judge the engine's own steps.
        launches += held_out_launches(replace(target, friction=0.0))[_SPEEDS * _PHASES :]
    if not isinstance(adapter_of(engine), SteppedEngine) or _error_controlled(engine, setting):
        # No phase of a step matters, and each may cost an ODE.
        return evaluate_impacts(run(launches[::_PHASES]), target, scene)
    grid = _SPEEDS * _PHASES
    impacts = run(launches[:grid])
    # Each launch that never parts takes seconds of simulated time: hundreds would say no more.
    if not all(impact.is_measured for impact in impacts):
        return evaluate_impacts(impacts, target, scene)
    others = launches[grid:]
    if target.friction:
        others += oblique_launches(target)
    impacts += run(others)
    _launch_near_worst(impacts, run, target, scene)
    impacts += run(corner_launches(target))
    return evaluate_impacts(impacts, target, scene)


def _launch_near_worst(
    impacts: list[Impact],
    run: Callable[[Sequence[Launch]], list[Impact]],
    target: Target,
    scene: Scene,
) -> None:
    """Launch ever nearer to the worst impact of all, by its error of e and, with friction, also by
    that of friction's impulse.

    impacts: those until now, one or more; the new ones are added to it.
    run: simulates launches.
    """
    random = np.random.default_rng(_SEED)
    measures: list[_Measure] = [_errors]
    if target.friction:
        measures.append(_friction_errors)
    # By each measure, the errors of the impacts until now, in their order.
    known: dict[_Measure, Floats] = dict.fromkeys(measures, np.empty(0))
    for nearer, measure in itertools.product(range(_ROUNDS), measures):
        unjudged = impacts[known[measure].size :]
        # An impact that has no such error is never the worst.
        new_errors = np.nan_to_num(measure(unjudged, target, scene), nan=-1.0)
        known[measure] = np.concatenate([known[measure], new_errors])
        worst = impacts[int(known[measure].argmax())]
        reach = _NEARBY / 4.0**nearer
        impacts += run(_near(worst, target, reach, random))


def _near(worst: Impact, target: Target, reach: float, random: np.random.Generator) -> list[Launch]:
    """Launches at random about the worst impact, within the band, with its spin.

    reach: half width of the range they are drawn from, as a share of the band, of a step and, for
    the slip, of the highest speed. About an impact without a speed: about the band's lowest speed.
    random: draws them, and so is left in another state.
    """
    speed = target.speed_min if math.isnan(worst.speed_in) else worst.speed_in
    speeds = speed + random.uniform(-1, 1, _NEAR) * reach * _width(target)
    phases = worst.launch.phase + random.uniform(-1, 1, _NEAR) * reach
    slips = worst.launch.slip[0] + random.uniform(-1, 1, _NEAR) * reach * target.speed_max
    around = _launches(
        target,
        np.clip(speeds, target.speed_min, target.speed_max),
        np.clip(phases, *_STEP_ENDS),
        np.abs(slips),
    )
    return [replace(launch, spin=worst.launch.spin) for launch in around]


def _error_controlled(engine: Engine, setting: Setting) -> bool:
    adapter = adapter_of(engine)
    return isinstance(adapter, ScriptedEngine) and adapter.error_controlled(setting)


def _friction_errors(impacts: Sequence[Impact], _: Target, scene: Scene) -> Floats:
    """Errors of friction's impulse, shape (n,); NaN where there is none."""
    return np.array([friction_error([impact], scene) for impact in impacts])


def _errors(impacts: Sequence[Impact], target: Target, _: Scene) -> Floats:
    """|e - target|, shape (n,); NaN if an impact has no e."""
    return np.abs(_signed_errors(impacts, target))


def _signed_errors(impacts: Sequence[Impact], target: Target) -> Floats:
    """e - target, shape (n,); NaN if an impact has no e."""
    speed, e = np.array([(i.speed_in, i.restitution) for i in impacts]).T
    return np.asarray(e - target.restitution(speed))


def evaluate_impacts(impacts: Sequence[Impact], target: Target, scene: Scene) -> Evaluation:
    """Errors of e, extremes of force, depth and steps, and failures of the impacts of a setting.

    impacts: those of `held_out_launches`, in their order, and any others after them.
    Where no impact has an e, errors and extremes are NaN: the evaluation tells how many failed and
    the first reason.
    """
    good = [i for i in impacts if i.is_measured]
    failed = [i for i in impacts if not i.is_measured]
    oblique = [i for i in impacts if i.launch.is_oblique]
    # The grid comes first, phases of one speed after another.
    grid = impacts[: _SPEEDS * _PHASES]
    constant, constant_error = minimax_constant(target)
    reason = ""
    if failed:
        reason = failed[0].reason
    evaluation = Evaluation(
        constant=constant,
        constant_error=constant_error,
        phase_spread=_phase_spread(grid),
        loop_rms=_loop_rms(grid[::_PHASES], target),
        failed=len(failed),
        reason=reason,
        launches=len(impacts),
        friction_error=friction_error(oblique, scene),
    )
    if not good:
        return evaluation
    signed = np.nan_to_num(_signed_errors(good, target))
    error = np.abs(signed)
    worst = int(error.argmax())
    samples = [impact.samples for impact in good]
    deepest = max(impact.penetration_max for impact in good)
    law_depth = float(closed_form.penetration_max(target.law, target.mass, target.speed_max))
    allowed_depth = max(DEEPEST_STEPS * target.speed_max * target.timestep, _AS_LAW * law_depth)
    return replace(
        evaluation,
        max_error=float(error[worst]),
        at_speed=good[worst].speed_in,
        steps_min=min(samples),
        steps_max=max(samples),
        penetration_max=deepest,
        force_max=max(impact.force_max for impact in good),
        max_e=max(impact.restitution for impact in good),
        deep=deepest > allowed_depth,
        mean_error=float(signed.mean()),
        below=float((signed < 0.0).mean()),
    )


def _phase_spread(grid: Sequence[Impact]) -> float:
    """Largest difference in e between phases of one speed; NaN where the grid is not complete."""
    if len(grid) < _SPEEDS * _PHASES:
        return math.nan
    e = np.array([impact.restitution for impact in grid]).reshape(_SPEEDS, _PHASES)
    return float(np.ptp(e, axis=1).max())


def _loop_rms(impacts: Sequence[Impact], target: Target) -> float:
    """Largest rms difference of a force loop from the law's, over the law's largest force; NaN
    without a loop.
    """
    differences = []
    for impact in impacts:
        score = scoring.score_loop(impact, target.law, target.mass) if impact.is_measured else None
        if score is not None:
            differences.append(score.rms)
    return max(differences, default=math.nan)


def rest_test(engine: Engine, scene: Scene, setting: Setting, seconds: float = 5.0) -> Rest:
    """Drop the body on the plate from almost no height, and measure how it rests in the second half
    of the time: drift, depth and vibration.

    seconds: to simulate, within bounds on the number of steps; less for an engine that controls its
    error. The scene's gravity acts, or the standard one if it has none.
    Raises what `Engine.trajectory` raises: EngineFailed of an engine that knows single impacts
    only.
    """
    if _error_controlled(engine, setting):
        # An engine that controls its error takes thousands of steps for each swing of the spring.
        seconds = _REST_CONTROLLED
    steps = min(max(seconds / setting.timestep, _REST_STEPS_MIN), _REST_STEPS_MAX)
    with_gravity = replace(scene, gravity=scene.gravity or STANDARD_GRAVITY)
    path = engine.trajectory(
        with_gravity, setting, Launch(0.0, height=1e-9), steps * setting.timestep
    )
    return rest_of(*map(last_half, (path.time, path.penetration, path.rate, path.force)))


SPEEDS = 4
PHASES = (0.12, 0.37, 0.62, 0.87)
# (slip m/s, spin rad/s): slow to fast sliding, backspin and topspin, and
# all at once out of the plane.
MOTIONS = (
    ((0.1, 0.0), (0.0, 0.0, 0.0)),
    ((0.5, 0.0), (0.0, 0.0, 0.0)),
    ((2.0, 0.0), (0.0, 0.0, 0.0)),
    ((3.0, 0.0), (0.0, 0.0, 0.0)),
    ((0.0, 0.0), (0.0, 40.0, 0.0)),
    ((1.0, 0.0), (0.0, -40.0, 0.0)),
    ((0.7, -0.4), (25.0, 10.0, 30.0)),
)


@lru_cache(maxsize=1)
def oblique_launches(target: Target) -> Sequence[Launch]:
    """Launches that slide or spin: each of SPEEDS speeds over the target's band, at each of PHASES
    of a step, with each (slip, spin) of MOTIONS.

    The speed is that along the normal at touch, m/s.
    """
    speeds = np.geomspace(target.speed_min, target.speed_max, SPEEDS).tolist()
    launches = []
    for v, phase, (slip, spin) in itertools.product(speeds, PHASES, MOTIONS):
        launch = Launch.touching(v, phase, target.timestep, target.gravity, slip=slip)
        launches.append(replace(launch, spin=spin))
    return tuple(launches)


def friction_error(impacts: Sequence[Impact], scene: Scene) -> float:
    """Largest error of friction's impulse: its distance from that of Coulomb's law, N s, divided by
    μ J_n, the impulse of a contact that slides until its end.

    NaN where no impact counts: those without an e, without a tangential record, and without
    friction do not.
    """
    errors = []
    for impact in impacts:
        along = impact.tangential if impact.is_measured else None
        if along is None:
            continue
        # Impulse of a contact that slides until its end, N s.
        sliding = scene.friction * along.normal_impulse
        if sliding > 0.0:
            by_law = friction_impulse(along.slip_in, along.normal_impulse, scene)
            errors.append(math.dist(along.impulse, by_law) / sliding)
    return max(errors, default=math.nan)
