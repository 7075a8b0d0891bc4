"""Engines whose faults are built in, and a verdict that is known.

All but the last have one ball over the floor. Each steps by semi-implicit Euler. They differ in when
they see the floor, and in what they do then.
"""

from __future__ import annotations

import math
from typing import Any


class OneBall:
    """A ball without friction; what it does at the floor is a subclass's."""

    version, combine = "1", "product"

    def __init__(self) -> None:
        self.name = type(self).__name__.lower()

    def make(self, world: dict[str, Any]) -> None:
        ball, *others = world["bodies"]
        if others or ball["shape"] != "sphere" or world["friction"]:
            raise NotImplementedError("has one ball without friction")
        self.h = world["timestep"]
        *_, self.g = world["gravity"]  # m/s², negative
        self.e = math.prod(world["materials"]) if "materials" in world else world["restitution"]
        self.x, self.y, self.z = ball["position"]
        *_, self.v = ball["velocity"]
        self.touch = ball["radius"]
        self.came = 0.0  # speed at which it met the floor, m/s; 0 away from it

    def step(self) -> None:
        before, self.v = self.v, self.v + self.g * self.h
        self._meet(before)
        self.z += self.v * self.h

    def _meet(self, before: float) -> None:
        """Change v where the ball meets the floor. before: v at the start of the step, m/s."""
        raise NotImplementedError

    def state(self) -> list[list[float]]:
        return [[self.x, self.y, self.z, 0.0, 0.0, self.v, 0.0, 0.0, 0.0]]


class Predictive(OneBall):
    """Turns the ball in the step that would end in the floor: above it, at e v exactly."""

    def _meet(self, before: float) -> None:
        if self.v < 0 and self.z + self.v * self.h < self.touch:
            self.v = self.e * max(0.0, -before)


class PredictiveAtTheEnd(OneBall):
    """Predictive by the other convention: e (v + g h)."""

    def _meet(self, before: float) -> None:
        if self.v < 0 and self.z + self.v * self.h < self.touch:
            self.v *= -self.e


class Late(OneBall):
    """Turns the ball a step after it ended in the floor, at e v exactly."""

    def _meet(self, before: float) -> None:
        if self.came and before < 0:
            self.v, self.came = self.e * -before, 0.0
        elif self.z < self.touch and before < 0:
            self.came = -before


class TwoStep(OneBall):
    """Stops the ball in the floor, and throws it back at e v a step later."""

    def _meet(self, before: float) -> None:
        if self.came:
            self.v, self.came = self.e * self.came, 0.0
        elif self.z < self.touch and before < 0:
            self.v, self.came = 0.0, -before


class Biased(OneBall):
    """Adds a fifth of the depth over the step to the rebound, as error reduction does."""

    def _meet(self, before: float) -> None:
        if self.z < self.touch and self.v < 0:
            self.v = self.e * max(0.0, -before) + 0.2 * (self.touch - self.z) / self.h


class Soft(OneBall):
    """A spring and damper of 20 steps, whose e is exact; it lets the ball into the floor.

    The motion within a step is x'' + 2 ζ ω x' + ω² x = g in closed form.
    """

    STEPS = 20

    def make(self, world: dict[str, Any]) -> None:
        super().make(world)
        # A ball without gravity leaves at x = 0, after half a turn, at exp(-π ζ/sqrt(1 - ζ²)).
        turn = math.pi / (self.STEPS * self.h)
        self.decay = -math.log(self.e) / math.pi * turn if self.e else 10 * turn
        self.omega = turn

    def step(self) -> None:
        if self.z >= self.touch:
            super().step()
            return
        rest = self.g / (self.omega**2 + self.decay**2)  # where gravity is carried, m
        x, v = self.z - self.touch - rest, self.v
        across = (v + self.decay * x) / self.omega
        shrink = math.exp(-self.decay * self.h)
        cos, sin = math.cos(self.omega * self.h), math.sin(self.omega * self.h)
        at = shrink * (x * cos + across * sin)
        self.v = shrink * self.omega * (across * cos - x * sin) - self.decay * at
        self.z = self.touch + rest + at

    def _meet(self, before: float) -> None:
        """Flight: the spring acts in `step`."""


class FallsThrough:
    """Bodies of any shape that nothing holds or stops: neither a floor, nor a body, nor a joint."""

    name, version, combine = "fallsthrough", "1", "product"
    STOPS_AT = -math.inf  # height of the centre at which a body stops for good, m

    def make(self, world: dict[str, Any]) -> None:
        self.h = world["timestep"]
        self.gravity = world["gravity"]
        moving = [body for body in world["bodies"] if not body.get("fixed")]
        self.bodies = [[*b["position"], *b["velocity"], *b["spin"]] for b in moving]

    def step(self) -> None:
        for body in self.bodies:
            for axis, g in enumerate(self.gravity):
                body[3 + axis] += g * self.h
                body[axis] += body[3 + axis] * self.h
            if body[2] < self.STOPS_AT:
                body[2], body[5] = self.STOPS_AT, 0.0

    def state(self) -> list[list[float]]:
        return self.bodies


class FallsThroughMeshes(FallsThrough):
    """A floor that stops each body of the cases with meshes, 50 mm high, and no contact of two."""

    STOPS_AT = 0.05
