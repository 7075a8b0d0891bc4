"""The command line: the only place that prints or exits.

Exit codes: 0 done, 1 a limit was exceeded, 2 a mistake in what was given, 3
could not run, 130 interrupted.
"""

from __future__ import annotations

import atexit
import errno
import gc
import os
import sys
import warnings
from contextlib import suppress

import click
from click.shell_completion import shell_complete

from hcbench.cli._process import (
    INTERRUPTS,
    flush_stdio,
    ignore_signals,
    install_signal_handlers,
    translate_errors,
    wrap_stdio,
)
from hcbench.cli.cases import cases
from hcbench.cli.check import check, land, measure, pairs
from hcbench.cli.console import beyond_bounds_option
from hcbench.cli.engines import engines, plugin
from hcbench.cli.fit import fit
from hcbench.cli.help import START, VARIABLE, completion, described, docs, group
from hcbench.cli.law import convert, law, materials
from hcbench.cli.randomize import randomize
from hcbench.cli.report import paper, report, sweep
from hcbench.cli.tune import tune
from hcbench.system.errors import LONGEST, HcbenchError, UserError
from hcbench.system.process import IS_COMMAND, NAMES_OPTIONS
from hcbench.system.text import sanitized
from hcbench.terms.bounds import beyond_bounds

_INTERRUPTED = "interrupted; nothing was left half-written"
_INTERRUPTED_CODE = 130
# Characters of a file's name in a line, at most.
_LONGEST = 80


@group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}, epilog=START
)
@click.version_option(package_name="hcbench", message="hcbench %(version)s")
def app() -> None:
    """Measure how physics engines really bounce, against the Hunt-Crossley law.

    Quantities take units ('0.008 s/in', '16 in/s', '1 lb'); plain numbers are SI.
    """


COMMANDS = (
    law, fit, materials, tune, randomize, pairs, measure, land, check, convert, report, sweep, paper, cases,
    engines, plugin, docs, completion,
)  # fmt: skip
for command in COMMANDS:
    command.params.append(beyond_bounds_option())
    app.add_command(described(translate_errors(command)))


def main() -> None:
    """Run the command line; every way out is an exit code and at most one line."""
    try:
        IS_COMMAND.set(True)
        install_signal_handlers()
        # A notebook sets its own backend; here figures are files.
        os.environ.pop("MPLBACKEND", None)
        warnings.formatwarning = lambda message, *_, **__: f"hcbench: {message}\n"
        wrap_stdio()
        code = run(sys.argv[1:])
    except HcbenchError as error:
        code = _fail(error.exit_code, str(error))
    except KeyboardInterrupt:
        code = _fail(_INTERRUPTED_CODE, _INTERRUPTED)
    ignore_signals()
    flush_stdio()
    if code == _INTERRUPTED_CODE:
        # During an import Python would end itself by the signal instead of with this code.
        atexit._run_exitfuncs()
        os._exit(code)
    # Python looks through all objects for garbage as it ends, which takes as long as a small import.
    gc.freeze()
    sys.exit(code)


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code; nothing but Ctrl-C's own signal escapes.

    arguments: words after "hcbench". Errors name options as a user types them.
    """
    token = NAMES_OPTIONS.set(True)
    try:
        with beyond_bounds(admitted=False):
            return _run(arguments)
    finally:
        NAMES_OPTIONS.reset(token)


def _run(arguments: list[str]) -> int:
    """Run a command and return its exit code; no exception leaves it, but in debugging
    (HCBENCH_DEBUG).

    arguments: words after "hcbench". Errors are printed to stderr, in one line.
    """
    try:
        # The shell sets the variable to ask for completions.
        if asked := os.environ.get(VARIABLE):
            return shell_complete(app, {}, "hcbench", VARIABLE, asked)
        # Not app(...): at Ctrl-C it prints an empty line before anything of ours is asked.
        with app.make_context("hcbench", list(arguments)) as context:
            code = app.invoke(context)
        sys.stdout.flush()
    except click.exceptions.Exit as end:
        return end.exit_code
    except HcbenchError as error:
        return _fail(error.exit_code, str(error))
    except click.exceptions.NoArgsIsHelpError as error:
        with suppress(BrokenPipeError):
            print(error.format_message(), flush=True)
        return UserError.exit_code
    except click.ClickException as error:
        hint = _hint(error)
        return _fail(
            UserError.exit_code, sanitized(error.format_message(), LONGEST - len(hint) - 3) + hint
        )
    except (KeyboardInterrupt, click.Abort) as error:
        return _fail(_INTERRUPTED_CODE, str(error) or _INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output went away, as `head` does.
        return 0
    except (OSError, MemoryError) as error:
        if os.environ.get("HCBENCH_DEBUG"):
            raise
        return _fail_on(error)
    except Exception as error:
        if os.environ.get("HCBENCH_DEBUG"):
            raise
        detail = sanitized(f"{type(error).__name__}: {error}".splitlines()[0])
        return _fail(3, f"unexpected {detail}. Set HCBENCH_DEBUG=1 for the traceback and report it")
    return code if isinstance(code, int) else 0


def _hint(error: Exception) -> str:
    context = getattr(error, "ctx", None)
    return f" Try `{context.command_path} --help`." if context else ""


def _fail_on(error: OSError | MemoryError) -> int:
    """Print the line of an error of a file or of too little memory that no command expected, and
    return the exit code: 2 for a name that is too long, else 3.
    """
    if isinstance(error, MemoryError):
        return _fail(3, "memory: not enough; expected more free memory, or a higher limit")
    name = str(error.filename or "a file")
    mistake = error.errno == errno.ENAMETOOLONG
    return _fail(
        UserError.exit_code if mistake else 3,
        f"{sanitized(name, _LONGEST)}: {error.strerror or error}",
    )


def _fail(code: int, message: str) -> int:
    """Print one line of what is wrong to stderr, and return the exit code: `code`, or that of an
    interruption if one came.
    """
    if INTERRUPTS.came and code != _INTERRUPTED_CODE:
        # Python makes a RuntimeError of what is raised while a class is
        # made, a KeyError in an import.
        code = _INTERRUPTED_CODE
        message = _INTERRUPTED
    # The exit code says it too.
    with suppress(OSError):
        print(f"hcbench: {message}", file=sys.stderr, flush=True)
    return code
