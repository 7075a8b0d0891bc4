"""The whole gate, in plain MuJoCo: drops, a slope, a rolling ball, boxes that fall, a stack."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import speed_reading
from hcbench.engines.mujoco.passivity.contact import HALF, Contact, Stepping
from hcbench.engines.mujoco.passivity.sliding import ball_slides, boxes_slide
from hcbench.sim.passivity import (
    HEIGHTS,
    LASTS,
    MOST_DRIFT,
    MOST_E,
    MOST_ENERGY,
    Bounces,
    DropReader,
    Finding,
    LongestTrain,
    Passivity,
    allowed_rebounds,
)
from hcbench.sim.rest import Rest, last_half, rest_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


# Seconds of drops in one call.
_CHUNK_S = 2.0
# Angle of a slope, rad, and time on it, s.
_SLOPE = math.radians(10.0)
_SLOPE_S = 3.0
# Speed at which a ball starts to roll, m/s, and the time that it rolls, s.
_ROLLS = 1.0
_ROLL_S = 4.0
# Share of its energy that it may have at the end.
_KEPT = 1.0005
# Speeds of a box at touch, m/s.
_BOX_SPEEDS = (0.1, 0.5, 1.5)
# A box is followed for so many seconds and steps, at most.
_BOX_S = 1.5
_BOX_STEPS = 4000
# Time for which a stack is followed, s.
_STACK_S = 5.0
# Depth of its lowest box that is allowed, m, for a step of 1 s.
_SINKS = 0.3
# In g h: slower bounces have too little energy to matter.
_SLOWEST = 1.6
# A box on its face, on an edge and on a vertex: quaternions, and how high
# its centre is then over HALF.
_ATTITUDES = {
    "face": ((1.0, 0.0, 0.0, 0.0), 1.0),
    "edge": ((math.cos(math.pi / 8), math.sin(math.pi / 8), 0.0, 0.0), math.sqrt(2.0)),
    "vertex": ((0.888073833977, 0.325057583672, -0.325057583672, 0.0), math.sqrt(3.0)),
}


def drops(
    contact: Contact,
    options: Stepping,
    heights: Sequence[float] = HEIGHTS,
    train: LongestTrain | None = None,
) -> Bounces:
    """Bounces of balls that are dropped from heights (m) and simulated for LASTS (s).

    train: the longest train of bounces that the target allows; None: none.
    """
    mujoco = backend()
    model = contact.with_ball(options)
    data = mujoco.MjData(model)
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    states = np.empty((len(heights), mujoco.mj_stateSize(model, kind)))
    for state, height in zip(states, heights, strict=True):
        mujoco.mj_resetData(model, data)
        data.qpos[2] += height
        mujoco.mj_getState(model, data, state, kind)
    allowed = allowed_rebounds(train, heights, contact.gravity)
    reader = DropReader(contact.timestep, contact.gravity, allowed, speed_reading(model))
    for _ in range(math.ceil(LASTS / _CHUNK_S)):
        path, _ = mujoco.rollout.rollout(
            model, [data], states, nstep=math.ceil(_CHUNK_S / contact.timestep)
        )
        reader.add(contact.radius - path[:, :, 3], -path[:, :, 1 + model.nq + 2])
        states = path[:, -1].copy()
    return reader.bounces


def rest_on_slope(contact: Contact, options: Stepping, degrees: float = 10.0) -> Rest:
    """Rest of a ball that may not turn on a slope, held by friction: its drift, depth and force."""
    slides = ""
    for axis in ("1 0 0", "0 1 0", "0 0 1"):
        slides += f'<joint type="slide" axis="{axis}"/>'
    model = contact.with_ball(options, slides)
    angle = math.radians(degrees)
    model.opt.gravity[:] = contact.gravity * np.array([math.sin(angle), 0.0, -math.cos(angle)])
    return _rest(model, _SLOPE_S)


def _rest(model: Any, seconds: float) -> Rest:
    """Rest of the first body of a model over the last half of some time, from its start at qpos0.

    Depth is how far it sinks below the start, m; its drift is along x and y.
    """
    mujoco = backend()
    data = mujoco.MjData(model)
    force = np.zeros(6)
    start = data.qpos[:3].copy()
    # Displacement (3) m, rise m/s, force N of each step.
    path = np.empty((round(seconds / model.opt.timestep), 5))
    for row in path:
        row[:3] = data.qpos[:3] - start
        row[3] = data.qvel[2]
        mujoco.mj_step(model, data)
        row[4] = 0.0
        for contact in range(data.ncon):
            mujoco.mj_contactForce(model, data, contact, force)
            row[4] += force[0]
    time = last_half(np.arange(len(path)) * model.opt.timestep)
    path = last_half(path)
    return rest_of(time, -path[:, 2], -path[:, 3], path[:, 4], path[:, :2])


def box_growth(contact: Contact, options: Stepping, attitude: str, speed: float) -> float:
    """Largest ratio of a box's energy in a flight to that in an
    earlier one: above 1 it gained some; infinite where it diverged.

    attitude: a key of _ATTITUDES. speed: downwards at touch, m/s.
    """
    model, (quaternion, high) = contact.with_boxes(options), _ATTITUDES[attitude]
    data = backend().MjData(model)
    data.qpos[2:7] = HALF * high + 2.4 * contact.timestep * speed, *quaternion
    data.qvel[2] = -speed
    return _growth(model, data, min(_BOX_S, _BOX_STEPS * contact.timestep))


def _growth(model: Any, data: Any, seconds: float) -> float:
    """The largest energy of a later flight of the first body over that of an earlier one.

    data: MjData at the start, in flight; stepped for so many seconds. Flights slower than
    _SLOWEST g h count as that fast. Infinite where the state is not finite at the end.
    """
    mujoco = backend()
    g = -model.opt.gravity[2]
    h = model.opt.timestep
    # A semi-implicit step leaves the speed of its middle; RK4 that of its end.
    is_rk4 = model.opt.integrator == int(mujoco.mjtIntegrator.mjINT_RK4)
    # Speed gained by gravity since then, m/s.
    gained = 0.0 if is_rk4 else g * h / 2
    slowest = (_SLOWEST * g * h) ** 2 / 2
    inertia = model.body_inertia[1] / model.body_mass[1]
    steps = round(seconds / h)
    # Of each state: the number of contacts in the step that led there, qvel, and height.
    # Ten thousands of steps are taken here: what is computed from them waits for the end.
    contacts = np.empty(steps, dtype=int)
    speeds = np.empty((steps, 6))
    heights = np.empty(steps)
    motion = data.qvel[:6]
    place = data.qpos
    step = mujoco.mj_step
    for k in range(steps):
        contacts[k] = data.ncon
        speeds[k] = motion
        heights[k] = place[2]
        step(model, data)
    if not np.isfinite(data.qpos).all():
        return math.inf
    free = contacts == 0
    v = speeds[free, :3] - np.array([0.0, 0.0, gained])
    # J/kg.
    energy = ((v**2).sum(axis=1) + speeds[free, 3:] ** 2 @ inertia) / 2 + g * (heights[free] - HALF)
    least = np.fmin.accumulate(energy)[:-1]
    return float(np.fmax.reduce(energy[1:] / np.maximum(least, slowest), initial=0.0))


def boxes(contact: Contact, options: Stepping) -> Iterator[Finding]:
    """Boxes that fall on face, edge and vertex."""
    for attitude, speed in itertools.product(_ATTITUDES, _BOX_SPEEDS):
        grew = box_growth(contact, options, attitude, speed)
        yield Finding(
            f"box on {attitude} at {speed:g} m/s", str(options), grew, MOST_ENERGY, "x energy"
        )


def certify(
    contact: Contact, slides: bool, runs: Sequence[Stepping], train: LongestTrain | None = None
) -> Passivity:
    """Run the whole gate under each of the options, and join what it finds.

    slides: true for a contact whose friction holds a ball on a slope.
    runs: options, one or more.
    train: the longest train of bounces that the target allows; None: none.
    """
    bounces = Bounces(0.0, 0.0, 0, 0)
    findings: list[Finding] = []
    sliding: list[Finding] = []
    is_flat = True
    drift = math.nan
    for options in runs:
        name = str(options)
        dropped = drops(contact, options, train=train)
        bounces = bounces.joined(dropped)
        findings.append(Finding("40 drops: largest e", name, dropped.max_e, MOST_E))
        findings.append(Finding("40 drops: bounce on", name, dropped.still_bouncing, 0))
        if slides:
            rest = rest_on_slope(contact, options)
            if math.isnan(drift):
                drift = rest.drift
            drift = max(drift, rest.drift)
            findings.append(Finding("drift on a slope", name, rest.drift, MOST_DRIFT, "m/s"))
        findings.append(
            Finding("rolling ball", name, _rolling(contact, options), _KEPT, "x energy")
        )
        of_boxes = [*boxes(contact, options), _stack(contact, options)]
        if contact.friction:
            of_ball = ball_slides(contact, options)
            sliding += of_ball
            findings += of_ball
            of_boxes += boxes_slide(contact, options)
        is_flat = is_flat and all(finding.passed for finding in of_boxes)
        findings += of_boxes
    return Passivity(bounces, is_flat, drift, tuple(findings), sliding=tuple(sliding))


def _rolling(contact: Contact, options: Stepping) -> float:
    """Kinetic energy of a ball that rolls for _ROLL_S, at the end over that at the start."""
    model = contact.with_ball(options)
    data = backend().MjData(model)
    data.qvel[0], data.qvel[4] = _ROLLS, _ROLLS / contact.radius
    start = _kinetic(model, data)
    for _ in range(round(_ROLL_S / contact.timestep)):
        backend().mj_step(model, data)
    return _kinetic(model, data) / start


def _kinetic(model: Any, data: Any) -> float:
    v = data.qvel[:3]
    w = data.qvel[3:6]
    return float(model.body_mass[1] * v @ v + model.body_inertia[1] @ w**2) / 2


def _stack(contact: Contact, options: Stepping) -> Finding:
    """Depth of the lowest of three boxes after a while; infinite if they do not lie still."""
    model = contact.with_boxes(options, 3)
    rest = _rest(model, _STACK_S)
    deep = rest.penetration if not rest.failures(1.0, 1.0) else math.inf
    return Finding("stack of three: depth", str(options), deep, _SINKS * contact.timestep, "m")
