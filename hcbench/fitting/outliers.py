"""Scatter with outliers: each e gets a width of its own, as Student's t distribution has it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.estimate import fit_law

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.which_law import CandidateLaw
    from hcbench.terms.impact import Floats

# An impact with a lower weight is named.
LOW_WEIGHT = 0.3
# With a larger share of outliers another law is at work.
MOST_OUTLIERS = 0.25
# Degrees of freedom of Student's t distribution, which stands for the scatter with outliers.
_FREEDOM = 4.0
_ROUNDS = 3


def scatter_widths(law: CandidateLaw, sets: Sequence[Dataset], reference: float) -> list[Floats]:
    """Width of each e's scatter over s_e, (m,) per data set, the same for all laws.

    t as a mixture of normal distributions: the weight of an impact is the mean of its
    precision, given how far its e is off the law (expectation maximisation). Laws with weights
    of their own could not be compared.

    reference: m/s.
    """
    widths: list[Floats] | None = None
    for _ in range(_ROUNDS):
        fit = fit_law(law, sets, reference, widths)
        widths = []
        for change, wide, reduced, noise in zip(
            fit.latent, fit.width, fit.reduced, fit.noise, strict=True
        ):
            variance = reduced.latent_variance(fit.scatter, noise)
            # Mean square of each e off the law, in units of s_e².
            square = ((change / wide) ** 2 + variance) * wide**2 / fit.scatter**2
            widths.append(np.sqrt((_FREEDOM + square) / (_FREEDOM + 1.0)))
    assert widths is not None
    return widths


def doubted_impacts(sets: Sequence[Dataset], widths: Sequence[Floats]) -> list[str]:
    """The impacts that count little, each by its file and its touch.

    widths: of each data set's e over s_e, shape (m,); the weight of an e is 1/width².
    """
    doubted: list[str] = []
    for s, wide in zip(sets, widths, strict=True):
        touches = zip(s.touches(), wide, strict=True)
        doubted += [f"{s.name}, {touch}" for touch, w in touches if w**-2 < LOW_WEIGHT]
    return doubted
