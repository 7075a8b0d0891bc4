"""Motion along the plate in an oblique impact: recorded at each step, and
evaluated from the record.

Directions are those of `terms.impact.Launch`: along the way that the body is sent, across it, and
along the normal away from the plate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hcbench.system.errors import UserError
from hcbench.terms.impact import ENERGY, FRICTION, SLIP, SPIN, Tangential

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.terms.impact import Floats, Impact
    from hcbench.terms.scene import Scene


# Component along x of a normal from which the plate counts as across x.
_ACROSS = 0.9
# Cosine from which a direction counts as normal to the plate.
_NORMAL = 1.0 - 1e-6


def frame(deeper: Floats, along: Sequence[float] = (1.0, 0.0, 0.0)) -> Floats:
    """Axes of a plate: unit vectors along it, across and away from it, as rows; shape (..., 3, 3).

    deeper: unit vectors into the plate, (..., 3).
    along: vector whose part in the plate is the first axis; it may have any length, and must not be
    normal to the plate.
    """
    up = -deeper
    ahead = np.asarray(along) - up * (up @ np.asarray(along))[..., None]
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    return np.stack([ahead, np.cross(up, ahead), up], axis=-2)


def plate_frame(deeper: Floats, along: Sequence[float] | None) -> Floats:
    """Axes of a plate for a direction that a user gives: rows along, across and away from it, (3,
    3).

    deeper: unit vector into the plate, (3,).
    along: the direction, of any length; None for x, or for y where x is nearly normal to the plate.
    Raises UserError for a direction that is 0 or normal to the plate.
    """
    if along is None:
        along = (1.0, 0.0, 0.0) if abs(deeper[0]) < _ACROSS else (0.0, 1.0, 0.0)
    length = float(np.linalg.norm(along))
    expected = "a direction along the plate"
    if not length > 0:
        raise UserError("along", f"{tuple(along)!r}", expected)
    if abs(float(deeper @ np.asarray(along))) > _NORMAL * length:
        raise UserError("along", f"{tuple(along)!r}, normal to the plate", expected)
    return frame(deeper, along)


def rows_of_ball(
    scene: Scene, velocity: Floats, spin: Floats, deeper: Floats, gained: Floats
) -> Floats:
    """Motion of a scene's balls along the plate at each step, (8, b, n): slip of the contact point
    (2, m/s), spin (3, rad/s), friction (2, N), and the kinetic energy without that of the approach
    (J); vectors in the plate's axes, along, across and away from it.

    velocity, spin: of the centre at the start of each step, m/s and rad/s, (b, n, 3).
    deeper: unit vectors into the plate, (b, n, 3).
    gained: acceleration in the step without that of gravity, m/s², (b, n, 3).
    """
    sliding = velocity + np.cross(spin, scene.touch_radius * deeper)
    rate = (velocity * deeper).sum(axis=-1)
    energy = 0.5 * scene.mass * ((velocity**2).sum(axis=-1) - rate**2)
    energy += 0.5 * scene.inertia * (spin**2).sum(axis=-1)
    # In the plate's own axes: along, across and away from it.
    axes = frame(deeper)
    slip = np.einsum("...ij,...j->i...", axes, sliding)
    turning = np.einsum("...ij,...j->i...", axes, spin)
    push = np.einsum("...ij,...j->i...", axes, scene.mass * gained)
    return np.concatenate([slip[:2], turning, push[:2], energy[None]])


class AlongPlate(NamedTuple):
    """Slip, spin and energy of an impact in the direction of the launch; NaN if not measured.

    slip: of the contact point, m/s; spin: about the axis across, rad/s; before and after.

    impulse_ratio: of friction over the normal impulse.
    energy_lost: share of the kinetic energy.
    """

    slip_in: float
    slip_out: float
    spin_in: float
    spin_out: float
    impulse_ratio: float
    energy_lost: float


def along_plate(impact: Impact) -> AlongPlate:
    """Slip (m/s), spin (rad/s), impulse ratio and energy lost of an impact, in the direction of the
    launch; slip and spin are 0 for one that is not oblique.

    All is NaN for an oblique impact whose motion along the plate was not recorded, and for one
    without an e.
    """
    motion = impact.tangential
    if motion is not None:
        # Along the way of the launch, and about the axis across it.
        slip_in, _ = motion.slip_in
        slip_out, _ = motion.slip_out
        _, spin_in, _ = motion.spin_in
        _, spin_out, _ = motion.spin_out
        return AlongPlate(
            slip_in=slip_in,
            slip_out=slip_out,
            spin_in=spin_in,
            spin_out=spin_out,
            impulse_ratio=motion.impulse_ratio,
            energy_lost=motion.energy_lost,
        )
    if impact.launch.is_oblique or not impact.is_measured:
        return AlongPlate(*(np.nan,) * 6)
    return AlongPlate(
        slip_in=0.0,
        slip_out=0.0,
        spin_in=0.0,
        spin_out=0.0,
        impulse_ratio=0.0,
        energy_lost=impact.energy_lost,
    )


def tangential_of(
    rows: Floats,
    samples: int,
    speeds: tuple[float, float],
    timestep: float,
    mass: float,
    by_work: bool = False,
) -> Tangential:
    """Evaluate a measured oblique impact along the plate: slip, spin and energy before and after,
    and impulses.

    rows: penetration, rate, force and the eight of `Record.tangential` at all steps of this launch,
    SI, (11, n).
    samples: steps in which the force acted.
    speeds: in and out along the normal, m/s.
    timestep: s.
    mass: effective, along the normal, kg.
    by_work: the energy after is the one before less the work that the contact took, since joints
    and servos change the energy, too.
    """
    force = rows[2]
    along = rows[3:]
    speed_in, speed_out = speeds
    first = int((force != 0.0).argmax())
    stop = first + samples
    contact = slice(first, stop)
    before = along[:, first]
    after = along[:, min(stop, along.shape[1] - 1)]
    # ENERGY is all but that of the approach along the normal.
    energy_in = float(before[ENERGY]) + 0.5 * mass * speed_in**2
    if by_work:
        energy_out = energy_in - timestep * _power(rows, contact)
    else:
        energy_out = float(after[ENERGY]) + 0.5 * mass * speed_out**2
    return Tangential(
        slip_in=tuple(before[SLIP].tolist()),
        slip_out=tuple(after[SLIP].tolist()),
        spin_in=tuple(before[SPIN].tolist()),
        spin_out=tuple(after[SPIN].tolist()),
        impulse=tuple((timestep * along[FRICTION, contact].sum(axis=1)).tolist()),
        normal_impulse=float(timestep * force[contact].sum()),
        energy_in=energy_in,
        energy_out=energy_out,
    )


def _power(rows: Floats, contact: slice) -> float:
    """Power that the contact takes from the motion, summed over its steps, W; times the step it is
    a work, J.

    In each step it is the force times the mean of the speeds at the step's ends, along the normal
    and along the plate.
    rows: penetration, rate, force, and the eight of `Record.tangential`, SI, (11, n).
    contact: the steps in which the force acted.
    """
    # A body that stays down is in contact to the record's last step, which then has no end.
    steps = np.arange(contact.start, contact.stop)
    ends = np.minimum(steps + 1, rows.shape[1] - 1)
    rates = rows[1]
    slips = rows[3:][SLIP]
    rate = (rates[..., contact] + rates[..., ends]) / 2
    slip = (slips[..., contact] + slips[..., ends]) / 2
    friction = rows[3:][FRICTION, contact]
    return float((rows[2, contact] * rate).sum() - (friction * slip).sum())
