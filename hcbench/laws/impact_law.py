"""`hcbench.law`: what the law says of impacts, from text with units or SI numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.summary import PAPER_RELATIVE_RADIUS, ImpactSummary, summarize
from hcbench.system.errors import UserError
from hcbench.system.notebook import Drawn
from hcbench.terms import units
from hcbench.terms.arguments import checked
from hcbench.terms.options import PintQuantity

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from hcbench.terms.impact import Floats
    from hcbench.terms.options import Quantities, Quantity

PAPER_MASS = "1 lb"
PAPER_STIFFNESS = "3.1e7 lbf/in^1.5"
# Impact speeds of the printed table, m/s.
_SHOWN = (0.1, 0.2, 0.5, 1.0, 2.0)


@dataclass(frozen=True, repr=False)
class ImpactLaw(Drawn):
    """The Hunt-Crossley law of one pair of bodies.

    Attributes
    ----------
    force : HuntCrossley
        F = k xⁿ (1 + (3/2) α ẋ).
    mass : float
        Effective mass, kg. e does not depend on it, nor on k.

    """

    force: HuntCrossley
    mass: float

    @property
    def alpha(self) -> float:
        """α, s/m: the share of the speed that is lost, per m/s, in slow impacts."""
        return self.force.alpha

    def e(self, speed: Quantities) -> Any:
        """Restitution at impact speeds.

        Parameters
        ----------
        speed : float, text, quantity of Pint's, or several
            Impact speeds, m/s or with a unit: 1.0, "1 m/s", "0.1:1:10 m/s", an array.

        Returns
        -------
        float or numpy.ndarray
            e, in the shape of `speed`; eq. (16) of Hunt and Crossley (1975), in closed form.

        Raises
        ------
        QuantityError
            If `speed` is not a speed of 0 m/s or more.

        Examples
        --------
        >>> import hcbench as hb
        >>> law = hb.law(alpha="0.3 s/m")
        >>> round(law.e("1 m/s"), 3)
        0.768
        >>> law.e([0.1, 0.5, 1.0]).round(3)
        array([0.971, 0.869, 0.768])

        """
        speeds = units.parse_values(speed, "speed", "speed", least=0.0)
        e: Floats = closed_form.restitution(self.alpha, speeds)
        given: Any = speed.magnitude if isinstance(speed, PintQuantity) else speed
        # Text may hold one speed or several.
        if isinstance(given, str) and len(e) > 1:
            return e
        if isinstance(given, str) or np.ndim(given) == 0:
            return float(e[0])
        return e.reshape(np.shape(given))

    def impacts(self, speeds: Quantities) -> list[ImpactSummary]:
        """Everything about one impact at each speed: e, penetration,
        force, duration, energy lost, SI.
        """
        values = units.parse_values(speeds, "speed", "speeds", above=0)
        return [summarize(self.force, self.mass, v, PAPER_RELATIVE_RADIUS) for v in values.tolist()]

    def _lines(self) -> Iterator[str]:
        yield f"Hunt-Crossley law, α = {self.alpha:.6g} s/m"
        for v in _SHOWN:
            yield f"e = {self.e(v):.3f} at {v:g} m/s"

    def _rows(self) -> Iterator[Mapping[str, Any]]:
        for impact in self.impacts(_SHOWN):
            yield {name: value for name, value in asdict(impact).items() if name != "warnings"}


@checked
def law(
    alpha: Quantity,
    *,
    mass: Quantity = PAPER_MASS,
    stiffness: Quantity | None = None,
    exponent: Quantity = 1.5,
) -> ImpactLaw:
    """Say what the Hunt-Crossley law expects of impacts, as `hcbench law` does.

    Parameters
    ----------
    alpha : float, text or quantity of Pint's
        α, s/m or with a unit.
    mass : float, text or quantity of Pint's
        Effective mass, kg or with a unit, for forces, penetrations and durations.
    stiffness : float, text or quantity of Pint's, optional
        k of F = k xⁿ, N/mⁿ or with a unit; that of the paper's steel ball for n = 1.5.
    exponent : float
        n, 1 or more; 1.5 is Hertz's, of round bodies.

    Returns
    -------
    ImpactLaw
        Its method `e` gives restitution at impact speeds.

    Raises
    ------
    UserError
        In the argument's name.

    Examples
    --------
    >>> import hcbench as hb
    >>> hb.law(alpha="0.3 s/m")
    Hunt-Crossley law, α = 0.3 s/m
    e = 0.971 at 0.1 m/s
    e = 0.943 at 0.2 m/s
    e = 0.869 at 0.5 m/s
    e = 0.768 at 1 m/s
    e = 0.620 at 2 m/s

    """
    n = units.parse(exponent, "exponent", "exponent")
    if stiffness is None and n >= 1 and n != 1.5:
        raise UserError("stiffness", f"missing for exponent {n:g}", f"k in N/m^{n:g}")
    if stiffness is None:
        stiffness = PAPER_STIFFNESS
    k = units.parse(stiffness, "stiffness", "stiffness", n)
    force = HuntCrossley(k, units.parse(alpha, "alpha", "alpha"), n)
    return ImpactLaw(force, units.parse(mass, "mass", "mass", above=0))
