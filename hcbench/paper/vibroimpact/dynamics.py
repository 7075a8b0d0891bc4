"""A mass between two blocks as a flow for `lanes`: rates, switches, variables that are smooth in contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from hcbench.laws.force import HuntCrossley
from hcbench.paper.vibroimpact.batched_ode import SURFACES

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.impact import Floats
    from hcbench.laws.force import ForceLaw
    from hcbench.paper.vibroimpact.batched_ode import Indices, Modes

APART, CONTACT, SLACK = 0, 1, 2  # slack: still inside the block's surface, but the law would pull
SIGNS = (1.0, -1.0)
_AT_SURFACE = 1e-14  # of the length scale
_EPS = float(np.finfo(float).eps)
_RELEASE_AT = 1e-9  # of the length scale: F(x, v)/F(x, 0) has no meaning nearer to x = 0


class Push(Protocol):
    """P of every lane."""

    def of(self, lane: Indices) -> Callable[[Floats], Floats]:
        """P in N of the lanes numbered `lane`, over their times in s."""
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
        self.drive = flow.push.of(lane)
        self.own = [~self.plain & touching for touching in self.touching]  # s is of this side
        self.outward = np.where(self.touching, 1.0, -1.0) / self.length  # distance over x of each side
        energy = 0.5 * flow.mass * self.speed**2
        place = np.where(self.plain, self.length, np.sqrt(self.length))
        rest = [energy, energy] if flow.ledger else []
        self.size = np.array([place, self.speed, *rest, self.length / self.speed])
        self.heading = np.where(self.plain, 1.0, self.side)  # d z[0] / dσ over v
        # Contacts of both sides one after the other: `which` lane, and what it needs there.
        right, left = (np.flatnonzero(touching) for touching in self.touching)
        self.which = np.concatenate([right, left])
        self.sides = slice(0, right.size), slice(right.size, self.which.size)
        self.sign = np.repeat(SIGNS, (right.size, left.size))
        self.wall = self.half[self.which]
        self.squeezed = self.plain[self.which]
        self.any_squeezed = bool(self.squeezed.any())
        pressing = np.concatenate([mode[0, right], mode[1, left]]) == CONTACT
        self.slack = None if pressing.all() else ~pressing

    def enter(self, t: Floats, y: Floats) -> Floats:
        """See `Phase`."""
        root = np.sqrt(np.maximum(self.side * y[0] - self.half, 0.0))
        return np.array([np.where(self.plain, y[0], root), *y[1:], t], dtype=float)

    def leave(self, z: Floats) -> tuple[Floats, Floats]:
        """See `Phase`."""
        return z[-1], np.array([self._position(z), *z[1:-1]])

    def _position(self, z: Floats) -> Floats:
        return np.asarray(np.where(self.plain, z[0], self.side * (self.half + z[0] * z[0])))

    def _contacts(self, z: Floats) -> tuple[Floats, Floats]:
        """x and its rate of every contact; x is s² itself where z has it."""
        here = z[0, self.which]
        x = here * here
        if self.any_squeezed:
            x = np.where(self.squeezed, np.maximum(self.sign * here - self.wall, 0.0), x)
        return x, self.sign * z[1, self.which]

    def _forces(self, x: Floats, w: Floats | float) -> Floats:
        """Of every contact, N."""
        right, left = self.flow.laws
        if right == left:
            return right.force(x, w)
        one, other = self.sides
        rates = (w[one], w[other]) if isinstance(w, np.ndarray) else (w, w)
        return np.concatenate([right.force(x[one], rates[0]), left.force(x[other], rates[1])])

    def _shared(self, values: Floats, out: Floats) -> None:
        """Add a value of every contact to its lane; a squeezed lane has two contacts, one a side."""
        for side in self.sides:
            out[self.which[side]] += values[side]

    def rates(self, z: Floats) -> Floats:
        """See `Phase`."""
        v = z[1]
        drive = self.drive(z[-1])
        out = np.empty_like(z)
        total = drive.copy()
        if self.flow.ledger:
            out[2], out[3] = 0.0, drive * v
        if self.which.size:
            x, w = self._contacts(z)
            force = self._forces(x, w)
            if self.slack is not None:
                force[self.slack] = 0.0
            self._shared(-self.sign * force, total)
            if self.flow.ledger:
                self._shared((force - self._forces(x, 0.0)) * w, out[2])
        np.divide(total, self.flow.mass, out=out[1])
        out[-1] = 1.0
        out[1:] *= np.where(self.plain, 1.0, 2.0 * z[0])  # dt/dσ
        np.multiply(self.heading, v, out=out[0])
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
        if self.which.size:
            x, w = self._contacts(z)
            for side, part in enumerate(self.sides):
                lanes = self.which[part]
                share = self.flow.share(side, x[part], w[part], self.lane[lanes])
                if self.slack is not None:
                    share = np.where(self.slack[part], -share, share)
                nearer = share < nearest[lanes]
                if nearer.any():
                    found = lanes[nearer]
                    nearest[found], switch[found], rate[found] = share[nearer], SURFACES + side, np.nan
        return nearest, switch, rate
