"""MuJoCo: a robot under its controller dropped on its floor, which is read as a force plate."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import (
    backend,
    captured_warnings,
    forget_resets,
    plugin_warnings,
    resets,
)
from hcbench.engines.mujoco.model.bodies import body_name, geom_name, volumes
from hcbench.engines.mujoco.model.controllers import Drive, drive_of
from hcbench.engines.mujoco.model.find_pair import contact_in_force, named_pair
from hcbench.engines.mujoco.model.over_floor import way_up
from hcbench.engines.mujoco.model.pair import WithoutContact, restitution_law
from hcbench.engines.mujoco.model.promises import broken_promise, promise_in
from hcbench.engines.mujoco.model.start_pose import require_quaternions, start_pose
from hcbench.sim.density import unit_notes
from hcbench.sim.landing import (
    PARTED_S,
    WINDOW_S,
    DropPlan,
    FootfallLog,
    Landing,
    Landings,
    take_off_speed,
)
from hcbench.sim.model_under_test import Request
from hcbench.sim.touch import Touchdowns, TrajectoryTouchdowns
from hcbench.system.errors import EngineFailed, UserError
from hcbench.terms.impact import Floats

# A floor is waited for as long as this times the time of a free fall, and some s more.
_FALL_SHARE = 1.5
_SLACK_S = 0.2


def land(model: Any, label: str, state: Any, request: Request, drops: DropPlan) -> Landings:
    """Drop the robot of a model from each height (m) at each tilt (rad) of a plan.

    state: an MjData to start from, or None. Raises UserError where the model has no robot or
    nothing to land on, EngineFailed where MuJoCo finds the state unstable.
    """
    with captured_warnings() as warned:
        start, name = start_pose(model, request, state)
        bench = _Bench(model, start)
        drive, words = drive_of(drops.controller, model, start, bench.root)
        landings = [bench.landing(h, tilt, drive) for h in drops.heights for tilt in drops.tilts]
    return Landings(
        "mujoco",
        backend().__version__,
        label,
        body_name(model, bench.root),
        ", ".join(geom_name(model, geom) for geom in sorted(bench.trodden)),
        name,
        words,
        bench.mass,
        bench.h,
        bench.g,
        tuple(landings),
        (
            *plugin_warnings(warned),
            *_broken_promises(model, bench.trodden),
            *unit_notes(
                body_name(model, bench.root), bench.mass, *volumes(model, start, bench.root)
            ),
        ),
    )


def _broken_promises(model: Any, floor: Iterable[int]) -> Iterator[str]:
    """Sentences on the pairs with the floor that are no longer as `hcbench tune` wrote them.

    floor: geoms that were touched.
    """
    gravity = float(np.linalg.norm(model.opt.gravity))
    said = set()
    for geom, other in itertools.product(range(model.ngeom), sorted(floor)):
        promise = promise_in(model, (geom, other))
        if promise is None:
            continue
        for suspect in broken_promise(model, promise, (geom, other), gravity):
            if suspect.code not in said:
                said.add(suspect.code)
                yield f"{suspect.title} {suspect.evidence} ({suspect.code})."


class _Hit(NamedTuple):
    """A contact that a plug-in's law turns back.

    speed: towards the floor, m/s.
    slide: along it.
    depth: m.
    """

    geom: int
    floor: int
    speed: float
    slide: float
    depth: float


class _Foot(NamedTuple):
    """A rigid part of the robot that met the floor, and which of its geoms did."""

    log: FootfallLog
    geoms: set[int]


class _Bench:
    """A robot with a free base, in its pose, over the parts of the world that it can land on.

    Raises UserError for a model without a free joint, or without gravity.
    """

    def __init__(self, model: Any, start: Any) -> None:
        self.model = model
        self.start = start
        self.h = float(model.opt.timestep)
        free = backend().mjtJoint.mjJNT_FREE
        bases = []
        for body, kind in zip(model.jnt_bodyid, model.jnt_type, strict=True):
            if kind == free:
                bases.append(int(body))
        if not bases:
            raise UserError(
                "model", "no body has a free joint", "a robot with a free base, to be dropped"
            )
        self.root = max(bases, key=lambda body: float(model.body_subtreemass[body]))
        self.joint = int(model.body_jntadr[self.root])
        self.mass = float(model.body_subtreemass[self.root])
        self.g = float(np.linalg.norm(model.opt.gravity))
        if self.g == 0.0 or model.opt.disableflags & backend().mjtDisableBit.mjDSBL_GRAVITY:
            raise UserError(
                "gravity",
                "the model has none",
                "a gravity that lets the robot fall",
                "Try --gravity 9.81",
            )
        self.up = -np.asarray(model.opt.gravity) / self.g
        # (ngeom + 1,): True for the robot's geoms, and for those that it can land on. A contact's
        # geom of -1, which is none, finds the False at the end.
        of_body = np.asarray(model.geom_bodyid)
        self.mine = np.append(model.body_rootid[of_body] == self.root, False)
        self.floor = np.append(model.body_weldid[of_body] == 0, False)
        self.trodden: set[int] = set()
        # Pairs that bounce by impulses of a plug-in; MuJoCo tells no contact force of them.
        self.struck: set[tuple[int, int]] = set()
        if model.nplugin:
            geoms = np.flatnonzero(self.mine[:-1]).tolist()
            floors = np.flatnonzero(self.floor[:-1]).tolist()
            pairs = itertools.product(geoms, floors)
            self.struck = {pair for pair in pairs if restitution_law(model, pair) is not None}
        self.beside = WithoutContact(model) if self.struck else None
        backend().mj_forward(model, start)

    def landing(self, height: float, tilt: float, drive: Drive) -> Landing:
        """One drop from a height (m) over the touch, the base turned by a tilt (rad)."""
        model = self.model
        data = copy.copy(self.start)
        address = int(model.jnt_qposadr[self.joint])
        self._turn(data, address, tilt)
        data.qpos[address : address + 3] += self.up * (height + self._way_up(data, address))
        backend().mj_forward(model, data)
        forget_resets(data)
        return self._fall(data, height, tilt, drive)

    def _turn(self, data: Any, address: int, tilt: float) -> None:
        """Turn the base about the world's y by a tilt, rad."""
        by = np.array([math.cos(tilt / 2), 0.0, math.sin(tilt / 2), 0.0])
        turned = np.zeros(4)
        backend().mju_mulQuat(turned, by, data.qpos[address + 3 : address + 7].copy())
        data.qpos[address + 3 : address + 7] = turned

    def _touches(self, data: Any) -> bool:
        """Say whether the robot touches anything that it can land on, in this pose."""
        backend().mj_fwdPosition(self.model, data)
        geoms = data.contact.geom
        distances = data.contact.dist
        on_floor = self.mine[geoms].any(axis=1) & self.floor[geoms].any(axis=1)
        return bool((on_floor & (distances <= 0.0) & (data.contact.exclude == 0)).any())

    def _way_up(self, data: Any, address: int) -> float:
        """Height by which to raise the robot until it just touches the floor, m; below 0 to lower it.

        address: of its free joint in qpos. Raises UserError where nothing is below it.
        """
        trial = copy.copy(data)
        here = data.qpos[address : address + 3].copy()

        def touches(way: float) -> bool:
            trial.qpos[address : address + 3] = here + way * self.up
            return self._touches(trial)

        return way_up(touches, body_name(self.model, self.root))

    def _fall(self, data: Any, height: float, tilt: float, drive: Drive) -> Landing:
        """Simulate a drop until WINDOW_S (s) after the first touch, and read it.

        data: at release.
        height: of the lowest point over the floor, m.
        tilt: rad.

        Raises EngineFailed where MuJoCo resets the state, UserError where the robot meets nothing.
        """
        model = self.model
        mujoco = backend()
        h = self.h
        jacobian = np.zeros((3, model.nv))
        latest = _FALL_SHARE * math.sqrt(2.0 * height / self.g) + _SLACK_S
        forces: list[float] = []
        rising: list[float] = []
        feet: dict[int, _Foot] = {}
        first = math.nan
        for step in range(math.ceil((latest + WINDOW_S) / h)):
            drive(data)
            before = data.qvel.copy()
            then = step * h
            hits = self._hits(data)
            mujoco.mj_step(model, data)
            if resets(data):
                got = f"MuJoCo found the state unstable {then:.3g} s after release"
                raise EngineFailed(
                    "model",
                    got,
                    "a robot that its controller holds",
                    "Try --controller pd:KP,KD or a smaller --timestep",
                )
            since_touch = 0.0
            if feet:
                since_touch = then - first
            force = self._tread(data, before, since_touch, feet, hits)
            if not feet:
                if then > latest:
                    break
                continue
            if not forces:
                first = then
            mujoco.mj_jacSubtreeCom(model, data, jacobian, self.root)
            forces.append(force)
            rising.append(float(self.up @ jacobian @ before))
            if then - first > WINDOW_S:
                break
        if not feet:
            raise UserError(
                "model",
                f"the robot met nothing within {latest:.3g} s",
                "a floor that it collides with",
            )
        pushed: Floats = np.array(forces)
        speed_out = take_off_speed(pushed, np.array(rising), h)
        time: Floats = np.arange(len(forces), dtype=np.float64) * h
        fallen = tuple(foot.log.footfall(self._name(body, foot)) for body, foot in feet.items())
        impulse = math.nan
        if self.beside is not None:
            impulse = h * float(pushed.max())
        return Landing(
            height, tilt, -rising[0], speed_out, self.mass * self.g, fallen, time, pushed, impulse
        )

    def _hits(self, data: Any) -> list[_Hit]:
        """Contacts that a plug-in's law turns back in the step to come, which goes on from `data`."""
        if self.beside is None:
            return []
        trial = self.beside.data
        hits = []
        whole = backend().mjtState.mjSTATE_INTEGRATION
        state = np.empty(backend().mj_stateSize(self.model, whole))
        backend().mj_getState(self.model, data, state, whole)
        backend().mj_setState(self.model, trial, state, whole)
        backend().mj_fwdPosition(self.model, trial)
        for contact in trial.contact:
            mine, floor, sign = self._in_order(contact.geom)
            depth = float(contact.includemargin - contact.dist)
            if (mine, floor) not in self.struck or depth < 0.0:
                continue
            normal = sign * contact.frame[:3]
            speed, slide = self._speeds(trial, trial.qvel, contact.pos, normal, mine)
            if speed > 0.0:
                hits.append(_Hit(mine, floor, speed, slide, -float(contact.dist)))
        return hits

    def _whole_force(self, data: Any) -> float:
        """Mean force of the floor on the robot in the step just
        taken, N upwards, from its momentum.
        """
        assert self.beside is not None
        jacobian = np.zeros((3, self.model.nv))
        backend().mj_jacSubtreeCom(self.model, self.beside.data, jacobian, self.root)
        return self.mass * float(self.up @ jacobian @ (data.qvel - self.beside.step())) / self.h

    def _tread(
        self, data: Any, before: Floats, time: float, feet: dict[int, _Foot], hits: list[_Hit]
    ) -> float:
        """Force of the floor on the robot in the step just taken, N upwards.

        before: velocities before the step, (nv,).
        time: since the first touch, s.
        hits: contacts of a plug-in in this step. Each foot's force, slip and depth are added to
        `feet`, by rigid body.
        """
        contacts = data.contact
        geoms = contacts.geom
        on_floor = self.mine[geoms].any(axis=1) & self.floor[geoms].any(axis=1)
        acting = on_floor & (contacts.efc_address >= 0)
        upward = 0.0
        wrench = np.zeros(6)
        geoms_of: dict[int, set[int]] = {}
        # (force N, depth m, speed towards the floor, speed along it) of each point, by rigid body.
        parts: dict[int, list[tuple[float, float, float, float]]] = {}
        for i in np.flatnonzero(acting).tolist():
            backend().mj_contactForce(self.model, data, i, wrench)
            mine, floor, sign = self._in_order(geoms[i])
            frame = contacts.frame[i].reshape(3, 3)
            upward += sign * float(self.up @ (frame.T @ wrench[:3]))
            normal = sign * frame[0]
            speed, slide = self._speeds(data, before, contacts.pos[i], normal, mine)
            if wrench[0] > 0.0:
                self.trodden.add(floor)
                body = int(self.model.body_weldid[self.model.geom_bodyid[mine]])
                point = (float(wrench[0]), -float(contacts.dist[i]), speed, slide)
                parts.setdefault(body, []).append(point)
                geoms_of.setdefault(body, set()).add(mine)
        for body, points in parts.items():
            force, depth, speed, slide = np.array(points).T
            if body not in feet:
                by_impulses = any(not geoms_of[body].isdisjoint(pair) for pair in self.struck)
                log = FootfallLog(
                    time, float(speed.max()), float(slide.max()), by_impulses=by_impulses
                )
                feet[body] = _Foot(log, set())
            feet[body].geoms.update(geoms_of[body])
            slip = float(force @ slide / force.sum())
            feet[body].log.add(time, self.h, float(force.sum()), slip, float(depth.max()))
        for hit in hits:
            body = int(self.model.body_weldid[self.model.geom_bodyid[hit.geom]])
            if body not in feet:
                feet[body] = _Foot(FootfallLog(time, hit.speed, hit.slide, by_impulses=True), set())
            if body not in parts:
                feet[body].log.add(time, self.h, 0.0, hit.slide, hit.depth)
            feet[body].geoms.add(hit.geom)
            self.trodden.add(hit.floor)
        return upward if self.beside is None else self._whole_force(data)

    def _in_order(self, geoms: Any) -> tuple[int, int, float]:
        """(the robot's geom, the floor's, 1 if MuJoCo's normal leads from floor to robot, else -1)."""
        one, two = geoms.tolist()
        if self.mine[two]:
            return two, one, 1.0
        return one, two, -1.0

    def _speeds(
        self, data: Any, before: Floats, point: Floats, normal: Floats, geom: int
    ) -> tuple[float, float]:
        """(towards the floor, along it) of the robot's material point, m/s.

        normal: away from the floor.
        """
        jacobian = np.zeros((3, self.model.nv))
        backend().mj_jac(self.model, data, jacobian, None, point, int(self.model.geom_bodyid[geom]))
        velocity = jacobian @ before
        away = float(normal @ velocity)
        return -away, float(np.linalg.norm(velocity - away * normal))

    def _name(self, body: int, foot: _Foot) -> str:
        """Name of a foot: the only geom that touched, if it has a name, else the body."""
        (geom, *more) = sorted(foot.geoms)
        name = "" if more else self.model.geom(geom).name
        return geom_name(self.model, geom) if name else body_name(self.model, body)


# MuJoCo: a recorded motion of a model, read for the speeds at which its parts met the floor.

# The geom that moves first.
_Geoms = tuple[int, int]
# Two rigid parts, in the same order.
_Bodies = tuple[int, int]
# The plug-in's law holds at any speed.
_ANY_SPEED = (0.0, float("inf"))


def touchdowns(
    model: Any, label: str, request: Request, recorded: Mapping[str, Floats]
) -> TrajectoryTouchdowns:
    """Every touchdown of a part that moves on one that does not, or of the request's pair.

    recorded: qpos (n, nq), qvel (n, nv), and time (n,), where it is known.
    Raises UserError for other shapes.
    """
    qpos, qvel, time = _states(model, recorded)
    kept = None
    if request.pair is not None:
        pair = named_pair(model, request.pair)
        kept = {_in_order(both) for both in itertools.product(pair.first.geoms, pair.second.geoms)}
    with captured_warnings():
        events = _events(model, qpos, qvel, time, kept)
    feet = [_foot(model, geoms, np.array(rows)) for geoms, rows in events.items()]
    feet.sort(key=lambda foot: (-len(foot.time), foot.part))
    interval = float(np.median(np.diff(time)))
    return TrajectoryTouchdowns(
        "mujoco", backend().__version__, label, len(qpos), interval, tuple(feet)
    )


def _in_order(geoms: _Geoms) -> _Geoms:
    first, second = geoms
    return (first, second) if first <= second else (second, first)


def _states(model: Any, recorded: Mapping[str, Floats]) -> tuple[Floats, Floats, Floats]:
    """qpos (n, nq), qvel (n, nv) and time (n,), s, of a recording; without a
    time, steps of the model's own.

    Raises UserError for other shapes, times that do not rise, numbers that are not finite, and
    quaternions of length 0.
    """
    arrays = []
    for name, width in (("qpos", model.nq), ("qvel", model.nv)):
        if (array := recorded.get(name)) is None:
            raise UserError(
                "trajectory", f"no {name!r} in it", "qpos and qvel of each state, and time"
            )
        if array.ndim != 2 or array.shape[1] != width or len(array) < 2:
            shape = " x ".join(map(str, array.shape))
            raise UserError(
                "trajectory",
                f"{name}: {shape} numbers",
                f"n x {width}, for this model, with n of 2 or more",
            )
        arrays.append(array)
    qpos, qvel = arrays
    steps: Floats = float(model.opt.timestep) * np.arange(len(qpos), dtype=np.float64)
    time = recorded.get("time", steps).reshape(-1)
    if not len(qpos) == len(qvel) == len(time):
        got = f"{len(qpos)} states in qpos, {len(qvel)} in qvel and {len(time)} in time"
        raise UserError("trajectory", got, "as many in each")
    for name, array in (("qpos", qpos), ("qvel", qvel), ("time", time)):
        if not np.isfinite(array).all():
            raise UserError("trajectory", f"{name}: numbers that are not finite", "finite numbers")
    if not (np.diff(time) > 0).all():
        raise UserError("trajectory", "time does not rise", "a later time for each state")
    require_quaternions(model, qpos, "trajectory")
    return qpos, qvel, time


def _events(
    model: Any, qpos: Floats, qvel: Floats, time: Floats, kept: set[_Geoms] | None
) -> dict[_Geoms, list[tuple[float, float, float]]]:
    """(time, speed, slide) of each touchdown, by the two geoms of its
    rigid parts that touched first.

    The speeds are those of the state before, or of the first in contact, the faster of the two: a
    contact slows, and free flight may speed up, within the time between two states.
    """
    data = backend().MjData(model)
    before = backend().MjData(model)
    # All by the bodies of two rigid parts.
    events: dict[_Bodies, list[tuple[float, float, float]]] = {}
    geoms_of: dict[_Bodies, _Geoms] = {}
    last_seen: dict[_Bodies, float] = {}
    for i in range(len(qpos)):
        data.qpos[:] = qpos[i]
        data.qvel[:] = qvel[i]
        backend().mj_fwdPosition(model, data)
        began: dict[_Bodies, int] = {}
        for contact, geoms in enumerate(_moving_first(model, data, kept)):
            if geoms is None:
                continue
            one, two = model.body_weldid[model.geom_bodyid[list(geoms)]].tolist()
            parts = (one, two)
            geoms_of.setdefault(parts, geoms)
            if i:
                apart = time[i] - last_seen.get(parts, -np.inf)
                # One state without contact may be a gap between two recorded states only.
                if apart > max(PARTED_S, 1.5 * (time[i] - time[i - 1])):
                    began[parts] = contact
            last_seen[parts] = float(time[i])
        if began:
            before.qpos[:] = qpos[i - 1]
            before.qvel[:] = qvel[i - 1]
            backend().mj_fwdPosition(model, before)
        for parts, contact in began.items():
            speeds_before = _speeds(model, before, data, contact, geoms_of[parts])
            speeds_now = _speeds(model, data, data, contact, geoms_of[parts])
            speed, slide = max(speeds_before, speeds_now)
            if speed > 0.0:
                events.setdefault(parts, []).append((float(time[i]), speed, slide))
    return {geoms_of[parts]: rows for parts, rows in events.items()}


def _moving_first(model: Any, data: Any, kept: set[_Geoms] | None) -> list[_Geoms | None]:
    """The two geoms of each contact that acts, the body that moves first; None for other contacts."""
    contacts = data.contact
    pairs: list[_Geoms | None] = []
    for (a, b), distance, excluded in zip(
        contacts.geom.tolist(), contacts.dist, contacts.exclude, strict=True
    ):
        pairs.append(None)
        # A geom of -1 is none: the contact is that of a flex.
        if excluded or distance > 0.0 or min(a, b) < 0:
            continue
        a_moves, b_moves = (bool(model.body_weldid[model.geom_bodyid[geom]]) for geom in (a, b))
        is_asked = a_moves != b_moves if kept is None else _in_order((a, b)) in kept
        if is_asked:
            pairs[-1] = (a, b) if a_moves else (b, a)
    return pairs


def _speeds(
    model: Any, state: Any, touching: Any, contact: int, geoms: _Geoms
) -> tuple[float, float]:
    """(approach, sliding) speed of the two at a contact of `touching`,
    m/s, by the velocities of `state`.
    """
    point = touching.contact.pos[contact]
    # From the contact's first geom to its second.
    normal = touching.contact.frame[contact][:3]
    sign = 1.0 if int(touching.contact.geom[contact][0]) == geoms[0] else -1.0
    velocity = np.zeros(3)
    jacobian = np.zeros((3, model.nv))
    for geom, share in zip(geoms, (1.0, -1.0), strict=True):
        backend().mj_jac(model, state, jacobian, None, point, int(model.geom_bodyid[geom]))
        velocity += share * (jacobian @ state.qvel)
    approach = float(sign * normal @ velocity)
    return approach, float(np.linalg.norm(velocity - sign * approach * normal))


def _foot(model: Any, geoms: _Geoms, rows: Floats) -> Touchdowns:
    """Touchdowns of two parts.

    rows: (n, 3), time s, speed and slide m/s.
    """
    promise = promise_in(model, geoms)
    band = None
    if restitution_law(model, geoms) is not None:
        band = _ANY_SPEED
        words = "plug-in hcbench.restitution"
    elif promise is not None:
        band = promise.speeds
        words = f"{promise.setting} by hcbench: {promise.curve.description}"
    else:
        solref = contact_in_force(model, *geoms)["solref"]
        words = "solref " + " ".join(f"{x:.4g}" for x in solref)
    part, other = (_geom_or_body_name(model, geom) for geom in geoms)
    time, speed, slide = rows.T
    return Touchdowns(part, other, time, speed, slide, band, words)


def _geom_or_body_name(model: Any, geom: int) -> str:
    if model.geom(geom).name:
        return geom_name(model, geom)
    return body_name(model, int(model.geom_bodyid[geom]))
