"""Options that name files, and the gate that outputs pass before a command does anything."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from hcbench.system.errors import UserError
from hcbench.system.outputs import require_outputs as require_all

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
        """The path; raises UserError for an empty or a too long one."""
        slot = param.opts[0] if param else "path"
        if not str(value):
            raise UserError(slot, "an empty path", "a path", "Leave the option out for its default")
        if any(len(os.fsencode(part)) > _LONGEST_NAME for part in Path(value).parts):
            raise UserError(slot, f"{str(value)[:60]}...: file name too long", "a shorter path")
        return super().convert(value, param, ctx)


class _OutputType(PathType):
    """A file to write."""


def output_option(name: str, **settings: Any) -> Callable[..., Any]:
    """An option that names a file to write. settings: as `click.option` takes them."""
    return click.option(name, type=_OutputType(path_type=Path), **settings)


force_option = click.option(
    "--force", is_flag=True, help="Replace output files that hcbench did not write."
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
