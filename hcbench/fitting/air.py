"""The air as a rival of the law: the drag of a light ball looks like a loss that grows with speed.

Where mass and size of the ball are not given, a constant e in air and the law in air are tried with
light balls: the law with a table tennis ball, the constant down to a balloon.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.estimate import alpha_of, fit_law
from hcbench.fitting.flight import DIAMETER_OF_LIGHTEST, LIGHTEST
from hcbench.fitting.setup import Known
from hcbench.fitting.which_law import LAWS, ODDS_TO_TELL, PLAIN, WITH_E0, laws_left

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.linear import LawFit
    from hcbench.terms.impact import Floats

# Masses, kg, of balls as large as one of table tennis: of solid rubber, and of one that the air holds
# up as much as a balloon.
_HEAVIEST = 30e-3
_BALLOON = 0.7e-3
_HALVINGS = 3
# ln of the prior odds of such a ball against one that is heavy for its size.
_LIGHT = math.log(0.1)
# s/m: the air of a table tennis ball adds 0.006 to 0.014 to α; a constant e in air seems no larger α.
_MOST_OF_CONSTANT = 0.09


@dataclass(frozen=True, slots=True)
class AirRivals:
    """Fits in air that the data leave beside the law's in a vacuum.

    constant: a constant e in air, the likeliest; None where the data rule it out.
    constants: with it, those of the other masses tried that the data leave, and the one without air
    where, if e is constant, a heavy ball is not ruled out.
    law: the likeliest law with α in air; None where the data rule it out.
    share: α in air over α in a vacuum, the least that is left; 1 where none is.
    """

    constant: LawFit | None = None
    constants: tuple[LawFit, ...] = ()
    law: LawFit | None = None
    share: float = 1.0


def rivals_in_air(
    sets: Sequence[Dataset],
    fits: Mapping[str, LawFit],
    widths: Sequence[Floats],
) -> AirRivals:
    """The fits in air that rival those in a vacuum: a constant e, and a smaller α; none for a given
    ball, for single impacts, or where the data show no α.

    fits: of all laws, in a vacuum.
    widths: per data set (m,), of each e's scatter over s_e.
    Beside a constant e in a vacuum, the one in air is the only rival: it is another e.
    """
    if not all(s.needs_gravity for s in sets) or sets[0].setup.has_air:
        return AirRivals()
    is_constant = "constant" in laws_left({name: fit.log_evidence for name, fit in fits.items()})
    alpha = alpha_of(fits[PLAIN], fits[WITH_E0]).value
    if not is_constant and not alpha > 0.0:
        return AirRivals()
    reference = fits[PLAIN].reference
    # ln of the evidence from which a fit in air is not ruled out; the prior of a light ball is in it.
    least = max(fit.log_evidence for fit in fits.values()) - math.log(ODDS_TO_TELL) - _LIGHT

    def in_air(law: str, mass: float) -> LawFit:
        ball = replace(sets[0].setup, mass=Known(mass), diameter=Known(DIAMETER_OF_LIGHTEST))
        return fit_law(LAWS[law], [s.with_setup(ball) for s in sets], reference, widths)

    found = AirRivals()
    masses = [LIGHTEST]
    if is_constant or alpha < _MOST_OF_CONSTANT:
        tried = _of_masses(lambda mass: in_air("constant", mass))
        likeliest_log_mass = max(tried, key=lambda log_mass: tried[log_mass].log_evidence)
        masses.append(math.exp(likeliest_log_mass))
        likeliest = tried[likeliest_log_mass]
        if likeliest.log_evidence >= least:
            constants = _constants_left(likeliest, list(tried.values()), fits["constant"])
            found = replace(found, constant=likeliest, constants=constants)
    if is_constant:
        return found
    for mass in masses:
        plain = in_air(PLAIN, mass)
        lossy = in_air(WITH_E0, mass)
        likelier = max((plain, lossy), key=lambda fit: fit.log_evidence)
        if likelier.log_evidence > least:
            share = min(found.share, alpha_of(plain, lossy).value / alpha)
            if found.law is not None and found.law.log_evidence >= likelier.log_evidence:
                likelier = found.law
            found = replace(found, law=likelier, share=share)
    return found


def _constants_left(
    likeliest: LawFit, in_air: Sequence[LawFit], in_vacuum: LawFit
) -> tuple[LawFit, ...]:
    """The fits of a constant e that do nearly as well as the likeliest in air: nobody knows the mass.

    in_air: one for each mass tried.
    in_vacuum: that of a heavy ball, which is the likelier one before the data are seen.
    """
    worst = likeliest.log_evidence - math.log(ODDS_TO_TELL)
    left = [fit for fit in in_air if fit.log_evidence > worst]
    if in_vacuum.log_evidence > worst + _LIGHT:
        left.append(in_vacuum)
    return tuple(left)


def _of_masses(fitted: Callable[[float], LawFit]) -> dict[float, LawFit]:
    """Fits by ln of the mass in kg: of a grid of five masses, whose step around the likeliest one is
    then halved _HALVINGS times.

    fitted: the fit with a ball of a mass, kg.
    """
    tried: dict[float, LawFit] = {}
    for x in np.linspace(math.log(_BALLOON), math.log(_HEAVIEST), 5).tolist():
        tried[x] = fitted(math.exp(x))
    step = math.log(_HEAVIEST / _BALLOON) / 4.0
    for _ in range(_HALVINGS):
        step *= 0.5
        best = max(tried, key=lambda x: tried[x].log_evidence)
        for x in (best - step, best + step):
            if math.log(_BALLOON) <= x <= math.log(_HEAVIEST):
                tried[x] = fitted(math.exp(x))
    return tried
