"""PyBullet: from files or a live client to two sides in a world, or one line that says why not."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from hcbench._text import sanitized
from hcbench.engines.pybullet.backend import LASTING_SETTINGS, BulletClient
from hcbench.engines.pybullet.model_file import check_user_model
from hcbench.errors import UserError
from hcbench.sim.names import find_part

if TYPE_CHECKING:
    from collections.abc import Sequence

_STARTING_SETTINGS = {**LASTING_SETTINGS, "fixedTimeStep": 1.0 / 240.0}
_Part = tuple[str, str, tuple[int, int | None]]  # kind, name, (body, link or None for any)
Bullet = BulletClient


@dataclass(frozen=True, slots=True)
class World:
    """A PyBullet world of the user's own, live.

    client: physics client id. first, second: what shall meet, the moving one first, each a body id or a
    (body id, link index); None where the request's pair names them.
    """

    client: int
    first: int | tuple[int, int] | None = None
    second: int | tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class Side:
    """One of the two. link: -1 is the base; None means whichever link touches."""

    name: str
    body: int
    link: int | None


@dataclass(frozen=True, slots=True)
class Loaded:
    """A world with what is in it.

    names: body id -> file it came from; empty for a world that was not made of files. own: ours to end.
    foreign: body id -> (tag, e) of a restitution that its file has in a place where PyBullet does not look.
    """

    bullet: BulletClient
    names: dict[int, str]
    label: str
    own: bool
    foreign: dict[int, tuple[str, float]] = field(default_factory=dict)


def load_files(paths: Sequence[str]) -> Loaded:
    """A new world with the files loaded in it, as PyBullet loads them by default."""
    files = [Path(path) for path in paths]
    foreign_in = {path: check_user_model(path) for path in files}
    bullet = BulletClient.direct()
    bullet.resetSimulation()
    bullet.setPhysicsEngineParameter(**_STARTING_SETTINGS)
    names: dict[int, str] = {}
    foreign: dict[int, tuple[str, float]] = {}
    for path in files:
        for body in bullet.load_model(path):
            names[body] = path.name
            if (found := foreign_in[path]) is not None:
                foreign[body] = found
    return Loaded(bullet, names, " + ".join(path.name for path in files), True, foreign)


def find_sides(loaded: Loaded, pair: tuple[str, str] | None, world: World | None) -> tuple[Side, Side]:
    """The two that the names mean: a file, a body, or a link ("body/link" where links share a name)."""
    if world is not None and world.first is not None and world.second is not None:
        first, second = (_numbered(loaded.bullet, part) for part in (world.first, world.second))
        return first, second
    parts = _parts(loaded)
    known = [name for _, name, _ in parts]
    if pair is None:
        numbers = loaded.bullet.bodies()
        if len(numbers) != 2:
            raise UserError(
                "pair",
                f"none given, and the world has {len(numbers)} bodies",
                "two names",
                f"Known: {', '.join(list(dict.fromkeys(known))[:12])}",
            )
        first, second = (Side(loaded.names.get(body, f"body:{body}"), body, None) for body in numbers)
        return first, second
    found = [(name, find_part(parts, name if name in known else Path(name).name)[1]) for name in pair]
    first, second = (Side(name, body, link) for name, (body, link) in found)
    if first.body == second.body and (first.link == second.link or None in (first.link, second.link)):
        raise UserError("pair", f"{pair[0]!r} and {pair[1]!r} are the same body", "two that can meet")
    return first, second


def _numbered(bullet: BulletClient, part: int | tuple[int, int]) -> Side:
    body, link = (part, None) if isinstance(part, int) else part
    try:
        name = sanitized(bullet.getBodyInfo(body)[1].decode(errors="replace"))
    except bullet.error:
        raise UserError("pair", f"no body {body} in this client", "a body id that loadURDF gave") from None
    words = f"body {body}" if link is None else f"body {body}, link {link}"
    return Side(f"{name} ({words})" if name else words, body, link)


def _parts(loaded: Loaded) -> list[_Part]:
    """Every name with the (body, link) that it means, bodies first; not those that several links share."""
    bullet = loaded.bullet
    bodies: list[_Part] = []
    links: list[_Part] = []
    for body in bullet.bodies():
        base, robot = (sanitized(part.decode(errors="replace")) for part in bullet.getBodyInfo(body))
        file = loaded.names.get(body, "")
        bodies += [("body", name, (body, None)) for name in (f"body:{body}", file, Path(file).stem, robot)]
        joints = [bullet.getJointInfo(body, j) for j in range(bullet.getNumJoints(body))]
        link_names = [base, *(sanitized(joint[12].decode(errors="replace")) for joint in joints)]
        prefixes = dict.fromkeys(["", f"body:{body}/", f"{Path(file).stem}/" if file else ""])
        links += [
            ("link", prefix + name, (body, link))
            for link, name in enumerate(link_names, start=-1)
            for prefix in prefixes
        ]
    uses = Counter(name for _, name, _ in links)
    return [part for part in bodies + [link for link in links if uses[link[1]] == 1] if part[1]]
