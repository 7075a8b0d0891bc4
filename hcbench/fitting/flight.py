"""A ball between two touches, with quadratic drag, buoyancy and added mass in closed form.

With V the terminal speed, g' the acceleration of a start from rest and u = w/V for a
launch speed w: time aloft (V/g')(atan u + asinh u), speed at the next touch
w/sqrt(1 + u²), apex (V²/2g') ln(1 + u²).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats

# Density of air at 20 °C and 101325 Pa, kg/m³.
AIR_DENSITY = 1.204
# Drag of a sphere at Reynolds numbers from 1e3 to 1e5.
DRAG_COEFFICIENT = 0.47
DRAG_COEFFICIENT_UNCERTAINTY = 0.05
# The lightest ball that a user need not give: of table tennis, kg and m.
LIGHTEST = 2.7e-3
DIAMETER_OF_LIGHTEST = 40e-3
# Newton's steps from a flight's time to its launch: 1e-12 of a balloon's.
_STEPS_TO_LAUNCH = 12


@dataclass(frozen=True, slots=True)
class Ballistics:
    """Vertical flight under gravity, in air or in a vacuum.

    gravity: g', m/s².
    drag: 1/V², s²/m²; 0 in a vacuum.
    """

    gravity: float
    drag: float = 0.0

    def aloft(self, launch: float) -> tuple[float, float]:
        """Time to the next touch, s, and its derivative by the launch speed (m/s)."""
        if not self.drag:
            return 2.0 * launch / self.gravity, 2.0 / self.gravity
        u = launch * math.sqrt(self.drag)
        time = (math.atan(u) + math.asinh(u)) / (self.gravity * math.sqrt(self.drag))
        return time, (1.0 / (1.0 + u * u) + 1.0 / math.sqrt(1.0 + u * u)) / self.gravity

    def launch(self, time: float) -> float:
        """Launch speed, m/s, of a flight that lasts so long, s, up to the next touch."""
        speed = 0.5 * self.gravity * time
        # A flight grows ever more slowly with its launch: each step of Newton's stays below the root.
        for _ in range(_STEPS_TO_LAUNCH if self.drag else 0):
            now, slope = self.aloft(speed)
            speed += (time - now) / slope
        return speed

    def launch_to(self, height: Floats) -> Floats:
        """Launch speeds, m/s, that reach these heights over the launch, m: both (n,).

        The inverse of `apex`: v² = 2 g' h, in air (exp(2 g' h/V²) - 1) V².
        """
        if not self.drag:
            return np.sqrt(2.0 * self.gravity * height)
        return np.sqrt(np.expm1(2.0 * self.drag * self.gravity * height) / self.drag)

    def touch(self, launch: float) -> tuple[float, float]:
        """Speed at the next touch, m/s, and its derivative by the launch speed (m/s)."""
        root = 1.0 / math.sqrt(1.0 + self.drag * launch * launch)
        return launch * root, root**3

    def apex(self, launch: float) -> tuple[float, float]:
        """Height of the flight, m, and its derivative by the launch speed (m/s)."""
        square = launch * launch
        if not self.drag:
            return square / (2.0 * self.gravity), launch / self.gravity
        height = math.log1p(self.drag * square) / (2.0 * self.drag * self.gravity)
        return height, launch / (self.gravity * (1.0 + self.drag * square))

    def dropped(self, height: float) -> tuple[float, float]:
        """Speed at touch of a ball let go at a height (m), m/s, and its derivative by the height."""
        if not self.drag:
            speed = math.sqrt(2.0 * self.gravity * height)
        else:
            speed = math.sqrt(-math.expm1(-2.0 * self.drag * self.gravity * height) / self.drag)
        return speed, self.gravity / speed * (1.0 - self.drag * speed * speed)

    def path(self, launch: float, time: Floats) -> tuple[Floats, Floats, Floats]:
        """A flight at times since its launch, s, shape (n,).

        launch: speed upwards, m/s.
        Returns heights over the launch, m; their derivatives by the launch speed, s; velocities
        upwards, m/s; of shape (n,) each. Nothing stops the ball: after the touch heights are below
        0.
        """
        g = self.gravity
        if not self.drag:
            return launch * time - 0.5 * g * time**2, time.copy(), launch - g * time
        v = 1.0 / math.sqrt(self.drag)
        u = launch / v
        up = v / g * math.atan(u)
        rising = np.minimum(time, up)
        falling = np.maximum(time - up, 0.0)
        angle = math.atan(u) - g * rising / v
        fallen = g * falling / v
        height = (
            v * v / g * (np.log(np.cos(angle) * math.sqrt(1.0 + u * u)) - np.log(np.cosh(fallen)))
        )
        slope = np.where(time < up, -np.tan(angle), np.tanh(fallen))
        return height, v / g * (u + slope) / (1.0 + u * u), -v * slope

    def fall(self, touch: float, before: Floats) -> tuple[Floats, Floats, Floats]:
        """A fall from rest at times before its touch, s, shape (n,); times below 0 are after it.

        touch: speed at the touch, m/s.
        Returns heights over the touch, m; their derivatives by that speed, s; velocities upwards,
        m/s. Before its release the ball is at rest with drag; without drag the parabola goes on.
        """
        g = self.gravity
        if not self.drag:
            return touch * before - 0.5 * g * before**2, before.copy(), g * before - touch
        v = 1.0 / math.sqrt(self.drag)
        end = math.atanh(min(touch / v, 1.0 - 1e-12))
        now = np.maximum(end - g * before / v, 0.0)
        height = v * v / g * (math.log(math.cosh(end)) - np.log(np.cosh(now)))
        by_touch = v / g * (math.tanh(end) - np.tanh(now)) / (1.0 - math.tanh(end) ** 2)
        return height, by_touch, -v * np.tanh(now)


def in_air(gravity: float, mass: float, diameter: float, drag_coefficient: float) -> Ballistics:
    """Flight of a ball of this mass (kg) and diameter (m) in air, under `gravity` (m/s²).

    Buoyancy takes off the weight of the air displaced; half its mass is accelerated along. A ball
    lighter than that air is not refused here: its drag is below 0.
    """
    displaced = AIR_DENSITY * math.pi / 6.0 * diameter**3
    pull = gravity * (mass - displaced) / (mass + 0.5 * displaced)
    area = math.pi / 4.0 * diameter**2
    terminal_squared = 2.0 * (mass - displaced) * gravity / (AIR_DENSITY * drag_coefficient * area)
    return Ballistics(pull, 1.0 / terminal_squared)
