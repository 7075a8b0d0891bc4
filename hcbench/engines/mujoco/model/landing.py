"""MuJoCo: a robot under its controller dropped on its floor, which is read as a force plate."""

from __future__ import annotations

import copy
import functools
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import (
    backend,
    captured_warnings,
    forget_resets,
    plugin_warnings,
    resets,
)
from hcbench.engines.mujoco.model.bodies import (
    body_name,
    geom_name,
    integrator_name,
    volumes,
)
from hcbench.engines.mujoco.model.falling import held_names, robot_in
from hcbench.engines.mujoco.model.find_pair import contact_in_force, named_pair
from hcbench.engines.mujoco.model.floor_record import FloorRecord, Point
from hcbench.engines.mujoco.model.open import copy_state
from hcbench.engines.mujoco.model.over_floor import Drive, OverFloor, drive_of
from hcbench.engines.mujoco.model.pair import WithoutContact, restitution_law
from hcbench.engines.mujoco.model.promises import broken_promise, promise_in
from hcbench.engines.mujoco.model.start_pose import posed_joints, require_quaternions, start_pose
from hcbench.sim.landing import (
    WINDOW_S,
    DropPlan,
    FootfallLog,
    Landing,
    Landings,
    latest_touch,
    over_phases,
    raised_for,
    take_off_speed,
)
from hcbench.sim.model_under_test import Request, Vector, unit_notes
from hcbench.sim.touch import (
    ANY_SPEED,
    NewTouches,
    RecordedMotion,
    Touchdown,
    Touchdowns,
    TrajectoryTouchdowns,
)
from hcbench.system.errors import EngineFailed, UserError
from hcbench.terms.impact import Floats


def land(model: Any, label: str, state: Any, request: Request, drops: DropPlan) -> Landings:
    """Drop the robot of a model from each height (m) at each tilt (rad) of a plan.

    model: compiled MjModel.
    label: what to call it.
    state: an MjData to start from, or None.
    Raises UserError where nothing of the model falls, no gravity or nothing to land on, and for a
    controller that does not fit; EngineFailed where MuJoCo finds the state unstable.
    """
    with captured_warnings() as warned:
        start, start_name = start_pose(model, request, state)
        bench = _Bench(model, start, request.move)
        robot = bench.over_floor
        posed = posed_joints(model, request)
        drive, controller = drive_of(drops.controller, model, start, robot.root, posed)
        landings = []
        for height, tilt in itertools.product(drops.heights, drops.tilts):
            landing_at = functools.partial(bench.landing, height, (tilt, drops.axis), drive)
            landings.append(over_phases(landing_at))
    return Landings(
        engine="mujoco",
        version=backend().__version__,
        model=label,
        robot=robot.name,
        floor=", ".join(geom_name(model, geom) for geom in sorted(bench.floor_geoms)),
        start=start_name,
        controller=controller,
        mass=robot.mass,
        timestep=bench.timestep,
        gravity=robot.gravity,
        drops=tuple(landings),
        notes=(
            *bench.notes,
            *plugin_warnings(warned),
            *_broken_promises(model, bench.floor_geoms),
            *unit_notes(robot.name, robot.mass, *volumes(model, start, robot.root)),
        ),
    )


def _broken_promises(model: Any, floor: Iterable[int]) -> Iterator[str]:
    """Sentences on contacts with the floor that are no longer as `hcbench tune` wrote them, one for
    each kind of change.

    floor: numbers of the floor's geoms that were touched.
    """
    gravity = float(np.linalg.norm(model.opt.gravity))
    reported = set()
    for geom, other in itertools.product(range(model.ngeom), sorted(floor)):
        promise = promise_in(model, (geom, other))
        if promise is None:
            continue
        for suspect in broken_promise(model, promise, (geom, other), gravity):
            if suspect.code not in reported:
                reported.add(suspect.code)
                yield f"{suspect.title} {suspect.evidence} ({suspect.code})."


# Steps that are read together; each takes 1 kB, and more with contacts and joints.
_STEPS_AT_ONCE = 256


class _Foot(NamedTuple):
    """A rigid part of the robot that met the floor, and the numbers of its geoms that did."""

    log: FootfallLog
    geoms: set[int]


# Feet by the number of the body that each is welded to.
_Feet = dict[int, _Foot]


class _Fall(NamedTuple):
    """A drop from its first touch on: its feet, and of each step the force of the floor on the robot,
    N upwards, and the speed of its centre of mass upwards at the step's start, m/s.
    """

    feet: _Feet
    forces: list[float]
    rising: list[float]


class _Bench:
    """A robot in its pose, over the parts of the world that it can land on.

    start: MjData of the pose, with its kinematics. base: how the robot falls. notes: sentences on
    how it was chosen. floor_geoms: numbers of the geoms that were touched until now.
    """

    def __init__(self, model: Any, start: Any, move: str | None) -> None:
        """Find the robot and what it can land on.

        start: MjData of the pose to drop it in.
        move: the part of the tree to drop, "body:NAME" or "joint:NAME"; else the robot.
        Raises UserError for a model in which that does not fall.
        """
        self.model = model
        self.start = start
        self.timestep = float(model.opt.timestep)
        backend().mj_forward(model, start)
        self.base, notes = robot_in(model, start, move)
        held = held_names(model, self.base)
        self.notes = [*notes, *([f"It holds {', '.join(held)}, dropped with it."] if held else [])]
        root = self.base.root
        self.over_floor = OverFloor(model, root)
        # RK4 leaves the contacts of its last stage: those of the step's start are computed beside it.
        self._stage = backend().MjData(model) if integrator_name(model) == "RK4" else None
        self.floor_geoms: set[int] = set()
        # (robot's geom, floor's) of the pairs that a plug-in's law turns back by impulses.
        self._struck = self._pairs_of_impulses()
        # MuJoCo tells no contact force of an impulse. A step beside it, without contact, does.
        self._without_contact = WithoutContact(model) if self._struck else None

    def _pairs_of_impulses(self) -> set[tuple[int, int]]:
        """Numbers (robot's geom, floor's) of the geoms between which a plug-in's restitution law acts,
        which turns bodies back by impulses.
        """
        if not self.model.nplugin:
            return set()
        geoms = np.flatnonzero(self.over_floor.of_robot[:-1]).tolist()
        floors = np.flatnonzero(self.over_floor.of_floor[:-1]).tolist()
        pairs = itertools.product(geoms, floors)
        return {pair for pair in pairs if restitution_law(self.model, pair) is not None}

    def landing(
        self, height: float, turn: tuple[float, Vector], drive: Drive, phase: float
    ) -> Landing:
        """Drop the robot once, and read how it lands.

        height: of its lowest point over the floor, m.
        turn: angle, rad, by which its base is turned, and the axis in the world.
        drive: sets the controls before each step.
        phase: place of the touch in a step.
        Raises UserError where nothing is below the robot, or it meets nothing; EngineFailed where
        MuJoCo finds the state unstable.
        """
        data = copy.copy(self.start)
        tilt, axis = turn
        if tilt and self.base.turns_by is None:
            raise UserError("tilt", f"the base {self.over_floor.name!r} cannot turn", "0")
        self.base.tilt(self.model, data, axis, tilt)
        to_touch = self.over_floor.way_up(data, self.base.rise)
        for_phase = raised_for(phase, height, self.over_floor.gravity, self.timestep)
        self.base.release(self.model, data, to_touch, height + for_phase)
        backend().mj_forward(self.model, data)
        forget_resets(data)
        fall = self._fall(data, height, drive)
        force: Floats = np.array(fall.forces)
        footfalls = [foot.log.footfall(self._name(body, foot)) for body, foot in fall.feet.items()]
        impulse = math.nan
        if self._without_contact is not None:
            impulse = self.timestep * float(force.max())
        return Landing(
            height=height,
            tilt=tilt,
            speed_in=-fall.rising[0],
            speed_out=take_off_speed(force, np.array(fall.rising), self.timestep),
            weight=self.over_floor.weight,
            feet=tuple(footfalls),
            time=np.arange(len(force), dtype=np.float64) * self.timestep,
            force=force,
            impulse=impulse,
        )

    def _fall(self, data: Any, height: float, drive: Drive) -> _Fall:
        """Simulate a drop until WINDOW_S (s) after the first touch.

        data: MjData at release, moved on.
        height: of the lowest point over the floor at release, m.
        drive: sets the controls before each step.
        Raises UserError where the robot meets nothing; EngineFailed where MuJoCo finds the state
        unstable.
        """
        latest = latest_touch(height, self.over_floor.gravity)
        most = math.ceil((latest + WINDOW_S) / self.timestep)
        record = FloorRecord(self.over_floor, min(most, _STEPS_AT_ONCE))
        fall = _Fall({}, [], [])
        first_touch = math.nan
        # Of the steps in `record`: points that are turned back, and the force where impulses act.
        struck: list[list[Point]] = []
        by_momentum: list[float] = []
        for step in range(most):
            time = step * self.timestep
            drive(data)
            record.begin(data)
            struck.append(self._struck_points(data))
            at_start = self._at_start(data)
            backend().mj_step(self.model, data)
            is_reset = self._stage is not None and resets(data)
            if is_reset or not record.read(at_start):
                raise _unstable(time)
            if math.isnan(first_touch) and (struck[-1] or record.presses()):
                first_touch = time
            if self._without_contact is not None and time >= first_touch:
                by_momentum.append(self._force_by_momentum(data, self._without_contact))
            is_over = time - first_touch > WINDOW_S or (math.isnan(first_touch) and time > latest)
            if is_over or record.is_full or step == most - 1:
                self._walk(fall, record, first_touch, step + 1, struck, by_momentum)
                struck.clear()
                by_momentum.clear()
            if is_over:
                break
        if not fall.feet:
            raise UserError(
                "model",
                f"the robot met nothing within {latest:.3g} s",
                "a floor that it collides with",
            )
        return fall

    def _at_start(self, data: Any) -> Any:
        """The MjData that will have the contacts and kinematics of the start of the coming step, once
        the step is taken.

        data: MjData before the step, in which integrators other than RK4 leave them.
        """
        if self._stage is None:
            return data
        copy_state(self.model, data, self._stage)
        backend().mj_forward(self.model, self._stage)
        return self._stage

    def _walk(
        self,
        fall: _Fall,
        record: FloorRecord,
        first_touch: float,
        end: int,
        struck: Sequence[Sequence[Point]],
        by_momentum: Sequence[float],
    ) -> None:
        """Add the steps of a record to a fall, and to the logs of its feet.

        first_touch: time of the first touch, s.
        end: number of the step after the last.
        struck: points of each step that a plug-in's law turns back.
        by_momentum: force of the last steps, N, in place of MuJoCo's contact forces where such a
        law acts.
        """
        begin = end - len(struck)
        # Steps before the first touch have no force by momentum.
        without = len(struck) - len(by_momentum)
        for k, step in enumerate(record.steps()):
            time = (begin + k) * self.timestep
            since_touch = time - first_touch if fall.feet else 0.0
            self._tread(fall.feet, step.points, struck[k], since_touch)
            if not fall.feet:
                continue
            force = step.force if self._without_contact is None else by_momentum[k - without]
            fall.forces.append(force)
            fall.rising.append(step.rising)

    def _struck_points(self, data: Any) -> list[Point]:
        """Points of the robot that a plug-in's law will turn back by impulses in the coming step;
        empty for a model without such a law.

        data: MjData before the step. The plug-in acts within the step, so the points are found
        before it. The state is also copied into the data of the step without contact, which
        `_force_by_momentum` takes.
        """
        if self._without_contact is None:
            return []
        trial = self._without_contact.data
        copy_state(self.model, data, trial)
        backend().mj_fwdPosition(self.model, trial)
        points = []
        for contact in trial.contact:
            geom, floor, sign = self._robot_first(contact.geom)
            depth_of_margin = float(contact.includemargin - contact.dist)
            if (geom, floor) not in self._struck or depth_of_margin < 0.0:
                continue
            normal = sign * contact.frame[:3]
            speed, slide = self._speeds(trial, trial.qvel, contact.pos, normal, geom)
            if speed > 0.0:
                points.append(Point(geom, floor, 0.0, -float(contact.dist), speed, slide))
        return points

    def _force_by_momentum(self, data: Any, beside: WithoutContact) -> float:
        """Mean force of the floor on the robot in the step just taken, N upwards: its momentum less
        that after the same step without contact, over the time step.

        data: MjData after the step.
        beside: has the state before the step; its step without contact is taken here.
        """
        robot = self.over_floor
        jacobian = np.zeros((3, self.model.nv))
        backend().mj_jacSubtreeCom(self.model, beside.data, jacobian, robot.root)
        gained = float(robot.up @ jacobian @ (data.qvel - beside.step()))
        return robot.mass * gained / self.timestep

    def _tread(
        self, feet: _Feet, pressed: Sequence[Point], struck: Sequence[Point], time: float
    ) -> None:
        """Add one step to the logs of the feet, and a new foot for each part that touches first.

        feet: by the number of their rigid body; changed.
        pressed: points of the step that feel forces.
        struck: points that a plug-in's law turns back by impulses.
        time: of the step's start, s after the first touch.
        """
        pressed_of: dict[int, list[Point]] = {}
        for point in pressed:
            pressed_of.setdefault(self._rigid_body(point.geom), []).append(point)
            self.floor_geoms.add(point.floor)
        for body, points in pressed_of.items():
            geoms = {point.geom for point in points}
            force, slip = _mean_slide(points)
            if body not in feet:
                has_law = any(not geoms.isdisjoint(pair) for pair in self._struck)
                fastest = max(point.speed for point in points)
                farthest = max(point.slide for point in points)
                log = FootfallLog(time, fastest, farthest, by_impulses=has_law)
                feet[body] = _Foot(log, set())
            feet[body].geoms.update(geoms)
            depth = max(point.depth for point in points)
            feet[body].log.add(time, self.timestep, force, slip, depth)
        for point in struck:
            body = self._rigid_body(point.geom)
            if body not in feet:
                log = FootfallLog(time, point.speed, point.slide, by_impulses=True)
                feet[body] = _Foot(log, set())
            if body not in pressed_of:
                feet[body].log.add(time, self.timestep, point.force, point.slide, point.depth)
            feet[body].geoms.add(point.geom)
            self.floor_geoms.add(point.floor)

    def _rigid_body(self, geom: int) -> int:
        """Number of the body that the geom's body is welded to."""
        return int(self.model.body_weldid[self.model.geom_bodyid[geom]])

    def _robot_first(self, geoms: Any) -> tuple[int, int, float]:
        """(the robot's geom, the floor's, sign) of a contact, by its geoms, (2,), -1 for a flex.

        MuJoCo's normal leads from the first geom to the second: the sign is 1 where that is from
        the floor to the robot, else -1. Of a contact that is not between the two, such as of two
        legs, the order means nothing: callers leave it out.
        """
        one, two = geoms.tolist()
        if self.over_floor.of_robot[two]:
            return two, one, 1.0
        return one, two, -1.0

    def _speeds(
        self, data: Any, velocity: Floats, point: Floats, normal: Floats, geom: int
    ) -> tuple[float, float]:
        """Speeds of a point of the robot towards the floor and along it, m/s.

        data: MjData with the kinematics.
        velocity: of the model, (nv,).
        point: m, (3,).
        normal: unit vector away from the floor, (3,).
        geom: number of the robot's geom that has the point.
        """
        jacobian = np.zeros((3, self.model.nv))
        body = int(self.model.geom_bodyid[geom])
        backend().mj_jac(self.model, data, jacobian, None, point, body)
        of_point = jacobian @ velocity
        away = float(normal @ of_point)
        along = of_point - away * normal
        # What np.linalg.norm computes, in a fifth of its time.
        return -away, math.sqrt(along.dot(along))

    def _name(self, body: int, foot: _Foot) -> str:
        """Name of a foot: the only geom that touched, if it has a name, else the body."""
        (geom, *more) = sorted(foot.geoms)
        name = "" if more else self.model.geom(geom).name
        return geom_name(self.model, geom) if name else body_name(self.model, body)


def _mean_slide(points: Sequence[Point]) -> tuple[float, float]:
    """Sum of the points' forces, N, and their mean speed along the floor weighed by the forces, m/s.

    points: one or more, at which the floor presses.
    """
    if len(points) == 1:
        # Most feet: arrays of one number take ten times as long, and give the same bits.
        force, slide = points[0].force, points[0].slide
        return force, force * slide / force
    forces = np.array([point.force for point in points])
    slides = np.array([point.slide for point in points])
    total = float(forces.sum())
    return total, float(forces @ slides) / total


def _unstable(time: float) -> EngineFailed:
    """The error to raise where MuJoCo reset the state in a step, as it does with an unstable one.

    time: from release to the step's start, s.
    """
    return EngineFailed(
        "model",
        f"MuJoCo found the state unstable {time:.3g} s after release",
        "a robot that its controller holds",
        "Try --controller pd:KP,KD or a smaller --timestep",
    )


# MuJoCo: a recorded motion of a model, read for the speeds at which its parts met the floor.

# Numbers of two geoms, that of the body that moves first.
_Geoms = tuple[int, int]
# Numbers of the two rigid parts that they belong to, in no order: which one MuJoCo's contact begins
# with depends on the kinds of the geoms.
_Parts = frozenset[int]


def touchdowns(
    model: Any, label: str, request: Request, recorded: Mapping[str, Floats]
) -> TrajectoryTouchdowns:
    """Find every touchdown in a recorded motion: of parts that move on parts that do not, or, if
    the request names a pair, of that pair.

    model: MjModel.
    label: what to call it.
    recorded: qpos (n, nq), qvel (n, nv), and time (n,), s, where it is known.
    Raises UserError for other shapes, for states that cannot be, and for a pair that the model does
    not have.
    """
    motion = RecordedMotion.read(recorded, model.nq, model.nv, float(model.opt.timestep))
    require_quaternions(model, motion.qpos, "trajectory")
    kept = None
    if request.pair is not None:
        pair = named_pair(model, request.pair)
        every = itertools.product(pair.first.geoms, pair.second.geoms)
        kept = {_ascending(geoms) for geoms in every}
    with captured_warnings():
        events = _events(model, motion, kept)
    feet = [_foot(model, geoms, of_parts) for geoms, of_parts in events.items()]
    feet.sort(key=lambda foot: (-len(foot.time), foot.part))
    return TrajectoryTouchdowns(
        "mujoco", backend().__version__, label, len(motion.qpos), motion.interval, tuple(feet)
    )


def _ascending(geoms: _Geoms) -> _Geoms:
    first, second = geoms
    return (first, second) if first <= second else (second, first)


def _events(
    model: Any, motion: RecordedMotion, kept: set[_Geoms] | None
) -> dict[_Geoms, list[Touchdown]]:
    """Find the touchdowns of every two rigid parts in a recorded motion, in the order of time; by
    the numbers of the first two of their geoms that touched, the moving one first.

    kept: pairs of geoms whose contacts count, the smaller number first; None: contacts of a part
    that moves with one that does not. Speeds are those of the state before, or of the first in
    contact, the faster of the two: a contact slows, and free flight may speed up, within the time
    between two states. Parts that touch in the first state have not come down.
    """
    qpos, qvel, time = motion.qpos, motion.qvel, motion.time
    now = backend().MjData(model)
    before = backend().MjData(model)
    events: dict[_Parts, list[Touchdown]] = {}
    first_geoms: dict[_Parts, _Geoms] = {}
    touches = NewTouches(time)
    for i in range(len(qpos)):
        _put(model, now, qpos[i], qvel[i])
        # The contact of each two parts that were apart until now, by its place in `now.contact`.
        begun: dict[_Parts, int] = {}
        for contact, geoms in enumerate(_moving_first(model, now, kept)):
            if geoms is None:
                continue
            parts = frozenset(model.body_weldid[model.geom_bodyid[list(geoms)]].tolist())
            first_geoms.setdefault(parts, geoms)
            if touches.begins(parts, i):
                begun[parts] = contact
        if begun:
            _put(model, before, qpos[i - 1], qvel[i - 1])
        for parts, contact in begun.items():
            speed, slide = max(
                _closing_speeds(model, before, now, contact),
                _closing_speeds(model, now, now, contact),
            )
            if speed > 0.0:
                events.setdefault(parts, []).append(Touchdown(float(time[i]), speed, slide))
    return {first_geoms[parts]: of_parts for parts, of_parts in events.items()}


def _put(model: Any, data: Any, qpos: Floats, qvel: Floats) -> None:
    """Put an MjData into a state, (nq,) and (nv,), with its kinematics and contacts."""
    data.qpos[:] = qpos
    data.qvel[:] = qvel
    backend().mj_fwdPosition(model, data)


def _moving_first(model: Any, data: Any, kept: set[_Geoms] | None) -> list[_Geoms | None]:
    """Numbers of the two geoms of each contact in `data`, that of the moving body first; None for a
    contact that does not count.

    kept: pairs of geoms whose contacts count, the smaller number first; None: contacts of a part
    that moves with one that does not.
    """
    contacts = data.contact
    pairs: list[_Geoms | None] = []
    for (a, b), distance, excluded in zip(
        contacts.geom.tolist(), contacts.dist, contacts.exclude, strict=True
    ):
        pairs.append(None)
        # A geom of -1 is none: the contact is that of a flex.
        if excluded or distance > 0.0 or min(a, b) < 0:
            continue
        # Bodies that are welded to the world have a weldid of 0.
        a_moves = bool(model.body_weldid[model.geom_bodyid[a]])
        b_moves = bool(model.body_weldid[model.geom_bodyid[b]])
        is_asked = a_moves != b_moves if kept is None else _ascending((a, b)) in kept
        if is_asked:
            pairs[-1] = (a, b) if a_moves else (b, a)
    return pairs


def _closing_speeds(model: Any, state: Any, touching: Any, contact: int) -> tuple[float, float]:
    """Speeds with which two geoms approach and slide on each other at a contact, m/s.

    state: MjData whose velocities count.
    touching: MjData that has the contact.
    contact: its number there.
    """
    point = touching.contact.pos[contact]
    # From the contact's first geom to its second.
    normal = touching.contact.frame[contact][:3]
    velocity = np.zeros(3)
    jacobian = np.zeros((3, model.nv))
    # Of the first geom's material at the point, less that of the second's.
    for geom, share in zip(touching.contact.geom[contact], (1.0, -1.0), strict=True):
        backend().mj_jac(model, state, jacobian, None, point, int(model.geom_bodyid[geom]))
        velocity += share * (jacobian @ state.qvel)
    approach = float(normal @ velocity)
    return approach, float(np.linalg.norm(velocity - approach * normal))


def _foot(model: Any, geoms: _Geoms, events: Sequence[Touchdown]) -> Touchdowns:
    """Touchdowns of two parts, with the band of speeds that their setting holds in.

    geoms: the first two that touched, one of each part.
    events: one or more, in the order of time.
    """
    promise = promise_in(model, geoms)
    band = None
    if restitution_law(model, geoms) is not None:
        band = ANY_SPEED
        setting = "plug-in hcbench.restitution"
    elif promise is not None:
        band = promise.speeds
        setting = f"{promise.setting} by hcbench: {promise.curve.description}"
    else:
        solref = contact_in_force(model, *geoms)["solref"]
        setting = "solref " + " ".join(f"{x:.4g}" for x in solref)
    part = _geom_or_body_name(model, geoms[0])
    other = _geom_or_body_name(model, geoms[1])
    time, speed, slide = np.array(events).T
    return Touchdowns(part, other, time, speed, slide, band, setting)


def _geom_or_body_name(model: Any, geom: int) -> str:
    """Name of a geom, or of its body where the geom has none."""
    if model.geom(geom).name:
        return geom_name(model, geom)
    return body_name(model, int(model.geom_bodyid[geom]))
