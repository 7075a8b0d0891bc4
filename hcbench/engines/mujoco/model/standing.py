"""Rest, slope and grasp of a user's MuJoCo model, and the cost of a step: measured in plain steps."""

from __future__ import annotations

import copy
import itertools
import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.model.pair_reader import MujocoAlongPlate
from hcbench.sim.rest import DIVERGED, Rest, Standing, rest_of
from hcbench.system.errors import UserError
from hcbench.terms.impact import Launch
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.mujoco.model.open import OpenedModel
    from hcbench.terms.impact import Floats

# The slope, rad.
_SLOPE = math.radians(10.0)
# The slope is this share of the friction angle where that is less: the body then has to hold.
_OF_FRICTION = 2.0 / 3.0
# Time of each rest, s.
_SECONDS = 4.0
# Time that fingers have to close, s, before gravity pulls at what they hold.
_CLOSES = 0.5
# Bounds the time of a rest at short steps.
_MOST_STEPS = 20_000
# A grasp starts with this many times the least force that holds the body.
_GRIPS = 4.0
# That force is doubled so often, at most.
_HARDER = 6
# Cosine of two normals below which two contacts face each other.
_OPPOSITE = -0.7
# Steps that are timed at once.
_TIMED = 200
# The shortest of so many times counts: other programs only lengthen one.
_REPEATS = 5
# Speed of what is laid down as it slides, m/s, and for how long it is followed, s.
_SLIDES = 1.0
_SLIDES_S = 1.0


def standing(opened: Sequence[OpenedModel]) -> Standing:
    """Measure how pairs of one model stand, each at touch."""
    first = opened[0]
    stands = not first.model.body_weldid[first.place.pair.second.body]
    held = [pair for pair in itertools.combinations(opened, 2) if _is_grasp(*pair)]
    level = slope = Rest(*[math.nan] * 4)
    hold = math.nan
    angle = math.nan
    data = _at_touch(first)
    with captured_warnings():
        if stands:
            angle = min(_SLOPE, _OF_FRICTION * math.atan(first.facts().friction or 0.0))
            level = _rest(first, data)
            slope = _rest(first, copy.copy(data), _tilted(first, angle)) if angle > 0.0 else slope
        if held:
            hold = _hold(*held[0])
        hop = _highest_hop(opened)
        return Standing.of(level, slope, hold, hop, _cost(first, data), angle)


def rest_of_pair(opened: OpenedModel) -> Rest | None:
    """Rest of the pair from its start, if it touches there, like a held body and its finger, or
    else from the touch; None if nothing holds the two together.
    """
    data = copy.copy(opened.start)
    place = opened.place
    data.time = 0.0
    with captured_warnings():
        backend().mj_forward(opened.model, data)
        if not _touches(opened, data):
            if not place.gravity > 0.0:
                return None
            data.qpos[:] = place.qpos
        # The second body, if it moves; else the world.
        from_body = 0
        if opened.model.body_weldid[place.pair.second.body]:
            from_body = place.pair.second.body
        rest = _rest(opened, data, from_body=from_body)
        if rest is DIVERGED or math.isfinite(rest.force_noise):
            return rest
        return None


def _touches(opened: OpenedModel, data: Any) -> bool:
    return bool((opened.place.pair.sides[data.contact.geom].sum(axis=1) == 3).any())


def _at_touch(opened: OpenedModel) -> Any:
    data = copy.copy(opened.start)
    data.qpos[:] = opened.place.qpos
    return data


def _tilted(opened: OpenedModel, angle: float) -> Floats:
    """Gravity, m/s², (3,), turned by an angle, rad, towards the first
    axis across it; 0 without gravity.
    """
    gravity = np.array(opened.model.opt.gravity)
    size = float(np.linalg.norm(gravity))
    if gravity.any():
        down = gravity / np.linalg.norm(gravity)
    else:
        down = opened.place.contact.normal
    across = np.eye(3)[np.abs(down).argmin()]
    across -= down * float(down @ across)
    along = across / np.linalg.norm(across)
    return np.asarray(size * (math.cos(angle) * down + math.sin(angle) * along))


def _rest(
    opened: OpenedModel, data: Any, gravity: Floats | None = None, from_body: int = 0
) -> Rest:
    """Rest of the pair at the end of a while, from a state that is moved on.

    gravity: m/s²; None: the model's.
    from_body: the body whose motion does not count.
    """
    mujoco = backend()
    model = opened.model
    timestep = model.opt.timestep
    body = opened.place.pair.first.body
    normal = opened.place.contact.normal
    steps = min(_MOST_STEPS, round(_SECONDS / timestep))
    settling = steps // 2
    count = steps - settling
    path = np.zeros((count, 5))
    position = path[:, :3]  # m
    force = path[:, 3]  # N
    depth = path[:, 4]  # m
    gravity_before = np.array(model.opt.gravity)
    if gravity is not None:
        model.opt.gravity[:] = gravity
    mujoco.mj_step(model, data, nstep=settling)
    sides = opened.place.pair.sides.tolist()
    # Views of the state: tens of thousands of steps are taken here.
    place = data.xpos[body]
    origin = data.xpos[from_body]
    for i in range(count):
        mujoco.mj_step(model, data)
        np.subtract(place, origin, out=position[i])
        force[i], depth[i] = _force_and_depth(opened, data, sides)
    model.opt.gravity[:] = gravity_before
    if not np.isfinite(path).all():
        return DIVERGED
    moment = np.arange(count) * timestep
    height = position @ normal
    rate = np.gradient(height, timestep)
    moved = position
    # A body that sinks into the world does not drift.
    if from_body == 0:
        moved = position - np.outer(height, normal)
    return rest_of(moment, depth, rate, force, moved)


def _force_and_depth(opened: OpenedModel, data: Any, sides: Sequence[int]) -> tuple[float, float]:
    """Force of the pair's contact, N, and penetration at its deepest point, m; 0 without one.

    sides: of each geom, as a list: of a few contacts NumPy would take ten times as long.
    """
    contacts = data.contact
    of_pair = [i for i, (a, b) in enumerate(contacts.geom.tolist()) if sides[a] + sides[b] == 3]
    if not of_pair:
        return 0.0, 0.0
    distances = contacts.dist.tolist()
    # In the contact's frame, the normal first.
    wrench = np.zeros(6)
    force = 0.0
    for i in of_pair:
        backend().mj_contactForce(opened.model, data, i, wrench)
        force += float(wrench[0])
    return force, opened.place.contact.onset - min(distances[i] for i in of_pair)


def _is_grasp(one: OpenedModel, other: OpenedModel) -> bool:
    """Say whether both pairs move the same body, between two that face each other."""
    same = one.place.pair.first.body == other.place.pair.first.body
    return same and float(one.place.contact.normal @ other.place.contact.normal) < _OPPOSITE


def _hold(one: OpenedModel, other: OpenedModel) -> float:
    """Drift, m/s, of a body that two others hold with a few times the force that it
    takes; NaN where they cannot.
    """
    model = one.model
    friction = one.facts().friction
    if not friction > 0.0:
        return math.nan
    gravity = np.array(model.opt.gravity)
    weight = STANDARD_GRAVITY * float(model.body_subtreemass[one.place.pair.first.body])  # N
    push = _GRIPS * weight / (2.0 * friction)  # N, of each side
    # Servos that hold the two fingers open push back, by a force that is not known.
    for _ in range(_HARDER):
        data = copy.copy(one.start)
        for each in (one, other):
            data.xfrc_applied[each.place.pair.second.body, :3] -= push * each.place.contact.normal
        model.opt.gravity[:] = 0.0
        backend().mj_step(model, data, nstep=round(_CLOSES / model.opt.timestep))
        model.opt.gravity[:] = gravity
        weaker = min(_force(one, data), _force(other, data))
        if weaker * 2.0 * friction > 2.0 * weight:
            return _rest(one, data, from_body=one.place.pair.second.body).drift
        push *= 2.0
    return math.nan


def _highest_hop(opened: Sequence[OpenedModel]) -> float:
    """The largest hop of loose bodies that slide on the world, m; NaN where there are none."""
    hops = []
    for each in opened:
        pair = each.place.pair
        on_world = not each.model.body_weldid[pair.second.body]
        if on_world and each.place.gravity > 0.0 and not pair.more_than_contacts:
            hops.append(_hop(each))
    return max(hops, default=math.nan)


def _hop(opened: OpenedModel) -> float:
    """Hop of a body that is laid down as it slides: its rise over the start, m, beyond what it
    falls in the first step, of which the contact knows nothing; NaN where it cannot slide.
    """
    mujoco = backend()
    model = opened.model
    place = opened.place
    timestep = model.opt.timestep
    data = _at_touch(opened)
    data.qvel[:] = 0.0
    slide = MujocoAlongPlate(place, Launch(0.0, slip=(_SLIDES, 0.0)), None)
    try:
        slide.send(data, 0.0)
    except UserError:
        return math.nan
    mujoco.mj_forward(model, data)
    body = place.pair.first.body
    up = -place.contact.normal
    start = float(data.xipos[body] @ up)
    highest = 0.0
    for _ in range(min(_MOST_STEPS, round(_SLIDES_S / timestep))):
        mujoco.mj_step(model, data)
        highest = max(highest, float(data.xipos[body] @ up) - start)
    if not np.isfinite(data.qpos).all():
        return math.inf
    return max(0.0, highest - place.gravity * float(timestep) ** 2)


def _force(opened: OpenedModel, data: Any) -> float:
    """Force of the pair's contact, N."""
    return _force_and_depth(opened, data, opened.place.pair.sides.tolist())[0]


def _cost(opened: OpenedModel, data: Any) -> tuple[float, float]:
    """(iterations of the solver, s of CPU) of a step, from a state at rest."""
    mujoco = backend()
    model = opened.model
    times = []
    for _ in range(_REPEATS):
        run = copy.copy(data)
        start = time.process_time()
        mujoco.mj_step(model, run, nstep=_TIMED)
        times.append((time.process_time() - start) / _TIMED)
    iterations = 0.0
    for _ in range(_TIMED):
        mujoco.mj_step(model, data)
        islands = max(1, int(data.nisland))
        iterations += float(data.solver_niter[:islands].sum())
    return iterations / _TIMED, min(times)
