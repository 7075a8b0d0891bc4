"""Bodies that slide, spin and roll on a contact with friction, in plain MuJoCo: energy, hops,
creep.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.sim.passivity import MOST_DRIFT, MOST_ENERGY, Finding

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.engines.mujoco.passivity.contact import Contact, Stepping
    from hcbench.terms.impact import Floats

# Speeds of throws at touch, m/s.
_THROWS = (0.1, 0.5, 1.5)
# (speed along the plate m/s, spin rad/s) of throws: slow and fast slides, backspin, topspin, and
# all at once.
_MOTIONS = (
    ((0.5, 0.0), (0.0, 0.0, 0.0)),
    ((2.0, 0.0), (0.0, 0.0, 0.0)),
    ((0.0, 0.0), (0.0, 30.0, 0.0)),
    ((1.0, 0.0), (0.0, -30.0, 20.0)),
    ((0.7, 0.3), (10.0, 5.0, 20.0)),
)
# Speed of what is laid down sliding or rolling, m/s, and spin of what is laid down spinning, rad/s.
_SLIDES = 1.0
_SPINS = 30.0
# Times for which a body is followed, s, and the steps of each at most.
_THROWN_S = 0.5
_LAID_S = 1.0
_SLOPE_S = 2.0
_STEPS = 2000
# A body that was laid down stays down. It may rise by what it falls in a step from rest, g h², of
# which the first step of a contact knows nothing, and by this, m.
_RISES = 1e-6
# Angle of a slope, rad, and how far friction has to be above its tangent to hold a body.
_SLOPE = math.radians(5.0)
_HOLDS = 1.1
# In g h: slower flights have too little energy to matter.
_SLOWEST = 1.6
# Share of the energy at the start that is none.
_ROUND_OFF = 1e-12
_MASS = 0.5


@dataclass(frozen=True, slots=True)
class _ThrownBody:
    """A body on the plate.

    name: in findings.
    shape: attributes of its geom.
    high: height of its centre where it touches, m.
    quaternion: of its attitude.
    lies: whether it lies still there; one on an edge is only thrown.
    axle: axis about which it rolls, in its own frame; () where it does not roll.
    along: attitude in which it does not roll down a slope; () for a body that rolls in any.
    """

    name: str
    shape: str
    high: float
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    lies: bool = True
    axle: tuple[float, ...] = ()
    along: tuple[float, ...] = ()


_HALF_SLAB = (0.06, 0.06, 0.02)
_TILT = 0.7
_FLAT = (1.0, 0.0, 0.0, 0.0)
# A turn of 90 degrees about x lays a capsule along y, one about y along x.
_ALONG_Y = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
_ALONG_X = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
_SLAB = f'type="box" size="{" ".join(map(str, _HALF_SLAB))}"'
# Flat, so that friction does not tip it over.
_BOXES = (
    _ThrownBody("box on its face", _SLAB, _HALF_SLAB[2], along=_FLAT),
    _ThrownBody(
        "box on an edge",
        _SLAB,
        _HALF_SLAB[0] * math.sin(_TILT) + _HALF_SLAB[2] * math.cos(_TILT),
        (math.cos(_TILT / 2), 0.0, math.sin(_TILT / 2), 0.0),
        lies=False,
    ),
    _ThrownBody(
        "capsule",
        'type="capsule" size="0.03 0.05"',
        0.03,
        _ALONG_Y,
        # Its own z points along -y.
        axle=(0.0, 0.0, -1.0),
        along=_ALONG_X,
    ),
)


def ball_slides(contact: Contact, options: Stepping) -> list[Finding]:
    """Findings for a ball that slides, spins and rolls."""
    shape = f'type="sphere" size="{contact.radius!r}"'
    ball = _ThrownBody("ball", shape, contact.radius, axle=(0.0, 1.0, 0.0))
    return list(_findings(contact, options, ball))


def boxes_slide(contact: Contact, options: Stepping) -> list[Finding]:
    """Findings for a box on its face and on an edge, and for a capsule on its side."""
    return [finding for body in _BOXES for finding in _findings(contact, options, body)]


def _findings(contact: Contact, options: Stepping, body: _ThrownBody) -> Iterator[Finding]:
    """Findings for one body: energy of throws; of a body that lies, hops where it slides, spins or
    rolls, and creep on a slope if friction is enough to hold it.
    """
    under = str(options)
    grew = 0.0
    thrown = _model(contact, options, body, contact.falls)
    for speed, (slip, spin) in product(_THROWS, _MOTIONS):
        velocity = (*slip, -speed, *spin)
        path = _followed(thrown, body, velocity, _THROWN_S, 2.4 * contact.timestep * speed)
        grew = max(grew, path.grew)
    throws = len(_THROWS) * len(_MOTIONS)
    yield Finding(f"energy of a {body.name}, thrown", under, grew, MOST_ENERGY, "x energy", throws)
    if not body.lies:
        return
    laid = {"sliding": (_SLIDES, 0, 0, 0, 0, 0), "spinning": (0, 0, 0, *_upright_spin(body))}
    if body.axle:
        rolls = np.array(body.axle) * _SLIDES / body.high
        laid["rolling"] = (_SLIDES, 0.0, 0.0, *rolls)
    lying = _model(contact, options, body, contact.gravity)
    for how, velocity in laid.items():
        path = _followed(lying, body, velocity, _LAID_S)
        limit = max(_RISES, contact.gravity * contact.timestep**2)
        yield Finding(f"hop of a {body.name}, laid down {how}", under, path.rose, limit, "m")
    if body.along and contact.friction > _HOLDS * math.tan(_SLOPE):
        drift = creep(contact, options, body)
        yield Finding(f"creep of a {body.name} on 5 degrees", under, drift, MOST_DRIFT, "m/s")


def _upright_spin(body: _ThrownBody) -> Floats:
    """Spin about the vertical, rad/s, in the body's own frame, (3,)."""
    turn = np.zeros(9)
    backend().mju_quat2Mat(turn, np.array(body.quaternion))
    spin: Floats = turn.reshape(3, 3).T @ np.array([0.0, 0.0, _SPINS])
    return spin


def _model(contact: Contact, options: Stepping, body: _ThrownBody, gravity: float) -> Any:
    geom = f'<geom name="ball" {body.shape} mass="{_MASS}" friction="{contact.friction!r}"/>'
    place = f'name="ball" pos="0 0 {body.high!r}"'
    model = contact.model(f"<body {place}><freejoint/>{geom}</body>", options, [("ball", "plate")])
    model.opt.gravity[2] = -gravity
    return model


@dataclass(slots=True)
class _Path:
    """Energy of a body after its contacts over that before them, largest; and how far it rose, m."""

    grew: float
    rose: float


def _followed(
    model: Any, body: _ThrownBody, velocity: tuple[float, ...], seconds: float, above: float = 0.0
) -> _Path:
    """Let a body go and compare its energy before and after each contact.

    In free flight MuJoCo turns a body other than a ball with an error of its own: so only contacts
    count.

    velocity: (6,), m/s and, in its own frame, rad/s.
    seconds: followed for so long, or _STEPS steps if that is less.
    above: start over the touch, m.

    Both numbers are infinite where the state is not finite at the end.
    """
    mujoco = backend()
    data = mujoco.MjData(model)
    data.qpos[2] += above
    data.qpos[3:7] = body.quaternion
    data.qvel[:] = velocity
    g = -model.opt.gravity[2]
    h = model.opt.timestep
    is_rk4 = model.opt.integrator == int(mujoco.mjtIntegrator.mjINT_RK4)
    # A semi-implicit step leaves the speed of its middle; RK4 that of its end.
    gained = 0.0 if is_rk4 else g * h / 2
    inertia = model.body_inertia[1] / model.body_mass[1]
    began = (data.qvel[:3] @ data.qvel[:3] + inertia @ data.qvel[3:] ** 2) / 2
    # Without gravity a body that a contact has stopped has none to compare with.
    slowest = max((_SLOWEST * g * h) ** 2 / 2, _ROUND_OFF * began)
    steps = min(round(seconds / h), _STEPS)
    # Of each state: the number of contacts in the step that led there, and qvel; height at its end.
    # Hundred thousands of steps are taken here: what is computed from them waits for the end.
    contacts = np.empty(steps, dtype=int)
    speeds = np.empty((steps, 6))
    heights = np.empty(steps)
    place = data.qpos
    motion = data.qvel
    step = mujoco.mj_step
    start = float(place[2])
    for k in range(steps):
        contacts[k] = data.ncon
        speeds[k] = motion
        step(model, data)
        heights[k] = place[2]
    if not np.isfinite(data.qpos).all():
        return _Path(math.inf, math.inf)
    # Without contacts the step from a state was free flight.
    free = np.flatnonzero(contacts == 0)
    v = speeds[free, :3] - np.array([0.0, 0.0, gained])
    turning = speeds[free, 3:]
    before = np.concatenate([[start], heights[:-1]])[free]
    # J/kg, of free flight.
    energy = ((v**2).sum(axis=1) + turning**2 @ inertia) / 2 + g * (before - body.high)
    # What the contacts have added since the start: in free flight it stays.
    added = np.diff(energy, prepend=0.0)
    added[1:][np.diff(free) == 1] = 0.0
    since = np.cumsum(added)
    least = np.fmin.accumulate(since)[:-1]
    grew = np.fmax.reduce(since[1:] / np.maximum(least, slowest), initial=0.0)
    return _Path(float(grew), float(np.fmax.reduce(heights)) - body.high)


def creep(contact: Contact, options: Stepping, body: _ThrownBody) -> float:
    """Speed of a body down a slope of 5 degrees, m/s, over the last quarter of the time.

    It starts at rest, in the attitude in which it does not roll down. Infinite where it diverged.
    """
    model = _model(contact, options, body, contact.gravity)
    data = backend().MjData(model)
    data.qpos[3:7] = body.along
    model.opt.gravity[:] = contact.gravity * np.array([math.sin(_SLOPE), 0.0, -math.cos(_SLOPE)])
    steps = min(round(_SLOPE_S / contact.timestep), 2 * _STEPS)
    last = steps // 4
    backend().mj_step(model, data, nstep=steps - last)
    start = float(data.qpos[0])
    backend().mj_step(model, data, nstep=last)
    drift = (float(data.qpos[0]) - start) / (last * contact.timestep)
    return abs(drift) if math.isfinite(drift) else math.inf
