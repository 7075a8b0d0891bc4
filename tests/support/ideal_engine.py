"""An engine without an error: exact flight between impacts that are
integrated; another route to true values.

An impact of balls is a stiff spring and damper with Coulomb's friction, integrated through the
contact. Boxes rest where forces of the corners within the cones of friction can carry them, found
by linear programming, and bounce by the least impulses of the corners that turn their speeds round.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog, lsq_linear

Floats = NDArray[np.float64]
UP = np.array([0.0, 0.0, 1.0])
_STEPS = 600  # of an impact
_QUIET = 1e-9  # m/s


@cache
def damping_ratio(e: float) -> float:
    """Damping of a spring and damper that parts with e at zero force, by bisection on its motion."""
    low, high = 0.0, 0.999
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if _leaves(middle) > e else (low, middle)
    return low


@cache
def _leaves(ratio: float) -> float:
    x, v, dt = 0.0, 1.0, 1e-3
    while ratio * 2 * v + x > 0 or v > 0:
        v -= dt * (2 * ratio * v + x)
        x += dt * v
    return -v


def _as_box(body: dict[str, Any]) -> dict[str, Any]:
    """A body whose mesh is that of a box, as the box."""
    if body["shape"] != "mesh":
        return body
    return {
        **body,
        "shape": "box",
        "half": [max(along) for along in zip(*body["vertices"], strict=True)],
    }


class Ideal:
    name, version, combine = "ideal", "1", "product"

    def make(self, world: dict[str, Any]) -> None:
        self.h, self.g = world["timestep"], np.array(world["gravity"])
        e = math.prod(world["materials"]) if "materials" in world else world["restitution"]
        self.e, self.ratio, self.friction, self.floor = (
            e,
            damping_ratio(e),
            world["friction"],
            world["floor"],
        )
        bodies = [_as_box(body) for body in world["bodies"]]
        moving = [body for body in bodies if not body.get("fixed")]
        self.fixed = [body for body in bodies if body.get("fixed")]
        # A box that lies on the floor hands what falls on it to the floor, with restitution 0.
        self.lying = moving[1:] if bodies[0]["shape"] != "sphere" else []
        self.fixed += self.lying
        moving = moving[: len(moving) - len(self.lying)]
        self.x, self.v, self.w = (
            np.array([b[k] for b in moving], float) for k in ("position", "velocity", "spin")
        )
        self.mass, self.bodies = np.array([b["mass"] for b in moving]), moving
        self.carried = False
        self.round = all(b["shape"] == "sphere" for b in moving)

    def step(self) -> None:
        left = self.h
        while left > 0.0:
            if self._resting():
                return self._rest(left)
            times = [(t, pair) for pair in self._pairs() if (t := self._touch(*pair)) <= left]
            until = min((t for t, _ in times), default=left)
            self.x = self.x + self.v * until + self.g * until**2 / 2
            self.v = self.v + self.g * until
            left -= until
            if not times:
                return None
            a, b = min(times)[1]
            if self.round:
                self._collide(a, b)
            else:
                self._bounce_box()
        return None

    def state(self) -> list[list[float]]:
        moving = [[*x, *v, *w] for x, v, w in zip(self.x, self.v, self.w, strict=True)]
        return moving + [[*body["position"], *[0.0] * 6] for body in self.lying]

    def _pairs(self) -> list[tuple[int, int]]:
        count = len(self.x)
        balls = [(a, b) for a in range(count) for b in range(a + 1, count)]
        return balls + [(a, -1) for a in range(count)] * (self.floor or bool(self.fixed))

    def _height(self, a: int) -> float:
        size = self.bodies[a].get("radius") or self.bodies[a]["half"][2]
        below = max((b["position"][2] + b["half"][2] for b in self.fixed), default=0.0)
        return float(self.x[a][2] - size - below)

    def _touch(self, a: int, b: int) -> float:
        """Time to the touch; infinite where they part."""
        if b < 0:
            gap, speed, g = self._height(a), -self.v[a][2], -self.g[2]
            if g == 0.0:
                return gap / speed if speed > 0 and gap > -1e-12 else math.inf
            if gap <= 1e-15 and speed > 0:
                return 0.0
            t = (-speed + math.sqrt(max(0.0, speed**2 + 2 * g * gap))) / g
            return float(t) if t > 1e-12 else math.inf
        apart, speed = self.x[b] - self.x[a], self.v[a] - self.v[b]
        distance = float(np.linalg.norm(apart))
        gap = distance - self.bodies[a]["radius"] - self.bodies[b]["radius"]
        closing = float(speed @ apart) / distance
        return gap / closing if closing > _QUIET and gap > -1e-9 else math.inf

    def _collide(self, a: int, b: int) -> None:
        """Integrate an impact, in time in which the spring alone would turn by a radian."""
        n = UP if b < 0 else (self.x[a] - self.x[b]) / np.linalg.norm(self.x[a] - self.x[b])
        shares = np.array([1 / self.mass[a], 0.0 if b < 0 else 1 / self.mass[b]])
        radius, x, dt = self.bodies[a]["radius"], 0.0, 2 * math.pi / _STEPS
        effective, pressed = 1 / shares.sum(), True
        if b < 0 and not self.friction:  # the spring and damper are linear: all speeds leave alike
            self.v[a] -= (1 + _leaves(self.ratio)) * (self.v[a] @ n) * n
            pressed = False
        while pressed:
            relative = self.v[a] - self._of(self.v, b)
            closing = -relative @ n
            force = effective * (2 * self.ratio * closing + x)  # the spring's rate is 1
            pressed = closing > 0.0 or (force > 0.0 and self.e > 0.0)
            slip = relative + closing * n - radius * np.cross(self.w[a] + self._of(self.w, b), n)
            speed = np.linalg.norm(slip)
            most = speed * effective * 2 / 7 / dt  # of friction: what stops the slip within dt
            along = (
                -slip / speed * min(self.friction * max(force, 0.0), most) if speed > 0 else 0 * n
            )
            self.v[a] += dt * shares[0] * (max(force, 0.0) * n + along)
            self.w[a] += dt * np.cross(-radius * n, along) * 2.5 * shares[0] / radius**2
            if b >= 0:
                self.v[b] -= dt * shares[1] * (max(force, 0.0) * n + along)
            x += dt * float(-(self.v[a] - self._of(self.v, b)) @ n)
        if self.e == 0.0 or (b < 0 and self.v[a] @ n < 0.05 * self.h * np.linalg.norm(self.g)):
            self.v[a] -= (self.v[a] @ n) * n

    def _of(self, values: Floats, b: int) -> Floats:
        return np.zeros(3) if b < 0 else values[b]

    def _bounce_box(self) -> None:
        """The least impulses of the corners that turn their speeds into -e times as much."""
        arms, inverse = self._corners()
        normal = np.array([[*UP, *np.cross(arm, UP)] for arm in arms])
        speeds = normal @ np.concatenate([self.v[0], self.w[0]])
        impulses = lsq_linear(
            normal @ inverse @ normal.T, -(1 + self.e) * speeds, bounds=(0, np.inf)
        ).x
        change = inverse @ normal.T @ impulses
        self.v[0], self.w[0] = self.v[0] + change[:3], self.w[0] + change[3:]

    def _corners(self) -> tuple[Floats, Floats]:
        half, mass = np.array(self.bodies[0]["half"]), self.mass[0]
        low = np.minimum(half, self.fixed[0]["half"]) if self.fixed else half
        arms = np.array([[sx * low[0], sy * low[1], -half[2]] for sx in (-1, 1) for sy in (-1, 1)])
        inertia = mass / 3 * (half @ half - half**2)
        return arms, np.diag(1 / np.array([mass] * 3 + [*inertia]))

    def _resting(self) -> bool:
        pressed = self.floor and len(self.x) == 1 and self.g[2] < 0 and abs(self._height(0)) < 1e-12
        return bool(pressed and abs(self.v[0][2]) < 1e-6)

    def _rest(self, left: float) -> None:
        """On the floor: a ball slides and rolls by Coulomb's friction; a
        box stays if corners carry it.
        """
        if not self.round:
            self.carried = self.carried or self._carried()
            assert self.carried
            return
        for _ in range(2):
            slip = self.v[0] - self.bodies[0]["radius"] * np.cross(self.w[0], UP)
            slip[2], dt = 0.0, left / 2
            speed = np.linalg.norm(slip)
            if speed > 0:
                impulse = -slip / speed * min(-self.friction * self.g[2] * dt, speed * 2 / 7)
                self.v[0] += impulse
                self.w[0] += np.cross(-UP, impulse) * 2.5 / self.bodies[0]["radius"]
            self.x[0] += dt * self.v[0] * (1, 1, 0)
        self.v[0][2] = 0.0

    def _carried(self) -> bool:
        """Say whether forces of the corners, within cones of friction of
        eight edges, balance the weight.
        """
        arms, _ = self._corners()
        angles = [k * math.pi / 4 for k in range(8)]
        edges = [
            np.array([self.friction * math.cos(a), self.friction * math.sin(a), 1.0])
            for a in angles
        ]
        columns = np.array([[*edge, *np.cross(arm, edge)] for arm in arms for edge in edges]).T
        weight = np.array([*(self.mass[0] * self.g), 0.0, 0.0, 0.0])
        return bool(linprog(np.ones(columns.shape[1]), A_eq=columns, b_eq=-weight).success)
