"""A spring row and a damper row of MuJoCo between a body and a plate, stepped as MuJoCo steps them.

Sections are those of MuJoCo's documentation.
"""

from __future__ import annotations

import ctypes
import functools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.recipes.common import SPRING_SOLIMP
from hcbench.engines.mujoco.scene.rows import MIN_IMPEDANCE, ConstraintRow
from hcbench.system.compiler import build
from hcbench.system.errors import HcbenchError
from hcbench.terms.impact import Floats

# Weight of the spring in MuJoCo's sums.
_WEIGHT = MIN_IMPEDANCE / (1 - MIN_IMPEDANCE)
# More than any contact asks for, N.
MOST_PULL = 1e6
# Power of the damper's solimp: others do no better.
POWER = 4.0
# Largest penetration, in v h at the top of the band.
_DEEPEST = 2.4
# Half periods of the spring for which a launch is followed.
_FOLLOWED = 3.0
# A larger e adds so much of what is above it to the error: so none of 40 drops bounces on.
LARGEST_E = 0.995
COSTS = 20.0


def short(number: float) -> float:
    """Six digits, as a model is written with."""
    return float(f"{number:.6g}")


def oscillator(steps: Any, damping: Any) -> tuple[Any, Any]:
    """(K h², D h) of a spring and damper with a half period of `steps` Euler steps.

    damping: D h.
    """
    c = 1.0 - damping
    return 1.0 + c - 2.0 * np.sqrt(c) * np.cos(np.pi / steps), damping


class _Rows(NamedTuple):
    """Spring and damper rows of one launch each, shape (m,); times in steps h, lengths in v h.

    Symbols of MuJoCo's documentation, Modeling, "Solver parameters": k and b of its section
    "Reference" (the direct format), d(r) and solimp's numbers of "Impedance".
    """

    # w k h² of the spring, w = d/(1 - d) its constant weight
    stiffness: Floats
    # w b h of the spring
    damping: Floats
    # b h of the damper: solref's damping over dmax
    damper: Floats
    # solimp's largest impedance of the damper, 0 ... 1
    dmax: Floats
    # over v h
    width: Floats
    # share of the width at which the sigmoid has its middle
    midpoint: Floats
    # (dmax - dmin)/midpoint^(power - 1), of the sigmoid up to its midpoint
    rise: Floats
    # (dmax - dmin)/(1 - midpoint)^(power - 1), of the sigmoid from there on
    level: Floats

    def of(self, which: Any) -> _Rows:
        """The rows of some of the launches."""
        return _Rows(*(column.take(which) for column in self))

    def impedance(self, penetration: Floats) -> Floats:
        """Impedance d(r) of the damper rows, (m,): a sigmoid of the power 4 from MuJoCo's least to
        dmax, which is reached at the width.

        penetration: r, in v h, (m,), the unit of the widths, too.
        """
        u = np.clip(penetration / self.width, 0.0, 1.0)
        early = u <= self.midpoint
        sigmoid = np.where(early, u, 1.0 - u)
        sigmoid *= sigmoid
        # Twice squared: to the power of 4, `POWER`.
        sigmoid *= sigmoid
        sigmoid *= np.where(early, self.rise, self.level)
        return np.where(early, MIN_IMPEDANCE + sigmoid, self.dmax - sigmoid)


class RowNumbers(NamedTuple):
    """Numbers of the two rows for p points of the search, (p,) each; times in steps h, lengths in
    v h.

    stiffness, spring_damping: K h² and D h of the spring.
    damping: D h of the damper.
    dmax, width, midpoint: of the damper's solimp; width over v h.
    """

    stiffness: Floats
    spring_damping: Floats
    damping: Floats
    dmax: Floats
    width: Floats
    midpoint: Floats


@dataclass(frozen=True, slots=True)
class RowFit:
    """Goal of a fit of spring and damper rows, in units of the step h and
    the band's highest speed v.

    speeds: over v.
    phases: where in a step the contact starts.
    target: e, NaN where any e will do that gains no energy; shape (n,) each.
    fall: g h / v.
    corners: of a body that meet at once, or how much more a row does there than on a ball.
    adhesive: whether the damper may pull.
    rk4: the integrator, else Euler's.
    lowest, highest: bounds.
    """

    speeds: Floats
    phases: Floats
    target: Floats
    fall: float
    corners: float
    adhesive: bool
    rk4: bool
    lowest: Floats
    highest: Floats

    def numbers(self, parameters: Floats) -> RowNumbers:
        """Numbers of the two rows for p points of the search.

        parameters: (p, 6): half period of the spring in steps, logarithms of the loss of the spring
        and of the damper's four numbers; those outside the bounds are put on them.
        """
        inside = np.clip(parameters, self.lowest, self.highest).T
        spring_damping, damping, dmax, width, midpoint = np.exp(inside[1:])
        stiffness, spring_damping = oscillator(inside[0], spring_damping)
        return RowNumbers(
            stiffness / self.corners,
            spring_damping / self.corners,
            damping,
            dmax,
            width,
            midpoint,
        )

    def errors(self, parameters: Floats, limits: Floats) -> Floats:
        """Error of each of p settings, (p,): the largest error of e over the launches, plus
        penalties.

        parameters: (p, 6), half period in steps and logs of the rest. The penalties are the depth
        beyond the one that is allowed, and a large multiple of what the largest e is above 0.995
        and the target's, so that a setting that gains energy is never the best.
        limits: (p,); of a setting whose error is above its limit, any number above that limit will
        do: C stops there, NumPy computes all.
        """
        numbers = self.numbers(parameters)
        library = _library()
        if library is None:
            return self._errors(numbers)
        errors = np.empty(len(parameters))
        columns = np.stack(self._columns(numbers), axis=1)
        limits = np.ascontiguousarray(limits, dtype=np.float64)
        arrays = (columns.ctypes.data, len(columns), limits.ctypes.data, errors.ctypes.data)
        library.row_errors(ctypes.byref(_Goal.of(self)), *arrays)
        return errors

    @property
    def largest_e(self) -> float:
        """e from which on a launch counts as gaining energy: an error that grows with what is above."""
        return max(LARGEST_E, float(np.nanmax(self.target)))

    @property
    def followed(self) -> int:
        """Steps for which a launch is followed."""
        return int(_FOLLOWED * self.highest[0])

    def _errors(self, numbers: RowNumbers) -> Floats:
        """Error of each of p settings by NumPy, where there is no library in C, (p,).

        numbers: of the rows of each setting.
        """
        e, deepest = self._simulate(numbers)
        # Launches outside of the band have no target.
        in_band = ~np.isnan(self.target)
        target = self.target[in_band]
        error: Floats = np.abs(e[:, in_band] - target).max(axis=1)
        gained = np.maximum(0.0, e.max(axis=1) - self.largest_e)
        too_deep = np.maximum(0.0, deepest[:, in_band].max(axis=1) - _DEEPEST)
        error += too_deep + COSTS * gained
        return error

    def _columns(self, numbers: RowNumbers) -> _Rows:
        """The rows of p settings, (p,), with what MuJoCo derives of their numbers.

        numbers: of the rows of each setting.
        """
        dmax = numbers.dmax
        midpoint = numbers.midpoint
        # In MuJoCo's reference k = K d/dmax² and b = D/dmax; the spring has d = dmax = dmin.
        weight = self.corners * _WEIGHT / MIN_IMPEDANCE
        return _Rows(
            stiffness=weight * numbers.stiffness,
            damping=weight * numbers.spring_damping,
            damper=numbers.damping / dmax,
            dmax=dmax,
            width=numbers.width,
            midpoint=midpoint,
            # Of the impedance's two branches, up to the midpoint and from it on
            rise=(dmax - MIN_IMPEDANCE) * (1.0 / midpoint ** (POWER - 1.0)),
            level=(dmax - MIN_IMPEDANCE) * (1.0 / (1.0 - midpoint) ** (POWER - 1.0)),
        )

    def _simulate(self, numbers: RowNumbers) -> tuple[Floats, Floats]:
        """Simulate all n launches with each of p settings: e, 0 where a launch has not parted, and
        the largest penetration over v h, (p, n) each.

        numbers: of the rows of each setting.
        """
        # Those of all launches, a setting after the other.
        columns = self._columns(numbers)
        rows = _Rows(*(np.repeat(column, len(self.speeds)) for column in columns))
        # All in units of the step h, the band's highest speed v, and v h.
        g = self.fall
        settings = len(numbers.stiffness)
        launches = len(self.speeds)
        # Time from the touch to the first state that sees it, in steps; a stage of RK4 may see it
        # a step before.
        if self.rk4:
            later = -self.phases
            ahead = 0.0
        else:
            later = 1.0 - self.phases
            # In steps of fall: Euler's speed is ahead of the true one by half a step's gain.
            ahead = 0.5
        x = np.tile(self.speeds * later + g * later**2 / 2, settings)
        v = np.tile(self.speeds + g * (later - ahead), settings)
        e = np.zeros(x.size)
        deepest = x.copy()
        # Of those still in contact: their number among all, and the largest penetration until now.
        number = np.arange(x.size)
        deep = x.copy()
        for _ in range(self.followed):
            x, v = self._step(rows, x, v)
            np.maximum(deep, x, out=deep)
            is_open = (x <= 0.0) & (v < 0.0)
            parted = np.flatnonzero(is_open)
            if not parted.size:
                continue
            # Back from the state that sees it to the touch plane, by what flight conserves.
            squared = (v[parted] + g * ahead) ** 2 - 2 * g * x[parted]
            speed_out = np.sqrt(np.maximum(0.0, squared))
            e[number[parted]] = speed_out / self.speeds[number[parted] % launches]
            deepest[number[parted]] = deep[parted]
            # Launches that have parted take no time any more.
            going = np.flatnonzero(~is_open)
            x = x[going]
            v = v[going]
            deep = deep[going]
            number = number[going]
            rows = rows.of(going)
            if not going.size:
                break
        deepest[number] = deep
        return e.reshape(-1, launches), deepest.reshape(-1, launches)

    def _step(self, rows: _Rows, x: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Take one step of m launches, Euler's by the new speed, or the classical Runge-Kutta of
        MuJoCo's RK4: penetration and rate after it.

        rows: of the setting of each launch, (m,).
        x: penetration in units of v h, (m,).
        v: its rate, in units of the band's highest speed, (m,). See MuJoCo's documentation,
        Computation, "Numerical integration".
        """
        if not self.rk4:
            v = v - self._acceleration(rows, x, v)
            return x + v, v
        one = -self._acceleration(rows, x, v)
        two = -self._acceleration(rows, x + v / 2, v + one / 2)
        three = -self._acceleration(rows, x + v / 2 + one / 4, v + two / 2)
        four = -self._acceleration(rows, x + v + two / 2, v + three)
        return x + v + (one + two + three) / 6, v + (one + 2 * two + 2 * three + four) / 6

    def _acceleration(self, rows: _Rows, x: Floats, v: Floats) -> Floats:
        """Acceleration away from the plate times the step, in the band's highest speed, (m,).

        rows: of the setting of each launch, (m,).
        x: penetration in units of v h, (m,).
        v: its rate, in units of the band's highest speed, (m,). MuJoCo's documentation,
        Computation, "Constraint model": (A + R) f = a_ref - a_0, R = (1 - d)/d diag(A). Rows at one
        point, of weights w = d/(1 - d), give a = (Σ w a_ref - g)/(1 + Σ w), summed over those that
        act.
        """
        g = self.fall
        spring_weight = self.corners * _WEIGHT
        d = rows.impedance(x)
        weight = self.corners * d
        weight /= np.subtract(1.0, d, out=d)
        spring = rows.stiffness * x  # w a_ref of the spring
        spring += rows.damping * v
        damper = rows.damper * v  # a_ref of the damper
        a = (spring + weight * damper - g) / (1.0 + spring_weight + weight)
        # Without adhesion f >= 0. A row once left out never comes back, as a is larger with it.
        if not self.adhesive:
            weight[damper < a] = 0.0
            a = (spring + weight * damper - g) / (1.0 + spring_weight + weight)
        alone = np.flatnonzero(spring < spring_weight * a)
        weight = weight.take(alone)
        a[alone] = (weight * damper.take(alone) - g) / (1.0 + weight)
        a[np.flatnonzero(x <= 0.0)] = -g
        return a

    def rows(self, parameters: Floats, timestep: float, speed: float) -> list[ConstraintRow]:
        """The two rows, a spring and a damper, of one point of the search, in SI units and in the
        digits with which a model is written.

        parameters: (6,).
        timestep: s.
        speed: the band's highest, m/s, by which the parameters are scaled.
        """
        h = timestep
        # K h² and D h of the spring; D h, dmax, width over v h and midpoint of the damper.
        units = (1 / h**2, 1 / h, 1 / h, 1.0, speed * h, 1.0)
        in_si = []
        for number, unit in zip(self.numbers(parameters[None]), units, strict=True):
            in_si.append(short(float(number[0]) * unit))
        stiffness, spring_damping, damping, dmax, width, midpoint = in_si
        solimp = (MIN_IMPEDANCE, dmax, width, midpoint, POWER)
        adhesion = MOST_PULL if self.adhesive else 0.0
        return [
            ConstraintRow.direct(stiffness, spring_damping, SPRING_SOLIMP),
            ConstraintRow.direct(0.0, damping, solimp, adhesion=adhesion),
        ]


class _Goal(ctypes.Structure):
    """`Goal` of row_errors.c, which says what its fields are."""

    _fields_ = (
        ("speeds", ctypes.c_void_p),
        ("phases", ctypes.c_void_p),
        ("target", ctypes.c_void_p),
        ("launches", ctypes.c_int),
        ("steps", ctypes.c_int),
        ("adhesive", ctypes.c_int),
        ("rk4", ctypes.c_int),
        ("fall", ctypes.c_double),
        ("corners", ctypes.c_double),
        ("spring_weight", ctypes.c_double),
        ("least_impedance", ctypes.c_double),
        ("deepest", ctypes.c_double),
        ("largest_e", ctypes.c_double),
        ("costs", ctypes.c_double),
    )
    arrays: list[Floats]

    @classmethod
    def of(cls, fit: RowFit) -> _Goal:
        """The goal of a fit as row_errors.c reads it; its pointers are valid as long as the object that
        is returned.

        fit: launches, bounds and costs, in units of the step and the band's highest speed.
        """
        arrays = [
            np.ascontiguousarray(each, dtype=np.float64)
            for each in (fit.speeds, fit.phases, fit.target)
        ]
        speeds, phases, target = (each.ctypes.data for each in arrays)
        goal = cls(
            speeds=speeds,
            phases=phases,
            target=target,
            launches=len(fit.speeds),
            steps=fit.followed,
            adhesive=fit.adhesive,
            rk4=fit.rk4,
            fall=fit.fall,
            corners=fit.corners,
            spring_weight=fit.corners * _WEIGHT,
            least_impedance=MIN_IMPEDANCE,
            deepest=_DEEPEST,
            largest_e=fit.largest_e,
            costs=COSTS,
        )
        # What its fields point into.
        goal.arrays = arrays
        return goal


@functools.cache
def _library() -> ctypes.CDLL | None:
    """Compile and load `row_errors`, which computes the errors of settings in C; None where that
    cannot be done.
    """
    try:
        library = ctypes.CDLL(str(build("engines/mujoco/recipes/row_errors.c")))
    # Without a compiler or on a full disk NumPy does it.
    except (HcbenchError, OSError):
        return None
    pointer = ctypes.c_void_p
    library.row_errors.argtypes = [pointer, pointer, ctypes.c_int, pointer, pointer]
    library.row_errors.restype = None
    return library
