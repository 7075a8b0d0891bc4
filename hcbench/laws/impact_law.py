"""All that the law says of impacts: `hcbench.law`, and the summary that it and the command print."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from hcbench.catalogue.target import target_material
from hcbench.laws import closed_form, hertz
from hcbench.laws.conventions import SOLVERS_OF_NEWTON, AdamsImpact, NewtonSpring
from hcbench.laws.force import HuntCrossley
from hcbench.system.errors import UserError
from hcbench.system.text import Drawn
from hcbench.terms import units
from hcbench.terms.arguments import checked, checked_fields
from hcbench.terms.bounds import positive
from hcbench.terms.options import MaterialName, PintQuantity
from hcbench.terms.records import LOOP
from hcbench.terms.units import INCH

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import pandas as pd

    from hcbench.terms.impact import Floats
    from hcbench.terms.options import Quantities, Quantity

# All that the law says about one impact, and where it leaves the range that the paper gives for
# itself.

# 1/(1/R1 + 1/R2) of the paper's section 3.1: 1 in convex on 2 in concave.
PAPER_RELATIVE_RADIUS = 2 * INCH
# The paper's section 1.2 treats impacts slower than 20 in/s, m/s.
SPEED_LIMIT = 20 * INCH
# α v_i at the ends of what the paper calls reasonable: α = 0.008 s/in at 20
# in/s. Eq. (2) is 0.02 low there.
ALPHA_SPEED_LIMIT = 0.16


@dataclass(frozen=True, slots=True)
class ImpactSummary:
    """One impact by eq. (16). No shear stress without a radius, or for n other than 3/2, where Hertz
    says nothing.
    """

    alpha_s_per_m: float
    speed_m_per_s: float
    restitution: float
    restitution_linear: float
    penetration_max_m: float
    force_max_n: float
    duration_s: float
    energy_loss_j: float
    shear_stress_max_pa: float | None
    warnings: tuple[str, ...]


def summarize(
    law: HuntCrossley, mass: float, speed: float, relative_radius: float | None
) -> ImpactSummary:
    """Everything about one impact: mass kg, speed v_i m/s, relative radius R m.

    The radius counts for the shear stress alone, which is None without it, and for an exponent
    other than 1.5.
    Raises UserError for a mass or speed that is not above 0, for such a radius at the exponent 1.5,
    and for an α v above 1000.
    """
    force = float(closed_form.force_max(law, mass, speed))
    shear = None
    if law.exponent == 1.5 and relative_radius is not None:
        shear = hertz.from_stiffness(law.stiffness, relative_radius).shear_max(force)
    return ImpactSummary(
        alpha_s_per_m=float(law.alpha),
        speed_m_per_s=float(speed),
        restitution=float(closed_form.restitution(law.alpha, speed)),
        restitution_linear=float(closed_form.restitution_linear(law.alpha, speed)),
        penetration_max_m=float(closed_form.penetration_max(law, mass, speed)),
        force_max_n=force,
        duration_s=float(closed_form.duration(law, mass, speed)),
        energy_loss_j=float(closed_form.energy_loss(law, mass, speed)),
        shear_stress_max_pa=shear,
        warnings=_warnings(law, speed, shear),
    )


def _warnings(law: HuntCrossley, speed: float, shear: float | None) -> tuple[str, ...]:
    """Sentences on an impact outside the paper's range; empty for one within it.

    speed: at the impact, m/s.
    shear: largest shear stress, Pa; None where it is not known.
    """
    warnings = []
    # The margin lets 20 in/s itself pass, whatever unit it was converted from.
    if speed > SPEED_LIMIT * (1 + 1e-12):
        warnings.append(
            f"speed {speed:.4g} m/s is above {SPEED_LIMIT:.3g} m/s (20 in/s):"
            " past the paper's range of e = 1 - α v"
        )
    if shear is not None and shear > hertz.SHEAR_LIMIT:
        warnings.append(
            f"shear stress {shear:.3g} Pa is above {hertz.SHEAR_LIMIT:.3g} Pa (62 000 psi):"
            " surfaces may yield"
        )
    if shear is None and law.exponent != 1.5:
        warnings.append(
            f"no shear stress for exponent {law.exponent:g}: eq. (6) is for n = 1.5, spheres"
        )
    if (share := law.alpha * speed) > ALPHA_SPEED_LIMIT * (1 + 1e-12):
        gap = float(closed_form.restitution(law.alpha, speed)) - (1.0 - share)
        warnings.append(
            f"α v = {share:.3g} is above {ALPHA_SPEED_LIMIT:g}: e of the law is {gap:.2g} above 1 - α v"
        )
    return tuple(warnings)


# The text "k, e, cmax, d", each in SI or with a unit.
Adams = str | AdamsImpact
# The text "SOLVER, ke, kd".
Newton = str | NewtonSpring


def read_adams(given: Adams, slot: str = "adams") -> AdamsImpact:
    """IMPACT of MSC Adams from "k, e, cmax, d", SI or with units (k N/m^e, cmax N s/m, d m); one
    that was read is returned as it is.

    slot: name of the option in errors.
    Raises UserError for text of other parts, and for numbers that IMPACT does not take.
    """
    if isinstance(given, AdamsImpact):
        return given
    k, e, c, d = _parts(
        given, slot, "IMPACT's k, e, cmax, d, such as '1e5 N/mm, 1, 10 N s/mm, 0.1 mm'", 4
    )
    exponent = units.parse(e, "exponent", slot)
    stiffness = units.parse(k, "stiffness", slot, exponent=exponent)
    damping = units.parse(c, "damping", slot)
    depth = units.parse(d, "length", slot)
    return AdamsImpact(stiffness, exponent, damping, depth)


def read_newton(given: Newton, slot: str = "newton") -> NewtonSpring:
    """The contact of Newton from "SOLVER, ke, kd"; one that was read is returned as it is.

    ke and kd: 1/s² and 1/s for a solver that reads them per mass, else N/m and N s/m.
    slot: name of the option in errors.
    Raises UserError for text of other parts, for an unknown solver, and for numbers without
    meaning.
    """
    if isinstance(given, NewtonSpring):
        return given
    solver, ke, kd = _parts(given, slot, "a solver, ke, kd, such as 'semi-implicit, 1e4, 20'", 3)
    if solver.lower() not in SOLVERS_OF_NEWTON:
        known = " or ".join(SOLVERS_OF_NEWTON)
        raise UserError(slot, repr(solver), f"{known}: the solvers of Newton that read ke and kd")
    numbers = (units.parse(text, "number", slot) for text in (ke, kd))
    return NewtonSpring(SOLVERS_OF_NEWTON[solver.lower()], *numbers)


def _parts(value: Any, slot: str, expected: str, count: int) -> list[str]:
    """The parts of a text between commas, `count` of them, without spaces around each.

    value: the text.
    Raises UserError with `slot` and `expected`, in words, for another number of parts and for
    anything but text.
    """
    parts = []
    if isinstance(value, str):
        parts = [part.strip() for part in value.split(",")]
    if len(parts) != count:
        raise UserError(slot, f"{value!r:.80}", expected)
    return parts


# `hcbench.law`: what the law says of impacts, from text with units or SI numbers.

PAPER_MASS = "1 lb"
LOOP_COUNT = 401
PAPER_STIFFNESS = "3.1e7 lbf/in^1.5"
# Impact speeds of the printed table, m/s.
_SHOWN = (0.1, 0.2, 0.5, 1.0, 2.0)


@checked_fields
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

    def __post_init__(self) -> None:
        """Raise UserError for a mass that is not above 0."""
        positive("mass", self.mass, "kg")

    @property
    def alpha(self) -> float:
        """α, s/m: the share of the speed that is lost, per m/s, in slow impacts."""
        return self.force.alpha

    @checked
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

    @checked
    def impacts(self, speeds: Quantities) -> list[ImpactSummary]:
        """Everything about one impact at each speed: e, penetration, force, duration, energy lost,
        SI; the shear stress only with the paper's stiffness, which is that of its sphere and plate.

        Raises QuantityError for a speed that is not above 0, UserError for an α v above 1000.
        """
        values = units.parse_values(speeds, "speed", "speeds", above=0)
        # Another stiffness is of bodies whose radius is not known.
        radius = None
        if self.force.stiffness == units.parse(PAPER_STIFFNESS, "stiffness", "stiffness", 1.5):
            radius = PAPER_RELATIVE_RADIUS
        return [summarize(self.force, self.mass, v, radius) for v in values.tolist()]

    @checked
    def loop(self, speed: Quantities, count: int = LOOP_COUNT) -> pd.DataFrame:
        """Force over penetration from touch to parting, as the paper's Figs. 3 and 4 draw it.

        Parameters
        ----------
        speed : float, text, quantity of Pint's, or several
            Impact speeds above 0, m/s or with a unit.
        count : int
            Points of a loop, 3 to 100 000; of an odd number the middle one is the deepest.

        Returns
        -------
        pandas.DataFrame
            `count` rows for each speed: `speed_m_per_s`, `penetration_m` and `force_n`, in closed form.

        Raises
        ------
        UserError
            For a speed that is not above 0, and for another number of points.

        Examples
        --------
        >>> import hcbench as hb
        >>> loop = hb.law(alpha="0.008 s/in").loop("16 in/s")
        >>> list(loop.columns), round(loop.force_n.max())
        (['speed_m_per_s', 'penetration_m', 'force_n'], 3721)

        """
        return self.trajectory(speed, count)[["speed_m_per_s", "penetration_m", "force_n"]]

    @checked
    def trajectory(self, speed: Quantities, count: int = LOOP_COUNT) -> pd.DataFrame:
        """Motion over time from touch to parting.

        Parameters
        ----------
        speed : float, text, quantity of Pint's, or several
            Impact speeds above 0, m/s or with a unit.
        count : int
            Points of an impact, 3 to 100 000, nearly even in time.

        Returns
        -------
        pandas.DataFrame
            `count` rows for each speed: `speed_m_per_s`, `time_s` from touch, `penetration_m`,
            `rate_m_per_s`, above 0 on approach, and `force_n`, in closed form.

        Raises
        ------
        UserError
            For a speed that is not above 0, and for another number of points.

        Examples
        --------
        >>> import hcbench as hb
        >>> motion = hb.law(alpha="0.3 s/m").trajectory("1 m/s")
        >>> round(-motion.rate_m_per_s.iloc[-1], 3)
        0.768

        """
        # pandas is slow to import.
        import pandas as pd

        parts = []
        for v in units.parse_values(speed, "speed", "speed", above=0).tolist():
            motion = closed_form.loop(self.force, self.mass, v, count)
            columns = {field.key: field.of(motion) for field in LOOP}
            parts.append(pd.DataFrame({"speed_m_per_s": v, **columns}))
        return pd.concat(parts, ignore_index=True)

    def _lines(self) -> Iterator[str]:
        yield f"Hunt-Crossley law, α = {self.alpha:.6g} s/m"
        for v in _SHOWN:
            yield f"e = {self.e(v):.3f} at {v:g} m/s"

    def _rows(self) -> Iterator[Mapping[str, Any]]:
        for impact in self.impacts(_SHOWN):
            yield {name: value for name, value in asdict(impact).items() if name != "warnings"}


@checked_fields
@dataclass(frozen=True, repr=False)
class ImpactLaws(Drawn):
    """The Hunt-Crossley law for several α, all else alike.

    Attributes
    ----------
    laws : tuple of ImpactLaw
        One for each α, in the order given.

    """

    laws: tuple[ImpactLaw, ...]

    @property
    def alphas(self) -> Floats:
        """α, s/m, shape (n,)."""
        return np.array([law.alpha for law in self.laws])

    @checked
    def e(self, speed: Quantities) -> Floats:
        """Restitution at impact speeds, m/s or with a unit: a row for each α, shape (n, ...).

        Raises QuantityError if `speed` is not a speed of 0 m/s or more.
        """
        return np.array([law.e(speed) for law in self.laws])

    @checked
    def impacts(self, speeds: Quantities) -> list[ImpactSummary]:
        """Everything about one impact for each α at each speed, SI, as `ImpactLaw.impacts`.

        Raises QuantityError for a speed that is not above 0, UserError for an α v above 1000.
        """
        impacts: list[ImpactSummary] = []
        for law in self.laws:
            impacts += law.impacts(speeds)
        return impacts

    @checked
    def loop(self, speed: Quantities, count: int = LOOP_COUNT) -> pd.DataFrame:
        """The loops of all α, as `ImpactLaw.loop`, with a first column `alpha_s_per_m`."""
        return self._joined([law.loop(speed, count) for law in self.laws])

    @checked
    def trajectory(self, speed: Quantities, count: int = LOOP_COUNT) -> pd.DataFrame:
        """The motions of all α, as `ImpactLaw.trajectory`, with a first column `alpha_s_per_m`."""
        return self._joined([law.trajectory(speed, count) for law in self.laws])

    def _joined(self, frames: list[pd.DataFrame]) -> pd.DataFrame:
        import pandas as pd

        for law, frame in zip(self.laws, frames, strict=True):
            frame.insert(0, "alpha_s_per_m", law.alpha)
        return pd.concat(frames, ignore_index=True)

    def _lines(self) -> Iterator[str]:
        speeds = ", ".join(f"{v:g}" for v in _SHOWN)
        yield f"Hunt-Crossley law, {len(self.laws)} α: e at {speeds} m/s"
        for law in self.laws:
            shown = ", ".join(f"{law.e(v):.3f}" for v in _SHOWN)
            yield f"α = {law.alpha:.6g} s/m: {shown}"

    def _rows(self) -> Iterator[Mapping[str, Any]]:
        for law in self.laws:
            yield from law._rows()


@overload
def law(
    alpha: Quantity | None = None,
    *,
    material: MaterialName | None = None,
    mass: Quantity = PAPER_MASS,
    stiffness: Quantity | None = None,
    exponent: Quantity = 1.5,
) -> ImpactLaw: ...


@overload
def law(
    alpha: list[Any] | tuple[Any, ...] | Floats,
    *,
    material: None = None,
    mass: Quantity = PAPER_MASS,
    stiffness: Quantity | None = None,
    exponent: Quantity = 1.5,
) -> ImpactLaws: ...


@checked
def law(
    alpha: Quantity | list[Any] | tuple[Any, ...] | Floats | None = None,
    *,
    material: MaterialName | None = None,
    mass: Quantity = PAPER_MASS,
    stiffness: Quantity | None = None,
    exponent: Quantity = 1.5,
) -> ImpactLaw | ImpactLaws:
    """Say what the Hunt-Crossley law expects of impacts, as `hcbench law` does.

    Parameters
    ----------
    alpha : float, text or quantity of Pint's, or a list or array of them
        α, s/m or with a unit.
    material : text, path or MaterialPair, optional
        In place of alpha: a pair of materials that `materials` lists with an α.
    mass : float, text or quantity of Pint's
        Effective mass, kg or with a unit, for forces, penetrations and durations.
    stiffness : float, text or quantity of Pint's, optional
        k of F = k xⁿ, N/mⁿ or with a unit; that of the paper's steel ball for n = 1.5.
    exponent : float
        n, 1 or more; 1.5 is Hertz's, of round bodies.

    Returns
    -------
    ImpactLaw
        Its method `e` gives restitution at impact speeds, `loop` and `trajectory` force and motion as data
        frames. ImpactLaws, with the same methods, for several α.

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
    known = target_material(material, alpha=alpha)
    if known is not None:
        alpha = known.alpha()
    if alpha is None:
        raise UserError("alpha", "missing", "α, s/m or with a unit, or a material")
    n = units.parse(exponent, "exponent", "exponent")
    if stiffness is None and n != 1.5:
        raise UserError("stiffness", f"missing for exponent {n:g}", f"k in N/m^{n:g}")
    if stiffness is None:
        stiffness = PAPER_STIFFNESS
    k = units.parse(stiffness, "stiffness", "stiffness", n)
    m = units.parse(mass, "mass", "mass", above=0)
    # A column of pandas is several, too.
    given: Any = alpha
    if isinstance(alpha, str) or (not isinstance(alpha, list | tuple) and np.ndim(given) == 0):
        return ImpactLaw(HuntCrossley(k, units.parse(alpha, "alpha", "alpha"), n), m)
    values = units.parse_values(alpha, "alpha", "alpha").tolist()
    return ImpactLaws(tuple(ImpactLaw(HuntCrossley(k, each, n), m) for each in values))
