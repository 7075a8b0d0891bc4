"""The pybullet package: importing it, its clients, the settings that outlive them, and trials in a
forked copy of a client's world.
"""

from __future__ import annotations

import re
import signal
import sys
from collections.abc import Callable
from contextlib import chdir, nullcontext
from functools import cache, partial
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, final

from hcbench.sim.backend import Backend
from hcbench.sim.world import Record, Simulation
from hcbench.system.errors import EngineFailed, SceneError
from hcbench.workers import captured_output, in_worker, process
from hcbench.workers.process import Fork

if TYPE_CHECKING:
    from hcbench.sim.world import Flags


BACKEND = Backend(
    "pybullet",
    "pybullet",
    "3.2.7",
    "3.2.7",
    "pip install 'pybullet>=3.2.7'  # wheels for CPython up to 3.11",
    newest_python="3.11",
)
# Bullet clips every component of a body's speed and spin at maxJointVelocity, 100 unless set.
UNCLIPPED = 1e9
# MAX_PHYSICS_CLIENTS of Bullet.
_MOST_CLIENTS = 1024
# Bullet's line of code before each of its messages.
_SOURCE_LINE = re.compile(r"b3(?:Error|Warning|Printf)\[[^\]]*\]:")
# Places in a point of getContactPoints and getClosestPoints, of body A and body B.
BODY_A = 1
BODY_B = 2
LINK_A = 3
LINK_B = 4
# Points in the world, m; unit vector on B that points at A; distance, m, below 0 where the two
# overlap; and force along the normal, N.
POINT_A = 5
POINT_B = 6
NORMAL = 7
DISTANCE = 8
FORCE = 9
# Place in getDynamicsInfo: kg, 0 of what cannot move.
MASS = 0
# Bullet's own values of what outlives resetSimulation; contactBreakingThreshold, a global of the
# process, outlives the client too. Every world made here starts with them.
LASTING_SETTINGS = {"contactBreakingThreshold": 0.02, "numSubSteps": 0, "enableFileCaching": 0}


class BulletClient:
    """Client of pybullet: the module with every call bound to one
    connection, like that of pybullet_utils.

    Ending one does not disconnect. Raises EngineMissing without pybullet.
    """

    def __init__(self, client: int) -> None:
        # PyBullet prints a line on import.
        self.module = BACKEND.module()
        self.client = client
        self.error: type[Exception] = self.module.error

    def __getattr__(self, name: str) -> Callable[..., Any]:
        function = getattr(self.module, name)
        # Client 0 is pybullet's default: naming it costs a tenth of a short call.
        bound = partial(function, physicsClientId=self.client) if self.client else function
        setattr(self, name, bound)
        return bound

    @classmethod
    def direct(cls) -> BulletClient:
        """A new client without a window; EngineFailed where Bullet has no room for one more."""
        new = cls(0)
        new.client = new.module.connect(new.module.DIRECT)
        if new.client < 0:
            raise EngineFailed("pybullet", "no client could be connected", "", "Close some others")
        return new

    def load_model(self, path: Path, slot: str = "model", **options: Any) -> list[int]:
        """Load a URDF, SDF or MJCF file, with its meshes beside it; ids of its bodies.

        options: of pybullet's loader. Raises SceneError about `slot` where
        PyBullet refuses the file.
        """
        loaders = {".urdf": self.loadURDF, ".sdf": self.loadSDF}
        load = loaders.get(path.suffix.lower(), self.loadMJCF)
        printed: list[str] = []
        try:
            # Bullet looks for meshes in the working directory first, and for
            # package:// above the whole path.
            file = path.resolve()
            # In a user's own process, what others print is not ours to take.
            quiet = captured_output() if in_worker() else nullcontext(printed)
            with chdir(file.parent), quiet as printed:
                bodies = load(str(file), **options)
        except self.error as error:
            reason = _SOURCE_LINE.sub(" ", " ".join(printed))
            got = f"{path}: {error} {reason}".strip()
            raise SceneError(slot, got, "a file that PyBullet loads") from None
        return [bodies] if isinstance(bodies, int) else list(bodies)

    def bodies(self) -> list[int]:
        """Ids of all bodies."""
        return [self.getBodyUniqueId(i) for i in range(self.getNumBodies())]


def is_connected() -> bool:
    """Say whether this process has imported pybullet and has a client that calls without one mean."""
    pybullet = sys.modules.get("pybullet")
    return pybullet is not None and bool(pybullet.isConnected())


@cache
def client() -> BulletClient:
    """One client for the life of this process, or until `end_clients`."""
    return BulletClient.direct()


def end_clients() -> None:
    """Disconnect every client of this process: ours, and those that a
    user's script left when it failed. Nothing where pybullet was never imported.
    """
    client.cache_clear()
    if (pybullet := sys.modules.get("pybullet")) is not None:
        for connected in filter(pybullet.isConnected, range(_MOST_CLIENTS)):
            pybullet.disconnect(connected)


# Trials and launches in a forked copy of the user's process, whose world stays as it is.

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

    pipe: the parent's end, closed here. end: the child's. make: makes the function that answers. An
    error is sent back; the parent raises it.
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
