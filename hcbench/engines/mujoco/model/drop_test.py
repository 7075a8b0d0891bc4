"""MuJoCo: a robot dropped on its floor in its pose, its joints held, and read by sensors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import (
    backend,
    captured_warnings,
    forget_resets,
    require_feature,
)
from hcbench.engines.mujoco.model.bodies import body_name
from hcbench.engines.mujoco.model.controllers import hold_pose
from hcbench.engines.mujoco.model.find_pair import named_pair
from hcbench.engines.mujoco.model.open import as_requested
from hcbench.engines.mujoco.model.over_floor import way_up
from hcbench.engines.mujoco.model.start_pose import start_pose
from hcbench.engines.mujoco.model.write_pairs import label_of, spec_of
from hcbench.sim.landing import (
    DROPS,
    FALLEN,
    LATE_S,
    PARTED_S,
    REST_SPEED,
    SECONDS,
    SECONDS_TO_FALL,
    TAIL_S,
    DropTest,
    Landed,
    Robot,
    RobotDrop,
    drop_test,
)
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.sim.model_under_test import Request
    from hcbench.terms.impact import Floats

# Axis in the world about which a free base is tilted: no axis of symmetry of a robot.
_TILT_AXIS = np.array([0.6, 0.8, 0.0])
# Cosine of the angle to gravity below which a slide does not carry a base down.
_VERTICAL = 0.9
# Share of its range by which a joint that is beyond a limit is bent into it.
_WITHIN_LIMITS = 0.05
# A centre of mass that is farther from its start, m, has diverged.
_FARTHEST = 50.0
# Names of what is added to a model.
_OURS = "hcbench drop test "


class DropBench:
    """A robot over its floor, whose contacts a search may change in `model` between tests.

    spec: of the whole model; a copy of it is changed. label: what to call it. requests: of pairs of
    the robot with the floor, in the pose to hold.

    Raises UserError for a pair of which no part is of a tree with actuators that can fall on what
    stands still.
    """

    def __init__(self, spec: Any, label: str, requests: Sequence[Request]) -> None:
        require_feature(backend(), "contact sensors")
        request = requests[0]
        spec = spec.copy()
        plain = as_requested(spec.compile(), request)
        self.root = _robot_in(plain, requests)
        _add_sensors(spec, plain, self.root)
        self.model = model = as_requested(spec.compile(), request)
        model.opt.enableflags |= int(backend().mjtEnableBit.mjENBL_ENERGY)
        self.timestep = float(model.opt.timestep)
        self.gravity = float(np.linalg.norm(model.opt.gravity))
        self.up = -np.asarray(model.opt.gravity) / self.gravity
        self.weight = float(model.body_subtreemass[self.root]) * self.gravity
        self.start, _ = start_pose(model, request)
        bent = _bend_into_limits(model, self.start)
        backend().mj_forward(model, self.start)
        self.controls, controller = hold_pose(model, self.start, self.root)
        if bent:
            controller += f"; {bent} joints beyond their limits are bent into them"
        gx, gy, gz = np.asarray(model.opt.gravity).tolist()
        self.robot = Robot(
            "mujoco",
            label,
            body_name(model, self.root),
            float(model.body_subtreemass[self.root]),
            self.timestep,
            (gx, gy, gz),
            controller,
        )
        self._data = backend().MjData(model)
        self._addresses = _sensor_addresses(model)
        of_body = np.asarray(model.geom_bodyid)
        self._mine = np.append(model.body_rootid[of_body] == self.root, False)
        self._floor = np.append(model.body_weldid[of_body] == 0, False)
        self._falls = _falling_joint(model, self.root, self.up)
        self._states: dict[RobotDrop, Floats] = {}
        for drop in DROPS:
            self._states[drop] = self._released(drop)
        # Height of the centre of mass over the floor at the touch, m.
        self._height = self._height_at_touch()

    def test(self, seconds: float, drops: Sequence[RobotDrop] = DROPS) -> DropTest:
        """Drop the robot with the contacts that `model` has now. seconds: of each drop."""
        landed = {}
        with captured_warnings():
            for drop in drops:
                landed[drop] = self._landed(drop, seconds)
        return drop_test(self.robot, landed, seconds)

    def _released(self, drop: RobotDrop) -> Floats:
        """The state of a drop at release, (n,)."""
        mujoco = backend()
        model = self.model
        data = mujoco.MjData(model)
        data.qpos[:] = self.start.qpos
        for actuator in np.flatnonzero(model.actuator_actnum == 1).tolist():
            # A filter that has settled.
            data.act[model.actuator_actadr[actuator]] = self.controls[actuator]
        data.mocap_pos[:] = self.start.mocap_pos
        data.mocap_quat[:] = self.start.mocap_quat
        if drop.tilt:
            _tilt(model, data, self.root, drop.tilt)
        resting = data.qpos.copy()
        speed = math.sqrt(2.0 * self.gravity * drop.height)

        def raise_by(way: float) -> None:
            data.qpos[:] = resting
            address, axis = self._falls
            data.qpos[address : address + len(axis)] += way * axis

        def touches(way: float) -> bool:
            raise_by(way)
            mujoco.mj_fwdPosition(model, data)
            geoms = data.contact.geom
            on_floor = self._mine[geoms].any(axis=1) & self._floor[geoms].any(axis=1)
            apart = data.contact.dist > 0.0
            return bool((on_floor & ~apart & (data.contact.exclude == 0)).any())

        clear = way_up(touches, body_name(model, self.root))
        raise_by(clear + drop.height + speed * self.timestep * drop.phase)
        mujoco.mj_forward(model, data)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        state = np.zeros(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, state, kind)
        return state

    def _height_at_touch(self) -> float:
        mujoco = backend()
        drop = DROPS[0]
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        mujoco.mj_setState(self.model, self._data, self._states[drop], kind)
        mujoco.mj_forward(self.model, self._data)
        centre = self._data.subtree_com[self.root]
        low = min(
            float(self.up @ self._data.geom_xpos[geom]) - float(self.model.geom_rbound[geom])
            for geom in np.flatnonzero(self._mine[:-1]).tolist()
        )
        return max(float(self.up @ centre) - low, 1e-3)

    def _landed(self, drop: RobotDrop, seconds: float) -> Landed | None:
        """Simulate and read one drop; None where it diverges."""
        mujoco = backend()
        steps = round(seconds / self.timestep)
        forget_resets(self._data)
        states, sensors = mujoco.rollout.rollout(
            self.model,
            [self._data],
            self._states[drop][None],
            np.broadcast_to(self.controls, (1, 1, self.model.nu)).copy(),
            nstep=steps,
        )
        state = states[0]
        ends = abs(state[-1, 0] - state[0, 0] - (steps - 1) * self.timestep) < 0.5 * self.timestep
        if not (ends and np.isfinite(sensors).all()):
            return None
        return self._read(drop, state, sensors[0])

    def _read(self, drop: RobotDrop, state: Floats, sensors: Floats) -> Landed | None:
        """Read the sensors of one drop, shape (n, m), each row of the start of a step."""
        h = self.timestep
        g = self.gravity
        at = self._addresses
        count = len(sensors)
        centre = sensors[:, at["centre"] : at["centre"] + 3]
        speed = sensors[:, at["speed"] : at["speed"] + 3]
        height = centre @ self.up
        force = np.zeros(count)
        distance = np.zeros(count)
        for floor in at["floors"]:
            force += sensors[:, floor : floor + 3] @ self.up
            distance = np.minimum(distance, sensors[:, floor + 3])
        force = np.abs(force)
        if np.abs(centre - centre[0]).max() > _FARTHEST:
            return None
        pressed = force > 0.0
        if not pressed.any():
            return None
        touch = int(np.argmax(pressed))
        starts, ends = _flights(pressed, touch, h)
        rising = speed @ self.up
        fastest = max((float(rising[i]) for i in starts), default=0.0)
        rebound = max(fastest, 0.0) ** 2 / (2.0 * g)
        energy = self._energy(state, sensors)
        flat = centre - np.outer(height, self.up)
        tail = slice(max(touch, count - round(TAIL_S / h)), count)
        is_long = count * h > LATE_S + TAIL_S
        pace = np.linalg.norm(speed, axis=1)
        rest = sink = travel = creep = vibration = late = sag = math.nan
        fell = False
        if is_long:
            moving = np.flatnonzero(pace > REST_SPEED)
            last = int(moving[-1])
            rest = math.inf if last >= count - 2 else (last + 1 - touch) * h
            sink = -float(np.median(distance[tail]))
            travel = float(np.linalg.norm(flat[-1] - flat[touch]))
            creep = float(np.linalg.norm(flat[-1] - flat[tail.start])) / ((count - tail.start) * h)
            vibration = float(np.sqrt(((speed[tail] - speed[tail].mean(0)) ** 2).sum(1).mean()))
            late = float(sum(i * h > LATE_S for i in starts))
            end = float(np.median(height[tail]))
            sag = float(height[touch]) - end - sink
            drop_of_height = float(height[touch]) - end
            fell = drop_of_height > (1.0 - FALLEN) * self._height
        return Landed(
            rebound=rebound,
            rest=rest,
            peak=float(force.max()) / self.weight,
            depth=-float(distance.min()),
            sink=sink,
            travel=travel,
            creep=creep,
            vibration=vibration,
            gain=_gain(energy, touch, starts, ends) / (self.weight * drop.height),
            late=late,
            sag=sag,
            fell=fell,
        )

    def _energy(self, state: Floats, sensors: Floats) -> Floats:
        """Energy of the robot and of its servos as springs, J, (n,)."""
        at = self._addresses
        model = self.model
        energy: Floats = sensors[:, at["potential"]] + sensors[:, at["kinetic"]]
        if not model.nu:
            return energy
        targets = np.tile(self.controls, (len(sensors), 1))
        for actuator in np.flatnonzero(model.actuator_actnum).tolist():
            address = 1 + model.nq + model.nv + int(model.actuator_actadr[actuator])
            targets[:, actuator] = state[:, address]
        stiffness = np.maximum(-model.actuator_biasprm[:, 1], 0.0)
        behind = sensors[:, at["actuators"]] - targets
        energy += 0.5 * (behind**2 * stiffness).sum(axis=1)
        return energy


def landing(source: Any, requests: Sequence[Request], like: DropTest | None) -> DropTest:
    """The whole test of a model; as long as `like`, and else as long as the robot stands.

    Raises UserError for what cannot be dropped.
    """
    bench = DropBench(spec_of(source), label_of(source), requests)
    if like is not None:
        return bench.test(like.seconds)
    # A robot that falls over lies by chance: only its touch can be compared.
    if bench.test(SECONDS, DROPS[-1:]).fell:
        return bench.test(SECONDS_TO_FALL)
    test = bench.test(SECONDS)
    return bench.test(SECONDS_TO_FALL) if test.fell else test


def _robot_in(model: Any, requests: Sequence[Request]) -> int:
    """The root body of the robot whose parts the pairs name.

    Raises UserError where it has no actuators, or nothing lets it fall.
    """
    expected = "pairs of a robot, which has actuators and can fall, with what stands still"
    roots = set()
    for request in requests:
        if request.pair is None:
            raise UserError("pair", "missing", expected)
        pair = named_pair(model, request.pair)
        one, two = pair.first.body, pair.second.body
        moving = [body for body in (one, two) if model.body_weldid[body]]
        if len(moving) != 1:
            raise UserError("pair", ",".join(request.pair), expected)
        roots.add(int(model.body_rootid[moving[0]]))
    if len(roots) != 1:
        raise UserError("pair", "parts of several robots", expected, "Tune them one by one")
    root = roots.pop()
    if not _is_driven(model, root):
        raise UserError("pair", "no actuator drives the body", expected)
    gravity = np.asarray(model.opt.gravity)
    off = model.opt.disableflags & backend().mjtDisableBit.mjDSBL_GRAVITY
    if off or not gravity.any():
        raise UserError("gravity", "the model has none", expected, "Try --gravity 9.81")
    _falling_joint(model, root, -gravity / np.linalg.norm(gravity))
    return root


def _is_driven(model: Any, root: int) -> bool:
    """Say whether an actuator moves a joint in the tree of a root body."""
    kinds = backend().mjtTrn
    in_tree = model.body_rootid[model.jnt_bodyid] == root
    for actuator in range(model.nu):
        kind = int(model.actuator_trntype[actuator])
        if kind in (int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT)):
            if in_tree[model.actuator_trnid[actuator, 0]]:
                return True
        # Tendons, sites and bodies: of a tree with joints of its own beside its base.
        elif in_tree.sum() > 1:
            return True
    return False


def _falling_joint(model: Any, root: int, up: Floats) -> tuple[int, Floats]:
    """(address in qpos, way in qpos for 1 m up) of the joint by which a robot falls.

    Raises UserError for a base that is fixed.
    """
    kinds = backend().mjtJoint
    first = int(model.body_jntadr[root])
    for joint in range(first, first + int(model.body_jntnum[root])):
        address = int(model.jnt_qposadr[joint])
        if int(model.jnt_type[joint]) == int(kinds.mjJNT_FREE):
            return address, up
        along = float(model.jnt_axis[joint] @ up)
        if int(model.jnt_type[joint]) == int(kinds.mjJNT_SLIDE) and abs(along) > _VERTICAL:
            return address, np.array([1.0 / along])
    name = str(model.body(root).name)
    got = f"the base {name!r} cannot fall"
    raise UserError("pair", got, "a robot whose base has a free joint or a vertical slide")


def _bend_into_limits(model: Any, data: Any) -> int:
    """Bend joints that are beyond their limits into them, which would throw the robot; return how
    many there were.
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


def _tilt(model: Any, data: Any, root: int, angle: float) -> None:
    """Turn the base of a robot by an angle, rad, about its free joint or its first hinge."""
    kinds = backend().mjtJoint
    first = int(model.body_jntadr[root])
    for joint in range(first, first + int(model.body_jntnum[root])):
        address = int(model.jnt_qposadr[joint])
        if int(model.jnt_type[joint]) == int(kinds.mjJNT_FREE):
            turn = np.zeros(4)
            turned = np.zeros(4)
            backend().mju_axisAngle2Quat(turn, _TILT_AXIS, angle)
            backend().mju_mulQuat(turned, turn, data.qpos[address + 3 : address + 7].copy())
            data.qpos[address + 3 : address + 7] = turned
            return
        if int(model.jnt_type[joint]) == int(kinds.mjJNT_HINGE):
            data.qpos[address] += angle
            return


def _add_sensors(spec: Any, model: Any, root: int) -> None:
    """Add to a spec what the test reads. model: compiled of it. root: number of the base."""
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
        if number:
            body.name = body.name or f"{_OURS}floor {number}"
        _add_contact(spec, f"{_OURS}force {number}", base.name, body.name, 1 << 1, 3)
        _add_contact(spec, f"{_OURS}distance {number}", base.name, body.name, 1 << 3, 1)
    for number, actuator in enumerate(spec.actuators):
        actuator.name = actuator.name or f"{_OURS}actuator {number}"
        spec.add_sensor(
            name=f"{_OURS}length {number}",
            type=sensors.mjSENS_ACTUATORPOS,
            objtype=objects.mjOBJ_ACTUATOR,
            objname=actuator.name,
        )


def _add_contact(spec: Any, name: str, base: str, floor: str, data: int, reduce: int) -> None:
    """A sensor of all contacts of the tree of a base with a body that stands still.

    data: bits of what to read, force (1) or distance (3). reduce: to the least (1), or to the net
    force in the world (3).
    """
    objects = backend().mjtObj
    sensor = spec.add_sensor(
        name=name,
        type=backend().mjtSensor.mjSENS_CONTACT,
        objtype=objects.mjOBJ_XBODY,
        objname=base,
        reftype=objects.mjOBJ_BODY,
        refname=floor,
    )
    sensor.intprm[0] = data
    sensor.intprm[1] = reduce
    sensor.intprm[2] = 1


def _sensor_addresses(model: Any) -> dict[str, Any]:
    """Places of the sensors in the data, by what they read."""
    addresses: dict[str, Any] = {}
    for name in ("centre", "speed", "potential", "kinetic"):
        addresses[name] = int(model.sensor(f"{_OURS}{name}").adr[0])
    names = [str(model.sensor(i).name) for i in range(model.nsensor)]
    # The distance follows the three numbers of the force.
    addresses["floors"] = [
        int(model.sensor_adr[i]) for i, name in enumerate(names) if name.startswith(f"{_OURS}force")
    ]
    addresses["actuators"] = [
        int(model.sensor_adr[i])
        for i, name in enumerate(names)
        if name.startswith(f"{_OURS}length")
    ]
    return addresses


def _flights(pressed: Any, touch: int, timestep: float) -> tuple[list[int], list[int]]:
    """First steps of flights after the touch, longer than chatter, and the steps after their ends."""
    off = ~pressed
    off[:touch] = False
    edges = np.diff(np.concatenate([[0], off.astype(int), [0]]))
    starts = np.flatnonzero(edges == 1)
    ends = np.flatnonzero(edges == -1)
    lasting = (ends - starts) * timestep >= PARTED_S
    return starts[lasting].tolist(), ends[lasting].tolist()


def _gain(energy: Floats, touch: int, starts: Sequence[int], ends: Sequence[int]) -> float:
    """Most energy that a flight has beyond the least before it, J; 0 for none.

    energy: (n,), J. starts, ends: of the flights.
    """
    least = float(energy[max(touch - 1, 0)])
    gain = 0.0
    for start, end in zip(starts, ends, strict=True):
        gain = max(gain, float(energy[start]) - least)
        least = min(least, float(energy[end - 1]))
    return gain
