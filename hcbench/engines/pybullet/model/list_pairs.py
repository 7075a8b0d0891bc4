"""The two in a PyBullet world that a request means, and all links that can meet."""

import math
from collections import Counter
from importlib.util import find_spec
from itertools import combinations
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.engines.pybullet.model.bodies import (
    FIXED,
    JOINT_NAME,
    JOINT_TYPE,
    LINK_NAME,
    BulletBody,
    contact_row,
)
from hcbench.engines.pybullet.model.open import ANY_LINK, BodyPart, LoadedWorld
from hcbench.engines.pybullet.model.place import DISTANCE, NORMAL
from hcbench.engines.pybullet.vectors import vector
from hcbench.sim.candidate_pairs import CandidatePair, choice_error, in_order
from hcbench.sim.packages import find_part
from hcbench.system.errors import UserError
from hcbench.system.text import joined_names, sanitized

_REACH = 1e4  # m
_TYPES = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule", 8: "height field"}
_SHAPE = 2  # in getCollisionShapeData
# Places in getDynamicsInfo
_DYNAMICS = {"lateralFriction": 1, "restitution": 5}
_Link = tuple[int, int]
_NamedPart = tuple[str, str, tuple[int, int]]  # kind, name, (body, link)


def list_pairs(world: LoadedWorld) -> list[CandidatePair]:
    """Every pair of links of two bodies, one of which moves; those that touch first."""
    bullet = world.bullet
    bodies = {number: BulletBody(bullet, number) for number in bullet.bodies()}
    links = [
        (number, link)
        for number, body in bodies.items()
        for link in range(-1, len(body.joints))
        if bullet.getCollisionShapeData(number, link)
    ]
    pairs = [
        _described(world, bodies, *sorted(pair, key=lambda part: bodies[part[0]].kind == "fixed"))
        for pair in combinations(links, 2)
        if pair[0][0] != pair[1][0] and any(bodies[number].kind != "fixed" for number, _ in pair)
    ]
    if len(bodies) == 1 and world.files:
        raise alone_error(world)
    return in_order(pairs)


def alone_error(world: LoadedWorld) -> UserError:
    """One file has nothing to meet: PyBullet's own floor would do."""
    spec = find_spec("pybullet_data")
    folder = next(iter(spec.submodule_search_locations or ()), "") if spec else ""
    floor = quote(str(Path(folder) / "plane.urdf")) if folder else "plane.urdf"
    got = f"{world.label} alone, in which no two parts can meet"
    return UserError("model", got, "something that it meets, such as a floor", f"Add a floor: {floor}")


def _described(
    world: LoadedWorld, bodies: dict[int, BulletBody], first: _Link, second: _Link
) -> CandidatePair:
    bullet, mass, distance = world.bullet, math.nan, math.nan
    points = bullet.getClosestPoints(first[0], second[0], _REACH, first[1], second[1])
    if points:
        point = min(points, key=lambda p: float(p[DISTANCE]))
        distance = float(point[DISTANCE])
        middle = (np.array(point[5]) + np.array(point[6])) / 2
        sides = [(bodies[number], link) for number, link in (first, second)]
        row = contact_row(sides[0], sides[1], vector(middle), vector(-np.array(point[NORMAL])))
        mass = 1.0 / row.inverse_mass if row.inverse_mass > 0.0 else math.nan
    infos = [bullet.getDynamicsInfo(*link) for link in (first, second)]
    return CandidatePair(
        bodies=(_body(world, first), _body(world, second)),
        geoms=(_link(bodies, first), _link(bodies, second)),
        types=(_type(bullet, first), _type(bullet, second)),
        pair=joined_names([f"body:{link[0]}/{_link(bodies, link)}" for link in (first, second)]),
        joint=_joint(bodies[first[0]], first[1]),
        effective_mass=mass,
        distance=distance,
        touching=distance <= 0.0,
        touching_in=("as it stands",) if distance <= 0.0 else (),
        settings={name: [float(info[place]) for info in infos] for name, place in _DYNAMICS.items()},
    )


def _body(world: LoadedWorld, link: _Link) -> str:
    return world.files.get(link[0]) or sanitized(
        world.bullet.getBodyInfo(link[0])[1].decode(errors="replace")
    )


def _link(bodies: dict[int, BulletBody], link: _Link) -> str:
    body = bodies[link[0]]
    name: Any = body.bullet.getBodyInfo(link[0])[0] if link[1] < 0 else body.joints[link[1]][LINK_NAME]
    return sanitized(name.decode(errors="replace"))


def _type(bullet: BulletClient, link: _Link) -> str:
    shapes = bullet.getCollisionShapeData(*link)
    return " + ".join(dict.fromkeys(_TYPES.get(shape[_SHAPE], "shape") for shape in shapes[:4]))


def _joint(body: BulletBody, link: int) -> str:
    if body.mass > 0.0:
        return "its free base"
    names = [
        body.joints[joint][JOINT_NAME].decode(errors="replace")
        for joint in body.ancestors(link)
        if body.joints[joint][JOINT_TYPE] != FIXED
    ]
    return f"its joints ({', '.join(names[:6])})" if names else "nothing"


def find_pair(world: LoadedWorld, names: tuple[str, str] | None) -> tuple[BodyPart, BodyPart]:
    """Find the two that meet: the world's own, or those of `names`, each a file, a body, or a link
    ("body/link" where links share a name); without names, the world's only two bodies.
    """
    bullet = world.bullet
    if world.pair:
        one, two = (_by_id(bullet, part) for part in world.pair)
        return one, two
    parts = _named_parts(world)
    known = [name for _, name, _ in parts]
    if names is None:
        numbers = bullet.bodies()
        if len(numbers) != 2:
            if len(numbers) < 2:
                raise alone_error(world)
            raise choice_error(list_pairs(world))
        one, two = (BodyPart(world.files.get(body, f"body:{body}"), body, ANY_LINK) for body in numbers)
        return one, two
    one, two = (
        BodyPart(name, *find_part(parts, name if name in known else Path(name).name)[1]) for name in names
    )
    if one.body == two.body and (one.link == two.link or ANY_LINK in (one.link, two.link)):
        raise UserError("pair", f"{one.name!r} and {two.name!r} are the same body", "two that can meet")
    return one, two


def _by_id(bullet: BulletClient, part: int | tuple[int, int]) -> BodyPart:
    body, link = (part, ANY_LINK) if isinstance(part, int) else part
    try:
        name = sanitized(bullet.getBodyInfo(body)[1].decode(errors="replace"))
    except bullet.error:
        raise UserError("pair", f"no body {body} in this client", "a body id that loadURDF gave") from None
    text = f"body {body}" if link == ANY_LINK else f"body {body}, link {link}"
    return BodyPart(f"{name} ({text})" if name else text, body, link)


def _named_parts(world: LoadedWorld) -> list[_NamedPart]:
    """Every name with the (body, link) that it means, bodies first; not those that several links share."""
    bullet = world.bullet
    bodies: list[_NamedPart] = []
    links: list[_NamedPart] = []
    for body in bullet.bodies():
        base, robot = (sanitized(part.decode(errors="replace")) for part in bullet.getBodyInfo(body))
        file = world.files.get(body, "")
        names = (f"body:{body}", file, Path(file).stem, robot)
        bodies += [("body", name, (body, ANY_LINK)) for name in names]
        joints = [bullet.getJointInfo(body, j) for j in range(bullet.getNumJoints(body))]
        link_names = [base, *(sanitized(joint[LINK_NAME].decode(errors="replace")) for joint in joints)]
        prefixes = dict.fromkeys(["", f"body:{body}/", f"{Path(file).stem}/" if file else ""])
        links += [
            ("link", prefix + name, (body, link))
            for link, name in enumerate(link_names, start=-1)
            for prefix in prefixes
        ]
    uses = Counter(name for _, name, _ in links)
    return [part for part in bodies + [link for link in links if uses[link[1]] == 1] if part[1]]
