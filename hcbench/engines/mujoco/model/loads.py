"""MuJoCo: a pair at rest in a user's model, pressed together and pushed along its plate."""

from __future__ import annotations

import copy
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.model.bodies import effective_mass
from hcbench.engines.mujoco.model.standing import (
    force_and_depth,
    laid_down,
    rest_on_slope,
    stands_on_world,
)
from hcbench.sim.loads import (
    LAST,
    LOADS,
    PRESSED_S,
    PRESSED_STEPS,
    PUSHED_STEPS,
    BorneLoad,
    Carried,
    borne,
    creep_of,
    push_of,
    rests,
)

if TYPE_CHECKING:
    from hcbench.engines.mujoco.model.open import OpenedModel
    from hcbench.terms.impact import Floats


# A normal within this cosine of gravity is level.
_LEVEL = math.cos(math.radians(0.5))
# A part whose effective mass along the plate is greater than that along the normal, over this share,
# is guided by joints: friction does not hold it.
_GUIDED = 0.02


class _ForceAtTouch:
    """The contact of a pair in a state: force on the moving part, N; the point where it acts, m.

    normal: N, apart. along: friction, (3,) in the world. axes: along the plate, (2, 3).
    """

    def __init__(self, opened: OpenedModel, data: Any) -> None:
        sides = opened.place.pair.sides
        wrench = np.zeros(6)
        self.normal = 0.0
        self.along = np.zeros(3)
        self.axes = np.zeros((2, 3))
        point = np.zeros(3)
        for i in range(data.ncon):
            contact = data.contact[i]
            if sides[contact.geom].sum() != 3:
                continue
            backend().mj_contactForce(opened.model, data, i, wrench)
            frame = contact.frame.reshape(3, 3)
            self.axes = frame[1:].copy()
            # MuJoCo's force acts on the contact's second geom.
            sign = 1.0 if sides[contact.geom[1]] == 1 else -1.0
            self.normal += float(wrench[0])
            self.along += sign * (wrench[1] * frame[1] + wrench[2] * frame[2])
            point += float(wrench[0]) * contact.pos
        self.point: Floats = (
            point / self.normal if self.normal > 0.0 else opened.place.contact.point
        )


def carried_by(opened: OpenedModel) -> Carried:
    """Loads that the pair carries where it rests; none where nothing holds the two together.

    Forces act on the moving part, at the point where the contact bears it: so they turn no joint
    while the contact holds.
    """
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
    """(slope, rad; speed down it, m/s) of a body at rest, in a state that is moved on; no speed of
    a body that rolls.
    """
    slope, rest = rest_on_slope(opened, data)
    body = opened.place.pair.first.body
    turns = np.zeros((3, opened.model.nv))
    backend().mj_jacBody(opened.model, data, None, turns, body)
    spin = float(np.linalg.norm(turns @ data.qvel))
    lever = float(np.linalg.norm(_ForceAtTouch(opened, data).point - data.xipos[body]))
    return slope, creep_of(rest.drift, spin, lever)


def _push(opened: OpenedModel, data: Any, touch: _ForceAtTouch, force: Floats) -> None:
    """Let a force, N, (3,), act on the moving part where the two touch, and its opposite on the
    other.
    """
    pair = opened.place.pair
    for sign, body in ((1.0, pair.first.body), (-1.0, pair.second.body)):
        if opened.model.body_weldid[body]:
            lever = touch.point - data.xipos[body]
            data.xfrc_applied[body, :3] = sign * force
            data.xfrc_applied[body, 3:] = sign * np.cross(lever, force)


def _pressed(opened: OpenedModel, resting: Any, touch: _ForceAtTouch, times: float) -> BorneLoad:
    """The pair under so many times its force at rest."""
    model = opened.model
    data = copy.copy(resting)
    more = (times - 1.0) * touch.normal
    _push(opened, data, touch, more * opened.place.contact.normal)
    steps = min(PRESSED_STEPS, round(PRESSED_S / model.opt.timestep))
    last = max(1, round(LAST * steps))
    backend().mj_step(model, data, nstep=steps - last)
    rows = np.zeros((last, 2))
    sides = opened.place.pair.sides.tolist()
    for i in range(last):
        backend().mj_step(model, data)
        rows[i] = force_and_depth(opened, data, sides)
    return borne(times, touch.normal, rows)


def _friction(opened: OpenedModel, resting: Any, touch: _ForceAtTouch) -> list[float]:
    """Limits of friction over the normal force, along each axis of the contact and between them;
    NaN alone for parts that joints keep from moving along the plate, and for a body that other
    contacts hold, too.

    The pair is pushed along its plate by more than friction bears: the friction then is at its
    limit, which a pyramid of two axes has lower between them.
    """
    if _stands_elsewhere(opened, resting):
        return [math.nan]

    def mass(way: Floats) -> float:
        row = opened.place.pair.approach_row(resting, touch.point, way)
        return effective_mass(opened.model, resting, row)

    most = mass(opened.place.contact.normal) / _GUIDED
    ways = [axis for axis in touch.axes if mass(axis) < most]
    if len(ways) > 1:
        ways.append((ways[0] + ways[1]) / math.sqrt(2.0))
    size = push_of(opened.facts().friction, touch.normal)
    limits = []
    for way in ways:
        data = copy.copy(resting)
        _push(opened, data, touch, size * way)
        limit = 0.0
        for _ in range(PUSHED_STEPS):
            backend().mj_step(opened.model, data)
            now = _ForceAtTouch(opened, data)
            if now.normal > 0.0:
                limit = max(limit, -float(now.along @ way) / now.normal)
        limits.append(limit)
    return limits or [math.nan]


def _stands_elsewhere(opened: OpenedModel, data: Any) -> bool:
    """True if the rigid part that moves touches something besides the pair: that holds it, too."""
    sides = opened.place.pair.sides
    rigid = opened.model.body_weldid
    moving = rigid[opened.place.pair.first.body]
    for i in range(data.ncon):
        geoms = data.contact[i].geom
        if sides[geoms].sum() != 3 and moving in rigid[opened.model.geom_bodyid[geoms]]:
            return True
    return False
