"""The command as a process: streams that cannot be written to, signals,
mistakes under the option's name.
"""

import functools
import io
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import click

from hcbench.cli.console import require_outputs
from hcbench.system.errors import HcbenchError, OutputError
from hcbench.system.files import SIGNALS

# Signals within this time count as one, s.
_REPEAT_S = 1.0
# Windows has no SIGALRM. The time until the signal comes again is in s.
_AGAIN = getattr(signal, "SIGALRM", None)
_AGAIN_S = 0.02
# An interrupt waits so long at most for the end of an import, s.
_DEFERRED_S = 0.5
# Slots that belong to options of another name.
_OPTIONS = {
    "lowest speed": ("--speeds",),
    "speed": ("--speed", "--speeds"),
    "coming-from": ("--from",),
    "model": ("--python",),
    "output folder": ("--out",),
    "folder": ("--out",),
}


class _Stream(io.TextIOWrapper):
    """A standard stream. Where one that is `required` cannot be written to, that is an OutputError."""

    required: bool

    @contextmanager
    def _checked(self) -> Iterator[None]:
        """Pass over errors of writing within the block, or, where the stream is required, raise
        OutputError for them; BrokenPipeError stays as it is, for a reader that has seen enough.
        """
        try:
            yield
        except OSError as error:
            if self.required and isinstance(error, BrokenPipeError):
                raise
            if self.required:
                got = error.strerror or str(error)
                raise OutputError("standard output", got, "one that can be written to") from None

    def write(self, text: str, /) -> int:
        with self._checked():
            super().write(text)
        return len(text)

    def flush(self) -> None:
        with self._checked():
            super().flush()


def wrap_stdio() -> None:
    """Make standard output fail with OutputError, here where it is closed,
    and standard error not at all.
    """
    # If one of the three is closed, the next file opened would get its number and its output.
    while (fd := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(fd, True)
    os.close(fd)
    if sys.stderr is None:
        sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - for good
    sys.stderr = _wrap(sys.stderr, required=False)
    if sys.stdout is None:
        raise OutputError("standard output", "closed", "one that can be written to")
    sys.stdout = _wrap(sys.stdout, required=True)


def _wrap(stream: Any, required: bool) -> Any:
    """The same stream, checked, and with a way to write α where the terminal has none.

    stream: standard output or error; returned as it is unless it is a TextIOWrapper.
    required: whether a failed write to it is an error.
    """
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    encoding = stream.encoding
    lines = stream.line_buffering
    through = stream.write_through
    wrapped = _Stream(stream.detach(), encoding, "backslashreplace", None, lines, through)
    wrapped.required = required
    return wrapped


def flush_stdio() -> None:
    """Write the rest of standard output; what cannot be written is dropped.

    Errors no longer matter here. But the interpreter tries again when it exits, and from Python
    3.13 on prints what went wrong.
    """
    if not isinstance(sys.stdout, _Stream):
        return
    sys.stdout.required = False
    try:
        io.TextIOWrapper.flush(sys.stdout)
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


class _Interrupts:
    """The signals that end a command, as KeyboardInterrupt.

    came: whether one has.

    _last: when a signal came last.
    _begin: when the last that counts did, s of time.monotonic.
    """

    came: bool = False
    _last: float = -_REPEAT_S
    _begin: float = 0.0

    def on_signal(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt, but not within an import, where a package would report it as a
        missing module: then the signal comes again a little later.

        number: of the signal.
        frame: what was running. A signal that comes within _REPEAT_S of the one before counts as
        one with it.
        """
        now = time.monotonic()
        # SIGALRM is one that waited, and comes again.
        if number != _AGAIN:
            before = self._last
            self._last = now
            if now - before < _REPEAT_S:
                # One press may come as several signals while what is running is being ended.
                return
            self.came = True
            self._begin = now
        if _AGAIN is not None and now - self._begin < _DEFERRED_S and _is_importing(frame):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
        else:
            raise KeyboardInterrupt

    def on_ignored(self, ignored: Any) -> None:
        """Send an interrupt again that Python ignored because it came in __del__ or a weak
        reference's callback.
        """
        if _AGAIN is not None and isinstance(ignored.exc_value, KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
        else:
            sys.__unraisablehook__(ignored)


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None and not frame.f_code.co_filename.startswith("<frozen importlib"):
        frame = frame.f_back
    return frame is not None


INTERRUPTS = _Interrupts()


def install_signal_handlers() -> None:
    """TERM and HUP end a command as Ctrl-C does: nothing is left
    half-written. Ignored ones stay ignored.
    """
    sys.unraisablehook = INTERRUPTS.on_ignored
    # The other signals set SIGALRM.
    for name in ("SIGALRM", *SIGNALS):
        number = getattr(signal, name, None)
        # A command under nohup ignores SIGHUP, and must go on to do so.
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, INTERRUPTS.on_signal)


def ignore_signals() -> None:
    """Ignore signals in the last moments of a command that has done its work: its exit code stays."""
    if _AGAIN is not None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    for name in ("SIGALRM", *SIGNALS):
        if (number := getattr(signal, name, None)) is not None:
            signal.signal(number, signal.SIG_IGN)


def translate_errors(command: click.Command) -> click.Command:
    """The command, with mistakes named by the option that was given, and
    Ctrl-C as a silent click.Abort.
    """
    inner = command.callback
    assert inner is not None

    @functools.wraps(inner)
    def outer(*args: Any, **kwargs: Any) -> Any:
        """Run the command; return its exit code, or None for 0. HcbenchErrors are raised under the
        name of the option; click.Abort for Ctrl-C.
        """
        try:
            require_outputs(click.get_current_context())
            return inner(*args, **kwargs)
        except HcbenchError as error:
            # In place: an error may carry more than its message.
            if (option := _option_of(error.slot, click.get_current_context())) is not None:
                HcbenchError.__init__(error, option, error.got, error.expected, error.advice)
            raise
        except KeyboardInterrupt:
            # Click would print an empty line for this.
            raise click.Abort from None
        except BrokenPipeError:
            # The reader of our output went away, as `head` does; Click would exit with 1.
            return 0

    command.callback = outer
    return command


def _option_of(slot: str, context: click.Context) -> str | None:
    """Find the option that the slot of an error is about; None where the user typed none that it
    may be about.

    slot: name of an argument, such as "max_error".
    context: of the command that runs.
    """
    given: set[str] = set()
    for parameter in context.command.params:
        if not parameter.name:
            continue
        source = context.get_parameter_source(parameter.name)
        if source is click.core.ParameterSource.COMMANDLINE:
            given.update(parameter.opts)
    names = _OPTIONS.get(slot, ("--" + slot.replace("_", "-"),))
    return next((name for name in names if name in given), None)
