"""Flies launches in MuJoCo and reads penetration, rate and force off the states.

The force of a step is what it does to the ball's momentum, m (Δv/h - g): MuJoCo's own contact force to
rounding under Euler, implicit, implicitfast and discrete, the mean over the step under RK4. So it is paired
by construction with the state that the step starts from, which mjData's own fields are not under every
integrator. Under `discrete` MuJoCo evaluates it at the end of the step.
"""

from __future__ import annotations

import math
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines._mujoco_model import edited, model_path
from hcbench.errors import EngineFailed, EngineMissing, SceneError, SettingError
from hcbench.impact import Trajectory

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.engines._mujoco_options import Options
    from hcbench.impact import Floats, Launch
    from hcbench.scene import Scene

INSTALL = "pip install mujoco"
_GROUP = 32  # launches flown together: bounds memory
_CONTACT_S = 0.5  # how long a ball may stay in contact before it counts as resting there
_AT_REST = 1e-6  # of its impact speed, over a whole chunk of steps: a bounce turns around in far fewer
_ROUND_OFF = 16 * np.finfo(float).eps  # of what a step adds up: a smaller change of velocity is no force
_FEW, _SHORT, _LONG = 16, 32, 8192  # steps in a chunk
_OVERLAP = 1e-5  # m, at which the model is checked
_SHAPE_TOLERANCE = 1e-9  # m


def backend() -> Any:
    """The mujoco module. Raises EngineMissing, and EngineFailed where it is there but does not load."""
    try:
        import mujoco
        import mujoco.rollout
    except ImportError as error:
        raise EngineMissing(
            "engine 'mujoco'", f"cannot be imported: {error}", "", f"Try: {INSTALL}"
        ) from None
    except Exception as error:  # its graphics library, named by MUJOCO_GL, may be missing
        raise EngineFailed("engine 'mujoco'", f"cannot be imported: {error}", "") from error
    return mujoco


@contextmanager
def _guarded(mujoco: Any) -> Iterator[None]:
    """No warnings on stderr or in MUJOCO_LOG.TXT, and MuJoCo's errors as ours.

    The user's own handler of warnings is back afterwards.
    """
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    except mujoco.FatalError as error:
        raise EngineFailed("mujoco", " ".join(str(error).split()), "") from error
    finally:
        mujoco.set_mju_user_warning(before)


@dataclass(frozen=True, slots=True)
class Flight:
    """A compiled model, and where to look in its state.

    origin: the full state with the ball at qpos0, where it just touches, shape (nstate,). at: where position
    and velocity of the ball start in a state. clearance: |R2| - R1 of a cup, None on a plane.
    """

    mujoco: Any
    model: Any
    scene: Scene
    timestep: float
    origin: Floats
    at: tuple[int, int]
    clearance: float | None

    def fly(self, launches: Sequence[Launch]) -> list[Trajectory]:
        """Each launch until it has parted or rests. Any number at once gives the same bits."""
        groups = [launches[i : i + _GROUP] for i in range(0, len(launches), _GROUP)]
        with _guarded(self.mujoco):
            return [trajectory for group in groups for trajectory in self._fly(group)]

    def follow(self, launch: Launch, steps: int) -> Trajectory:
        """All of `steps` steps after one launch."""
        with _guarded(self.mujoco):
            return self._fly([launch], steps)[0]

    def _fly(self, launches: Sequence[Launch], steps: int | None = None) -> list[Trajectory]:
        data = self.mujoco.MjData(self.model)
        watches = [_Watch.of(launch, self.scene, self.timestep) for launch in launches]
        state = np.stack([self._released(launch) for launch in launches])
        flying, done = list(range(len(launches))), 0
        while flying:
            # The same chunks for everyone: a chunk starts the solver cold, and that moves last bits.
            count = _chunk(done) if steps is None else min(_chunk(done), steps - done)
            path, _ = self.mujoco.rollout.rollout(self.model, data, state, nstep=count)
            path = np.concatenate([state[:, None], path], axis=1)
            seen = self._observe(path)
            for i, record in zip(flying, seen, strict=True):
                watches[i].add(record)
            done += count
            going = [
                (not watches[i].over) if steps is None else done < steps and not watches[i].lost
                for i in flying
            ]
            flying = [i for i, go in zip(flying, going, strict=True) if go]
            state = path[going, -1]
        return [watch.trajectory(self.timestep) for watch in watches]

    def _released(self, launch: Launch) -> Floats:
        """The full state at release, shape (nstate,)."""
        gap = launch.gap(self.timestep)
        if self.clearance is not None and gap >= self.clearance:
            raise SettingError(
                "height",
                f"{gap!r} m above the cup",
                f"below |R2| - R1 = {self.clearance!r} m, where the centres meet",
                "Drop from lower, or in the form 'plane'",
            )
        state, (position, velocity) = self.origin.copy(), self.at
        state[position + 2] += gap
        state[velocity + 2] = -launch.speed
        return state

    def _observe(self, path: Floats) -> Floats:
        """Penetration, rate and force of each step from states: (b, n + 1, nstate) -> (b, 3, n)."""
        position, velocity = (path[:, :, i : i + 3] for i in self.at)
        with np.errstate(all="ignore"):  # what is not finite is told by the record
            record = self._read(position, velocity)
        # MuJoCo meets what is not finite by starting the model over, and rollout by standing still.
        stopped = np.maximum.accumulate(np.diff(path[:, :, 0], axis=1) <= 0.0, axis=1)
        record[np.broadcast_to(stopped[:, None], record.shape)] = np.nan
        return record

    def _read(self, position: Floats, velocity: Floats) -> Floats:
        x, v, deeper = self._overlap(position[:, :-1], velocity[:, :-1])
        h, g = self.timestep, self.scene.gravity
        change = np.diff(velocity, axis=1)
        change[:, :, 2] += g * h
        lost = -(change * deeper).sum(axis=2)
        speed = np.abs(velocity).sum(axis=2)
        noise = _ROUND_OFF * (speed[:, :-1] + speed[:, 1:] + g * h)
        force = np.where(np.abs(lost) <= noise, 0.0, self.scene.mass * lost / h)
        return np.stack([x, v, force], axis=1)

    def _overlap(self, position: Floats, velocity: Floats) -> tuple[Floats, Floats, Floats]:
        """Penetration, its rate, and the unit vector of deeper, by geometry: no engine."""
        touch = self.origin[self.at[0] : self.at[0] + 3]
        if self.clearance is None:
            return touch[2] - position[:, :, 2], -velocity[:, :, 2], np.array([0.0, 0.0, -1.0])
        away = position - (touch + np.array([0.0, 0.0, self.clearance]))
        distance = np.sqrt((away**2).sum(axis=2))
        out = away / np.maximum(distance, np.finfo(float).tiny)[:, :, None]
        return distance - self.clearance, (out * velocity).sum(axis=2), out


@dataclass(slots=True)
class _Watch:
    """What one launch has done so far, and whether there is more to see."""

    patience: int  # steps, after which it counts as resting or as never touching
    rest_speed: float
    records: list[Floats]
    touched: bool = False
    parted: bool = False
    resting: bool = False
    lost: bool = False
    steps: int = 0

    @classmethod
    def of(cls, launch: Launch, scene: Scene, timestep: float) -> _Watch:
        gap = launch.gap(timestep)
        speed = math.sqrt(launch.speed**2 + 2.0 * scene.gravity * gap)  # at touch
        if gap and not speed:
            raise SettingError("speed", "0 m/s without gravity", "a speed above 0, or gravity to fall by")
        flight = 2.0 * gap / (launch.speed + speed) if gap else 0.0
        patience = math.ceil(1.5 * flight / timestep) + math.ceil(_CONTACT_S / timestep) + 100
        return cls(patience, _AT_REST * speed, [])

    @property
    def over(self) -> bool:
        return self.parted or self.resting or self.lost or self.steps >= self.patience

    def add(self, record: Floats) -> None:
        """One more chunk of penetration, rate and force, shape (3, n)."""
        self.records.append(record)
        self.steps += record.shape[1]
        self.lost = not np.isfinite(record).all()
        x, v, f = record
        acting = np.flatnonzero(f)
        start = 0 if self.touched else int(acting[0]) if acting.size else len(f)
        self.touched = self.touched or acting.size > 0
        # The same words as impact_of has for parting.
        self.parted = bool(((x <= 0.0) & (v < 0.0) & (f == 0.0))[start:].any())
        self.resting = self.touched and len(v) >= _SHORT and bool((np.abs(v) <= self.rest_speed).all())

    def trajectory(self, timestep: float) -> Trajectory:
        record = np.concatenate(self.records, axis=1)
        return Trajectory(np.arange(record.shape[1]) * timestep, *record)


def _chunk(done: int) -> int:
    """Steps to take next: few at first, where a coarse step has parted already, then a share of what was."""
    return min(max(_SHORT if done >= _SHORT else _FEW, done // 8), _LONG)


def load(scene: Scene, timestep: float, options: Options) -> Flight:
    """A scene under a setting, compiled and checked.

    Raises SceneError for a model that is not what the scene says, EngineMissing where the installed MuJoCo
    is too old for the setting.
    """
    mujoco = backend()
    _require_version(mujoco, options)
    text, path = edited(scene, timestep, options), model_path(scene)
    with _guarded(mujoco):
        try:
            model = mujoco.MjModel.from_xml_string(text)
        except ValueError as error:
            what = " ".join(str(error).split())
            raise SceneError(str(path), what, "MJCF that MuJoCo loads") from None
        data = mujoco.MjData(model)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        origin = np.empty(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, origin, kind)
        joint = _find_ball(mujoco, model, scene)
        position, velocity = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        _check_shapes(mujoco, model, data, scene, position)
    at = (1 + position, 1 + int(model.nq) + velocity)  # a state is time, positions, velocities, ...
    clearance = -scene.plate_radius - scene.ball_radius if scene.form == "cup" else None
    return Flight(mujoco, model, scene, timestep, origin, at, clearance)


def _require_version(mujoco: Any, options: Options) -> None:
    wanted = {
        "adhesion": (any(row.adhesion for row in options.rows), hasattr(mujoco.MjModel, "pair_adhesion")),
        "the integrator 'discrete'": (
            options.integrator == "discrete",
            hasattr(mujoco.mjtIntegrator, "mjINT_DISCRETE"),
        ),
    }
    for what, (asked, there) in wanted.items():
        if asked and not there:
            raise EngineMissing(
                f"mujoco {mujoco.__version__}", f"has no {what}", "a newer one", f"Try: {INSTALL} --upgrade"
            )


def _find_ball(mujoco: Any, model: Any, scene: Scene) -> int:
    """The free joint of the body `ball`, which is as heavy as the scene says and centred on its geom."""
    path = str(model_path(scene))
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "ball")
    joint = model.body_jntadr[body]
    if model.body_jntnum[body] != 1 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        raise SceneError(path, "the body 'ball' does not move freely", "a <freejoint/> on it")
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "ball")
    if geom < 0 or model.geom_bodyid[geom] != body:
        raise SceneError(path, "the body 'ball' has no geom 'ball'", "one")
    if model.geom_pos[geom].any() or model.body_ipos[body].any():
        raise SceneError(
            path, "the ball's geom or mass is off its body's origin", "both at the centre, pos 0 0 0"
        )
    mass = float(model.body_mass[body])
    if not math.isclose(mass, scene.mass, rel_tol=1e-12):
        raise SceneError(
            path,
            f"the body 'ball' weighs {mass!r} kg",
            f"{scene.mass!r} kg as scene.toml says",
            "Give it an <inertial>, or all of its mass to the geom 'ball'",
        )
    return int(joint)


def _check_shapes(mujoco: Any, model: Any, data: Any, scene: Scene, position: int) -> None:
    """MuJoCo must see the overlap that the scene says: radii, frames and qpos0 are right then."""
    data.qpos[position + 2] -= _OVERLAP
    mujoco.mj_forward(model, data)
    if scene.form == "cup":
        tendon = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, "contact")
        if tendon < 0 or not model.tendon_limited[tendon]:
            raise SceneError(
                str(model_path(scene)), "there is no limited tendon 'contact'", "one between the two centres"
            )
        seen = float(data.ten_length[tendon]) - (-scene.plate_radius - scene.ball_radius)
    else:
        geoms = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name) for name in ("ball", "plate")]
        if geoms[1] < 0:
            raise SceneError(str(model_path(scene)), "there is no geom 'plate'", "one")
        seen = -float(mujoco.mj_geomDistance(model, data, *geoms, 1.0, None))
    if abs(seen - _OVERLAP) > _SHAPE_TOLERANCE:
        raise SceneError(
            str(model_path(scene)),
            f"ball and plate overlap by {seen:.6e} m where the scene says {_OVERLAP:g} m",
            "the ball to just touch at qpos0, with the radii of scene.toml",
        )
