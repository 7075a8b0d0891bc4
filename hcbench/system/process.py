"""This process: whether it runs a command of hcbench, and a bound on the memory that it takes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

# Flags of what runs hcbench: its own command line, or a program in Python.

# This process runs a command of hcbench, so that all its resources are hcbench's own.
IS_COMMAND = ContextVar("is_command", default=False)
# The user is at the command line: a message names options, `--max-error`, and
# not parameters, `max_error`.
NAMES_OPTIONS = ContextVar("names_options", default=False)


# A bound on the memory that a process takes, for files that ask for more than they can need.


@contextmanager
def memory_limit(more: int) -> Iterator[None]:
    """Hold this process to `more` bytes above what it has, within the block, where the system knows
    such a limit; elsewhere than on Linux nothing is limited.

    Beyond it Python raises MemoryError. A lower limit that the process has already stays.
    """
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except (ImportError, OSError):
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    # The first number of statm is the size of the address space, in pages.
    limits = [pages * resource.getpagesize() + more]
    limits += [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min(limits), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
