"""A contact tried in plain models of MuJoCo: drops, a slope, boxes that fall, a stack, and bodies that
slide, spin and roll; `certify` runs them all, under each of several options.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import speed_reading
from hcbench.engines.mujoco.model.simulation import follow_in_c
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
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from hcbench.terms.impact import Floats
    from hcbench.terms.setting import Pair

# Half an edge of a box, m.
HALF = 0.05
# Places in the qpos of a free joint, and in its qvel; z is in both.
_PLACE = slice(0, 3)
_QUATERNION = slice(3, 7)
_LINEAR = slice(0, 3)
_SPIN = slice(3, 6)
_Z = 2


@dataclass(frozen=True, slots=True)
class Stepping:
    """Options under which a plain model is simulated."""

    integrator: str = "Euler"
    cone: str = "elliptic"
    solver: str = "Newton"

    def __str__(self) -> str:
        return f"{self.integrator}, {self.cone}, {self.solver}"


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact that is tried in plain models.

    timestep: s.
    option: attributes of <option> that it asks for.
    text: what to paste for pairs of geoms.
    gravity: m/s², of drops, slopes, boxes and what is laid down: the standard one where the scene
    has none.
    radius: of the ball, m.
    falls: gravity of the scene, m/s², under which what slides is thrown.
    friction: Coulomb's μ of the two geoms.
    """

    timestep: float
    gravity: float
    option: Mapping[str, str]
    text: Callable[[Sequence[Pair]], str]
    radius: float
    falls: float = 0.0
    friction: float = 0.0

    def model(self, bodies: str, options: Stepping, pairs: Sequence[Pair]) -> Any:
        """Compile a model of a plane and some bodies, of which some pairs have this contact.

        bodies: <body> elements of MJCF.
        options: of the model; the contact's own `option` goes before their cone and solver and
        before `timestep`, but not before their integrator.
        pairs: names of two geoms each; the plane's is "plate".
        Raises ValueError for wrong MJCF.
        """
        plain = {"timestep": repr(self.timestep), "cone": options.cone, "solver": options.solver}
        option = " ".join(f'{key}="{value}"' for key, value in {**plain, **self.option}.items())
        # In an <option> of its own, which comes later and so goes before the contact's.
        integrator = f'integrator="{options.integrator}" gravity="0 0 {-self.gravity!r}"'
        return backend().MjModel.from_xml_string(
            f"<mujoco><option {option}/><option {integrator}/><worldbody>"
            f'<geom name="plate" type="plane" size="9 9 1"/>{bodies}</worldbody>'
            f"{self.text(pairs)}</mujoco>"
        )

    def with_ball(self, options: Stepping, joint: str = "<freejoint/>") -> Any:
        """A plain model of a ball on the plane."""
        shape = f'type="sphere" size="{self.radius!r}" mass="0.5"'
        place = f'name="ball" pos="0 0 {self.radius!r}"'
        body = f'<body {place}>{joint}<geom name="ball" {shape}/></body>'
        return self.model(body, options, [("ball", "plate")])

    def with_boxes(self, options: Stepping, count: int = 1) -> Any:
        """Compile a model of boxes of edge 2 HALF, m, and 0.5 kg, one on top of the other on the
        plane; each meets the next in this contact.

        options: of the model.
        count: of boxes, 1 or more.
        """
        names = [f"box{i}" for i in range(count)]
        bodies = ""
        for i, name in enumerate(names):
            height = (2 * i + 1) * HALF
            bodies += f'<body name="{name}" pos="0 0 {height!r}"><freejoint/>'
            bodies += (
                f'<geom name="{name}" type="box" size="{HALF} {HALF} {HALF}" mass="0.5"/></body>'
            )
        return self.model(bodies, options, list(itertools.pairwise(["plate", *names])))


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
_CREEP_S = 2.0
_STEPS = 2000
# A body that was laid down stays down. It may rise by what it falls in a step from rest, g h², of
# which the first step of a contact knows nothing, and by this, m.
_RISES = 1e-6
# Angle of a slope, rad, and how far friction has to be above its tangent to hold a body.
_CREEP_SLOPE = math.radians(5.0)
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


def boxes_slide(contact: Contact, options: Stepping) -> Iterator[Finding]:
    """Findings for a box on its face and on an edge, and for a capsule on its side."""
    for body in _BOXES:
        yield from _findings(contact, options, body)


def _findings(contact: Contact, options: Stepping, body: _ThrownBody) -> Iterator[Finding]:
    """Yield findings for one body in a contact: the largest growth of energy in throws; and, for a
    body that can lie still, how high it hops as it is laid down sliding, spinning or rolling, and
    how fast it creeps on a slope, if friction is enough to hold it there.

    options: under which it is simulated.
    """
    under = str(options)
    grew = 0.0
    model = _model(contact, options, body)
    model.opt.gravity[2] = -contact.falls
    for speed, (slip, spin) in product(_THROWS, _MOTIONS):
        velocity = (*slip, -speed, *spin)
        # It touches after some steps of flight, within one.
        above = 2.4 * contact.timestep * speed
        path = _followed(model, body, velocity, _THROWN_S, above)
        grew = max(grew, path.grew)
    throws = len(_THROWS) * len(_MOTIONS)
    yield Finding(
        name=f"energy of a {body.name}, thrown",
        under=under,
        value=grew,
        limit=MOST_ENERGY,
        unit="x energy",
        tried=throws,
    )
    if not body.lies:
        return
    # Velocity, m/s, and spin, rad/s, of a body that is laid down, by how it moves.
    laid = {"sliding": (_SLIDES, 0, 0, 0, 0, 0), "spinning": (0, 0, 0, *_upright_spin(body))}
    if body.axle:
        # Without slip: the spin times the height is the speed.
        rolls = np.array(body.axle) * _SLIDES / body.high
        laid["rolling"] = (_SLIDES, 0.0, 0.0, *rolls)
    model.opt.gravity[2] = -contact.gravity
    for how, velocity in laid.items():
        path = _followed(model, body, velocity, _LAID_S)
        limit = max(_RISES, contact.gravity * contact.timestep**2)
        yield Finding(f"hop of a {body.name}, laid down {how}", under, path.rose, limit, "m")
    if body.along and contact.friction > _HOLDS * math.tan(_CREEP_SLOPE):
        drift = creep(contact, model, body)
        yield Finding(f"creep of a {body.name} on 5 degrees", under, drift, MOST_DRIFT, "m/s")


def _upright_spin(body: _ThrownBody) -> Floats:
    """Spin about the vertical, rad/s, in the body's own frame, (3,)."""
    turn = np.zeros(9)
    backend().mju_quat2Mat(turn, np.array(body.quaternion))
    spin: Floats = turn.reshape(3, 3).T @ np.array([0.0, 0.0, _SPINS])
    return spin


def _model(contact: Contact, options: Stepping, body: _ThrownBody) -> Any:
    geom = f'<geom name="ball" {body.shape} mass="{_MASS}" friction="{contact.friction!r}"/>'
    place = f'name="ball" pos="0 0 {body.high!r}"'
    return contact.model(f"<body {place}><freejoint/>{geom}</body>", options, [("ball", "plate")])


@dataclass(slots=True)
class _Path:
    """Energy of a body after its contacts over that before them, largest; and how far it rose, m."""

    grew: float
    rose: float


def _followed(
    model: Any, body: _ThrownBody, velocity: tuple[float, ...], seconds: float, above: float = 0.0
) -> _Path:
    """Let a body go, and return by which factor contacts made its energy grow at most, and how far it
    rose, m; both infinite where the state is not finite at the end.

    In free flight MuJoCo turns a body other than a ball with an error of its own: so only changes
    by contacts count.
    velocity: (6,), m/s and, in its own frame, rad/s.
    seconds: to simulate, or _STEPS steps if that is less.
    above: height of the start over the touch, m.
    """
    data = backend().MjData(model)
    data.qpos[_Z] += above
    data.qpos[_QUATERNION] = body.quaternion
    data.qvel[:] = velocity
    g = -model.opt.gravity[_Z]
    h = model.opt.timestep
    # About the main axes over the mass, m²: the body is the first after the world.
    inertia = model.body_inertia[1] / model.body_mass[1]
    # Kinetic energy at the start, J/kg.
    began = (data.qvel[_LINEAR] @ data.qvel[_LINEAR] + inertia @ data.qvel[_SPIN] ** 2) / 2
    # Without gravity a body that a contact has stopped has none to compare with.
    slowest = max((_SLOWEST * g * h) ** 2 / 2, _ROUND_OFF * began)
    start = float(data.qpos[_Z])
    contacts, speeds, heights = _stepped(model, data, min(round(seconds / h), _STEPS))
    if not np.isfinite(data.qpos).all():
        return _Path(math.inf, math.inf)
    # Without contacts the step from a state was free flight.
    free = np.flatnonzero(contacts == 0)
    v = speeds[free, _LINEAR] - np.array([0.0, 0.0, _gained_since(model)])
    turning = speeds[free, _SPIN]
    before = np.concatenate([[start], heights[:-1]])[free]
    # J/kg, of free flight.
    energy = ((v**2).sum(axis=1) + turning**2 @ inertia) / 2 + g * (before - body.high)
    # What the contacts have added since the start. From one state of a flight to the next the energy
    # changes by MuJoCo's own error alone, which is left out.
    added = np.diff(energy, prepend=0.0)
    added[1:][np.diff(free) == 1] = 0.0
    by_contacts = np.cumsum(added)
    # Each energy over the least one before it.
    least_before = np.fmin.accumulate(by_contacts)[:-1]
    ratios = by_contacts[1:] / np.maximum(least_before, slowest)
    grew = np.fmax.reduce(ratios, initial=0.0)
    return _Path(float(grew), float(np.fmax.reduce(heights)) - body.high)


def _stepped(model: Any, data: Any, steps: int) -> tuple[NDArray[np.int32], Floats, Floats]:
    """Step a body on a free joint n times, and record for each of n states the number of contacts in
    the step that led to it, (n,), its velocity qvel, (n, 6), and the height of the body after the
    step from it, m, (n,).

    data: MjData; moved on.
    steps: n. Hundred thousands of steps are taken here: what is computed from them waits for the
    end.
    """
    contacts = np.empty(steps, dtype=np.int32)
    speeds = np.empty((steps, 6))
    heights = np.empty(steps)
    if follow_in_c(model, data, contacts, speeds, heights):
        return contacts, speeds, heights
    # Views of the state.
    place = data.qpos
    motion = data.qvel
    step = backend().mj_step
    for k in range(steps):
        contacts[k] = data.ncon
        speeds[k] = motion
        step(model, data)
        heights[k] = place[_Z]
    return contacts, speeds, heights


def _gained_since(model: Any) -> float:
    """Speed that gravity has given since the moment of a state's velocity, m/s downwards.

    A semi-implicit step leaves the speed of its middle; RK4 that of its end.
    """
    is_rk4 = model.opt.integrator == int(backend().mjtIntegrator.mjINT_RK4)
    return 0.0 if is_rk4 else -model.opt.gravity[_Z] * model.opt.timestep / 2


def creep(contact: Contact, model: Any, body: _ThrownBody) -> float:
    """Speed of a body down a slope of 5 degrees, m/s, over the last quarter of the time.

    It starts at rest, in the attitude in which it does not roll down. Infinite where it diverged.

    model: of the body on the plate, whose gravity is turned.
    """
    data = backend().MjData(model)
    data.qpos[_QUATERNION] = body.along
    model.opt.gravity[:] = contact.gravity * np.array(
        [math.sin(_CREEP_SLOPE), 0.0, -math.cos(_CREEP_SLOPE)]
    )
    steps = min(round(_CREEP_S / contact.timestep), 2 * _STEPS)
    last = steps // 4
    # Until then it settles. Down the slope is along x, the first number of qpos.
    backend().mj_step(model, data, nstep=steps - last)
    start = float(data.qpos[0])
    backend().mj_step(model, data, nstep=last)
    drift = (float(data.qpos[0]) - start) / (last * contact.timestep)
    return abs(drift) if math.isfinite(drift) else math.inf


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
    """Drop balls in a plain model from heights, m, simulate them for LASTS s, and read how they
    bounce.

    options: of the model.
    train: the longest train of bounces that the target allows; None: none.
    """
    mujoco = backend()
    model = contact.with_ball(options)
    data = mujoco.MjData(model)
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    # MuJoCo's full states of all balls, (balls, nstate): first those of the drops' start.
    states = np.empty((len(heights), mujoco.mj_stateSize(model, kind)))
    for state, height in zip(states, heights, strict=True):
        mujoco.mj_resetData(model, data)
        data.qpos[_Z] += height
        mujoco.mj_getState(model, data, state, kind)
    # How often a ball of each height may bounce.
    allowed = allowed_rebounds(train, heights, contact.gravity)
    reader = DropReader(contact.timestep, contact.gravity, allowed, speed_reading(model))
    for _ in range(math.ceil(LASTS / _CHUNK_S)):
        path, _ = mujoco.rollout.rollout(
            model, [data], states, nstep=math.ceil(_CHUNK_S / contact.timestep)
        )
        # A state has the time before qpos and qvel. Of each ball after each step, (balls, n):
        height = path[:, :, 1 + _Z]
        rising = path[:, :, 1 + model.nq + _Z]
        reader.add(contact.radius - height, -rising)
        states = path[:, -1].copy()
    return reader.bounces


def rest_on_slope(contact: Contact, options: Stepping, degrees: float = 10.0) -> Rest:
    """Let a ball that may not turn rest on a slope, held by friction: its drift, m/s, depth, m, and
    vibration.

    options: of the plain model.
    degrees: angle of the slope; gravity is turned by it.
    """
    slides = ""
    for axis in ("1 0 0", "0 1 0", "0 0 1"):
        slides += f'<joint type="slide" axis="{axis}"/>'
    model = contact.with_ball(options, slides)
    angle = math.radians(degrees)
    model.opt.gravity[:] = contact.gravity * np.array([math.sin(angle), 0.0, -math.cos(angle)])
    return _rest(model, _SLOPE_S)


def _rest(model: Any, seconds: float) -> Rest:
    """Let the first body of a model rest, from its start at qpos0, and measure the last quarter of
    `seconds`: penetration, by how far it sinks below the start, m, and drift along x and y, m/s. The
    quarter before it tells how vibration decays.
    """
    mujoco = backend()
    data = mujoco.MjData(model)
    # A contact's force along its normal, N, and what else it transfers.
    wrench = np.zeros(6)
    start = data.qpos[_PLACE].copy()
    steps = round(seconds / model.opt.timestep)
    # Of each step: way from the start, m, speed upwards, m/s, and force of all contacts, N.
    moved = np.empty((steps, 3))
    rising = np.empty(steps)
    force = np.zeros(steps)
    for i in range(steps):
        moved[i] = data.qpos[_PLACE] - start
        rising[i] = data.qvel[_Z]
        mujoco.mj_step(model, data)
        for contact in range(data.ncon):
            mujoco.mj_contactForce(model, data, contact, wrench)
            force[i] += wrench[0]
    time = np.arange(steps) * model.opt.timestep
    return rest_of(
        time=last_half(time),
        penetration=-last_half(moved[:, _Z]),
        rate=-last_half(rising),
        force=last_half(force),
        along=last_half(moved[:, :_Z]),
    )


def box_growth(model: Any, attitude: str, speed: float) -> float:
    """Throw a box on the plate, and return the largest ratio of its energy in a flight to that in an
    earlier one: above 1 it gained energy; infinite where it diverged.

    model: of one box.
    attitude: a key of _ATTITUDES.
    speed: downwards at touch, m/s; the box starts 2.4 steps before the touch.
    """
    timestep = float(model.opt.timestep)
    quaternion, high = _ATTITUDES[attitude]
    data = backend().MjData(model)
    data.qpos[_Z] = HALF * high + 2.4 * timestep * speed
    data.qpos[_QUATERNION] = quaternion
    data.qvel[_Z] = -speed
    return _growth(model, data, min(_BOX_S, _BOX_STEPS * timestep))


def _growth(model: Any, data: Any, seconds: float) -> float:
    """Largest ratio of the energy of a body in a flight to that in an earlier flight; infinite where
    the state is not finite at the end.

    model: of one body on a free joint.
    data: MjData at the start, in flight; stepped for `seconds`. Flights with less energy than that
    of the speed _SLOWEST g h count as that fast.
    """
    g = -model.opt.gravity[_Z]
    h = model.opt.timestep
    # J/kg, and m² about the main axes of the body, which is the first after the world.
    slowest = (_SLOWEST * g * h) ** 2 / 2
    inertia = model.body_inertia[1] / model.body_mass[1]
    start = float(data.qpos[_Z])
    contacts, speeds, later = _stepped(model, data, round(seconds / h))
    heights = np.concatenate([[start], later[:-1]])
    if not np.isfinite(data.qpos).all():
        return math.inf
    # Without contacts the step from a state was free flight.
    free = contacts == 0
    v = speeds[free, _LINEAR] - np.array([0.0, 0.0, _gained_since(model)])
    turning = speeds[free, _SPIN]
    # J/kg, over that of a box at rest on its face.
    energy = ((v**2).sum(axis=1) + turning**2 @ inertia) / 2 + g * (heights[free] - HALF)
    # Each energy over the least one before it.
    least_before = np.fmin.accumulate(energy)[:-1]
    return float(np.fmax.reduce(energy[1:] / np.maximum(least_before, slowest), initial=0.0))


def boxes(contact: Contact, options: Stepping) -> Iterator[Finding]:
    """Yield a finding for each box that falls on its face, an edge or a vertex, at each speed: by
    which factor its energy grew at most, against the factor that is allowed.

    contact: of the box with the plane.
    options: of the plain model.
    """
    model = contact.with_boxes(options)
    for attitude, speed in itertools.product(_ATTITUDES, _BOX_SPEEDS):
        grew = box_growth(model, attitude, speed)
        name = f"box on {attitude} at {speed:g} m/s"
        yield Finding(name, str(options), grew, MOST_ENERGY, "x energy")


def certify(
    contact: Contact, slides: bool, runs: Sequence[Stepping], train: LongestTrain | None = None
) -> Passivity:
    """Run all tests of a contact under each of several options, and join what they find: drops, a
    ball on a slope and rolling, boxes that fall, a stack, and bodies that slide and spin.

    slides: true for a contact whose friction holds a ball on a slope.
    runs: options, one or more.
    train: the longest train of bounces that the target allows; None: none.
    """
    bounces = Bounces(max_e=0.0, gains_below=0.0, still_bouncing=0, tried=0)
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
        # Flat bodies pass under every option, or the contact is for round ones alone.
        is_flat = is_flat and all(finding.passed for finding in of_boxes)
        findings += of_boxes
    return Passivity(bounces, is_flat, drift, tuple(findings), sliding=tuple(sliding))


def _rolling(contact: Contact, options: Stepping) -> float:
    """Let a ball roll for _ROLL_S s, and return its kinetic energy at the end over that at the start.

    contact: of the ball with the plane.
    options: of the plain model.
    """
    model = contact.with_ball(options)
    data = backend().MjData(model)
    data.qvel[0] = _ROLLS
    # Rolling without slip along x turns a ball about y.
    data.qvel[4] = _ROLLS / contact.radius
    start = _kinetic(model, data)
    for _ in range(round(_ROLL_S / contact.timestep)):
        backend().mj_step(model, data)
    return _kinetic(model, data) / start


def _kinetic(model: Any, data: Any) -> float:
    """Kinetic energy of the only body of a model, J."""
    v = data.qvel[_LINEAR]
    w = data.qvel[_SPIN]
    return float(model.body_mass[1] * v @ v + model.body_inertia[1] @ w**2) / 2


def _stack(contact: Contact, options: Stepping) -> Finding:
    """Depth of the lowest of three boxes after a while; infinite if they do not lie still."""
    model = contact.with_boxes(options, 3)
    rest = _rest(model, _STACK_S)
    deep = rest.penetration if not rest.failures(1.0, 1.0) else math.inf
    return Finding("stack of three: depth", str(options), deep, _SINKS * contact.timestep, "m")
