"""The force of each contact over a step, by a force law or by a restitution law."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from hcbench import _compile
from hcbench.engines.pybullet.model import ContactRow
from hcbench.laws.contact_law import PluginForceLaw
from hcbench.laws.exact_step import ContactOde, advance, euler_force, touch_speed_ode, two_point_solve
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import TouchSpeedLaw

if TYPE_CHECKING:
    from hcbench.engines.pybullet.vectors import Vector
    from hcbench.laws.contact_law import Law
    from hcbench.laws.restitution import ConstantRestitution, Restitution

_SWEEPS = 1000
_RELATIVE = 1e-15


@dataclass(slots=True)
class ContactPoint:
    """One contact at the start of a step: SI, x > 0 in contact, the normal from the second body to the first.

    Those that only touch within the step have penetration below 0. `force` acts over the step that follows.
    """

    pair: tuple[tuple[int, int], tuple[int, int]]
    order: int
    penetration: float
    rate: float
    point: Vector
    normal: Vector
    slip: Vector
    inverse_mass: float
    pull: float  # approach by gravity, m/s²
    weight: float  # approach by gravity on one of the bodies, which the other may bear, m/s²
    row: ContactRow = field(repr=False)
    force: float = 0.0
    rate_of_step: float = 0.0  # (ω h)²

    @property
    def key(self) -> tuple[Any, int]:
        """Equal for the same contact in the next step."""
        return self.pair, self.order


class ContactSolver(Protocol):
    """Sets the force of each contact."""

    def solve(self, touches: Sequence[ContactPoint], h: float) -> None:
        """Forces over a step of `h` s."""
        ...


def solver_of(law: Law) -> ContactSolver:
    """The solver of a law."""
    return ForceSolver(law) if isinstance(law, (HuntCrossley, TouchSpeedLaw)) else RestitutionSolver(law)


class _CLaw(ctypes.Structure):
    _fields_ = [(name, ctypes.c_double) for name in ("kappa", "a", "n", "b", "chi", "e", "load", "least")]


class ForceSolver:
    """F = k x^n (1 + a x') over a step, by exact_step.euler_force or its compiled twin."""

    def __init__(self, law: PluginForceLaw) -> None:
        self.law = law
        if isinstance(law, HuntCrossley) or law.chi == 0.0:
            self._plain = ContactOde(0.0, getattr(law, "dissipation", 0.0), law.exponent)
        else:
            self._plain = touch_speed_ode(0.0, law.chi, law.exponent)
        plain = self._plain
        self._c = _CLaw(0.0, plain.a, plain.n, 0.0, plain.chi, plain.e, 0.0, 0.0)
        self._compiled = _compiled_euler_force()
        self._late = _LateReports()

    def solve(self, touches: Sequence[ContactPoint], h: float) -> None:
        """Other contacts of the same bodies enter to first order, as an acceleration."""
        plain = []
        for touch in touches if len(touches) > 1 else ():
            x, v = touch.penetration, touch.rate
            motion = self._motion(touch, 0.0)
            if x > 0.0:
                motion = motion.with_touch_speed(x, v)
            plain.append(-motion.acceleration(x, v) / touch.inverse_mass)
        for i, touch in enumerate(touches):
            b = touch.pull - sum(
                touch.row.acceleration(touches[j].row) * f for j, f in enumerate(plain) if f and j != i
            )
            motion = self._motion(touch, b)
            touch.rate_of_step = (h * motion.frequency(touch.penetration)) ** 2
            touch.force = self._acceleration(motion, h, touch) / touch.inverse_mass
        self._late.seen({touch.key for touch in touches})

    def _motion(self, touch: ContactPoint, b: float) -> ContactOde:
        ode, kappa = self._plain, self.law.stiffness * touch.inverse_mass
        return ContactOde(kappa, ode.a, ode.n, b, ode.chi, ode.e, touch.pull if ode.chi else 0.0)

    def _acceleration(self, motion: ContactOde, h: float, touch: ContactPoint) -> float:
        late = self._late.acceleration(motion.with_step(h), h, touch)
        if late is not None:
            return late
        if self._compiled is None:
            return euler_force(motion, h, touch.penetration, touch.rate)
        self._c.kappa, self._c.b, self._c.load = motion.kappa, motion.b, motion.load
        return float(self._compiled(ctypes.byref(self._c), h, touch.penetration, touch.rate))


def _compiled_euler_force() -> Any:
    try:
        function = _compile.law_library().hcb_euler_force
    except _compile.NotCompiled:
        return None
    function.argtypes = [ctypes.c_void_p, *[ctypes.c_double] * 3]
    function.restype = ctypes.c_double
    return function


class _LateReports:
    """Shapes that Bullet reports only once they overlap, as distance fields and concave meshes.

    The step of the touch has then passed without a force. The motion that it should have had is computed when
    the contact is first reported, and a force is applied that puts the next position right; the step after
    that starts from where the body should have been. The last step in contact sets the speed of departure.
    """

    def __init__(self) -> None:
        self._last: set[Any] = set()
        self._late: set[Any] = set()
        self._offset: dict[Any, float] = {}

    def seen(self, keys: set[Any]) -> None:
        """Record which contacts this step had."""
        self._last, self._late = keys, self._late & keys

    def acceleration(self, motion: ContactOde, h: float, touch: ContactPoint) -> float | None:
        """F/m >= 0 in m/s² where a late report needs care, else None."""
        key, x, v = touch.key, touch.penetration, touch.rate
        before = x - h * v
        if key not in self._last and x > 0.0 > before:
            self._late.add(key)
            should, rate = advance(motion, h, before, v - 0.5 * h * motion.b)
            after, out = advance(motion.with_touch_speed(should, rate), h, should, rate)
            self._offset[key] = should - x
        elif key in self._late:
            rate, after = two_point_solve(motion, h, before + self._offset.pop(key, 0.0), x)
            out = advance(motion.with_touch_speed(x, rate), h, x, rate)[1]
        else:
            return None
        aim = (after - x) / h if after > 0.0 else out
        return max(0.0, motion.b - (aim - v) / h)


class RestitutionSolver:
    """Each contact leaves with e(v) of its approach speed, or rests; all at once."""

    def __init__(self, law: Restitution | ConstantRestitution) -> None:
        self.law = law
        self._resting: dict[
            Any, float
        ] = {}  # acceleration by loads that are not modelled, of each resting one

    def solve(self, touches: Sequence[ContactPoint], h: float) -> None:
        """Gauss-Seidel on the impulses: none pulls, each contact ends at its speed or above."""
        active = [touch for touch in touches if touch.penetration >= 0.0]
        pulls, aims, resting = [], [], {}
        for touch in active:
            load = self._resting.get(touch.key)
            # Speeds below what gravity adds in one step count as rest.
            still = 1.1 * h * touch.weight
            if load is not None:
                still = max(still, 10.0 * h * (touch.weight + abs(load)))
                load += touch.rate / h
            bounces = touch.rate > still
            pulls.append(touch.pull + (load or 0.0) * (not bounces))
            aims.append(touch.rate * max(0.0, float(self.law.at(touch.rate))) if bounces else 0.0)
            if not bounces:
                resting[touch.key] = load or 0.0
        self._sweep(active, pulls, aims, h)
        self._resting = {t.key: resting[t.key] for t in active if t.key in resting and t.force > 0.0}

    @staticmethod
    def _sweep(active: list[ContactPoint], pulls: list[float], aims: list[float], h: float) -> None:
        coupling = [[one.row.acceleration(other.row) for other in active] for one in active]
        need = [(t.rate + aim) / h + pull for t, aim, pull in zip(active, aims, pulls, strict=True)]
        for _ in range(_SWEEPS if len(active) > 1 else 1):
            change = 0.0
            for i, touch in enumerate(active):
                others = sum(coupling[i][j] * other.force for j, other in enumerate(active) if j != i)
                force = max(0.0, (need[i] - others) / touch.inverse_mass)
                change = max(change, abs(force - touch.force) - _RELATIVE * force)
                touch.force = force
            if change <= 0.0:
                break
