"""Contact laws that came after 1975: F = k x^n (1 + χ v/v_i), each with its own χ(e) for a wanted e.

For every law of this form the restitution delivered follows exactly, whatever k, n and m are (see `exact`):
with χ as d, d (1 + e) = ln(1 + d) - ln(1 - d e). So each can be asked what it promises and told what it
delivers. As e nears 1 that relation is χ = (3/2)(1 - e): of the laws below Lee-Wang starts at half of it,
Gonthier at 4/3, Flores at 16/15, the others on it.

The originals were not all at hand. χ has been held against independent statements: Hunt-Crossley, Herbert-
McWhannell, Lee-Wang, Lankarani-Nikravesh, Gonthier, Zhiying-Qishao and Flores against the multibody code DyS
of L. Skrinjar, first author of a review of them (Int. J. Mech. Sci. 145, 2018, 171-187,
doi 10.1016/j.ijmecsci.2018.07.010); Hunt-Crossley, Gonthier and Carvalho-Martins against the manual of the
code EXUDYN. DOIs were found again elsewhere but for those of Herbert-McWhannell and Lee-Wang.

Hu-Guo is stated in two forms, (3/2)(1 - e)/e and half of it, (3/2)(1 - e)/(2 e), which DyS has. The first is
taken: it alone loses the right energy at small losses, as the authors promise; the second loses half of it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hcbench.laws._series import argument_of, restitution_of
from hcbench.laws.force import HuntCrossley
from hcbench.laws.require import positive, require

if TYPE_CHECKING:
    from hcbench.impact import Floats


@dataclass(frozen=True, slots=True)
class PrescribedRestitutionLaw(ABC):
    """F = k x^n (1 + χ(e) v/v_i): a law that is given a restitution and the speed at which to keep it.

    stiffness: k, N/m^n. restitution: e asked for. speed: v_i, the speed at touch, m/s. exponent: n >= 1.
    chi: χ of this law, worked out once.
    """

    stiffness: float
    restitution: float
    speed: float
    exponent: float = 1.5
    chi: float = field(init=False)

    name: ClassVar[str]
    slug: ClassVar[str]  # how settings, studies and plug-ins call it
    formula: ClassVar[str]
    reference: ClassVar[str]
    takes_zero: ClassVar[bool] = True  # whether χ(0) is finite

    def __post_init__(self) -> None:
        positive("stiffness", self.stiffness, "N/m^n")
        positive("speed", self.speed, "m/s")
        require("exponent", self.exponent, 1 <= self.exponent < np.inf, "n of 1 or more")
        object.__setattr__(self, "chi", float(self.chi_of(self.restitution)))

    @staticmethod
    @abstractmethod
    def _chi(e: Floats) -> Floats:
        """χ(e) as published; e already known to be in its range."""

    @classmethod
    def chi_of(cls, e: Floats | float) -> Floats:
        """χ over restitutions asked for, same shape.

        UserError outside 0 ... 1, and at 0 where χ is infinite.
        """
        values = np.asarray(e, dtype=float)
        slot = f"restitution of {cls.name}"
        for value in values[~((values >= 0.0) & (values <= 1.0))].flat[:1]:
            need = "0 <= e <= 1: above 1 χ is below 0 and the contact would feed energy in"
            require(slot, float(value), False, need)
        if not cls.takes_zero:
            need = f"e above 0: χ = {cls.formula} is infinite at e = 0"
            require(slot, 0.0, not (values == 0.0).any(), need, "Take a small e, such as 0.01")
        return cls._chi(values)

    @classmethod
    def delivered(cls, e: Floats | float) -> Floats:
        """The restitution this law gives when asked for e, same shape; at its own speed, for any k, n, m."""
        return restitution_of(cls.chi_of(e))

    @property
    def hunt_crossley(self) -> HuntCrossley:
        """The same force as eq. (16): α = χ/((3/2) v_i). Engines and plug-ins that know (16) take this."""
        return HuntCrossley(self.stiffness, self.chi / (1.5 * self.speed), self.exponent)

    def force(self, x: Floats | float, v: Floats | float) -> Floats:
        """F(x, v) in N; x >= 0 in m, v in m/s."""
        stretch = 1.0 + self.chi * np.asarray(v) / self.speed
        return np.asarray(self.stiffness * np.power(x, self.exponent) * stretch)


class FirstOrder(PrescribedRestitutionLaw):
    """What eq. (2) makes of (16): 1 - e = α v_i."""

    __slots__ = ()
    name = "Hunt-Crossley"
    slug = "first-order"
    formula = "(3/2)(1 - e)"
    reference = (
        "K. H. Hunt, F. R. E. Crossley, Coefficient of restitution interpreted as damping in vibroimpact, "
        "J. Appl. Mech. 42(2), 1975, 440-445, doi 10.1115/1.3423596"
    )

    @staticmethod
    def _chi(e: Floats) -> Floats:
        return 1.5 * (1.0 - e)


class HerbertMcWhannell(PrescribedRestitutionLaw):
    """χ = 6 (1 - e)/((2e - 1)² + 3)."""

    __slots__ = ()
    name = "Herbert-McWhannell"
    slug = "herbert-mcwhannell"
    formula = "6 (1 - e)/((2e - 1)² + 3)"
    reference = (
        "R. G. Herbert, D. C. McWhannell, Shape and frequency composition of pulses from an impact pair, "
        "J. Eng. Ind. 99(3), 1977, 513-518, doi 10.1115/1.3439270"
    )

    @staticmethod
    def _chi(e: Floats) -> Floats:
        return 6.0 * (1.0 - e) / ((2.0 * e - 1.0) ** 2 + 3.0)


class LeeWang(PrescribedRestitutionLaw):
    """χ = (3/4)(1 - e)."""

    __slots__ = ()
    name = "Lee-Wang"
    slug = "lee-wang"
    formula = "(3/4)(1 - e)"
    reference = (
        "T. W. Lee, A. C. Wang, On the dynamics of intermittent-motion mechanisms, part 1: dynamic model and "
        "response, J. Mech. Transm. Autom. Des. 105(3), 1983, 534-540, doi 10.1115/1.3267392"
    )

    @staticmethod
    def _chi(e: Floats) -> Floats:
        return 0.75 * (1.0 - e)


class LankaraniNikravesh(PrescribedRestitutionLaw):
    """χ = (3/4)(1 - e²)."""

    __slots__ = ()
    name = "Lankarani-Nikravesh"
    slug = "lankarani-nikravesh"
    formula = "(3/4)(1 - e²)"
    reference = (
        "H. M. Lankarani, P. E. Nikravesh, A contact force model with hysteresis damping for impact analysis "
        "of multibody systems, J. Mech. Des. 112(3), 1990, 369-376, doi 10.1115/1.2912617"
    )

    @staticmethod
    def _chi(e: Floats) -> Floats:
        return 0.75 * (1.0 - e) * (1.0 + e)


class Gonthier(PrescribedRestitutionLaw):
    """χ = (1 - e²)/e."""

    __slots__ = ()
    name = "Gonthier et al."
    slug = "gonthier"
    formula = "(1 - e²)/e"
    takes_zero = False
    reference = (
        "Y. Gonthier, J. McPhee, C. Lange, J.-C. Piedbœuf, A regularized contact model with asymmetric "
        "damping and dwell-time dependent friction, Multibody Syst. Dyn. 11(3), 2004, 209-233, "
        "doi 10.1023/B:MUBO.0000029392.21648.bc"
    )

    @staticmethod
    def _chi(e: Floats) -> Floats:
        return (1.0 - e) * (1.0 + e) / e


class ZhiyingQishao(PrescribedRestitutionLaw):
    """χ = (3/4)(1 - e²) exp(2(1 - e))."""

    __slots__ = ()
    name = "Zhiying-Qishao"
    slug = "zhiying-qishao"
    formula = "(3/4)(1 - e²) exp(2(1 - e))"
    reference = (
        "Qin Zhiying, Lu Qishao, Analysis of impact process based on restitution coefficient (in Chinese), "
        "J. Dyn. Control 4(4), 2006, 294-298"
    )

    @staticmethod
    def _chi(e: Floats) -> Floats:
        return np.asarray(0.75 * (1.0 - e) * (1.0 + e) * np.exp(2.0 * (1.0 - e)))


class Flores(PrescribedRestitutionLaw):
    """χ = 8 (1 - e)/(5 e)."""

    __slots__ = ()
    name = "Flores et al."
    slug = "flores"
    formula = "8 (1 - e)/(5 e)"
    takes_zero = False
    reference = (
        "P. Flores, M. Machado, M. T. Silva, J. M. Martins, On the continuous contact force models for soft "
        "materials in multibody dynamics, Multibody Syst. Dyn. 25(3), 2011, 357-375, "
        "doi 10.1007/s11044-010-9237-4"
    )

    @staticmethod
    def _chi(e: Floats) -> Floats:
        return 1.6 * (1.0 - e) / e


class HuGuo(PrescribedRestitutionLaw):
    """χ = (3/2)(1 - e)/e; not (3/2)(1 - e)/(2 e), which is in use too."""

    __slots__ = ()
    name = "Hu-Guo"
    slug = "hu-guo"
    formula = "(3/2)(1 - e)/e"
    takes_zero = False
    reference = (
        "S. Hu, X. Guo, A dissipative contact force model for impact analysis in multibody dynamics, "
        "Multibody Syst. Dyn. 35(2), 2015, 131-151, doi 10.1007/s11044-015-9453-z"
    )

    @staticmethod
    def _chi(e: Floats) -> Floats:
        return 1.5 * (1.0 - e) / e


class CarvalhoMartins(PrescribedRestitutionLaw):
    """χ = (3/2)(1 - e)(11 - e)/(1 + 9 e)."""

    __slots__ = ()
    name = "Carvalho-Martins"
    slug = "carvalho-martins"
    formula = "(3/2)(1 - e)(11 - e)/(1 + 9e)"
    reference = (
        "A. S. Carvalho, J. M. Martins, Exact restitution and generalizations for the Hunt-Crossley contact "
        "model, Mech. Mach. Theory 139, 2019, 174-194, doi 10.1016/j.mechmachtheory.2019.03.028"
    )

    @staticmethod
    def _chi(e: Floats) -> Floats:
        return 1.5 * (1.0 - e) * (11.0 - e) / (1.0 + 9.0 * e)


class Exact(PrescribedRestitutionLaw):
    """χ that solves χ (1 + e) = ln(1 + χ) - ln(1 - χ e): the one that delivers what it promises."""

    __slots__ = ()
    name = "exact"
    slug = "exact"
    formula = "root of χ (1 + e) = ln(1 + χ) - ln(1 - χ e)"
    takes_zero = False
    reference = "follows from eq. (16) by separating variables; see hcbench.laws._series"

    @staticmethod
    def _chi(e: Floats) -> Floats:
        return argument_of(e)


LAWS: dict[str, type[PrescribedRestitutionLaw]] = {
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


def law_named(name: str) -> type[PrescribedRestitutionLaw]:
    """The law called `name`, in full or by its slug, any case; UserError lists what there is."""
    for law in LAWS.values():
        if str(name).casefold() in (law.name.casefold(), law.slug):
            return law
    require("law", name, False, f"one of {', '.join(law.slug for law in LAWS.values())}")
    raise AssertionError  # `require` has raised


@dataclass(frozen=True, slots=True)
class TouchSpeedLaw:
    """One of these laws as it is published: v_i is the speed at touch of each impact itself.

    So every impact has the same χ and delivers the same e, whatever its speed: α falls as 1/v_i.

    family: the law, such as Flores. stiffness: k, N/m^n. restitution: e asked for. exponent: n >= 1.
    chi, delivered: χ(e), and the restitution that follows from it. Raises UserError like the laws themselves.
    """

    family: type[PrescribedRestitutionLaw]
    stiffness: float
    restitution: float
    exponent: float = 1.5
    chi: float = field(init=False)
    delivered: float = field(init=False)

    def __post_init__(self) -> None:
        at_once = self.at(1.0)
        object.__setattr__(self, "chi", at_once.chi)
        object.__setattr__(self, "delivered", float(restitution_of(np.asarray(at_once.chi))))

    def at(self, speed: float) -> PrescribedRestitutionLaw:
        """The law of an impact that touches at `speed` m/s."""
        return self.family(self.stiffness, self.restitution, speed, self.exponent)


OwnSpeedLaw = TouchSpeedLaw  # its earlier name: scripts that use it keep working
