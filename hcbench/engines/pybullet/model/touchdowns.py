"""PyBullet: a recorded motion of a world's bodies, read for the speeds at which their links met the
floor.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hcbench.engines.pybullet import plugin
from hcbench.engines.pybullet.backend import (
    BACKEND,
    DISTANCE,
    LINK_A,
    LINK_B,
    MASS,
    NORMAL,
    POINT_A,
    RESTITUTION,
)
from hcbench.engines.pybullet.model.bodies import FIXED, JOINT_TYPE, PRISMATIC, REVOLUTE, BulletBody
from hcbench.engines.pybullet.model.causes import promise_in
from hcbench.engines.pybullet.model.list_pairs import find_pair
from hcbench.engines.pybullet.model.open import ANY_LINK, BodyPart
from hcbench.sim.touch import (
    ANY_SPEED,
    NewTouches,
    RecordedMotion,
    Touchdown,
    Touchdowns,
    TrajectoryTouchdowns,
)
from hcbench.system.errors import QuantityError, UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from hcbench.engines.pybullet.backend import BulletClient
    from hcbench.engines.pybullet.model.open import LoadedWorld
    from hcbench.sim.model_under_test import Request
    from hcbench.terms.impact import Floats

# Bullet stops a body before it enters another: up to this distance the two touch, m.
_TOUCHING = 1e-4
# Numbers of a free base: its place and quaternion; its velocity and spin.
_PLACE, _BASE_Q, _BASE_V = 3, 7, 6
# A quaternion shorter than this is none.
_LEAST_QUATERNION = 1e-6


@dataclass(frozen=True, slots=True)
class _Moving:
    """A body that moves, in the order of PyBullet's numbers.

    body: its id.
    is_free: its base moves.
    joints: numbers of its hinges and slides.
    """

    body: int
    is_free: bool
    joints: list[int]

    @property
    def widths(self) -> tuple[int, int]:
        """Numbers that a state has of it: count of positions, and of velocities."""
        base = (_BASE_Q, _BASE_V) if self.is_free else (0, 0)
        return base[0] + len(self.joints), base[1] + len(self.joints)

    def put(self, bullet: BulletClient, qpos: Floats, qvel: Floats) -> None:
        """Put the body into a state.

        qpos: its own positions: of a free base x y z, m, and a quaternion x y z w, then one of each
        joint, rad or m.
        qvel: of a free base velocity, m/s, and spin, rad/s, then of each joint.
        """
        if self.is_free:
            bullet.resetBasePositionAndOrientation(
                self.body, qpos[:_PLACE].tolist(), qpos[_PLACE:_BASE_Q].tolist()
            )
            bullet.resetBaseVelocity(
                self.body, qvel[:_PLACE].tolist(), qvel[_PLACE:_BASE_V].tolist()
            )
        positions = qpos[len(qpos) - len(self.joints) :].tolist()
        velocities = qvel[len(qvel) - len(self.joints) :].tolist()
        for joint, position, velocity in zip(self.joints, positions, velocities, strict=True):
            bullet.resetJointState(self.body, joint, position, velocity)


class _Links(NamedTuple):
    """Two links that meet, the moving one first: (PyBullet's id of the body, number of the link)
    of each; the base is link -1.
    """

    moving: tuple[int, int]
    other: tuple[int, int]


class _TouchingLinks(NamedTuple):
    """A contact of two links in the world's frame.

    point: on the moving one, m, (3,).
    normal: unit vector, (3,), on the other one, towards the moving one.
    """

    links: _Links
    point: Floats
    normal: Floats


class _Recording:
    """The bodies of a world that move, and the states of a recorded motion of them.

    moving: the bodies, in PyBullet's order.
    motion: the recorded states.
    """

    def __init__(self, bullet: BulletClient, recorded: Mapping[str, Floats]) -> None:
        """Read a recording of the bodies that move in a world.

        recorded: "qpos" and "qvel", (states, numbers of all moving bodies); "time", s, (states,),
        where it is known.
        Raises UserError for a ball joint or a planar one, for arrays of other shapes, for numbers
        that are not finite and for a time that does not rise; QuantityError for a quaternion of
        length 0.
        """
        self.bullet = bullet
        self.moving = list(_moving_bodies(bullet))
        widths = np.array([one.widths for one in self.moving], dtype=int).reshape(-1, 2)
        nq, nv = widths.sum(axis=0).tolist()
        # Where the numbers of each body begin in qpos and in qvel, (bodies, 2).
        self._starts = np.cumsum(widths, axis=0) - widths
        timestep = float(bullet.getPhysicsEngineParameters()["fixedTimeStep"])
        self.motion = RecordedMotion.read(recorded, nq, nv, timestep, self._layout())
        for one, (start, _) in zip(self.moving, self._starts.tolist(), strict=True):
            turns = self.motion.qpos[:, start + _PLACE : start + _BASE_Q]
            if one.is_free and np.linalg.norm(turns, axis=1).min() < _LEAST_QUATERNION:
                got = f"a quaternion of body {one.body} is 0"
                raise QuantityError("trajectory", got, "one of length 1, x y z w")

    def put(self, state: int) -> None:
        """Put the world into a state of the recording, by its index, and find its contacts."""
        for body, (q, v) in zip(self.moving, self._starts.tolist(), strict=True):
            nq, nv = body.widths
            qpos = self.motion.qpos[state, q : q + nq]
            body.put(self.bullet, qpos, self.motion.qvel[state, v : v + nv])
        self.bullet.performCollisionDetection()

    def _layout(self) -> str:
        """The numbers of a state in words, for errors."""
        parts = []
        for one in self.moving:
            base = "x y z, quaternion x y z w, " if one.is_free else ""
            parts.append(f"body {one.body}: {base}{len(one.joints)} joints")
        return "; ".join(parts)


def _moving_bodies(bullet: BulletClient) -> Iterator[_Moving]:
    """The bodies of a world with a free base or joints that move, in PyBullet's order.

    Raises UserError for a ball joint or a planar one, whose state PyBullet sets otherwise.
    """
    for body in bullet.bodies():
        joints = []
        for joint in range(bullet.getNumJoints(body)):
            kind = bullet.getJointInfo(body, joint)[JOINT_TYPE]
            if kind not in (REVOLUTE, PRISMATIC, FIXED):
                got = f"joint {joint} of body {body} is neither a hinge nor a slide"
                raise UserError("trajectory", got, "a model of hinges and slides")
            if kind != FIXED:
                joints.append(joint)
        is_free = bullet.getDynamicsInfo(body, -1)[MASS] > 0.0
        if is_free or joints:
            yield _Moving(body, is_free, joints)


def touchdowns(
    world: LoadedWorld, request: Request, recorded: Mapping[str, Floats]
) -> TrajectoryTouchdowns:
    """Find, in a recorded motion, every touchdown of a link that moves on a body that does not, or
    of the request's pair alone.

    The bodies of the world are left in a state of the recording.

    recorded: "qpos" and "qvel", (states, numbers of all bodies that move), in PyBullet's order: of
    a free base what getBasePositionAndOrientation and getBaseVelocity return, then of its hinges
    and slides what getJointState does; and "time", s, (states,), where it is known.
    Raises UserError for other shapes, numbers that are not finite, a time that does not rise, and a
    pair that the world does not have; QuantityError for a quaternion of length 0.
    """
    recording = _Recording(world.bullet, recorded)
    pair = None if request.pair is None else find_pair(world, request.pair)
    events = _events(recording, pair)
    feet = [_foot(world, links, of_links) for links, of_links in events.items()]
    # Most touchdowns first.
    feet.sort(key=lambda foot: (-len(foot.time), foot.part))
    motion = recording.motion
    return TrajectoryTouchdowns(
        "pybullet",
        BACKEND.version(),
        world.label,
        len(motion.qpos),
        motion.interval,
        tuple(feet),
    )


def _events(
    recording: _Recording, pair: tuple[BodyPart, BodyPart] | None
) -> dict[_Links, list[Touchdown]]:
    """Touchdowns of each two links that meet in a recording, in the order of time.

    Their speeds are those of the last state before the contact or of the first one in it, the
    faster of the two: between two states, free flight may speed a link up, and the contact slow it.

    pair: the two that count; None: each link that moves, with each body that does not.
    """
    touches = NewTouches(recording.motion.time)
    events: dict[_Links, list[Touchdown]] = {}
    for state, time in enumerate(recording.motion.time.tolist()):
        recording.put(state)
        every = _contacts(recording, pair)
        begun = [contact for contact in every if touches.begins(contact.links, state)]
        at_touch = [_closing_speeds(recording.bullet, contact) for contact in begun]
        if begun:
            recording.put(state - 1)
        for contact, speeds in zip(begun, at_touch, strict=True):
            speed, slide = max(speeds, _closing_speeds(recording.bullet, contact))
            if speed > 0.0:
                events.setdefault(contact.links, []).append(Touchdown(time, speed, slide))
    return events


def _contacts(
    recording: _Recording, pair: tuple[BodyPart, BodyPart] | None
) -> Iterator[_TouchingLinks]:
    """Contacts of a pair in the present state of the world.

    recording: has the bodies that move, and their client.
    pair: the two that count; None: each link that moves, with each body that does not.
    """
    bullet = recording.bullet
    moving = [one.body for one in recording.moving]
    if pair is None:
        still = [body for body in bullet.bodies() if body not in moving]
        sides = [_every_link(body, other) for body, other in product(moving, still)]
    else:
        # The one that moves comes first.
        sides = [pair if pair[0].body in moving else pair[::-1]]
    for first, second in sides:
        for contact in bullet.getContactPoints(first.body, second.body):
            one, two = contact[LINK_A], contact[LINK_B]
            is_asked = first.link in (ANY_LINK, one) and second.link in (ANY_LINK, two)
            if is_asked and contact[DISTANCE] <= _TOUCHING:
                links = _Links((first.body, one), (second.body, two))
                yield _TouchingLinks(links, np.array(contact[POINT_A]), np.array(contact[NORMAL]))


def _every_link(body: int, other: int) -> tuple[BodyPart, BodyPart]:
    return BodyPart("", body, ANY_LINK), BodyPart("", other, ANY_LINK)


def _closing_speeds(bullet: BulletClient, contact: _TouchingLinks) -> tuple[float, float]:
    """Speeds of two links at the point of their contact in the world's present state, m/s: at which
    they close in, and at which they slide on each other.
    """
    (body, link), (other, other_link) = contact.links
    point = contact.point.tolist()
    velocity = np.array(BulletBody(bullet, body).velocity_at(link, point))
    velocity -= BulletBody(bullet, other).velocity_at(other_link, point)
    # Speed at which the first moves away from the second.
    away = float(contact.normal @ velocity)
    return -away, float(np.linalg.norm(velocity - away * contact.normal))


def _foot(world: LoadedWorld, links: _Links, events: list[Touchdown]) -> Touchdowns:
    """Describe the touchdowns of two links: their names, times, s, speeds, m/s, the setting that
    makes them bounce, and the band of speeds, m/s, in which it holds, None where that is unknown.

    links: in the world.
    events: their touchdowns, one or more, in the order of time.
    """
    bullet = world.bullet
    sides = (BodyPart("", *links.moving), BodyPart("", *links.other))
    promise = promise_in(bullet, sides)
    law = None if world.files else plugin.find(links.moving, links.other, client=bullet.client)
    band = None
    if law is not None:
        band = ANY_SPEED
        setting = f"plug-in hcbench: {law.command}"
    elif promise is not None:
        band = promise.speeds
        setting = f"{promise.setting} by hcbench: {promise.curve.description}"
    else:
        values = [bullet.getDynamicsInfo(side.body, side.link)[RESTITUTION] for side in sides]
        first, second = values
        setting = f"restitution {first:g} x {second:g}"
    time, speed, slide = np.array(events).T
    part = world.name_of(*links.moving)
    other = world.name_of(*links.other)
    return Touchdowns(part, other, time, speed, slide, band, setting)
