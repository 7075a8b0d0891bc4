"""PyBullet: a robot dropped on its floor in its pose, its joints held by motors, in copies of its
world.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.pybullet.backend import DISTANCE, FORCE, INERTIA, LINK_A, MASS, NORMAL
from hcbench.engines.pybullet.model.bodies import FIXED, JOINT_TYPE
from hcbench.engines.pybullet.model.in_child import can_fork, run_aside
from hcbench.engines.pybullet.model.list_pairs import find_pair
from hcbench.engines.pybullet.model.open import ANY_LINK, BodyPart, LoadedWorld
from hcbench.engines.pybullet.model.over_floor import (
    CENTRE,
    QUATERNION,
    SPIN,
    VELOCITY,
    WorldOverFloor,
    drive_of,
    prepare,
    turn_about,
)
from hcbench.sim.drop_test import DropBench, DropMotion, DroppedRobot
from hcbench.sim.landing import (
    DROPS,
    LATE_S,
    QUANTITIES,
    REBOUNDS,
    REST_SPEED,
    TAIL_S,
    TILT_AXIS,
    DropTest,
    Landed,
    Robot,
    RobotDrop,
    drop_test,
    raised_for,
)
from hcbench.system.errors import EngineFailed, UserError

if TYPE_CHECKING:
    from hcbench.engines.pybullet.backend import BulletClient
    from hcbench.sim.model_under_test import Request
    from hcbench.terms.impact import Floats

# A step of a robot costs some 0.3 ms of CPU time, so that these drops alone show how it rests, and
# the others end this long after release, s.
LASTING = (DROPS[-1], REBOUNDS[0], DROPS[len(DROPS) // 2])
_BRIEF_S = 0.7
# Time of a first one of these, s, which shows how a robot lies after LATE_S and TAIL_S.
FIRST_S = LATE_S + TAIL_S + 0.2
# Steps after which it is looked again whether a robot that should rest does.
_LOOKS = 8
_EXPECTED = "pairs of a robot, which has joints and a free base, with what is fixed"
# Numbers of a link's motion: centre, quaternion x y z w, velocity and spin.
_TO_CENTRE, _TO_QUATERNION, _TO_VELOCITY, _TO_SPIN = 3, 7, 10, 13

# Changes a world before the robot is dropped.
Change = Callable[["BulletClient"], None]


@dataclass(frozen=True, slots=True)
class ChangedWorld:
    """A user's world with a setting: build opens the world, apply makes the setting in it.

    bench: drops the robot of that world, and has made some of its drops; None: none is made.
    """

    build: Callable[[], LoadedWorld]
    apply: Change
    bench: WorldDropBench | None = None


@dataclass(frozen=True, slots=True)
class _Ends:
    """Values beyond which a drop is worse than allowed, so that it need not go on: force of the
    floor, N; depth, m; and time from the touch to rest, s. NaN: no limit.
    """

    force: float = math.nan
    depth: float = math.nan
    rest: float = math.nan


class Seen(NamedTuple):
    """A drop: its landing, None where it diverges; links that the floor pushed, -1 for the base; and
    points at which it pushed at once, at most.
    """

    landed: Landed | None
    links: frozenset[int]
    points: int


class WorldDropBench(DropBench):
    """A robot over the fixed bodies of its world; every drop is in a forked copy of it.

    number: its body in the client.
    feet: its links that the pairs name, or () for all.
    robot: what a test reports of it and of what holds its joints.
    mass: kg.
    seen: links that the floor pushed so far, -1 for the base.
    points: at which it pushed at once, at most.

    Raises UserError for pairs that are not of a robot, a world without floor or gravity, and for a
    client that is another process's.
    """

    def __init__(
        self, world: LoadedWorld, requests: Sequence[Request], apply: Change | None = None
    ) -> None:
        """Find the robot of the pairs, and what holds its joints.

        world: with the robot; a client that hcbench opened is disconnected when the bench goes.
        requests: of pairs of the robot with the floor; the first has the pose, step and gravity.
        apply: changes the world of each drop.
        """
        self.world = world
        if world.disconnect:
            # Copies of this process end without it.
            weakref.finalize(self, world.bullet.disconnect).atexit = False
        self._request = requests[0]
        self._apply = apply
        bullet = world.bullet
        if not can_fork(bullet):
            got = "a client that no copy of this process has"
            raise UserError("model", got, "files, or a client by pybullet.DIRECT")
        pairs = [find_pair(world, request.pair) for request in requests]
        self.number, self.feet = _feet(world, pairs)
        self.robot, self.mass = run_aside(bullet, self._described)
        self.timestep = self.robot.timestep
        self.gravity = float(np.linalg.norm(self.robot.gravity))
        self.seen: set[int] = set()
        self.points = 1
        self._unchanged: dict[tuple[RobotDrop, float], Landed | None] = {}
        self._origin: WorldDropBench | None = None

    def test(self, seconds: float, drops: Sequence[RobotDrop] = DROPS) -> DropTest:
        """Drop the robot as it is. seconds: of the drops that show how it rests."""
        landed = {}
        for drop in drops:
            lasting = self._seconds(drop, seconds)
            if (drop, lasting) not in self._unchanged:
                self._unchanged[drop, lasting] = self._landed(drop, lasting, None)
            landed[drop] = self._unchanged[drop, lasting]
        return drop_test(self.robot, landed, seconds)

    def test_with(self, change: Change, seconds: float, drops: Sequence[RobotDrop]) -> DropTest:
        """Drop the robot with a change of its contacts. seconds: as of `test`."""
        landed = {drop: self._landed(drop, self._seconds(drop, seconds), change) for drop in drops}
        return drop_test(self.robot, landed, seconds)

    def with_change(self, change: Change) -> WorldDropBench:
        """The same robot in the same client, with a change of its world in every drop."""
        other = copy(self)
        other._apply = change
        other._unchanged = {}
        other.seen = set(self.seen)
        # The client ends with the bench that opened it.
        other._origin = self
        return other

    def is_no_worse(
        self,
        like: DropTest,
        target: float,
        seconds: float,
        drops: Sequence[RobotDrop] = DROPS,
    ) -> bool:
        """Say whether no drop is worse than `like`. Drops end with the first that is, and that one as
        soon as it is.

        target: rebound, m.
        seconds: of the drops that show how the robot rests.
        """
        return all(self._drop_is_no_worse(like, target, seconds, drop) for drop in drops)

    def _drop_is_no_worse(
        self, like: DropTest, target: float, seconds: float, drop: RobotDrop
    ) -> bool:
        """Say so of one drop."""
        lasting = self._seconds(drop, seconds)
        key = drop, lasting
        limits = {each.name: each.limit(getattr(like, each.name), target) for each in QUANTITIES}
        landed = self._unchanged.get(key)
        if key not in self._unchanged:
            force = limits["peak"] * self.mass * self.gravity
            rest = limits["rest"] if lasting > LATE_S + TAIL_S else math.nan
            ends = _Ends(force, limits["depth"], rest)
            landed = self._landed(drop, lasting, None, ends)
        if landed is None or any(getattr(landed, name) > limits[name] for name in limits):
            return False
        # It went on to its end.
        self._unchanged[key] = landed
        return True

    def _seconds(self, drop: RobotDrop, seconds: float) -> float:
        """Time of a drop from release, s. seconds: of those that show how a robot rests."""
        return seconds if drop in LASTING else min(seconds, _BRIEF_S)

    def _prepared(self) -> tuple[WorldOverFloor, Callable[[], None], str]:
        """Put the robot in its pose over its floor: the robot, the function that drives its joints
        before each step, and a phrase of that. It changes the world, so it is called in a forked
        copy.

        Files have no motors: hcbench's hold the pose. A world of the user's has its own.
        """
        prepare(self.world, self._request)
        if self._apply is not None:
            self._apply(self.world.bullet)
        over_floor = WorldOverFloor(self.world, self.number)
        has_motors = not self.world.files or not self._request.actuators
        return over_floor, *drive_of("ctrl" if has_motors else "pd", over_floor)

    def _described(self) -> tuple[Robot, float]:
        """Data of the robot for results, and its mass, kg. Called in a forked copy."""
        over_floor, _, controller = self._prepared()
        gx, gy, gz = (-over_floor.g * over_floor.up + 0.0).tolist()
        robot = Robot(
            engine="pybullet",
            model=self.world.label,
            name=over_floor.name,
            mass=over_floor.mass,
            timestep=over_floor.h,
            gravity=(gx, gy, gz),
            controller=controller,
        )
        return robot, over_floor.mass

    def _landed(
        self, drop: RobotDrop, seconds: float, change: Change | None, ends: _Ends = _Ends()
    ) -> Landed | None:
        """Simulate one drop for `seconds` in a forked copy, and read how the robot lands; None where
        the drop diverges or kills its process, or the robot never touches the floor.

        change: made in the copy's world before; None: no change.
        ends: where the drop may end before its time, with what it has shown.
        """

        def dropped() -> Seen:
            over_floor, drive, _ = self._prepared()
            if change is not None:
                change(self.world.bullet)
            return _drop(over_floor, drive, drop, seconds, ends)

        try:
            seen = run_aside(self.world.bullet, dropped)
        except EngineFailed:
            return None
        self.seen |= seen.links
        self.points = max(self.points, seen.points)
        return seen.landed


def _feet(
    world: LoadedWorld, pairs: Sequence[tuple[BodyPart, BodyPart]]
) -> tuple[int, tuple[int, ...]]:
    """Find the robot of which some pairs name feet: the number of its body, and the links that the
    pairs name, () if one names the whole body.

    pairs: each of a part of the robot and of something fixed.
    Raises UserError for pairs of which not one part has a free base, of several bodies, or of a
    body without moving joints.
    """
    bullet = world.bullet
    feet: dict[tuple[int, int], None] = {}
    for pair in pairs:
        falling = [side for side in pair if bullet.getDynamicsInfo(side.body, -1)[MASS] > 0.0]
        if len(falling) != 1:
            got = f"{pair[0].name} and {pair[1].name}"
            raise UserError("pair", f"{got}: not one with a free base", _EXPECTED)
        feet[falling[0].body, falling[0].link] = None
    robots = {body for body, _ in feet}
    if len(robots) > 1:
        raise UserError("pair", f"parts of {len(robots)} bodies that fall", _EXPECTED)
    (robot,) = robots
    joints = range(bullet.getNumJoints(robot))
    if all(bullet.getJointInfo(robot, joint)[JOINT_TYPE] == FIXED for joint in joints):
        raise UserError("pair", f"no joint of {world.name_of(robot)} moves", _EXPECTED)
    links = tuple(link for _, link in feet)
    return robot, () if ANY_LINK in links else links


def _drop(
    over_floor: WorldOverFloor,
    drive: Callable[[], None],
    drop: RobotDrop,
    seconds: float,
    ends: _Ends,
) -> Seen:
    """Drop the robot once, in a world that may be changed, and read how it lands.

    drop: height, tilt and phase.
    over_floor: the robot in its pose.
    drive: called before each step.
    seconds: to simulate.
    ends: where it ends before; a robot that moves beyond the time to rest has an infinite one.
    """
    h, g = over_floor.h, over_floor.g
    turn = turn_about(TILT_AXIS, drop.tilt)
    lowest = over_floor.put(drop.height + raised_for(drop.phase, drop.height, g, h), turn)
    path = _DropPath(over_floor)
    for _ in range(round(seconds / h)):
        drive()
        path.step()
        if path.is_beyond(ends):
            break
    motion = path.motion()
    height = float((motion.centre[0] - lowest) @ over_floor.up)
    dropped = DroppedRobot(h, g, over_floor.up, over_floor.mass * g, max(height, 1e-3))
    landed = dropped.landed(motion, drop.height)
    if landed is not None and path.is_late:
        landed = replace(landed, rest=math.inf)
    return Seen(landed, frozenset(path.links), path.points)


class _DropPath:
    """The way of a robot, recorded step by step.

    links: that the floor pushed.
    points: at which it pushed at once, at most.
    is_late: whether it moves when it should rest.
    """

    def __init__(self, over_floor: WorldOverFloor) -> None:
        """Begin an empty record, and read the inertias of the links.

        over_floor: the robot, put where its drop begins.
        """
        self._over_floor = over_floor
        bullet, robot = over_floor.bullet, over_floor.robot
        every = [*over_floor.links, -1]
        self._inertias = np.array([bullet.getDynamicsInfo(robot, one)[INERTIA] for one in every])
        self._rows: list[list[tuple[float, ...]]] = []
        self._forces: list[float] = []
        self._distances: list[float] = []
        self.links: set[int] = set()
        self.points = 0
        self.is_late = False
        # Number of the first step in which the floor pushes.
        self._touch: int | None = None

    def is_beyond(self, ends: _Ends) -> bool:
        """Say whether the last step is beyond what a drop may show."""
        force = self._forces[-1]
        if self._touch is None:
            if not force > 0.0:
                return False
            self._touch = len(self._forces) - 1
        if force > ends.force or -self._distances[-1] > ends.depth:
            return True
        since = len(self._forces) - 1 - self._touch
        if since * self._over_floor.h > ends.rest and since % _LOOKS == 0:
            over_floor = self._over_floor
            velocities = np.array([row[_TO_QUATERNION:_TO_VELOCITY] for row in self._rows[-1]])
            velocity = over_floor.masses @ velocities / over_floor.mass
            self.is_late = bool(np.linalg.norm(velocity) > REST_SPEED)
        return self.is_late

    def step(self) -> None:
        """Record the motion, take a step, and record what the floor does in it."""
        self._rows.append(self._links())
        self._over_floor.bullet.stepSimulation()
        upward = 0.0
        deepest = 0.0
        points = 0
        up = self._over_floor.up.tolist()
        for floor in self._over_floor.floors:
            for contact in self._over_floor.bullet.getContactPoints(self._over_floor.robot, floor):
                if contact[FORCE] > 0.0:
                    normal = contact[NORMAL]
                    upward += contact[FORCE] * sum(u * n for u, n in zip(up, normal, strict=True))
                    deepest = min(deepest, contact[DISTANCE])
                    points += 1
                    self.links.add(contact[LINK_A])
        self._forces.append(upward)
        self._distances.append(deepest)
        self.points = max(self.points, points)

    def _links(self) -> list[tuple[float, ...]]:
        """Centre, quaternion x y z w, velocity and spin of each link, 13 numbers, and last those of
        the base; SI, in the world.
        """
        over_floor = self._over_floor
        bullet, robot = over_floor.bullet, over_floor.robot
        states: Any = ()
        if over_floor.links:
            states = bullet.getLinkStates(
                robot, over_floor.links, computeLinkVelocity=1, computeForwardKinematics=1
            )
        rows = [
            state[CENTRE] + state[QUATERNION] + state[VELOCITY] + state[SPIN] for state in states
        ]
        place, attitude = bullet.getBasePositionAndOrientation(robot)
        velocity, spin = bullet.getBaseVelocity(robot)
        rows.append((*place, *attitude, *velocity, *spin))
        return rows

    def motion(self) -> DropMotion:
        """The recorded motion of n steps, SI: centre of mass, velocity, force and depth at the floor,
        and energy of the links; motors store no energy.
        """
        rows = np.array(self._rows)
        centres = rows[..., :_TO_CENTRE]
        velocities = rows[..., _TO_QUATERNION:_TO_VELOCITY]
        spins = _turned_back(rows[..., _TO_CENTRE:_TO_QUATERNION], rows[..., _TO_VELOCITY:_TO_SPIN])
        over_floor = self._over_floor
        masses = over_floor.masses
        share = masses / over_floor.mass
        kinetic = 0.5 * (masses * (velocities**2).sum(axis=2)).sum(axis=1)
        kinetic += 0.5 * (self._inertias * spins**2).sum(axis=(1, 2))
        potential = over_floor.g * (centres @ over_floor.up) @ masses
        return DropMotion(
            centre=np.einsum("l,nlx->nx", share, centres),
            velocity=np.einsum("l,nlx->nx", share, velocities),
            force=np.array(self._forces),
            distance=np.array(self._distances),
            energy=kinetic + potential,
        )


def _turned_back(quaternions: Floats, vectors: Floats) -> Floats:
    """Vectors in the world, (..., 3), in the frames that unit quaternions x y z w, (..., 4), turn."""
    axis, w = -quaternions[..., :3], quaternions[..., 3:]
    twice: Floats = 2.0 * np.cross(axis, vectors)
    turned: Floats = vectors + w * twice + np.cross(axis, twice)
    return turned
