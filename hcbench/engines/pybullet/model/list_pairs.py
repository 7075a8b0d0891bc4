"""Lists the links of a PyBullet world that can meet, and which do as it stands."""

import math
from itertools import combinations
from typing import Any

import numpy as np

from hcbench._text import sanitized
from hcbench.engines.pybullet.backend import BulletClient
from hcbench.engines.pybullet.model.bodies import (
    FIXED,
    JOINT_NAME,
    JOINT_TYPE,
    LINK_NAME,
    BulletBody,
    contact_row,
)
from hcbench.engines.pybullet.model.open import LoadedWorld
from hcbench.engines.pybullet.model.place import DISTANCE, NORMAL
from hcbench.engines.pybullet.vectors import vector
from hcbench.sim.candidate_pairs import CandidatePair, in_order

_REACH = 1e4  # m
_TYPES = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule", 8: "height field"}
_SHAPE = 2  # in getCollisionShapeData
_DYNAMICS = {"lateralFriction": 1, "restitution": 5}  # places in getDynamicsInfo
_Link = tuple[int, int]


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
    return in_order(pairs)


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
        pair=",".join(f"body:{link[0]}/{_link(bodies, link)}" for link in (first, second)),
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
