"""Discards the output of a worker process."""

import ctypes
import os
import sys
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
    sys.stdout.flush()
    sys.stderr.flush()
    copies = [(fd, os.dup(fd)) for fd in (1, 2)]
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        for fd, _ in copies:
            os.dup2(null, fd)
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
        os.close(null)
