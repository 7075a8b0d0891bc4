"""Trials and launches beside the user's world, which stays as it is: in
a forked copy of this process.

Where a process cannot fork, or the world is another process's, they run in the world itself,
which is then put back. restoreState alone would not do: a contact of the launch before
survives it and acts in the next.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.sim import in_child as forked
from hcbench.sim.world import Record, Simulation
from hcbench.workers import fork

if TYPE_CHECKING:
    from hcbench.sim.world import Flags

Answer = TypeVar("Answer")

_CONNECTION = "connectionMethod"
# Bodies so far apart, m, have no contacts.
_FAR = 1e4


def _can_fork(bullet: BulletClient) -> bool:
    return fork.AVAILABLE and bullet.getConnectionInfo()[_CONNECTION] == bullet.module.DIRECT


def run_aside(bullet: BulletClient, function: Callable[[], Answer]) -> Answer:
    """Call `function()`, which moves bodies in the world, and return its result;
    the bodies are back afterwards.
    """
    if _can_fork(bullet):
        return forked.run_forked(function)
    state = bullet.saveState()
    try:
        return function()
    finally:
        bullet.restoreState(state)
        bullet.removeState(state)


def release_aside(bullet: BulletClient, release: Callable[[], Simulation]) -> Simulation:
    """The simulation that `release()` begins in the world as it is now."""
    return forked.ForkedSimulation(release) if _can_fork(bullet) else _InPlace(bullet, release)


class _InPlace(Simulation):
    """A simulation of one launch in the world itself."""

    def __init__(self, bullet: BulletClient, release: Callable[[], Simulation]) -> None:
        self._bullet = bullet
        self._state = bullet.saveState()
        _forget_contacts(bullet, self._state)
        self._simulation = release()

    def advance(self, steps: int) -> Record:
        """Take the steps in the world itself."""
        return self._simulation.advance(steps)

    def keep(self, which: Flags) -> None:
        """Keep the one launch that there is."""

    def close(self) -> None:
        """Put the world back."""
        _forget_contacts(self._bullet, self._state)
        self._bullet.removeState(self._state)


def _forget_contacts(bullet: BulletClient, state: int) -> None:
    """Restore a state without the contacts that there are now: Bullet
    drops those of bodies far apart.
    """
    for i, body in enumerate(bullet.bodies(), start=1):
        bullet.resetBasePositionAndOrientation(
            body, [i * _FAR, i * _FAR, i * _FAR], [0.0, 0.0, 0.0, 1.0]
        )
    bullet.performCollisionDetection()
    bullet.restoreState(state)
