"""Rest, slope and grasp of a user's MuJoCo model, and the cost of a step: measured in plain steps."""

from __future__ import annotations

import copy
import itertools
import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.sim.rest import DIVERGED, Rest, rest_of
from hcbench.sim.standing import Standing
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.mujoco.model.under_test import MujocoModel
    from hcbench.terms.impact import Floats

_SLOPE, _OF_FRICTION = math.radians(10.0), 2.0 / 3.0  # of the friction angle, where that is less
_SECONDS, _CLOSES = 4.0, 0.5  # of each rest; before gravity pulls at what is held
_MOST_STEPS = 20_000
_GRIPS, _HARDER, _OPPOSITE = 4.0, 6, -0.7  # times the least force; doublings of it; cosine of two normals
_TIMED, _REPEATS = 200, 5  # steps, and times of which the shortest counts


def standing(opened: Sequence[MujocoModel]) -> Standing:
    """Measure how pairs of one model stand, each at touch."""
    first = opened[0]
    stands = not first.model.body_weldid[first.place.pair.second.body]
    held = [pair for pair in itertools.combinations(opened, 2) if _is_grasp(*pair)]
    level = slope = Rest(*[math.nan] * 4)
    hold, angle, data = math.nan, math.nan, _at_touch(first)
    with captured_warnings():
        if stands:
            angle = min(_SLOPE, _OF_FRICTION * math.atan(first.facts().friction or 0.0))
            level = _rest(first, data)
            slope = _rest(first, copy.copy(data), _tilted(first, angle)) if angle > 0.0 else slope
        if held:
            hold = _hold(*held[0])
        return Standing.of(level, slope, hold, _cost(first, data), angle)


def rest_of_pair(opened: MujocoModel) -> Rest | None:
    """Rest of the pair from its start, if it touches there, like a held body and its finger, or
    else from the touch; None if nothing holds the two together.
    """
    data, place = copy.copy(opened.start), opened.place
    data.time = 0.0
    with captured_warnings():
        backend().mj_forward(opened.model, data)
        if not _touches(opened, data):
            if not place.gravity > 0.0:
                return None
            data.qpos[:] = place.qpos
        moves = bool(opened.model.body_weldid[place.pair.second.body])
        rest = _rest(opened, data, from_body=place.pair.second.body if moves else 0)
        return rest if rest is DIVERGED or math.isfinite(rest.force_noise) else None


def _touches(opened: MujocoModel, data: Any) -> bool:
    return bool((opened.place.pair.sides[data.contact.geom].sum(axis=1) == 3).any())


def _at_touch(opened: MujocoModel) -> Any:
    data = copy.copy(opened.start)
    data.qpos[:] = opened.place.qpos
    return data


def _tilted(opened: MujocoModel, angle: float) -> Floats:
    """Gravity, turned by an angle towards the first axis across it."""
    gravity = np.array(opened.model.opt.gravity)
    down = gravity / np.linalg.norm(gravity) if gravity.any() else opened.place.contact.normal
    across = np.eye(3)[np.abs(down).argmin()]
    across -= down * float(down @ across)
    size = float(np.linalg.norm(gravity))
    along = across / np.linalg.norm(across)
    return np.asarray(size * (math.cos(angle) * down + math.sin(angle) * along))


def _rest(opened: MujocoModel, data: Any, gravity: Floats | None = None, from_body: int = 0) -> Rest:
    """Rest of the pair at the end of a while, from a state that is moved on.

    gravity: m/s²; None: the model's. from_body: the body whose motion does not count.
    """
    mujoco, model, place = backend(), opened.model, opened.place
    before, steps = np.array(model.opt.gravity), min(_MOST_STEPS, round(_SECONDS / model.opt.timestep))
    path, body, normal = np.zeros((steps - steps // 2, 5)), place.pair.first.body, place.contact.normal
    model.opt.gravity[:] = before if gravity is None else gravity
    mujoco.mj_step(model, data, nstep=steps // 2)
    for row in path:
        mujoco.mj_step(model, data)
        row[:3], row[3] = data.xpos[body] - data.xpos[from_body], _force(opened, data)
        row[4] = _depth(opened, data)
    model.opt.gravity[:] = before
    if not np.isfinite(path).all():
        return DIVERGED
    moment = np.arange(len(path)) * model.opt.timestep
    rate = np.gradient(path[:, :3] @ normal, model.opt.timestep)
    across = path[:, :3] - np.outer(path[:, :3] @ normal, normal)
    return rest_of(moment, path[:, 4], rate, path[:, 3], across if from_body == 0 else path[:, :3])


def _depth(opened: MujocoModel, data: Any) -> float:
    """Penetration at the deepest point of the pair's contact, m; 0 without one."""
    mine = opened.place.pair.sides[data.contact.geom].sum(axis=1) == 3
    return float(opened.place.contact.onset - data.contact.dist[mine].min()) if mine.any() else 0.0


def _is_grasp(one: MujocoModel, other: MujocoModel) -> bool:
    """Say whether both pairs move the same body, between two that face each other."""
    same = one.place.pair.first.body == other.place.pair.first.body
    return same and float(one.place.contact.normal @ other.place.contact.normal) < _OPPOSITE


def _hold(one: MujocoModel, other: MujocoModel) -> float:
    """Drift, m/s, of a body that two others hold with a few times the force that it takes; NaN where they
    cannot.
    """
    model, friction = one.model, one.facts().friction
    if not friction > 0.0:
        return math.nan
    weight = STANDARD_GRAVITY * float(model.body_subtreemass[one.place.pair.first.body])
    push, gravity = _GRIPS * weight / (2.0 * friction), np.array(model.opt.gravity)
    for _ in range(_HARDER):  # servos that hold the two open push back
        data = copy.copy(one.start)
        for each in (one, other):
            data.xfrc_applied[each.place.pair.second.body, :3] -= push * each.place.contact.normal
        model.opt.gravity[:] = 0.0
        backend().mj_step(model, data, nstep=round(_CLOSES / model.opt.timestep))
        model.opt.gravity[:] = gravity
        if min(_force(each, data) for each in (one, other)) * 2.0 * friction > 2.0 * weight:
            return _rest(one, data, from_body=one.place.pair.second.body).drift
        push *= 2.0
    return math.nan


def _force(opened: MujocoModel, data: Any) -> float:
    """Force of the pair's contact, N."""
    force, total = np.zeros(6), 0.0
    for i in range(data.ncon):
        if opened.place.pair.sides[data.contact[i].geom].sum() == 3:
            backend().mj_contactForce(opened.model, data, i, force)
            total += float(force[0])
    return total


def _cost(opened: MujocoModel, data: Any) -> tuple[float, float]:
    """(iterations of the solver, s of CPU) of a step, from a state at rest."""
    mujoco, model, iterations, times = backend(), opened.model, 0.0, []
    for _ in range(_REPEATS):
        run, start = copy.copy(data), time.process_time()
        mujoco.mj_step(model, run, nstep=_TIMED)
        times.append((time.process_time() - start) / _TIMED)
    for _ in range(_TIMED):
        mujoco.mj_step(model, data)
        iterations += float(data.solver_niter[: max(1, int(data.nisland))].sum())
    return iterations / _TIMED, min(times)
