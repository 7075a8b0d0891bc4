"""The main loop that a worker process runs."""

from __future__ import annotations

import os
import pickle
import signal
from contextlib import suppress
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import NoReturn

from hcbench.workers.message import CallEnd, FirstCall, pickled, portable

_is_worker = False
# Name of this process' Interpreter.
_environment = ""


def mark_as_worker(environment: str = "") -> None:
    """Declare this process to be hcbench's own: engines then run in it, in place.

    environment: the name of the Interpreter that it was started in. To be called first thing in a
    process. It ignores Ctrl-C from then on: a terminal sends that to every process, and the parent
    decides what becomes of its workers.
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
    """Be a worker process as a copy of its parent: with nothing open of
    the parent's but a pipe's end.
    """
    null = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(null, stream)
    os.closerange(3, end.fileno())
    os.closerange(end.fileno() + 1, os.sysconf("SC_OPEN_MAX"))
    serve(end.fileno(), "", first)


def serve(handle: int, environment: str = "", first: FirstCall | None = None) -> NoReturn:
    """The main loop of a worker process: answers requests on a pipe until it closes.

    first: a module, a function of it and arguments, called before any
    request; what it raises is dropped.
    """
    mark_as_worker(environment)
    pipe = type(Pipe()[0])(handle)
    error: Exception | None = None
    # The parent has gone.
    with suppress(EOFError, OSError):
        while True:
            pipe.send_bytes(pickled(CallEnd(error)))
            if first is not None:
                (module, function, args), first = first, None
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
