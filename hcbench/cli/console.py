"""Options, their types and JSON, shared by the commands."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import click

from hcbench.system.errors import UserError
from hcbench.system.files import json_text
from hcbench.system.outputs import require_outputs as require_all
from hcbench.terms.bounds import admit_beyond_bounds
from hcbench.terms.options import OPTIONS, Jobs, Option

# Options that name files, and the gate that outputs pass before a command does anything.

# Bytes of a name: the limit of every common file system.
_LONGEST_NAME = 255


class PathType(click.Path):
    """A path: "" is none, and not the working directory; nor is what no disk takes."""

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str | None:
        """Word for the option's value in a help text; None for an argument, which has its own name."""
        if isinstance(param, click.Argument):
            return None
        return "FILE" if self.file_okay else "FOLDER"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, or /dev/stdin for "-" where that is allowed.

        value: as typed. Raises UserError for an empty path, one with a part that is too long, and
        one that Click refuses.
        """
        slot = param.opts[0] if param else "path"
        if value == "-" and self.allow_dash:
            value = "/dev/stdin"
        if not str(value):
            raise UserError(slot, "an empty path", "a path", "Leave the option out for its default")
        if any(len(os.fsencode(part)) > _LONGEST_NAME for part in Path(value).parts):
            raise UserError(slot, f"{str(value)[:60]}...: file name too long", "a shorter path")
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            expected = "a file that can be read" if self.file_okay else "a folder"
            raise UserError(slot, error.message.rstrip("."), expected) from None


class _OutputType(PathType):
    """A file to write."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path; raises UserError as `PathType`, and for "-", whose file nobody means."""
        if value == "-":
            slot = param.opts[0] if param else "path"
            raise UserError(slot, "-", "a file", "/dev/stdout is standard output")
        return super().convert(value, param, ctx)


def output_option(name: str, **settings: Any) -> Callable[..., Any]:
    """An option that names a file to write. settings: as `click.option` takes them."""
    return click.option(name, type=_OutputType(path_type=Path), **settings)


force_option = click.option(
    "--force",
    is_flag=True,
    help="Replace output files that hcbench did not write, or that you changed.",
)


def require_outputs(context: click.Context) -> None:
    """Raises UserError or OutputError for an output that would replace an
    input or what is not hcbench's.
    """
    outputs: dict[str, Path] = {}
    inputs: list[object] = []
    for parameter in context.command.params:
        value = context.params.get(parameter.name or "")
        if not isinstance(parameter.type, _OutputType):
            inputs.append(value)
        elif value is not None:
            outputs[parameter.opts[0]] = value
    require_all(outputs, inputs, context.params.get("force", False))


CORES = os.cpu_count() or 1

as_json = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
jobs_option = click.option(
    "--jobs",
    "-j",
    type=click.IntRange(min=get_args(Jobs)[1].least),
    default=CORES,
    help="Worker processes.  [default: one a core]",
)


device_option = click.option(
    "--device",
    type=click.Choice(["cpu", "gpu"]),
    help="Where engines on JAX and Warp compute, up to a million impacts in one batch.",
)


def options(
    *names: str, cls: type[click.Option] = click.Option
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator that adds options, by their names in
    `hcbench.terms.options`. cls: the class of each.

    Raises KeyError for an unknown name.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for name in reversed(names):
            option = OPTIONS[name]
            flag = f"--{option.flag}"
            if option.default is True:
                flag += f"/--no-{option.flag}"
            kind: Any = _choice(option)
            metavar = option.takes or None
            if option.takes == "FILE":
                kind = PathType(path_type=Path, dir_okay=False)
                metavar = None
            add = click.option(
                flag,
                name,
                cls=cls,
                type=kind,
                metavar=metavar,
                default=option.default,
                show_default=bool(option.choices),
                help=option.help,
            )
            command = add(command)
        return command

    return decorate


def _choice(option: Option) -> click.Choice[str] | None:
    return click.Choice(option.choices) if option.choices else None


def model_source(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add what opens a model: its files or a function of Python, the engine, and the time limit."""
    python = click.option(
        "--python", metavar="FILE:FUNCTION", help="Use the model that this function returns."
    )
    models = click.argument("models", nargs=-1, type=PathType())
    return models(python(options("engine", "limit")(command)))


# Words by which a help names the values of an option.
_KINDS = {
    "speed": "speed",
    "time": "time",
    "timestep": "time",
    **dict.fromkeys(("restitution", "friction", "exponent", "number"), "number"),
}


class QuantityType(click.types.StringParamType):
    """A number with or without a unit as a float in SI, or several,
    such as "1:20 in/s", as an array.

    quantity: a name in `units.QUANTITIES`. positive: whether only
    values above 0 will do. least: SI.
    """

    def __init__(
        self,
        quantity: str,
        *,
        several: bool = False,
        positive: bool = False,
        least: float = -math.inf,
    ) -> None:
        self.quantity = quantity
        self.several = several
        self.name = _KINDS.get(quantity, "quantity") + ("s" if several else "")
        self.bounds = {"above": 0.0 if positive else -math.inf, "least": least}

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The quantity of a text, in SI: a float, or an array for several.

        Raises QuantityError, which names the option, for a text that is none or outside the bounds.
        """
        from hcbench.terms import units

        slot = param.opts[0] if param else ""
        if self.several:
            return units.parse_values(value, self.quantity, slot, **self.bounds)
        return units.parse(value, self.quantity, slot, **self.bounds)


class UncertainType(click.types.StringParamType):
    """A number with or without a unit and a standard uncertainty, such as
    "0.31 +- 0.004 s/m": both in SI.
    """

    def __init__(self, quantity: str, *, above: float = -math.inf) -> None:
        self.quantity = quantity
        self.above = above
        self.name = _KINDS.get(quantity, "quantity")

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Read the text as (value, standard uncertainty); QuantityError names the option."""
        from hcbench.terms import units

        return units.parse_uncertain(
            value, self.quantity, param.opts[0] if param else "", above=self.above
        )


EXPONENT = QuantityType("exponent")
RESTITUTION = QuantityType("restitution")
REBOUND = QuantityType("length", least=0.0)
FRICTION = QuantityType("friction")
ALPHA = QuantityType("alpha")
ALPHAS = QuantityType("alpha", several=True)
SPEED = QuantityType("speed")
SPEEDS = QuantityType("speed", several=True, positive=True)
TIME = QuantityType("timestep")
STEP = QuantityType("timestep", positive=True)
ACCELERATION = QuantityType("acceleration")
MASS = QuantityType("mass", positive=True)


def beyond_bounds_option() -> click.Option:
    """Read before all other options, whose values it admits."""

    def admit(_: click.Context, __: click.Parameter, given: bool) -> None:
        if given:
            admit_beyond_bounds()

    words = "Accept numbers that look like wrong units to hcbench."
    return click.Option(
        ["--beyond-bounds"],
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=admit,
        help=words,
    )


def print_json(content: Any) -> None:
    """JSON with null for what is not a finite number."""
    print(json_text(content), end="")
