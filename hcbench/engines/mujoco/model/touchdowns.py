"""MuJoCo: a recorded motion of a model, read for the speeds at which its parts met the floor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.model.bodies import body_name, geom_name
from hcbench.engines.mujoco.model.find_pair import named_pair
from hcbench.engines.mujoco.model.list_pairs import contact_in_force
from hcbench.engines.mujoco.model.plugin_contact import restitution_law
from hcbench.engines.mujoco.scene.promises import promise_in
from hcbench.sim.landing import PARTED_S
from hcbench.sim.model_under_test import Request
from hcbench.sim.touchdowns import Touchdowns, TrajectoryTouchdowns
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats

_Geoms = tuple[int, int]  # the one that moves first
_ANY_SPEED = (0.0, float("inf"))


def touchdowns(
    model: Any, label: str, request: Request, recorded: Mapping[str, Floats]
) -> TrajectoryTouchdowns:
    """Every touchdown of a part that moves on one that does not, or of the request's pair.

    recorded: qpos (n, nq), qvel (n, nv), and time (n,), where it is known. Raises UserError for other shapes.
    """
    qpos, qvel, time = _states(model, recorded)
    kept = None
    if request.pair is not None:
        pair = named_pair(model, request.pair)
        kept = {tuple(sorted((a, b))) for a in pair.first.geoms for b in pair.second.geoms}
    with captured_warnings():
        events = _events(model, qpos, qvel, time, kept)
    feet = [_foot(model, geoms, np.array(rows)) for geoms, rows in events.items()]
    feet.sort(key=lambda foot: (-len(foot.time), foot.part))
    interval = float(np.median(np.diff(time)))
    return TrajectoryTouchdowns("mujoco", backend().__version__, label, len(qpos), interval, tuple(feet))


def _states(model: Any, recorded: Mapping[str, Floats]) -> tuple[Floats, Floats, Floats]:
    arrays = []
    for name, width in (("qpos", model.nq), ("qvel", model.nv)):
        if (array := recorded.get(name)) is None:
            raise UserError("trajectory", f"no {name!r} in it", "qpos and qvel of each state, and time")
        if array.ndim != 2 or array.shape[1] != width or len(array) < 2:
            shape = " x ".join(map(str, array.shape))
            raise UserError("trajectory", f"{name}: {shape} numbers", f"n x {width}, for this model")
        arrays.append(array)
    qpos, qvel = arrays
    steps: Floats = float(model.opt.timestep) * np.arange(len(qpos), dtype=np.float64)
    time = recorded.get("time", steps).reshape(-1)
    if len(qpos) != len(qvel) or len(time) != len(qpos) or not (np.diff(time) > 0).all():
        raise UserError(
            "trajectory", "qpos, qvel and time are of unlike lengths, or time does not rise", "alike"
        )
    if not all(np.isfinite(array).all() for array in (qpos, qvel, time)):
        raise UserError("trajectory", "numbers that are not finite", "finite numbers")
    return qpos, qvel, time


def _events(
    model: Any, qpos: Floats, qvel: Floats, time: Floats, kept: set[tuple[int, ...]] | None
) -> dict[_Geoms, list[tuple[float, float, float]]]:
    """(time, speed, slide) of each touchdown, by the two geoms of its rigid parts that touched first.

    The speeds are those of the state before, or of the first in contact, the faster of the two: a contact
    slows, and free flight may speed up, within the time between two states.
    """
    data, before = backend().MjData(model), backend().MjData(model)
    events: dict[tuple[int, int], list[tuple[float, float, float]]] = {}
    names: dict[tuple[int, int], _Geoms] = {}
    last: dict[tuple[int, int], float] = {}
    for i in range(len(qpos)):
        data.qpos[:], data.qvel[:] = qpos[i], qvel[i]
        backend().mj_fwdPosition(model, data)
        if i:
            before.qpos[:], before.qvel[:] = qpos[i - 1], qvel[i - 1]
        new: dict[tuple[int, int], int] = {}
        for c, geoms in enumerate(_moving_first(model, data, kept)):
            if geoms is None:
                continue
            one, two = model.body_weldid[model.geom_bodyid[list(geoms)]].tolist()
            names.setdefault((one, two), geoms)
            if i and time[i] - last.get((one, two), -np.inf) > max(PARTED_S, 1.5 * (time[i] - time[i - 1])):
                new[one, two] = c
            last[one, two] = float(time[i])
        if new:
            backend().mj_fwdPosition(model, before)
        for parts, c in new.items():
            speed, slide = max(_speeds(model, state, data, c, names[parts]) for state in (before, data))
            if speed > 0.0:
                events.setdefault(parts, []).append((float(time[i]), speed, slide))
    return {names[parts]: rows for parts, rows in events.items()}


def _moving_first(model: Any, data: Any, kept: set[tuple[int, ...]] | None) -> list[_Geoms | None]:
    """The two geoms of each contact that acts, the body that moves first; None for other contacts."""
    pairs: list[_Geoms | None] = []
    for (a, b), distance, excluded in zip(
        data.contact.geom.tolist(), data.contact.dist, data.contact.exclude, strict=True
    ):
        moves = [bool(model.body_weldid[model.geom_bodyid[geom]]) if geom >= 0 else False for geom in (a, b)]
        meets = distance <= 0.0 and not excluded and min(a, b) >= 0
        asked = moves[0] != moves[1] if kept is None else tuple(sorted((a, b))) in kept
        pairs.append(((a, b) if moves[0] else (b, a)) if meets and asked else None)
    return pairs


def _speeds(model: Any, state: Any, touching: Any, contact: int, geoms: _Geoms) -> tuple[float, float]:
    """(approach, sliding) speed of the two at a contact of `touching`, m/s, by the velocities of `state`."""
    point, normal = touching.contact.pos[contact], touching.contact.frame[contact][:3]
    sign = 1.0 if int(touching.contact.geom[contact][0]) == geoms[0] else -1.0
    velocity, jacobian = np.zeros(3), np.zeros((3, model.nv))
    for geom, share in zip(geoms, (1.0, -1.0), strict=True):
        backend().mj_jac(model, state, jacobian, None, point, int(model.geom_bodyid[geom]))
        velocity += share * (jacobian @ state.qvel)
    approach = float(sign * normal @ velocity)
    return approach, float(np.linalg.norm(velocity - sign * approach * normal))


def _foot(model: Any, geoms: _Geoms, rows: Floats) -> Touchdowns:
    promise, band = promise_in(model, geoms), None
    if restitution_law(model, geoms) is not None:
        band, words = _ANY_SPEED, "plug-in hcbench.restitution"
    elif promise is not None:
        band, words = promise.speeds, f"{promise.setting} by hcbench: {promise.curve.description}"
    else:
        solref = " ".join(f"{x:.4g}" for x in contact_in_force(model, *geoms)["solref"])
        words = f"solref {solref}"
    names = [
        geom_name(model, g) if model.geom(g).name else body_name(model, int(model.geom_bodyid[g]))
        for g in geoms
    ]
    time, speed, slide = rows.T
    return Touchdowns(names[0], names[1], time, speed, slide, band, words)
