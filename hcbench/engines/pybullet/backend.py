"""The pybullet package: importing it, its clients, and the settings that outlive them."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from contextlib import chdir, nullcontext
from functools import cache, partial
from pathlib import Path
from typing import Any

from hcbench.sim.backend import Backend
from hcbench.system.errors import EngineFailed, SceneError
from hcbench.workers import captured_output, in_worker

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
# Places in getDynamicsInfo: mass, kg, 0 of what cannot move; lateralFriction; inertia, kg m², about
# the main axes; the frame of these axes in that of the link; restitution; contactStiffness, N/m;
# and the kind of body.
MASS = 0
LATERAL_FRICTION = 1
INERTIA = 2
FRAME_POSITION = 3
FRAME_QUATERNION = 4
RESTITUTION = 5
STIFFNESS = 9
BODY_TYPE = 10
# Bullet's own values of what outlives resetSimulation; contactBreakingThreshold, a global of the
# process, outlives the client too. Every world made here starts with them.
LASTING_SETTINGS = {"contactBreakingThreshold": 0.02, "numSubSteps": 0, "enableFileCaching": 0}


class BulletClient:
    """Client of pybullet: the module with every call bound to one
    connection, like that of pybullet_utils.

    Ending one does not disconnect.
    Raises EngineMissing without pybullet.
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
        """Load a URDF, SDF or MJCF file into the client, and return the ids of its bodies.

        Meshes are looked for in the file's folder.
        slot: name of the file's slot, for the error.
        options: of pybullet's loader.
        Raises SceneError where PyBullet refuses the file.
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
