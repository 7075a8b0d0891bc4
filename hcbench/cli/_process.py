"""How a command ends: streams that cannot be written to, signals, mistakes under the option's own name."""

from __future__ import annotations

import functools
import io
import os
import signal
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hcbench.errors import OutputError, UserError

if TYPE_CHECKING:
    from collections.abc import Iterator

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
_LONGEST_NAME = 255  # bytes, on every common file system
_AGAIN_S = 1.0  # between two signals that count as two
# A slot that is told of under another option than its own name.
_ALSO = {"restitution": ("--restitution", "--points"), "lowest speed": ("--speeds",)}


class Interrupted(Exception):  # noqa: N818 - reads as what happened
    """Ctrl-C, as something that Click passes on without a word of its own; with what to say, if anything."""


class _Output(io.TextIOWrapper):
    """Standard output that says so when it cannot be written to."""

    def write(self, text: str, /) -> int:
        with _told():
            return super().write(text)

    def flush(self) -> None:
        with _told():
            super().flush()


class _Notes(io.TextIOWrapper):
    """Standard error: what cannot be said there is not worth failing for."""

    def write(self, text: str, /) -> int:
        with suppress(OSError):
            super().write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            super().flush()


@contextmanager
def _told() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(
            "standard output", error.strerror or str(error), "one that can be written to"
        ) from None


def take_streams() -> None:
    """Make standard output tell when it fails. Raises OutputError where it is closed."""
    while (fd := os.open(os.devnull, os.O_RDWR)) <= 2:  # closed: the next file opened would be taken for it
        os.set_inheritable(fd, True)
    os.close(fd)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115 - for good
    sys.stderr = _as(_Notes, sys.stderr)
    if sys.stdout is None:
        raise OutputError("standard output", "closed", "one that can be written to")
    sys.stdout = _as(_Output, sys.stdout)


def _as(kind: type[io.TextIOWrapper], stream: Any) -> Any:
    """The same stream, of another kind, and with a way to write α where the terminal has none."""
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    encoding, lines, through = stream.encoding, stream.line_buffering, stream.write_through
    return kind(stream.detach(), encoding, "backslashreplace", None, lines, through)


def leave_streams() -> None:
    """Let go of what could not be written, so that the interpreter does not try again."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except (OSError, OutputError, ValueError):
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def take_signals() -> None:
    """TERM and HUP end a command as Ctrl-C does: nothing is left half-written. Ignored ones stay ignored."""
    last = -_AGAIN_S

    def interrupt(number: int, frame: object) -> None:
        nonlocal last
        before, last = last, time.monotonic()
        if last - before >= _AGAIN_S:  # one press may come as several, while what is running is being ended
            raise KeyboardInterrupt

    for name in _SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:  # as under nohup
            signal.signal(number, interrupt)


def ending_well(command: click.Command) -> click.Command:
    """The command, whose mistakes name the option that was given, and whose interrupts are ours to tell."""
    inner = command.callback
    assert inner is not None

    @functools.wraps(inner)
    def outer(*args: Any, **kwargs: Any) -> Any:
        try:
            return inner(*args, **kwargs)
        except UserError as error:
            if (option := _option_of(error.slot, click.get_current_context())) is None:
                raise
            raise type(error)(option, error.got, error.expected, error.todo) from error
        except KeyboardInterrupt:
            raise Interrupted from None
        except BrokenPipeError:  # the reader of our output went away, as `head` does; Click would exit with 1
            return 0

    command.callback = outer
    return command


def _option_of(slot: str, context: click.Context) -> str | None:
    """The option of the command line that a slot is about; None where none was given."""
    given = {
        name
        for parameter in context.command.params
        if parameter.name
        and context.get_parameter_source(parameter.name) is click.core.ParameterSource.COMMANDLINE
        for name in parameter.opts
    }
    names = _ALSO.get(slot, ("--" + slot.replace("_", "-"),))
    return next((name for name in names if name in given), None)


def path_type(**options: Any) -> click.Path:
    """A path: "" is none, and not the working directory; nor is what no disk takes."""
    return _OutPath(**options)


class _OutPath(click.Path):
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        slot = param.opts[0] if param else "path"
        if not str(value):
            raise UserError(slot, "an empty path", "a path", "Leave the option out for its default")
        if any(len(os.fsencode(part)) > _LONGEST_NAME for part in Path(value).parts):
            raise UserError(slot, f"{str(value)[:60]}...: file name too long", "a shorter path")
        return super().convert(value, param, ctx)
