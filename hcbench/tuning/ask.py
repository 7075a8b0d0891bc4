"""`hcbench.tune`: a user's question, in text with units or SI numbers, to the one answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hcbench import units
from hcbench._arguments import checked
from hcbench.errors import UserError
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import Reading
from hcbench.measuring.request import read_pair
from hcbench.recipes.band import default_band
from hcbench.recipes.search import report_progress
from hcbench.recipes.target import Target
from hcbench.scene import load_scene
from hcbench.setting import PAIR, Pair
from hcbench.tuning.answer import KINDS, MAX_ERROR, Answer, Kind
from hcbench.tuning.choose import Match
from hcbench.tuning.find import find_answer

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.laws.penalty import AdamsImpact, NewtonSpring
    from hcbench.scene import Scene

    Points = Sequence[tuple[float, float]]

_GRAVITY = 9.81  # m/s²


@checked
def tune(
    engine: str,
    *,
    timestep: Any,
    alpha: Any = None,
    restitution: Any = None,
    points: Points = (),
    pair: Sequence[str] | str = PAIR,
    kind: Kind = "settings",
    recipe: str = "auto",
    match: Match = "restitution",
    integrator: str | None = None,
    max_error: float = MAX_ERROR,
    progress: Callable[[int, int], None] | None = None,
    **target: Any,
) -> Answer:
    """What to write into an engine so that a pair of bodies bounces like a material.

    engine: one that `hcbench engines` lists. timestep: "2 ms" or s.
    alpha: of the law's e, "0.3 s/m" or s/m; or restitution: one e for all speeds; or points: (v m/s, e).
    pair: what the two bodies are called in your model, the body that moves first. kind: "exact" (a plug-in),
    "settings" (numbers of the engine's own) or "constant" (one e for all speeds). max_error: of e.
    target: adams, newton, speeds, gravity, friction, scene, mass, stiffness, exponent, corners, reading, as
    `make_target`.
    Returns an `Answer`: `.best.text` is what to paste, `.best.max_error` its largest error of e over
    `.best.speeds`. Raises UserError for a question that cannot be answered.

    """
    if kind not in KINDS:
        raise UserError("kind", repr(kind), f"one of: {', '.join(KINDS)}")
    scene, wanted = make_target(
        timestep=timestep, alpha=alpha, restitution=restitution, points=points, **target
    )
    with report_progress(progress):
        return find_answer(engine, wanted, scene, recipe, match, integrator, max_error, names_of(pair), kind)


def names_of(pair: Sequence[str] | str | None) -> Pair:
    """The two names, the body that moves first; the scene's for None."""
    names = read_pair(pair)
    return PAIR if names is None else names


def _pairs(points: Any) -> tuple[tuple[float, float], ...]:
    """Pairs of v and e as floats."""
    try:
        return tuple((float(v), float(e)) for v, e in points)
    except (TypeError, ValueError, OverflowError):
        raise UserError("points", f"{points!r:.80}", "pairs of v in m/s and e") from None


def make_target(
    *,
    timestep: Any,
    alpha: Any = None,
    restitution: Any = None,
    points: Points = (),
    adams: AdamsImpact | None = None,
    newton: NewtonSpring | None = None,
    speeds: Any = None,
    reading: Reading = "law",
    scene: str = "steel-plane",
    mass: Any = None,
    stiffness: Any = None,
    exponent: float | None = None,
    gravity: Any = None,
    friction: float = 0.0,
    corners: int = 1,
) -> tuple[Scene, Target]:
    """The scene and the target of a question; SI numbers or text with units.

    adams, newton: a contact by stiffness and damping, in place of an e. speeds: the band of impact
    speeds, by default the paper's as far as the step can bounce. mass, stiffness,
    exponent: the scene's by default. gravity: into the plate, 9.81 m/s² by default.
    """
    points = _pairs(points)
    ways = {"alpha": alpha, "restitution": restitution, "points": points or None}
    ways |= {"adams": adams, "newton": newton}
    given = [f"--{name}" for name, value in ways.items() if value is not None]
    if len(given) != 1:
        raise UserError(
            "target", " and ".join(given) or "none", f"one of {', '.join(f'--{name}' for name in ways)}"
        )
    setting = load_scene(scene)
    n = setting.exponent if exponent is None else exponent
    if stiffness is None and n != setting.exponent:
        raise UserError("--stiffness", f"missing for exponent {n:g}", f"k in N/m^{n:g}")
    k = setting.stiffness if stiffness is None else units.parse(stiffness, "stiffness", "--stiffness", n)
    step = units.parse(timestep, "timestep", "timestep", above=0)
    g = _GRAVITY if gravity is None else units.parse(gravity, "acceleration", "gravity")
    band: Sequence[float]
    if speeds is not None:
        band = units.parse_values(speeds, "speed", "speeds", above=0).tolist()
    elif len(points) > 1:  # outside their band e is not known
        band = [v for v, _ in points]
    else:
        band = default_band(step, g)
    low, high = min(band), max(band)
    weight = setting.mass if mass is None else units.parse(mass, "mass", "mass")
    if adams is not None:
        points = adams.points(weight, low, high)
    elif newton is not None:
        restitution = newton.restitution(weight)
    if restitution is not None:
        points = ((low, units.parse(restitution, "number", "restitution")),)
    law = HuntCrossley(k, 0.0 if alpha is None else units.parse(alpha, "alpha", "alpha"), n)
    as_read = "points" if points else reading
    return setting, Target(law, weight, step, low, high, as_read, tuple(points), g, friction, corners)
