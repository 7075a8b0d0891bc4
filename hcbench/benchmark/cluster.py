"""A Dask cluster as an executor: any scheduler, however its workers came to be."""

from __future__ import annotations

import re
from contextlib import contextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import hcbench
from hcbench.errors import CannotRun

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import Executor

# As Dask reads them; what it cannot read leaves it a client that cannot even be closed.
_ADDRESS = re.compile(r"inproc://\S+|(\w+://)?[^\s/]+:\d+")
_CONNECT_S, _WORKERS_S = 10.0, 60.0
_INSTALL = "pip install distributed pyarrow"


@contextmanager
def connected(address: str) -> Iterator[tuple[Executor, Callable[[], int]]]:
    """The executor behind a scheduler's address, and how many tasks its workers run at once.

    Raises CannotRun without an answer, without a worker, and where a worker has another hcbench.
    """
    try:
        from distributed import Client
    except ImportError:
        raise CannotRun("scheduler", "Dask is not installed", "its package", f"Try: {_INSTALL}") from None
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
    try:
        _require_workers(client, address)
        yield client.get_executor(pure=False), lambda: max(1, sum(client.ncores().values()))
    finally:
        client.close()


def _require_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_WORKERS_S)
    except OSError:  # a timeout is one
        raise CannotRun(
            "scheduler",
            f"{address} has no workers after {_WORKERS_S:g} s",
            "one at least",
            "Start some: `dask worker`",
        ) from None
    here = hcbench.__version__
    # In the standard library's words: a worker without hcbench can say so.
    for worker, there in client.run(version, "hcbench", on_error="return").items():
        if there != here:
            got = "no hcbench" if isinstance(there, Exception) else f"hcbench {there}"
            raise CannotRun(
                "worker", f"{worker} has {got}", f"hcbench {here}", f"On every worker: {_INSTALL}"
            )
