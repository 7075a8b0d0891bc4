"""A scene that bounces as the recording did: a tuned setting, the
recorded drop in it, and both trains.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import Restitution
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.system.errors import UserError
from hcbench.system.text import table
from hcbench.terms.impact import Launch
from hcbench.terms.scene import load_scene
from hcbench.tuning.find import tune
from hcbench.tuning.tuned import Tuned

if TYPE_CHECKING:
    from hcbench.fitting.datasets import TouchTimes
    from hcbench.fitting.which_law import FittedCurve
    from hcbench.terms.impact import Floats, Trajectory
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# Largest error of a touch's time, s, with which a train counts as replayed.
NEAR = 0.06
# Speeds at which the fitted curve is sampled for `tune`.
_POINTS = 20
# Rounds of the secant method for the scene's α.
_ROUNDS = 4
# Longest step of that search, as a share of α.
_SECANT = 0.04
_SCENE = "steel-plane"
# Places in a time step at which the first touch is tried, the one that is shown first.
_PLACES = (0.5, 0.0, 0.17, 0.33, 0.67, 0.83)
# Recipes that give the law's e at each impact, at any step.
_PLUGINS = ("restitution-law",)


@dataclass(frozen=True, slots=True)
class Replay:
    """A recorded train of bounces beside its simulation in an engine.

    recorded, simulated: (n,), times of touches in s from the first of
    them; the scene may miss some.
    others: the same of the scene as `simulated`, with the first touch elsewhere in its time step.
    tuned: what `tune` chose.
    setting: that of the scene, and alpha its α in s/m where it is another than the fit's, to
    make up for contacts that last a step. Begins with the second touch of the recording, whose
    speed the flight before it tells.
    """

    tuned: Tuned
    recorded: Floats = field(repr=False)
    simulated: Floats = field(repr=False)
    setting: Setting
    others: tuple[Floats, ...] = field(repr=False)
    alpha: float | None = None

    @property
    def error(self) -> float:
        """The largest error of a touch time, s, wherever in a step the first touch falls.

        inf where the scene has bounces missing.
        """
        return max(map(self._error_of, self._trains))

    @property
    def shown_error(self) -> float:
        """The same of the train that is shown, `simulated`."""
        return self._error_of(self.simulated)

    @property
    def lateness(self) -> float:
        """Mean lateness of the scene's touches, s, over all trains."""
        late = [np.mean(train - self.recorded[: len(train)]) for train in self._trains]
        return float(np.mean(late))

    @property
    def _trains(self) -> tuple[Floats, ...]:
        return (self.simulated, *self.others)

    def _error_of(self, train: Floats) -> float:
        if len(train) < len(self.recorded):
            return math.inf
        return float(np.abs(train - self.recorded).max())

    @property
    def e_off(self) -> float:
        """Largest difference of e between the scene's α and the fit's."""
        if self.alpha is None:
            return 0.0
        target = self.tuned.target
        v = np.linspace(target.speed_min, target.speed_max, _POINTS)
        return float(np.abs(Restitution(self.alpha).at(v) - target.restitution(v)).max())

    @property
    def script(self) -> str:
        """Return the scene in the engine's own format."""
        return registry.engine(self.setting.engine).script(self.tuned.scene, self.setting)


def replay(touches: TouchTimes, target: Target, engine: str, recipe: str = "auto") -> Replay:
    """Tune an engine to a fit, as `hcbench tune` does, and simulate the recorded drop.

    target: the fitted law, by `target_of`.
    recipe: name of one, or "auto". Where the setting that "auto" chooses is more than 60 ms off,
    the recipes with a contact plug-in are tried, and the nearest is taken.
    Raises UserError for fewer than 4 touches in a row, and what `tune` and the engine raise.
    """
    recorded = recorded_touches(touches)
    names = [recipe]
    if recipe == "auto":
        names += [name for name in registry.recipes(engine) if name in _PLUGINS]
    best: Replay | None = None
    for name in names:
        tuned = tune(engine, target, load_scene(_SCENE), name)
        shown, *others = _trains(tuned.scene, tuned.setting, touches, recorded)
        now = Replay(tuned, recorded, shown, tuned.setting, tuple(others))
        if tuned.recipe.name in _PLUGINS:
            now = _made_up(now, touches)
        if best is None or now.error < best.error:
            best = now
        if best.error <= NEAR:
            break
    assert best is not None
    return best


def _made_up(scene: Replay, touches: TouchTimes) -> Replay:
    """The scene with the α at which touches are as often early as late, by steps of the secant
    method.

    A contact of a plug-in lasts about a step, and the ball's hardly any time: at the α of the fit
    each flight begins late. A larger α shortens the flights by the same time.
    The scene itself where its target is not an α, where it has bounces missing, and where no step
    is better.
    """
    tuned = scene.tuned
    if tuned.target.reading != "law" or not math.isfinite(scene.error):
        return scene
    best = scene
    before = scene
    alpha = tuned.target.law.alpha
    step = _SECANT * alpha
    for _ in range(_ROUNDS):
        law = dataclasses.replace(tuned.target.law, alpha=alpha + step)
        setting = tuned.recipe(dataclasses.replace(tuned.target, law=law), None)
        shown, *others = _trains(tuned.scene, setting, touches, scene.recorded)
        now = Replay(
            tuned=tuned,
            recorded=scene.recorded,
            simulated=shown,
            setting=setting,
            others=tuple(others),
            alpha=law.alpha,
        )
        if now.error < best.error:
            best = now
        slope = (now.lateness - before.lateness) / step
        before, alpha = now, law.alpha
        if not slope < 0.0 or now.error == math.inf:
            break
        step = (
            float(np.clip(-now.lateness / slope, -_SECANT * alpha, _SECANT * alpha))
            or _SECANT * alpha
        )
    return best


def recorded_touches(touches: TouchTimes) -> Floats:
    """Recorded touches from the second on, up to the first that is unheard, s.

    Shape (n,), from the time of the second touch.
    Raises UserError for fewer than 4 in a row.
    """
    numbers = touches.numbers
    if numbers is None:
        numbers = np.arange(len(touches.times))
    whole = int(np.argmax(np.append(np.diff(numbers) > 1, True))) + 1
    if whole < 4:
        raise UserError("--engine", f"{whole} touches in a row", "4 or more, to compare with")
    return np.asarray(touches.times[1:whole] - touches.times[1])


def target_of(
    curve: FittedCurve,
    alpha: float | None,
    speeds: tuple[float, float],
    gravity: float,
    timestep: float,
) -> Target:
    """The target of a scene with a fitted law: its formula if it is plain eq. (16), or else points
    of its curve.

    alpha: s/m, of plain eq. (16); None for another law.
    speeds: the band, m/s.
    gravity: m/s².
    timestep: s.

    The scene keeps its own mass and stiffness.
    """
    scene = load_scene(_SCENE)
    low, high = speeds
    law = HuntCrossley(scene.stiffness, 0.0, scene.exponent)
    if alpha is not None:
        law = dataclasses.replace(law, alpha=alpha)
        return Target(law, scene.mass, timestep, low, high, gravity=gravity)
    sampled = np.linspace(low, high, _POINTS)
    points = tuple((float(v), min(1.0, curve.at(float(v)))) for v in sampled)
    return Target(
        law=law,
        mass=scene.mass,
        timestep=timestep,
        speed_min=low,
        speed_max=high,
        reading="points",
        points=points,
        gravity=gravity,
    )


def _trains(
    scene: Scene, setting: Setting, recording: TouchTimes, recorded: Floats
) -> list[Floats]:
    """Trains of touches of the scene, as `_simulated` returns them, with the first touch at several
    places in a time step: what follows depends on the place by chance.
    """
    return [_simulated(scene, setting, recording, recorded, place) for place in _PLACES]


def _simulated(
    scene: Scene, setting: Setting, recording: TouchTimes, recorded: Floats, place: float
) -> Floats:
    """Times of touches in the simulated scene, s from the first of them; at most as many as
    recorded.

    recording: its gravity and first flight tell the speed of the first simulated touch.
    recorded: times of the recorded touches from the second on, s, shape (n,). The body is dropped
    so that it touches at the speed that the first recorded flight shows.
    place: of the first touch in a time step, 0 ... 1.
    Raises what the engine raises.
    """
    gravity = recording.setup.gravity.value
    speed = 0.5 * gravity * float(recording.times[1] - recording.times[0])
    launch = Launch.dropped(speed, place, setting.timestep, gravity)
    duration = speed / gravity + float(recorded[-1]) * 1.6 + 0.1
    path = registry.engine(setting.engine).trajectory(scene, setting, launch, duration)
    touches = touches_of(path)
    if len(touches):
        touches = touches - touches[0]
    return touches[: len(recorded)]


def touches_of(path: Trajectory) -> Floats:
    """Times at which the surfaces met before each turn of the body, s.

    Shape (n,); a turn without contact before it counts at its own time. Empty for a body that never
    turns.
    """
    turns = np.flatnonzero((path.rate[:-1] > 0) & (path.rate[1:] <= 0))
    touches = []
    # The step from which the body has left the plate after the turn before.
    last = 0
    for turn in turns:
        inside = np.flatnonzero(path.penetration[last : turn + 2] > 0)
        first = 0
        if inside.size:
            first = last + int(inside[0])
        if first > 0:
            touches.append(_crossing(path, first))
        else:
            touches.append(path.time[turn])
        last = int(turn) + 1
        # Skip the rest of this contact, until the surfaces have parted.
        while last < len(path.rate) - 1 and path.penetration[last] > 0:
            last += 1
    return np.array(touches)


def _crossing(path: Trajectory, step: int) -> float:
    """Time at which the penetration passed 0 before a step, s; that of the step before if it did
    not.

    step: 1 or more.
    """
    x0 = path.penetration[step - 1]
    x1 = path.penetration[step]
    t0 = path.time[step - 1]
    t1 = path.time[step]
    share = 0.0
    if x1 > x0 and x0 < 0:
        share = float(-x0 / (x1 - x0))
    return float(t0 + share * (t1 - t0))


def replay_text(scene: Replay) -> str:
    """Both trains and the largest error, for a terminal, with advice where the scene lags or lacks
    touches.
    """
    count = len(scene.simulated)
    missing = len(scene.recorded) - len(scene.simulated)
    rows = []
    # Both begin with the second touch, at 0 s.
    both = zip(scene.recorded, scene.simulated, strict=False)
    for number, (recorded, simulated) in enumerate(both, 2):
        late = 1e3 * (simulated - recorded)
        rows.append((f"{number}", f"{recorded:.4f}", f"{simulated:.4f}", f"{late:+.1f}"))
    setting = scene.setting
    lines = [
        "",
        f"scene     {setting.engine}, {scene.tuned.recipe.name}, step {setting.timestep:g} s",
    ]
    lines += table(("touch", "recorded, s", "scene, s", "late, ms"), rows)
    span = 1e3 * float(scene.recorded[-1])
    if missing:
        lines.append(f"the scene has {count} of {count + missing} touches: its bounces die early")
    elif not math.isfinite(scene.error):
        lines.append("the scene has all touches at some places of the first touch in a step only")
    else:
        lines.append(
            f"largest error of a touch time: {1e3 * scene.shown_error:.3g} ms of {span:.0f} ms; "
            f"{1e3 * scene.error:.3g} ms wherever in a step the first touch falls"
        )
    if scene.alpha is not None:
        lines.append(
            f"α of the scene is {scene.alpha:.4g} s/m, so that contacts of about a step and flights together "
            f"last as recorded; e is wrong by {scene.e_off:.2g} at most"
        )
    if scene.error > NEAR:
        lines.append(
            "the scene lags: a contact lasts several steps; use a smaller --timestep or the contact plug-in"
        )
    return "\n".join(lines) + "\n"


def replay_record(scene: Replay) -> dict[str, Any]:
    """The scene as `--json` prints it; an error of None where the scene has too few touches."""
    error = None
    if math.isfinite(scene.error):
        error = scene.error
    return {
        "engine": scene.setting.engine,
        "recipe": scene.tuned.recipe.name,
        "timestep_s": scene.setting.timestep,
        "alpha_s_per_m": scene.alpha,
        "recorded_s": scene.recorded.tolist(),
        "simulated_s": scene.simulated.tolist(),
        "largest_error_s": error,
    }
