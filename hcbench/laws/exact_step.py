"""The law of Hunt and Crossley over one time step of an engine.

A force F(x, v) sampled at the start of each step is of first order in the step. Its error is largest in the
steps in which the bodies touch and part, as the force begins or ends inside them. Here the motion itself,
eq. (16) with an effective mass m and a constant acceleration b of everything else that acts,

    x'' = b - κ x^n (1 + a x'),   κ = k/m,   a = (3/2) α,   no tension,   x > 0 in contact,

is advanced over the step, through touch and parting. The force is the one with which the engine's own update
arrives at the end of that motion. It depends on the engine's integrator:

Semi-implicit Euler, v' = v + h A, x' = x + h v'. Positions can be exact; the engine's v is then the mean rate
over the step before, (x - x_before)/h. So `euler_force` finds the motion through x_before = x - h v and x (a
secant search for the rate at x) and aims at its next position. In free flight v is the rate itself, so the
speeds before and after an impact are exact, whatever the step. Nothing is remembered between steps. The force
is the true one averaged over two steps with a triangle as weight: of second order within a contact.

Classical Runge-Kutta. v is the rate at the start, and the four stages see four forces: `rk4_stage_forces`
chooses them so that both sums which the method forms of them give the exact position and rate.

What is left is the error of advancing the motion: by a Taylor series of order 8 where touch and parting are
far away, else by RK4 in s = sqrt(time from touch), in which x^n is smooth, with eight sub-steps. The
restitution is of order h^2.5 or better in the step, down to the error of the sub-steps, near 1e-6.

Laws whose v_i is the touch speed of each impact are eq. (16) too: touch_speed.py finds a from the state. The
same lines in C are in exact_step.c; a test compares the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hcbench.laws._restitution_series import restitution_of
from hcbench.laws.touch_speed import touch_speed

_SUBSTEP = 0.2  # largest sub-step, in units of 1/ω
_SUBSTEPS_AT_TOUCH = 8  # of a piece of the motion that begins or ends at touch
_MAX_ITERATIONS = 16  # of the secant search; 2 or 3 are the rule
_TERMS = 8
_LEAST_SPEED = 1e-9  # m/s: slower impacts count as of this speed where a law depends on it
_FAR = 2.5  # steps away from touch and parting from which on the series is accurate


@dataclass(frozen=True, slots=True)
class ContactOde:
    """One contact's equation of motion.

    kappa: k/m, m^(1-n)/s². a: (3/2) α, s/m. n: exponent. b: acceleration by all else, towards contact, m/s².
    chi: if not 0, each impact has its own a = χ/v_i, and `a` is that of the present impact. e: what χ
    delivers. load: the constant part of b, which v_i is worked out with. speed_min: the least v_i, m/s.
    """

    kappa: float
    a: float
    n: float
    b: float = 0.0
    chi: float = 0.0
    e: float = 1.0
    load: float = 0.0
    speed_min: float = _LEAST_SPEED

    def acceleration(self, x: float, v: float) -> float:
        """x'' in m/s²."""
        push = 1.0 + self.a * v
        if x <= 0.0 or push <= 0.0:
            return self.b
        return float(self.b - self.kappa * x**self.n * push)

    def frequency(self, x: float) -> float:
        """ω of small motion about x, 1/s."""
        return math.sqrt(self.kappa * self.n * x ** (self.n - 1.0)) if x > 0.0 else 0.0

    def with_touch_speed(self, x: float, v: float) -> ContactOde:
        """The same with the a of the impact that is at x with rate v."""
        if self.chi == 0.0:
            return self
        return self.touching_at(touch_speed(self.kappa, self.n, self.chi, self.e, self.load, x, v))

    def touching_at(self, speed: float) -> ContactOde:
        """The same with the a of an impact that touches at `speed` m/s."""
        return replace(self, a=self.chi / max(speed, self.speed_min))

    def time_reversed(self) -> ContactOde:
        """The motion run backwards: it comes in with -e v_i."""
        return replace(self, a=-self.a, chi=-self.chi * self.e, speed_min=self.e * self.speed_min)

    def with_step(self, h: float) -> ContactOde:
        """The same for a step h in s: speeds below what the load adds in one step count as rest."""
        if self.chi == 0.0:
            return self
        return replace(self, speed_min=max(_LEAST_SPEED, h * abs(self.b)))

    def with_load(self, b: float) -> ContactOde:
        """The same with another acceleration b, m/s²."""
        return replace(self, b=b)


def touch_speed_ode(kappa: float, chi: float, n: float, b: float = 0.0) -> ContactOde:
    """The motion under a law with χ > 0 whose v_i is the touch speed of each impact; b is constant."""
    return ContactOde(kappa, 0.0, n, b, chi, float(restitution_of(np.asarray(chi))), b)


def advance(ode: ContactOde, time: float, x: float, v: float) -> tuple[float, float]:
    """The exact (x, v) after `time` >= 0 s, through touch and parting."""
    for _ in range(10_000):
        if not time > 0.0:
            break
        if x <= 0.0:
            free = _time_to_touch(ode, x, v)
            if not free < time:
                return x + (v + 0.5 * ode.b * time) * time, v + ode.b * time
            v, time, x = v + ode.b * free, time - free, 0.0
            if ode.chi != 0.0:
                ode = ode.touching_at(v)
            piece = _piece(ode, v * time + 0.5 * ode.b * time * time, time)
            if v > 0.0:
                x, v = _rk4_in_root_of_time(ode, x, v, 0.0, math.sqrt(piece), 1, _SUBSTEPS_AT_TOUCH)
            else:
                x, v = _rk4_in_time(ode, x, v, piece, _SUBSTEPS_AT_TOUCH)
            time -= piece
            continue
        piece = _piece(ode, x + (v * time if v > 0.0 else 0.0), time)
        near = x / abs(v) if v else math.inf  # time since touch, or to parting
        if v < 0.0 and near < 2.0 * piece:
            left, out = _part(ode, x, v)
            if 0.0 <= left <= time:
                x, v, time = 0.0, out, time - left
                continue
        if v > 0.0 and near < 1e6 * piece:
            ends = math.sqrt(near), math.sqrt(near + piece)
            x, v = _rk4_in_root_of_time(ode, x, v, *ends, 1, _substeps(near, piece))
        elif v < 0.0 and 1.01 * piece < near < 1e6 * piece:
            ends = math.sqrt(near), math.sqrt(near - piece)
            x, v = _rk4_in_root_of_time(ode, x, v, *ends, -1, _substeps(near - piece, piece))
        else:
            x, v = _rk4_in_time(ode, x, v, piece, _SUBSTEPS_AT_TOUCH if near < 1.01 * piece else 1)
        time -= piece
    return x, v


def euler_force(ode: ContactOde, h: float, x: float, v: float) -> float:
    """F/m >= 0 in m/s² for a step of semi-implicit Euler from x, with v = (x - x_before)/h."""
    before = x - h * v
    if x <= 0.0 and before <= 0.0 and x + h * (v + h * ode.b) <= 0.0:
        return 0.0
    after = two_point_solve(ode, h, before, x)[1]
    return max(0.0, ode.b - ((after - before) / h - 2.0 * v) / h)


def two_point_solve(ode: ContactOde, h: float, before: float, x: float) -> tuple[float, float]:
    """The motion that was at `before` h ago and is at x now: its rate now, and where it is h later."""
    v = (x - before) / h
    ode = ode.with_step(h).with_touch_speed(x, v)
    rate = h * h * ode.frequency(max(x, before)) ** 2
    V = v + 0.5 * h * ode.acceleration(x, v)
    V = v + 0.5 * h * ode.acceleration(x - h / 3.0 * V, V)
    smooth = x > _FAR * h * abs(V) and rate < 0.25 and 1.0 + ode.a * V > 0.5
    V0 = miss0 = after = 0.0
    last = math.inf
    for turn in range(_MAX_ITERATIONS):
        ode = ode.with_touch_speed(x, V)
        past, after = _series(ode, h, x, V) if smooth else (advance(ode.time_reversed(), h, x, -V)[0], x)
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
    return V, advance(ode, h, x, V)[0]


def rk4_stage_forces(ode: ContactOde, h: float, x: float, v: float) -> tuple[float, float, float]:
    """F/m >= 0 in m/s² at the first, the two middle and the last stage of RK4, from the true x and v."""
    if x <= 0.0 and x + h * (v + max(0.0, h * ode.b)) <= 0.0:
        return 0.0, 0.0, 0.0
    ode = ode.with_step(h).with_touch_speed(x, v)
    plain = ode.b - ode.acceleration(x, v)
    X, V = advance(ode, 0.5 * h, x, v)  # in halves: sub-steps of half the size
    X, V = advance(ode.with_touch_speed(X, V), 0.5 * h, X, V)
    moved = max(0.0, 6.0 / (h * h) * (x + h * (v + 0.5 * h * ode.b) - X))  # f1 + 2 f2
    slowed = max(moved, 6.0 / h * (v + h * ode.b - V))  # f1 + 4 f2 + f4
    first = min(max(plain, 2.0 * moved - slowed, 0.0), moved)
    return first, 0.5 * (moved - first), slowed - 2.0 * moved + first


def _piece(ode: ContactOde, x: float, time: float) -> float:
    """How much of `time` to advance at once, s: short against the oscillation about x."""
    rate = ode.frequency(x)
    return _SUBSTEP / rate if rate * time > _SUBSTEP else time


def _substeps(near: float, piece: float) -> int:
    """Sub-steps of a piece that is `near` s away from touch or parting."""
    ratio = near / piece
    return _SUBSTEPS_AT_TOUCH if ratio < 1.0 else 6 if ratio < 4.0 else 3 if ratio < 16.0 else 1


def _rk4_in_root_of_time(
    ode: ContactOde, x: float, v: float, s0: float, s1: float, sign: int, count: int
) -> tuple[float, float]:
    """RK4 in s with t = t0 + sign (s² - s0²): smooth through the x^n at touch."""
    ds = (s1 - s0) / count
    force = ode.acceleration
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


def _rk4_in_time(ode: ContactOde, x: float, v: float, time: float, count: int) -> tuple[float, float]:
    """RK4 in t, for where the body turns and any x."""
    dt = time / count
    force = ode.acceleration
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


def _part(ode: ContactOde, x: float, v: float) -> tuple[float, float]:
    """From x > 0, v < 0 to x = 0 by RK4 in sqrt(x): the time it takes, or -1 if it turns before; v there."""
    dy = -math.sqrt(x) / _SUBSTEPS_AT_TOUCH
    time = 0.0
    for i in range(_SUBSTEPS_AT_TOUCH, 0, -1):
        y = -i * dy
        middle, end = y + 0.5 * dy, -(i - 1) * dy
        k1 = 2.0 * y * ode.acceleration(y * y, v) / v
        V2 = v + 0.5 * dy * k1
        if V2 >= 0.0:
            return -1.0, v
        k2 = 2.0 * middle * ode.acceleration(middle * middle, V2) / V2
        V3 = v + 0.5 * dy * k2
        if V3 >= 0.0:
            return -1.0, v
        k3 = 2.0 * middle * ode.acceleration(middle * middle, V3) / V3
        V4 = v + dy * k3
        if V4 >= 0.0:
            return -1.0, v
        k4 = 2.0 * end * ode.acceleration(end * end, V4) / V4
        time += dy / 6.0 * (2.0 * y / v + 4.0 * middle / V2 + 4.0 * middle / V3 + 2.0 * end / V4)
        v += dy / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        if v >= 0.0:
            return -1.0, v
    return time, v


def _time_to_touch(ode: ContactOde, x: float, v: float) -> float:
    """Time until a body at x <= 0 touches, s; infinite if it never does."""
    b = ode.b
    if x == 0.0:
        if v > 0.0 or (v == 0.0 and b > 0.0):
            return 0.0
        return -2.0 * v / b if b > 0.0 else math.inf
    square = v * v - 2.0 * b * x
    total = v + math.sqrt(square) if square >= 0.0 else -1.0
    return -2.0 * x / total if total > 0.0 else math.inf


def _series(ode: ContactOde, h: float, x: float, v: float) -> tuple[float, float]:
    """Positions h before and h after by the Taylor series of the motion; touch and parting have to be far."""
    c, u = [x, v * h], [v]  # coefficients of x and v in powers of t/h
    y = [x**ode.n]  # and of x^n
    even, odd = x, c[1]
    for j in range(_TERMS - 1):
        if j:
            total = sum(((ode.n + 1.0) * i - j) * c[i] * y[j - i] for i in range(1, j + 1))
            y.append(total / x / j)
        damped = sum(y[i] * u[j - i] for i in range(j + 1))
        u.append(-ode.kappa * h * (y[j] + ode.a * damped) / (j + 1) + (ode.b * h if j == 0 else 0.0))
        c.append(u[j + 1] * h / (j + 2))
        if j % 2:
            odd += c[j + 2]
        else:
            even += c[j + 2]
    return even - odd, even + odd
