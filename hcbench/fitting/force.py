"""k, n and α of eq. (16), from the force over time of one impact or from
force over penetration and rate.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.fitting.which_law import dissipation_of
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.system.errors import UserError
from hcbench.system.text import Shown
from hcbench.terms.resolution import SIGMAS_95

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.fitting.setup import MeasurementSetup
    from hcbench.terms.impact import Floats

# A pulse begins and ends at this share of its largest force.
_EDGE = 0.05
# e by the shape and e by the impulse contradict each other beyond so many standard deviations.
_APART = 3.0
# A smaller difference between those two never counts as a contradiction.
_NO_CONTRADICTION = 0.01
# Samples of quiet, at least.
_LEAST_QUIET = 5
# Points of a pulse that a fit of its shape needs, and that its impulse needs.
_LEAST_POINTS = 20
_LEAST_OF_IMPULSE = 4
# Standard deviations of α below 0 from which the data surely gain energy.
_SIGMAS_BELOW = 3.0
# Smooth difference from the law, rms over the largest force, from which on it is another law's.
_OFF_LAW = 0.01
# Chance that noise alone counts as a smooth difference.
_CHANCE = 1e-3
# Groups of neighbours in which a smooth difference is looked for.
_GROUPS = 12
# Groups of penetration in a loop; each is divided by speed.
_DEPTHS = 6
# Another push has this share of the largest force.
_ANOTHER = 0.3


@dataclass(frozen=True, repr=False)
class ForceFit(Shown):
    """The fit of eq. (16) to a measured force, over time or over penetration and rate.

    stiffness, exponent: k, N/m^n, and n.
    alpha: α, s/m.
    covariance: (3, 3), of ln k, n and α; that of n is 0 where n was given.
    e, e_uncertainty: by the impulse; NaN for loops.
    speeds: lowest and highest speed of the data, m/s.
    misfit: rms of the difference of the force from the law's, over the largest force.
    systematic: the part of it that is smooth, and no noise.
    e_by_shape: e of a pulse by its shape; NaN for loops.

    A push of few samples has e by its impulse, and the α that goes with it under the law: stiffness,
    exponent, misfit and e_by_shape are NaN.
    """

    file: str
    kind: str
    stiffness: float
    exponent: float
    alpha: float
    covariance: Floats
    e: float
    e_uncertainty: float
    speeds: tuple[float, float]
    misfit: float
    systematic: float
    e_by_shape: float = math.nan

    @property
    def has_shape(self) -> bool:
        """False for a push of so few samples that its impulse alone was used."""
        return not math.isnan(self.exponent)

    @property
    def contradicts(self) -> bool:
        """True if the shape of the pulse implies another e than its impulse does."""
        apart = abs(self.e_by_shape - self.e)
        return apart > max(_APART * self.e_uncertainty, _NO_CONTRADICTION)

    @property
    def alpha_by_impulse(self) -> float:
        """α that goes with the impulse's e, s/m."""
        return dissipation_of(math.log(self.e)) / (1.5 * self.speeds[1])

    @property
    def is_law(self) -> bool:
        """True if the force follows eq. (16)."""
        if not self.has_shape:
            return False
        # A loop of n = 1 may come out a little below it.
        least = 1.0 - SIGMAS_95 * math.sqrt(self.covariance[1, 1])
        is_law = least <= self.exponent <= 10.0 and self.alpha_interval[1] > 0.0
        return is_law and self.systematic < _OFF_LAW and not self.contradicts

    @property
    def alpha_uncertainty(self) -> float:
        """Standard, s/m."""
        return math.sqrt(self.covariance[2, 2])

    @property
    def alpha_interval(self) -> tuple[float, float]:
        """95 %, s/m."""
        half = SIGMAS_95 * self.alpha_uncertainty
        return max(0.0, self.alpha - half), self.alpha + half

    def _lines(self) -> list[str]:
        """Lines for a terminal."""
        from hcbench.fitting.result import with_uncertainty

        return lines_of(self, with_uncertainty)

    def _rows(self) -> list[dict[str, object]]:
        """The one row for a data frame: the file, and the parameters in SI."""

        kept = ("stiffness_n_per_m_n", "exponent", "alpha_s_per_m", "restitution", "misfit")
        record = as_record(self)
        return [{"file": self.file, **{name: record[name] for name in kept}}]


def fit_pulse(name: str, setup: MeasurementSetup, time: Floats, force: Floats) -> ForceFit:
    """Fit one impact, force over time. The impulse gives e without k and n; the shape then gives
    those, where the push has 20 samples or more.

    name: of the file, for messages.
    setup: with the mass, and the speed or the drop height; n too, where it is known.
    time, force: s and N, shape (n,), rising times; either sign of the force.
    Raises UserError without mass and speed (or drop height), for an impulse that means no e in 0
    ... 1, and unless the force is a single push.
    """
    mass, u_mass, speed, u_speed = _approach(name, setup)
    inside, force = _pulse(name, time, force)
    impulse, u_impulse = _impulse(time, force, inside)
    e = impulse / (mass * speed) - 1.0
    of_inputs = (1.0 + e) * math.hypot(u_mass / mass, u_speed / speed)
    u_e = math.hypot(of_inputs, u_impulse / (mass * speed))
    if not 0.0 < e < 1.0:
        got = f"the impulse {impulse:.4g} N s is {impulse / (mass * speed):.3g} times m v"
        advice = "Look at mass, speed, units and the sign of the force"
        raise UserError(name, got, "1 ... 2 times", advice)
    if inside.sum() < _LEAST_POINTS:
        return _by_impulse(name, speed, e, u_e)
    # F(t) of the law varies with ln k, ln e, the time of the first touch, and n if it is not given.
    fitted = _fitted_shape(time, force, inside, mass, speed, e, setup.exponent)
    log_e = float(fitted.x[1])
    alpha = _alpha_at(log_e, speed)
    # dα/d(ln e), s/m.
    by_log_e = (_alpha_at(log_e + _STEP_OF_LOG_E, speed) - alpha) / _STEP_OF_LOG_E
    # Places of ln k, n and ln e among what varies; α goes with ln e.
    covariance = _covariance(fitted, [0, None if setup.exponent else 3, 1])
    covariance[2, :] *= by_log_e
    covariance[:, 2] *= by_log_e
    covariance[2, 2] += (by_log_e * u_e / e) ** 2
    left = fitted.fun[inside]
    noise = _spread(force[np.logical_not(inside)]) / float(force.max())
    return ForceFit(
        file=name,
        kind="force",
        stiffness=math.exp(fitted.x[0]),
        exponent=setup.exponent or float(fitted.x[3]),
        alpha=alpha,
        covariance=covariance,
        e=e,
        e_uncertainty=u_e,
        speeds=(speed, speed),
        misfit=float(np.sqrt(np.mean(left**2))),
        systematic=_systematic(left, _in_a_row(int(inside.sum())), noise),
        e_by_shape=math.exp(log_e),
    )


# Step over which α is differentiated by ln e, and relative step of SciPy's derivatives.
_STEP_OF_LOG_E = 1e-5
# Points of the law's F(t), between which it is a line.
_POINTS_OF_LAW = 161


def _alpha_at(log_e: float, speed: float) -> float:
    """α, s/m, at which the law has this ln e at a speed, m/s."""
    return dissipation_of(log_e) / (1.5 * speed)


def _fitted_shape(
    time: Floats,
    force: Floats,
    inside: Floats,
    mass: float,
    speed: float,
    e: float,
    exponent: float | None,
) -> Any:
    """The result of SciPy's `least_squares` for the law's F(t) through a pulse.

    time, force: s and N, (n,), the force upwards and its zero removed.
    inside: mask of the push.
    mass, speed: kg and m/s.
    e: by the impulse, to start from.
    exponent: n where it is given.
    `x` of the result is ln k, ln e, the time of the first touch, s, and n unless that is given;
    `fun` is the difference of the force from the law's over the largest force, (n,).
    """
    # SciPy's optimisation is slow to import, and few data are forces.
    from scipy.optimize import least_squares

    top = float(force.max())
    first = float(time[inside][0])
    last = float(time[inside][-1])
    lasts = float(np.ptp(time[inside]))

    def residual(p: Floats) -> Floats:
        """Difference of the force from the law's over the largest, shape (n,), at these parameters."""
        n = exponent or max(float(p[3]), 1.0)
        # An e of 1 has no loss, and no ln.
        alpha = max(_alpha_at(min(p[1], -1e-6), speed), 0.0)
        law = HuntCrossley(math.exp(p[0]), alpha, n)
        loop = closed_form.loop(law, mass, speed, _POINTS_OF_LAW)
        of_law = np.interp(time, loop.time + p[2], loop.force, left=0.0, right=0.0)
        return np.asarray(force - of_law) / top

    # In a contact without loss (F t)² is k m times a function of n alone: good enough for a start.
    n = exponent or 1.5
    log_k = math.log(_stiffness_for(top, mass, speed, n))
    count = 3 if exponent else 4
    # Of each parameter: ln k, ln e, the time of the first touch, n.
    start = [log_k, math.log(e), first - 0.05 * lasts, n]
    low = [-np.inf, -8.0, float(time[0]) - lasts, 1.0]
    high = [np.inf, -1e-6, last, 4.0]
    scale = [1.0, 0.1, lasts, 0.3]
    return least_squares(
        residual,
        start[:count],
        bounds=(low[:count], high[:count]),
        x_scale=scale[:count],
        diff_step=[_STEP_OF_LOG_E] * count,
    )


def _by_impulse(name: str, speed: float, e: float, u_e: float) -> ForceFit:
    """The result for a push of too few samples for its shape: e at one speed, m/s, with its standard
    uncertainty, and α where the law holds.
    """
    by_e = 1.0 / (1.5 * speed)
    alpha = dissipation_of(math.log(e)) * by_e
    slope = (dissipation_of(math.log(e) + 1e-5) * by_e - alpha) / 1e-5
    covariance = np.full((3, 3), math.nan)
    covariance[2, 2] = (slope * u_e / e) ** 2
    return ForceFit(
        file=name,
        kind="force",
        stiffness=math.nan,
        exponent=math.nan,
        alpha=alpha,
        covariance=covariance,
        e=e,
        e_uncertainty=u_e,
        speeds=(speed, speed),
        misfit=math.nan,
        systematic=math.nan,
    )


def _approach(name: str, setup: MeasurementSetup) -> tuple[float, float, float, float]:
    """Mass in kg and speed in m/s, each with its standard uncertainty.
    Raises UserError without either.
    """
    if setup.mass is None:
        raise UserError("mass", f"not given for {name}", "the effective mass", "--mass '0.45 kg'")
    mass = setup.mass.value
    u_mass = setup.mass.uncertainty
    if setup.speed is not None:
        return mass, u_mass, setup.speed.value, setup.speed.uncertainty
    if setup.height is None:
        raise UserError(
            "speed", f"not given for {name}", "--speed of the approach, or --height of a drop"
        )
    speed, slope = setup.ballistics.dropped(setup.height.value)
    return mass, u_mass, speed, slope * setup.height.uncertainty


def _impulse(time: Floats, force: Floats, inside: Floats) -> tuple[float, float]:
    """The impulse, N s, from one pulse length before the push to one after it, and its uncertainty.

    The noise, and the drift of the zero from before the push to after it, make it uncertain; the
    uncertainty is standard.
    time, force: s and N, shape (n,), the force as `_pulse` returns it: upwards, its zero removed.
    inside: mask of the push, shape (n,), not empty.
    """
    pushing = np.flatnonzero(inside)
    first = int(pushing[0])
    last = int(pushing[-1])
    begin = max(0, 2 * first - last)
    end = min(len(force), 2 * last - first + 1)
    before = force[:first]
    after = force[last + 1 :]
    quiet = np.concatenate([before, after])
    # Standard deviation of the force outside the pulse, N.
    noise = float(np.std(quiet))
    # Duration of what is integrated, s: up to three pulses.
    window = float(time[end - 1] - time[begin])
    step = float(np.median(np.diff(time)))
    drift = 0.0
    if len(before) and len(after):
        drift = 0.5 * abs(float(np.median(before)) - float(np.median(after)))
    # Standard uncertainty of the zero, N.
    zero = noise / math.sqrt(len(quiet))
    # An error of the zero adds up over the whole time; noise adds up as its root.
    uncertainty = math.hypot(window * (drift + zero), noise * math.sqrt(window * step))
    return float(np.trapezoid(force[begin:end], time[begin:end])), uncertainty


def _pulse(name: str, time: Floats, force: Floats) -> tuple[Floats, Floats]:
    """Select the samples of the push: a mask, and the force, N, upwards and with its zero removed.

    time, force: s and N, shape (n,).
    Raises UserError without a push, with several, with fewer than 4 samples in it, or with too
    little quiet around it to set the zero.
    """
    force = force - _first_zero(force)
    smooth = _smoothed(force, _half_width(force))
    if abs(smooth.min()) > smooth.max():
        force = -force
        smooth = -smooth
    top = float(smooth.max())
    if not top > 0.0:
        raise UserError(name, "no push in the force", "one impact")
    # The quiet lies below its noise, which is known only once the push is: two rounds.
    limit = _EDGE * top
    for _ in range(2):
        first, last = _around(smooth, int(np.argmax(smooth)), limit)
        quiet = np.concatenate([force[:first], force[last + 1 :]])
        if len(quiet) < _LEAST_QUIET:
            raise UserError(
                name, "no quiet about the push", "as long a quiet as the push, for the zero"
            )
        calm = np.concatenate([smooth[:first], smooth[last + 1 :]])
        limit = max(limit, float(np.median(calm)) + 3.0 * _spread(calm))
    force = force - float(np.median(quiet))
    inside = (np.arange(len(force)) >= first) & (np.arange(len(force)) <= last)
    if inside.sum() < _LEAST_OF_IMPULSE:
        got = f"{inside.sum()} samples in the push"
        expected = f"{_LEAST_OF_IMPULSE} or more for e, {_LEAST_POINTS} or more for k, n and α"
        raise UserError(name, got, expected, "Sample faster")
    if calm.min() < -_ANOTHER * top:
        raise UserError(name, "a zero that is not quiet", "zero force before and after the push")
    if calm.max() > _ANOTHER * top:
        raise UserError(name, "several pushes", "one impact", "Cut out one of them")
    return np.asarray(inside), np.asarray(force)


def _first_zero(force: Floats) -> float:
    """The force (n,) at the ends of a record where both are alike; else its median, which is the quiet's
    where that is longer than the push.
    """
    count = max(_LEAST_QUIET, len(force) // 20)
    ends = [float(np.median(part)) for part in (force[:count], force[-count:])]
    if abs(ends[0] - ends[1]) < _ANOTHER * float(np.ptp(force)):
        return 0.5 * sum(ends)
    return float(np.median(force))


def _half_width(force: Floats) -> int:
    """Samples for which the force (n,) is above half of its largest, in a row and without noise."""
    loud = np.abs(force)
    width = 1
    for _ in range(3):
        smooth = _smoothed(loud, width)
        first, last = _around(smooth, int(np.argmax(smooth)), 0.5 * float(smooth.max()))
        width = last - first + 1
    return width


def _smoothed(force: Floats, width: int) -> Floats:
    """The force averaged over a tenth of `width` samples, (n,)."""
    from scipy.ndimage import uniform_filter1d

    return np.asarray(uniform_filter1d(force, max(1, width // 10), mode="nearest"))


def _around(values: Floats, top: int, limit: float) -> tuple[int, int]:
    """First and last sample of those in a row about `top` whose values (n,) are above a limit."""
    below = np.flatnonzero(values <= limit)
    place = int(np.searchsorted(below, top))
    first = 0
    if place > 0:
        first = int(below[place - 1]) + 1
    last = len(values) - 1
    if place < len(below):
        last = int(below[place]) - 1
    return first, last


def _spread(values: Floats) -> float:
    """Standard deviation of normal values (n,) by their median distance, blind to a few outliers."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _systematic(
    residual: Floats, groups: Sequence[Floats], known_noise: float | None = None
) -> float:
    """Root mean square of what a law leaves besides noise, in the unit of the residual.

    residual: (n,).
    groups: masks, (n,), of points that a smooth error would move alike. The part of noise in the
    groups' means is taken out; 0 where the means show no more than noise.
    known_noise: of a reading, where it is known: then all beyond it counts.
    """
    from scipy.special import chdtri

    if known_noise is not None:
        whole = float((residual**2).mean())
        if whole * len(residual) > known_noise**2 * chdtri(len(residual), _CHANCE):
            return math.sqrt(whole - known_noise**2)
    # (mean, variance of the mean, points) of each group.
    of_groups = []
    for at in groups:
        points = at.sum()
        if points > 2:
            of_groups.append((residual[at].mean(), residual[at].var(ddof=1) / points, points))
    if not of_groups:
        return 0.0
    rows = np.array(of_groups)
    # All groups have one noise; a group's own variance is too uncertain.
    noise = float((rows[:, 1] * rows[:, 2]).mean())
    by_noise = noise / rows[:, 2]
    square = rows[:, 0] ** 2
    if float((square / np.maximum(by_noise, 1e-300)).sum()) < chdtri(len(rows), _CHANCE):
        return 0.0
    return float(np.sqrt(max((square - by_noise).mean(), 0.0)))


def _stiffness_for(top: float, mass: float, speed: float, n: float) -> float:
    """k at which the largest force without loss is `top` (N)."""
    # F = k x^n and k x^(n+1) = (n+1) m v²/2 at the turn.
    return float(top ** (n + 1) / ((n + 1) * mass * speed**2 / 2.0) ** n)


def fit_loop(
    name: str, penetration: Floats, rate: Floats, force: Floats, exponent: float | None
) -> ForceFit:
    """F = k x^n (1 + (3/2) α ẋ) through points of any number of impacts.

    penetration, rate, force: shape (n,), m, m/s (above 0 on approach) and N. Points out of contact,
    at a penetration of 0 or less, are left out.
    exponent: n where it is known.
    Raises UserError for fewer than 20 points in contact, for points of approach or of rebound
    alone, and for a force that is surely larger on rebound.
    """
    used = penetration > 0.0
    x = penetration[used]
    v = rate[used]
    f = force[used]
    has_both = bool((v > 0).any() and (v < 0).any())
    if len(x) < _LEAST_POINTS or not has_both:
        got = f"{len(x)} points in contact, {int((v > 0).sum())} of them on approach"
        raise UserError(
            name, got, f"{_LEAST_POINTS} or more, on approach (rate above 0) and on rebound"
        )
    top = float(f.max())
    depth = float(x.max())

    # The force at `depth` in place of k, which hangs on n through its unit.
    def residual(p: Floats) -> Floats:
        n = exponent or float(p[2])
        return np.asarray((f - math.exp(p[0]) * (x / depth) ** n * (1.0 + 1.5 * p[1] * v)) / top)

    # Starting values: the ln of the force at `depth`, and α.
    start = [math.log(top), 0.1 / float(np.abs(v).max())]
    # Places of ln k, n and α among the parameters; None for an exponent that is given.
    order: list[int | None] = [0, None, 1]
    if not exponent:
        start.append(1.5)
        order = [0, 2, 1]
    from scipy.optimize import least_squares

    done = least_squares(residual, start, x_scale="jac")
    n = exponent or float(done.x[2])
    alpha = float(done.x[1])
    turn = np.eye(3)
    # ln k is the ln of the force at `depth` less n ln depth.
    turn[0, 1] = -math.log(depth)
    covariance = turn @ _covariance(done, order) @ turn.T
    if alpha < -_SIGMAS_BELOW * math.sqrt(covariance[2, 2]):
        got = f"α {alpha:.3g} s/m: the force is larger on rebound than on approach"
        raise UserError(
            name, got, "0 s/m or more", "Look at the sign of the rate: above 0 on approach"
        )
    return ForceFit(
        file=name,
        kind="loop",
        stiffness=math.exp(float(done.x[0])) / depth**n,
        exponent=n,
        alpha=alpha,
        covariance=covariance,
        e=math.nan,
        e_uncertainty=math.nan,
        speeds=(float(v[v > 0].min()), float(v.max())),
        misfit=float(np.sqrt(np.mean(done.fun**2))),
        systematic=_systematic(done.fun, _of_loop(x, v)),
    )


def _in_a_row(count: int) -> list[Floats]:
    """Masks, (count,) each, that cut a row of `count` into _GROUPS runs of neighbours."""
    place = np.arange(count) * _GROUPS // count
    return [np.asarray(place == k) for k in range(_GROUPS)]


def _of_loop(penetration: Floats, rate: Floats) -> list[Floats]:
    """Masks of neighbours in a loop, (n,): by penetration and by rate, on approach and on rebound.

    penetration: (n,), m.
    rate: of it, (n,), m/s, above 0 on approach.
    """
    groups = []
    for side in (rate > 0, rate <= 0):
        depth = np.argsort(np.argsort(np.where(side, penetration, np.inf)))
        speed = np.argsort(np.argsort(np.where(side, np.abs(rate), np.inf)))
        count = max(int(side.sum()), 1)
        # As many groups of speed as of depth: a loop of several impacts fills them all.
        for k, half in itertools.product(range(_DEPTHS), range(2)):
            at = side & (depth * _DEPTHS // count == k) & (speed * 2 // count == half)
            groups.append(np.asarray(at))
    return groups


def _covariance(fitted: Any, order: list[int | None]) -> Floats:
    """Covariance of three parameters, (3, 3), from the scatter about the fit.

    fitted: the result of SciPy's `least_squares`.
    order: places of the three among the fitted parameters; None for one that is given, whose row
    and column are 0.
    """
    jacobian = fitted.jac
    degrees = max(len(fitted.fun) - jacobian.shape[1], 1)
    of_fitted = np.linalg.pinv(jacobian.T @ jacobian) * float((fitted.fun**2).sum()) / degrees
    covariance = np.zeros((3, 3))
    for row, of_row in enumerate(order):
        for column, of_column in enumerate(order):
            if of_row is not None and of_column is not None:
                covariance[row, column] = of_fitted[of_row, of_column]
    return covariance


# A fit of forces, for a terminal and as JSON.


def as_record(force_fit: ForceFit) -> dict[str, object]:
    """The fit of forces as `--json` prints it, in SI units.

    None for a law that the pulse contradicts or does not show, and for what the shape does not give;
    NaN for the e of a loop.
    """
    low, high = force_fit.alpha_interval
    law = None
    if force_fit.is_law:
        law = "hunt-crossley"
    by_shape = None
    if not math.isnan(force_fit.e_by_shape):
        by_shape = force_fit.e_by_shape
    shape: dict[str, object] = dict.fromkeys(
        ("stiffness_n_per_m_n", "exponent", "covariance_ln_k_n_alpha", "misfit")
    )
    if force_fit.has_shape:
        shape = {
            "stiffness_n_per_m_n": force_fit.stiffness,
            "exponent": force_fit.exponent,
            "covariance_ln_k_n_alpha": force_fit.covariance.tolist(),
            "misfit": force_fit.misfit,
        }
    return {
        "schema": 1,
        "kind": "hcbench fit",
        "files": [{"name": force_fit.file, "kind": force_fit.kind}],
        "law": law,
        "law_asked": "hunt-crossley",
        "alpha_s_per_m": force_fit.alpha,
        "alpha_standard_uncertainty_s_per_m": force_fit.alpha_uncertainty,
        "alpha_interval_95_s_per_m": [low, high],
        "restitution": force_fit.e,
        "restitution_interval_95": [
            force_fit.e - SIGMAS_95 * force_fit.e_uncertainty,
            force_fit.e + SIGMAS_95 * force_fit.e_uncertainty,
        ],
        "restitution_by_shape": by_shape,
        "shape_contradicts_impulse": force_fit.contradicts,
        "laws": [],
        "flagged": [],
        **shape,
        "speed_range_m_per_s": list(force_fit.speeds),
    }


def lines_of(force_fit: ForceFit, describe: Callable[[float, float], str]) -> list[str]:
    """The main numbers of the fit, a line each.

    describe: a function of a value and its standard uncertainty that writes both, with their
    digits.
    Stiffness k is in N/m^n, α in s/m; misfit is the rms difference over the largest force.
    """
    low, high = force_fit.alpha_interval
    if not force_fit.has_shape:
        return [
            f"data      {force_fit.file}: {force_fit.kind}, a push of fewer than {_LEAST_POINTS} samples",
            f"e         {describe(force_fit.e, force_fit.e_uncertainty)} by the impulse, "
            f"at {force_fit.speeds[1]:.3g} m/s",
            f"α         {describe(force_fit.alpha, force_fit.alpha_uncertainty)} s/m, 95 %: {low:.4g} ... "
            f"{high:.4g} s/m, if it is hunt-crossley: one e does not show it",
            f"k, n      need {_LEAST_POINTS} samples or more in the push: sample faster",
        ]
    sd = np.sqrt(np.diag(force_fit.covariance))
    k = force_fit.stiffness
    n = force_fit.exponent
    lines = [
        f"data      {force_fit.file}: {force_fit.kind}, fitted with the law",
        f"k         {describe(k, k * sd[0])} N/m^{n:.4g}",
        f"n         {describe(n, sd[1])}",
        f"α         {describe(force_fit.alpha, sd[2])} s/m, 95 %: {low:.4g} ... {high:.4g} s/m",
    ]
    if not math.isnan(force_fit.e):
        lines.append(
            f"e         {describe(force_fit.e, force_fit.e_uncertainty)} by the impulse, without k and n, "
            f"at {force_fit.speeds[1]:.3g} m/s"
        )
    if force_fit.contradicts:
        lines.append(
            f"          {force_fit.e_by_shape:.4f} by the pulse's shape: they contradict. The impulse "
            f"means α = {force_fit.alpha_by_impulse:.4g} s/m; do not use k and n"
        )
    if sd[0] and sd[1]:
        together = force_fit.covariance[0, 1] / (sd[0] * sd[1])
        lines.append(f"ln k, n   correlation {together:.3f}: --exponent fixes n where it is known")
    lines.append(f"misfit    {100 * force_fit.misfit:.2g} % of the largest force (rms)")
    if not force_fit.is_law:
        lines.append(
            "law       not Hunt and Crossley's: the force does not follow it, and α has little meaning"
        )
    return lines


def as_text(force_fit: ForceFit, describe: Callable[[float, float], str], engine: str) -> str:
    """The fit for a terminal, and the command to go on with; no command where the law does not fit.

    describe: as of `lines_of`.
    engine: the name that the command has.
    """
    lines = lines_of(force_fit, describe)
    if not force_fit.is_law:
        return "\n".join(lines) + "\n"
    alpha = describe(max(force_fit.alpha, 0.0), force_fit.alpha_uncertainty)
    stiffness = (
        f'--stiffness "{force_fit.stiffness:.5g}" --exponent {max(force_fit.exponent, 1.0):.5g}'
    )
    tuned = f'--alpha "{alpha} s/m" {stiffness}'
    return (
        "\n".join(
            [*lines, "", "next:", f"  hcbench tune {engine} {tuned} --timestep 1e-5 --match both"]
        )
        + "\n"
    )
