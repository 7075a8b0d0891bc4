"""hcbench tune: settings of an engine for a scene, or of the engine of a model for pairs in it."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from hcbench.cli.console import (
    ACCELERATION,
    EXPONENT,
    FRICTION,
    MASS,
    REBOUND,
    RESTITUTION,
    SPEEDS,
    STEP,
    UncertainType,
    as_json,
    force_option,
    options,
    output_option,
    print_json,
    progress,
    show,
    show_code,
)
from hcbench.cli.help import command
from hcbench.cli.law import spring_options
from hcbench.system.errors import LimitPassed, UserError
from hcbench.system.text import joined_names, time_step, two_digits
from hcbench.terms.bounds import BOUNDS

if TYPE_CHECKING:
    from hcbench.recipes.recipe import SearchInterrupted
    from hcbench.recipes.target import Target
    from hcbench.sim.passivity import Passivity
    from hcbench.tuning.answer import Answer, Choice, Kind
    from hcbench.tuning.evaluate import Evaluation
    from hcbench.tuning.tuned import Tuned


# hcbench tune ENGINE: a setting of an engine for a scene, as text to paste, and how wrong it is.

_FLAGS: dict[Kind, str] = {"exact": "--plugin", "settings": "--settings", "constant": "--constant"}


# A function of the user's script that sets up a world, as a shell takes it.
_SCRIPT = "--python FILE.py:FUNCTION"
# Variables of two bodies whose names cannot be those of a script.
_BODIES = ("first", "second")


def tune_engine(
    engine: str,
    *,
    alpha: tuple[float, float] | None,
    pair: tuple[str, ...],
    kind: Kind | None,
    scene: str,
    max_error: float | None,
    certify: bool,
    write_scene: Path | None,
    force: bool,
    as_json: bool,
    **asked: Any,
) -> None:
    """Tune an engine, print the answer, and write a script with its setting.

    alpha: α and its standard uncertainty, s/m.
    pair: names of the two bodies in the text to paste, once at most.
    kind: of the answer that --plugin, --settings or --constant ask for.
    scene: its name or folder.
    max_error: limit of the error of e, None for the default.
    certify: whether to run the whole test for energy on the answer, which then has to pass it.
    write_scene: file for the script.
    force: replace a file that hcbench did not write.
    asked: other arguments of `tuning.ask.tune`.
    Raises LimitPassed where the answer is not as asked, click.Abort where the search is
    interrupted, and what `tune` raises.
    """
    from hcbench.recipes.recipe import SearchInterrupted
    from hcbench.sim import registry
    from hcbench.system.outputs import write_output
    from hcbench.terms.setting import PAIR
    from hcbench.tuning.answer import MAX_ERROR
    from hcbench.tuning.ask import tune

    if len(pair) > 1:
        raise UserError("--pair", f"given {len(pair)} times", "one pair of names for an engine")
    limit = MAX_ERROR if max_error is None else max_error
    try:
        with progress("tuning") as report:
            answer = tune(
                engine,
                pair[0] if pair else None,
                alpha=None if alpha is None else alpha[0],
                kind=kind,
                scene=scene,
                max_error=limit,
                progress=report,
                **asked,
            )
    except SearchInterrupted as interrupt:
        _print_interrupted(interrupt, scene, as_json)
        raise click.Abort(f"interrupted: {interrupt}") from None
    if answer.left_out:
        click.echo(answer.left_out, err=True)
    best = answer.best
    # The file is written even where the answer is then beyond a limit.
    if write_scene is not None:
        adapter = registry.engine(engine)
        script = adapter.script(answer.scene, best.setting)
        if best.promise is not None:
            script = adapter.promised(script, PAIR, best.promise)
        write_output(write_scene, script, "--write-scene", force)
    gate = _gate(answer) if certify else None
    margin = _margin(answer.target, alpha)
    if as_json:
        print_json(_as_json(answer, margin, gate))
    else:
        _print(answer, margin, gate)
        _print_next(answer, write_scene, asked["material"])
    _require(answer, limit, gate)


def _print_next(answer: Answer, write_scene: Path | None, material: str | None) -> None:
    """Print the command that shows how the answer's text does in a model; nothing for an engine
    that opens no models.

    write_scene: the script that was written with the setting, None for none: then the text goes
    into a model of the user's.
    material: as it was typed, None for another target.
    """
    from hcbench.terms.setting import PAIR

    model = _user_model(answer.engine)
    # The bodies have the user's names in a model, and hcbench's own in a script that it wrote.
    names = answer.pair
    if write_scene is not None:
        model = quote(str(write_scene))
        names = PAIR
    if not model:
        return
    title = "next:"
    if model == _SCRIPT:
        bodies = ", ".join(names if all(map(str.isidentifier, names)) else _BODIES)
        title = f"next, with a FUNCTION that returns World(client, {bodies}):"
    show(f"\n{title}\n  {_next_line(answer, model, joined_names(names), material)}")


def _user_model(engine: str) -> str:
    """Model of the user's, as a shell takes it, into which the text of an engine is pasted: a file,
    or a function of the script; "" for an engine that opens no models.
    """
    from hcbench.sim import registry
    from hcbench.sim.capabilities import OpensModels, TunesModels

    adapter = registry.engine(engine)
    if not isinstance(adapter, OpensModels):
        return ""
    if not isinstance(adapter, TunesModels):
        # Without its name another engine opens the file.
        return f"my.xml --engine {quote(engine)}"
    return "my.xml" if adapter.writes_models else _SCRIPT


def _next_line(answer: Answer, model: str, pair: str, material: str | None) -> str:
    """The command that shows how the pasted text does.

    model: with the text, as a shell takes it.
    pair: of its bodies.
    material: as it was typed.
    """
    target = answer.target
    low, high = answer.best.speeds
    asked = f'--alpha "{target.law.alpha:.10g} s/m"'
    if material is not None:
        asked = f"--material {quote(material)}"
    elif target.reading == "points":
        # No option names a curve that is not constant.
        asked = ""
        if target.is_constant:
            asked = f"--restitution {target.points[0][1]:g}"
    line = f"hcbench measure {model} --pair {quote(pair)} {asked}".rstrip()
    speeds = f"{low:.3g}:{high:.3g}:5" if low < high else f"{low:.10g}"
    return f'{line} --speeds "{speeds} m/s"'


def _require(answer: Answer, max_error: float, gate: Passivity | None) -> None:
    """Raise LimitPassed where the answer is not what was asked for, or may not be recommended; of
    several reasons the first in this order: kind of setting, its flaws, bodies that it is not for,
    error of e, the gate.

    answer: of a search.
    max_error: largest error of e that is allowed.
    gate: of `--certify`, None without.
    """
    best = answer.best
    if answer.asked is not None and not answer.is_as_asked:
        got = f"no setting passes; the next is {best.line}"
        raise LimitPassed(
            _FLAGS[answer.asked], got, "a setting that follows the target and gains no energy"
        )
    if best.tuned is not None and best.tuned.flaws:
        got = f"{best.setting.name!r}: {best.tuned.flaws}"
        raise LimitPassed(
            "--recipe", got, "a setting that gains no energy and rests", answer.remedy
        )
    if not answer.fits(best):
        got = f"{best.setting.name!r} is for spheres: {_worst_of_boxes(answer)}"
        expected = "a setting for any body"
        advice = "Balls need --corners 1, boxes on a face --corners 4"
        raise LimitPassed("--corners", got, expected, f"{advice}. {answer.remedy}")
    if not best.max_error <= max_error:
        got = f"{best.max_error:.3g} with {best.setting.name!r}"
        raise LimitPassed("max-error", got, f"{max_error:g} or less", answer.remedy)
    if gate is not None and not gate.sphere:
        raise LimitPassed(
            "--certify", f"{best.setting.name!r} {gate.warning}", "a setting that passes"
        )


def _worst_of_boxes(answer: Answer) -> str:
    """Phrase on the test of boxes and a capsule that the best choice fails by most; the answer's
    own tests ended with the first that failed.
    """
    from hcbench.sim import registry

    best = answer.best
    assert best.passivity is not None
    adapter = registry.engine(answer.engine)
    tried = adapter.with_boxes(answer.scene, best.setting, best.passivity, whole=True)
    return tried.worst_of_boxes


def _gate(answer: Answer) -> Passivity:
    """Run the whole test for energy on the best setting of an answer, in the plain engine, also
    with a train of bounces; it takes about a minute. Raises what the engine raises.
    """
    from hcbench.sim import registry
    from hcbench.sim.passivity import LongestTrain

    best = answer.best
    train = LongestTrain(answer.target.curve, best.max_error, answer.target.speed_max)
    adapter = registry.engine(answer.engine)
    return adapter.passivity(answer.scene, best.setting, best.speeds, whole=True, train=train)


def _margin(target: Target, alpha: tuple[float, float] | None) -> float:
    """Error of e from the uncertainty of α over the target's band (95 %); 0 for an exact α.

    alpha: α and its standard uncertainty, s/m; None where the target is no α.
    """
    import numpy as np

    from hcbench.laws.restitution import Restitution

    if alpha is None or target.reading == "points":
        return 0.0
    # The margin bends slowly over speed: a few speeds find its largest.
    band = np.linspace(target.speed_min, target.speed_max, 13)
    value, uncertainty = alpha
    return Restitution(value, target.reading, uncertainty).margin(band)


def _print(answer: Answer, margin: float, gate: Passivity | None) -> None:
    """Print the answer: setting, error, text to paste, other choices, notes.

    margin: of e, by the uncertainty of α.
    gate: None unless --certify asks for it.
    """
    best = answer.best
    rows = {**_setting_rows(answer), **_rows(best, answer.target)}
    if margin:
        rows["uncertainty of α"] = f"e is known to ± {margin:.2g} (95 %)"
    rows["needs"] = "; ".join(best.needs) or "nothing"
    for name, value in rows.items():
        show(f"{name:<20}  {value}")
    show("\npaste:\n")
    show_code(f"{best.text or 'nothing: the default'}\n")
    for choice in answer.choices:
        if choice is not best:
            flags = _FLAGS[choice.kind]
            if not answer.fits(choice):
                flags += " --corners 1"
            show(f"or {choice.line} ({flags})")
    for never in answer.never:
        show(f"never {never.setting}: {never.why}")
    if gate is not None:
        _print_gate(gate)
    show("\nNotes:")
    advice = best.tuned.advice if best.tuned is not None else ()
    for line in (*advice, *best.notes):
        show(f"- {line}")


def _setting_rows(answer: Answer) -> dict[str, str]:
    """First rows of the answer's table, texts by their titles: the target's material, the setting
    with the reason for it, and what to beware of; those that do not apply are left out.
    """
    best = answer.best
    why = "the plug-in gives each impact the e of its own speed"
    warning = ""
    if best.tuned is not None:
        why = best.tuned.why
        warning = best.tuned.passivity.warning
    spheres = ""
    if best.flat is False:
        spheres = "; for spheres: a flat face gains energy"
    rows = {
        "material": answer.target.material,
        "setting": f"{answer.engine} {best.setting.name}: {why}{spheres}",
        "warning": warning,
        # It is about the engine's own contact, which the plug-in replaces.
        "caution": "" if best.kind == "exact" else answer.caution,
        "band": answer.band_note,
    }
    return {title: text for title, text in rows.items() if text}


def _print_gate(gate: Passivity) -> None:
    """Print the certificate: the verdicts, then each finding beside its limit."""
    of_spheres = _verdict(gate.sphere)
    of_boxes = _verdict(gate.flat)
    show(f"\ncertified: {of_spheres} for spheres, {of_boxes} for boxes")
    for finding in gate.findings:
        mark = "ok " if finding.passed else "NOT"
        value = f"{finding.value:.5g} of at most {finding.limit:.5g} {finding.unit}".rstrip()
        show(f"  {mark} {finding.name}: {value} ({finding.under})")


def _verdict(has_passed: bool | None) -> str:
    """The word for a part of the certificate; what was not tested, None, has failed."""
    if has_passed:
        return "passed"
    return "FAILED"


def _rows(best: Choice, target: Target) -> dict[str, str]:
    """Rows of the table of a choice, values by their titles.

    best: the choice.
    target: whose words say what e is held against. Values are texts with units.
    """
    truth = {"law": "e of the law", "linear": "1 - α v", "points": "the target e"}[target.reading]
    low, high = best.speeds
    error = f"{two_digits(best.max_error)} against {truth} over {low:.4g} ... {high:.4g} m/s"
    tuned = best.tuned
    if tuned is None:
        return {
            "largest error of e": error,
            "largest e": f"{best.max_e:.4f}, {best.energy}",
        }
    result = tuned.evaluation
    has_loop = not math.isnan(result.loop_rms) and target.reading == "law"
    launches = f"{result.launches} launches at random and about the worst"
    steps = f"{result.steps_min} ... {result.steps_max} of {time_step(target.timestep)} s"
    rows = {
        "largest error of e": f"{error}, {_conditions(tuned)}, {launches}",
        "mean error of e": _bias(result),
        "largest e": f"{best.max_e:.4f} there, below and above, {best.energy}",
    }
    if target.friction:
        rows["friction"] = _friction(result, target)
    rows |= {
        "best constant e": f"{result.constant:.6g}, wrong by at most {result.constant_error:.2g}",
        "steps in contact": steps,
        "largest penetration": f"{result.penetration_max:.3g} m",
        "largest force": f"{result.force_max:.4g} N",
    }
    if has_loop:
        loop = f"{_percent(result.loop_rms)} of the largest force from the law's (rms)"
        rows["force loop"] = loop
    rows["rests under gravity"] = _rest(tuned)
    return rows | _slope(tuned)


def _bias(result: Evaluation) -> str:
    """The side of the target on which the launches lie, in words."""
    share = f"{100 * result.below:.0f} % of them lie below the target"
    return f"{result.mean_error:+.2g} in these launches; {share}"


def _rest(tuned: Tuned) -> str:
    """Words for the body at rest: m/s and m."""
    rest = tuned.rest
    if math.isnan(rest.penetration):
        return "no: it diverges"
    moves = f"drift {rest.sinking:.1e} m/s, penetration {rest.penetration:.1e} m"
    return f"{'yes' if tuned.rests else 'no'}: {moves}, vibration {rest.vibration:.1e} m/s"


def _slope(tuned: Tuned) -> dict[str, str]:
    drift = tuned.passivity.slope_drift
    return {} if math.isnan(drift) else {"holds on 10 degrees": f"drift {1e3 * drift:.2g} mm/s"}


def _conditions(tuned: Tuned) -> str:
    """Gravity and friction of the launches, in words."""
    from hcbench.sim import registry

    target = tuned.target
    falls = "without gravity"
    if target.gravity:
        falls = f"gravity {target.gravity:g} m/s^2"
    slides = "frictionless and head-on"
    if registry.engine(tuned.setting.engine).keeps_friction:
        slides = "head-on; bodies keep the friction that they have"
    if target.friction:
        slides = f"friction {target.friction:g}, sliding and spinning"
    return f"{falls}, {slides}"


def _friction(result: Evaluation, target: Target) -> str:
    off = f"{_percent(result.friction_error)} of {target.friction:g} times the normal impulse"
    return f"impulse wrong by at most {off}"


def _percent(share: float) -> str:
    # Three digits below 1, and no exponent above.
    return f"{100 * share:.{'3g' if share < 1 else '0f'}} %"


def _print_interrupted(interrupt: SearchInterrupted, scene: str, as_json: bool) -> None:
    """Print the best setting when a search was interrupted; it has not been simulated.

    scene: its name, whose form decides on the text to paste.
    as_json: print JSON in place of lines.
    """
    from hcbench.terms.scene import load_scene
    from hcbench.tuning.model import snippet

    best = interrupt.best
    text = snippet(best, load_scene(scene).form)
    if as_json:
        progress_made = {
            "evaluations": interrupt.done,
            "at_most": interrupt.budget,
            "max_error_by_model": interrupt.error,
        }
        head = {"schema": 1, "engine": best.engine, "recipe": best.name, "cut_short": progress_made}
        print_json(
            {**head, "timestep_s": best.timestep, "options": dict(best.options), "paste": text}
        )
        return
    error = f"{interrupt.error:.2g} by the search's own model; not simulated yet"
    show(f"{'setting':<20}  {best.engine} {best.name}, the best so far: {interrupt}")
    show(f"{'largest error of e':<20}  {error}\n\npaste:\n")
    show_code(text)


def _as_json(answer: Answer, margin: float, gate: Passivity | None) -> dict[str, Any]:
    """The answer as `--json` prints it; None for what an exact setting, which needs no run, lacks.

    margin: of e, by the uncertainty of α.
    gate: None unless --certify asks for it.
    """
    best = answer.best
    tuned = best.tuned
    why = "exact at any step: it needs no run"
    of_run: dict[str, Any] = {
        "evaluation": None,
        "rest": None,
        "slope_drift_m_per_s": None,
        "warning": "",
        "advice": [],
    }
    if tuned is not None:
        why = tuned.why
        of_run = {
            "evaluation": dataclasses.asdict(tuned.evaluation),
            "rest": {"rests": tuned.rests, **dataclasses.asdict(tuned.rest)},
            "slope_drift_m_per_s": tuned.passivity.slope_drift,
            "warning": tuned.flaws,
            "advice": list(tuned.advice),
        }
    certificate = {}
    if gate is not None:
        certificate["certificate"] = _certificate(gate)
    return {
        "schema": 2,
        "engine": answer.engine,
        "recipe": best.setting.name,
        "kind": best.kind,
        "requested": answer.asked,
        "pair": list(answer.pair),
        "why": why,
        "target": dataclasses.asdict(answer.target),
        "timestep_s": best.setting.timestep,
        "options": dict(best.setting.options),
        **of_run,
        "notes": list(best.notes),
        "paste": best.text,
        **answer.record,
        "restitution_margin_95": margin,
        **certificate,
    }


def _certificate(gate: Passivity) -> dict[str, Any]:
    findings = [{**dataclasses.asdict(f), "passed": f.passed} for f in gate.findings]
    return {"sphere": gate.sphere, "flat": gate.flat, "findings": findings}


class _EngineOption(click.Option):
    """An option of `hcbench tune ENGINE` alone."""


class _ModelOption(click.Option):
    """An option of `hcbench tune MODEL` alone."""


_engine_option = partial(click.option, cls=_EngineOption)


@command()
@click.argument("engine", metavar="ENGINE|MODEL")
@click.argument("files", nargs=-1, metavar="[MODEL]")
@click.option(
    "--alpha",
    type=UncertainType("alpha"),
    help="α of e = 1 - α v: '0.008 s/in' or '0.31 +- 0.004 s/m'.",
)
@options("material")
@click.option("--restitution", type=RESTITUTION, help="One e for all speeds, in place of --alpha.")
@click.option(
    "--rebound",
    type=REBOUND,
    cls=_ModelOption,
    help="Rebound of a robot's centre of mass from a drop of 10 cm, such as '5 mm', in place of --alpha.",
)
@click.option(
    "--points",
    help="Pairs v:e in place of --alpha, such as '0.1:0.95, 0.5:0.85 m/s', or a CSV file.",
)
@spring_options()
@click.option("--timestep", type=STEP, help="Time step, such as '1 ms'.  [a model: its own]")
@click.option(
    "--speeds",
    type=SPEEDS,
    help="Band of impact speeds.  [default: 1:20 in/s, or that of --points]",
)
@options("target")
@click.option(
    "--gravity",
    type=ACCELERATION,
    help="Gravity into the plate; 0 for none.  [default: 9.81; a model: its own]",
)
@click.option(
    "--max-error",
    metavar="NUMBER",
    help="Exit 1 when the largest error of e is above this.  [default: none; --recipe auto aims at 0.05]",
)
@_engine_option(
    "--match",
    type=click.Choice(["restitution", "loop", "both"]),
    default="restitution",
    show_default=True,
    help="Choose the recipe by e, by the force loop, or by both.",
)
@_engine_option(
    "--recipe",
    default="auto",
    show_default=True,
    help="Recipe to use; `hcbench engines` lists them.",
)
@_engine_option(
    "--integrator",
    help="Integrator, such as RK4, where an engine has several.  [default: the recipe's]",
)
@_engine_option(
    "--scene", default="steel-plane", show_default=True, help="A scene's name or folder."
)
@_engine_option("--mass", type=MASS, help="Effective mass.  [default: the scene's]")
@_engine_option("--stiffness", help="k of the law, N/m^n or with units.  [default: the scene's]")
@_engine_option("--exponent", type=EXPONENT, help="n of the law.  [default: the scene's]")
@_engine_option(
    "--friction",
    type=FRICTION,
    help="Coulomb's μ of the contact, 0 for none.  [default: of two bodies of the engine]",
)
@_engine_option(
    "--corners",
    type=click.IntRange(1, int(BOUNDS["corners"][1])),
    help="Contact points that land together: 1 for balls, 4 for a box on its face.  [default: any]",
)
@output_option(
    "--write-scene", cls=_EngineOption, help="Write a file that runs in the plain engine."
)
@click.option(
    "--pair",
    multiple=True,
    help="Two names, first the one that moves: of your bodies or geoms. A model: repeatable.",
)
@_engine_option("--plugin", "kind", flag_value="exact", help="Print the exact plug-in.")
@_engine_option(
    "--settings", "kind", flag_value="settings", help="Print settings of the engine's own."
)
@_engine_option(
    "--constant", "kind", flag_value="constant", help="Print the best one e for all speeds."
)
@_engine_option(
    "--certify", is_flag=True, help="Run the whole gate on it in the plain engine: a minute."
)
@options("key", "qpos", "state", "coming_from", "actuators", cls=_ModelOption)
@click.option(
    "--strict",
    is_flag=True,
    cls=_ModelOption,
    help="Exit 1 where rest, hold, vibration or speed get worse than 1.2 times what they were.",
)
@click.option(
    "--for",
    "version",
    cls=_ModelOption,
    help="ENGINE@VERSION that has to load what is written.  [default: the installed one]",
)
@output_option("--write-model", cls=_ModelOption, help="Write the model with the setting in it.")
@output_option(
    "--write-include", cls=_ModelOption, help="Write the lines to a file that a model includes."
)
@force_option
@as_json
def tune(
    engine: str,
    files: tuple[str, ...],
    points: str | None,
    max_error: str | None,
    **options: Any,
) -> None:
    """Find settings that bounce like your material.

    ENGINE is an engine's name, tuned in a scene. MODEL is your own
    model (a file, two URDFs, or FILE.py:FUNCTION), whose pairs are tuned in it.
    """
    from hcbench.terms.units import parse_max_error
    from hcbench.tuning.ask import is_model

    limit = None if max_error is None else parse_max_error(max_error)
    options |= {"points": () if points is None else _parsed(points), "max_error": limit}
    if is_model(engine):
        from hcbench.cli.tune_model import tune_model

        _drop(options, _EngineOption, f"given with the model {engine}", "an engine's name")
        tune_model((engine, *files), **options)
    elif files:
        got = f"{files[0]!r} after the engine {engine!r}"
        raise UserError("model", got, "one engine's name, or files of models")
    else:
        _drop(options, _ModelOption, f"given with the engine {engine!r}", "a model file")
        tune_engine(engine, **options)


def _parsed(points: str) -> tuple[tuple[float, float], ...]:
    from hcbench.checking.baseline import parse_points

    return parse_points(points)


def _drop(options: dict[str, Any], others: type[click.Option], got: str, expected: str) -> None:
    """Take out the options of the other form of the command, by name.

    options: of the command, changed.
    others: class of the options to take out.
    got, expected: words for the error.
    Raises UserError for one that was given.
    """
    context = click.get_current_context()
    for option in context.command.params:
        if isinstance(option, others) and option.name:
            options.pop(option.name, None)
            if context.get_parameter_source(option.name) is ParameterSource.COMMANDLINE:
                raise UserError(option.opts[0], got, f"{expected}, to which it applies")
