"""PyBullet worlds of users, from files or live, and the two in them that meet."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hcbench.engines.pybullet.backend import LASTING_SETTINGS, BulletClient
from hcbench.engines.pybullet.model.model_file import check_user_model
from hcbench.sim.packages import Packages, is_utf8, require_packages, with_absolute_files
from hcbench.system.errors import SceneError, UserError

_STARTING_SETTINGS = {**LASTING_SETTINGS, "fixedTimeStep": 1.0 / 240.0}
# Any link that touches, as PyBullet's own calls have it.
ANY_LINK = -2


@dataclass(frozen=True, slots=True)
class LiveWorld:
    """PyBullet world that the user has set up and is running.

    client: physics client id.
    first, second: what shall meet, the moving body first, each a body id or a (body id, link
    index); None where the request's pair names them.
    """

    client: int
    first: int | tuple[int, int] | None = None
    second: int | tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class BodyPart:
    """One of the two that meet: a link (-1: the base) of a body, or ANY_LINK of it."""

    name: str
    body: int
    link: int

    @property
    def variable(self) -> int | str:
        """Variable for the body in a script: its file's name, numbered if
        several came from one; or its id.
        """
        stem, _, copy = self.name.partition(".")
        name = stem + "".join(f"_{number}" for number in re.findall(r" \((\d+)\)$", copy))
        if name.isidentifier():
            return name
        return self.body


@dataclass(frozen=True, slots=True)
class LoadedWorld:
    """A world to be measured.

    label: what a report calls it.
    disconnect: whether to end its client at the end.
    pair: the two that meet, as in a `LiveWorld`; () where names say.
    files: body id -> name of the file it came from; empty for a world of the user's.
    unread: body id -> (tag, e) of a restitution that its file has in a place where PyBullet does
    not look.
    owner: what the user made of the client, which may disconnect it when it goes.
    """

    bullet: BulletClient
    label: str
    disconnect: bool
    pair: tuple[int | tuple[int, int], ...] = ()
    files: dict[int, str] = field(default_factory=dict)
    unread: dict[int, tuple[str, float]] = field(default_factory=dict)
    owner: Any = None


def load_files(paths: Sequence[str], packages: Packages = ()) -> LoadedWorld:
    """A new world with the files loaded in it, as PyBullet loads them by default."""
    files = [Path(path) for path in paths]
    unread = [check_user_model(path) for path in files]
    with ExitStack() as failed:
        bullet = BulletClient.direct()
        failed.callback(bullet.disconnect)
        bullet.resetSimulation()
        bullet.setPhysicsEngineParameter(**_STARTING_SETTINGS)
        world = LoadedWorld(bullet, " + ".join(path.name for path in files), True)
        for path, restitution in zip(files, unread, strict=True):
            for body in _load(bullet, path, packages):
                _require_readable(bullet, body, path)
                copies = sum(
                    Path(name).name.partition(" (")[0] == path.name for name in world.files.values()
                )
                world.files[body] = path.name
                if copies:
                    world.files[body] += f" ({copies + 1})"
                if restitution is not None:
                    world.unread[body] = restitution
        failed.pop_all()
    return world


def _load(bullet: BulletClient, path: Path, packages: Packages) -> list[int]:
    """Bodies of a file. Of a URDF that names files by packages that were given, or
    that is not in UTF-8, of a copy. Raises SceneError with the package that has no
    folder, or with Bullet's reason.
    """
    if path.suffix.lower() != ".urdf":
        return bullet.load_model(path)
    try:
        if not packages and is_utf8(path):
            return bullet.load_model(path)
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / path.name
            copy.write_text(with_absolute_files(path, packages), encoding="utf-8")
            return bullet.load_model(copy)
    except SceneError:
        require_packages(path, packages)
        raise


def _require_readable(bullet: BulletClient, body: int, path: Path) -> None:
    """Refuse a robot with more joints than PyBullet reports the state of."""
    if not (count := bullet.getNumJoints(body)):
        return
    try:
        bullet.getJointState(body, 0)
    except bullet.error:
        got = f"{path}: {count} joints, of which PyBullet reports no state"
        raise SceneError(
            "model", got, "fewer joints (PyBullet: 128)", "Merge fixed links"
        ) from None


def open_live(source: Any, disconnect: bool) -> LoadedWorld:
    """The world of a `LiveWorld`, a client id, or a BulletClient of pybullet_utils.

    UserError for others.
    """
    world = source
    if source is None or isinstance(source, int):
        world = LiveWorld(source or 0)
    elif hasattr(source, "_client"):
        world = LiveWorld(source._client)
    if not isinstance(world, LiveWorld):
        raise UserError("model", f"a {type(source).__name__}", "a path or a PyBullet World")
    number = world.client
    bullet = BulletClient(number)
    if not (0 <= number < 2**31 and bullet.isConnected()):
        raise UserError("model", f"PyBullet client {number} is not connected", "a live client")
    pair: tuple[int | tuple[int, int], ...] = ()
    if world.first is not None and world.second is not None:
        pair = (world.first, world.second)
    return LoadedWorld(bullet, "PyBullet world", disconnect, pair, owner=source)
