"""Options, their types and JSON, shared by the commands; and what they print: lines, code to paste,
and progress on a terminal.
"""

from __future__ import annotations

import math
import os
import re
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from shlex import quote
from typing import Any, get_args

import click

from hcbench.system.errors import UserError
from hcbench.system.files import json_text
from hcbench.system.outputs import require_outputs as require_all
from hcbench.system.text import COLUMNS, sanitized
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

        value: as typed.
        Raises UserError for an empty path, one with a part that is too long, and one that Click
        refuses.
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
    """An option that names a file to write.

    settings: as `click.option` takes them.
    """
    return click.option(name, type=_OutputType(path_type=Path), **settings)


force_option = click.option(
    "--force",
    is_flag=True,
    help="Replace output files that hcbench did not write, or that you changed.",
)


def require_outputs(context: click.Context) -> None:
    """Raise UserError or OutputError for an output that would replace an input, or a file that
    hcbench did not write.

    context: of the command that runs, with its options.
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
    """Decorator that adds options, by their names in `hcbench.terms.options`.

    cls: the class of each.

    Raises KeyError for an unknown name.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        """The command with these options, in the order of their names."""
        # The decorator that is applied last is the first in a help.
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


def typed_again(options: Mapping[str, Any], names: Sequence[str]) -> str:
    """The options of these names that were given, as a command takes them, each with a space before
    it.

    options: values by names of `hcbench.terms.options`; those that it lacks were not given.
    """
    words = ""
    for name in names:
        option = OPTIONS[name]
        value = options.get(name, option.default)
        if value is False:
            words += f" --no-{option.flag}"
        elif value != option.default:
            words += f" --{option.flag} {quote(str(value))}"
    return words


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

    quantity: a name in `units.QUANTITIES`.
    several: whether a list or a range is read, as an array.
    positive: whether only values above 0 will do.
    least: the lowest value that will do, SI.
    """

    def __init__(
        self,
        quantity: str,
        *,
        several: bool = False,
        positive: bool = False,
        least: float = -math.inf,
    ) -> None:
        """Keep what the class names; `least`, SI, and `positive` become bounds for `units.parse`."""
        self.quantity = quantity
        self.several = several
        self.name = _KINDS.get(quantity, "quantity") + ("s" if several else "")
        self.bounds = {"above": 0.0 if positive else -math.inf, "least": least}

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The quantity of a text, in SI: a float, or an array for several.

        Raises QuantityError, which names the option, for a text that is not a quantity or outside
        the bounds.
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
    """The option --beyond-bounds. Click reads it before all others, so that it admits their values
    whatever their size.
    """

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


# Output for a person at a terminal: lines of at most 100 columns, verdicts in colour, progress.

WIDTH = COLUMNS
_COLOURS = {
    "PASSED": "green",
    "MEASURED": "cyan",
    "FAILED": "red",
    "MISTAKE": "yellow",
    "COULD NOT RUN": "red",
}
_VERDICT = re.compile(rf"^({'|'.join(_COLOURS)})\b", re.MULTILINE)
# The text before the value in a line `name   value`.
_NAME = re.compile(r"\S.*?\s{2,}(?=\S)")
# A call without texts, which may be broken after its commas.
_CALL = re.compile(r"\s*[\w.]+\([^'\"#]*\)")
# Seconds of silence after which hcbench names its work.
_AFTER_S = 0.5


def show(text: str) -> None:
    """Print a text: lines folded to 100 columns, and verdicts in colour unless NO_COLOR is set.

    Characters that move a cursor, as a model's names may have them, are each a "?".
    """
    lines = "\n".join(folded([sanitized(line, len(line)) for line in text.split("\n")]))
    print(_VERDICT.sub(_coloured, lines) if has_colour() else lines)


def show_code(text: str) -> None:
    """Print lines of a text to paste: long tags are broken between attributes, long calls after
    commas.
    """
    for line in text.split("\n"):
        lines: Iterable[str] = [line]
        if len(line) > WIDTH:
            if line.lstrip().startswith("<"):
                lines = _folded_tag(line)
            elif _CALL.fullmatch(line):
                lines = _folded_call(line)
        print("\n".join(lines))


def has_colour() -> bool:
    """Say whether standard output is a terminal that may have colour (https://no-color.org)."""
    return (
        sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    )


def _coloured(match: re.Match[str]) -> str:
    return click.style(match[1], fg=_COLOURS[match[1]], bold=True)


def folded(lines: list[str]) -> Iterator[str]:
    """The lines, those of more than 100 columns broken: commands by
    backslashes, tags between attributes.
    """
    for line in lines:
        if len(line) <= WIDTH:
            yield line
        elif re.match(r"\s*(hcbench|next:) ", line):
            yield from _folded_command(line)
        elif re.match(r"\s*<", line):
            yield from _folded_tag(line)
        else:
            yield from textwrap.wrap(
                line, WIDTH, subsequent_indent=_indent_after(line), break_long_words=False,
                break_on_hyphens=False, drop_whitespace=True, replace_whitespace=False,
            )  # fmt: skip


def _indent_after(line: str) -> str:
    """Spaces before the second and later parts of a long line of words: under the value of a
    `name   value`, two more than before the first part of an item, else as many as there.
    """
    name = _NAME.match(line)
    if name is not None and name.end() <= WIDTH // 2:
        return " " * name.end()
    lead = len(line) - len(line.lstrip())
    is_item = lead > 0 or re.match(r"- |[\w ,:.-]+: ", line) is not None
    if is_item:
        lead += 2
    return " " * lead


def _folded_command(line: str) -> Iterator[str]:
    """Broken before options, so that a shell reads one command."""
    *lines, last = _joined(re.split(r" (?=--)", line), line, " ", room=2)
    yield from (f"{each} \\" for each in lines)
    yield last


def _folded_tag(line: str) -> Iterator[str]:
    """Broken before attributes, which XML allows; a comment between words."""
    return _joined(re.split(r" (?=\S)" if "<!--" in line else r" (?=[\w:]+=\")", line), line, " ")


def _folded_call(line: str) -> Iterator[str]:
    """Broken after commas within the brackets of a call."""
    return _joined(re.split(r"(?<=,) ", line), line, " ")


def _joined(parts: list[str], line: str, by: str, room: int = 0) -> Iterator[str]:
    """Fill lines with parts, joined by `by`; all but the first line are indented by four more than
    `line` is.

    line: from which the parts are.
    room: columns to leave free. The indent is less where the longest part would not fit; a part
    that is longer than the terminal stays too long.
    """
    longest = max(map(len, parts[1:]), default=0)
    lead = " " * max(0, min(len(line) - len(line.lstrip()) + 4, WIDTH - room - longest))
    now = parts[0]
    for part in parts[1:]:
        if len(now) + len(by) + len(part) > WIDTH - room:
            yield now
            now = f"{lead}{part}"
        else:
            now = f"{now}{by}{part}"
    yield now


@contextmanager
def status(what: str) -> Iterator[None]:
    """Show within the block, on a terminal, a line with the work and the seconds that it takes.

    what: the work, in words. Without a terminal nothing is shown. A thread writes the line, by the
    system's own call: it holds no lock that a fork of this process could miss.
    """
    if not sys.stderr.isatty():
        yield
        return
    over = threading.Event()
    begin = time.monotonic()

    def write() -> None:
        wait = _AFTER_S
        while not over.wait(wait):
            os.write(2, f"\r{what} ... {time.monotonic() - begin:.0f} s".encode())
            wait = 1.0

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    try:
        yield
    finally:
        over.set()
        writer.join()
        os.write(2, b"\r\x1b[K")


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on stderr with rate and time left, on a terminal; yields `tick(done, total)`.

    what: is under way, in words, beside the bar. At 100 % the bar becomes indeterminate, since
    writing takes time too. Without a terminal `tick` does nothing.
    """
    # Asked before the import of Rich, which takes a while and takes more kinds of output for
    # terminals.
    if not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done, total: None
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[count]}"),
        TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True, speed_estimate_period=120.0) as bar:
        task = bar.add_task(what, total=None, rate="", count="")
        # When the first call came, s of time.monotonic, and how much was done then.
        begin: float | None = None
        done_before = 0

        def tick(done: int, total: int) -> None:
            """Move the bar to `done` of `total`; the rate is that since the first call."""
            nonlocal begin, done_before
            if begin is None:
                begin = time.monotonic()
                done_before = done
            elapsed = time.monotonic() - begin
            new = done - done_before
            rate = f"{new / elapsed:,.0f}/s" if new else ""
            bar.update(task, completed=done, total=total, count=f"{done}/{total}", rate=rate)
            if done >= total:
                bar.update(task, description=f"{what}: putting together", rate="")
                # A bar without a total moves from end to end.
                bar.tasks[0].total = None

        yield tick
