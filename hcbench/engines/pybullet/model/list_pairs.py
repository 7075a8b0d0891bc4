"""The two in a PyBullet world that a request means, and all links that can meet."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from itertools import combinations
from pathlib import Path
from shlex import quote
from typing import NamedTuple

import numpy as np

from hcbench.engines.pybullet.backend import (
    BODY_TYPE,
    DISTANCE,
    LATERAL_FRICTION,
    NORMAL,
    POINT_A,
    POINT_B,
    RESTITUTION,
    BulletClient,
)
from hcbench.engines.pybullet.model.bodies import (
    FIXED,
    JOINT_NAME,
    JOINT_TYPE,
    LINK_NAME,
    MAXIMAL_COORDINATES,
    SOFT_BODY,
    BulletBody,
    contact_row,
    vector,
)
from hcbench.engines.pybullet.model.open import ANY_LINK, BodyPart, LoadedWorld
from hcbench.sim.model_under_test import CandidatePair, choice_error, in_order
from hcbench.sim.packages import find_part, suggest_names
from hcbench.system.errors import UserError
from hcbench.system.text import joined_names, sanitized

# Distance within which PyBullet looks for the nearest points, m.
_REACH = 1e4
_TYPES = {
    2: "sphere",
    3: "box",
    4: "cylinder",
    5: "mesh",
    6: "plane",
    7: "capsule",
    8: "height field",
}
# Place of a shape's kind in getCollisionShapeData.
_SHAPE = 2
# Names in getBodyInfo: of the base's link, and of the robot.
_BASE = 0
_ROBOT = 1
# Places in getDynamicsInfo.
_DYNAMICS = {"lateralFriction": LATERAL_FRICTION, "restitution": RESTITUTION}


class _Link(NamedTuple):
    """Link of a body, by PyBullet's numbers; -1 is the base."""

    body: int
    link: int


# Kind, name, and (body, link).
_NamedPart = tuple[str, str, tuple[int, int]]


def list_pairs(world: LoadedWorld) -> list[CandidatePair]:
    """List every pair of links of two bodies of a world of which one moves; pairs that touch come
    first.

    Soft bodies are left out: PyBullet does not report their contacts.
    Raises UserError for one file alone, which has nothing to meet.
    """
    bullet = world.bullet
    bodies = {number: BulletBody(bullet, number) for number in bullet.bodies()}
    links = []
    for number, body in bodies.items():
        for index in range(-1, len(body.joints)):
            link = _Link(number, index)
            if _type(bullet, link):
                links.append(link)
    pairs = []
    for one, two in combinations(links, 2):
        one_is_fixed = bodies[one.body].kind == "fixed"
        two_is_fixed = bodies[two.body].kind == "fixed"
        if one.body == two.body or (one_is_fixed and two_is_fixed):
            continue
        if one_is_fixed:
            pair = _described(world, bodies, two, one)
        else:
            pair = _described(world, bodies, one, two)
        pairs.append(pair)
    if len(bodies) == 1 and world.files:
        raise alone_error(world)
    return in_order(pairs)


def alone_error(world: LoadedWorld) -> UserError:
    """The error to raise for a world of one file, which has nothing to meet; it advises to add
    PyBullet's own floor.
    """
    floor = "plane.urdf"
    data = find_spec("pybullet_data")
    folders = data.submodule_search_locations if data else None
    if folders:
        floor = quote(str(Path(folders[0]) / floor))
    got = f"{world.label} alone, in which no two parts can meet"
    return UserError(
        "model", got, "something that it meets, such as a floor", f"Add a floor: {floor}"
    )


def _described(
    world: LoadedWorld, bodies: dict[int, BulletBody], first: _Link, second: _Link
) -> CandidatePair:
    """Describe a pair of links in the world's present pose: names, shapes, effective mass (kg), signed
    distance (m) and contact parameters.

    bodies: by PyBullet's numbers.
    first: one that moves.
    Mass and distance are NaN where PyBullet finds no distance.
    """
    bullet = world.bullet
    pair = (first, second)
    mass = math.nan
    distance = math.nan
    points = bullet.getClosestPoints(first.body, second.body, _REACH, first.link, second.link)
    if points:
        point = min(points, key=lambda p: float(p[DISTANCE]))
        distance = float(point[DISTANCE])
        row = contact_row(
            (bodies[first.body], first.link),
            (bodies[second.body], second.link),
            vector((np.array(point[POINT_A]) + np.array(point[POINT_B])) / 2),
            vector(-np.array(point[NORMAL])),
        )
        if row.inverse_mass > 0.0:
            mass = 1.0 / row.inverse_mass
    names = (_link(bodies, first), _link(bodies, second))
    of_first = bullet.getDynamicsInfo(*first)
    of_second = bullet.getDynamicsInfo(*second)
    settings = {}
    for name, place in _DYNAMICS.items():
        settings[name] = [float(of_first[place]), float(of_second[place])]
    is_touching = distance <= 0.0
    touching_in: tuple[str, ...] = ()
    if is_touching:
        touching_in = ("as it stands",)
    return CandidatePair(
        bodies=(_body(world, first), _body(world, second)),
        geoms=names,
        types=(_type(bullet, first), _type(bullet, second)),
        pair=joined_names(
            [f"body:{link.body}/{name}" for link, name in zip(pair, names, strict=True)]
        ),
        joint=_joint(bodies[first.body], first.link),
        effective_mass=mass,
        distance=distance,
        touching=is_touching,
        touching_in=touching_in,
        settings=settings,
    )


def _readable(name: bytes) -> str:
    """A name of the user's file, safe to print."""
    return sanitized(name.decode(errors="replace"))


def _body(world: LoadedWorld, link: _Link) -> str:
    """Name of a link's body: that of its file, else of the robot in it."""
    file = world.files.get(link.body)
    return file or _readable(world.bullet.getBodyInfo(link.body)[_ROBOT])


def _link(bodies: dict[int, BulletBody], link: _Link) -> str:
    """Name of a link or base."""
    body = bodies[link.body]
    if link.link < 0:
        return _readable(body.bullet.getBodyInfo(link.body)[_BASE])
    return _readable(body.joints[link.link][LINK_NAME])


def _type(bullet: BulletClient, link: _Link) -> str:
    """Kinds of a link's shapes, in words; empty where it has none, and of soft bodies."""
    body_type = bullet.getDynamicsInfo(*link)[BODY_TYPE]
    if body_type == SOFT_BODY:
        return ""
    if body_type == MAXIMAL_COORDINATES:
        # PyBullet has no shapes to read of such bodies.
        return "shape"
    shapes = bullet.getCollisionShapeData(*link)
    return " + ".join(dict.fromkeys(_TYPES.get(shape[_SHAPE], "shape") for shape in shapes[:4]))


def _joint(body: BulletBody, link: int) -> str:
    """Phrase of what lets a link move: "its free base", "its joints (...)" with up to six that it
    hangs on, or "nothing".

    link: number, -1 the base.
    A base of mass 0 is fixed in Bullet.
    """
    if body.mass > 0.0:
        return "its free base"
    names = []
    for number in body.ancestors(link):
        joint = body.joints[number]
        if joint[JOINT_TYPE] != FIXED:
            names.append(joint[JOINT_NAME].decode(errors="replace"))
    if not names:
        return "nothing"
    return f"its joints ({', '.join(names[:6])})"


def find_pair(world: LoadedWorld, names: tuple[str, str] | None) -> tuple[BodyPart, BodyPart]:
    """Find the two parts of a world that are to meet: those that the user's World states; else those
    of `names`; else the world's only two bodies.

    names: of two parts, each a file, a body, or a link ("body/link" where links share a name); None
    for none.
    Raises UserError for a world with a choice, an unknown name, and one body twice.
    """
    bullet = world.bullet
    if world.pair:
        first, second = world.pair
        return _by_id(bullet, first), _by_id(bullet, second)
    if names is None:
        numbers = bullet.bodies()
        if len(numbers) < 2:
            raise alone_error(world)
        if len(numbers) > 2:
            raise choice_error(list_pairs(world))
        return _whole_body(world, numbers[0]), _whole_body(world, numbers[1])
    parts = _named_parts(world)
    one, two = _by_name(parts, names[0]), _by_name(parts, names[1])
    one = replace(one, file=world.files.get(one.body, ""))
    two = replace(two, file=world.files.get(two.body, ""))
    if one.body == two.body and (one.link == two.link or ANY_LINK in (one.link, two.link)):
        raise UserError(
            "pair", f"{one.name!r} and {two.name!r} are the same body", "two that can meet"
        )
    return one, two


def body_of(world: LoadedWorld, move: str) -> int:
    """Number of the body that a user names by its file or name, by a link's or by a joint's.

    move: "body:NAME", "joint:NAME" or "body:NUMBER". Of several with the same name the first is
    meant.
    Raises UserError for a name that the world does not have.
    """
    kind, _, name = move.partition(":")
    named = [(known, body) for _, known, (body, _) in _named_parts(world)]
    if kind == "joint":
        named = list(_named_joints(world))
    # Backwards, so that the first of several stays.
    bodies = dict(reversed(named))
    # A body without a file is listed as "body:NUMBER".
    if move in bodies:
        return bodies[move]
    # Names are sanitized where they are read.
    name = sanitized(name)
    if name not in bodies:
        raise UserError("move", f"no {kind} {name!r}", *suggest_names(name, dict(named)))
    return bodies[name]


def _named_joints(world: LoadedWorld) -> Iterator[tuple[str, int]]:
    """Name of each joint, and the number of its body."""
    bullet = world.bullet
    for body in bullet.bodies():
        for number in range(bullet.getNumJoints(body)):
            yield _readable(bullet.getJointInfo(body, number)[JOINT_NAME]), body


def _whole_body(world: LoadedWorld, body: int) -> BodyPart:
    """Any link of a body, under the name of its file, or its number where it came from none."""
    return BodyPart(world.files.get(body, f"body:{body}"), body, ANY_LINK)


def _by_name(parts: list[_NamedPart], name: str) -> BodyPart:
    """The part of this name, which may also be the path of a file."""
    sought = name
    if not any(known == name for _, known, _ in parts):
        sought = Path(name).name
    _, (body, link) = find_part(parts, sought)
    return BodyPart(name, body, link)


def _by_id(bullet: BulletClient, part: int | tuple[int, int]) -> BodyPart:
    """Return the part that a body's id, or a (body id, link index), stands for.

    Raises UserError for an id that the client does not have.
    """
    if isinstance(part, int):
        part = (part, ANY_LINK)
    body, link = part
    text = f"body {body}"
    if link != ANY_LINK:
        text = f"body {body}, link {link}"
    try:
        name = _readable(bullet.getBodyInfo(body)[_ROBOT])
    except bullet.error:
        raise UserError(
            "pair", f"no body {body} in this client", "a body id that loadURDF gave"
        ) from None
    if name:
        text = f"{name} ({text})"
    return BodyPart(text, body, link)


def _named_parts(world: LoadedWorld) -> list[_NamedPart]:
    """All names by which a user may call a part of a world: (kind, name, (body, link)) of each, those
    of bodies first.

    A link's name alone counts only if no other link has it; together with its body's, always.
    """
    bullet = world.bullet
    bodies: list[_NamedPart] = []
    links: list[_NamedPart] = []
    for body in bullet.bodies():
        info = bullet.getBodyInfo(body)
        file = world.files.get(body, "")
        stem = Path(file).stem
        names = (f"body:{body}", file, stem, _readable(info[_ROBOT]))
        bodies += [("body", name, (body, ANY_LINK)) for name in names]
        prefixes = ["", f"body:{body}/"]
        if file:
            prefixes.append(f"{stem}/")
        for link in range(-1, bullet.getNumJoints(body)):
            if link < 0:
                raw = info[_BASE]
            else:
                raw = bullet.getJointInfo(body, link)[LINK_NAME]
            name = _readable(raw)
            links += [("link", prefix + name, (body, link)) for prefix in dict.fromkeys(prefixes)]
    uses = Counter(name for _, name, _ in links)
    unique = [part for part in links if uses[part[1]] == 1]
    return [part for part in bodies + unique if part[1]]
