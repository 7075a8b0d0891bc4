"""One law fitted to data sets that share its parameters: Gauss-Newton,
then the posterior over a grid.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.linear import (
    Estimate,
    LawFit,
    NoiseLikelihood,
    Posterior,
    best_noise,
    coarse_grid,
    quantiles,
    reduce,
    refined,
    surface,
)
from hcbench.terms.resolution import SIGMAS_95

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.linear import Reduced
    from hcbench.fitting.which_law import CandidateLaw
    from hcbench.terms.impact import Floats


# Newton steps, at most.
_STEPS = 25
# Longest Newton step of a parameter: a change of ln e, or of the ln of a speed.
_LONGEST_STEP = 0.5
# ln of e may come out so far above 0: data about 0 lie on both sides of it.
_BEYOND = 0.05
# Points of the grid over a parameter.
_POINTS = 121
# Half width of that grid, in standard deviations.
_WIDTH = 8.0
# Grid points over the share of the loss at the reference speed that α explains; e0 explains the
# rest.
_SHARES = 41


def fit_law(
    law: CandidateLaw,
    sets: Sequence[Dataset],
    reference: float,
    width: Sequence[Floats] | None = None,
) -> LawFit:
    """Fit one law by Newton steps, and the noise by a grid between them.

    sets: data sets that share the law's parameters, each with its own noise s_m.
    reference: m/s, middle of the data.
    width: per data set (m,), how much wider than s_e each e scatters; None: all alike.
    Ends where a step promises no more gain, or after _STEPS steps.
    Raises FloatingPointError where no noise is likely, NumPy's LinAlgError where a matrix is
    singular.
    """
    parameters = _start(law, sets, reference)
    # One entry a data set: own parameters, relative changes of e, and s_m.
    own: list[Floats] = []
    latent: list[Floats] = []
    noise: list[float] = []
    for s in sets:
        own.append(s.start())
        latent.append(_start_of_changes(law, parameters, s, reference))
        noise.append(s.known_noise or 0.1 * s.noise_scale)
    if width is None:
        width = list(map(np.ones_like, latent))
    scatter = 5e-3
    grid = coarse_grid(sets)
    for step in range(_STEPS):
        curve = law.curve(tuple(parameters), reference)
        models = []
        for s, own_of_set, latent_of_set, wide in zip(sets, own, latent, width, strict=True):
            model = s.linearise(curve, own_of_set, latent_of_set)
            models.append(replace(model, by_scatter=model.by_scatter * wide))
        reduced = list(map(reduce, models))
        move, hessian = _law_step(reduced, scatter, noise, _BEYOND - parameters)
        own_moves = [r.own_step(scatter, n, move) for r, n in zip(reduced, noise, strict=True)]
        share = _share_of_step(move, own_moves)
        # Twice what the quadratic model promises that this step gains in ln of the density.
        decrement = float(move @ hessian @ move)
        if decrement < 1e-6 and step > 2:
            break
        for k, (r, n, own_move, wide) in enumerate(
            zip(reduced, noise, own_moves, width, strict=True)
        ):
            drawn = wide * r.latent(scatter, n, own_move, move)
            latent[k] = latent[k] + share * (drawn - latent[k])
            own[k] = own[k] + share * own_move
        parameters = parameters + share * move
        # Far from the optimum the noise would take in what the law does not yet explain.
        if share == 1.0:
            scatter, noise = best_noise(surface(reduced, sets, grid), move)
    coarse = surface(reduced, sets, grid)
    fine = surface(reduced, sets, refined(coarse, move, sets))
    scatter, noise = best_noise(fine, move)
    posterior, log_evidence, beyond = _posterior(law, parameters, move, hessian, fine)
    return LawFit(
        law=law,
        reference=reference,
        parameters=parameters,
        own=tuple(own),
        latent=tuple(latent),
        width=tuple(width),
        models=tuple(models),
        reduced=tuple(reduced),
        surface=fine,
        posterior=posterior,
        log_evidence=log_evidence,
        scatter=scatter,
        noise=tuple(noise),
        beyond=beyond,
    )


def _share_of_step(move: Floats, own_moves: Sequence[Floats]) -> float:
    """Share, up to 1, of a Newton step to take: no logarithm moves by more than `_LONGEST_STEP`.

    move: of the law's parameters, (q,).
    own_moves: of each data set's own, (p,); the last is a logarithm.
    """
    longest = float(np.abs(move).max())
    for own_move in own_moves:
        # Only the last of a data set's own parameters is a logarithm.
        longest = max(longest, float(np.abs(own_move[-1:]).max(initial=0.0)))
    return min(1.0, _LONGEST_STEP / max(longest, 1e-300))


def _start(law: CandidateLaw, sets: Sequence[Dataset], reference: float) -> Floats:
    """Law parameters to start from, shape (q,), fitted to rough pairs of v and e by least squares
    in ln e.

    reference: speed at which the parameters are defined, m/s.
    Gauss-Newton steps, eight of limited length: an e outside 1e-3 ... 1 counts as the nearer end.
    """
    # Impacts of all data sets, shape (2, n): speeds, m/s, over e.
    speed, e = np.concatenate([s.pairs() for s in sets], axis=1)
    log_e = np.log(np.clip(e, 1e-3, 1.0))
    middle = min(float(np.median(log_e)), -1e-3)
    parameters = np.full(law.count, middle / law.count)
    for _ in range(8):
        curve = law.curve(tuple(parameters), reference)
        log_curve = []
        slopes = []
        for v in speed:
            log_e_at_v, _, by_law = curve.local(float(v))
            log_curve.append(log_e_at_v)
            slopes.append(by_law)
        move = np.linalg.lstsq(np.array(slopes), log_e - log_curve, rcond=1e-8)[0]
        parameters = parameters + np.clip(move, -_LONGEST_STEP, _LONGEST_STEP)
    return parameters


def _start_of_changes(
    law: CandidateLaw, parameters: Floats, s: Dataset, reference: float
) -> Floats:
    """Relative changes of each e to start from, shape (m,): those that lead to the rough e read off.

    Flights then begin where the data have them. A film's fit that begins with flights of other
    lengths ends anywhere. None are tried where an e is not read off for each impact.
    """
    speed, e = s.pairs()
    if not s.needs_gravity or len(e) != len(s.touches()):
        return np.zeros(len(s.touches()))
    curve = law.curve(tuple(parameters), reference)
    log_e = [curve.local(float(v))[0] for v in speed]
    return np.asarray(np.log(np.clip(e, 1e-3, 1.2)) - log_e)


def _law_step(
    reduced: Sequence[Reduced], scatter: float, noise: Sequence[float], room: Floats
) -> tuple[Floats, Floats]:
    """δ of the law's parameters where the likelihood is largest, (q,), and its negated Hessian, (q,
    q).

    reduced, noise: of each data set, its model and s_m.
    scatter: s_e.
    room: (q,), how far each parameter may rise; one that would rise further stays there, and the
    others are solved again.
    Raises FloatingPointError for a model that is not finite.
    """
    q = reduced[0].law
    total = sum(
        one.profile(np.array(scatter), np.array(n))[0][: q + 1, : q + 1]
        for one, n in zip(reduced, noise, strict=True)
    )
    if not np.isfinite(np.asarray(total)).all():
        # LAPACK would print a remark, among the lines of --json.
        raise FloatingPointError("the step of the law is not finite")
    hessian = np.asarray(total)[:q, :q]
    slope = np.asarray(total)[:q, q]
    move = np.linalg.lstsq(hessian, slope, rcond=1e-12)[0]
    held = move > room
    if held.any():
        move = np.where(held, room, move)
        unheld = ~held
        left = slope[unheld] - hessian[np.ix_(unheld, held)] @ move[held]
        move[unheld] = np.linalg.lstsq(hessian[np.ix_(unheld, unheld)], left, rcond=1e-12)[0]
    return np.minimum(move, room), hessian


def _posterior(
    law: CandidateLaw, parameters: Floats, move: Floats, hessian: Floats, fine: NoiseLikelihood
) -> tuple[Posterior, float, float]:
    """Posterior over the parameters of a law, ln of its integral, and the share that was cut off.

    parameters, move: of the law, and the last Newton step, shape (q,).
    hessian: second derivatives of ln of the likelihood, negated, shape (q, q).
    fine: likelihood over the grid of noise.
    Cut off is the part where e is above 1; where nearly all is, nothing is cut, and the share says
    so.
    """
    make = _line if law.count == 1 else _shares
    centre = move
    spread = None
    for _ in range(2):
        deltas, log_cell, allowed = make(parameters, centre, hessian, spread, fine)
        log_density = fine.log_posterior(deltas)[0] + log_cell
        top = log_density.max()
        weight = np.exp(log_density - top)
        kept = np.where(allowed, weight, 0.0)
        beyond = 1.0 - kept.sum() / weight.sum()
        used = kept
        # Where nearly all is cut off, the rest is a corner of the grid: it tells no centre.
        if not kept.sum() > 1e-6 * weight.sum():
            used = weight
        centre = np.average(deltas, axis=0, weights=used)
        spread = np.sqrt(np.average((deltas - centre) ** 2, axis=0, weights=used))
    posterior = Posterior(parameters + deltas, used / used.sum())
    return posterior, float(top + math.log(used.sum())), float(beyond)


def _line(
    parameters: Floats,
    centre: Floats,
    hessian: Floats,
    spread: Floats | None,
    fine: NoiseLikelihood,
) -> tuple[Floats, float, Floats]:
    """An even grid over the one parameter of a law: points (g, 1), ln of the cell's width, and a
    mask (g,).

    parameters, centre, spread: shape (1,); points are relative to `parameters`. hessian: (1, 1), of
    minus ln of the likelihood.
    fine: not used; `_shares` is called with the same arguments.
    The mask is true where e is at most 1. The grid is centred on `centre` and as wide as `spread`;
    without a spread it is twice as wide as the curvature of the likelihood suggests.
    """
    if spread is None:
        sd = 1.0 / math.sqrt(max(float(hessian[0, 0]), 1e-12))
        factor = 2.0 * _WIDTH
    else:
        sd = float(spread[0])
        factor = _WIDTH
    half = min(factor * max(sd, 1e-12), 20.0)
    delta = np.linspace(float(centre[0]) - half, float(centre[0]) + half, _POINTS)
    return delta[:, None], math.log(delta[1] - delta[0]), parameters[0] + delta <= 0.0


def _shares(
    parameters: Floats,
    centre: Floats,
    hessian: Floats,
    spread: Floats | None,
    fine: NoiseLikelihood,
) -> tuple[Floats, Floats, Floats]:
    """A grid over ψ = ln e at the reference speed and the share f of it that goes with α, even in
    both.

    parameters, centre, spread: shape (2,), the first the part that goes with α; centre is relative
    to `parameters`. Without a spread the grid has all shares.
    hessian: (2, 2).
    fine: not used; `_line` is called with the same arguments.
    Returned are points relative to `parameters`, shape (g, 2), ln of the cells' areas, (g,), and a
    mask of the points where e is at most 1.
    The density is flat in ψ, as it is for the other laws, and in f: so this law has no arbitrary
    constant.
    """
    low, high = 0.0, 1.0
    # The largest variance of ψ that the spreads of both parameters allow.
    of_spread = 0.0
    if spread is not None:
        of_spread = float(spread.sum()) ** 2
        with_alpha = parameters[0] + centre[0]
        total = float((parameters + centre).sum())
        half = _WIDTH * max(float(spread.max()), 1e-9) / max(abs(total), 1e-9)
        low = max(0.0, with_alpha / total - half)
        high = min(1.0, with_alpha / total + half)
    edges = np.linspace(low, high, _SHARES + 1)
    share = 0.5 * (edges[1:] + edges[:-1])
    direction = np.stack([share, 1.0 - share], axis=1)
    # Along each direction the likelihood is nearly normal in ψ: where it is largest, and how wide.
    curvature = np.einsum("fa,ab,fb->f", direction, hessian, direction)
    best = direction @ hessian @ (parameters + centre) / curvature
    sd = np.sqrt(1.0 / curvature + of_spread)
    across = np.linspace(-_WIDTH, _WIDTH, _SHARES)
    psi = best[:, None] + sd[:, None] * across
    points = psi[..., None] * direction[:, None, :]
    log_cell = np.log((edges[1] - edges[0]) * sd * (across[1] - across[0]))
    deltas = points.reshape(-1, 2) - parameters
    return deltas, np.repeat(log_cell, _SHARES), (psi <= 0.0).reshape(-1)


ENDS = (0.025, 0.5, 0.975)
# Below these odds between eq. (16) with and without e0, the interval of α spans both.
ODDS_TO_DROP = 25.0
# Prior odds of the law with e0: some constant loss is the rule.
_PRIOR_OF_E0 = 3.0


def estimate_of(fit: LawFit, name: str, inputs: float = 0.0) -> Estimate:
    """A parameter from the posterior of its law, in the unit of `describe`, with its 95 % interval.

    inputs: standard uncertainty that comes from what was given, added in quadrature.
    """
    # An e is at most 1; α has no upper end.
    most = 1.0
    if name == "alpha":
        most = math.inf
    return _estimate(fit.values(name), fit.posterior.weight, inputs, 0.0, most)


def widened(estimate: Estimate, factor: float) -> Estimate:
    """The estimate with an interval that many times as wide."""
    value = estimate.value
    low = value - factor * (value - estimate.low)
    high = value + factor * (estimate.high - value)
    return Estimate(value, factor * estimate.uncertainty, max(0.0, low), high)


def alpha_of(
    plain: LawFit, lossy: LawFit, inputs: float = 0.0, odds: float = ODDS_TO_DROP
) -> Estimate:
    """α of eq. (16), s/m, where a constant loss e0 may be present.

    plain, lossy: the fits without and with e0.
    inputs: standard uncertainty of α, s/m, from what was given, such as g.
    odds: at which one of the two laws is ruled out; then the other's α is returned.
    The interval reaches from the lower to the upper end of both laws' 95 % intervals, as long as
    the odds between them lie within 25 : 1, or what is given. An average by odds is too narrow: at
    e0 = 0.99 the law without e0 is favoured for having one parameter less, and the average contains
    the true value 84 % of the time.
    """
    kept = in_question(plain, lossy, odds)
    if len(kept) == 1:
        return estimate_of(kept[0], "alpha", inputs)
    without_e0 = estimate_of(plain, "alpha", inputs)
    with_e0 = estimate_of(lossy, "alpha", inputs)
    lead = plain.log_evidence - lossy.log_evidence
    # exp of more than 709 overflows a float.
    lead = min(max(lead, -700.0), 700.0)
    # Posterior share of the law with e0, by Bayes' rule.
    share = 1.0 / (1.0 + math.exp(lead) / _PRIOR_OF_E0)
    values = np.concatenate([plain.values("alpha"), lossy.values("alpha")])
    weight = np.concatenate(
        [(1.0 - share) * plain.posterior.weight, share * lossy.posterior.weight]
    )
    both = _estimate(values, weight, inputs, 0.0, math.inf)
    low = min(without_e0.low, with_e0.low)
    high = max(without_e0.high, with_e0.high)
    return Estimate(both.value, both.uncertainty, low, high)


def in_question(plain: LawFit, lossy: LawFit, odds: float) -> list[LawFit]:
    """The fits of the two laws that the other does not rule out at these odds: one or both."""
    lead = plain.log_evidence - lossy.log_evidence
    limit = math.log(odds)
    kept = []
    if lead > -limit:
        kept.append(plain)
    if lead < limit:
        kept.append(lossy)
    return kept


def _estimate(values: Floats, weight: Floats, inputs: float, least: float, most: float) -> Estimate:
    """Median, standard deviation and 95 % interval of weighted values, all in their unit.

    values, weight: shape (g,); the weights add up to 1.
    inputs: standard uncertainty from what was given, added in quadrature.
    least, most: bounds of the parameter, which the interval keeps to.
    """
    low, middle, high = quantiles(values, weight, ENDS)
    mean = float(values @ weight)
    sd = math.sqrt(float((values - mean) ** 2 @ weight))
    down = math.hypot(middle - low, SIGMAS_95 * inputs)
    up = math.hypot(high - middle, SIGMAS_95 * inputs)
    return Estimate(
        middle, math.hypot(sd, inputs), max(least, middle - down), min(most, middle + up)
    )
