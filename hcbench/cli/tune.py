"""hcbench tune: a target in, text to paste out, and how wrong it is."""

from __future__ import annotations

import dataclasses
import math
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hcbench.cli._process import Interrupted, path_type
from hcbench.cli.console import as_json, print_json, progress
from hcbench.errors import LimitPassed, UserError

if TYPE_CHECKING:
    from hcbench.scene import Scene
    from hcbench.tune.evaluate import RestResult
    from hcbench.tune.search import SearchInterrupted
    from hcbench.tune.target import Target
    from hcbench.tune.tune import Tuned

_SPEEDS = "1:20 in/s"


@click.command()
@click.argument("engine")
@click.option("--alpha", help="α of e = 1 - α v, such as '0.008 s/in'.")
@click.option("--restitution", "constant", help="One e for all speeds, in place of --alpha.")
@click.option(
    "--points", help="Pairs v:e in place of --alpha, such as '0.1:0.95, 0.5:0.85 m/s', or a CSV file."
)
@click.option("--timestep", required=True, help="The engine's step, such as '1e-3' or '1 ms'.")
@click.option("--speeds", help="The band of impact speeds.  [default: 1:20 in/s, or that of --points]")
@click.option("--target", "reading", type=click.Choice(["law", "linear"]), default="law", show_default=True)
@click.option(
    "--match", type=click.Choice(["restitution", "loop", "both"]), default="restitution", show_default=True
)
@click.option("--recipe", default="auto", show_default=True, help="`hcbench engines` lists them.")
@click.option("--integrator", help="MuJoCo's: Euler, implicitfast, RK4.  [default: the recipe's, Euler]")
@click.option("--scene", default="steel-plane", show_default=True, help="A scene's name or folder.")
@click.option("--mass", help="Effective mass.  [default: the scene's]")
@click.option("--stiffness", help="k of the law, N/m^n or with units.  [default: the scene's]")
@click.option("--exponent", help="n of the law.  [default: the scene's]")
@click.option("--max-error", type=float, help="Exit 1 when the largest error of e is above this.")
@click.option(
    "--write-scene", type=path_type(path_type=Path), help="Write a file that runs in the plain engine."
)
@as_json
def tune(engine: str, as_json: bool, write_scene: Path | None, max_error: float | None, **given: Any) -> None:
    """Find settings that bounce like your material.

    Prints what to write in ENGINE (mujoco, pybullet), and how wrong it is.
    """
    from hcbench._files import write_text
    from hcbench.tune import snippet
    from hcbench.tune import tune as tuning
    from hcbench.tune.search import SearchInterrupted

    if max_error is not None and not 0 <= max_error <= 1:
        raise UserError("--max-error", f"{max_error:g}", "0 ... 1, a difference in e")
    scene, target = _asked(given)
    asked = (given["recipe"], given["match"], given["integrator"])
    try:
        with progress("tuning") as tick:
            tuned = tuning.tune(engine, target, scene, *asked, progress=tick)
    except SearchInterrupted as interrupt:
        _print_interrupted(interrupt, scene, as_json)
        raise Interrupted(f"interrupted: {interrupt}") from None
    text = snippet.paste(tuned.setting, scene.form, scene.relative_radius)
    if write_scene is not None:
        write_text(write_scene, snippet.script(tuned.scene, tuned.setting))
    if as_json:
        print_json(_as_json(tuned, text))
    else:
        _print(tuned, text)
    if max_error is not None and not tuned.evaluation.max_error <= max_error:
        raise LimitPassed(
            "max-error",
            f"{tuned.evaluation.max_error:.3g} with {tuned.recipe.name!r}",
            f"{max_error:g} or less",
        )


def _asked(given: dict[str, Any]) -> tuple[Scene, Target]:
    from hcbench import units
    from hcbench.laws.force import HuntCrossley
    from hcbench.scene import load_scene
    from hcbench.tune.target import Target

    scene = load_scene(given["scene"])
    ways = [name for name in ("alpha", "constant", "points") if given[name] is not None]
    if len(ways) != 1:
        got = "none" if not ways else " and ".join(f"--{w}".replace("constant", "restitution") for w in ways)
        raise UserError("target", got, "one of --alpha, --restitution, --points")
    n = units.parse(given["exponent"], "number", "--exponent") if given["exponent"] else scene.exponent
    k = scene.stiffness
    if given["stiffness"]:
        k = units.parse(given["stiffness"], "stiffness", "--stiffness", n)
    elif n != scene.exponent:
        raise UserError("--stiffness", f"missing for exponent {n:g}", f"k in N/m^{n:g}")
    timestep = units.parse(given["timestep"], "timestep", "--timestep")
    units.require_positive(timestep, "timestep", "--timestep")
    mass = units.parse(given["mass"], "mass", "--mass") if given["mass"] else scene.mass
    units.require_positive(mass, "mass", "--mass")
    alpha = units.parse(given["alpha"], "alpha", "--alpha") if given["alpha"] else 0.0
    pairs = _points(given["points"]) if given["points"] else ()
    band = _band(given["speeds"], pairs)
    if given["alpha"]:
        return scene, Target(HuntCrossley(k, alpha, n), mass, timestep, *band, reading=given["reading"])
    points = pairs or ((band[0], units.parse(given["constant"], "number", "--restitution")),)
    return scene, Target(HuntCrossley(k, 0.0, n), mass, timestep, *band, "points", points)


def _band(asked: str | None, pairs: tuple[tuple[float, float], ...]) -> tuple[float, float]:
    """Lowest and highest speed, m/s: as asked, or those of several pairs: beyond them nobody knows e."""
    from hcbench import units

    if asked is None and len(pairs) > 1:
        return min(v for v, _ in pairs), max(v for v, _ in pairs)
    speeds = units.parse_values(_SPEEDS if asked is None else asked, "speed", "--speeds")
    units.require_positive(speeds, "speed", "--speeds")
    return float(speeds.min()), float(speeds.max())


def _is_file(text: str) -> bool:
    with suppress(OSError):  # pairs are no file's name, and may be longer than one can be
        return Path(text).is_file()
    return False


def _points(text: str) -> tuple[tuple[float, float], ...]:
    """Pairs (v m/s, e) from 'v:e, v:e unit' or from a CSV file with the columns speed and restitution."""
    from hcbench import units

    if _is_file(text):
        from hcbench.check.pairs import read_pairs

        return read_pairs(Path(text))
    pairs = []
    unit = text.rsplit(":", 1)[-1].strip().partition(" ")[2]
    for piece in text.split(","):
        speed, colon, e = piece.strip().removesuffix(unit).strip().partition(":")
        if not colon:
            raise UserError(
                "--points", repr(text), "pairs like '0.1:0.95, 0.5:0.85 m/s' or a CSV file that exists"
            )
        v = units.parse(f"{speed} {unit}".strip(), "speed", "--points")
        units.require_positive(v, "speed", "--points")
        pairs.append((v, units.parse(e, "number", "--points")))
    return tuple(pairs)


def _print(tuned: Tuned, text: str) -> None:
    verdict, target = tuned.evaluation, tuned.target
    truth = {"law": "e of (16)", "linear": "1 - α v", "points": "the e asked for"}[target.reading]
    band = f"{target.speed_min:.4g} ... {target.speed_max:.4g} m/s"
    rows = [
        ("setting", f"{tuned.setting.engine} {tuned.recipe.name}: {tuned.why}"),
        (
            "largest error of e",
            f"{verdict.max_error:.2g} against {truth} over {band}, held-out speeds, 8 phases",
        ),
        ("best constant e", f"{verdict.constant:.6g}, off by {verdict.constant_error:.2g}"),
        ("steps in contact", f"{verdict.steps_min} ... {verdict.steps_max} of {target.timestep:g} s"),
        ("largest penetration", f"{verdict.penetration_max:.3g} m"),
        ("largest force", f"{verdict.force_max:.4g} N"),
    ]
    if not math.isnan(verdict.loop_rms) and target.reading == "law":
        rows.append(("force loop", f"{_percent(verdict.loop_rms)} of the largest force from the law's (rms)"))
    rows.append(("rests under gravity", f"{'yes' if tuned.rest.rests else 'no'}: {_rest(tuned.rest)}"))
    for name, value in rows:
        print(f"{name:<20}  {value}")
    print("\npaste:\n")
    print(text or "nothing: the engine as it comes")
    print("\nknow:")
    for line in (*tuned.advice, *tuned.recipe.notes):
        print(f"- {line}")


def _rest(rest: RestResult) -> str:
    if math.isnan(rest.depth):
        return "it diverges"
    return f"creep {rest.creep:.1e} m/s, depth {rest.depth:.1e} m, buzz {rest.buzz:.1e} m/s"


def _percent(share: float) -> str:
    """Three digits, and no power of ten for what is above 1 %."""
    return f"{100 * share:.3g} %" if share < 1 else f"{100 * share:.0f} %"


def _print_interrupted(interrupt: SearchInterrupted, scene: Scene, as_json: bool) -> None:
    """What a search had found when it was interrupted; the engine has not judged it."""
    from hcbench.tune import snippet

    best = interrupt.best
    text = snippet.paste(best, scene.form, scene.relative_radius)
    if as_json:
        found = {
            "evaluations": interrupt.done,
            "at_most": interrupt.budget,
            "max_error_by_model": interrupt.error,
        }
        head = {"schema": 1, "engine": best.engine, "recipe": best.name, "cut_short": found}
        print_json({**head, "timestep_s": best.timestep, "options": dict(best.options), "paste": text})
        return
    error = f"{interrupt.error:.2g} by the search's own model; the engine has not judged it"
    print(f"{'setting':<20}  {best.engine} {best.name}, the best so far: {interrupt}")
    print(f"{'largest error of e':<20}  {error}")
    print(f"\npaste:\n\n{text}", flush=True)


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
