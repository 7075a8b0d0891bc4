"""Single bounces: a body is launched so that it meets the plate as
measured, and its motion after is read.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hcbench.reality.motion import lowest, quaternions, rotation
from hcbench.sim.toss import (
    GRAVITY,
    POSITION,
    QUATERNION,
    SPIN,
    VELOCITY,
    Body,
    ContactSetting,
    Toss,
    TossModule,
)
from hcbench.terms.impact import Floats

# Steps of flight before the touch; the phase adds up to one more.
_BACK = 1.5


@dataclass(frozen=True, slots=True)
class MeasuredBounces:
    """Velocities (m/s) and spins (rad/s) at the touch, before and after,
    shape (n, 3), and attitudes (n, 4).

    What was not measured after is NaN.

    numbers: which of the data set, shape (n,).
    """

    numbers: Floats
    attitude: Floats
    velocity: Floats
    spin: Floats
    velocity_after: Floats
    spin_after: Floats

    def __len__(self) -> int:
        return len(self.numbers)

    def of(self, keep: NDArray[np.bool_]) -> "MeasuredBounces":
        """The bounces that a mask keeps."""
        return MeasuredBounces(
            self.numbers[keep], self.attitude[keep], self.velocity[keep], self.spin[keep],
            self.velocity_after[keep], self.spin_after[keep],
        )  # fmt: skip


def bounced(
    module: TossModule,
    setting: ContactSetting,
    values: Sequence[float],
    body: Body,
    bounces: MeasuredBounces,
    timestep: float,
    duration: float,
) -> tuple[Floats, Floats]:
    """Velocities (m/s) and spins (rad/s) with which an engine's bodies
    leave the plate, shape (n, 3) each.
    """
    tosses = _launches(body, bounces, timestep, duration)
    return _after(body, module.simulate(body, setting, values, timestep, tosses), timestep)


def _launches(body: Body, bounces: MeasuredBounces, timestep: float, duration: float) -> list[Toss]:
    """Tosses that begin a step or two before the touch, each in another phase of the step.

    timestep, duration: s. The state at the touch is followed back through free flight.
    """
    phases = np.random.default_rng(0).random(len(bounces))
    tosses = []
    for i, phase in enumerate(phases):
        back = (_BACK + phase) * timestep
        turn = Rotation.from_rotvec(-back * bounces.spin[i]) * rotation(bounces.attitude[i])
        height = -float(lowest(body, np.zeros(3), bounces.attitude[i]))
        velocity = bounces.velocity[i] + [0.0, 0.0, GRAVITY * back]
        place = np.array([0.0, 0.0, height - 0.5 * GRAVITY * back**2]) - back * bounces.velocity[i]
        steps = int(duration / timestep)
        tosses.append(Toss(place, quaternions(turn), velocity, bounces.spin[i], steps))
    return tosses


def _after(body: Body, simulated: Sequence[Floats], timestep: float) -> tuple[Floats, Floats]:
    """Velocities and spins where bodies leave the plate, shape (n, 3) each.

    One that has not left at the end has the velocity along the plate of
    the last step, and none upwards.
    """
    velocities = []
    spins = []
    for states in simulated:
        height = lowest(body, states[:, POSITION], states[:, QUATERNION])
        clear = (height > 0.0) & (states[:, VELOCITY][:, 2] > 0.0)
        clear[0] = False
        if clear.any():
            k = int(np.argmax(clear))
            rise = height[k] - height[k - 1]
            # How much of a step ago it was at the plate: gravity has slowed it since.
            share = float(np.clip(height[k] / rise, 0.0, 1.0)) if rise > 0.0 else 0.0
            velocities.append(states[k, VELOCITY] + [0.0, 0.0, GRAVITY * (timestep * share)])
        else:
            k = len(states) - 1
            velocities.append(states[k, VELOCITY] * [1.0, 1.0, 0.0])
        spins.append(states[k, SPIN])
    return np.array(velocities), np.array(spins)
