"""Numbers with their uncertainty: a parameter of one law, and α with and without a constant loss."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.estimate import quantiles
from hcbench.terms.resolution import SIGMAS_95

if TYPE_CHECKING:
    from hcbench.fitting.estimate import LawFit
    from hcbench.terms.impact import Floats

ENDS = (0.025, 0.5, 0.975)
# Of eq. (16) with e0 against without: below that, the interval of α spans both
ODDS_TO_DROP = 25.0
# odds, for the value between the two: some constant loss is the rule
_PRIOR_OF_E0 = 3.0


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its standard uncertainty and its 95 % interval, SI."""

    value: float
    uncertainty: float
    low: float
    high: float


def estimate_of(fit: LawFit, name: str, inputs: float = 0.0) -> Estimate:
    """A parameter from the posterior of its law. inputs: what is given adds this much, in quadrature."""
    return _estimate(
        fit.values(name), fit.posterior.weight, inputs, 0.0, math.inf if name == "alpha" else 1.0
    )


def widened(estimate: Estimate, factor: float) -> Estimate:
    """The estimate with an interval that many times as wide."""
    value = estimate.value
    low, high = value - factor * (value - estimate.low), value + factor * (estimate.high - value)
    return Estimate(value, factor * estimate.uncertainty, max(0.0, low), high)


def alpha_of(plain: LawFit, lossy: LawFit, inputs: float = 0.0, odds: float = ODDS_TO_DROP) -> Estimate:
    """α of eq. (16) where a constant loss e0 may be present.

    The interval reaches from the lower to the upper end of both laws' 95 % intervals, as long as the odds
    between them lie within 25 : 1, or what is given. An average by odds is too narrow: at e0 = 0.99 the law
    without e0 is favoured for having one parameter less, and the average contains the true value 84 % of the
    time.
    """
    kept = in_question(plain, lossy, odds)
    estimates = [estimate_of(fit, "alpha", inputs) for fit in kept]
    if len(estimates) == 1:
        return estimates[0]
    lead = plain.log_evidence - lossy.log_evidence
    lead = min(max(lead, -700.0), 700.0)  # exp of more overflows
    share = 1.0 / (1.0 + math.exp(lead) / _PRIOR_OF_E0)  # of the law with e0
    values = np.concatenate([fit.values("alpha") for fit in kept])
    weight = np.concatenate([(1.0 - share) * plain.posterior.weight, share * lossy.posterior.weight])
    both = _estimate(values, weight, inputs, 0.0, math.inf)
    low = min(estimate.low for estimate in estimates)
    high = max(estimate.high for estimate in estimates)
    return Estimate(both.value, both.uncertainty, low, high)


def in_question(plain: LawFit, lossy: LawFit, odds: float) -> list[LawFit]:
    """The fits of the two laws that the other does not rule out at these odds."""
    lead = plain.log_evidence - lossy.log_evidence
    limit = math.log(odds)
    kept = []
    if lead > -limit:
        kept.append(plain)
    if lead < limit:
        kept.append(lossy)
    return kept


def _estimate(values: Floats, weight: Floats, inputs: float, least: float, most: float) -> Estimate:
    low, middle, high = quantiles(values, weight, ENDS)
    mean = float(values @ weight)
    sd = math.sqrt(float((values - mean) ** 2 @ weight))
    down, up = (math.hypot(side, SIGMAS_95 * inputs) for side in (middle - low, high - middle))
    return Estimate(middle, math.hypot(sd, inputs), max(least, middle - down), min(most, middle + up))
