"""`hcbench.tune` and `hcbench.tune_model`: a question, in text with
units or SI numbers, to its answer.
"""

from __future__ import annotations

import dataclasses
import os
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from hcbench.catalogue.target import target_material
from hcbench.laws.force import HuntCrossley
from hcbench.laws.impact_law import read_adams, read_newton
from hcbench.laws.restitution import Reading, RestitutionCurve
from hcbench.measuring.measurement import Wanted, read_points
from hcbench.measuring.request import make_request, read_limit, read_pair
from hcbench.recipes.recipe import report_progress
from hcbench.recipes.target import Target, default_band
from hcbench.sim import registry
from hcbench.sim.landing import HEIGHTS
from hcbench.sim.model_under_test import DEFAULT_SPEEDS, Output
from hcbench.system.errors import UserError
from hcbench.system.outputs import require_outputs, write_output
from hcbench.system.process import NAMES_OPTIONS
from hcbench.system.text import sanitized
from hcbench.terms import units
from hcbench.terms.arguments import checked
from hcbench.terms.options import (
    BodyPair,
    Folders,
    Joints,
    LaunchOptions,
    MaterialName,
    ModelSource,
    PoseState,
    Quantities,
    Quantity,
)
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import PAIR, Pair
from hcbench.tuning.answer import MAX_ERROR, Answer, Kind
from hcbench.tuning.find import Match, find_answer
from hcbench.tuning.model import LIMIT_S, Rebound, tune_job
from hcbench.tuning.tuned_model import AS_IT_IS, TunedModel

if TYPE_CHECKING:
    from hcbench.catalogue.material import MaterialPair
    from hcbench.laws.conventions import AdamsImpact, NewtonSpring
    from hcbench.laws.impact_law import Adams, Newton
    from hcbench.terms.scene import Scene

    Points = Sequence[tuple[float, float]]

_GRAVITY = 9.81  # m/s²
# Files of a model that leave no choice of a pair.
_TWO_FILES = 2
# No version has a number of more digits, and int() takes none of more than 4300.
_VERSION = re.compile(r"([a-z0-9_-]+)@(\d{1,9}(?:\.\d{1,9})*)")


@checked
def tune(
    engine: str,
    pair: BodyPair | None = None,
    *,
    material: MaterialName | None = None,
    alpha: Quantity | None = None,
    restitution: Quantity | None = None,
    points: Points = (),
    adams: Adams | None = None,
    newton: Newton | None = None,
    target: Reading = "law",
    timestep: Quantity | None = None,
    speeds: Quantities | None = None,
    gravity: Quantity | None = None,
    max_error: float = MAX_ERROR,
    kind: Kind | None = None,
    recipe: str = "auto",
    match: Match = "restitution",
    integrator: str | None = None,
    scene: str = "steel-plane",
    mass: Quantity | None = None,
    stiffness: Quantity | None = None,
    exponent: float | None = None,
    friction: float | None = None,
    corners: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Answer:
    """Find settings of an engine that bounce like your material, as `hcbench tune ENGINE` does.

    Parameters
    ----------
    engine : text
        The name of an engine (`hcbench engines` lists them). `tune_model` tunes pairs in your own model.
    pair : text or two names, optional
        What the two bodies are called in the text to paste, first the one that moves.
    material, alpha, restitution, points : optional
        One target: a pair of materials that `materials` lists; α, s/m or with a unit; one e for all
        speeds; or pairs of impact speed, m/s, and e.
    adams, newton : text, optional
        A contact by stiffness and damping, in place of an e: "k, e, cmax, d" of Adams' IMPACT, or
        "SOLVER, ke, kd" of Newton.
    target : {"law", "linear"}
        Read α as the law's e(v), or as e = 1 - α v.
    timestep : float, text or quantity of Pint's
        Time step, s or with a unit.
    speeds : float, text, quantity of Pint's, or several, optional
        Band of impact speeds, m/s or with a unit; the paper's by default, as far as the step can bounce.
    gravity : float, text or quantity of Pint's, optional
        Into the plate, m/s² or with a unit; 9.81 by default.
    max_error : float
        Of e, within which the simplest setting will do.
    kind : {"exact", "settings", "constant"}, optional
        The exact plug-in, settings of the engine's own, or the best one e for all speeds; by default the
        first of these that the engine has.
    recipe, match, integrator : text, optional
        The name of a recipe; what the choice aims at ("restitution", "loop" or "both"); an integrator such
        as "RK4", where the engine has several.
    scene : text
        The name or folder of the scene in which settings are tried.
    mass, stiffness, exponent : optional
        Effective mass, kg, and k, N/mⁿ, and n of the law; the scene's by default.
    friction : float, optional
        Coulomb's μ, 0 for none; by default the engine's own for two bodies.
    corners : int, optional
        Contact points that land together: 1 for a ball, 4 for the face of a box. By default the best choice
        is one with which neither balls nor boxes and capsules gain energy, where there is one.
    progress : function of two integers, optional
        It is called with how many evaluations are done, and how many there are at most.

    Returns
    -------
    Answer
        `text` is what to paste; `max_error` is the largest error of e that was measured over the band;
        `choices` are all settings that will do, `never` those that will not, with the reasons.

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
    if is_model(engine):
        raise UserError(
            "engine", f"{sanitized(engine)!r}, a model", "an engine's name", "Use `tune_model`"
        )
    # Refuses an unknown name before the missing time step is reported.
    registry.engine(engine)
    if timestep is None:
        raise UserError("timestep", "missing", "the engine's step, such as '1 ms'")
    tried_scene, wanted = make_target(
        material=material,
        alpha=alpha,
        restitution=restitution,
        points=points,
        adams=adams,
        newton=newton,
        reading=target,
        timestep=timestep,
        speeds=speeds,
        gravity=gravity,
        scene=scene,
        mass=mass,
        stiffness=stiffness,
        exponent=exponent,
        friction=friction,
        default_friction=registry.engine(engine).default_friction,
        corners=corners,
    )
    names = names_of(pair)
    max_error = units.parse_max_error(max_error)
    with report_progress(progress):
        return find_answer(
            engine, wanted, tried_scene, recipe, match, integrator, max_error, names, kind
        )


@checked
def tune_model(
    model: ModelSource,
    pair: BodyPair | Sequence[BodyPair] | None = None,
    *,
    material: MaterialName | None = None,
    alpha: Quantity | None = None,
    restitution: Quantity | None = None,
    points: Points = (),
    adams: Adams | None = None,
    newton: Newton | None = None,
    rebound: Quantity | None = None,
    target: Reading = "law",
    speeds: Quantities | None = None,
    max_error: float = MAX_ERROR,
    engine: str | None = None,
    limit: Quantity | None = None,
    timestep: Quantity | None = None,
    gravity: Quantities | None = None,
    key: str | None = None,
    qpos: Joints | None = None,
    state: PoseState | None = None,
    package: Folders | None = None,
    move: str | None = None,
    coming_from: str | Sequence[float | str] | None = None,
    actuators: bool | None = None,
    version: str | None = None,
    write_model: str | Path | None = None,
    write_include: str | Path | None = None,
    force: bool = False,
) -> TunedModel:
    """Find a setting with which pairs of your own model bounce like your
    material, as `hcbench tune MODEL`.

    Parameters
    ----------
    model : path, text or object
        Your model, as `measure` takes it; its pairs are tuned in it.
    pair : text or two names, or several
        Two bodies or geoms, first the one that moves; or a list of pairs such as "foot,floor". Needless for
        a model of two files.
    material, alpha, restitution, points, adams, newton, target : optional
        One target, as `tune` takes it.
    rebound : float, text or quantity of Pint's, optional
        Target of a robot in place of an e of its feet, m or with a unit: how high its centre of mass
        rebounds from a drop of 10 cm in its pose. `pair` names its feet with the floor.
    speeds : float, text, quantity of Pint's, or several, optional
        Band of impact speeds, m/s or with a unit; 0.1 to 2 m/s by default.
    max_error : float
        Of e, within which the simplest setting will do.
    engine, limit, timestep, gravity, key, qpos, state, package, move, coming_from, actuators : optional
        As `measure` takes them.
    version : text, optional
        "ENGINE@3.5": the version that has to load what is written; the installed one by default.
    write_model, write_include : path, optional
        Files for the model with the setting in it, and for the lines that a model includes. They are written
        where the setting gains; else nothing is written, a warning says so, and `files` is empty. An input
        is never replaced.
    force : bool
        Replace files that hcbench did not write.

    Returns
    -------
    TunedModel
        `text` is what to paste; `max_error` is the largest error of e that was measured over the band;
        `gains` says whether e came nearer to the target, and a robot lands no worse; `landing` has
        the robot's landing before and after; `files` are those that were written.

    Raises
    ------
    UserError
        For a pair that cannot be tuned, and for a file that cannot be written, in the argument's name.
    OutputError
        For a full disk or a missing permission.
    EngineFailed
        For an engine that crashed or hung on the model.

    Examples
    --------
    >>> import hcbench as hb
    >>> tuned = hb.tune_model("ball.xml", "ball,plate", restitution=0.5, speeds="0.5, 1 m/s")
    >>> tuned.gains
    True
    >>> tuned.max_error < 0.05
    True

    """
    pairs: list[BodyPair | None] = [*_listed(pair)]
    max_error = units.parse_max_error(max_error)
    if not pairs and isinstance(model, list | tuple) and len(model) == _TWO_FILES:
        # Each file is one of the two that meet.
        pairs = [None]
    if not pairs:
        advice = f"`hcbench measure {sanitized(model)}` lists them"
        raise UserError("pair", "missing", "two bodies or geoms", advice)
    points = read_points(points)
    ways: dict[str, Any] = {
        "alpha": alpha,
        "restitution": restitution,
        "points": points or None,
        "adams": adams,
        "newton": newton,
    }
    wanted, band = _wanted_of_model(rebound, target, material, points, ways, speeds)
    launch: LaunchOptions = {
        "speeds": sorted({min(band), max(band)}),
        "timestep": timestep,
        "gravity": gravity,
        "key": key,
        "qpos": qpos,
        "state": state,
        "package": package,
        "move": move,
        "coming_from": coming_from,
        "actuators": actuators,
    }
    requests = [make_request(each, **launch) for each in pairs]
    # Two bodies are one pair, whichever of them is named first.
    different = {frozenset(request.pair or ()) for request in requests}
    if len(different) < len(requests):
        raise UserError("pair", " and ".join(map(str, pairs)), "each pair once")
    outputs: dict[str, Path] = {}
    if write_model is not None:
        outputs["--write-model"] = Path(write_model)
    if write_include is not None:
        outputs["--write-include"] = Path(write_include)
    require_outputs(outputs, [model, package], force)
    output = _output(outputs.get("--write-model"), outputs.get("--write-include"), version)
    seconds = read_limit(limit) or LIMIT_S
    tuned = tune_job(model, requests, wanted, engine, max_error, seconds, output)
    if tuned.gains and tuned.name == AS_IT_IS:
        if outputs and not NAMES_OPTIONS.get():
            warnings.warn("Nothing is written: the model as it is has this already.", stacklevel=3)
        return tuned
    if not tuned.gains:
        # The command ends with an error instead.
        if outputs and not NAMES_OPTIONS.get():
            warnings.warn(f"Nothing is written: {tuned.no_gain}.", stacklevel=3)
        return tuned
    texts = {"--write-model": tuned.written, "--write-include": tuned.texts.include}
    for option, path in outputs.items():
        write_output(path, texts[option], option, force)
    notes = (*tuned.notes, *_without_include(tuned.written, outputs, output.include))
    return dataclasses.replace(tuned, files=tuple(outputs.values()), notes=notes)


def _without_include(text: str, outputs: Mapping[str, Path], include: str) -> list[str]:
    """A sentence if a model and a file of its lines are written, but the model does not include
    that file; else none.

    text: of the model.
    outputs: files, by their options.
    include: the file's name in the model.
    """
    if len(outputs) < 2 or f'<include file="{include}"/>' in text:
        return []
    model = outputs["--write-model"].name
    return [
        f"{model} has the lines itself and does not include {include}: your model's own text could "
        "not stay."
    ]


def is_model(model: ModelSource) -> bool:
    """Say whether an argument is a model (a file, FILE.py:FUNCTION, text, an object), not an
    engine's name.
    """
    if not isinstance(model, str):
        return True
    # The suffix of a version, as in `mujoco@3.3.0`, may look like a file's.
    if registry.base_name(model) in registry.names():
        return False
    return ".py:" in model or "<" in model or Path(model).suffix != "" or Path(model).is_file()


def _listed(pair: BodyPair | Sequence[BodyPair] | None) -> list[BodyPair]:
    """The pairs of one pair, of a list of pairs, or of None, which has none."""
    if pair is None:
        return []
    if not isinstance(pair, list | tuple):
        return [cast("BodyPair", pair)]
    # Two names are one pair; two texts such as "foot,floor" are two.
    is_one_pair = len(pair) == 2 and not any("," in str(name) for name in pair)
    if is_one_pair:
        return [cast("BodyPair", pair)]
    return list(cast("Sequence[BodyPair]", pair))


def _output(model: Path | None, include: Path | None, version: str | None) -> Output:
    """The files to write and the version that has to load them.

    model, include: paths, or None.
    version: "ENGINE@3.5", or None for the installed engine.
    Raises UserError for another form of the version.
    """
    engine = ""
    numbers: tuple[int, ...] = ()
    if version:
        match = _VERSION.fullmatch(version)
        if match is None:
            raise UserError("for", repr(version), "an engine and its version, as ENGINE@3.5")
        engine = match[1]
        numbers = tuple(map(int, match[2].split(".")))
    folder: Path | None = None
    if model is not None:
        folder = model.absolute().parent
    name = ""
    if include is not None:
        # A model names the file that it includes as seen from its own folder.
        name = os.path.relpath(include.absolute(), folder or include.absolute().parent)
    return Output(folder, name, engine, numbers)


def names_of(pair: BodyPair | None) -> Pair:
    """The two names, the body that moves first; the scene's for None."""
    names = read_pair(pair)
    return PAIR if names is None else names


def _spring(
    *, adams: Adams | None, newton: Newton | None, **others: object
) -> AdamsImpact | NewtonSpring | None:
    """The contact by stiffness and damping, if that is the target; None for another target.

    others: the other ways to give one, by their options' names.
    Raises UserError for none or several, and for text that `read_adams` or `read_newton` refuses.
    """
    ways = {**others, "adams": adams, "newton": newton}
    given = [f"--{name}" for name, value in ways.items() if value is not None]
    if len(given) != 1:
        names = ", ".join(f"--{name}" for name in (*ways, "material"))
        raise UserError("target", " and ".join(given) or "none", f"one of {names}")
    if adams is not None:
        return read_adams(adams)
    if newton is not None:
        return read_newton(newton)
    return None


def make_target(
    *,
    timestep: Quantity,
    material: MaterialName | None = None,
    alpha: Quantity | None = None,
    restitution: Quantity | None = None,
    points: Points = (),
    adams: Adams | None = None,
    newton: Newton | None = None,
    speeds: Quantities | None = None,
    reading: Reading = "law",
    scene: str = "steel-plane",
    mass: Quantity | None = None,
    stiffness: Quantity | None = None,
    exponent: float | None = None,
    gravity: Quantity | None = None,
    friction: float | None = None,
    default_friction: float = 0.0,
    corners: int | None = None,
) -> tuple[Scene, Target]:
    """The scene and the target of a question; SI numbers or text with units.

    material: a pair of materials by name, in place of its numbers.
    adams, newton: a contact by stiffness and damping, in place of an e.
    speeds: the band of impact speeds, by default the material's or the paper's, as far as the step
    can bounce.
    mass, stiffness, exponent: the scene's by default.
    gravity: into the plate, 9.81 m/s² by default.
    friction: Coulomb's μ; None for `default_friction`, and for none in a cup, which has no
    friction.
    corners: points of the body that land together; None where it is not said what body lands.
    Raises UserError for none or several of material, alpha, restitution, points, adams and newton,
    for "linear" with a material that has no α, and for an exponent without its stiffness;
    QuantityError for numbers and units; SceneError for an unknown scene; SettingError for what
    `Target` refuses.
    """
    points = read_points(points)
    ways = {"alpha": alpha, "restitution": restitution, "points": points or None}
    known = target_material(material, **ways, adams=adams, newton=newton)
    spring = None
    if known is None:
        spring = _spring(**ways, adams=adams, newton=newton)
    else:
        known.curve(reading)
        alpha, restitution, points = known.target
    loaded = load_scene(scene)
    k, n = _stiffness_and_exponent(loaded, stiffness, exponent)
    step = units.parse(timestep, "timestep", "timestep", above=0)
    g = _GRAVITY
    if gravity is not None:
        g = units.parse(gravity, "acceleration", "gravity")
    low, high = _band_of(speeds, known, points, step, g)
    m = loaded.mass
    if mass is not None:
        m = units.parse(mass, "mass", "mass")
    # Of the four kinds of target three are points (v, e): a spring has one at each of some speeds,
    # and one e for all speeds is a single point.
    if spring is not None:
        points = spring.points(m, low, high)
    if restitution is not None:
        points = ((low, units.parse(restitution, "restitution", "restitution")),)
    # Without an α the law gives the contact's duration and depth alone.
    rate = 0.0
    if alpha is not None:
        rate, _ = units.parse_uncertain(alpha, "alpha", "alpha")
    as_read = "points" if points else reading
    mu = friction
    if mu is None:
        mu = default_friction if loaded.form == "plane" else 0.0
    target = Target(
        law=HuntCrossley(k, rate, n),
        mass=m,
        timestep=step,
        speed_min=low,
        speed_max=high,
        reading=as_read,
        points=tuple(points),
        gravity=g,
        friction=mu,
        corners=1 if corners is None else corners,
        friction_asked=friction is not None,
        corners_asked=corners is not None,
        material="" if known is None else known.line,
    )
    return loaded, target


def _stiffness_and_exponent(
    scene: Scene, stiffness: Quantity | None, exponent: float | None
) -> tuple[float, float]:
    """k, N/mⁿ, and n of the law: as the user gave them, else the scene's.

    Raises UserError for an exponent other than the scene's without its stiffness, whose unit
    depends on it, and QuantityError for text that is not such a quantity.
    """
    n = scene.exponent
    if exponent is not None:
        n = units.parse(exponent, "exponent", "--exponent")
    if stiffness is not None:
        return units.parse(stiffness, "stiffness", "--stiffness", n), n
    if n != scene.exponent:
        raise UserError("--stiffness", f"missing for exponent {n:g}", f"k in N/m^{n:g}")
    return scene.stiffness, n


def _band_of(
    speeds: Quantities | None,
    known: MaterialPair | None,
    points: Points,
    timestep: float,
    gravity: float,
) -> tuple[float, float]:
    """The band of impact speeds, m/s: as given, else that of the target, else the default.

    known: the material of the target.
    points: pairs of v, m/s, and e.
    timestep: s.
    gravity: m/s². Warns where the band is outside what was measured of the material.
    Raises QuantityError for speeds that are none.
    """
    low, high = default_band(timestep, gravity)
    if speeds is not None:
        given = units.parse_values(speeds, "speed", "speeds", above=0).tolist()
        low, high = min(given), max(given)
    elif known is not None and known.band is not None:
        # A step cannot bounce below the lowest speed of its default band.
        low, high = (max(v, low) for v in known.band)
    elif known is None and len(points) > 1:
        # e is unknown outside the band of the given points.
        of_points = [v for v, _ in points]
        low, high = min(of_points), max(of_points)
    if known is not None:
        known.warn_outside(low, high)
    return low, high


def _wanted_of_model(
    rebound: Quantity | None,
    target: Reading,
    material: MaterialName | None,
    points: Points,
    ways: dict[str, Any],
    speeds: Quantities | None,
) -> tuple[RestitutionCurve | AdamsImpact | NewtonSpring | Rebound, Sequence[float]]:
    """Target of pairs of a model, and the band of speeds, m/s: as given, else the target's.

    rebound: of a robot from a drop of 10 cm, m or text with a unit; None for another target.
    target: how α is read, "law" or "linear".
    points: pairs of v, m/s, and e.
    ways: all targets but material and rebound (the points among them), by their options' names.
    Warns where the band is outside what was measured of the material.
    Raises UserError for none or several targets, and QuantityError for text that is not such a
    quantity.
    """
    if rebound is not None:
        return _rebound(rebound, material=material, **ways), DEFAULT_SPEEDS
    known = target_material(material, **ways)
    wanted, band = _wanted(target, known, points, ways)
    if speeds is not None:
        band = units.parse_values(speeds, "speed", "speeds", above=0).tolist()
    if known is not None:
        known.warn_outside(min(band), max(band))
    return wanted, band


def _rebound(rebound: Quantity, **others: object) -> Rebound:
    """The target of a robot: how high its centre of mass rebounds from a drop of 10 cm.

    rebound: m, or text with a unit.
    others: the other targets, by the names of their options; each has to be None.
    Raises UserError where one is not, and for a rebound that is not below the drop; QuantityError
    for text that is not a length.
    """
    given = [f"--{name}" for name, value in others.items() if value is not None]
    if given:
        raise UserError("rebound", f"given with {' and '.join(given)}", "one target")
    height = units.parse(rebound, "length", "rebound", least=0.0)
    if not height < max(HEIGHTS):
        got = f"{1e3 * height:g} mm from a drop of {1e3 * max(HEIGHTS):g} mm"
        raise UserError(
            "rebound", got, "less than the drop", "Write it with a unit, such as '5 mm'"
        )
    return Rebound(height)


def _wanted(
    target: Reading, known: MaterialPair | None, points: Points, ways: dict[str, Any]
) -> tuple[RestitutionCurve | AdamsImpact | NewtonSpring, Sequence[float]]:
    """Target of pairs of a model, and the default band of speeds, m/s.

    target: how α is read.
    known: the material of the target, or None.
    points: pairs of v, m/s, and e.
    ways: the other targets, by the names of their options.
    Raises UserError for none or several of them.
    """
    if known is not None:
        return known.curve(target), known.band or DEFAULT_SPEEDS
    spring = _spring(**ways)
    wanted = spring or Wanted(ways["alpha"], ways["restitution"], points, target)
    band = [v for v, _ in points] if len(points) > 1 else DEFAULT_SPEEDS
    return wanted, band
