"""hcbench tune ENGINE: a setting of an engine for a scene, as text to paste, and how wrong it is."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import click

from hcbench._text import time_step
from hcbench.cli.console import print_json, progress
from hcbench.errors import LimitPassed, UserError

if TYPE_CHECKING:
    from hcbench.impact import Floats
    from hcbench.laws.restitution import Reading
    from hcbench.recipes.search import SearchInterrupted
    from hcbench.recipes.target import Target
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.tuning.choose import Match
    from hcbench.tuning.evaluate import Evaluation
    from hcbench.tuning.tune import Tuned

_SPEEDS = [0.0254, 0.508]  # m/s: 1 ... 20 in/s
_GRAVITY = 9.81  # m/s^2


class _TargetOptions(TypedDict):
    """The options that say what to match, SI."""

    alpha: tuple[float, float] | None
    restitution: float | None
    points: tuple[tuple[float, float], ...]
    speeds: Floats | None
    reading: Reading
    scene: str
    mass: float | None
    stiffness: str | None
    exponent: float | None
    gravity: float | None
    friction: float
    corners: int


def tune_engine(
    engine: str,
    *,
    timestep: float | None,
    recipe: str,
    match: Match,
    integrator: str | None,
    max_error: float | None,
    write_scene: Path | None,
    force: bool,
    as_json: bool,
    **options: Unpack[_TargetOptions],
) -> None:
    """Tune an engine, print the setting and how wrong it is, and write a script with it."""
    from hcbench._outputs import write_output
    from hcbench.recipes.search import SearchInterrupted
    from hcbench.sim import registry
    from hcbench.tuning import tune as tuning

    if timestep is None:
        raise UserError("--timestep", "missing", "the engine's step, such as '1 ms'")
    scene, target = _scene_and_target(timestep, options)
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


def _scene_and_target(timestep: float, options: _TargetOptions) -> tuple[Scene, Target]:
    from hcbench import units
    from hcbench.laws.force import HuntCrossley
    from hcbench.recipes.target import Target
    from hcbench.scene import load_scene

    scene = load_scene(options["scene"])
    ways = {name: options.get(name) for name in ("alpha", "restitution", "points")}
    given = [f"--{name}" for name, value in ways.items() if value not in (None, ())]
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
    points = options["points"]
    # Outside the band of several points e is not known.
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
        timestep,
        *band,
        reading,
        points,
        gravity=_GRAVITY if options["gravity"] is None else options["gravity"],
        friction=options["friction"],
        corners=options["corners"],
    )


def _snippet(setting: Setting, scene: Scene) -> str:
    from hcbench.tuning.snippet import snippet

    return snippet(setting, scene.form)


def _margin(target: Target, alpha: tuple[float, float] | None) -> float:
    """Error of e from the uncertainty of α over the band (95 %); 0 for an exact α."""
    import numpy as np

    from hcbench.laws.restitution import Restitution

    if alpha is None or target.reading == "points":
        return 0.0
    band = np.linspace(target.speed_min, target.speed_max, 13)
    return Restitution(alpha[0], target.reading, alpha[1]).margin(band)


def _print(tuned: Tuned, text: str, margin: float) -> None:
    result, target, rest = tuned.evaluation, tuned.target, tuned.rest
    truth = {"law": "e of the law", "linear": "1 - α v", "points": "the target e"}[target.reading]
    band = f"{target.speed_min:.4g} ... {target.speed_max:.4g} m/s"
    moves = f"drift {rest.creep:.1e} m/s, penetration {rest.depth:.1e} m, vibration {rest.buzz:.1e} m/s"
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
        "best constant e": f"{result.constant:.6g}, wrong by at most {result.constant_error:.2g}",
        "steps in contact": f"{result.steps_min} ... {result.steps_max} of {time_step(target.timestep)} s",
        "largest penetration": f"{result.penetration_max:.3g} m",
        "largest force": f"{result.force_max:.4g} N",
        **({"force loop": loop} if has_loop else {}),
        "rests under gravity": (
            f"{'yes' if rest.rests else 'no'}: {'it diverges' if math.isnan(rest.depth) else moves}"
        ),
    }
    for name, value in rows.items():
        print(f"{name:<20}  {value}")
    print(f"\npaste:\n\n{text or 'nothing: the defaults of the engine'}\n\nNotes:")
    for line in (*tuned.advice, *tuned.recipe.notes):
        print(f"- {line}")


def _conditions(target: Target) -> str:
    falls = f"gravity {target.gravity:g} m/s^2" if target.gravity else "without gravity"
    slides = f"friction {target.friction:g}, sliding and spinning"
    return f"{falls}, {slides}" if target.friction else f"{falls}, frictionless and head-on"


def _friction(result: Evaluation, target: Target) -> str:
    off = f"{_percent(result.friction_error)} of {target.friction:g} times the normal impulse"
    return f"impulse wrong by at most {off}"


def _percent(share: float) -> str:  # three digits, and no power of ten above 1 %
    return f"{100 * share:.{'3g' if share < 1 else '0f'}} %"


def _print_interrupted(interrupt: SearchInterrupted, scene: Scene, as_json: bool) -> None:
    """The best setting when a search was interrupted; it has not been simulated."""
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
    error = f"{interrupt.error:.2g} by the search's own model; not simulated yet"
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
        "evaluation": dataclasses.asdict(tuned.evaluation),
        "rest": dataclasses.asdict(tuned.rest),
        "advice": list(tuned.advice),
        "notes": list(tuned.recipe.notes),
        "paste": text,
    }
