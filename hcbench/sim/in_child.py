"""Runs what would change an engine's world in a forked copy of this process: the world here stays as it is.

For engines that cannot be put back: Bullet keeps contacts that its own restoreState does not take away.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar, final

from hcbench.errors import EngineFailed
from hcbench.sim.world import Record, Simulation

if TYPE_CHECKING:
    from hcbench.sim.world import Flags

Answer = TypeVar("Answer")

AVAILABLE = sys.platform == "linux"  # elsewhere libraries that draw may not survive a fork
_SET_PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)


class _Fork:
    """A forked child that answers calls of one function until it is closed."""

    def __init__(self, make: Callable[[], Callable[[Any], Any]]) -> None:
        self._pipe, end = Pipe()
        parent = os.getpid()
        self._child = os.fork()
        if not self._child:
            _serve(parent, self._pipe, end, make)
        end.close()

    def ask(self, request: Any) -> Any:
        """What the function returns in the child. Raises what it raises, EngineFailed if the child dies."""
        try:
            self._pipe.send(request)
            error, answer = self._pipe.recv()
        except (EOFError, OSError):
            code = os.waitstatus_to_exitcode(self._wait())
            got = f"crashed with {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
            raise EngineFailed("model", f"the engine's process {got}", "a model that runs") from None
        if error is not None:
            raise error
        return answer

    def close(self) -> None:
        """End the child."""
        self._pipe.close()
        if self._child:
            with suppress(ProcessLookupError):
                os.kill(self._child, signal.SIGKILL)
            self._wait()

    def _wait(self) -> int:
        child, self._child = self._child, 0
        return os.waitpid(child, 0)[1]


def _serve(parent: int, pipe: Connection, end: Connection, make: Callable[[], Any]) -> NoReturn:
    """Answer requests until the parent is gone; only os._exit leaves, as this is a copy of its program."""
    try:
        ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
        pipe.close()
        answer = None
        while os.getppid() == parent:
            request = end.recv()
            try:
                answer = answer or make()
                end.send((None, answer(request)))
            except Exception as error:
                end.send((error, None))
    finally:
        os._exit(0)


def run_forked(function: Callable[[], Answer]) -> Answer:
    """What `function()` returns, run in a forked copy of this process."""
    fork = _Fork(lambda: lambda _: function())
    try:
        answer: Answer = fork.ask(None)
    finally:
        fork.close()
    return answer


@final
class ForkedSimulation(Simulation):
    """A simulation of one launch, released and advanced in a forked copy of this process."""

    def __init__(self, release: Callable[[], Simulation]) -> None:
        self._fork = _Fork(lambda: release().advance)

    def advance(self, steps: int) -> Record:
        """As the simulation's own."""
        record: Record = self._fork.ask(steps)
        return record

    def keep(self, which: Flags) -> None:
        """There is one launch only."""

    def close(self) -> None:
        """End the copy."""
        self._fork.close()
