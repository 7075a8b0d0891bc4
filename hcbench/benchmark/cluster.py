"""A Dask cluster as an executor: any scheduler, however its workers came to be."""

from __future__ import annotations

import logging
import math
import re
import time
from contextlib import contextmanager, suppress
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import hcbench
from hcbench.benchmark.store import GO_ON
from hcbench.system.errors import CannotRun

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import Executor

# Addresses that Dask can read: any other leaves it a client that cannot even be closed.
_ADDRESS = re.compile(r"inproc://\S+|(\w+://)?[^\s/]+:\d+")
# Seconds to wait for the scheduler, and then for its first worker.
_CONNECT_S = 10.0
_WORKERS_S = 60.0
# s between two counts of the workers: each costs an answer of the scheduler.
_COUNT_S = 1.0
_INSTALL = "pip install distributed pyarrow"


@contextmanager
def connected(address: str) -> Iterator[tuple[Executor, Callable[[], int]]]:
    """Connect to a scheduler: its executor, and a function that counts the tasks its workers run at
    once, 1 or more. The connection ends with the block.

    address: such as "tcp://host:8786".

    Raises CannotRun without Dask's package, without an answer, without a worker, where a worker has
    another hcbench, and where the scheduler or the last worker goes away.
    """
    try:
        from distributed import Client
    except ImportError:
        raise CannotRun(
            "scheduler", "Dask is not installed", "its package", f"Try: {_INSTALL}"
        ) from None
    try:
        if not _ADDRESS.fullmatch(address):
            raise ValueError("not an address with a port")
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CannotRun(
            "scheduler",
            f"{address or repr(address)} does not answer: {reason:.100}",
            "the address of a running Dask scheduler, like tcp://host:8786",
        ) from None
    with _quiet():
        try:
            _require_workers(client, address)
            yield client.get_executor(pure=False), _width(client, address)
        except Exception:
            if client.status == "running":
                raise
            got = f"{address} went away, and did not come back within {_CONNECT_S:g} s"
            raise CannotRun(
                "scheduler", got, "one that lasts as long as the sweep", GO_ON
            ) from None
        finally:
            client.close()


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence Dask's lines about a lost scheduler, and about answers to tasks that an interrupt
    cancelled: the error that is raised says it.
    """
    names = ("distributed", "distributed.client", "tornado.application")
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _width(client: Any, address: str) -> Callable[[], int]:
    """Return a function that counts the tasks the workers run at once, 1 or more, at most once in
    _COUNT_S. It raises CannotRun if there has been no worker for _WORKERS_S.
    """
    threads = 1
    counted = -math.inf
    seen = time.monotonic()

    def width() -> int:
        """The number of tasks. Raises CannotRun without a worker for _WORKERS_S."""
        nonlocal threads, counted, seen
        now = time.monotonic()
        if now - counted >= _COUNT_S:
            # Without an answer Dask connects again, or gives up and closes the client.
            with suppress(OSError):
                threads, counted = sum(client.ncores().values()), now
        # A worker that was lost may come back: for a while one task counts.
        if threads:
            seen = now
        elif now - seen >= _WORKERS_S:
            raise _without_workers(address, GO_ON)
        return max(1, threads)

    return width


def _without_workers(address: str, advice: str) -> CannotRun:
    got = f"{address} has no workers after {_WORKERS_S:g} s"
    return CannotRun("scheduler", got, "one at least", advice)


def _require_workers(client: Any, address: str) -> None:
    """Wait for a worker, and check their hcbench.

    Raises CannotRun without a worker within _WORKERS_S, and for a worker without hcbench or with
    another version.
    """
    try:
        client.wait_for_workers(1, timeout=_WORKERS_S)
    except OSError:
        # OSError is the base of TimeoutError.
        raise _without_workers(address, "Start some: `dask worker`") from None
    here = hcbench.__version__
    # In the standard library's words: a worker without hcbench can say so.
    for worker, there in client.run(version, "hcbench", on_error="return").items():
        if there != here:
            got = "no hcbench" if isinstance(there, Exception) else f"hcbench {there}"
            raise CannotRun(
                "worker", f"{worker} has {got}", f"hcbench {here}", f"On every worker: {_INSTALL}"
            )
