"""Impacts measured one by one, and heights of successive bounces, as linear models about parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hcbench.fitting.datasets import (
    Dataset,
    bounce_train,
    drop_prior,
    pairs_of_launches,
    rounding_of,
)
from hcbench.fitting.estimate import ENDS
from hcbench.fitting.linear import Estimate, LinearModel
from hcbench.terms.resolution import SIGMAS_95

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.flight import Ballistics
    from hcbench.fitting.recording import Indices
    from hcbench.fitting.setup import MeasurementSetup
    from hcbench.fitting.which_law import FittedCurve
    from hcbench.terms.impact import Floats

# Impacts measured one by one: pairs of speed and e, or of the speeds in and out.


@dataclass(frozen=True, slots=True)
class DropHeights:
    """Heights from which a ball was let go, one impact each, and what was read after it: (n,) each.

    height, uncertainty: of the drops, m; 0 where none is given.
    rebound: height after each impact, m; None where there is another reading.
    flight: time from each impact to the next, s; likewise.
    """

    height: Floats
    uncertainty: Floats
    rebound: Floats | None = None
    flight: Floats | None = None

    def speeds(self, ballistics: Ballistics) -> tuple[Floats, Floats]:
        """Impact speeds and their standard uncertainties, m/s: (n,) each."""
        by_height = np.array([ballistics.dropped(height) for height in self.height])
        return by_height[:, 0], by_height[:, 1] * self.uncertainty

    def rebounds(self, ballistics: Ballistics) -> Floats | None:
        """Speeds after the impacts, m/s, (n,); None without a height or a flight after them."""
        if self.flight is not None:
            return np.array([ballistics.launch(time) for time in self.flight])
        if self.rebound is not None:
            return ballistics.launch_to(self.rebound)
        return None


@dataclass(frozen=True, slots=True)
class SpeedPairs(Dataset):
    """Impacts measured one by one.

    speed, restitution: (n,), m/s and 1.

    speed_uncertainty, restitution_uncertainty: (n,), standard, 0 where none is given.
    twice: whether e is v_out/v_in, so that an error of v_in counts in both; then without
    uncertainties the relative error of both speeds is to be found.
    drops: of which the speeds are, by gravity and the air; None where speeds are given.
    """

    name: str
    setup: MeasurementSetup
    speed: Floats
    restitution: Floats
    speed_uncertainty: Floats
    restitution_uncertainty: Floats
    twice: bool = False
    assumed: str = ""
    drops: DropHeights | None = None
    noise_scale: ClassVar[float] = 0.01
    noise_unit: ClassVar[str] = ""

    @property
    def kind(self) -> str:
        """Name of this kind of data."""
        if self.twice:
            return "speeds"
        return "pairs"

    @property
    def _is_given(self) -> bool:
        return bool((self.speed_uncertainty > 0).any() or (self.restitution_uncertainty > 0).any())

    @property
    def known_noise(self) -> float | None:
        """s_m where it is given."""
        if self.twice and not self._is_given:
            return None
        return 1.0

    @property
    def needs_gravity(self) -> bool:
        """False: no speed is of the flight between two impacts."""
        return False

    @property
    def depends_on_setup(self) -> bool:
        """True if the speeds are those of drops."""
        return self.drops is not None

    def with_setup(self, setup: MeasurementSetup) -> SpeedPairs:
        """The same readings under other conditions; drops then have other speeds."""
        if self.drops is None:
            return replace(self, setup=setup)
        speed, uncertainty = self.drops.speeds(setup.ballistics)
        after = self.drops.rebounds(setup.ballistics)
        e = self.restitution if after is None else after / speed
        return replace(self, setup=setup, speed=speed, restitution=e, speed_uncertainty=uncertainty)

    def pairs(self) -> tuple[Floats, Floats]:
        """The given impact speeds (m/s) and e."""
        return self.speed, self.restitution

    def start(self) -> Floats:
        """Own parameters to start from."""
        return np.zeros(0)

    def linearise(self, curve: FittedCurve, own: Floats, latent: Floats) -> LinearModel:
        """Linear model of the relative errors of e about a law, one row for each of n impacts.

        curve: the law with its parameters.
        own, latent: unused, since the model has no own parameters and is linear in the changes of
        e.
        The noise of each row has the relative uncertainties of the speed and of e.
        """
        n = len(self.speed)
        # Of the law at each speed: ln e, its slope over ln v, its derivatives by the parameters.
        log_e = np.empty(n)
        slope = np.empty(n)
        by_law = np.empty((n, curve.count))
        for i, v in enumerate(self.speed):
            log_e[i], slope[i], by_law[i] = curve.local(v)
        e = np.exp(log_e)
        of_e = self.restitution_uncertainty / e
        if not self.twice:
            shape = np.hypot(slope * self.speed_uncertainty / self.speed, of_e)
        elif self._is_given:
            # e is v_out/v_in: an error of v_in changes e itself, too.
            shape = np.hypot((1.0 + slope) * (self.speed_uncertainty / self.speed), of_e)
        else:
            # Both speeds have the same uncertainty.
            shape = np.hypot(1.0 + slope, np.ones(n))
        return LinearModel(
            residual=self.restitution / e - 1.0,
            by_own=np.zeros((n, 0)),
            by_law=by_law,
            by_scatter=np.eye(n),
            shape=np.maximum(shape, 1e-9),
            prior=np.zeros((0, 2)),
            speed=self.speed,
        )

    def touches(self) -> list[str]:
        """Labels for the columns of by_scatter."""
        return [f"the pair at {v:.4g} m/s" for v in self.speed]


# Heights of successive bounces as a linear model about parameters.


@dataclass(frozen=True, slots=True)
class Heights(Dataset):
    """Heights to which a ball rises after successive bounces.

    heights: (n,), m, of successive bounces; the first may be where the ball was let go.
    uncertainty: standard, of each height, m; None: to be found from their scatter.
    numbers: (n,), which bounce each is, from 0; None: none is missing.

    Own parameter: ln of the speed of the first touch where the drop height is
    given, else of the first launch.
    """

    name: str
    setup: MeasurementSetup
    heights: Floats
    uncertainty: float | None = None
    assumed: str = ""
    numbers: Indices | None = None
    noise_unit: ClassVar[str] = "m"

    @property
    def noise_scale(self) -> float:
        """Likely size of the noise of measuring, m: its rounding at least."""
        return max(1e-3, rounding_of(self.heights))

    @property
    def kind(self) -> str:
        """Name of this kind of data."""
        return "heights"

    @property
    def known_noise(self) -> float | None:
        """s_m where it is given."""
        return self.uncertainty

    @property
    def which(self) -> Indices:
        """Number of the bounce of each height, from 0: shape (n,)."""
        if self.numbers is None:
            return np.arange(len(self.heights))
        return self.numbers

    def _launches(self) -> Floats:
        """Launch speeds that reach the heights, m/s: shape (n,)."""
        return self.setup.ballistics.launch_to(self.heights)

    def pairs(self) -> tuple[Floats, Floats]:
        """Rough impact speeds (m/s) and e, without the law; of bounces in a row alone."""
        speed, e = pairs_of_launches(self._launches(), self.setup, self.setup.drop)
        steps = np.diff(self.which)
        if self.setup.height is not None:
            steps = np.diff(self.which, prepend=-1)
        if (steps == 1).any():
            return speed[steps == 1], e[steps == 1]
        # Over a gap e is that of several bounces; better than none to start from.
        return speed, e ** (1.0 / steps)

    def start(self) -> Floats:
        """Own parameters to start from."""
        height = self.setup.height
        if height is None:
            return np.log(self._launches()[:1])
        return np.log([self.setup.ballistics.dropped(height.value)[0]])

    def linearise(self, curve: FittedCurve, own: Floats, latent: Floats) -> LinearModel:
        """Linear model of the heights about a law, own parameters and relative changes of each e.

        curve: the law with its parameters.
        own: ln of the first speed, m/s.
        latent: relative change of each e, shape (m,). The residual is that at no changes: what the
        ones given do is added back to first order.
        The residuals are heights, m, one for each bounce.
        """
        dropped = self.setup.height is not None
        ballistics = self.setup.ballistics
        train = bounce_train(curve, ballistics, math.exp(own[0]), latent, dropped)
        apex = np.array([ballistics.apex(w) for w in train.launch])
        by = (apex[:, 1:] * train.by)[self.which]
        q = curve.count
        return LinearModel(
            residual=self.heights - apex[self.which, 0] + by[:, 1 + q :] @ latent,
            by_own=by[:, :1],
            by_law=by[:, 1 : 1 + q],
            by_scatter=by[:, 1 + q :],
            shape=np.ones(len(self.heights)),
            prior=np.array([drop_prior(self.setup, own[0])]),
            speed=train.touch,
        )

    def touches(self) -> list[str]:
        """Labels for the columns of by_scatter."""
        count = int(self.which[-1]) + (self.setup.height is not None)
        return [f"bounce {i + 1}" for i in range(count)]

    def rows(self) -> list[str]:
        """Labels for the rows of the residual."""
        return [f"height {i + 1}" for i in self.which]


# Grid over the scatter between drops.
_BETWEEN = np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 60)])
# Scale of the half-Cauchy prior of the scatter between drops.
_SCALE = 0.05
# A file so many standard deviations from the others is named.
_ODD = 4.0
_LEAST_OTHERS = 2
# Stands for the lower end of an interval that reaches 0, as a share of the value.
_LOWEST = 1e-2


@dataclass(frozen=True, slots=True)
class Drops:
    """Value shared by all drops, over a grid of the scatter between drops τ, (t,).

    share: posterior of τ.

    mean, sd: (t,), of ln of the shared value at each τ.
    """

    share: Floats
    mean: Floats
    sd: Floats

    @property
    def between(self) -> float:
        """Share of the value by which the drops differ, its posterior mean."""
        return float(self.share @ _BETWEEN)

    def estimate(self, inputs: float = 0.0) -> Estimate:
        """The shared value, with its 95 % interval.

        inputs: relative standard uncertainty that all drops have in common.
        """
        low, middle, high = np.exp(_quantiles(self.share, self.mean, np.hypot(self.sd, inputs)))
        mean = float(self.share @ self.mean)
        spread = float(self.share @ (self.sd**2 + (self.mean - mean) ** 2)) + inputs**2
        return Estimate(float(middle), float(middle * np.sqrt(spread)), float(low), float(high))


def shared_value(each: Sequence[Estimate]) -> Drops:
    """The value that several drops share, and by how much they differ, from a random-effects model."""
    x, s = _logs(each)
    log_likelihood, mean, sd = _over_between(x, s)
    return Drops(_shares(log_likelihood + _prior()), mean, sd)


def odd_drops(each: Sequence[Estimate]) -> list[tuple[int, float]]:
    """The drop that goes least with the others: its place, and by how many standard deviations; or
    none.

    each: values above 0. Every drop is compared with the others alone, which have to be two or
    more. The list has one pair at most; the sign tells whether the value is above or below.
    """
    x, s = _logs(each)
    doubtful = []
    for k in range(len(each)):
        others = np.arange(len(each)) != k
        if others.sum() < _LEAST_OTHERS:
            break
        log_likelihood, mean, sd = _over_between(x[others], s[others])
        share = _shares(log_likelihood + _prior())
        middle = float(share @ mean)
        between = float(share @ _BETWEEN)
        variance = float(share @ (sd**2 + (mean - middle) ** 2))
        off = float((x[k] - middle) / np.sqrt(s[k] ** 2 + between**2 + variance))
        if abs(off) > _ODD:
            doubtful.append((k, off))
    return sorted(doubtful, key=lambda one: -abs(one[1]))[:1]


def ratio(one: Sequence[Estimate], other: Sequence[Estimate]) -> Estimate:
    """The ratio of two materials' values, each from its drops; both scatter alike between drops.

    one, other: values above 0, with their intervals. The ratio has its 95 % interval.
    """
    (log_one, mean_one, sd_one), (log_other, mean_other, sd_other) = (
        _over_between(*_logs(each)) for each in (one, other)
    )
    share = _shares(log_one + log_other + _prior())
    low, middle, high = np.exp(_quantiles(share, mean_one - mean_other, np.hypot(sd_one, sd_other)))
    return Estimate(float(middle), float((high - low) / (2.0 * SIGMAS_95)), float(low), float(high))


def _logs(each: Sequence[Estimate]) -> tuple[Floats, Floats]:
    """ln of each drop's value, above 0, and its standard deviation by its interval; (drops,) each."""
    logs = np.log([e.value for e in each])
    deviations = []
    for e in each:
        # An interval may begin at 0, which has no logarithm.
        low = max(e.low, _LOWEST * e.value)
        deviations.append(np.log(e.high / low) / (2.0 * SIGMAS_95))
    return logs, np.maximum(np.array(deviations), 1e-9)


def _over_between(x: Floats, s: Floats) -> tuple[Floats, Floats, Floats]:
    """ln of the likelihood of each τ with μ integrated out, and mean and standard deviation of μ
    there.

    μ is the middle of all drops, τ the scatter between them: a value of the grid _BETWEEN, shape
    (g,).

    x, s: estimate of each drop and its standard deviation, shape (drops,).
    The three results have the shape (g,).
    """
    weight = 1.0 / (s**2 + _BETWEEN[:, None] ** 2)
    total = weight.sum(axis=1)
    mean = (weight * x).sum(axis=1) / total
    log_likelihood = 0.5 * np.log(weight).sum(axis=1) - 0.5 * np.log(total)
    log_likelihood -= 0.5 * (weight * (x - mean[:, None]) ** 2).sum(axis=1)
    return log_likelihood, mean, total**-0.5


def _prior() -> Floats:
    return np.asarray(np.log(np.gradient(_BETWEEN)) - np.log1p((_BETWEEN / _SCALE) ** 2))


def _shares(log_density: Floats) -> Floats:
    density = np.exp(log_density - log_density.max())
    return np.asarray(density / density.sum())


def _quantiles(share: Floats, mean: Floats, sd: Floats) -> Floats:
    """2.5 %, 50 % and 97.5 % of a mixture of normal distributions."""
    from scipy.special import ndtr

    at = np.linspace((mean - 8 * sd).min(), (mean + 8 * sd).max(), 4001)
    below = (share[:, None] * ndtr((at - mean[:, None]) / sd[:, None])).sum(axis=0)
    return np.interp(ENDS, below, at)
