"""A fit of forces, for a terminal and as JSON."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hcbench.terms.resolution import SIGMAS_95

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.fitting.force import ForceFit


def as_record(force_fit: ForceFit) -> dict[str, object]:
    """The fit of forces as `--json` prints it; None for a law that the pulse contradicts, and for
    an e that the shape does not give.
    """
    low, high = force_fit.alpha_interval
    law = None
    if force_fit.is_law:
        law = "hunt-crossley"
    by_shape = None
    if not math.isnan(force_fit.e_by_shape):
        by_shape = force_fit.e_by_shape
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
        "stiffness_n_per_m_n": force_fit.stiffness,
        "exponent": force_fit.exponent,
        "covariance_ln_k_n_alpha": force_fit.covariance.tolist(),
        "misfit": force_fit.misfit,
        "speed_range_m_per_s": list(force_fit.speeds),
    }


def lines_of(force_fit: ForceFit, describe: Callable[[float, float], str]) -> list[str]:
    """The main numbers of the fit, a line each.

    describe: a function of a value and its standard uncertainty that writes both, with their
    digits.
    Stiffness k is in N/m^n, α in s/m; misfit is the rms difference over the largest force.
    """
    sd = np.sqrt(np.diag(force_fit.covariance))
    low, high = force_fit.alpha_interval
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
    """The fit for a terminal, and the command to go on with.

    describe: as of `lines_of`.
    """
    lines = lines_of(force_fit, describe)
    if not force_fit.is_law:
        return "\n".join(lines) + "\n"
    alpha = describe(max(force_fit.alpha, 0.0), force_fit.alpha_uncertainty)
    stiffness = f'--stiffness "{force_fit.stiffness:.5g}" --exponent {force_fit.exponent:.5g}'
    tuned = f'--alpha "{alpha} s/m" {stiffness}'
    return (
        "\n".join(
            [*lines, "", "next:", f"  hcbench tune {engine} {tuned} --timestep 1e-5 --match both"]
        )
        + "\n"
    )
