"""hcbench tune: settings of an engine for a scene, or of the engine of a model for pairs in it."""

from __future__ import annotations

from functools import partial
from typing import Any

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
)
from hcbench.cli.help import command
from hcbench.cli.law import spring_options
from hcbench.system.errors import UserError
from hcbench.terms.bounds import BOUNDS


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
    from hcbench.cli.tune_engine import tune_engine
    from hcbench.cli.tune_model import tune_model
    from hcbench.terms.units import parse_max_error
    from hcbench.tuning.ask import is_model

    limit = None if max_error is None else parse_max_error(max_error)
    options |= {"points": () if points is None else _parsed(points), "max_error": limit}
    if is_model(engine):
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

    options: of the command, changed. others: class of the options to take out. got, expected: words
    for the error. Raises UserError for one that was given.
    """
    context = click.get_current_context()
    for option in context.command.params:
        if isinstance(option, others) and option.name:
            options.pop(option.name, None)
            if context.get_parameter_source(option.name) is ParameterSource.COMMANDLINE:
                raise UserError(option.opts[0], got, f"{expected}, to which it applies")
