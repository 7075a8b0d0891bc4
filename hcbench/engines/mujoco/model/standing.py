"""A pair at rest in a user's MuJoCo model, measured in plain steps: on the level, on a slope, in a grasp
and under loads; and the cost of a step.
"""

from __future__ import annotations

import copy
import itertools
import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.model.bodies import effective_mass, geom_friction
from hcbench.engines.mujoco.model.pair import BOTH_SIDES
from hcbench.engines.mujoco.model.pair_reader import MujocoAlongPlate
from hcbench.sim.rest import (
    DIVERGED,
    LAST,
    LOADS,
    PRESSED_S,
    PRESSED_STEPS,
    PUSHED_STEPS,
    VIBRATION_MAX,
    BorneLoad,
    Carried,
    Rest,
    Standing,
    borne,
    creep_of,
    push_of,
    rest_of,
    rests,
    slope_of,
)
from hcbench.system.errors import UserError
from hcbench.terms.impact import Launch
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.mujoco.model.open import OpenedModel
    from hcbench.terms.impact import Floats

# Time of each rest, s.
_SECONDS = 4.0
# Time that fingers have to close, s, before gravity pulls at what they hold.
_CLOSING_SECONDS = 0.5
# Times as long, at most, are waited for a body whose vibration still dies away.
_LONGER = 4
# Bounds the time of a rest at short steps.
_MOST_STEPS = 20_000
# A grasp starts with this many times the least force that holds the body.
_FIRST_GRIP = 4.0
# That force is doubled so often, at most.
_GRIPS_MAX = 6
# Cosine of two normals below which two contacts face each other.
_OPPOSITE = -0.7
# Steps that are timed at once.
_TIMED = 200
# The shortest of so many times counts: other programs only lengthen one.
_REPEATS = 5
# A robot of which a part turns by more than this, rad, has fallen: servos that sag turn it by less.
_FALLEN = 0.5
# Speed of what is laid down as it slides, m/s, and for how long it is followed, s.
_SLIDING_SPEED = 1.0
_SLIDING_SECONDS = 1.0


def standing(opened: Sequence[OpenedModel]) -> Standing:
    """Measure how pairs of one model rest: on the level, on a slope, in a grasp, and as they slide;
    and what a step costs. NaN for what the model does not have.

    opened: the model with each of the pairs at touch, one or more.
    Level, slope and cost are of the first pair, if its second part stands still; the grasp is of
    the first two that hold one body from both sides, the hop the highest of loose bodies that
    slide.
    """
    first = opened[0]
    held = [pair for pair in itertools.combinations(opened, 2) if _is_grasp(*pair)]
    level = slope = Rest(*[math.nan] * 4)
    hold = math.nan
    angle = math.nan
    falls = False
    data = _at_touch(first)
    with captured_warnings():
        if stands_on_world(first):
            level = _rest(first, data)
            falls = _has_fallen(first, data)
            # What lies where it fell shakes as it happens to lie.
            level = replace(level, vibration=math.nan) if falls else level
        if stands_on_world(first) and not falls:
            angle, slope = rest_on_slope(first, copy.copy(data))
        if held:
            hold = _hold(*held[0])
        hop = _highest_hop(opened)
        return Standing.of(level, slope, hold, hop, _cost(first, data), angle, falls)


def stands_on_world(opened: OpenedModel) -> bool:
    """Say whether the pair's second part does not move."""
    return not opened.model.body_weldid[opened.place.pair.second.body]


def _has_fallen(opened: OpenedModel, data: Any) -> bool:
    """Say whether any body of the robot with the pair's first part has turned by more than _FALLEN,
    rad, since the touch, as one does that its actuators do not hold.

    data: MjData after a rest on the level.
    """
    model = opened.model
    start = _at_touch(opened)
    backend().mj_kinematics(model, start)
    robot = model.body_rootid == model.body_rootid[opened.place.pair.first.body]
    # A turn from one unit quaternion to another is twice the angle between them; q and -q are the
    # same attitude.
    cosines = np.abs((start.xquat[robot] * data.xquat[robot]).sum(axis=1))
    # Not "any below": NaN has fallen, too.
    return not bool((cosines > math.cos(0.5 * _FALLEN)).all())


def _friction_of(opened: OpenedModel) -> float:
    """μ of the pair."""
    return geom_friction(opened.model, opened.place.contact.geoms)


def rest_on_slope(opened: OpenedModel, data: Any) -> tuple[float, Rest]:
    """Let a pair rest on a slope, and return the slope, rad, and how it rests; NaN where the pair has
    no friction.

    opened: the model with the pair.
    data: MjData at rest on the level; moved on.
    Gravity is turned in place of the bodies.
    """
    angle = slope_of(_friction_of(opened))
    if not angle > 0.0:
        return angle, Rest(*[math.nan] * 4)
    return angle, _rest(opened, data, _tilted(opened, angle))


def rest_of_pair(opened: OpenedModel) -> Rest | None:
    """Rest of the pair from its start, if it touches there, like a held body and its finger, or
    else from the touch; None if nothing holds the two together, DIVERGED where the state is not
    finite.
    """
    rest, _ = laid_down(opened)
    return rest


def laid_down(opened: OpenedModel) -> tuple[Rest | None, Any]:
    """Let a pair come to rest: how it rests, and the MjData at the end.

    opened: with the pair at touch.
    It begins at the model's start if the two touch there, else at the touch if gravity presses them
    together. The rest is None where nothing holds the two together, DIVERGED where the state is not
    finite at the end.
    """
    data = copy.copy(opened.start)
    place = opened.place
    data.time = 0.0
    with captured_warnings():
        backend().mj_forward(opened.model, data)
        if not _has_contact(opened, data):
            if not place.gravity > 0.0:
                return None, data
            data.qpos[:] = place.qpos
        # The second body, if it moves; else the world.
        from_body = 0 if stands_on_world(opened) else place.pair.second.body
        rest = _rest(opened, data, from_body=from_body)
        if rest is DIVERGED or math.isfinite(rest.force_noise):
            return rest, data
        return None, data


def _has_contact(opened: OpenedModel, data: Any) -> bool:
    """Say whether MuJoCo has a contact of the pair in `data`, an MjData after collision detection;
    within the margins of its geoms it has one of two that do not touch yet.
    """
    return bool((opened.place.pair.sides[data.contact.geom].sum(axis=1) == BOTH_SIDES).any())


def _at_touch(opened: OpenedModel) -> Any:
    """A new MjData at the start, with the pair brought to touch."""
    data = copy.copy(opened.start)
    data.qpos[:] = opened.place.qpos
    return data


def _tilted(opened: OpenedModel, angle: float) -> Floats:
    """Gravity of the model turned by an angle, rad, as a vector, m/s², (3,), as if the plate were a
    slope; it is turned towards the axis of the world that is most across it. 0 without gravity.
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
    """Step a pair for _SECONDS and measure how it rests in the second half; DIVERGED where it ends
    in numbers that are not finite. While its vibration dies away that is the tail of settling: it is
    measured again over the next half, _LONGER times at most.

    data: MjData at the start; moved on.
    gravity: m/s², (3,), in place of the model's, which holds again afterwards; None: the model's.
    from_body: number of the body from which positions are taken, such as a hand; 0: the world.
    """
    model = opened.model
    timestep = model.opt.timestep
    steps = min(_MOST_STEPS, round(_SECONDS / timestep))
    settling = steps // 2
    gravity_before = np.array(model.opt.gravity)
    if gravity is not None:
        model.opt.gravity[:] = gravity
    backend().mj_step(model, data, nstep=settling)
    for _ in range(1 + _LONGER):
        rest = _rest_in(opened, data, steps - settling, from_body)
        if not (rest.dies_away and rest.vibration > VIBRATION_MAX):
            break
    model.opt.gravity[:] = gravity_before
    return rest


def _rest_in(opened: OpenedModel, data: Any, steps: int, from_body: int) -> Rest:
    """Take so many steps and measure how the pair rests in them; DIVERGED where a number is not
    finite.

    data: MjData; moved on.
    from_body: number of the body from which positions are taken; 0: the world.
    """
    position, force, depth = _followed(opened, data, steps, from_body)
    if not all(np.isfinite(column).all() for column in (position, force, depth)):
        return DIVERGED
    normal = opened.place.contact.normal
    timestep = opened.model.opt.timestep
    moment = np.arange(len(force)) * timestep
    # The normal points into the second part: how far, m, and how fast, m/s, the first part sinks.
    sunk = position @ normal
    rate = np.gradient(sunk, timestep)
    moved = position
    # A body that sinks into the world does not drift.
    if from_body == 0:
        moved = position - np.outer(sunk, normal)
    return rest_of(moment, depth, rate, force, moved)


def _followed(
    opened: OpenedModel, data: Any, steps: int, from_body: int
) -> tuple[Floats, Floats, Floats]:
    """Take n steps, and read after each the position of the pair's moving body from another, m, (n,
    3), the force of the pair's contact, N, (n,), and its penetration, m, (n,).

    data: MjData; moved on.
    steps: n.
    from_body: number of the other body; 0: the world.
    """
    position = np.zeros((steps, 3))
    force = np.zeros(steps)
    depth = np.zeros(steps)
    sides = opened.place.pair.sides.tolist()
    # Views of the state: tens of thousands of steps are taken here.
    place = data.xpos[opened.place.pair.first.body]
    origin = data.xpos[from_body]
    for i in range(steps):
        backend().mj_step(opened.model, data)
        np.subtract(place, origin, out=position[i])
        force[i], depth[i] = force_and_depth(opened, data, sides)
    return position, force, depth


class ForceAndDepth(NamedTuple):
    """Contact of a pair in one state: force along its normal, N, and depth of its deepest point, m,
    counted from where the force begins. Both are 0 without a contact.
    """

    force: float
    depth: float


def force_and_depth(opened: OpenedModel, data: Any, sides: Sequence[int]) -> ForceAndDepth:
    """Read the contact of the pair in a state.

    data: MjData of the state, with its contacts and forces.
    sides: of each geom, as a list: 1 for the first part's, 2 for the second's, else 0; with one 0
    more at the end, which a flex takes, as its geom is -1.
    The penetration counts from where the force begins. Of a few contacts NumPy would take ten times
    as long.
    """
    contacts = data.contact
    of_pair = [
        i for i, (a, b) in enumerate(contacts.geom.tolist()) if sides[a] + sides[b] == BOTH_SIDES
    ]
    if not of_pair:
        return ForceAndDepth(0.0, 0.0)
    distances = contacts.dist.tolist()
    # In the contact's frame, the normal first.
    wrench = np.zeros(6)
    force = 0.0
    for i in of_pair:
        backend().mj_contactForce(opened.model, data, i, wrench)
        force += float(wrench[0])
    nearest = min(distances[i] for i in of_pair)
    return ForceAndDepth(force, opened.place.contact.onset - nearest)


def _is_grasp(one: OpenedModel, other: OpenedModel) -> bool:
    """Say whether both pairs move the same body, between two that face each other."""
    same = one.place.pair.first.body == other.place.pair.first.body
    return same and float(one.place.contact.normal @ other.place.contact.normal) < _OPPOSITE


def _hold(one: OpenedModel, other: OpenedModel) -> float:
    """Drift of a body that two fingers hold by friction against gravity, m/s; NaN where they cannot,
    and without friction.

    one, other: the pairs of the body with each finger; the body is the first part of both. The
    fingers close without gravity, pushed towards the body by _FIRST_GRIP times the force that
    friction needs, or more if servos resist; then gravity pulls at the body.
    """
    model = one.model
    friction = _friction_of(one)
    if not friction > 0.0:
        return math.nan
    gravity = np.array(model.opt.gravity)
    weight = STANDARD_GRAVITY * float(model.body_subtreemass[one.place.pair.first.body])  # N
    # N, of each finger: the friction of both carries the weight.
    push = _FIRST_GRIP * weight / (2.0 * friction)
    # Servos that hold the two fingers open push back, by a force that is not known.
    for _ in range(_GRIPS_MAX):
        data = copy.copy(one.start)
        # The normals point from the body to the fingers.
        for each in (one, other):
            data.xfrc_applied[each.place.pair.second.body, :3] -= push * each.place.contact.normal
        model.opt.gravity[:] = 0.0
        backend().mj_step(model, data, nstep=round(_CLOSING_SECONDS / model.opt.timestep))
        model.opt.gravity[:] = gravity
        weaker = min(_force(one, data), _force(other, data))
        # Friction could carry the body twice.
        if weaker * 2.0 * friction > 2.0 * weight:
            return _rest(one, data, from_body=one.place.pair.second.body).drift
        push *= 2.0
    return math.nan


def _highest_hop(opened: Sequence[OpenedModel]) -> float:
    """The largest hop of loose bodies that are laid down sliding on what stands still, m; NaN where
    there are none.

    opened: the model with each of its pairs at touch.
    The first body of a pair is loose if gravity presses it on what stands still and nothing else,
    such as a joint or servo, acts on it.
    """
    hops = []
    for each in opened:
        pair = each.place.pair
        on_world = not each.model.body_weldid[pair.second.body]
        if on_world and each.place.gravity > 0.0 and not pair.more_than_contacts:
            hops.append(_hop(each))
    return max(hops, default=math.nan)


def _hop(opened: OpenedModel) -> float:
    """Lay a body down as it slides at _SLIDING_SPEED, and measure how high its centre hops above its
    start, m; NaN where it cannot slide, infinite where the state is not finite at the end.

    opened: with the pair at touch.
    What gravity lets it fall in one step, g h², is taken off: in the first step the contact does
    not act yet.
    """
    mujoco = backend()
    model = opened.model
    place = opened.place
    timestep = model.opt.timestep
    data = _at_touch(opened)
    data.qvel[:] = 0.0
    slide = MujocoAlongPlate(place, Launch(0.0, slip=(_SLIDING_SPEED, 0.0)), None)
    try:
        slide.send(data, 0.0)
    # The joints do not let it slide.
    except UserError:
        return math.nan
    mujoco.mj_forward(model, data)
    body = place.pair.first.body
    up = -place.contact.normal
    start = float(data.xipos[body] @ up)
    highest = 0.0
    for _ in range(min(_MOST_STEPS, round(_SLIDING_SECONDS / timestep))):
        mujoco.mj_step(model, data)
        highest = max(highest, float(data.xipos[body] @ up) - start)
    if not np.isfinite(data.qpos).all():
        return math.inf
    return max(0.0, highest - place.gravity * float(timestep) ** 2)


def _force(opened: OpenedModel, data: Any) -> float:
    """Force of the pair's contact, N."""
    return force_and_depth(opened, data, opened.place.pair.sides.tolist()).force


def _cost(opened: OpenedModel, data: Any) -> tuple[float, float]:
    """Cost of one step at rest: iterations of the solver and seconds of CPU, means over _TIMED
    steps, the time the shortest of _REPEATS.

    data: MjData at rest; moved on.
    Iterations of islands, which MuJoCo solves one by one, add up.
    """
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


# A normal within this cosine of gravity is level.
_LEVEL = math.cos(math.radians(0.5))
# A part whose effective mass along the plate is greater than that along the normal, over this share,
# is guided by joints: friction does not hold it.
_GUIDED = 0.02


class _ForceAtTouch:
    """The contact of a pair in a state: force on the moving part, N; the point where it acts, m.

    normal: N, apart.
    along: friction, (3,) in the world.
    axes: along the plate, (2, 3).
    """

    def __init__(self, opened: OpenedModel, data: Any) -> None:
        """Add up the forces of all contacts of the pair; without one they are 0, and the point is that
        of the touch.

        opened: the model with the pair.
        data: MjData after a step or mj_forward. The axes are those of the last contact: all lie in
        one plate.
        """
        # 1 for geoms of the first part, 2 for those of the second, else 0.
        sides = opened.place.pair.sides
        # Of one contact, in its own frame: force along the normal and two tangents, N, then torques.
        wrench = np.zeros(6)
        self.normal = 0.0
        self.along = np.zeros(3)
        self.axes = np.zeros((2, 3))
        point = np.zeros(3)
        for i in range(data.ncon):
            contact = data.contact[i]
            if sides[contact.geom].sum() != BOTH_SIDES:
                continue
            backend().mj_contactForce(opened.model, data, i, wrench)
            frame = contact.frame.reshape(3, 3)
            self.axes = frame[1:].copy()
            # MuJoCo's force acts on the contact's second geom.
            sign = 1.0 if sides[contact.geom[1]] == 1 else -1.0
            self.normal += float(wrench[0])
            self.along += sign * (wrench[1] * frame[1] + wrench[2] * frame[2])
            point += float(wrench[0]) * contact.pos
        self.point: Floats = opened.place.contact.point
        if self.normal > 0.0:
            # The mean of the points, by their forces.
            self.point = point / self.normal


def carried_by(opened: OpenedModel) -> Carried:
    """Measure what the contact of a pair carries at rest: multiples of its load, the limits of
    friction, and the creep on a slope; nothing where the two do not come to rest on each other.

    opened: with the pair at touch.
    Forces act on the moving part, at the point where the contact bears it: so they turn no joint
    while the contact holds. Creep is left NaN for parts that joints move, for a plate that is
    tilted or moves, and without friction.
    """
    # How it rests, and the MjData at the end.
    rest, data = laid_down(opened)
    if rest is None or not math.isfinite(rest.penetration) or not rests(rest):
        return Carried()
    with captured_warnings():
        backend().mj_forward(opened.model, data)
        touch = _ForceAtTouch(opened, data)
        if not touch.normal > 0.0:
            return Carried()
        loads = [BorneLoad(1.0, touch.normal, rest.penetration)]
        loads += [_pressed(opened, data, touch, times) for times in LOADS[1:]]
        ratios = _friction(opened, data, touch)
        slope = creep = math.nan
        # Joints move a leg's foot as it settles: the contact itself does not creep. On a plate that
        # is tilted already, the slope would be another one.
        lies_free = not opened.facts().shares and _is_level(opened)
        if lies_free and stands_on_world(opened) and math.isfinite(ratios[0]):
            slope, creep = _creep(opened, copy.copy(data))
    return Carried(tuple(loads), max(ratios), min(ratios), slope, creep)


def _is_level(opened: OpenedModel) -> bool:
    """True if gravity acts along the normal of the pair."""
    gravity = np.array(opened.model.opt.gravity)
    along = abs(float(gravity @ opened.place.contact.normal))
    return along > _LEVEL * float(np.linalg.norm(gravity))


def _creep(opened: OpenedModel, data: Any) -> tuple[float, float]:
    """Let a pair rest on a slope, and return the slope, rad, and the speed with which the body creeps
    down it, m/s, NaN for one that rolls.

    opened: the model with the pair.
    data: MjData of the body at rest on the level; moved on.
    """
    slope, rest = rest_on_slope(opened, data)
    body = opened.place.pair.first.body
    turns = np.zeros((3, opened.model.nv))
    backend().mj_jacBody(opened.model, data, None, turns, body)
    spin = float(np.linalg.norm(turns @ data.qvel))  # rad/s
    # From the contact to the body's centre, m: a body that rolls drifts by the spin times this.
    lever = float(np.linalg.norm(_ForceAtTouch(opened, data).point - data.xipos[body]))
    return slope, creep_of(rest.drift, spin, lever)


def _push(opened: OpenedModel, data: Any, touch: _ForceAtTouch, force: Floats) -> None:
    """Let a force, N, (3,), act on the moving part where the two touch, and its opposite on the
    other part, in all steps that `data` takes from now on.

    data: MjData; changed.
    touch: the contact of the pair at rest.
    A part that is welded to the world needs no force.
    """
    pair = opened.place.pair
    for sign, body in ((1.0, pair.first.body), (-1.0, pair.second.body)):
        if opened.model.body_weldid[body]:
            lever = touch.point - data.xipos[body]
            data.xfrc_applied[body, :3] = sign * force
            data.xfrc_applied[body, 3:] = sign * np.cross(lever, force)


def _pressed(opened: OpenedModel, resting: Any, touch: _ForceAtTouch, times: float) -> BorneLoad:
    """Press a resting pair together, so that its contact bears `times` its force at rest, and measure
    what it bears then: force, N, and penetration, m, over the last LAST of the steps.

    resting: MjData at rest, which stays as it is.
    touch: the contact in it.
    times: above 1.
    """
    model = opened.model
    data = copy.copy(resting)
    added = (times - 1.0) * touch.normal
    _push(opened, data, touch, added * opened.place.contact.normal)
    steps = min(PRESSED_STEPS, round(PRESSED_S / model.opt.timestep))
    last = max(1, round(LAST * steps))
    backend().mj_step(model, data, nstep=steps - last)
    # Force, N, and penetration, m, after each step.
    rows = np.zeros((last, 2))
    sides = opened.place.pair.sides.tolist()
    for i in range(last):
        backend().mj_step(model, data)
        rows[i] = force_and_depth(opened, data, sides)
    return borne(times, touch.normal, rows)


def _friction(opened: OpenedModel, resting: Any, touch: _ForceAtTouch) -> list[float]:
    """The largest friction over the normal force, along each axis of the contact in the plate, and
    half-way between the two; [NaN] for parts that joints keep from moving along the plate, and for
    a body that other contacts hold, too.

    resting: MjData of the pair at rest, which stays as it is.
    touch: the contact in it.
    The pair is pushed along its plate by more than friction bears, so the friction is at its limit.
    A pyramidal cone has a lower limit between its axes.
    """
    if _stands_elsewhere(opened, resting):
        return [math.nan]

    def mass(way: Floats) -> float:
        """Effective mass along a direction, kg; infinite where no joint moves along it."""
        row = opened.place.pair.approach_row(resting, touch.point, way)
        return effective_mass(opened.model, resting, row)

    # Along a way with a larger mass, kg, joints hold the part, not friction.
    most = mass(opened.place.contact.normal) / _GUIDED
    ways = [axis for axis in touch.axes if mass(axis) < most]
    if len(ways) > 1:
        ways.append((ways[0] + ways[1]) / math.sqrt(2.0))
    # N: more than friction bears.
    size = push_of(_friction_of(opened), touch.normal)
    limits = []
    for way in ways:
        data = copy.copy(resting)
        _push(opened, data, touch, size * way)
        limit = 0.0
        for _ in range(PUSHED_STEPS):
            backend().mj_step(opened.model, data)
            now = _ForceAtTouch(opened, data)
            # Friction points against the push.
            if now.normal > 0.0:
                limit = max(limit, -float(now.along @ way) / now.normal)
        limits.append(limit)
    return limits or [math.nan]


def _stands_elsewhere(opened: OpenedModel, data: Any) -> bool:
    """Say whether the rigid part that moves touches something besides the pair, which holds it, too.

    data: MjData with contacts.
    """
    sides = opened.place.pair.sides
    rigid = opened.model.body_weldid
    moving = rigid[opened.place.pair.first.body]
    for contact in data.contact:
        # A contact without a row does not act.
        if contact.efc_address < 0:
            continue
        # A flex is not a geom, and has the number -1.
        geoms = contact.geom[contact.geom >= 0]
        if sides[geoms].sum() != BOTH_SIDES and moving in rigid[opened.model.geom_bodyid[geoms]]:
            return True
    return False
