"""The law of Hunt and Crossley over one time step of an engine.

Sampling F(x, v) where a step starts is of first order and errs most where it matters: in the steps that touch
and part, whose force begins or ends inside. Here the motion itself, eq. (16) with an effective mass m and a
constant acceleration b of whatever else acts,

    x'' = b - κ x^n (1 + a x'),   κ = k/m,   a = (3/2) α,   no tension,   x > 0 in contact,

is advanced over the step, through touch and parting, and the force is the one that makes the engine's own
update land on it. What "land" means depends on the engine's integrator:

Semi-implicit Euler, v' = v + h A, x' = x + h v'. Positions can be exact, and then the engine's v is the mean
rate over the step before, (x - x_before)/h. So `kick` finds the motion through x_before = x - h v and x (a
secant search on the rate at x) and aims at its next position. In free flight v is the rate itself, so both
speeds of an impact are exact, whatever the step. It needs no memory: x and v say it all. The force is the
true one averaged over two steps with a triangle as weight, so within a loop it is of second order.

Classical Runge-Kutta. v is the rate at the start, and the four stages see four forces: `stages` chooses them
so that both sums which the method forms of them give the exact position and rate.

Left is the error of advancing the motion: a Taylor series of order 8 where touch and parting are far, else
RK4 in s = sqrt(time from touch), in which x^n is smooth, eight sub-steps a piece. Restitution is of order
h^2.5 or better in the step until sub-steps keep the error where it is, near 1e-6.

Laws whose v_i is each impact's own are eq. (16) too, with an a that own_speed.py finds from the state.

The same lines in C are in _law.c; a test holds the two together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hcbench.laws._series import restitution_of
from hcbench.laws.touch_speed import touch_speed

_SUBSTEP = 0.2  # largest sub-step, in units of 1/ω
_STEEP = 8  # sub-steps of a piece that begins or ends at touch
_ROUNDS = 16  # of the secant search; 2 or 3 are the rule
_TERMS = 8
_SLOWEST = 1e-9  # m/s: slower impacts count as of this speed where a law asks for it
_FAR = 2.5  # steps away from touch and parting, from where on the series is good


@dataclass(frozen=True, slots=True)
class Motion:
    """One contact's equation of motion.

    kappa: k/m, m^(1-n)/s². a: (3/2) α, s/m. n: exponent. b: acceleration by all else, towards contact, m/s².
    chi: where it is not 0, each impact has its own a = χ/v_i, and `a` is what it has just now. e: what χ
    delivers. load: the constant part of b, which v_i is worked out with. least: v_i at least, m/s.
    """

    kappa: float
    a: float
    n: float
    b: float = 0.0
    chi: float = 0.0
    e: float = 1.0
    load: float = 0.0
    least: float = _SLOWEST

    def acceleration(self, x: float, v: float) -> float:
        """x'' in m/s²."""
        push = 1.0 + self.a * v
        if x <= 0.0 or push <= 0.0:
            return self.b
        return float(self.b - self.kappa * x**self.n * push)

    def settled(self, x: float, v: float) -> Motion:
        """The motion of the impact that is at x with rate v: with its own a."""
        if self.chi == 0.0:
            return self
        speed = touch_speed(self.kappa, self.n, self.chi, self.e, self.load, x, v)
        return self._with(self.chi / max(speed, self.least), self.chi, self.least)

    def reversed(self) -> Motion:
        """The motion run backwards: it comes in with -e v_i."""
        return self._with(-self.a, -self.chi * self.e, self.e * self.least)

    def over(self, h: float) -> Motion:
        """The motion over a step: what all else adds to a speed in it is no impact that is told from rest."""
        if self.chi == 0.0:
            return self
        return self._with(self.a, self.chi, max(_SLOWEST, h * abs(self.b)))

    def under(self, b: float) -> Motion:
        """The same with another acceleration b, m/s²."""
        return Motion(self.kappa, self.a, self.n, b, self.chi, self.e, self.load, self.least)

    def _with(self, a: float, chi: float, least: float) -> Motion:
        return Motion(self.kappa, a, self.n, self.b, chi, self.e, self.load, least)

    def rate(self, x: float) -> float:
        """ω of small motion about x, 1/s."""
        return math.sqrt(self.kappa * self.n * x ** (self.n - 1.0)) if x > 0.0 else 0.0


def own_motion(kappa: float, chi: float, n: float, b: float = 0.0) -> Motion:
    """The motion under a law whose v_i is each impact's own, with its χ > 0; b all of it constant."""
    return Motion(kappa, 0.0, n, b, chi, float(restitution_of(np.asarray(chi))), b)


def flow(motion: Motion, time: float, x: float, v: float) -> tuple[float, float]:
    """The exact (x, v) after `time` >= 0 s, through touch and parting."""
    for _ in range(10_000):
        if not time > 0.0:
            break
        if x <= 0.0:
            free = _time_to_touch(motion, x, v)
            if not free < time:
                return x + (v + 0.5 * motion.b * time) * time, v + motion.b * time
            v, time, x = v + motion.b * free, time - free, 0.0
            if motion.chi != 0.0:
                motion = motion._with(motion.chi / max(v, motion.least), motion.chi, motion.least)
            piece = _piece(motion, v * time + 0.5 * motion.b * time * time, time)
            if v > 0.0:
                x, v = _advance(motion, x, v, 0.0, math.sqrt(piece), 1, _STEEP)
            else:
                x, v = _advance_plain(motion, x, v, piece, _STEEP)
            time -= piece
            continue
        piece = _piece(motion, x + (v * time if v > 0.0 else 0.0), time)
        near = x / abs(v) if v else math.inf  # time since touch, or to parting
        if v < 0.0 and near < 2.0 * piece:
            left, out = _part(motion, x, v)
            if 0.0 <= left <= time:
                x, v, time = 0.0, out, time - left
                continue
        if v > 0.0 and near < 1e6 * piece:
            ends = math.sqrt(near), math.sqrt(near + piece)
            x, v = _advance(motion, x, v, *ends, 1, _substeps(near, piece))
        elif v < 0.0 and 1.01 * piece < near < 1e6 * piece:
            ends = math.sqrt(near), math.sqrt(near - piece)
            x, v = _advance(motion, x, v, *ends, -1, _substeps(near - piece, piece))
        else:
            x, v = _advance_plain(motion, x, v, piece, _STEEP if near < 1.01 * piece else 1)
        time -= piece
    return x, v


def kick(motion: Motion, h: float, x: float, v: float) -> float:
    """F/m >= 0 in m/s² for a step of semi-implicit Euler from x, with v = (x - x_before)/h."""
    before = x - h * v
    if x <= 0.0 and before <= 0.0 and x + h * (v + h * motion.b) <= 0.0:
        return 0.0
    after = through(motion, h, before, x)[1]
    return max(0.0, motion.b - ((after - before) / h - 2.0 * v) / h)


def through(motion: Motion, h: float, before: float, x: float) -> tuple[float, float]:
    """The motion that is at `before` h ago and at x now: its rate now, and where it is h later."""
    v = (x - before) / h
    motion = motion.over(h).settled(x, v)
    rate = h * h * motion.rate(max(x, before)) ** 2
    V = v + 0.5 * h * motion.acceleration(x, v)
    V = v + 0.5 * h * motion.acceleration(x - h / 3.0 * V, V)
    smooth = x > _FAR * h * abs(V) and rate < 0.25 and 1.0 + motion.a * V > 0.5
    V0 = miss0 = after = 0.0
    last = math.inf
    for turn in range(_ROUNDS):
        motion = motion.settled(x, V)
        past, after = _series(motion, h, x, V) if smooth else (flow(motion.reversed(), h, x, -V)[0], x)
        miss = past - before
        slope = (miss - miss0) / (V - V0) if turn else -h * (1.0 - min(rate / 6.0, 0.5))
        if not slope < -0.1 * h:
            slope = -h
        V0, miss0 = V, miss
        V -= miss / slope
        change, scale = abs(V - V0), abs(V) + abs(v)
        if change * last <= 1e-9 * scale * scale or change <= 1e-13 * scale:
            break
        last = change
    if smooth:
        return V, after + (V - V0) * h * (1.0 - rate / 6.0)
    return V, flow(motion, h, x, V)[0]


def stages(motion: Motion, h: float, x: float, v: float) -> tuple[float, float, float]:
    """F/m >= 0 in m/s² at the first, the two middle and the last stage of RK4, from the true x and v."""
    if x <= 0.0 and x + h * (v + max(0.0, h * motion.b)) <= 0.0:
        return 0.0, 0.0, 0.0
    motion = motion.over(h).settled(x, v)
    plain = motion.b - motion.acceleration(x, v)
    X, V = flow(motion, 0.5 * h, x, v)  # in halves: sub-steps of half the size
    X, V = flow(motion.settled(X, V), 0.5 * h, X, V)
    moved = max(0.0, 6.0 / (h * h) * (x + h * (v + 0.5 * h * motion.b) - X))  # f1 + 2 f2
    slowed = max(moved, 6.0 / h * (v + h * motion.b - V))  # f1 + 4 f2 + f4
    first = min(max(plain, 2.0 * moved - slowed, 0.0), moved)
    return first, 0.5 * (moved - first), slowed - 2.0 * moved + first


def _piece(motion: Motion, x: float, time: float) -> float:
    rate = motion.rate(x)
    return _SUBSTEP / rate if rate * time > _SUBSTEP else time


def _substeps(near: float, piece: float) -> int:
    ratio = near / piece
    return _STEEP if ratio < 1.0 else 6 if ratio < 4.0 else 3 if ratio < 16.0 else 1


def _advance(
    motion: Motion, x: float, v: float, s0: float, s1: float, sign: int, count: int
) -> tuple[float, float]:
    """RK4 in s with t = t0 + sign (s² - s0²): smooth through the x^n at touch."""
    ds = (s1 - s0) / count
    force = motion.acceleration
    for i in range(count):
        w1 = 2.0 * sign * (s0 + i * ds)
        w2, w4 = w1 + sign * ds, w1 + 2.0 * sign * ds
        x1, v1 = w1 * v, w1 * force(x, v)
        V2 = v + 0.5 * ds * v1
        x2, v2 = w2 * V2, w2 * force(x + 0.5 * ds * x1, V2)
        V3 = v + 0.5 * ds * v2
        x3, v3 = w2 * V3, w2 * force(x + 0.5 * ds * x2, V3)
        V4 = v + ds * v3
        x4, v4 = w4 * V4, w4 * force(x + ds * x3, V4)
        x += ds / 6.0 * (x1 + 2.0 * x2 + 2.0 * x3 + x4)
        v += ds / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4)
    return x, v


def _advance_plain(motion: Motion, x: float, v: float, time: float, count: int) -> tuple[float, float]:
    """RK4 in t: where the body turns, and x may be anything."""
    dt = time / count
    force = motion.acceleration
    for _ in range(count):
        v1 = force(x, v)
        V2 = v + 0.5 * dt * v1
        v2 = force(x + 0.5 * dt * v, V2)
        V3 = v + 0.5 * dt * v2
        v3 = force(x + 0.5 * dt * V2, V3)
        V4 = v + dt * v3
        v4 = force(x + dt * V3, V4)
        x += dt / 6.0 * (v + 2.0 * V2 + 2.0 * V3 + V4)
        v += dt / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4)
    return x, v


def _part(motion: Motion, x: float, v: float) -> tuple[float, float]:
    """From x > 0, v < 0 to x = 0, in y = sqrt(x): the time it takes, or -1 if it turns before; v there."""
    dy = -math.sqrt(x) / _STEEP
    time = 0.0
    for i in range(_STEEP, 0, -1):
        y = -i * dy
        middle, end = y + 0.5 * dy, -(i - 1) * dy
        k1 = 2.0 * y * motion.acceleration(y * y, v) / v
        V2 = v + 0.5 * dy * k1
        if V2 >= 0.0:
            return -1.0, v
        k2 = 2.0 * middle * motion.acceleration(middle * middle, V2) / V2
        V3 = v + 0.5 * dy * k2
        if V3 >= 0.0:
            return -1.0, v
        k3 = 2.0 * middle * motion.acceleration(middle * middle, V3) / V3
        V4 = v + dy * k3
        if V4 >= 0.0:
            return -1.0, v
        k4 = 2.0 * end * motion.acceleration(end * end, V4) / V4
        time += dy / 6.0 * (2.0 * y / v + 4.0 * middle / V2 + 4.0 * middle / V3 + 2.0 * end / V4)
        v += dy / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        if v >= 0.0:
            return -1.0, v
    return time, v


def _time_to_touch(motion: Motion, x: float, v: float) -> float:
    b = motion.b
    if x == 0.0:
        if v > 0.0 or (v == 0.0 and b > 0.0):
            return 0.0
        return -2.0 * v / b if b > 0.0 else math.inf
    square = v * v - 2.0 * b * x
    total = v + math.sqrt(square) if square >= 0.0 else -1.0
    return -2.0 * x / total if total > 0.0 else math.inf


def _series(motion: Motion, h: float, x: float, v: float) -> tuple[float, float]:
    """Where touch and parting are far, the motion is its Taylor series: positions h before and h after."""
    c, u = [x, v * h], [v]  # coefficients of x and v in powers of t/h
    y = [x**motion.n]  # and of x^n
    even, odd = x, c[1]
    for j in range(_TERMS - 1):
        if j:
            total = sum(((motion.n + 1.0) * i - j) * c[i] * y[j - i] for i in range(1, j + 1))
            y.append(total / x / j)
        damped = sum(y[i] * u[j - i] for i in range(j + 1))
        u.append(-motion.kappa * h * (y[j] + motion.a * damped) / (j + 1) + (motion.b * h if j == 0 else 0.0))
        c.append(u[j + 1] * h / (j + 2))
        if j % 2:
            odd += c[j + 2]
        else:
            even += c[j + 2]
    return even - odd, even + odd
