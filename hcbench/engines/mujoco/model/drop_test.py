"""MuJoCo: a robot dropped on its floor in its pose, its joints held, and read by sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import (
    backend,
    captured_warnings,
    forget_resets,
    require_feature,
)
from hcbench.engines.mujoco.model.falling import base_of_pairs, held_names
from hcbench.engines.mujoco.model.open import as_requested
from hcbench.engines.mujoco.model.over_floor import OverFloor, hold_pose
from hcbench.engines.mujoco.model.start_pose import posed_joints, start_pose
from hcbench.engines.mujoco.model.write_pairs import label_of, spec_of
from hcbench.sim.drop_test import DropBench, DropMotion, DroppedRobot
from hcbench.sim.landing import (
    DROPS,
    HEIGHTS,
    PHASES,
    SECONDS_TO_FALL,
    TILT_AXIS,
    DropTest,
    Landed,
    Robot,
    RobotDrop,
    drop_test,
)
from hcbench.sim.rest import LandingPeak
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.sim.model_under_test import Request
    from hcbench.terms.impact import Floats

# Last part of a short drop, s, in which the feet of a robot that stands are on the floor.
_STANDS_S = 0.2
# Share of its range by which a joint that is beyond a limit is bent into it.
_WITHIN_LIMITS = 0.05
# MuJoCo's contact sensor (XML reference, sensor/contact): bits of what it reads, 1 for the force and
# 3 for the distance; how it joins contacts, 3 to the net force in the world and 1 to the least
# distance; how many results.
_NET_FORCE = (1 << 1, 3, 1)
_LEAST_DISTANCE = (1 << 3, 1, 1)
# Names of what is added to a model.
_OURS = "hcbench drop test "


@dataclass(frozen=True, slots=True)
class _SensorColumns:
    """Columns of the sensors in MuJoCo's sensor data, of a spec to which `_add_sensors` added them.

    centre, velocity: the first of three.
    potential, kinetic: energies, J.
    floors: the first of four of each body that stands still: the force of its contacts with the
    robot in the world, N, then the least distance, m.
    actuators: one each.
    """

    centre: int
    velocity: int
    potential: int
    kinetic: int
    floors: list[int]
    actuators: list[int]

    @classmethod
    def of(cls, model: Any) -> _SensorColumns:
        """Find the columns by the sensors' names, in a model compiled with those of `_add_sensors`."""

        def column(name: str) -> int:
            return int(model.sensor(f"{_OURS}{name}").adr[0])

        def columns(kind: str) -> list[int]:
            names = [str(model.sensor(i).name) for i in range(model.nsensor)]
            of_kind = [i for i, name in enumerate(names) if name.startswith(f"{_OURS}{kind}")]
            return [int(model.sensor_adr[i]) for i in of_kind]

        return cls(
            centre=column("centre"),
            velocity=column("speed"),
            potential=column("potential"),
            kinetic=column("kinetic"),
            floors=columns("force"),
            actuators=columns("length"),
        )


class ModelDropBench(DropBench):
    """A tree of bodies over its floor, whose contacts a search may change in `model` between tests.

    base: how it falls.
    """

    def __init__(self, spec: Any, label: str, requests: Sequence[Request]) -> None:
        """Add sensors to the model, let constant controls hold its pose, and find where each drop
        begins.

        spec: of the whole model, copied.
        label: what to call it.
        requests: of pairs of the tree with the floor; the first has the pose, step and gravity.
        Raises UserError for what cannot be dropped, EngineMissing for a MuJoCo without contact
        sensors.
        """
        require_feature(backend(), "contact sensors")
        request = requests[0]
        spec = spec.copy()
        plain = as_requested(spec.compile(), request)
        start, _ = start_pose(plain, request)
        bent = _bend_into_limits(plain, start)
        backend().mj_forward(plain, start)
        # The model with sensors has the same bodies and joints.
        self.base = base_of_pairs(plain, start, requests)
        root = self.base.root
        _add_sensors(spec, plain, root)
        self.model = as_requested(spec.compile(), request)
        # Else MuJoCo leaves the sensors of energy at 0.
        self.model.opt.enableflags |= int(backend().mjtEnableBit.mjENBL_ENERGY)
        self.timestep = float(self.model.opt.timestep)
        self._over_floor = OverFloor(self.model, root)
        self.gravity = self._over_floor.gravity
        if self.base.turns_by is None:
            # Tilted it would fall as it does flat.
            self.drops = tuple(drop for drop in DROPS if not drop.tilt)
        self._start, _ = start_pose(self.model, request)
        _bend_into_limits(self.model, self._start)
        backend().mj_forward(self.model, self._start)
        # A rollout begins with the places of mocap bodies and the equalities of the model alone.
        is_mocap = self.model.body_mocapid >= 0
        order = self.model.body_mocapid[is_mocap]
        self.model.body_pos[is_mocap] = self._start.mocap_pos[order]
        self.model.body_quat[is_mocap] = self._start.mocap_quat[order]
        self.model.eq_active0[:] = self._start.eq_active
        posed = posed_joints(self.model, request)
        self._controls, controller = hold_pose(self.model, self._start, root, posed)
        if bent:
            controller += f"; {bent} joints beyond their limits are bent into them"
        if self.base.held:
            controller += f"; it holds {', '.join(held_names(plain, self.base))}"
        self.robot = self._described(label, controller)
        self._data = backend().MjData(self.model)
        self._columns = _SensorColumns.of(self.model)
        # MuJoCo's full state at release, (nstate,).
        self._states: dict[RobotDrop, Floats] = {}
        over_floor = self._over_floor
        self._dropped = DroppedRobot(
            self.timestep, self.gravity, over_floor.up, over_floor.weight, self._measured_height()
        )

    @property
    def hardest(self) -> list[RobotDrop]:
        """Drops that show most of what lands worse, the highest and tilted first: one of each height and
        tilt.
        """
        last = max(PHASES)
        return [drop for drop in reversed(self.drops) if drop.phase == last]

    def _described(self, label: str, controller: str) -> Robot:
        """Data of the robot for results: names, mass (kg), time step (s) and gravity (m/s²).

        label: name of its model.
        controller: what holds its joints, in words.
        """
        gx, gy, gz = np.asarray(self.model.opt.gravity).tolist()
        return Robot(
            engine="mujoco",
            model=label,
            name=self._over_floor.name,
            mass=self._over_floor.mass,
            timestep=self.timestep,
            gravity=(gx, gy, gz),
            controller=controller,
        )

    def test(self, seconds: float, drops: Sequence[RobotDrop]) -> DropTest:
        """Drop the robot with the contacts that `model` has now, and join what each drop shows.

        drops: those to make, of DROPS.
        seconds: to simulate of each drop.
        A drop that diverges makes the whole test a diverged one.
        Raises EngineFailed for a fatal error of MuJoCo's.
        """
        landed = {}
        with captured_warnings():
            for drop in drops:
                landed[drop] = self._landed(drop, seconds)
        return drop_test(self.robot, landed, seconds)

    def _released(self, drop: RobotDrop) -> Floats:
        """MuJoCo's full state of the robot at the release of a drop, (nstate,), computed once."""
        if drop not in self._states:
            self._states[drop] = self._release(drop)
        return self._states[drop]

    def _release(self, drop: RobotDrop) -> Floats:
        """MuJoCo's full state of the robot at the release of a drop, (nstate,).

        The phase of a drop raises the robot by this share of the way that it falls in the step of
        the touch, so that it touches later by this share of a step.
        """
        mujoco = backend()
        model = self.model
        data = mujoco.MjData(model)
        data.qpos[:] = self._start.qpos
        data.act[:] = self._start.act
        self.base.tilt(model, data, TILT_AXIS, drop.tilt)
        to_touch = self._over_floor.way_up(data, self.base.rise)
        speed_at_touch = math.sqrt(2.0 * self.gravity * drop.height)
        for_phase = speed_at_touch * self.timestep * drop.phase
        self.base.release(model, data, to_touch, drop.height + for_phase)
        mujoco.mj_forward(model, data)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        state = np.zeros(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, state, kind)
        return state

    def standing_geoms(self) -> set[tuple[int, int]]:
        """Geoms on which the robot stands after a flat drop from 2 cm: (number of the robot's geom,
        of the floor's) of each contact with a force in the last _STANDS_S of SECONDS_TO_FALL.

        Contacts that press in only some of these steps count.
        """
        mujoco = backend()
        data = mujoco.MjData(self.model)
        mujoco.mj_setState(
            self.model, data, self._released(DROPS[0]), mujoco.mjtState.mjSTATE_FULLPHYSICS
        )
        data.ctrl[:] = self._controls
        of_robot = self._over_floor.of_robot
        standing = set()
        for step in range(round(SECONDS_TO_FALL / self.timestep)):
            mujoco.mj_step(self.model, data)
            if step * self.timestep < SECONDS_TO_FALL - _STANDS_S:
                continue
            contacts = data.contact
            acting = self._over_floor.between(contacts.geom) & (contacts.efc_address >= 0)
            for one, other in contacts.geom[acting].tolist():
                standing.add((one, other) if of_robot[one] else (other, one))
        return standing

    def _measured_height(self) -> float:
        """Height of the robot's centre of mass over its lowest point in the pose, m, 1 mm at least.

        The lowest point is that of the geoms' bounding spheres, so the height may be too large.
        """
        mujoco = backend()
        up = self._over_floor.up
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        mujoco.mj_setState(self.model, self._data, self._released(DROPS[0]), kind)
        mujoco.mj_forward(self.model, self._data)
        centre = self._data.subtree_com[self._over_floor.root]
        lowest = math.inf
        for geom in np.flatnonzero(self._over_floor.of_robot[:-1]).tolist():
            middle = float(up @ self._data.geom_xpos[geom])
            lowest = min(lowest, middle - float(self.model.geom_rbound[geom]))
        return max(float(up @ centre) - lowest, 1e-3)

    def _landed(self, drop: RobotDrop, seconds: float) -> Landed | None:
        """Simulate one drop for `seconds`, and read how the robot lands; None where it diverges, or
        never touches the floor.

        drop: height, tilt and phase.
        Raises MuJoCo's fatal errors as they are.
        """
        mujoco = backend()
        steps = round(seconds / self.timestep)
        forget_resets(self._data)
        states, sensors = mujoco.rollout.rollout(
            self.model,
            [self._data],
            self._released(drop)[None],
            np.broadcast_to(self._controls, (1, 1, self.model.nu)).copy(),
            nstep=steps,
        )
        state = states[0]
        # MuJoCo sets the time back where it resets an unstable state.
        lasted = state[-1, 0] - state[0, 0]
        is_whole = abs(lasted - (steps - 1) * self.timestep) < 0.5 * self.timestep
        if not (is_whole and np.isfinite(sensors).all()):
            return None
        return self._dropped.landed(self._motion(state, sensors[0]), drop.height)

    def _motion(self, state: Floats, sensors: Floats) -> DropMotion:
        """Motion of the robot at each of n steps, read from the sensors of a simulation.

        state: MuJoCo's full state after each step, (n, nstate).
        sensors: data of all sensors, (n, nsensordata).
        """
        columns = self._columns
        upward = np.zeros(len(sensors))
        distance = np.zeros(len(sensors))
        for floor in columns.floors:
            upward += sensors[:, floor : floor + 3] @ self._over_floor.up
            distance = np.minimum(distance, sensors[:, floor + 3])
        return DropMotion(
            centre=sensors[:, columns.centre : columns.centre + 3],
            velocity=sensors[:, columns.velocity : columns.velocity + 3],
            # Upwards on the robot or downwards on the floor, by the order of the two: its size counts.
            force=np.abs(upward),
            distance=distance,
            energy=self._energy(state, sensors),
        )

    def _energy(self, state: Floats, sensors: Floats) -> Floats:
        """Energy of the robot, J, (n,), its servos counted as springs.

        A servo of kp pulls its joint's length l to its target by kp (target - l): a spring. Without
        its energy, one that a landing stretches and that lets go later would seem to make some.
        state: after each step, (n, nstate).
        sensors: their data, (n, nsensor).
        """
        columns = self._columns
        model = self.model
        energy: Floats = sensors[:, columns.potential] + sensors[:, columns.kinetic]
        if not model.nu:
            return energy
        targets = np.tile(self._controls, (len(sensors), 1))
        for actuator in np.flatnonzero(model.actuator_actnum).tolist():
            # The target of a filtered servo is its activation: time, positions and velocities come
            # before it in a state.
            activation = 1 + model.nq + model.nv + int(model.actuator_actadr[actuator])
            targets[:, actuator] = state[:, activation]
        # A position servo has -kp in the second number of its bias.
        stiffness = np.maximum(-model.actuator_biasprm[:, 1], 0.0)
        behind = sensors[:, columns.actuators] - targets
        energy += 0.5 * (behind**2 * stiffness).sum(axis=1)
        return energy


def landing(
    source: Any, requests: Sequence[Request], like: DropTest | None, until_worse: bool = False
) -> DropTest:
    """Drop a robot in its pose from all heights, tilts and phases of DROPS, and judge its landing.

    source: a file, MJCF text or an MjSpec.
    requests: of pairs of the robot with its floor; the first has the pose.
    like: a test whose length this one takes; None: long enough to come to rest.
    until_worse: one drop is enough where something is worse in it than in all of `like`.
    Raises UserError for what cannot be dropped or copied and for a rigid body, EngineMissing for a
    MuJoCo without contact sensors.
    """
    bench = ModelDropBench(spec_of(source), label_of(source), requests)
    if not bench.base.has_joints:
        raise UserError(
            "pair",
            f"{bench.robot.name!r} is one rigid body",
            "a robot, which has joints beside those by which it falls",
            "The rebound of a body is its e squared times the drop: give --restitution",
        )
    if like is not None and until_worse:
        for drop in bench.hardest:
            test = bench.test(like.seconds, [drop])
            # Quantities are the largest of all drops: the others change nothing.
            if any(test.worse_than(like)):
                return test
    return bench.whole_test(like)


def landing_peaks(source: Any, request: Request) -> tuple[LandingPeak, ...]:
    """Drop the whole tree of the pair's moving body flat from each of HEIGHTS: for each the lowest
    and the highest peak force over its weight, over the phases; infinite where it diverges.

    source: a file, MJCF text or an MjSpec.
    request: of the pair.
    Raises UserError for what cannot be dropped or copied, EngineMissing for a MuJoCo without
    contact sensors.
    """
    bench = ModelDropBench(spec_of(source), label_of(source), [request])
    of_height: dict[float, list[float]] = {height: [] for height in HEIGHTS}
    for drop in DROPS:
        if not drop.tilt:
            of_height[drop.height].append(bench.test(SECONDS_TO_FALL, [drop]).peak)
    return tuple(LandingPeak(h, min(peaks), max(peaks)) for h, peaks in of_height.items())


def _bend_into_limits(model: Any, data: Any) -> int:
    """Bend joints that are beyond their limits back into them, as limits would throw the robot;
    return how many there were.

    data: MjData of the pose, whose qpos is changed: such a hinge or slide is put inside its limit
    by _WITHIN_LIMITS of its range.
    Ball joints are left as they are.
    """
    kinds = backend().mjtJoint
    bent = 0
    for joint in np.flatnonzero(model.jnt_limited).tolist():
        if int(model.jnt_type[joint]) < int(kinds.mjJNT_SLIDE):
            continue
        low, high = model.jnt_range[joint].tolist()
        address = int(model.jnt_qposadr[joint])
        inside = _WITHIN_LIMITS * (high - low)
        if not low <= data.qpos[address] <= high:
            data.qpos[address] = np.clip(data.qpos[address], low + inside, high - inside)
            bent += 1
    return bent


def _add_sensors(spec: Any, model: Any, root: int) -> None:
    """Replace a spec's sensors by those that a test reads; `_SensorColumns` finds them by name.

    spec: changed; bodies and actuators without a name get one, as sensors go by names.
    model: compiled of it before.
    root: number of the base.
    """
    sensors = backend().mjtSensor
    objects = backend().mjtObj
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    bodies = list(spec.bodies)
    base = bodies[root]
    base.name = base.name or f"{_OURS}base"
    of_base = {"objtype": objects.mjOBJ_BODY, "objname": base.name}
    spec.add_sensor(name=f"{_OURS}centre", type=sensors.mjSENS_SUBTREECOM, **of_base)
    spec.add_sensor(name=f"{_OURS}speed", type=sensors.mjSENS_SUBTREELINVEL, **of_base)
    spec.add_sensor(name=f"{_OURS}potential", type=sensors.mjSENS_E_POTENTIAL)
    spec.add_sensor(name=f"{_OURS}kinetic", type=sensors.mjSENS_E_KINETIC)
    for number in sorted({int(model.geom_bodyid[g]) for g in range(model.ngeom)}):
        if model.body_weldid[number]:
            continue
        body = bodies[number]
        # The world has its own name.
        if number:
            body.name = body.name or f"{_OURS}floor {number}"
        _add_contact_sensor(spec, f"{_OURS}force {number}", base.name, body.name, _NET_FORCE)
        _add_contact_sensor(
            spec, f"{_OURS}distance {number}", base.name, body.name, _LEAST_DISTANCE
        )
    for number, actuator in enumerate(spec.actuators):
        actuator.name = actuator.name or f"{_OURS}actuator {number}"
        spec.add_sensor(
            name=f"{_OURS}length {number}",
            type=sensors.mjSENS_ACTUATORPOS,
            objtype=objects.mjOBJ_ACTUATOR,
            objname=actuator.name,
        )


def _add_contact_sensor(
    spec: Any, name: str, base: str, floor: str, read: tuple[int, int, int]
) -> None:
    """Add a sensor of all contacts of a base's tree with one body that stands still.

    spec: changed.
    name: of the sensor.
    base, floor: names of the two bodies.
    read: _NET_FORCE or _LEAST_DISTANCE.
    """
    objects = backend().mjtObj
    sensor = spec.add_sensor(
        name=name,
        type=backend().mjtSensor.mjSENS_CONTACT,
        # mjOBJ_XBODY means the body's whole tree to this sensor, mjOBJ_BODY the body alone.
        objtype=objects.mjOBJ_XBODY,
        objname=base,
        reftype=objects.mjOBJ_BODY,
        refname=floor,
    )
    sensor.intprm[:3] = read
