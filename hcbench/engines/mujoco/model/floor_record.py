"""MuJoCo: contacts of a robot with its floor, read step by step in C or in Python, to the same bits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import backend, resets
from hcbench.engines.mujoco.model.over_floor import OverFloor
from hcbench.engines.mujoco.model.simulation import loop_in_c

# Contacts in a step for which there is room at first.
_CONTACTS = 4


class Point(NamedTuple):
    """A point at which the robot meets the floor in one step, SI.

    geom, floor: numbers of the two geoms.
    force: normal, N; 0 where a plug-in's law turns the point back by an impulse.
    depth: m.
    speed: towards the floor before the step; slide: along it, m/s.
    """

    geom: int
    floor: int
    force: float
    depth: float
    speed: float
    slide: float


class FloorStep(NamedTuple):
    """Points that the floor pressed on in one step, its force on the robot, N upwards, and the speed
    of the robot's centre of mass upwards at the step's start, m/s.
    """

    points: list[Point]
    force: float
    rising: float


class FloorRecord:
    """Some steps of a robot over its floor, as MuJoCo leaves them in an MjData.

    MuJoCo's numbers are kept as they are, and multiplied for all steps at once: one after the other
    takes five times as long as the steps.
    """

    def __init__(self, robot: OverFloor, steps: int) -> None:
        """Make room for so many steps."""
        self._robot = robot
        nv = robot.model.nv
        self._in_c = loop_in_c()
        # For C, which takes a byte for each geom.
        self._of_robot = robot.of_robot.astype(np.uint8)
        self._of_floor = robot.of_floor.astype(np.uint8)
        # Of each step, at its start: velocities, and the Jacobian of the centre of mass.
        self._velocity = np.empty((steps, nv))
        self._centre = np.empty((steps, 3, nv))
        # Points until the end of each step.
        self._ends = [0]
        # Of each point: its two geoms, MuJoCo's contact force, frame and distance, and the Jacobian
        # of the robot's material there.
        room = _CONTACTS * steps
        self._geoms = np.empty((room, 2), dtype=np.int32)
        self._wrench = np.empty((room, 6))
        self._frame = np.empty((room, 3, 3))
        self._distance = np.empty(room)
        self._jacobian = np.empty((room, 3, nv))
        self._find_addresses()

    @property
    def is_full(self) -> bool:
        """True if there is no room for another step."""
        return len(self._ends) > len(self._velocity)

    def begin(self, data: Any) -> None:
        """Keep the velocities before a step."""
        self._velocity[len(self._ends) - 1] = data.qvel

    def read(self, data: Any) -> bool:
        """Read the step that was just taken in `data`; False where MuJoCo reset the state in it."""
        read = self._read_in_python if self._in_c is None else self._read_in_c
        count = read(data)
        if count > len(self._distance) - self._ends[-1]:
            self._make_room(count)
            count = read(data)
        self._ends.append(self._ends[-1] + max(count, 0))
        return count >= 0

    def presses(self) -> bool:
        """Say whether the floor pressed on the robot in the last step."""
        begin, end = self._ends[-2:]
        return bool((self._wrench[begin:end, 0] > 0.0).any())

    def steps(self) -> Iterator[FloorStep]:
        """Yield what the floor did in each step, and forget them."""
        ends = self._ends
        self._ends = [0]
        count = len(ends) - 1
        total = ends[-1]
        step_of = np.repeat(np.arange(count), np.diff(ends))
        velocity = self._velocity[:count]
        rising = _dots(self._robot.up @ self._centre[:count], velocity)
        # MuJoCo's normal leads from the first geom to the second: its sign is 1 where that is from
        # the floor to the robot, else -1.
        geoms = self._geoms[:total].astype(np.int64)
        is_second = self._robot.of_robot[geoms[:, 1]]
        sign = np.where(is_second, 1.0, -1.0)
        geom = np.where(is_second, geoms[:, 1], geoms[:, 0]).tolist()
        floor = np.where(is_second, geoms[:, 0], geoms[:, 1]).tolist()
        frame = self._frame[:total]
        wrench = self._wrench[:total]
        along_world = (np.swapaxes(frame, 1, 2) @ wrench[:, :3, None])[:, :, 0]
        upward = (sign * _dots(np.broadcast_to(self._robot.up, (total, 3)), along_world)).tolist()
        # Of the robot's material at each point.
        normal = sign[:, None] * frame[:, 0]
        of_point = (self._jacobian[:total] @ velocity[step_of][:, :, None])[:, :, 0]
        away = _dots(normal, of_point)
        along = of_point - away[:, None] * normal
        slide = np.sqrt(_dots(along, along)).tolist()
        speed = (-away).tolist()
        depth = (-self._distance[:total]).tolist()
        force = wrench[:, 0].tolist()
        for step in range(count):
            points = []
            sum_upward = 0.0
            for i in range(ends[step], ends[step + 1]):
                sum_upward += upward[i]
                if force[i] > 0.0:
                    points.append(Point(geom[i], floor[i], force[i], depth[i], speed[i], slide[i]))
            yield FloorStep(points, sum_upward, float(rising[step]))

    def _make_room(self, more: int) -> None:
        """Make room for so many points more, and for twice as many in all."""
        for name in ("_geoms", "_wrench", "_frame", "_distance", "_jacobian"):
            array = getattr(self, name)
            extra = np.empty((len(array) + more, *array.shape[1:]), dtype=array.dtype)
            setattr(self, name, np.concatenate([array, extra]))
        self._find_addresses()

    def _find_addresses(self) -> None:
        """Keep where arrays are, for C: to ask NumPy in each step takes as long as the step."""
        masks = (self._of_robot, self._of_floor)
        self._masks = [array.ctypes.data for array in masks]
        of_points = (self._geoms, self._wrench, self._frame, self._distance, self._jacobian)
        # The address of each array of points, and the bytes of a point in it.
        self._places = [(array.ctypes.data, array.strides[0]) for array in of_points]
        self._of_centre = (self._centre.ctypes.data, self._centre.strides[0])

    def _read_in_c(self, data: Any) -> int:
        """Read a step by launch.c: the number of its points, which may be more than there is room for,
        or -1 for a state that was reset.

        data: MjData after the step.
        """
        assert self._in_c is not None, "asked for only with a library"
        begin = self._ends[-1]
        places = [address + begin * size for address, size in self._places]
        address, size = self._of_centre
        places.append(address + (len(self._ends) - 1) * size)
        room = len(self._distance) - begin
        robot = self._robot
        return int(
            self._in_c.read_floor(
                robot.model._address, data._address, robot.root, *self._masks, room, *places
            )
        )

    def _read_in_python(self, data: Any) -> int:
        """Read a step without C: the number of its points, which may be more than there is room for
        (then only the first of them are kept), or -1 for a state that was reset.

        data: MjData after the step.
        """
        if resets(data):
            return -1
        mujoco = backend()
        model = self._robot.model
        contacts = data.contact
        # A contact without a constraint row has no force.
        acting = self._robot.between(contacts.geom) & (contacts.efc_address >= 0)
        begin = self._ends[-1]
        places = np.flatnonzero(acting).tolist()
        for at, i in enumerate(places[: len(self._distance) - begin], begin):
            one, two = contacts.geom[i].tolist()
            mujoco.mj_contactForce(model, data, i, self._wrench[at])
            self._geoms[at] = one, two
            self._frame[at] = contacts.frame[i].reshape(3, 3)
            self._distance[at] = contacts.dist[i]
            geom = two if self._robot.of_robot[two] else one
            body = int(model.geom_bodyid[geom])
            mujoco.mj_jac(model, data, self._jacobian[at], None, contacts.pos[i], body)
        centre = self._centre[len(self._ends) - 1]
        mujoco.mj_jacSubtreeCom(model, data, centre, self._robot.root)
        return len(places)


def _dots(one: Any, other: Any) -> Any:
    """Products of vectors, (n,), of two arrays, (n, k): each as `one @ other` has it."""
    return (one[:, None, :] @ other[:, :, None])[:, 0, 0]
