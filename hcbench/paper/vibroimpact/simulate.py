"""Simulates a mass between two blocks: its motion, its events and its energy balance."""

import math

import numpy as np

from hcbench.laws.force import ForceLaw, HuntCrossley
from hcbench.laws.require import positive, require
from hcbench.paper.vibroimpact.batched_ode import integrate
from hcbench.paper.vibroimpact.dynamics import (
    APART,
    CONTACT,
    PULLED_OFF,
    SIGNS,
    Flags,
    Indices,
    Modes,
    TwoSidedContact,
)
from hcbench.paper.vibroimpact.system import (
    Drive,
    Event,
    Kind,
    Side,
    SimulatedMotion,
    Sinusoid,
    VibroImpact,
    pressing,
    stored,
)
from hcbench.system.errors import HcbenchError, UserError
from hcbench.terms.impact import Floats

SIDES: tuple[Side, Side] = ("right", "left")
_KINDS: dict[tuple[int, int], Kind] = {
    (APART, CONTACT): "touch",
    (CONTACT, APART): "part",
    (PULLED_OFF, APART): "part",
    (CONTACT, PULLED_OFF): "release",
    (PULLED_OFF, CONTACT): "press",
}
# Largest force, N: the square of a larger one overflows.
_STRONGEST = 1e100


def simulate(
    system: VibroImpact,
    position: float,
    velocity: float,
    until: float,
    drive: Drive | None = None,
    *,
    tolerance: float = 1e-11,
    step_max: float = math.inf,
) -> SimulatedMotion:
    """The motion from q = position (m), q' = velocity (m/s), t = 0 to
    `until` (s); free without a drive.

    drive: P in N over t in s, a `Sinusoid` or any smooth function (a rough one needs `step_max`,
    s).
    tolerance: error of a step over the size of the motion.

    Raises UserError for numbers that are not finite, from the caller or from the drive.
    """
    for slot, value, unit in (("position", position, "m"), ("velocity", velocity, "m/s")):
        require(slot, value, math.isfinite(value), f"a finite number in {unit}")
    positive("until", until, "s")
    require(
        "tolerance", tolerance, 1e-15 <= tolerance <= 1e-2, "1e-15 ... 1e-2 of the motion's size"
    )
    require("step_max", step_max, step_max > 0.0, "a step above 0 s")
    length, speed = motion_size(system, position, velocity, _largest(drive, until), drive)
    contact = TwoSidedContact(
        laws=(system.right, system.left),
        mass=system.mass,
        half_gap=np.array([system.gap / 2.0]),
        drive=lambda t, _: _force_of(drive, t),
        length=np.array([length]),
        speed=np.array([speed]),
        tolerance=tolerance,
        energy_balance=True,
    )
    if isinstance(drive, Sinusoid):
        step_max = min(step_max, 0.1 / drive.frequency)
    start = np.array([position, velocity, 0.0, 0.0])
    times = [0.0]
    states = [start]
    events = []

    def record(_: Indices, t: Floats, y: Floats, before: Modes, after: Modes, __: Flags) -> None:
        times.append(float(t[0]))
        states.append(y[:, 0].copy())
        for side, (sign,) in enumerate(SIGNS.tolist()):
            kind = _KINDS.get((int(before[side, 0]), int(after[side, 0])))
            if kind is not None:
                events.append(Event(times[-1], SIDES[side], kind, sign * float(y[1, 0])))

    integrate(contact, start[:, None], np.array([[until]]), np.array([step_max]), record)
    return _motion_of(system, np.array(times), np.array(states), tuple(events))


def _motion_of(
    system: VibroImpact, times: Floats, states: Floats, events: tuple[Event, ...]
) -> SimulatedMotion:
    """The motion with its forces, N, and energies, J.

    times: s, shape (n,).
    states: shape (n, 4): position (m), velocity (m/s), energies lost and put in (J).
    """
    q, v, lost, put_in = states.T
    half = system.gap / 2.0
    energy = np.empty_like(q)
    for i, x in enumerate(q.tolist()):
        energy[i] = stored(system.right, x - half) + stored(system.left, -x - half)
    return SimulatedMotion(
        time=times,
        position=q,
        velocity=v,
        right=pressing(system.right, q - half, v),
        left=pressing(system.left, -q - half, -v),
        kinetic=0.5 * system.mass * v * v,
        stored=energy,
        lost=lost,
        put_in=put_in,
        events=events,
    )


def _force_of(drive: Drive | None, times: Floats) -> Floats:
    """P in N at times (s), same shape; 0 without a drive."""
    if drive is None:
        return np.zeros_like(times)
    return np.array([_checked(drive, float(t)) for t in times])


def _checked(drive: Drive, time: float) -> float:
    """Evaluate P in N at `time` (s); UserError unless it is a finite force."""
    expected = "a finite force, a number in N, at every time"
    try:
        value: object = drive(time)
    except HcbenchError:
        raise
    except Exception as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise UserError("drive", f"raised {what:.200} at t = {time!r} s", expected) from error
    try:
        force = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise UserError("drive", f"gave {value!r} at t = {time!r} s", expected) from None
    if not abs(force) < _STRONGEST:
        raise UserError("drive", f"gave {force!r} N at t = {time!r} s", expected)
    return force


def _largest(drive: Drive | None, until: float) -> float:
    """Largest P, N."""
    if isinstance(drive, Sinusoid):
        return abs(drive.amplitude)
    return float(np.abs(_force_of(drive, np.linspace(0.0, until, 257))).max())


def motion_size(
    system: VibroImpact, position: float, velocity: float, force: float, drive: Drive | None = None
) -> tuple[float, float]:
    """The size of the motion (m, m/s) that errors are measured over, from
    its energy and the largest P (N).

    A depth X and a speed V with F(X, 0) X = m V², about those of an impact;
    for a squeezed mass its swing.
    """
    half = system.gap / 2.0
    squeeze = system.squeeze
    start = 0.5 * system.mass * velocity**2
    for law, x in ((system.right, position - half), (system.left, -position - half)):
        start += max(0.0, stored(law, x) - stored(law, squeeze))
    if squeeze > 0.0:
        stiffness = sum(tangent(law, squeeze)[0] for law in (system.right, system.left))
        energy = start + 0.5 * force**2 / stiffness
        require(
            "start",
            energy,
            energy > 0.0,
            "a motion: a speed, a position off the middle, or a drive",
        )
        return math.sqrt(2.0 * energy / stiffness), math.sqrt(2.0 * energy / system.mass)

    def elastic(x: float) -> float:
        return float(system.right.force(x, 0.0))

    # The energy includes what the drive gives to a free mass.
    if isinstance(drive, Sinusoid):
        energy = start + 0.5 * (force / (2.0 * math.pi * drive.frequency)) ** 2 / system.mass
    else:
        energy = start
        if force:
            energy += force * _solve(elastic, force)
    require(
        "start", energy, energy > 0.0, "a motion: a speed, a position inside a block, or a drive"
    )
    depth = _solve(lambda x: elastic(x) * x, 2.0 * energy)
    return depth, math.sqrt(2.0 * energy / system.mass)


def tangent(law: ForceLaw, depth: float) -> tuple[float, float]:
    """dF/dx (N/m) and dF/dv (N s/m) at rest at `depth` (m).

    n k x^(n-1) and λ x^n of eq. (16); central differences of other laws.
    """
    if isinstance(law, HuntCrossley):
        k, n = law.stiffness, law.exponent
        return n * k * depth ** (n - 1.0), law.dissipation * k * depth**n
    x = depth * np.array([1.0 - 1e-5, 1.0 + 1e-5])
    stiffness = np.diff(law.force(x, 0.0))[0] / np.diff(x)[0]
    # The difference over 2e-6 m/s: near v = 0 these laws are straight lines in v.
    v = np.array([-1e-6, 1e-6])
    damping = np.diff(law.force(depth, v))[0] / 2e-6
    return float(stiffness), float(damping)


def _solve(rising: Drive, wanted: float) -> float:
    """Find x > 0, m, at which a rising function reaches a value, by bisection on a logarithmic
    scale.
    """
    low, high = 1e-15, 1e6
    for _ in range(60):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if rising(middle) < wanted else (low, middle)
    return math.sqrt(low * high)
