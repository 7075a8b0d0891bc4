"""hcbench tune: a target in, text to paste out, and how wrong it is."""

from __future__ import annotations

import dataclasses
import math
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

import click

from hcbench.cli.console import (
    ACCELERATION,
    MASS,
    NUMBER,
    SPEEDS,
    STEP,
    UncertainType,
    as_json,
    print_json,
    progress,
)
from hcbench.cli.outputs import force_option, output_option
from hcbench.cli.tune_model import tunes_models
from hcbench.errors import LimitPassed, UserError

if TYPE_CHECKING:
    from hcbench.impact import Floats
    from hcbench.recipes.search import SearchInterrupted
    from hcbench.recipes.target import Target
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.tuning.choose import Match
    from hcbench.tuning.evaluate import Evaluation
    from hcbench.tuning.tune import Tuned

    Points = tuple[tuple[float, float], ...]

_SPEEDS = [0.0254, 0.508]  # m/s: 1 ... 20 in/s


class _TargetOptions(TypedDict):
    """The options that say what to match, SI."""

    alpha: tuple[float, float] | None
    restitution: float | None
    points: str | None
    timestep: float
    speeds: Floats | None
    reading: Literal["law", "linear"]
    scene: str
    mass: float | None
    stiffness: str | None
    exponent: float | None
    gravity: float
    friction: float
    corners: int


@click.command()
@click.argument("engine", metavar="ENGINE|MODEL")
@click.option(
    "--alpha", type=UncertainType("alpha"), help="α of e = 1 - α v: '0.008 s/in' or '0.31 +- 0.004 s/m'."
)
@click.option("--restitution", type=NUMBER, help="One e for all speeds, in place of --alpha.")
@click.option(
    "--points", help="Pairs v:e in place of --alpha, such as '0.1:0.95, 0.5:0.85 m/s', or a CSV file."
)
@click.option("--timestep", type=STEP, help="The engine's step, such as '1 ms'.  [a model: its own]")
@click.option(
    "--speeds", type=SPEEDS, help="The band of impact speeds.  [default: 1:20 in/s, or that of --points]"
)
@click.option("--target", "reading", type=click.Choice(["law", "linear"]), default="law", show_default=True)
@click.option(
    "--match", type=click.Choice(["restitution", "loop", "both"]), default="restitution", show_default=True
)
@click.option("--recipe", default="auto", show_default=True, help="`hcbench engines` lists them.")
@click.option("--integrator", help="Where an engine has several, such as RK4.  [default: the recipe's]")
@click.option("--scene", default="steel-plane", show_default=True, help="A scene's name or folder.")
@click.option("--mass", type=MASS, help="Effective mass.  [default: the scene's]")
@click.option("--stiffness", help="k of the law, N/m^n or with units.  [default: the scene's]")
@click.option("--exponent", type=NUMBER, help="n of the law.  [default: the scene's]")
@click.option(
    "--gravity", type=ACCELERATION, default="9.81", show_default=True, help="Into the plate; 0: none."
)
@click.option("--friction", type=NUMBER, default="0", show_default=True, help="Coulomb's μ of the contact.")
@click.option("--corners", type=int, default=1, show_default=True, help="That meet at once: 4 of a flat box.")
@click.option(
    "--max-error",
    type=float,
    help="Exit 1 when the largest error of e is above this.  [default: auto looks for 0.05]",
)
@output_option("--write-scene", help="Write a file that runs in the plain engine.")
@force_option
@as_json
@tunes_models
def tune(
    engine: str,
    recipe: str,
    match: Match,
    integrator: str | None,
    max_error: float | None,
    write_scene: Path | None,
    force: bool,
    as_json: bool,
    **options: Unpack[_TargetOptions],
) -> None:
    """Find settings that bounce like your material."""
    from hcbench._outputs import write_output
    from hcbench.recipes.search import SearchInterrupted
    from hcbench.sim import registry
    from hcbench.tuning import tune as tuning

    scene, target = _scene_and_target(options)
    try:
        with progress("tuning") as report:
            limit = tuning.MAX_ERROR if max_error is None else max_error
            tuned = tuning.tune(engine, target, scene, recipe, match, integrator, report, limit)
    except SearchInterrupted as interrupt:
        _print_interrupted(interrupt, scene, as_json)
        raise click.Abort(f"interrupted: {interrupt}") from None
    text = _snippet(tuned.setting, scene)
    if write_scene is not None:
        script = registry.engine(engine).script(tuned.scene, tuned.setting)
        write_output(write_scene, script, "--write-scene", force)
    margin = _margin(target, options["alpha"])
    if as_json:
        print_json({**_as_json(tuned, text), "restitution_margin_95": margin})
    else:
        _print(tuned, text, margin)
    error = tuned.evaluation.max_error
    if max_error is not None and not error <= max_error:
        raise LimitPassed("max-error", f"{error:.3g} with {tuned.recipe.name!r}", f"{max_error:g} or less")


def _scene_and_target(options: _TargetOptions) -> tuple[Scene, Target]:
    from hcbench import units
    from hcbench.laws.force import HuntCrossley
    from hcbench.recipes.target import Target
    from hcbench.scene import load_scene

    scene = load_scene(options["scene"])
    ways = {name: options[name] for name in ("alpha", "restitution", "points")}
    given = [f"--{name}" for name, value in ways.items() if value is not None]
    if len(given) != 1:
        got = " and ".join(given) or "none"
        raise UserError("target", got, "one of --alpha, --restitution, --points")
    n = scene.exponent if options["exponent"] is None else options["exponent"]
    k = scene.stiffness
    if options["stiffness"]:
        k = units.parse(options["stiffness"], "stiffness", "--stiffness", n)
    elif n != scene.exponent:
        raise UserError("--stiffness", f"missing for exponent {n:g}", f"k in N/m^{n:g}")
    mass = scene.mass if options["mass"] is None else options["mass"]
    points = () if options["points"] is None else parse_points(options["points"])
    # Beyond several points nobody knows e.
    speeds = [v for v, _ in points] if len(points) > 1 else _SPEEDS
    if options["speeds"] is not None:
        speeds = options["speeds"].tolist()
    band = min(speeds), max(speeds)
    if options["restitution"] is not None:
        points = ((band[0], options["restitution"]),)
    law = HuntCrossley(k, (options["alpha"] or (0.0, 0.0))[0], n)
    reading = "points" if points else options["reading"]
    return scene, Target(
        law,
        mass,
        options["timestep"],
        *band,
        reading,
        points,
        gravity=options["gravity"],
        friction=options["friction"],
        corners=options["corners"],
    )


def parse_points(text: str) -> Points:
    """Pairs (v m/s, e) from 'v:e, v:e unit' or from a CSV file with the columns speed and restitution."""
    from hcbench import units

    is_file = False
    with suppress(OSError):  # pairs are no file's name, and may be longer than one can be
        is_file = Path(text).is_file()
    if is_file:
        from hcbench.checking.measured_pairs import read_pairs

        return read_pairs(Path(text))
    points = []
    unit = text.rsplit(":", 1)[-1].strip().partition(" ")[2]
    for pair in text.split(","):
        speed, colon, e = pair.strip().removesuffix(unit).strip().partition(":")
        if not colon:
            expected = "pairs like '0.1:0.95, 0.5:0.85 m/s' or a CSV file that exists"
            raise UserError("--points", repr(text), expected)
        v = units.parse(f"{speed} {unit}".strip(), "speed", "--points", above=0)
        points.append((v, units.parse(e, "number", "--points")))
    return tuple(points)


def _snippet(setting: Setting, scene: Scene) -> str:
    from hcbench.tuning.snippet import snippet

    return snippet(setting, scene.form)


def _margin(target: Target, alpha: tuple[float, float] | None) -> float:
    """How far an uncertain α lets e be off over the band (95 %); 0 for one that is not."""
    import numpy as np

    from hcbench.laws.restitution import Restitution

    if alpha is None or target.reading == "points":
        return 0.0
    band = np.linspace(target.speed_min, target.speed_max, 13)
    return Restitution(alpha[0], target.reading, alpha[1]).margin(band)


def _print(tuned: Tuned, text: str, margin: float) -> None:
    result, target, rest = tuned.evaluation, tuned.target, tuned.rest
    truth = {"law": "e of (16)", "linear": "1 - α v", "points": "the e asked for"}[target.reading]
    band = f"{target.speed_min:.4g} ... {target.speed_max:.4g} m/s"
    moves = f"creep {rest.creep:.1e} m/s, depth {rest.depth:.1e} m, buzz {rest.buzz:.1e} m/s"
    loop = f"{_percent(result.loop_rms)} of the largest force from the law's (rms)"
    has_loop = not math.isnan(result.loop_rms) and target.reading == "law"
    rows = {
        "setting": f"{tuned.setting.engine} {tuned.recipe.name}: {tuned.why}",
        "largest error of e": (
            f"{result.max_error:.2g} against {truth} over {band}, {_conditions(target)},"
            f" {result.launches} launches at random and about the worst"
        ),
        **({"uncertainty of α": f"e is known to ± {margin:.2g} (95 %)"} if margin else {}),
        **({"friction": _friction(result, target)} if target.friction else {}),
        "best constant e": f"{result.constant:.6g}, off by {result.constant_error:.2g}",
        "steps in contact": f"{result.steps_min} ... {result.steps_max} of {target.timestep:g} s",
        "largest penetration": f"{result.penetration_max:.3g} m",
        "largest force": f"{result.force_max:.4g} N",
        **({"force loop": loop} if has_loop else {}),
        "rests under gravity": (
            f"{'yes' if rest.rests else 'no'}: {'it diverges' if math.isnan(rest.depth) else moves}"
        ),
    }
    for name, value in rows.items():
        print(f"{name:<20}  {value}")
    print(f"\npaste:\n\n{text or 'nothing: the engine as it comes'}\n\nknow:")
    for line in (*tuned.advice, *tuned.recipe.notes):
        print(f"- {line}")


def _conditions(target: Target) -> str:
    falls = f"gravity {target.gravity:g} m/s^2" if target.gravity else "without gravity"
    slides = f"friction {target.friction:g}, sliding and spinning"
    return f"{falls}, {slides}" if target.friction else f"{falls}, frictionless and head-on"


def _friction(result: Evaluation, target: Target) -> str:
    off = f"{_percent(result.friction_error)} of {target.friction:g} times the normal impulse"
    return f"impulse off Coulomb's by at most {off}"


def _percent(share: float) -> str:  # three digits, and no power of ten above 1 %
    return f"{100 * share:.{'3g' if share < 1 else '0f'}} %"


def _print_interrupted(interrupt: SearchInterrupted, scene: Scene, as_json: bool) -> None:
    """What a search had found when it was interrupted; the engine has not judged it."""
    best, text = interrupt.best, _snippet(interrupt.best, scene)
    if as_json:
        progress_made = {
            "evaluations": interrupt.done,
            "at_most": interrupt.budget,
            "max_error_by_model": interrupt.error,
        }
        head = {"schema": 1, "engine": best.engine, "recipe": best.name, "cut_short": progress_made}
        print_json({**head, "timestep_s": best.timestep, "options": dict(best.options), "paste": text})
        return
    error = f"{interrupt.error:.2g} by the search's own model; the engine has not judged it"
    print(f"{'setting':<20}  {best.engine} {best.name}, the best so far: {interrupt}")
    print(f"{'largest error of e':<20}  {error}\n\npaste:\n\n{text}", flush=True)


def _as_json(tuned: Tuned, text: str) -> dict[str, Any]:
    return {
        "schema": 1,
        "engine": tuned.setting.engine,
        "recipe": tuned.recipe.name,
        "why": tuned.why,
        "target": dataclasses.asdict(tuned.target),
        "timestep_s": tuned.setting.timestep,
        "options": dict(tuned.setting.options),
        "verdict": dataclasses.asdict(tuned.evaluation),
        "rest": dataclasses.asdict(tuned.rest),
        "advice": list(tuned.advice),
        "holds": list(tuned.recipe.notes),
        "paste": text,
    }
