"""A mass in a gap between two blocks: the appendix and the forced system of section 3.1.

Position q is 0 in the middle. The right block is touched at q = g/2, the left one at q = -g/2, so
the penetrations are x_R = q - g/2 and x_L = -q - g/2, and m q'' = F_L(x_L, -v) - F_R(x_R, v) +
P(t). g > 0 is clearance (two impacts a cycle), g = 0 two half loops that meet (Fig. 7), g < 0 a
mass squeezed from both sides (Figs. 8, 9). The blocks press and never pull: where a law would pull
(F < 0 at x > 0), nothing acts until it presses again or the surfaces part.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad

from hcbench.laws.force import ForceLaw, HuntCrossley
from hcbench.system.errors import UserError
from hcbench.terms.bounds import positive, require
from hcbench.terms.impact import Floats

Drive: TypeAlias = Callable[[float], float]


@dataclass(frozen=True, slots=True)
class Sinusoid:
    """P(t) = A sin(2π f t + φ): amplitude A, N; frequency f, Hz; phase φ, rad."""

    amplitude: float
    frequency: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        require(
            "amplitude", self.amplitude, math.isfinite(self.amplitude), "a finite amplitude in N"
        )
        positive("frequency", self.frequency, "Hz")
        require("phase", self.phase, math.isfinite(self.phase), "a finite phase in rad")

    def __call__(self, time: float) -> float:
        """P in N at `time` in s."""
        return self.amplitude * math.sin(2.0 * math.pi * self.frequency * time + self.phase)


@dataclass(frozen=True, slots=True)
class VibroImpact:
    """The mass (kg), the gap g (m; negative: squeezed) and the law of each block.

    right, left: laws of the blocks at q = g/2 and q = -g/2.
    depth_max: penetration (m) up to which the laws hold, such as `EllipticContact.depth_max()`; a
    gap that squeezes the mass further is refused.
    """

    mass: float
    gap: float
    right: ForceLaw
    left: ForceLaw
    depth_max: float = math.inf

    def __post_init__(self) -> None:
        """Raise UserError for a mass or depth that is not above 0, and for a gap that is not finite
        or squeezes the mass too far.
        """
        positive("mass", self.mass, "kg")
        require("gap", self.gap, math.isfinite(self.gap), "a finite gap in m; negative: squeezed")
        require("depth_max", self.depth_max, self.depth_max > 0.0, "a depth above 0 m")
        if -self.gap / 2.0 > self.depth_max:
            raise UserError(
                "gap",
                f"{self.gap!r} m squeezes each side by {-self.gap / 2.0:.4g} m",
                f"at most {self.depth_max:.4g} m, where contact radius over surface radius reaches 0.1 and "
                "Hertz's law ends",
                f"Take a gap above {-2.0 * self.depth_max:.4g} m",
            )

    @property
    def squeeze(self) -> float:
        """Penetration on both sides in the middle, where equal blocks hold the mass at rest, m; 0
        with clearance.
        """
        return max(0.0, -self.gap / 2.0)

    def resultant(self, position: Floats | float, velocity: Floats | float) -> Floats:
        """F_R - F_L in N, the force of both blocks towards smaller q; positions (m)
        and velocities (m/s) broadcast, and the result has their common shape.
        """
        q, v = np.broadcast_arrays(
            np.asarray(position, dtype=float), np.asarray(velocity, dtype=float)
        )
        half = self.gap / 2.0
        return pressing(self.right, q - half, v) - pressing(self.left, -q - half, -v)


def pressing(law: ForceLaw, penetration: Floats, rate: Floats) -> Floats:
    """F of a law that cannot pull, N: 0 for x <= 0 and where F would
    be below 0; arrays of one shape.
    """
    inside = np.maximum(penetration, 0.0)
    return np.where(penetration > 0.0, np.maximum(law.force(inside, rate), 0.0), 0.0)


def stored(law: ForceLaw, penetration: float) -> float:
    """Elastic energy ∫ F(x, 0) dx from 0 to `penetration` (m), J; 0 outside contact.

    In closed form for eq. (16), k x^(n+1)/(n+1); by quadrature for other laws.
    """
    if penetration <= 0.0:
        return 0.0
    if isinstance(law, HuntCrossley):
        return float(law.stiffness * penetration ** (law.exponent + 1.0) / (law.exponent + 1.0))
    value, _ = quad(
        lambda x: float(law.force(x, 0.0)), 0.0, penetration, epsabs=0.0, epsrel=1e-13, limit=200
    )
    return float(value)


Side = Literal["right", "left"]
Kind = Literal["touch", "part", "release", "press"]


@dataclass(frozen=True, slots=True)
class Event:
    """A side touched or parted (x = 0), or its force went to 0 (release)
    or came back (press) at x > 0.

    time, s; rate: of penetration at that side, m/s, > 0 on approach.
    """

    time: float
    side: Side
    kind: Kind
    rate: float


@dataclass(frozen=True, slots=True)
class SimulatedMotion:
    """Motion, forces and energies: arrays of shape (n,) at the integrator's own steps, events
    included; SI.

    right, left: what the blocks press with, >= 0. kinetic + stored + lost - put_in is constant.
    """

    time: Floats
    position: Floats
    velocity: Floats
    right: Floats
    left: Floats
    kinetic: Floats
    stored: Floats
    lost: Floats
    put_in: Floats
    events: tuple[Event, ...]

    @property
    def resultant(self) -> Floats:
        """F_R - F_L, N: over `position`, the summed loops of Figs. 7, 8 and 9."""
        return self.right - self.left

    def during(self, start: float, end: float) -> SimulatedMotion:
        """The part with start <= time <= end, s."""
        keep = (self.time >= start) & (self.time <= end)
        arrays = {f.name: getattr(self, f.name)[keep] for f in fields(self) if f.name != "events"}
        events = tuple(e for e in self.events if start <= e.time <= end)
        return SimulatedMotion(**arrays, events=events)


# The equations of a mass between two blocks for `simulate.integrate`: rates, switches and modes.

Modes: TypeAlias = NDArray[np.int8]
Indices: TypeAlias = NDArray[np.intp]
Flags: TypeAlias = NDArray[np.bool_]

# Modes of a contact. Pulled off: inside the block's surface, where the law would pull.
APART, CONTACT, PULLED_OFF = 0, 1, 2
# Row 0 is the right block and row 1 the left one, whose x points the other way.
SIGNS = np.array([[1.0], [-1.0]])
# A step's error must be above this share of a position's last digit to be seen.
_GRAIN = 0.01
# A state this near to a surface is on it, as a share of the length scale.
_AT_SURFACE = 1e-14
_EPS = float(np.finfo(float).eps)
# Share of the length scale: F(x, v)/F(x, 0) has no meaning nearer to x = 0.
_SHALLOWEST = 1e-9

# The drive P, N, at times, s, of oscillators.
Drives: TypeAlias = Callable[[Floats, Indices], Floats]


@dataclass(frozen=True, slots=True)
class TwoSidedContact:
    """A batch of masses between blocks, whose equations depend on modes, which change at switches.

    The mode of a contact is APART, CONTACT while its law presses, or PULLED_OFF where the mass is
    in the block and the law would pull, so that nothing acts.
    y is position, velocity and, if the energy balance is kept, the energies lost and put in; shape
    (components, masses). `rows` are the numbers of the masses that the columns of the other arrays
    belong to. Switch 0 or 1 is the surface of the right or left block, 2 or 3 where its force ends
    or returns.

    laws: of the right and the left block.
    mass: of every one, kg.
    half_gap: g/2 of each, m, shape (masses,).
    drive: P of each.
    length, speed: the size of each motion, m, m/s, shape (masses,).
    size: that of each component
    of y.
    tolerance: error of a step over those sizes.
    energy_balance: whether y has the energies.
    """

    laws: tuple[ForceLaw, ForceLaw]
    mass: float
    half_gap: Floats
    drive: Drives
    length: Floats
    speed: Floats
    tolerance: float
    energy_balance: bool = False
    size: Floats = field(init=False)

    def __post_init__(self) -> None:
        """Set `size`, over which the errors of position (m), velocity (m/s) and energies (J) are
        measured. Raises UserError for contacts too shallow to resolve over their gap.
        """
        shallow = self.length * self.tolerance < _GRAIN * _EPS * np.abs(self.half_gap)
        # No step would be good: the error that it may have is less than a position's last digit.
        if shallow.any():
            got = f"{self.length[shallow][0]:.2g} m over a half gap of {self.half_gap[shallow][0]:.2g} m"
            raise UserError("depth of contact", got, "a softer contact, or a larger tolerance")
        energy = 0.5 * self.mass * self.speed**2
        rest = [energy, energy] if self.energy_balance else []
        object.__setattr__(self, "size", np.array([self.length, self.speed, *rest]))

    def rates(self, t: Floats, y: Floats, mode: Modes, rows: Indices) -> Floats:
        """dy/dt, shape of y: velocity, m/s, acceleration, m/s², and, with the energy balance, the
        powers that are lost and put in, W. A block's force acts in the mode CONTACT alone, the
        right one's towards smaller positions.

        t: times, s, shape (r,).
        y: states, shape (components, r).
        mode: of both contacts, shape
        (2, r).
        rows: numbers of the masses, shape (r,).
        """
        x, w = self._sides(y, rows)
        force = np.where(mode == CONTACT, self._forces(x, w), 0.0)
        drive = self.drive(t, rows)
        out = np.empty_like(y)
        out[0] = y[1]
        out[1] = (drive - force[0] + force[1]) / self.mass
        if self.energy_balance:
            # The force at rest stores energy. What the rest of the force takes is lost, and so is
            # what was stored where the block no longer presses.
            elastic = np.where(mode == APART, 0.0, self._forces(x, np.zeros_like(w)))
            out[2] = ((force - elastic) * w).sum(axis=0)
            out[3] = drive * y[1]
        return out

    def distance(self, y: Floats, mode: Modes, rows: Indices) -> tuple[Floats, Indices]:
        """Distance of each mass to its nearest switch, where the mode of a contact changes (below
        0: beyond), and the number of that switch; both of shape (r,).

        Switches 0 and 1 are the surfaces of the right and the left block, with the distance over
        the size of the motion; at 2 and 3 their force ends or returns, with F(x, v)/F(x, 0) for a
        distance.

        y: states, shape (components, r).
        mode: of both contacts, shape (2, r).
        rows: numbers of the masses, shape (r,).
        """
        x, w = self._sides(y, rows)
        surface = np.where(mode == APART, -x, x) / self.length[rows]
        ratio = self._force_ratio(x, w, rows)
        force = np.where(mode == APART, np.inf, np.where(mode == CONTACT, ratio, -ratio))
        distances = np.concatenate([surface, force])
        return distances.min(axis=0), distances.argmin(axis=0)

    def transition(self, y: Floats, mode: Modes, switch: Indices, rows: Indices) -> Modes:
        """The modes of both contacts after these switches, shape (2, r).

        Surfaces switch between apart and contact, forces between contact and pulled off.

        y: states, shape (components, r).
        mode: of both contacts, shape (2, r).
        switch: number of the switch of each mass, shape (r,).
        """
        x, w = self._sides(y, rows)
        side = np.array([[0], [1]])
        # Without a gap a body meets one side where it leaves the other: the speed decides for both.
        near = _AT_SURFACE * self.length[rows] + 8.0 * _EPS * np.abs(y[0])
        surface = (switch == side) | (np.abs(x) <= near)
        force = ~surface & (switch == 2 + side)
        mode = np.where(force, np.where(mode == CONTACT, PULLED_OFF, CONTACT), mode)
        return np.where(surface, np.where(w > 0.0, CONTACT, APART), mode).astype(np.int8)

    def first_modes(self, y: Floats) -> Modes:
        """The modes at t = 0, shape (sides, masses): at x = 0 the speed, then the drive, tells.

        y: states of all masses, shape (components, masses).
        """
        rows = np.arange(y.shape[1])
        x, w = self._sides(y, rows)
        push = SIGNS * self.drive(np.zeros(rows.size), rows)
        comes = (w > 0.0) | ((w == 0.0) & (push > 0.0))
        at_surface = np.where((x == 0.0) & comes, CONTACT, APART)
        inside = np.where(self._force_ratio(x, w, rows) > 0.0, CONTACT, PULLED_OFF)
        return np.where(x > 0.0, inside, at_surface).astype(np.int8)

    def first_step(self, mode: Modes, rows: Indices) -> Floats:
        """The step in s to begin these modes with: short in contact, where
        x^n begins without derivatives.

        With n = 3/2 the motion begins as x = v t - C t^(7/2): the error of
        the step is about the tolerance. Infinite where neither block is touched.

        mode: of both contacts, shape (2, r).
        rows: numbers of the masses, shape (r,).
        """
        short = (
            min(0.05, 2.0 * self.tolerance ** (2.0 / 7.0)) * self.length[rows] / self.speed[rows]
        )
        return np.where((mode == APART).all(axis=0), np.inf, short)

    def _sides(self, y: Floats, rows: Indices) -> tuple[Floats, Floats]:
        """Penetration (m) and its rate (m/s) at both sides, shape (2, rows)."""
        return SIGNS * y[0] - self.half_gap[rows], SIGNS * y[1]

    def _forces(self, x: Floats, w: Floats) -> Floats:
        """Forces on both blocks, N, shape (2, rows)."""
        right, left = self.laws
        inside = np.maximum(x, 0.0)
        if right == left:
            return right.force(inside, w)
        return np.stack([right.force(inside[0], w[0]), left.force(inside[1], w[1])])

    def _force_ratio(self, x: Floats, w: Floats, rows: Indices) -> Floats:
        """F(x, v)/F(x, 0), clipped to -1 ... 1, shape (2, r): above 0 while the block presses.

        x: penetration into either block, m, shape (2, r).
        w: its rate, m/s, shape (2, r).
        """
        ratio = np.empty_like(x)
        for side, law in enumerate(self.laws):
            if isinstance(law, HuntCrossley):
                ratio[side] = 1.0 + law.dissipation * w[side]
            else:
                depth = np.maximum(x[side], _SHALLOWEST * self.length[rows])
                ratio[side] = law.force(depth, w[side]) / law.force(depth, 0.0)
        return np.clip(ratio, -1.0, 1.0)
