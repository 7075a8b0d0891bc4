"""How good a setting is, by the engine itself, at speeds and phases that no recipe has used."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench import scoring
from hcbench.impact import Floats, Impact, Launch
from hcbench.tune.constant import minimax_constant
from hcbench.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.sim.engine import Engine
    from hcbench.tune.target import Target

HELD_OUT = 13  # speeds
PHASES = 8
_GOLDEN = (math.sqrt(5) - 1) / 2
_REST_STEPS_MIN, _REST_STEPS_MAX = 200, 400_000
# A body rests that creeps slower (m/s), lies less deep (of R), and vibrates less (m/s) or less than before.
_CREEP_MAX, _DEPTH_MAX, _VIBRATION_MAX, _DECAY_MAX = 1e-5, 1e-3, 1e-4, 0.95


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What the engine did with a setting.

    max_error: largest |e - target|; at_speed: where, m/s. constant, constant_error: the best constant e.
    steps_min, steps_max: steps in contact. penetration_max: m. force_max: N.
    loop_rms: distance of the loops from the law's over its largest force; NaN where no loop is resolved.
    failed: impacts that gave no restitution, with the first reason.
    """

    max_error: float
    at_speed: float
    constant: float
    constant_error: float
    phase_spread: float
    steps_min: int
    steps_max: int
    penetration_max: float
    force_max: float
    loop_rms: float
    failed: int
    reason: str


@dataclass(frozen=True, slots=True)
class RestResult:
    """A body let down on the plate under gravity, over the last quarter of the time simulated.

    creep: m/s, > 0 sinks. depth: m. buzz: rms rate about the creep, m/s. decay: buzz over that of the quarter
    before. The law itself damps small motion about rest by exp(-(3/4) α g t) only: seconds, for steel.
    """

    rests: bool
    creep: float
    depth: float
    buzz: float
    decay: float


def held_out_speeds(target: Target, count: int = HELD_OUT) -> Floats:
    """Both ends of the band and the golden-ratio points between: shape (count,), m/s."""
    inside = np.sort((np.arange(1, count - 1) * _GOLDEN) % 1.0)
    shares = np.concatenate([[0.0], inside, [1.0]])
    return target.speed_min + (target.speed_max - target.speed_min) * shares


def evaluate(engine: Engine, scene: Scene, setting: Setting, target: Target) -> Evaluation:
    """Launch at held-out speeds, each at 8 phases of the step, and compare with the target."""
    # Phases off any grid that a search or a study uses.
    phases = (np.arange(PHASES) + _GOLDEN) / PHASES
    launches = [Launch(float(v), float(p)) for v in held_out_speeds(target) for p in phases]
    return evaluate_impacts(engine.run(scene, setting, launches), target)


def evaluate_impacts(impacts: Sequence[Impact], target: Target) -> Evaluation:
    """Compare impacts with the target."""
    good = [i for i in impacts if i.is_measured]
    failed = [i for i in impacts if not i.is_measured]
    speed = np.array([i.speed_in for i in good])
    error = np.abs(np.array([i.restitution for i in good]) - target.restitution(speed))
    constant, constant_error = minimax_constant(target)
    one_phase = [i for i in good if i.launch.phase == impacts[0].launch.phase]
    loops = [scoring.score_loop(i, target.law, target.mass) for i in one_phase]
    return Evaluation(
        max_error=float(error.max()) if good else math.nan,
        at_speed=float(speed[error.argmax()]) if good else math.nan,
        constant=constant,
        constant_error=constant_error,
        phase_spread=scoring.phase_spread(good),
        steps_min=min((i.samples for i in good), default=0),
        steps_max=max((i.samples for i in good), default=0),
        penetration_max=max((i.penetration_max for i in good), default=math.nan),
        force_max=max((i.force_max for i in good), default=math.nan),
        loop_rms=max((score.rms for score in loops if score is not None), default=math.nan),
        failed=len(failed),
        reason=failed[0].reason if failed else "",
    )


def rest_test(engine: Engine, scene: Scene, setting: Setting, seconds: float = 2.0) -> RestResult:
    """Let the body down on the plate under gravity, from next to no height, and see whether it stays.

    It rests when it sinks slower than 1e-5 m/s, is less than 1e-3 R deep, and its buzz is below 1e-4 m/s or
    dying away.
    """
    steps = min(max(seconds / setting.timestep, _REST_STEPS_MIN), _REST_STEPS_MAX)
    heavy = replace(scene, gravity=STANDARD_GRAVITY)
    path = engine.trajectory(heavy, setting, Launch(0.0, height=1e-9), steps * setting.timestep)
    quarter = len(path.time) // 4
    before, last = slice(2 * quarter, 3 * quarter), slice(3 * quarter, None)
    time, x, v = path.time[last], path.penetration[last], path.rate[last]
    if not np.isfinite(path.penetration).all():
        return RestResult(False, math.nan, math.nan, math.nan, math.nan)
    creep = float((x[-1] - x[0]) / (time[-1] - time[0]))
    buzz, earlier = (float(np.sqrt(np.mean((rate - creep) ** 2))) for rate in (v, path.rate[before]))
    decay = buzz / earlier if earlier > 0 else 0.0
    depth = float(x.max())
    result = RestResult(True, creep, depth, buzz, decay)
    return replace(result, rests=not rest_failures(result, scene.relative_radius))


def rest_failures(rest: RestResult, radius: float) -> list[str]:
    """What keeps a body from resting as it should, in words; none where it rests. radius: R, m."""
    if math.isnan(rest.depth):
        return ["it diverges"]
    failures = []
    if not abs(rest.creep) < _CREEP_MAX:
        verb = "sinks" if rest.creep > 0 else "rises"
        failures.append(f"it still {verb} at {abs(rest.creep):.1e} m/s when the test ends")
    if not rest.depth < _DEPTH_MAX * radius:
        share = 100 * rest.depth / radius
        failures.append(f"it rests {rest.depth:.1e} m deep, {share:.2g} % of the radius")
    if not (rest.buzz < _VIBRATION_MAX or rest.decay < _DECAY_MAX):
        failures.append(f"it keeps on moving at {rest.buzz:.1e} m/s (rms)")
    return failures
