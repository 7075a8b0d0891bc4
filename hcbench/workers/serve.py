"""The main loop that a worker process runs."""

from __future__ import annotations

import copyreg
import ctypes
import io
import os
import pickle
import signal
import sys
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn

from hcbench.system.errors import EngineFailed, HcbenchError, typed

# Messages between a worker process and its parent, which may run different versions of Python.

# Default of Python 3.11, the oldest that may be at the other end.
_PROTOCOL = 4
# A module, a function of it, and arguments.
FirstCall = tuple[str, str, tuple[Any, ...]]


@dataclass(frozen=True, slots=True)
class CallEnd:
    """Message of a worker after the results of a request."""

    error: Exception | None


def pickled(value: Any) -> bytes:
    """The bytes of a value, which `pickle.loads` of every Python from 3.11 on reads.

    Raises what pickle raises for a value that it cannot take.
    """
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer, _PROTOCOL)
    # Paths cross as text: Python 3.13 has their class in a module that others lack.
    pickler.dispatch_table = {**copyreg.dispatch_table, type(Path()): _reduced}
    pickler.dump(value)
    return buffer.getvalue()


def _reduced(path: Path) -> tuple[Any, tuple[str]]:
    return as_path, (str(path),)


def as_path(text: str) -> Path:
    """The path as this Python has it."""
    return Path(text)


def portable(error: Exception) -> Exception:
    """An error that the parent can read: one of Python's own or of hcbench as it is, any other as
    an EngineFailed with its type and text.

    Python's own get their traceback as a note, since a traceback does not cross. Other packages'
    errors do not cross: to read one, the parent would have to import the engine.
    """
    package = type(error).__module__.partition(".")[0]
    if package not in ("builtins", "hcbench"):
        return EngineFailed("engine", typed(error), "")
    if not isinstance(error, HcbenchError):
        error.add_note("".join(traceback.format_exception(error)))
    return error


# Discards or collects the output of a worker process.


# Opening the library takes as long as three launches.
@cache
def _c() -> Any:
    return ctypes.CDLL(None)


@contextmanager
def redirect_output() -> Iterator[None]:
    """Discard what is printed within the block, also by C code.

    It concerns all threads, so it is for worker processes.
    """
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        with _redirected(null):
            yield
    finally:
        os.close(null)


@contextmanager
def captured_output() -> Iterator[list[str]]:
    """Collect the lines that are printed, also by C code; they are in the list after the block.

    It concerns all threads, so it is for worker processes.
    """
    lines: list[str] = []
    with tempfile.TemporaryFile() as file:
        try:
            with _redirected(file.fileno()):
                yield lines
        finally:
            file.seek(0)
            lines += file.read().decode(errors="replace").splitlines()


@contextmanager
def _redirected(target: int) -> Iterator[None]:
    """Let standard output and standard error go to an open file within the block.

    target: its descriptor; it stays open.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    copies = [(fd, os.dup(fd)) for fd in (1, 2)]
    try:
        for fd, _ in copies:
            os.dup2(target, fd)
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        # C keeps a buffer of its own.
        with suppress(OSError, TypeError, AttributeError):
            _c().fflush(None)
        for fd, copy in copies:
            os.dup2(copy, fd)
            os.close(copy)


_is_worker = False
# Name of this process' Interpreter.
_environment = ""


def mark_as_worker(environment: str = "") -> None:
    """Declare this process to be hcbench's own: engines then run in it, in place.

    To be called first thing in a process. It ignores Ctrl-C from then on: a terminal sends that to
    every process, and the parent decides what becomes of its workers.

    environment: the name of the environment that it was started in; "" for the user's own.
    """
    global _is_worker, _environment
    _is_worker, _environment = True, environment
    # In another thread than the main one: then interrupts do not come here anyway.
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def in_worker() -> bool:
    """Say whether this process is a worker that hcbench started."""
    return _is_worker


def environment() -> str:
    """The name of the environment that this worker process was started in; "" for the user's own."""
    return _environment


def serve_forked(end: Connection, first: FirstCall | None) -> None:
    """Be a worker process as a copy of its parent, until the pipe closes; it never returns.

    Of what the parent has open, the copy keeps the pipe's end alone: another worker then sees its
    own pipe close where the parent ends.
    first: as for `serve`.
    """
    null = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(null, stream)
    os.closerange(3, end.fileno())
    os.closerange(end.fileno() + 1, os.sysconf("SC_OPEN_MAX"))
    serve(end.fileno(), "", first)


def serve(handle: int, environment: str = "", first: FirstCall | None = None) -> NoReturn:
    """The main loop of a worker process: answers requests on a pipe until it closes, and ends the
    process then.

    A request is a pickled (folder, function, arguments). The answer is each value that the function
    yields, then a `CallEnd` with what it raised; the first `CallEnd` says that the process is up.

    handle: descriptor of the pipe's end.
    environment: name of its Interpreter, "" for the user's.
    first: a module, a function of it and arguments, called before any request; what it raises is
    dropped.
    """
    mark_as_worker(environment)
    # The class of a pipe's end differs between systems.
    pipe = type(Pipe()[0])(handle)
    # Of the last request; None for the message that the process is up.
    error: Exception | None = None
    # Raised where the parent has gone.
    with suppress(EOFError, OSError):
        while True:
            pipe.send_bytes(pickled(CallEnd(error)))
            if first is not None:
                module, function, args = first
                first = None
                with suppress(Exception):
                    getattr(import_module(module), function)(*args)
            request = pipe.recv_bytes()
            try:
                folder, function, args = pickle.loads(request)
                # The parent's folder: relative paths mean the same here.
                os.chdir(folder)
                for result in function(*args):
                    pipe.send_bytes(pickled(result))
                error = None
            except Exception as raised:
                error = portable(raised)
    os._exit(0)
