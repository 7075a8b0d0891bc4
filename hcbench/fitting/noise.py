"""Grids over scatter and noise of measuring, and the likelihood of a law over them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.linear import Reduced
    from hcbench.terms.impact import Floats

# Likeliest scatter of e from one impact to the next: 0.1 to 2 % are seen.
SCATTER_SCALE = 0.0035
# The grid reaches so many times below and above what is likely.
_SPAN = 1e4
# Scale of the prior of the noise, in ln: instruments differ by a factor of three.
_FACTOR = math.log(3.0)
# Largest scatter of e: bodies other than balls scatter by a third.
MOST_SCATTER = 1.0
# Points of the first grid, over all noise that is possible.
_COARSE = 19
# Points of the grid about the likeliest noise.
_FINE = 13
# A point of the grid is dropped if the ln of its density is this far below the largest.
_NEGLIGIBLE = 9.0


def scatter_prior(log_scatter: Floats) -> Floats:
    """ln of the density over ln s_e, in the shape of `log_scatter`.

    1/s_e is half a normal distribution, of width 1/SCATTER_SCALE. It has almost nothing below a
    third of the scale, so that few touches that happen to lie on the curve do not get an interval
    of no width, and a long tail above it.
    """
    away = SCATTER_SCALE * np.exp(-log_scatter)
    return np.asarray(0.5 * math.log(2.0 / math.pi) + np.log(away) - 0.5 * away**2)


def noise_prior(log_noise: Floats, scale: float) -> Floats:
    """ln of the density over ln s_m: about a scale, with long tails: instruments differ more."""
    away = (log_noise - math.log(scale)) / _FACTOR
    return np.asarray(-np.log(math.pi * _FACTOR * (1.0 + away**2)))


@dataclass(frozen=True, slots=True)
class NoiseGrid:
    """A grid over the scatter of e and the noise of each data set.

    log_scatter: (k,), ln s_e, even.
    log_noise: one array (l,) of ln s_m, even, a data set.
    """

    log_scatter: Floats
    log_noise: tuple[Floats, ...]

    def weights(self, sets: Sequence[Dataset]) -> tuple[Floats, list[Floats]]:
        """ln of prior mass of each value: of s_e, and of s_m a data set.

        Shapes (k,) and, a data set, (l,). A known s_m is one point with all the mass.
        """
        each = []
        for grid, s in zip(self.log_noise, sets, strict=True):
            if s.known_noise is not None:
                each.append(np.zeros(1))
            else:
                each.append(noise_prior(grid, s.noise_scale) + _log_cell(grid))
        return scatter_prior(self.log_scatter) + _log_cell(self.log_scatter), each


def _log_cell(grid: Floats) -> float:
    return math.log(grid[1] - grid[0])


def coarse_grid(sets: Sequence[Dataset]) -> NoiseGrid:
    """A coarse grid over all noise that is possible: ln s_e, and ln s_m for each data set.

    A data set with a known s_m has that value alone.
    """
    scatter = np.linspace(math.log(SCATTER_SCALE / _SPAN), math.log(MOST_SCATTER), _COARSE)
    # About ln of a data set's own scale.
    around = np.linspace(-math.log(_SPAN), math.log(100.0), _COARSE)
    noise = []
    for s in sets:
        if s.known_noise is None:
            noise.append(np.log(s.noise_scale) + around)
        else:
            noise.append(np.log([s.known_noise]))
    return NoiseGrid(scatter, tuple(noise))


@dataclass(frozen=True, slots=True)
class NoiseLikelihood:
    """Likelihood of a law's parameters δ over a grid of noise, for each data set.

    outer: (k, l, q+1, q+1) matrices S; offset: (k, l).
    """

    grid: NoiseGrid
    outer: tuple[Floats, ...]
    offset: tuple[Floats, ...]
    prior_scatter: Floats
    prior_noise: tuple[Floats, ...]

    def over_noise(self, delta: Floats) -> list[Floats]:
        """ln of prior times likelihood at one δ (q,) for each data set: (k, l)."""
        z = np.concatenate([-delta, [1.0]])
        return [
            offset - 0.5 * (outer @ z) @ z + prior
            for outer, offset, prior in zip(self.outer, self.offset, self.prior_noise, strict=True)
        ]

    def log_posterior(self, deltas: Floats) -> tuple[Floats, Floats]:
        """ln of the likelihood at δ (g, q), noise integrated out:
        (g,), and its parts by s_e: (k, g).
        """
        z = np.concatenate([-deltas, np.ones((len(deltas), 1))], axis=1)
        total = np.tile(self.prior_scatter[:, None], (1, len(deltas)))
        q = z.shape[1]
        # z S z as a product of S with the monomials of z: one matrix product for the whole grid.
        monomials = np.einsum("ga,gb->abg", z, z).reshape(q * q, -1)
        for outer, offset, prior in zip(self.outer, self.offset, self.prior_noise, strict=True):
            k, n = offset.shape
            quadratic = (outer.reshape(k * n, q * q) @ monomials).reshape(k, n, -1)
            exponent = (offset + prior)[..., None] - 0.5 * quadratic
            top = exponent.max(axis=1, keepdims=True)
            total += (top + np.log(np.exp(exponent - top).sum(axis=1, keepdims=True)))[:, 0]
        return np.asarray(logsumexp(total, axis=0)), total


def surface(
    reduced: Sequence[Reduced], sets: Sequence[Dataset], grid: NoiseGrid
) -> NoiseLikelihood:
    """The likelihood over a grid; right-hand sides after the residual are left out."""
    outer, offset = [], []
    for one, log_noise in zip(reduced, grid.log_noise, strict=True):
        scatter, noise = np.meshgrid(np.exp(grid.log_scatter), np.exp(log_noise), indexing="ij")
        matrices, offsets = one.profile(scatter, noise)
        outer.append(matrices[..., : one.law + 1, : one.law + 1])
        offset.append(offsets)
    prior_scatter, prior_noise = grid.weights(sets)
    return NoiseLikelihood(grid, tuple(outer), tuple(offset), prior_scatter, tuple(prior_noise))


def refined(coarse: NoiseLikelihood, delta: Floats, sets: Sequence[Dataset]) -> NoiseGrid:
    """A grid over what the coarse one leaves likely at δ.

    delta: change of the law's parameters, shape (q,). A known s_m keeps its one value.

    Raises FloatingPointError where no noise is likely.
    """
    per_set = coarse.over_noise(delta)
    by_scatter = [logsumexp(part, axis=1) for part in per_set]
    total = coarse.prior_scatter + sum(by_scatter)
    scatter = _zoomed(coarse.grid.log_scatter, total)
    noise = []
    for s, grid, part, own in zip(sets, coarse.grid.log_noise, per_set, by_scatter, strict=True):
        if s.known_noise is not None:
            noise.append(grid)
            continue
        # This data set's own part of the total is in `part`, over its noise.
        over = logsumexp(part + (total - own)[:, None], axis=0)
        noise.append(_zoomed(grid, over))
    return NoiseGrid(scatter, tuple(noise))


def _zoomed(grid: Floats, log_weight: Floats) -> Floats:
    """A finer grid over the part of a grid (n,) whose ln of weight is not negligible.

    Raises FloatingPointError where no weight is a number.
    """
    likely = np.flatnonzero(log_weight > log_weight.max() - _NEGLIGIBLE)
    if not likely.size:
        raise FloatingPointError("no noise is likely")
    low = max(likely[0] - 1, 0)
    high = min(likely[-1] + 1, len(grid) - 1)
    return np.linspace(grid[low], grid[high], _FINE)


def best_noise(surface: NoiseLikelihood, delta: Floats) -> tuple[float, list[float]]:
    """The most likely s_e, and s_m for each data set, in its SI unit.

    delta: change of the law's parameters, shape (q,).
    """
    per_set = surface.over_noise(delta)
    total = surface.prior_scatter + sum(logsumexp(part, axis=1) for part in per_set)
    k = int(np.argmax(total))
    noise = []
    for log_noise, part in zip(surface.grid.log_noise, per_set, strict=True):
        likeliest = int(np.argmax(part[k]))
        noise.append(float(np.exp(log_noise[likeliest])))
    return float(np.exp(surface.grid.log_scatter[k])), noise
