"""Trials and launches in a forked copy of the user's process, whose world stays as it is."""

from __future__ import annotations

import signal
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection, Pipe
from typing import TYPE_CHECKING, Any, TypeVar, final

import numpy as np

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.sim.world import Record, Simulation
from hcbench.system.errors import EngineFailed
from hcbench.terms.impact import SLIP
from hcbench.workers import process
from hcbench.workers.process import Fork

if TYPE_CHECKING:
    from hcbench.sim.world import Flags
    from hcbench.terms.impact import Launch

# Runs what would change an engine's world in a forked copy of this process: the world here stays
# as it is.
#
# For engines that cannot be put back: Bullet keeps contacts that its own restoreState does not
# take away.

Answer = TypeVar("Answer")


class _Child:
    """A forked child that answers calls of one function until it is closed.

    make: makes the function in the child, at the first call; requests and answers are pickled.
    """

    def __init__(self, make: Callable[[], Callable[[Any], Any]]) -> None:
        self._pipe, end = Pipe()
        self._fork = Fork(lambda: _serve(self._pipe, end, make))
        end.close()

    def ask(self, request: Any) -> Any:
        """Call the function in the child with a request, which is pickled, and return its result.

        Raises what the function raises; EngineFailed if the child dies.
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
    """Answer requests in the child until the parent is gone.

    pipe: the parent's end, closed here.
    end: the child's.
    make: makes the function that answers.
    An error is sent back; the parent raises it.
    """
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
    """Call `function()` in a forked copy of this process and return its result, pickled.

    Raises what the function raises; EngineFailed if the copy dies.
    """
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


# Trials and launches beside the user's world, which stays as it is: in a forked copy of this
# process.
#
# Where a process cannot fork, or the world is another process's, they run in the world itself,
# which is then put back. restoreState alone would not do: a contact of the launch before survives
# it and acts in the next.


_CONNECTION = "connectionMethod"
# Bodies of a world that has a pair alone.
_PAIR = 2
# Places, m, and speeds, m/s, below which a body is within Bullet's bounds.
_NEAR = 1e4
# Bodies so far apart, m, have no contacts.
_FAR = 1e4


def can_fork(bullet: BulletClient) -> bool:
    """Say whether a forked copy of this process has a copy of the client's world in it."""
    return process.CAN_FORK and bullet.getConnectionInfo()[_CONNECTION] == bullet.module.DIRECT


def run_aside(bullet: BulletClient, function: Callable[[], Answer]) -> Answer:
    """Call `function()`, which moves bodies in the world, and return its result;
    the bodies are back afterwards.

    In a forked copy of this process where that is possible, else in the world itself. Raises what
    the function raises; EngineFailed if the copy dies.
    """
    if can_fork(bullet):
        return run_forked(function)
    state = bullet.saveState()
    try:
        return function()
    finally:
        bullet.restoreState(state)
        bullet.removeState(state)


def release_aside(bullet: BulletClient, release: Callable[[], Simulation]) -> Simulation:
    """The simulation that `release()` begins in the world as it is now."""
    return ForkedSimulation(release) if can_fork(bullet) else _InPlace(bullet, release)


class _InPlace(Simulation):
    """A simulation of one launch in the world itself."""

    def __init__(self, bullet: BulletClient, release: Callable[[], Simulation]) -> None:
        """Save the world's state, which `close` restores, and begin the launch by `release`.

        Raises what `release` raises, with the world put back.
        """
        self._bullet = bullet
        self._state = bullet.saveState()
        _forget_contacts(bullet, self._state)
        try:
            self._simulation = release()
        except BaseException:
            self.close()
            raise

    def advance(self, steps: int) -> Record:
        """Take the steps in the world itself."""
        return self._simulation.advance(steps)

    def keep(self, which: Flags) -> None:
        """Keep the one launch that there is."""

    def close(self) -> None:
        """Put the world back."""
        _forget_contacts(self._bullet, self._state)
        self._bullet.removeState(self._state)


@final
class CopyOfWorld:
    """A forked copy of this process in whose world launches run one after the other.

    Each finds the world as the first did, which holds for worlds that `keeps_nothing`. The fork
    takes a hundred times as long as the steps of a ball.

    A launch that flies off ends the copy, because Bullet takes bodies out of the simulation whose
    boxes are not finite, or larger than 1e6 m.

    make_launches: makes, in the copy, what begins the launches there.
    """

    def __init__(self, make_launches: Callable[[], LaunchesInPlace]) -> None:
        self._make_advance = lambda: make_launches().advance
        # None until the first launch, and after one that flew off.
        self._child: _Child | None = None
        self._flew_off = False
        # The launch that was released last, the only one that may be advanced.
        self._under_way: object = None

    def release(self, launch: Launch) -> Simulation:
        """The launch, which ends the one before it."""
        self._under_way = simulation = _LaunchInCopy(self, launch)
        return simulation

    def advance(self, simulation: _LaunchInCopy, launch: Launch | None, steps: int) -> Record:
        """Let the copy take steps of the launch under way, and return their record.

        simulation: that launch's.
        launch: it, to be released first; None where that is done.
        steps: number of steps.
        Raises what the copy raises, EngineFailed if it dies.
        """
        assert simulation is self._under_way, "a copy of a world has one launch at a time"
        if launch is not None and self._flew_off:
            self.close()
        if self._child is None:
            self._child = _Child(self._make_advance)
            self._flew_off = False
        record: Record = self._child.ask((launch, steps))
        self._flew_off |= not _is_near(record)
        return record

    def close(self) -> None:
        """End the copy."""
        if self._child is not None:
            self._child.close()
            self._child = None


def _is_near(record: Record) -> bool:
    """Say whether all places and speeds of a record are those of a body that stays about."""
    motion = [record.penetration, record.rate]
    if record.tangential is not None:
        motion.append(record.tangential[SLIP])
    # Written so that NaN is not near.
    return all(float(np.abs(each).max()) < _NEAR for each in motion)


class _LaunchInCopy(Simulation):
    """One launch of a `CopyOfWorld`."""

    def __init__(self, copy: CopyOfWorld, launch: Launch) -> None:
        self._copy = copy
        self._launch: Launch | None = launch

    def advance(self, steps: int) -> Record:
        """Advance the simulation in the copy."""
        record = self._copy.advance(self, self._launch, steps)
        self._launch = None
        return record

    def keep(self, which: Flags) -> None:
        """Keep the one launch that there is."""

    def close(self) -> None:
        """Nothing: the next launch puts the world back."""


class LaunchesInPlace:
    """Launches in the world of this process, one after the other; each puts the world back.

    release: begins a launch in the world.
    """

    def __init__(self, bullet: BulletClient, release: Callable[[Launch], Simulation]) -> None:
        self._bullet = bullet
        self._release = release
        # None before the first launch.
        self._simulation: Simulation | None = None

    def advance(self, request: tuple[Launch | None, int]) -> Record:
        """Take steps of the launch under way, and return their record.

        request: a launch to begin in place of the one under way, or None; and the number of steps.
        """
        launch, steps = request
        if launch is not None:
            before, self._simulation = self._simulation, None
            if before is not None:
                before.close()
            self._simulation = _InPlace(self._bullet, partial(self._release, launch))
        assert self._simulation is not None, "the first request has a launch"
        return self._simulation.advance(steps)


def keeps_nothing(bullet: BulletClient) -> bool:
    """Say whether a world, put back to a saved state, goes on as it did before, to the bit: one of two
    bodies without joints, and without substeps.

    restoreState does not give back all of joints, nor the order of contacts of more bodies, and
    with substeps Bullet carries a rest of time from step to step.
    """
    bodies = bullet.bodies()
    if len(bodies) > _PAIR or any(bullet.getNumJoints(body) for body in bodies):
        return False
    return int(bullet.getPhysicsEngineParameters()["numSubSteps"]) <= 1


def _forget_contacts(bullet: BulletClient, state: int) -> None:
    """Restore a saved state without the contacts that Bullet has now and would go on with: bodies are
    put far apart for a moment, and so lose their contacts.

    state: id that saveState gave.
    """
    for i, body in enumerate(bullet.bodies(), start=1):
        bullet.resetBasePositionAndOrientation(
            body, [i * _FAR, i * _FAR, i * _FAR], [0.0, 0.0, 0.0, 1.0]
        )
    bullet.performCollisionDetection()
    bullet.restoreState(state)
