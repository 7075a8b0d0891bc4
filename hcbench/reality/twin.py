"""Synthetic twins of measured tosses: the same starts under a known law, with
the measured noise, as motions.

What a reading finds in a twin, whose law is known, says what the same reading of the data is worth.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from hcbench.reality.impacts import POSITION_NOISE, ROTATION_NOISE
from hcbench.reality.motion import Motion, at_times, motion, quaternions, rotation
from hcbench.sim.toss import Body, ContactSetting, TossModule

TIMESTEP = 2.5e-4  # s


def twins(
    module: TossModule, body: Body, setting: ContactSetting, values: Sequence[float],
    motions: Sequence[Motion], timestep: float = TIMESTEP, seed: int = 3,
) -> list[Motion]:  # fmt: skip
    """A twin of each motion, by an engine's setting whose law is exact."""
    noise = np.random.default_rng(seed)
    tosses = [each.toss(timestep) for each in motions]
    made = []
    for measured, states in zip(
        motions, module.simulate(body, setting, values, timestep, tosses), strict=True
    ):
        place, turn = at_times(states, timestep, measured.time - measured.time[0])
        place = place + noise.normal(0.0, POSITION_NOISE, place.shape)
        shaken = Rotation.from_rotvec(noise.normal(0.0, ROTATION_NOISE, place.shape)) * rotation(
            turn
        )
        made.append(motion(measured.number, body, measured.time, place, quaternions(shaken)))
    return made
