"""`hcbench.tune`: a user's question, in text with units or SI numbers, to the one answer."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from hcbench import units
from hcbench._arguments import checked
from hcbench._outputs import write_output
from hcbench._text import sanitized
from hcbench.errors import UserError
from hcbench.launch_options import LaunchOptions
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import Reading
from hcbench.laws.spring_text import read_adams, read_newton
from hcbench.measuring.measurement import Wanted, read_points
from hcbench.measuring.request import make_request, read_limit, read_pair
from hcbench.recipes.band import default_band
from hcbench.recipes.search import report_progress
from hcbench.recipes.target import Target
from hcbench.scene import load_scene
from hcbench.setting import PAIR, Pair
from hcbench.sim import registry
from hcbench.sim.model_under_test import DEFAULT_SPEEDS, Output
from hcbench.tuning.answer import KINDS, MAX_ERROR, Answer, Kind
from hcbench.tuning.choose import Match
from hcbench.tuning.find import find_answer
from hcbench.tuning.model import LIMIT_S, tune_model
from hcbench.tuning.tuned_model import TunedModel

if TYPE_CHECKING:
    from hcbench.laws.penalty import AdamsImpact, NewtonSpring
    from hcbench.scene import Scene

    Points = Sequence[tuple[float, float]]

_GRAVITY = 9.81  # m/s²
_VERSION = re.compile(r"[a-z-]+@(\d+(?:\.\d+)*)")


def tune(
    model: Any,
    pair: Any = None,
    *,
    alpha: Any = None,
    restitution: Any = None,
    points: Points = (),
    target: Reading = "law",
    timestep: Any = None,
    speeds: Any = None,
    gravity: Any = None,
    max_error: float = MAX_ERROR,
    **options: Any,
) -> Any:
    """Find settings that bounce like your material, as `hcbench tune` does.

    Parameters
    ----------
    model : text, path or object
        The name of an engine (`hcbench engines` lists them), tuned in a scene; or your own model, as
        `measure` takes it, whose pairs are tuned in it.
    pair : text or two names
        What the two bodies are called, first the one that moves. Of a model: one pair, or a list of "a,b".
    alpha, restitution, points : optional
        One target: α, s/m or with a unit; one e for all speeds; or pairs of impact speed, m/s, and e.
    target : {"law", "linear"}
        Read α as the law's e(v), or as e = 1 - α v.
    timestep : float, text or quantity of Pint's
        Time step, s or with a unit; a model has its own.
    speeds : float, text, quantity of Pint's, or several, optional
        Band of impact speeds, m/s or with a unit.
    gravity : float, text or quantity of Pint's, optional
        Into the plate, m/s² or with a unit; 9.81 by default, or the model's own.
    max_error : float
        Of e, within which the simplest setting will do.
    **options
        Of an engine: kind ("settings", "exact" for a plug-in, "constant" for one e at all speeds), recipe,
        match, integrator, friction, corners, scene, mass, stiffness, exponent, progress.
        Of both: adams, newton, a contact by stiffness and damping in place of an e.
        Of a model: engine, limit, write_model, write_include, version, force, and key, qpos, state,
        coming_from and actuators as `LaunchOptions` describes them.

    Returns
    -------
    Answer or TunedModel
        `text` is what to paste; `max_error` is the largest error of e that was measured over the band.

    Raises
    ------
    UserError
        For a question that cannot be answered, in the argument's name.
    EngineMissing, EngineFailed
        For an engine that is not installed, or that fails.

    Examples
    --------
    >>> import hcbench as hb
    >>> answer = hb.tune("mujoco", alpha="0.3 s/m", timestep="2 ms", kind="exact")
    >>> answer.best.within
    'e within 1e-7 from 0.0314 to 0.508 m/s'
    >>> "plugin" in answer.text
    True

    """
    given: dict[str, Any] = {"alpha": alpha, "restitution": restitution, "points": points, **options}
    given |= {"timestep": timestep, "speeds": speeds, "gravity": gravity, "max_error": max_error}
    own, other = (tune_pairs, _of_engine) if is_model(model) else (_of_engine, tune_pairs)
    for name in options:
        if name not in _keywords(own):
            expected = "an engine's name" if own is tune_pairs else "a model"
            expected = f"{expected}, to which it applies" if name in _keywords(other) else "a keyword of tune"
            raise UserError(name, f"given with {sanitized(model)!r}", expected)
    return own(model, pair, reading=target, **given)


def is_model(model: Any) -> bool:
    """Say whether the argument is a model (a file, FILE.py:FUNCTION, text, an object), not an
    engine's name.
    """
    if not isinstance(model, str):
        return True
    if registry.base_name(model) in registry.names():  # whose version may look like a suffix
        return False
    return ".py:" in model or "<" in model or Path(model).suffix != "" or Path(model).is_file()


def _keywords(function: Callable[..., Any]) -> set[str]:
    """The keywords that a form of `tune` takes."""
    own = {name for name, each in signature(function).parameters.items() if each.kind is each.KEYWORD_ONLY}
    return own | (_keywords(make_target) if function is _of_engine else set(get_type_hints(LaunchOptions)))


@checked
def _of_engine(
    engine: str,
    pair: Any,
    *,
    timestep: Any,
    kind: Kind = "settings",
    recipe: str = "auto",
    match: Match = "restitution",
    integrator: str | None = None,
    max_error: float = MAX_ERROR,
    progress: Callable[[int, int], None] | None = None,
    **target: Any,
) -> Answer:
    registry.engine(engine)  # which refuses an unknown name, before anything else is missed
    if timestep is None:
        raise UserError("timestep", "missing", "the engine's step, such as '1 ms'")
    if kind not in KINDS:
        raise UserError("kind", repr(kind), f"one of: {', '.join(KINDS)}")
    scene, wanted = make_target(timestep=timestep, **target)
    with report_progress(progress):
        return find_answer(engine, wanted, scene, recipe, match, integrator, max_error, names_of(pair), kind)


def tune_pairs(
    model: Any,
    pair: Any,
    *,
    alpha: Any,
    restitution: Any,
    points: Points,
    reading: Reading,
    speeds: Any,
    max_error: float,
    adams: AdamsImpact | None = None,
    newton: NewtonSpring | None = None,
    engine: str | None = None,
    limit: Any = None,
    write_model: str | Path | None = None,
    write_include: str | Path | None = None,
    version: str | None = None,
    force: bool = False,
    **launch: Any,
) -> TunedModel:
    """`tune` of a model: its pairs, tuned in it. The files are written where the setting gains."""
    several = isinstance(pair, list | tuple) and (len(pair) != 2 or any("," in str(name) for name in pair))
    pairs = pair if several else [pair]
    if pair is None or not pairs:
        advice = f"`hcbench pairs {sanitized(model)}` lists them"
        raise UserError("pair", "missing", "two bodies or geoms", advice)
    spring = _spring(alpha=alpha, restitution=restitution, points=points or None, adams=adams, newton=newton)
    wanted = spring or Wanted(alpha, restitution, points, reading)
    band = [v for v, _ in read_points(points)] if len(points) > 1 else list(DEFAULT_SPEEDS)
    if speeds is not None:
        band = units.parse_values(speeds, "speed", "speeds", above=0).tolist()
    requests = [make_request(each, speeds=sorted({min(band), max(band)}), **launch) for each in pairs]
    if len({frozenset(request.pair or ()) for request in requests}) < len(requests):
        raise UserError("pair", " and ".join(map(str, pairs)), "each pair once")
    files = {"write-model": write_model, "write-include": write_include}
    outputs = {f"--{name}": Path(file) for name, file in files.items() if file is not None}
    output = _output(outputs.get("--write-model"), outputs.get("--write-include"), version)
    seconds = read_limit(limit) or LIMIT_S
    tuned = tune_model(model, requests, wanted, engine, max_error, seconds, output)
    if tuned.gains:
        texts = {"--write-model": tuned.written, "--write-include": tuned.texts.include}
        for option, path in outputs.items():
            if not texts[option]:
                of = tuned.pairs[0].facts.engine
                raise UserError(option, f"a model of {of}", "a model that is one file")
            write_output(path, texts[option], option, force)
    return tuned


def _output(model: Path | None, include: Path | None, version: str | None) -> Output:
    match = _VERSION.fullmatch(version) if version else None
    if version and match is None:
        raise UserError("for", repr(version), "an engine and its version, as ENGINE@3.5")
    numbers = tuple(int(part) for part in match[1].split(".")) if match else ()
    folder = None if model is None else model.absolute().parent
    name = "" if include is None else os.path.relpath(include.absolute(), folder or include.absolute().parent)
    return Output(folder, name, numbers)


def names_of(pair: Sequence[str] | str | None) -> Pair:
    """The two names, the body that moves first; the scene's for None."""
    names = read_pair(pair)
    return PAIR if names is None else names


def _spring(**ways: Any) -> AdamsImpact | NewtonSpring | None:
    """The contact by stiffness and damping, if that is the one target given. Raises UserError for others."""
    given = [f"--{name}" for name, value in ways.items() if value is not None]
    if len(given) != 1:
        names = ", ".join(f"--{name}" for name in ways)
        raise UserError("target", " and ".join(given) or "none", f"one of {names}")
    if ways["adams"] is not None:
        return read_adams(ways["adams"])
    return None if ways["newton"] is None else read_newton(ways["newton"])


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
    points = read_points(points)
    spring = _spring(alpha=alpha, restitution=restitution, points=points or None, adams=adams, newton=newton)
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
    if spring is not None:
        points = spring.points(weight, low, high)
    if restitution is not None:
        points = ((low, units.parse(restitution, "number", "restitution")),)
    law = HuntCrossley(k, 0.0 if alpha is None else units.parse_uncertain(alpha, "alpha", "alpha")[0], n)
    as_read = "points" if points else reading
    return setting, Target(law, weight, step, low, high, as_read, tuple(points), g, friction, corners)
