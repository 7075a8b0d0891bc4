"""Runs of a mass between two blocks: one run, its events, and the ledger of its energy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.errors import HcbenchError, UserError
from hcbench.laws.force import HuntCrossley
from hcbench.laws.require import positive, require
from hcbench.paper.vibroimpact.batched_ode import Control, Lanes, march
from hcbench.paper.vibroimpact.dynamics import APART, CONTACT, SIGNS, SLACK, Blocks
from hcbench.paper.vibroimpact.system import (
    Drive,
    Event,
    Kind,
    Run,
    Side,
    Sinusoid,
    VibroImpact,
    pressing,
    stored,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.impact import Floats
    from hcbench.laws.force import ForceLaw
    from hcbench.paper.vibroimpact.batched_ode import Indices, Modes
    from hcbench.paper.vibroimpact.dynamics import Push

SIDES: tuple[Side, Side] = ("right", "left")
_KINDS: dict[tuple[int, int], Kind] = {
    (APART, CONTACT): "touch",
    (CONTACT, APART): "part",
    (SLACK, APART): "part",
    (CONTACT, SLACK): "release",
    (SLACK, CONTACT): "press",
}


_STRONGEST = 1e100  # N: the squares of larger ones would overflow


def simulate(
    system: VibroImpact,
    position: float,
    velocity: float,
    until: float,
    drive: Drive | None = None,
    *,
    tolerance: float = 1e-11,
    step_max: float = math.inf,
) -> Run:
    """One run from q = position (m), q' = velocity (m/s), t = 0 to `until` (s); free without a drive.

    drive: P in N over t in s, a `Sinusoid` or any function that is smooth (steps of a rough one need
    `step_max`, s). tolerance: error of a step over the size of the motion. Raises UserError for numbers
    that are not finite, from the caller or from the drive.
    """
    for slot, value, unit in (("position", position, "m"), ("velocity", velocity, "m/s")):
        require(slot, value, math.isfinite(value), f"a finite number in {unit}")
    positive("until", until, "s")
    require("tolerance", tolerance, 1e-15 <= tolerance <= 1e-2, "1e-15 ... 1e-2 of the motion's size")
    require("step_max", step_max, step_max > 0.0, "a step above 0 s")
    push = _Any(drive)
    length, speed = size_of(system, position, velocity, _largest(drive, push, until), drive)
    half = np.array([system.gap / 2.0])
    laws = (system.right, system.left)
    sizes = np.array([length]), np.array([speed])
    blocks = Blocks(laws, system.mass, half, push, *sizes, tolerance, ledger=True)
    y = np.array([[position], [velocity], [0.0], [0.0]])
    lane = np.zeros(1, dtype=np.intp)
    modes = blocks.modes(y, lane, push.of(lane)(np.zeros(1)))
    if isinstance(drive, Sinusoid):
        step_max = min(step_max, 0.1 / drive.frequency)
    lanes = Lanes(np.zeros(1), y, modes)
    control = Control(tolerance, np.array([step_max]))
    log = _Log(blocks, lanes)
    march(blocks, lanes, np.array([[until]]), control, log)
    return log.run(system, push)


class _Log:
    """Keeps every step of a single lane."""

    def __init__(self, blocks: Blocks, lanes: Lanes) -> None:
        self.blocks = blocks
        self.times, self.states = [0.0], [lanes.y[:, 0].copy()]
        self.events: list[Event] = []

    def step(self, lane: Indices, t: Floats, y: Floats, before: Modes, after: Modes) -> None:
        """See `lanes.Watch`."""
        self.times.append(float(t[0]))
        self.states.append(y[:, 0])
        for side, sign in enumerate(SIGNS):
            kind = _KINDS.get((int(before[side, 0]), int(after[side, 0])))
            if kind is not None:
                self.events.append(Event(float(t[0]), SIDES[side], kind, float(y[1, 0]) * sign))

    def stop(self, lane: Indices, index: Indices, y: Floats) -> None:
        """See `lanes.Watch`."""

    def run(self, system: VibroImpact, push: Push) -> Run:
        """All of it as a Run."""
        time = np.array(self.times)
        q, v, lost, put_in = np.array(self.states).T
        half = system.gap / 2.0
        energy = [stored(system.right, float(x - half)) + stored(system.left, float(-x - half)) for x in q]
        return Run(
            time=time,
            position=q,
            velocity=v,
            right=pressing(system.right, q - half, v),
            left=pressing(system.left, -q - half, -v),
            drive=push.of(np.zeros(time.size, dtype=np.intp))(time),
            kinetic=0.5 * system.mass * v * v,
            stored=np.array(energy),
            lost=lost,
            put_in=put_in,
            events=tuple(self.events),
        )


@dataclass(frozen=True, slots=True)
class _Any:
    """Any function of time as the push of every lane; None pushes nothing."""

    drive: Drive | None

    def of(self, lane: Indices) -> Callable[[Floats], Floats]:
        """See `Push`."""
        return np.zeros_like if self.drive is None else self._checked

    def _checked(self, time: Floats) -> Floats:
        return np.array([self._at(float(t)) for t in time])

    def _at(self, time: float) -> float:
        assert self.drive is not None
        expected = "a finite force, a number in N, at every time"
        try:
            value: object = self.drive(time)
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


def _largest(drive: Drive | None, push: Push, until: float) -> float:
    """Largest P, N."""
    if isinstance(drive, Sinusoid):
        return abs(drive.amplitude)
    time = np.linspace(0.0, until, 257)
    return float(np.abs(push.of(np.zeros(time.size, dtype=np.intp))(time)).max())


def size_of(
    system: VibroImpact, position: float, velocity: float, force: float, drive: Drive | None = None
) -> tuple[float, float]:
    """How large the motion is (m, m/s), for tolerances: by its energy and a drive of size `force` (N).

    A depth X and a speed V with F(X, 0) X = m V², about an impact's; for a squeezed mass those of its swing.
    """
    half, squeeze = system.gap / 2.0, system.squeeze
    start = 0.5 * system.mass * velocity**2
    for law, x in ((system.right, position - half), (system.left, -position - half)):
        start += max(0.0, stored(law, x) - stored(law, squeeze))
    if squeeze > 0.0:
        stiffness = sum(tangent(law, squeeze)[0] for law in (system.right, system.left))
        energy = start + 0.5 * force**2 / stiffness
        require("start", energy, energy > 0.0, "a motion: a speed, a position off the middle, or a drive")
        return math.sqrt(2.0 * energy / stiffness), math.sqrt(2.0 * energy / system.mass)
    if isinstance(drive, Sinusoid):  # what it does to a free mass
        energy = start + 0.5 * (force / (2.0 * math.pi * drive.frequency)) ** 2 / system.mass
    else:
        energy = start + (force * _depth_at(system.right, force) if force else 0.0)
    require("start", energy, energy > 0.0, "a motion: a speed, a position inside a block, or a drive")
    depth = _depth_for(system.right, energy)
    return depth, math.sqrt(2.0 * energy / system.mass)


def tangent(law: ForceLaw, depth: float) -> tuple[float, float]:
    """dF/dx (N/m) and dF/dv (N s/m) at rest at `depth` (m).

    n k x^(n-1) and λ x^n of eq. (16); central differences of fourth order of other laws.
    """
    if isinstance(law, HuntCrossley):
        k, n = law.stiffness, law.exponent
        return n * k * depth ** (n - 1.0), law.dissipation * k * depth**n
    step = 1e-3 * depth
    dx = [float(law.force(depth + i * step, 0.0)) for i in (-2, -1, 1, 2)]
    # In v every law here is a straight line near 0; the step is the one that a swing of 1e-3 of the depth
    # makes.
    rate = max(step * math.sqrt(abs(dx[2] - dx[1])), 1e-9)
    dv = [float(law.force(depth, i * rate)) for i in (-2, -1, 1, 2)]
    weights = (1.0 / 12.0, -8.0 / 12.0, 8.0 / 12.0, -1.0 / 12.0)
    return (
        sum(w * f for w, f in zip(weights, dx, strict=True)) / step,
        sum(w * f for w, f in zip(weights, dv, strict=True)) / rate,
    )


def _depth_at(law: ForceLaw, force: float) -> float:
    """x with F(x, 0) = force, m."""
    return _solve(lambda x: float(law.force(x, 0.0)), force)


def _depth_for(law: ForceLaw, energy: float) -> float:
    """x with F(x, 0) x = 2 energy, m."""
    return _solve(lambda x: float(law.force(x, 0.0)) * x, 2.0 * energy)


def _solve(rising: Drive, wanted: float) -> float:
    """Roughly where a rising function of x > 0 has a value: within a few per cent, all that a scale needs."""
    low, high = 1e-15, 1e6
    for _ in range(60):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if rising(middle) < wanted else (low, middle)
    return math.sqrt(low * high)
