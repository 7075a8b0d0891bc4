"""Runs what would change an engine's world in a forked copy of this process:
the world here stays as it is.

For engines that cannot be put back: Bullet keeps contacts that its own
restoreState does not take away.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from multiprocessing.connection import Connection, Pipe
from typing import TYPE_CHECKING, Any, TypeVar, final

from hcbench.sim.world import Record, Simulation
from hcbench.system.errors import EngineFailed
from hcbench.workers.fork import Fork

if TYPE_CHECKING:
    from hcbench.sim.world import Flags

Answer = TypeVar("Answer")


class _Child:
    """A forked child that answers calls of one function until it is closed."""

    def __init__(self, make: Callable[[], Callable[[Any], Any]]) -> None:
        self._pipe, end = Pipe()
        self._fork = Fork(lambda: _serve(self._pipe, end, make))
        end.close()

    def ask(self, request: Any) -> Any:
        """Call the function in the child and return its result. Raises what it raises;
        EngineFailed if the child dies.
        """
        try:
            self._pipe.send(request)
            error, answer = self._pipe.recv()
        except (EOFError, OSError):
            code = self._fork.wait()
            got = (
                f"crashed with {signal.Signals(-code).name}"
                if code < 0
                else f"ended with exit code {code}"
            )
            raise EngineFailed(
                "model", f"the engine's process {got}", "a model that runs"
            ) from None
        if error is not None:
            raise error
        return answer

    def close(self) -> None:
        """End the child."""
        self._pipe.close()
        self._fork.kill()
        self._fork.wait()


def _serve(pipe: Connection, end: Connection, make: Callable[[], Any]) -> None:
    """Answer requests until the parent is gone."""
    pipe.close()
    answer = None
    while True:
        request = end.recv()
        try:
            answer = answer or make()
            end.send((None, answer(request)))
        except Exception as error:
            end.send((error, None))


def run_forked(function: Callable[[], Answer]) -> Answer:
    """Call `function()` in a forked copy of this process and return its result."""
    child = _Child(lambda: lambda _: function())
    try:
        answer: Answer = child.ask(None)
    finally:
        child.close()
    return answer


@final
class ForkedSimulation(Simulation):
    """A simulation of one launch, released and advanced in a forked copy of this process."""

    def __init__(self, release: Callable[[], Simulation]) -> None:
        self._child = _Child(lambda: release().advance)

    def advance(self, steps: int) -> Record:
        """Advance the simulation in its child process."""
        record: Record = self._child.ask(steps)
        return record

    def keep(self, which: Flags) -> None:
        """Keep the one launch that there is."""

    def close(self) -> None:
        """End the copy."""
        self._child.close()
