"""MuJoCo: a recorded motion of a model, read for the speeds at which its parts met the floor."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.model.bodies import body_name, geom_name
from hcbench.engines.mujoco.model.find_pair import contact_in_force, named_pair
from hcbench.engines.mujoco.model.pair import restitution_law
from hcbench.engines.mujoco.model.promises import promise_in
from hcbench.sim.landing import PARTED_S
from hcbench.sim.model_under_test import Request
from hcbench.sim.touch import Touchdowns, TrajectoryTouchdowns
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats

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

    Raises UserError for other shapes, times that do not rise, and numbers that are not finite.
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
    if len(qpos) != len(qvel) or len(time) != len(qpos) or not (np.diff(time) > 0).all():
        raise UserError(
            "trajectory",
            "qpos, qvel and time are of unlike lengths, or time does not rise",
            "alike",
        )
    if not all(np.isfinite(array).all() for array in (qpos, qvel, time)):
        raise UserError("trajectory", "numbers that are not finite", "finite numbers")
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
