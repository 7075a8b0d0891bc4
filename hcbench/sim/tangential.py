"""What happens along the plate in an oblique impact: recorded at each step, and read off the record.

Directions are those of `hcbench.impact.Launch`: along the way that the body is sent, across it, and along the
normal away from the plate.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.impact import ENERGY, FRICTION, SLIP, SPIN, Tangential

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.impact import Floats, Impact
    from hcbench.scene import Scene


def frame(deeper: Floats, along: Sequence[float] = (1.0, 0.0, 0.0)) -> Floats:
    """Unit vectors along, across and away from the plate, shape (..., 3, 3).

    deeper: unit vectors into the plate, shape (..., 3). along: any vector that is not normal to the plate.
    """
    up = -deeper
    ahead = np.asarray(along) - up * (up @ np.asarray(along))[..., None]
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    return np.stack([ahead, np.cross(up, ahead), up], axis=-2)


def rows_of_ball(scene: Scene, velocity: Floats, spin: Floats, deeper: Floats, gained: Floats) -> Floats:
    """The rows of `Record.tangential` of a scene's balls, shape (8, b, n).

    velocity, spin: of the centre at the start of each step, m/s and rad/s, shape (b, n, 3). deeper: unit
    vectors into the plate. gained: acceleration in the step without gravity's, m/s²; of the same shape.
    """
    sliding = velocity + np.cross(spin, scene.touch_radius * deeper)
    rate = (velocity * deeper).sum(axis=-1)
    energy = 0.5 * scene.mass * ((velocity**2).sum(axis=-1) - rate**2)
    energy += 0.5 * scene.inertia * (spin**2).sum(axis=-1)
    vectors = (sliding, spin, scene.mass * gained)
    slip, turning, push = (np.einsum("...ij,...j->i...", frame(deeper), vector) for vector in vectors)
    return np.concatenate([slip[:2], turning, push[:2], energy[None]])


def with_tangential(impact: Impact, rows: Floats, timestep: float, mass: float) -> Impact:
    """An impact with what it did along the plate; as it is where it was not measured or not sent obliquely.

    rows: of `Record.rows`, all steps of this launch, shape (11, n). mass: effective, along the normal, kg.
    """
    if not (impact.is_measured and impact.launch.is_oblique and len(rows) > 3):
        return impact
    force, along = rows[2], rows[3:]
    first = int((force != 0.0).argmax())
    stop = first + impact.samples
    before, after = along[:, first], along[:, min(stop, along.shape[1] - 1)]
    contact = slice(first, stop)
    energies = [
        float(state[ENERGY]) + 0.5 * mass * speed**2
        for state, speed in ((before, impact.speed_in), (after, impact.speed_out))
    ]
    return replace(
        impact,
        tangential=Tangential(
            slip_in=tuple(before[SLIP].tolist()),
            slip_out=tuple(after[SLIP].tolist()),
            spin_in=tuple(before[SPIN].tolist()),
            spin_out=tuple(after[SPIN].tolist()),
            impulse=tuple((timestep * along[FRICTION, contact].sum(axis=1)).tolist()),
            normal_impulse=float(timestep * force[contact].sum()),
            energy_in=energies[0],
            energy_out=energies[1],
        ),
    )
