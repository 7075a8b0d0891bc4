"""Runs of a mass between two blocks: its flow as `lanes` wants it, one run, the ledger of its energy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from hcbench.errors import UserError
from hcbench.reference.lanes import SURFACES, Control, Lanes, march
from hcbench.reference.laws import HuntCrossley
from hcbench.reference.require import positive, require
from hcbench.reference.vibroimpact import (
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
    from hcbench.impact import Floats
    from hcbench.reference.lanes import Indices, Modes
    from hcbench.reference.laws import ForceLaw

APART, CONTACT, SLACK = 0, 1, 2  # slack: still inside the block's surface, but the law would pull
SIDES: tuple[Side, Side] = ("right", "left")
SIGNS = (1.0, -1.0)
_AT_SURFACE = 1e-14  # of the length scale
_EPS = float(np.finfo(float).eps)
_KINDS: dict[tuple[int, int], Kind] = {
    (APART, CONTACT): "touch",
    (CONTACT, APART): "part",
    (SLACK, APART): "part",
    (CONTACT, SLACK): "release",
    (SLACK, CONTACT): "press",
}
_RELEASE_AT = 1e-9  # of the length scale: F(x, v)/F(x, 0) has no meaning nearer to x = 0


class Push(Protocol):
    """P of every lane."""

    def __call__(self, time: Floats, lane: Indices) -> Floats:
        """N, at times (s) of the lanes numbered `lane`."""
        ...


@dataclass(frozen=True, slots=True)
class Blocks:
    """The flow of `lanes`: position, velocity and, with `ledger`, the energies lost and put in.

    half_gap: g/2 of each lane, m, shape (lanes,). length, speed: size of its motion, m, m/s, shape (lanes,).
    tolerance: error of a step over those sizes.
    """

    laws: tuple[ForceLaw, ForceLaw]
    mass: float
    half_gap: Floats
    push: Push
    length: Floats
    speed: Floats
    tolerance: float
    ledger: bool = False

    def phase(self, mode: Modes, lane: Indices) -> BlocksPhase:
        """See `Flow`."""
        return BlocksPhase(self, mode, lane)

    def share(self, side: int, x: Floats, w: Floats, lane: Indices) -> Floats:
        """F(x, v)/F(x, 0), clipped to -1 ... 1: above 0 while the block presses. x in m."""
        law = self.laws[side]
        if isinstance(law, HuntCrossley):
            ratio = 1.0 + law.dissipation * w
        else:
            depth = np.maximum(x, _RELEASE_AT * self.length[lane])
            ratio = law.force(depth, w) / law.force(depth, 0.0)
        return np.minimum(np.maximum(ratio, -1.0), 1.0)

    def switched(self, y: Floats, mode: Modes, switch: Indices, lane: Indices) -> Modes:
        """Apart <-> contact at the surfaces, contact <-> slack where a force ends or returns; see `Flow`."""
        out = mode.copy()
        for side, sign in enumerate(SIGNS):
            # With no gap one side is met where the other is left: both go by the speed.
            x = sign * y[0] - self.half_gap[lane]
            near = _AT_SURFACE * self.length[lane] + 8.0 * _EPS * np.abs(y[0])
            surface = (switch == side) | (np.abs(x) <= near)
            force = ~surface & (switch == SURFACES + side)
            out[side] = np.where(surface, np.where(sign * y[1] > 0.0, CONTACT, APART), out[side])
            out[side] = np.where(force, np.where(mode[side] == CONTACT, SLACK, CONTACT), out[side])
        return out

    def modes(self, y: Floats, lane: Indices, drive: Floats) -> Modes:
        """The modes to start in; at x = 0 it is the speed, then the drive, that tells contact from flight."""
        out = np.zeros((2, y.shape[1]), dtype=np.int8)
        for side, sign in enumerate(SIGNS):
            x, w = sign * y[0] - self.half_gap[lane], sign * y[1]
            presses = self.share(side, x, w, lane) > 0.0
            comes = (w > 0.0) | ((w == 0.0) & (sign * drive > 0.0))
            free = np.where((x == 0.0) & comes, CONTACT, APART)
            out[side] = np.where(x > 0.0, np.where(presses, CONTACT, SLACK), free)
        return out


class BlocksPhase:
    """Lanes whose modes stand; see `lanes.Phase`. Works out once who is in contact with what.

    Where one side is in contact, z holds s = √x of that side instead of the position, over σ with dt = 2 s
    dσ. x^(3/2) has no derivatives at x = 0 that an error estimate could go by; in s, σ everything is smooth
    there.
    """

    def __init__(self, flow: Blocks, mode: Modes, lane: Indices) -> None:
        self.flow, self.lane, self.half = flow, lane, flow.half_gap[lane]
        self.length, self.speed = flow.length[lane], flow.speed[lane]
        self.touching = mode != APART
        self.plain = self.touching[0] == self.touching[1]
        self.side = np.where(self.touching[1], -1.0, 1.0)  # of the side that s belongs to
        self.inside = [np.flatnonzero(touching) for touching in self.touching]
        self.pressing = [mode[side, inside] == CONTACT for side, inside in enumerate(self.inside)]
        self.slack = [not bool(pressing.all()) for pressing in self.pressing]
        energy = 0.5 * flow.mass * self.speed**2
        place = np.where(self.plain, self.length, np.sqrt(self.length))
        rest = [energy, energy] if flow.ledger else []
        self.own = [~self.plain & touching for touching in self.touching]  # s is of this side
        self.outward = np.where(self.touching, 1.0, -1.0) / self.length  # distance over x of each side
        self.size = np.array([place, self.speed, *rest, self.length / self.speed])

    def enter(self, t: Floats, y: Floats) -> Floats:
        """See `Phase`."""
        root = np.sqrt(np.maximum(self.side * y[0] - self.half, 0.0))
        return np.array([np.where(self.plain, y[0], root), *y[1:], t], dtype=float)

    def leave(self, z: Floats) -> tuple[Floats, Floats]:
        """See `Phase`."""
        return z[-1], np.array([self._position(z), *z[1:-1]])

    def _position(self, z: Floats) -> Floats:
        return np.asarray(np.where(self.plain, z[0], self.side * (self.half + z[0] * z[0])))

    def _depths(self, side: int, z: Floats) -> Floats:
        """x of the lanes in contact with a side: s² itself where z has it."""
        inside, place = self.inside[side], z[0]
        here = place[inside]
        plain = np.maximum(SIGNS[side] * here - self.half[inside], 0.0)
        return np.asarray(np.where(self.plain[inside], plain, here * here))

    def rates(self, z: Floats) -> Floats:
        """See `Phase`."""
        flow, v = self.flow, z[1]
        pace = np.where(self.plain, 1.0, 2.0 * z[0])  # dt/dσ
        drive = flow.push(z[-1], self.lane)
        out = np.empty_like(z)
        total = drive.copy()
        if flow.ledger:
            out[2], out[3] = 0.0, drive * v
        for side, sign in enumerate(SIGNS):
            inside = self.inside[side]
            if not inside.size:
                continue
            law = flow.laws[side]
            x, w = self._depths(side, z), sign * v[inside]
            force = law.force(x, w)
            if self.slack[side]:
                force = np.where(self.pressing[side], force, 0.0)
            total[inside] -= sign * force
            if flow.ledger:
                out[2, inside] += (force - law.force(x, 0.0)) * w
        out[1] = total / flow.mass
        out[-1] = 1.0
        out[1:] *= pace
        out[0] = np.where(self.plain, v, self.side * v)
        return out

    def first_step(self) -> Floats:
        """Short where a second side is met: x^n has no derivatives there; see `Phase`.

        With n = 3/2 the motion is x = v t - C t^(7/2) ...: the step takes its error to the tolerance by
        itself.
        """
        tolerance = self.flow.tolerance
        both = np.where(self.touching[0], min(0.05, 2.0 * tolerance ** (2.0 / 7.0)) * self.size[-1], np.inf)
        return np.where(self.plain, both, 2.0 * tolerance**0.125 * self.size[0] / self.speed)

    def longest_step(self, z: Floats, time: Floats) -> Floats:
        """See `Phase`."""
        return np.where(self.plain, time, time / (2.0 * np.maximum(z[0], 0.3 * self.size[0])))

    def distances(self, z: Floats) -> tuple[Floats, Indices, Floats]:
        """Of surfaces over the size of z[0]; of forces, F(x, v)/F(x, 0) within -1 ... 1. See `Phase`."""
        q, v = self._position(z), z[1]
        right, left = (q - self.half) * self.outward[0], (-q - self.half) * self.outward[1]
        # The side that s belongs to: s itself, which falls at a steady rate where x = s² does not.
        own = z[0] / self.size[0]
        right, left = np.where(self.own[0], own, right), np.where(self.own[1], own, left)
        switch = (left < right).astype(np.intp)
        nearest = np.minimum(right, left)
        pace = np.where(self.plain, 1.0, 2.0 * z[0])
        of_s = np.where(switch == 0, self.own[0], self.own[1])
        rate = np.where(switch == 0, self.outward[0], -self.outward[1]) * pace * v
        rate = np.where(of_s, self.side * v / self.size[0], rate)
        for side, sign in enumerate(SIGNS):
            inside = self.inside[side]
            if not inside.size:
                continue
            share = self.flow.share(side, self._depths(side, z), sign * z[1, inside], self.lane[inside])
            if self.slack[side]:
                share = np.where(self.pressing[side], share, -share)
            nearer = share < nearest[inside]
            if nearer.any():
                which = inside[nearer]
                nearest[which], switch[which], rate[which] = share[nearer], SURFACES + side, np.nan
        return nearest, switch, rate


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
    push = _push_of(drive)
    length, speed = size_of(system, position, velocity, _largest(drive, push, until), drive)
    half = np.array([system.gap / 2.0])
    laws = (system.right, system.left)
    sizes = np.array([length]), np.array([speed])
    blocks = Blocks(laws, system.mass, half, push, *sizes, tolerance, ledger=True)
    y = np.array([[position], [velocity], [0.0], [0.0]])
    lane = np.zeros(1, dtype=np.intp)
    modes = blocks.modes(y, lane, push(np.zeros(1), lane))
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
            drive=push(time, np.zeros(time.size, dtype=np.intp)),
            kinetic=0.5 * system.mass * v * v,
            stored=np.array(energy),
            lost=lost,
            put_in=put_in,
            events=tuple(self.events),
        )


def _push_of(drive: Drive | None) -> Push:
    if drive is None:
        return lambda time, lane: np.zeros_like(time)

    def push(time: Floats, lane: Indices) -> Floats:
        out = np.array([drive(float(t)) for t in time])
        if not np.isfinite(out).all():
            i = int(np.flatnonzero(~np.isfinite(out))[0])
            raise UserError(
                "drive",
                f"gave {float(out[i])!r} N at t = {float(time[i])!r} s",
                "a finite force at every time",
            )
        return out

    return push


def _largest(drive: Drive | None, push: Push, until: float) -> float:
    """Largest P, N."""
    if drive is None:
        return 0.0
    if isinstance(drive, Sinusoid):
        return abs(drive.amplitude)
    time = np.linspace(0.0, until, 257)
    return float(np.abs(push(time, np.zeros(time.size, dtype=np.intp))).max())


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
    """dF/dx (N/m) and dF/dv (N s/m) at rest at `depth` (m), by central differences of fourth order."""
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
