"""Contact laws published after 1975: F = k x^n (1 + χ v/v_i), each
with another χ(e) for a wanted e.

For every law of this form the restitution delivered follows exactly for all k, n and m (see
`closed_form`): with χ as d, d (1 + e) = ln(1 + d) - ln(1 - d e). So each law's promise can be
compared with what it delivers. As e nears 1 that relation is χ = (3/2)(1 - e): of the laws below
Lee-Wang starts at half of it, Gonthier at 4/3, Flores at 16/15, the others on it.

The originals were not all at hand. χ has been held against independent statements:
Hunt-Crossley, Herbert- McWhannell, Lee-Wang, Lankarani-Nikravesh, Gonthier, Zhiying-Qishao and
Flores against the multibody code DyS of L. Skrinjar, first author of a review of them (Int. J.
Mech. Sci. 145, 2018, 171-187, doi 10.1016/j.ijmecsci.2018.07.010); Hunt-Crossley, Gonthier and
Carvalho-Martins against the manual of the code EXUDYN. All DOIs but those of Herbert-McWhannell
and Lee-Wang were confirmed by a second source.

Hu-Guo is stated in two forms, (3/2)(1 - e)/e and half of it, (3/2)(1 - e)/(2 e), which DyS
has. The first is taken: it alone loses the right energy at small losses, as the authors
promise; the second loses half of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hcbench.laws._restitution_series import inverse_restitution, restitution_of
from hcbench.laws.force import HuntCrossley
from hcbench.terms.arguments import checked_fields
from hcbench.terms.bounds import positive, require
from hcbench.terms.impact import Floats

Curve = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class PublishedLaw:
    """F = k x^n (1 + χ(e) v/v_i) with the χ of one publication.

    name: as it is cited.
    symbol: what it is called here.
    slug: what settings and studies call it.
    formula, chi: χ(e), in words and as a function.
    takes_zero: whether χ(0) is finite.
    """

    name: str
    symbol: str
    slug: str
    formula: str
    chi: Curve = field(repr=False)
    reference: str = field(repr=False)
    takes_zero: bool = True

    def __reduce__(self) -> tuple[Callable[[str], PublishedLaw], tuple[str]]:
        return law_named, (self.slug,)

    def chi_of(self, e: Floats | float) -> Floats:
        """The damping factor χ of F = k x^n (1 + χ v/v_i) for restitutions asked for, a pure
        number; same shape.

        e: 0 ... 1.
        Raises UserError outside it, and at 0 where χ is infinite.
        """
        values = np.asarray(e, dtype=float)
        slot = f"restitution of {self.name}"
        wrong = values[~((values >= 0.0) & (values <= 1.0))]
        if wrong.size:
            need = "0 <= e <= 1: above 1 χ is below 0 and the contact would feed energy in"
            require(slot, float(wrong.flat[0]), False, need)
        if not self.takes_zero:
            need = f"e above 0: χ = {self.formula} is infinite at e = 0"
            require(slot, 0.0, not (values == 0.0).any(), need, "Take a small e, such as 0.01")
        return self.chi(values)

    def delivered(self, e: Floats | float) -> Floats:
        """The restitution that this law gives when asked for e, same
        shape; for any k, n, m and v_i.
        """
        return restitution_of(self.chi_of(e))


# Eq. (2), the first order of (16): 1 - e = α v_i.
FirstOrder = PublishedLaw(
    "Hunt-Crossley",
    "FirstOrder",
    "first-order",
    "(3/2)(1 - e)",
    lambda e: 1.5 * (1.0 - e),
    "K. H. Hunt, F. R. E. Crossley, Coefficient of restitution interpreted as damping in vibroimpact, "
    "J. Appl. Mech. 42(2), 1975, 440-445, doi 10.1115/1.3423596",
)
HerbertMcWhannell = PublishedLaw(
    "Herbert-McWhannell",
    "HerbertMcWhannell",
    "herbert-mcwhannell",
    "6 (1 - e)/((2e - 1)² + 3)",
    lambda e: 6.0 * (1.0 - e) / ((2.0 * e - 1.0) ** 2 + 3.0),
    "R. G. Herbert, D. C. McWhannell, Shape and frequency composition of pulses from an impact pair, "
    "J. Eng. Ind. 99(3), 1977, 513-518, doi 10.1115/1.3439270",
)
LeeWang = PublishedLaw(
    "Lee-Wang",
    "LeeWang",
    "lee-wang",
    "(3/4)(1 - e)",
    lambda e: 0.75 * (1.0 - e),
    "T. W. Lee, A. C. Wang, On the dynamics of intermittent-motion mechanisms, part 1: dynamic model and "
    "response, J. Mech. Transm. Autom. Des. 105(3), 1983, 534-540, doi 10.1115/1.3267392",
)
LankaraniNikravesh = PublishedLaw(
    "Lankarani-Nikravesh",
    "LankaraniNikravesh",
    "lankarani-nikravesh",
    "(3/4)(1 - e²)",
    lambda e: 0.75 * (1.0 - e) * (1.0 + e),
    "H. M. Lankarani, P. E. Nikravesh, A contact force model with hysteresis damping for impact analysis "
    "of multibody systems, J. Mech. Des. 112(3), 1990, 369-376, doi 10.1115/1.2912617",
)
Gonthier = PublishedLaw(
    "Gonthier et al.",
    "Gonthier",
    "gonthier",
    "(1 - e²)/e",
    lambda e: (1.0 - e) * (1.0 + e) / e,
    "Y. Gonthier, J. McPhee, C. Lange, J.-C. Piedbœuf, A regularized contact model with asymmetric "
    "damping and dwell-time dependent friction, Multibody Syst. Dyn. 11(3), 2004, 209-233, "
    "doi 10.1023/B:MUBO.0000029392.21648.bc",
    takes_zero=False,
)
ZhiyingQishao = PublishedLaw(
    "Zhiying-Qishao",
    "ZhiyingQishao",
    "zhiying-qishao",
    "(3/4)(1 - e²) exp(2(1 - e))",
    lambda e: 0.75 * (1.0 - e) * (1.0 + e) * np.exp(2.0 * (1.0 - e)),
    "Qin Zhiying, Lu Qishao, Analysis of impact process based on restitution coefficient (in Chinese), "
    "J. Dyn. Control 4(4), 2006, 294-298",
)
Flores = PublishedLaw(
    "Flores et al.",
    "Flores",
    "flores",
    "8 (1 - e)/(5 e)",
    lambda e: 1.6 * (1.0 - e) / e,
    "P. Flores, M. Machado, M. T. Silva, J. M. Martins, On the continuous contact force models for soft "
    "materials in multibody dynamics, Multibody Syst. Dyn. 25(3), 2011, 357-375, "
    "doi 10.1007/s11044-010-9237-4",
    takes_zero=False,
)
# Not (3/2)(1 - e)/(2 e), which is in use too.
HuGuo = PublishedLaw(
    "Hu-Guo",
    "HuGuo",
    "hu-guo",
    "(3/2)(1 - e)/e",
    lambda e: 1.5 * (1.0 - e) / e,
    "S. Hu, X. Guo, A dissipative contact force model for impact analysis in multibody dynamics, "
    "Multibody Syst. Dyn. 35(2), 2015, 131-151, doi 10.1007/s11044-015-9453-z",
    takes_zero=False,
)
CarvalhoMartins = PublishedLaw(
    "Carvalho-Martins",
    "CarvalhoMartins",
    "carvalho-martins",
    "(3/2)(1 - e)(11 - e)/(1 + 9e)",
    lambda e: 1.5 * (1.0 - e) * (11.0 - e) / (1.0 + 9.0 * e),
    "A. S. Carvalho, J. M. Martins, Exact restitution and generalizations for the Hunt-Crossley contact "
    "model, Mech. Mach. Theory 139, 2019, 174-194, doi 10.1016/j.mechmachtheory.2019.03.028",
)
# χ that solves χ (1 + e) = ln(1 + χ) - ln(1 - χ e): the one that delivers what it promises.
Exact = PublishedLaw(
    "exact",
    "Exact",
    "exact",
    "root of χ (1 + e) = ln(1 + χ) - ln(1 - χ e)",
    inverse_restitution,
    "follows from eq. (16) by separating variables",
    takes_zero=False,
)

LAWS = {
    law.name: law
    for law in (
        FirstOrder,
        HerbertMcWhannell,
        LeeWang,
        LankaraniNikravesh,
        Gonthier,
        ZhiyingQishao,
        Flores,
        HuGuo,
        CarvalhoMartins,
        Exact,
    )
}


def law_named(name: str) -> PublishedLaw:
    """The law called `name`, in full or by its slug, any case; UserError for another lists what
    there is.
    """
    for law in LAWS.values():
        if str(name).casefold() in (law.name.casefold(), law.slug):
            return law
    require("law", name, False, f"one of {', '.join(law.slug for law in LAWS.values())}")
    # Never reached: `require` has raised.
    raise AssertionError


@checked_fields
@dataclass(frozen=True)
class TouchSpeedLaw:
    """One of these laws as it is published: v_i is the touch speed of each impact.

    So every impact has the same χ and delivers the same e at every speed: α falls as 1/v_i.

    family: the law, such as Flores.
    stiffness: k, N/m^n.
    restitution: e asked for.
    exponent: n >= 1.
    chi, delivered: χ(e), and the restitution that follows from it.

    Raises UserError for numbers that no law of this kind has.
    """

    family: PublishedLaw
    stiffness: float
    restitution: float
    exponent: float = 1.5
    chi: float = field(init=False)
    delivered: float = field(init=False)

    def __post_init__(self) -> None:
        # Raises for the values that HuntCrossley refuses.
        HuntCrossley(self.stiffness, 0.0, self.exponent)
        chi = self.family.chi_of(self.restitution)
        object.__setattr__(self, "chi", float(chi))
        object.__setattr__(self, "delivered", float(restitution_of(chi)))

    def at(self, speed: float) -> HuntCrossley:
        """The law of an impact that touches at `speed` m/s: eq. (16) with α = χ/((3/2) v_i)."""
        positive("speed", speed, "m/s")
        return HuntCrossley(self.stiffness, self.chi / (1.5 * speed), self.exponent)
