"""Touches that do not go with the others: named, not dropped; and what
another reading would be worth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtri, logsumexp

from hcbench.fitting.linear import reduce
from hcbench.fitting.noise import coarse_grid

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.estimate import LawFit
    from hcbench.fitting.linear import Reduced
    from hcbench.terms.impact import Floats

# Chance that good data have one touch flagged.
_CHANCE = 0.01
# With fewer degrees of freedom no outlier can be told from the scatter.
_LEAST_FREE = 3


@dataclass(frozen=True, slots=True)
class Flag:
    """A touch that stands out from the others of its data.

    file, touch: which.
    what: "measured off" or "bounced off".
    size: how far, in SI or as a share of e.
    sigmas: how far from the others, in standard deviations with this touch left out.
    """

    file: str
    touch: str
    what: str
    size: float
    sigmas: float


def flagged_touches(fit: LawFit, sets: Sequence[Dataset]) -> Iterator[Flag]:
    """Flag touches that one more parameter, their own error, would make much likelier; one for each
    data set.

    A touch may have bounced off the curve, or have been measured off. The limit holds for all
    candidates together, so that 1 % of good data sets have a flag. Data with fewer than 3 degrees
    of freedom have none.
    """
    for i, (s, model) in enumerate(zip(sets, fit.models, strict=True)):
        degrees = len(model.residual) - model.by_own.shape[1] - model.by_law.shape[1]
        if degrees < _LEAST_FREE:
            continue
        candidates = [(name, "bounced off") for name in s.touches()]
        candidates += [(name, "measured off") for name in s.rows()]
        # What one unit of each candidate's error does to the residual, a column each.
        columns = [*model.by_scatter.T, *np.eye(len(s.rows()))]
        directions = np.stack(columns, axis=1)
        gain, size = _gains(fit, i, directions)
        limit = float(chdtri(1, _CHANCE / len(candidates)))
        worst = int(np.argmax(gain))
        if gain[worst] > limit:
            name, what = candidates[worst]
            yield Flag(s.name, name, what, float(size[worst]), float(np.sqrt(gain[worst])))


def _gains(fit: LawFit, i: int, directions: Floats) -> tuple[Floats, Floats]:
    """Twice the gain in ln likelihood by a parameter along each direction (n, c), and its value."""
    model = fit.models[i]
    grid = fit.surface.grid
    left, offset = _without_law(reduce(model, directions), grid.log_scatter, grid.log_noise[i])
    of_residual = left[..., 0, 0]
    along = np.diagonal(left, axis1=-2, axis2=-1)[..., 1:]
    score = left[..., 0, 1:]
    prior = fit.surface.prior_scatter[:, None] + fit.surface.prior_noise[i]
    before = offset + prior - 0.5 * of_residual
    gain = score**2 / np.maximum(along, 1e-300)
    after = before[..., None] + 0.5 * gain
    flat = after.reshape(-1, after.shape[-1])
    best = flat.argmax(axis=0)
    size = (score / np.maximum(along, 1e-300)).reshape(flat.shape)
    columns = np.arange(flat.shape[1])
    return 2.0 * (flat[best, columns] - before.max()), size[best, columns]


def _without_law(reduced: Reduced, log_scatter: Floats, log_noise: Floats) -> tuple[Floats, Floats]:
    """Eliminate the law's parameters: matrices of the right-hand sides over s_e and s_m, and
    offsets.
    """
    scatter, noise = np.meshgrid(np.exp(log_scatter), np.exp(log_noise), indexing="ij")
    matrix, offset = reduced.profile(scatter, noise)
    q = reduced.law
    law = matrix[..., :q, :q]
    cross = matrix[..., :q, q:]
    rest = matrix[..., q:, q:]
    # A law that has no slope where it ends leaves a singular matrix: nothing to eliminate.
    law = law + 1e-9 * np.eye(q)
    offset = offset - 0.5 * np.linalg.slogdet(law)[1]
    return rest - np.swapaxes(cross, -1, -2) @ np.linalg.solve(law, cross), offset


def gains_by_moving(fit: LawFit, s: Dataset, rows: Sequence[int], moves: Floats) -> Floats:
    """The gain in ln evidence where one reading each is another, to first order: shape (c,).

    rows: which reading, moves: (c,), by how much.
    s: the one data set that was fitted, its noise not given.
    """
    (model,) = fit.models
    moved = np.repeat(model.residual[:, None], len(moves), axis=1)
    moved[rows, np.arange(len(moves))] += moves
    grid = coarse_grid([s])
    reduced = reduce(model, moved, np.repeat(model.prior[None, :, 0], len(moves), axis=0))
    left, offset = _without_law(reduced, grid.log_scatter, grid.log_noise[0])
    prior_scatter, (prior_noise,) = grid.weights([s])
    prior = prior_scatter[:, None] + prior_noise
    squares = np.diagonal(left, axis1=-2, axis2=-1)
    evidence = logsumexp((offset + prior)[..., None] - 0.5 * squares, axis=(0, 1))
    return np.asarray(evidence[1:] - evidence[0])
