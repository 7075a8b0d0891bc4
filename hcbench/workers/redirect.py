"""Discards or collects the output of a worker process."""

import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any


# Opening the library takes as long as three launches.
@cache
def _c() -> Any:
    return ctypes.CDLL(None)


@contextmanager
def redirect_output() -> Iterator[None]:
    """Discard what is printed, also by C code.

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
    """Let standard output and standard error go to an open file."""
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
