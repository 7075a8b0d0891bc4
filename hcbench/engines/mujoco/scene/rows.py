"""MuJoCo's contact constraints as equations: how several act together, and
the restitution of one or more.

Per unit effective mass, with impedance d(r) at depth r below its onset (x penetration, v its rate),
a row of solref "-S -D" and solimp "d0 dw ..." asks for the acceleration apart

    a_ref = S d(r)/dw² r + D/dw v

and has the weight w = d/(1 - d). Rows together give a = Σ w_i a_ref,i / (1 + Σ w_i) over those that
act: from their onset on and, without adhesion, only while they push, a_ref,i > a. One row alone
gives a = d a_ref. Gravity g, together, takes g off the sum above the line. Formulas: MuJoCo's
documentation, Modeling (solver parameters) and Computation (constraint model).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

# A contact of one row in continuous time: how fast the bodies part.
#
# By the pair of orders 5 and 4 of Dormand and Prince, J. Comp. Appl. Math. 6 (1980), table 2, on
# plain floats: importing SciPy's integrators takes ten times as long as all that a measurement
# asks.

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Push = Callable[[float, float], float]

_STAGES = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
# Difference of the weights of order 5 and order 4: what a step's error is estimated by.
_ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
# Tolerances of a step: relative, and absolute in speeds at touch.
_RELATIVE = 1e-9
_ABSOLUTE = 1e-13
# Halvings of the step in which the bodies part: to the last bit. And a
# bound of the steps of one contact.
_BISECTIONS = 60
_MOST_STEPS = 100_000


def parting_speed(push: Push, speed: float, first_step: float, longest: float) -> float:
    """Follow a contact from touch until it no longer pushes, and return the speed with which the
    bodies then part, m/s; 0 for a contact that has not ended by `longest`.

    push: acceleration apart, m/s², as a function of penetration, m, and its rate, m/s.
    speed: of approach at touch, m/s.
    first_step: of the integration, s, short beside all that happens; later steps follow the error.
    longest: time to follow the contact, s.
    """
    time = 0.0
    x = 0.0
    v = speed
    step = first_step
    for _ in range(_MOST_STEPS):
        if time >= longest or time + step == time:
            break
        new_x, new_v, error_x, error_v = _step(push, x, v, step)
        # Largest error over what is tolerated.
        error = max(
            error_x / (_RELATIVE * max(abs(x), abs(new_x)) + _ABSOLUTE * speed * step),
            error_v / (_RELATIVE * max(abs(v), abs(new_v)) + _ABSOLUTE * speed),
        )
        # A step with a larger error is taken again, shorter.
        if error <= 1.0:
            if new_v < 0.0 and push(new_x, new_v) <= 0.0:
                return -_at_parting(push, x, v, step)
            time = time + step
            x = new_x
            v = new_v
        # The usual control for a method of order 5: the error grows as the step to the power 5.
        step *= min(5.0, max(0.2, 0.9 * max(error, 1e-12) ** -0.2))
    return 0.0


def _step(push: Push, x: float, v: float, step: float) -> tuple[float, float, float, float]:
    """Take one step of Dormand and Prince's method: penetration x, m, and rate v, m/s, after it, and
    estimates of their errors.

    push: acceleration apart of the contact, m/s², at (x, v); below 0 it counts as none.
    step: s.
    """
    # Rates of x and of v at each stage; the contact only pushes.
    speeds = [v]
    accelerations = [-max(0.0, push(x, v))]
    at_x = x
    at_v = v
    for weights in _STAGES:
        at_x = x + step * _weighted(weights, speeds)
        at_v = v + step * _weighted(weights, accelerations)
        speeds.append(at_v)
        accelerations.append(-max(0.0, push(at_x, at_v)))
    error_x = abs(step * _weighted(_ERROR, speeds))
    error_v = abs(step * _weighted(_ERROR, accelerations))
    return at_x, at_v, error_x, error_v


def _weighted(weights: Sequence[float], rates: Sequence[float]) -> float:
    """Sum of the rates at as many stages as there are weights, each times its weight."""
    return sum(weight * rate for weight, rate in zip(weights, rates, strict=True))


def _at_parting(push: Push, x: float, v: float, step: float) -> float:
    """Find by bisection the time within a step at which the contact no longer pushes; the rate v
    then, m/s.

    push: acceleration apart of the contact, m/s², at (x, v); below 0 it counts as none.
    x, v: penetration, m, and rate, m/s, at the step's start.
    step: s, at whose end the contact no longer pushes.
    """
    low = 0.0
    high = step
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        at_x, at_v, *_ = _step(push, x, v, middle)
        if at_v < 0.0 and push(at_x, at_v) <= 0.0:
            high = middle
        else:
            low = middle
    _, leaves_at, _, _ = _step(push, x, v, high)
    return leaves_at


if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.terms.impact import Floats

    Solimp = tuple[float, float, float, float, float]

# mjMINIMP, mjMAXIMP: impedances and midpoints are clamped to them. A contact lets that share of
# gravity through that its impedance lacks to 1.
MIN_IMPEDANCE = 1e-4
MAX_IMPEDANCE = 0.9999
STIFF_SOLIMP = (MAX_IMPEDANCE, MAX_IMPEDANCE, 0.001, 0.5, 2.0)
# A little above this power of solimp the sigmoid underflows.
MAX_POWER = 1000.0
_MINVAL = 1e-15  # mjMINVAL
# Below this k h² the damper of one step, not the spring, makes the bounce.
_SPRINGLESS = 0.1
_SOLID_SPHERE = 3.5  # 1 + m R²/I
# A contact is followed for as many of its slowest time scale.
_LONGEST = 100.0


@dataclass(frozen=True, slots=True)
class ConstraintRow:
    """One constraint between ball and plate: a contact pair, or a tendon's limit.

    solref, solimp: MuJoCo's.
    onset: penetration from which it acts, m.
    adhesion: force with which it may pull, N.
    friction: coefficient of sliding, 0 for a contact without friction.
    solreffriction: MuJoCo's, of its friction; () for that of solref.
    """

    solref: tuple[float, ...]
    solimp: tuple[float, ...]
    onset: float = 0.0
    adhesion: float = 0.0
    friction: float = 0.0
    solreffriction: tuple[float, ...] = ()

    @classmethod
    def direct(
        cls,
        stiffness: float,
        damping: float,
        solimp: Solimp,
        onset: float = 0.0,
        adhesion: float = 0.0,
    ) -> ConstraintRow:
        """Make a row by its stiffness S, 1/s², and damping D, 1/s, per unit effective mass.

        solimp: MuJoCo's, of the impedance.
        onset: depth from which the row acts, m.
        adhesion: N.
        """
        return cls((-float(stiffness), -float(damping)), solimp, float(onset), float(adhesion))

    def with_friction(self, coefficient: float, timestep: float, impratio: float) -> ConstraintRow:
        """The same row with Coulomb friction that stops the slip of a solid sphere in about a step,
        as far as μ allows. For a row whose impedance d is constant.

        coefficient: μ.
        timestep: h, s.
        impratio: that the model will have.

        The contact point gives way s = 1 + m R²/I = 3.5 times as easily along the plate as along its
        normal. So the impedance of friction is d_t = w/(1 + w), w = d/(1 - d) impratio s, and the
        solreffriction "0 -(d/d_t)/h" asks for the deceleration v/h.
        """
        d = self.solimp[0]
        w = d / (1.0 - d) * impratio * _SOLID_SPHERE
        # As short as a model is written.
        damping = float(f"{d * (1.0 + w) / w / timestep:.6g}")
        return replace(self, friction=coefficient, solreffriction=(0.0, -damping))

    @property
    def stiffness(self) -> float:
        """S of solref "-S -D", 1/s²."""
        return -self.solref[0]

    @property
    def damping(self) -> float:
        """D of solref "-S -D", 1/s."""
        return -self.solref[1]

    def option(self) -> dict[str, Any]:
        """Entry of the option `rows` of a setting for this row, by the names of fields; those of
        friction are there only if it has some.
        """
        option: dict[str, Any] = {
            "solref": list(self.solref),
            "solimp": list(map(float, self.solimp)),
            "onset": self.onset,
            "adhesion": self.adhesion,
        }
        if self.friction:
            option["friction"] = self.friction
        if self.solreffriction:
            option["solreffriction"] = list(self.solreffriction)
        return option


def _rise(u: Any, midpoint: Any, power: Any) -> Any:
    """MuJoCo's sigmoid of u = depth/width up to its midpoint; beyond it is
    this one turned by 180 degrees.
    """
    return u**power / midpoint ** (power - 1.0)


def _held_impedance(d: float) -> float:
    """An impedance within the limits that MuJoCo holds it to."""
    return min(max(d, MIN_IMPEDANCE), MAX_IMPEDANCE)


def impedance(solimp: Sequence[Floats | float], depth: Floats) -> Floats:
    """MuJoCo's impedance d, from 0 to 1, at depths: d0 at touch, dw from the width on, and a power
    sigmoid between (its documentation, Modeling, "Impedance").

    solimp: its five numbers, d0, dw, width (m), midpoint and power; each may be an array that
    broadcasts with the depths.
    depth: below the onset, m.
    """
    d0, dw, width, midpoint, power = solimp
    # `np.clip` takes four times as long.
    u = np.minimum(np.maximum(depth / width, 0.0), 1.0)
    if np.ndim(power) == 0 and power == 1.0:
        return np.asarray(d0 + (dw - d0) * u)
    sigmoid = np.where(
        u <= midpoint, _rise(u, midpoint, power), 1.0 - _rise(1.0 - u, 1.0 - midpoint, power)
    )
    return np.asarray(d0 + (dw - d0) * np.where(power == 1.0, u, sigmoid))


def weight(solimp: Sequence[float], depth: Floats) -> Floats:
    """d/(1 - d) at a depth below the onset (m), 0 above it; same shape."""
    return _weight(impedance(solimp, depth), depth)


def _weight(d: Floats, depth: Floats) -> Floats:
    return np.where(depth > 0.0, d / (1.0 - d), 0.0)


def combine(
    reference: Floats, weights: Floats, may_pull: Floats | bool, axis: int, gravity: float = 0.0
) -> tuple[Floats, Floats]:
    """Acceleration apart that several rows give together, m/s², without the axis of the rows; and
    their weights, 0 for those that do not act, with it.

    reference: acceleration that each row asks for, m/s².
    weights: d/(1 - d) of each, 0 above its onset, of the same shape.
    may_pull: true for rows with adhesion; others act only while they push.
    axis: that of the rows.
    gravity: that presses together, m/s².
    """
    while True:
        pushed = np.add.reduce(weights * reference, axis=axis, keepdims=True) - gravity
        a = pushed / (1.0 + np.add.reduce(weights, axis=axis, keepdims=True))
        # Without a row that pulls a is larger: a row once left out never comes back.
        pulls = (reference < a) & (weights > 0.0) & np.logical_not(may_pull)
        if not np.logical_or.reduce(pulls, axis=None):
            return a.squeeze(axis), weights
        weights = np.where(pulls, 0.0, weights)


def acceleration(
    rows: Sequence[ConstraintRow], x: Floats, v: Floats, gravity: float = 0.0
) -> Floats:
    """Acceleration apart, m/s², that rows and gravity together give, in the shape of x.

    x, v: penetrations, m, and their rates, m/s, of the same shape.
    gravity: that presses together, m/s².
    """
    # Of each row, (rows, shape of x): a_ref = S d/dw² r + D/dw v, and its weight d/(1 - d), 0 above
    # its onset. In place, as fits spend their time here.
    reference, weights = np.empty((2, len(rows), *np.shape(x)))
    for i, row in enumerate(rows):
        depth = x - row.onset
        dw = row.solimp[1]
        d = impedance(row.solimp, depth)
        np.divide(d, 1.0 - d, out=weights[i])
        weights[i] *= depth > 0.0
        d *= row.stiffness
        d /= dw**2
        d *= depth
        np.add(d, row.damping / dw * v, out=reference[i])
    may_pull = np.array([row.adhesion != 0.0 for row in rows]).reshape(-1, *[1] * np.ndim(x))
    acceleration, _ = combine(reference, weights, may_pull, 0, gravity)
    return acceleration


def restitution(
    rows: Sequence[ConstraintRow], timestep: float, speeds: Floats, phases: int, duration: float
) -> Floats:
    """Simulate impacts on rows without gravity, by MuJoCo's Euler step v+ = v - h a, x+ = x + h v+:
    e, (speeds, phases), NaN for a contact that has not ended.

    rows: one or more, per unit mass.
    timestep: h, s.
    speeds: at touch, m/s, (n,).
    phases: number of places in a step where the contact starts, evenly spread.
    duration: to simulate, s.
    """
    phase = (np.arange(phases) + 0.5) / phases
    v_i, before = np.meshgrid(speeds, phase, indexing="ij")
    x = -before * timestep * v_i
    v = v_i.copy()
    for _ in range(int(duration / timestep) + 2):
        v = v - timestep * acceleration(rows, x, v)
        x = x + timestep * v
    return np.where((x <= 0.0) & (v < 0.0), -v / v_i, np.nan)


@dataclass(frozen=True, slots=True)
class SoftConstraint:
    """One contact as a model's author wrote it or as the engine uses
    it, and its e in continuous time.

    solref: (time constant s, damping ratio), or (-stiffness 1/s^2, -damping 1/s), per unit
    effective mass.
    timestep: s.
    shortest: the least time constant, s, that the engine's refsafe lets through (0: any).
    clamped: whether solimp is held within what the engine allows, as the engine does.
    """

    solref: tuple[float, float]
    solimp: Solimp
    timestep: float
    shortest: float = 0.0
    clamped: bool = True

    def impedance(self, x: float) -> float:
        """Impedance d at a penetration x, m, of either sign, as MuJoCo computes it: a power sigmoid from
        d0 at touch to dw at the width; the mean of the two without a width.
        """
        d0, dw, width, midpoint, power = self._solimp()
        if width <= _MINVAL or d0 == dw:
            return 0.5 * (d0 + dw)
        u = min(abs(x) / width, 1.0)
        if power == 1 or u in (0.0, 1.0):
            return d0 + u * (dw - d0)
        y = _rise(u, midpoint, power) if u <= midpoint else 1 - _rise(1 - u, 1 - midpoint, power)
        return float(d0 + y * (dw - d0))

    def stiffness_damping(self) -> tuple[float, float]:
        """k, 1/s², and b, 1/s, of the contact's push d (k d x + b v), d its impedance, as MuJoCo
        computes them of solref in either format.
        """
        _, dw, _, _, _ = self._solimp()
        first, second = self.solref
        if first > 0:
            constant = max(first, self.shortest)
            # The square of this may be inf, which the operator ** would refuse.
            reach = dw * constant * second
            return 1 / max(_MINVAL, reach * reach), 2 / max(_MINVAL, dw * constant)
        return -first / max(_MINVAL, dw**2), -second / max(_MINVAL, dw)

    def _solimp(self) -> Solimp:
        """The five numbers of solimp as MuJoCo uses them: impedances and midpoint within its limits,
        the width (m) not below 0, the power not below 1; as they are if this is not `clamped`.
        """
        if not self.clamped:
            return self.solimp
        d0, dw, width, midpoint, power = self.solimp
        return (
            _held_impedance(d0),
            _held_impedance(dw),
            max(width, 0.0),
            _held_impedance(midpoint),
            max(power, 1.0),
        )

    @property
    def is_impulse(self) -> bool:
        """True if the contact reverses a body within one step: its damping is strong enough, and it
        has hardly any spring.
        """
        first, second = self.solref
        if first > 0:
            return False
        # Above 1 the damper reverses the body within the step, up to e = 1 at 2.
        reversal = -second * self.timestep
        is_springless = -first * self.timestep**2 < _SPRINGLESS
        return 1.0 <= reversal <= 2.0 and is_springless

    @property
    def is_powerless(self) -> bool:
        """True if neither spring nor damper pushes back."""
        return self.solref[0] <= 0 and max(abs(value) for value in self.solref) < _MINVAL

    @property
    def overflows(self) -> bool:
        """True if the sigmoid of solimp overflows, in the engine too."""
        _, _, width, midpoint, power = self._solimp()
        low = min(midpoint, 1 - midpoint)
        return width > _MINVAL and power > MAX_POWER and math.pow(max(low, 0.0), power - 1) == 0.0

    def restitution(self, speed: float) -> float:
        """e at an impact speed, m/s, in continuous time; for a contact that reverses the body within
        one step, that of the step, D h - 1.

        NaN for a speed that is not above 0 and for a solimp whose sigmoid is NaN; 0 without a
        spring, or for a contact that does not end.
        """
        if self.is_impulse:
            return -self.solref[1] * self.timestep - 1.0
        if not speed > 0 or self.overflows:
            return math.nan
        k, b = self.stiffness_damping()
        if k <= 0:
            return 0.0

        def push(x: float, v: float) -> float:
            d = self.impedance(x)
            return d * (k * d * x + b * v)

        lowest = max(1e-6, min(self.impedance(0.0), self.impedance(math.inf)))
        # Many times what the spring takes to turn the body round, or the damper to let it out.
        longest = _LONGEST * (1 / (math.sqrt(k) * lowest) + b / k)
        return max(0.0, parting_speed(push, speed, 1e-3 / (math.sqrt(k) + b), longest)) / speed

    def curve(self, speeds: Sequence[float]) -> tuple[float, ...]:
        """e at each of `speeds` (m/s)."""
        return tuple(self.restitution(float(v)) for v in speeds)
