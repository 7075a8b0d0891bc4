"""`hcbench.convert`: one contact in every library's words, those of
each engine from its own folder.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from hcbench.catalogue.target import target_material
from hcbench.laws.conventions import contact_of, said
from hcbench.laws.impact_law import read_adams, read_newton
from hcbench.laws.restitution import Reading
from hcbench.sim import registry
from hcbench.sim.capabilities import DescribesContact
from hcbench.system.errors import UserError
from hcbench.terms import units
from hcbench.terms.arguments import checked
from hcbench.terms.options import MaterialName, Quantity

if TYPE_CHECKING:
    from hcbench.catalogue.material import MaterialPair
    from hcbench.laws.conventions import Conversion
    from hcbench.laws.impact_law import Adams, Newton

_QUANTITIES = {
    "alpha": "alpha",
    "drake": "alpha",
    "simbody": "alpha",
    "restitution": "restitution",
    "mass": "mass",
    "speed": "speed",
    "contact_time": "time",
    "timestep": "time",
}


@checked
def convert(
    *,
    material: MaterialName | None = None,
    alpha: Quantity | None = None,
    drake: Quantity | None = None,
    simbody: Quantity | None = None,
    restitution: Quantity | None = None,
    solref: str | Sequence[float | str] | None = None,
    adams: Adams | None = None,
    newton: Newton | None = None,
    mass: Quantity | None = None,
    speed: Quantity | None = None,
    contact_time: Quantity | None = None,
    timestep: Quantity | None = None,
    target: Reading = "law",
) -> Conversion:
    """Convert a contact between libraries, as `hcbench convert` does.

    Parameters
    ----------
    material : text, path or MaterialPair, optional
        In place of the next seven: a pair of materials that `materials` lists. One e holds at the speed that
        it was measured at, which is `speed` by default.
    alpha, drake, simbody, restitution, solref, adams, newton : float, text or quantity of Pint's
        Exactly one: α, s/m; Drake's hunt_crossley_dissipation, s/m; Simbody's dissipation, s/m; e at `speed`;
        a solref of two numbers; IMPACT of Adams, "k, e, cmax, d"; or a solver of Newton, "NAME, ke, kd".
    mass : float, text or quantity of Pint's, optional
        Effective mass, kg or with a unit, for `adams` and `newton`.
    speed : float, text or quantity of Pint's, optional
        Impact speed to match, m/s or with a unit, for engines with one e at all speeds.
    contact_time, timestep : float, text or quantity of Pint's, optional
        Duration of the contact, and the time step, s or with a unit, for a solref.
    target : {"law", "linear"}
        Write α as the law's e(v), or as e = 1 - α v.

    Returns
    -------
    Conversion
        `rows`: what to write in each system; `caveats`. `restitution` is e of the law at `speed` and
        `restitution_linear` is 1 - α v there, whatever the target.

    Raises
    ------
    UserError
        For numbers without meaning, and for none or several of the first eight.

    Examples
    --------
    >>> import hcbench as hb
    >>> contact = hb.convert(drake="0.45 s/m", speed="0.5 m/s")
    >>> round(contact.alpha, 6), round(contact.restitution, 3)
    (0.3, 0.869)

    """
    ways = {"alpha": alpha, "drake": drake, "simbody": simbody, "restitution": restitution}
    known = target_material(material, **ways, solref=solref, adams=adams, newton=newton)
    if known is not None:
        numbers_of_material = _of_material(known, speed)
        alpha = numbers_of_material.alpha
        restitution = numbers_of_material.restitution
        speed = numbers_of_material.speed
    given = {
        "alpha": alpha, "drake": drake, "simbody": simbody, "restitution": restitution, "mass": mass,
        "speed": speed, "contact_time": contact_time, "timestep": timestep,
    }  # fmt: skip
    numbers: dict[str, float | None] = {}
    for name, value in given.items():
        numbers[name] = None
        if value is not None:
            numbers[name] = units.parse(value, _QUANTITIES[name], name)
    contact = contact_of(
        **numbers,
        solref=_solref(solref),
        adams=None if adams is None else read_adams(adams),
        newton=None if newton is None else read_newton(newton),
        reading=target,
    )
    engines = map(registry.adapter, registry.names())
    own = (engine.vocabulary(contact) for engine in engines if isinstance(engine, DescribesContact))
    return said(contact, own)


class _OfMaterial(NamedTuple):
    """Numbers of a material that are converted.

    alpha: its α, s/m; None for a material without one.
    restitution: its e at the speed; None for a material with an α, which gives e at any speed.
    speed: m/s; None for a material with an α where the user gave none.
    """

    alpha: float | None
    restitution: float | None
    speed: float | None


def _of_material(known: MaterialPair, speed: Quantity | None) -> _OfMaterial:
    """Numbers of a material to convert: its α, or without one its e at a speed.

    known: the material, with what its source states.
    speed: as the user gave it, or None: then e is taken at a speed of the source, the middle one.
    Warns of a speed outside the material's range.
    Raises QuantityError for text that is not a speed, UserError for a material without an α where
    neither the user nor the source states one.
    """
    v = None if speed is None else units.parse(speed, "speed", "speed", above=0.0)
    if v is None and known.speeds is not None and known.target.alpha is None:
        v = known.speeds[len(known.speeds) // 2]
    if v is not None:
        known.warn_outside(v, v)
    if known.target.alpha is not None:
        return _OfMaterial(known.target.alpha, restitution=None, speed=v)
    if v is None:
        got = f"none, and the source of {known.name!r} states none"
        raise UserError("speed", got, "the impact speed at which e is to hold")
    return _OfMaterial(None, float(known.curve("law").at(v)), v)


def _solref(given: str | Sequence[float | str] | None) -> tuple[float, float] | None:
    """The two numbers of a solref, from text or a sequence; None for None.

    They are a time constant, s, and a damping ratio, or, both below 0, a stiffness, 1/s², and a
    damping, 1/s; here they are only read.
    given: as the user wrote it, such as "-2.7e8 -815" or [0.02, 1].
    Raises UserError for anything but two numbers.
    """
    if given is None:
        return None
    parts: Sequence[float | str] = given
    if isinstance(given, str):
        parts = given.replace(",", " ").split()
    try:
        first, second = (units.parse(part, "number", "solref") for part in parts)
    except (TypeError, ValueError):
        raise UserError("solref", repr(given), "two numbers such as '-2.7e8 -815'") from None
    return first, second
