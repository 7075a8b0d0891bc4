"""Quantities read from text with units, as SI floats, by Pint. A plain number is SI already."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.system.errors import QuantityError
from hcbench.system.text import shown
from hcbench.terms.bounds import require_bounds
from hcbench.terms.options import PintQuantity

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

INCH = 0.0254  # m
POUND = 0.45359237  # kg
POUND_FORCE = 4.4482216152605  # N
PSI = 6894.757293168361  # Pa
STANDARD_GRAVITY = 9.80665  # m/s²
# Values of a range without a count: "1:20 in/s" is 1, 2, ..., 20.
RANGE_COUNT = 20


@dataclass(frozen=True, slots=True)
class QuantityKind:
    """A kind of number.

    unit: SI, which a text must convert to; "" for a plain number.
    example: for errors.
    below: a bound that no value reaches, SI.
    least: the lowest value, SI.
    """

    name: str
    unit: str
    example: str
    below: float = math.inf
    least: float = -math.inf


QUANTITIES = {
    q.name: q
    for q in (
        QuantityKind("alpha", "s/m", "0.008 s/in"),
        QuantityKind("speed", "m/s", "16 in/s"),
        QuantityKind("timestep", "s", "1e-3, 1 ms or 1/240 s"),
        QuantityKind("time", "s", "10 ms"),
        QuantityKind("mass", "kg", "1 lb"),
        QuantityKind("length", "m", "1 in"),
        QuantityKind("position", "m", "1 in"),
        QuantityKind("pressure", "Pa", "30e6 psi"),
        QuantityKind("acceleration", "m/s^2", "9.81 m/s^2"),
        QuantityKind("force", "N", "600 lbf"),
        QuantityKind("energy", "J", "10 mJ"),
        QuantityKind("damping", "N*s/m", "100 N*s/m"),
        QuantityKind("frequency", "Hz", "100 Hz"),
        QuantityKind("stiffness", "N/m^n", "3.1e7 lbf/in^1.5"),
        QuantityKind("number", "", "1.5"),
        QuantityKind("restitution", "", "0.9", least=0.0),
        QuantityKind("exponent", "", "1.5", least=1.0),
        QuantityKind("friction", "", "0.5", least=0.0),
        # From the normal of the plate.
        QuantityKind("angle", "rad", "60 deg", below=math.pi / 2),
        QuantityKind("spin", "rad/s", "40 rad/s"),
    )
}

_PLAIN = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_NUMBER = re.compile(rf"\s*({_PLAIN}(?:/\d+)?)\s*+(?!,)(.*)", re.DOTALL)
_PIECE = re.compile(
    rf"\s*(?P<range>{_PLAIN}(?:/\d+)?(?:\s*:\s*{_PLAIN}){{0,2}})\s*(?P<unit>[^\d\s.:+\-].*)?",
    re.DOTALL,
)
# Pint passes over comments and reads quotes as inches or feet.
_UNIT = re.compile(r"[\w\s*/^().·+-]+")
# Pint takes a radian for 1: off by 2π.
_ANGLE = {
    "frequency": "1 rpm is 1/60 Hz and 1 rad/s is 1/(2π) Hz",
    "spin": "1 Hz of turns is 60 rpm",
}
# A comma between whole digits: "1,5" may be 1.5 or 1 and 5; "1,2,3" is a list; "1,050" is none.
_DECIMAL_COMMA = re.compile(r"(?<![\w.,+-])[-+]?\d+,\d+(?!\d|,\d)|,0\d")
_SHAPE = 'a list like "4, 8, 16 in/s" or a range "1:20 in/s", "1:20:5 in/s" (first:last:count)'
_UNCERTAIN = re.compile(
    r"\s*\(?\s*(?P<value>[^()±]*?)\s*(?:±|\+/?-)\s*(?P<by>[^()±]*?)\s*(?:\)\s*(?P<unit>.*?))?\s*",
    re.DOTALL,
)
_LONGEST_UNIT = 60
# A sign, except that of an exponent: Pint would add or negate.
_SIGN = re.compile(r"(?<![\^*(eE])[-+]")
# Powers of powers, and numbers of four digits and more: Pint would compute the power.
_TOWER = re.compile(r"(\*\*|\^)[^*^/]*(\*\*|\^)|\d{4}")


# A negative power right behind a unit: "m s-1", "m·s⁻¹".
_INVERSE = re.compile(r"(?<=[a-zA-Zµ])(?:\^|\*\*)?[-−⁻]([1-4¹²³⁴])(?![\d.])")
_PRODUCT = re.compile(r"(?<=[a-zA-Zµ])[·⋅.](?=[a-zA-Zµ])")
_DIGITS = str.maketrans("¹²³⁴", "1234")
# Units as people write them in names, where Pint has another word.
_OTHER_WORDS = {
    "kmh": "km/h",
    "km_h": "km/h",
    "kmph": "km/h",
    **{f"{length}_s": f"{length}/s" for length in ("m", "cm", "mm", "in", "ft")},
}


# SI values of the units that nearly everybody writes. Pint knows all others, and takes half a
# second to import.
_USUAL = {
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "in/s": INCH},
    "s/m": {"s/m": 1.0, "s/in": 1.0 / INCH},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "in": INCH},
    "kg": {"kg": 1.0, "g": 1e-3, "lb": POUND},
    "m/s^2": {"m/s^2": 1.0, "m/s²": 1.0},
    "rad": {"rad": 1.0, "deg": math.pi / 180},
    "rad/s": {"rad/s": 1.0},
    "Hz": {"Hz": 1.0, "kHz": 1e3},
    "N": {"N": 1.0, "kN": 1e3, "lbf": POUND_FORCE},
    "Pa": {"Pa": 1.0, "MPa": 1e6, "GPa": 1e9, "psi": PSI},
    "N/m": {"N/m": 1.0},
    "N/m^1.5": {"N/m^1.5": 1.0, "lbf/in^1.5": 1098.843494108755},
    "N*s/m": {"N*s/m": 1.0},
}
# None of these converts to another, so Pint need not be asked. Angles and stiffnesses are not
# among them: their units say more than their dimension.
_APART = ("m/s", "s/m", "s", "m", "kg", "m/s^2", "N", "Pa", "N*s/m")


def _is_of_another(unit: str, si: str) -> bool:
    """True for a usual unit that surely does not convert to `si`; False where only Pint knows."""
    return si in _APART and any(unit in _USUAL[other] for other in _APART if other != si)


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(cache_folder=None)


@cache
def _factor(unit: str, si: str) -> float:
    """Return the size of one `unit` in the unit `si`.

    Raises Pint's own error for text that is not such a unit, TypeError for a usual unit of
    another kind, ValueError where an angle is in one of the two alone.
    """
    if _is_of_another(unit, si):
        raise TypeError(unit)
    registry = _registry()
    quantity = registry.Quantity(1.0, registry.parse_units(unit))
    if ("radian" in str(quantity.to_root_units().units)) != ("rad" in si):
        raise ValueError(unit)
    return float(quantity.to(si).magnitude)


def usual_unit(unit: str) -> str:
    """A unit in the form that Pint reads: "m*s^-1" of "m·s⁻¹" and "m.s-1", "km/h" of "kmh"."""
    unit = _INVERSE.sub(lambda power: f"^-{power[1].translate(_DIGITS)}", unit)
    unit = _PRODUCT.sub("*", re.sub(r"[\s_]per[\s_]", "/", unit))
    return _OTHER_WORDS.get(unit, unit)


def _scale(unit: str, kind: QuantityKind, slot: str, text: str, exponent: float) -> float:
    """Return the size of one `unit` in the SI unit of the kind; 1 for the unit "".

    slot: what to call the quantity in an error.
    text: all that the user wrote, for errors.
    exponent: n of N/m^n.

    Raises QuantityError for text that is not a unit, or one of another kind.
    """
    if not unit:
        return 1.0
    si = kind.unit.replace("^n", f"^{exponent!r}")
    expected = f"a unit that converts to {si}" if si else "a plain number"
    advice = f"Write for example {kind.example!r}"
    if "±" in unit or re.search(r"\+/?-", unit):
        raise QuantityError(
            slot, f"{text[:80]!r} has an uncertainty", "a value without one", advice
        )
    if unit.endswith("%"):
        raise QuantityError(slot, f"{text[:80]!r} is in per cent", expected, advice)
    unit = usual_unit(unit)
    is_unit = _UNIT.fullmatch(unit) and not _TOWER.search(unit) and not _SIGN.search(unit)
    if len(unit) > _LONGEST_UNIT or not is_unit:
        raise QuantityError(slot, f"{text[:80]!r}: not a unit", expected, advice)
    if not si:
        raise QuantityError(slot, f"{text!r} has the unit {unit!r}", expected, advice)
    usual = _USUAL.get(si, {}).get(unit)
    if usual is not None:
        return usual
    try:
        return _factor(unit, si)
    except Exception as error:
        # Pint raises several unrelated kinds of error for text that it cannot read as a unit. A
        # plain ValueError is `_factor`'s own: an angle in one of the two units alone.
        if type(error) is ValueError and kind.name in _ANGLE:
            what = "an angle" if kind.name == "frequency" else "no angle"
            raise QuantityError(
                slot, f"{text!r} is {what} in time", expected, _ANGLE[kind.name]
            ) from None
        why = "does not fit"
        if "Undefined" in type(error).__name__:
            why = "is not a known unit"
        got = f"{text!r}: {unit!r} {why}"
        raise QuantityError(slot, got, expected, f"{advice}; plain numbers are SI") from None


def parse(
    value: object,
    quantity: str,
    slot: str = "",
    exponent: float = 1.5,
    *,
    least: float = -math.inf,
    above: float = -math.inf,
) -> float:
    """Parse one quantity and return it in SI units.

    value: a number (SI already) or text such as "0.008 s/in".
    quantity: a name in QUANTITIES.
    slot: what to call it in an error.
    exponent: n in N/m^n, for a stiffness.
    least, above: the lowest value that may be, and one that it must exceed, SI.

    Raises QuantityError for text that is not such a quantity and for values not finite or out of
    bounds, those of `bounds.BOUNDS` among them.
    """
    kind = QUANTITIES[quantity]
    slot = slot or quantity
    value = without_pint(value, quantity, slot, exponent)
    if isinstance(value, str):
        match = _NUMBER.fullmatch(value)
        if match is None:
            near = _near(value)
            advice = f"Write {near!r} if that is meant" if near else "Plain numbers are SI"
            raise QuantityError(
                slot, f"{value!r} is not a number", f"one like {kind.example!r}", advice
            )
        number = _fraction(match[1]) * _scale(match[2].strip(), kind, slot, value, exponent)
    elif is_real(value):
        try:
            number = float(value)  # type: ignore[arg-type]
        except OverflowError:
            # Python cannot make a float of an integer with more than 308 digits.
            number = math.inf
    else:
        raise QuantityError(slot, shown(value), f"a number or text like {kind.example!r}")
    _require_bounds([number], value, kind, slot, least, above)
    return number


def is_real(value: object) -> bool:
    """Say whether a value is a number of Python or NumPy: no bool, no complex number, no duration."""
    # NumPy takes timedelta64 for an integer.
    if isinstance(value, bool | np.timedelta64):
        return False
    return isinstance(value, int | float | np.integer | np.floating)


def real_array(values: object) -> Floats:
    """Numbers as an array of floats, of the shape that they have.

    Raises ValueError for text, booleans and anything else that NumPy would turn into numbers.
    """
    array = np.asarray(values)
    has_others = array.dtype.kind not in "iuf"
    if isinstance(values, list | tuple):
        # NumPy makes 1 of a True beside numbers.
        has_others |= any(isinstance(each, bool) for each in np.asarray(values, object).flat)
    if has_others:
        raise ValueError("not numbers alone")
    return array.astype(float)


def without_pint(value: object, quantity: str, slot: str, exponent: float = 1.5) -> Any:
    """A quantity of Pint's as a number or an array, SI; any other value as it is.

    quantity: a name in QUANTITIES.
    slot: what to call it in an error.
    exponent: n in N/m^n.

    Raises QuantityError for a unit of another kind.
    """
    if isinstance(value, str | float | int) or not isinstance(value, PintQuantity):
        return value
    unit = str(value.units)
    # [()] makes a number of an array without dimensions.
    magnitude = np.asarray(value.magnitude)[()]
    if unit == "dimensionless":
        unit = ""
    return magnitude * _scale(unit, QUANTITIES[quantity], slot, str(value), exponent)


def _fraction(text: str) -> float:
    """The number of a text such as "0.5", or one over a whole one, "1/240"; infinite over 0, which
    the bounds refuse.
    """
    over, _, under = text.partition("/")
    divisor = float(under or 1)
    if divisor == 0.0:
        return math.inf
    return float(over) / divisor


def _near(text: str) -> str:
    """The quantity that a text with a decimal comma, two signs or a
    typographer's minus may mean; or "".
    """
    near = re.sub(r"(\d),(\d)", r"\1.\2", text.replace("−", "-"))
    near = re.sub(r"^\s*([-+])[-+]+", r"\1", near)
    return near if near != text and _NUMBER.fullmatch(near) else ""


def parse_uncertain(
    value: object,
    quantity: str,
    slot: str = "",
    *,
    least: float = -math.inf,
    above: float = -math.inf,
) -> tuple[float, float]:
    """A quantity and its standard uncertainty, SI: "0.31 +- 0.004 s/m", "30 ±
    0.1 cm"; 0 where none is given.

    The unit may stand behind both, or behind a pair in brackets.

    value, quantity, slot, least, above: as of `parse`, which raises QuantityError. The bounds are
    of the quantity; an uncertainty is 0 or more.
    """
    match = _UNCERTAIN.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        return parse(value, quantity, slot, least=least, above=above), 0.0
    # "(0.31 +- 0.004) s/m" has its unit there, for both.
    behind_bracket = match["unit"] or ""
    number = f"{match['value']} {behind_bracket}".strip()
    error = f"{match['by']} {behind_bracket}".strip()
    unit = _unit_of(number)
    unit_of_error = _unit_of(error)
    if unit_of_error == "%":
        got = f"{value!r:.80} has its uncertainty in per cent"
        raise QuantityError(slot, got, "it in the unit of the value")
    # One unit holds for both.
    if unit_of_error and not unit:
        number = f"{number} {unit_of_error}"
    elif unit and not unit_of_error:
        error = f"{error} {unit}"
    value_si = parse(number, quantity, slot, least=least, above=above)
    return value_si, parse(error, quantity, slot, least=0.0)


def _unit_of(text: str) -> str:
    """The unit behind a number; "" without one, or without a number."""
    match = _NUMBER.fullmatch(text)
    if match is None:
        return ""
    return match[2].strip()


def parse_max_error(value: object) -> float:
    """Largest error of e that is allowed, from a number or its text.

    Text may be in per cent: "5%" is 0.05.
    Raises QuantityError for anything else than a number of 0 ... 1.
    """
    expected = "0 ... 1, a difference in e, such as 0.05 or 5%"
    in_percent = isinstance(value, str) and value.rstrip().endswith("%")
    number = str(value).rstrip().removesuffix("%") if in_percent else value
    try:
        max_error = parse(number, "number", "max-error")
    except QuantityError as error:
        raise QuantityError("max-error", error.got, expected) from None
    if in_percent:
        max_error /= 100
    # Also true for NaN, which no error is larger than.
    if not 0 <= max_error <= 1:
        raise QuantityError("max-error", f"{max_error:g}", expected)
    return max_error


def parse_values(
    value: object,
    quantity: str,
    slot: str = "",
    *,
    least: float = -math.inf,
    above: float = -math.inf,
) -> Floats:
    """Several quantities, shape (n,), SI: "4, 8, 16 in/s", "1:20 in/s" (20
    even values), "1:20:5 in/s" (5).

    A list, in text or of Python, may mix all of these. A unit at the end of a text alone holds for
    the whole text; otherwise each item has its own, or none has one. Order is kept.

    quantity, slot, least, above: as of `parse`, for each value.

    Raises QuantityError as `parse`, and for an empty list, another form, units at some values
    only, and a comma that may be a decimal one.
    """
    kind = QUANTITIES[quantity]
    slot = slot or quantity
    value = without_pint(value, quantity, slot)
    if not isinstance(value, str | list | tuple) and hasattr(value, "__array__"):
        # Also a column of pandas or a tensor.
        array = np.asanyarray(value).ravel()
        # NumPy makes whole numbers of durations, without their unit.
        value = list(array) if array.dtype.kind in "mM" else array.tolist()
    if isinstance(value, list | tuple):
        if not len(value):
            raise QuantityError(slot, "an empty list", f"at least one value like {kind.example!r}")
        parts = []
        for part in value:
            if isinstance(part, str):
                parts.append(parse_values(part, quantity, slot, least=least, above=above))
            else:
                parts.append(np.array([parse(part, quantity, slot, least=least, above=above)]))
        return np.concatenate(parts)
    if not isinstance(value, str) or not re.search(r"[:,]", value):
        return np.array([parse(value, quantity, slot, least=least, above=above)])
    numbers = _listed(value, kind, slot)
    _require_bounds(numbers, value, kind, slot, least, above)
    return np.array(numbers)


def _listed(text: str, kind: QuantityKind, slot: str) -> list[float]:
    """Numbers of a list or range in text, SI, not held to any bounds.

    slot: what to call it in an error.
    Raises QuantityError for another form, a comma that may be a decimal one, units at some values
    only, text that is not a unit of the kind, and a range's count as `_expand`.
    """
    # Matches of _PIECE, one for each item of the list.
    pieces = []
    for part in text.split(","):
        piece = _PIECE.fullmatch(part)
        if piece is None:
            raise QuantityError(slot, f"{text!r}", _SHAPE)
        if ":" in (piece["unit"] or ""):
            got = f"{text!r} has a unit within a range"
            raise QuantityError(slot, got, "one unit, at its end", f"Write {_SHAPE}")
        pieces.append(piece)
    comma = _DECIMAL_COMMA.search(text)
    if comma is not None:
        got = f"{text!r} has a comma between digits"
        near = comma[0].replace(",", ".")
        raise QuantityError(slot, got, f"{near!r}, or a space after the comma of a list")
    units = [(piece["unit"] or "").strip() for piece in pieces]
    # A unit at the end alone is that of all.
    last = units[-1]
    if any(units[:-1]) and not all(units):
        expected = "one unit at the end for the whole list, or one at each value"
        raise QuantityError(slot, f"{text!r} has units at some values only", expected)
    numbers: list[float] = []
    for piece, unit in zip(pieces, units, strict=True):
        scale = _scale(unit or last, kind, slot, text, exponent=1.5)
        numbers.extend(_expand(piece["range"], slot, text) * scale)
    return numbers


def _expand(text: str, slot: str, value: str) -> Floats:
    """The numbers of "first", "first:last" or "first:last:count".

    Of a range without a count there are RANGE_COUNT, evenly from first to last, in the unit of the
    text.
    slot, value: for errors, the latter all that the user wrote.
    Raises QuantityError for a count that is not a whole number from 2 to 100 000.
    """
    first, *rest = map(_fraction, text.split(":"))
    if not rest:
        return np.array([first])
    count = rest[1] if len(rest) == 2 else RANGE_COUNT
    if not 2 <= count <= 100_000 or count != int(count):
        got = f"{value!r} asks for {count:g} values"
        raise QuantityError(slot, got, "a whole number from 2 to 100000", _SHAPE)
    return np.linspace(first, rest[0], int(count))


def _require_bounds(
    numbers: list[float], value: object, kind: QuantityKind, slot: str, least: float, above: float
) -> None:
    """Raise QuantityError unless all numbers, in SI, are finite and within the kind's bounds.

    Bounds are those given here, the kind's `below` and `least`, and `bounds.BOUNDS`.

    numbers: one or more.
    value: what the user gave, and slot: what to call it, for the message.
    least, above: the lowest number that may be, and one that all must exceed.
    """
    if not np.isfinite(numbers).all():
        raise QuantityError(
            slot, f"{value!r:.80} is not finite", f"a finite number like {kind.example!r}"
        )
    lowest = min(numbers)
    if lowest <= above or lowest < least:
        bound = f"{least:g} {kind.unit}".strip()
        expected = f"a value above {above:g}" if lowest <= above else f"{bound} or more"
        advice = f"Write for example {kind.example!r}"
        raise QuantityError(slot, f"{lowest:g} {kind.unit}".strip(), expected, advice)
    if (highest := max(numbers)) >= kind.below:
        advice = f"Write for example {kind.example!r}; plain numbers are {kind.unit}"
        got = f"{value!r:.80}" if isinstance(value, str) else f"{highest:g} {kind.unit}"
        # Angles alone have such a bound; people write them in degrees.
        expected = f"below {math.degrees(kind.below):g} deg ({kind.below:.6g} {kind.unit})"
        raise QuantityError(slot, got, expected, advice)
    require_bounds(slot, numbers, kind.name, kind.unit)
    if lowest < kind.least:
        # The table of bounds holds for sizes: -1 is within that of an exponent.
        raise QuantityError(slot, f"{lowest:g}", f"{kind.least:g} or more")


def parse_spin(value: object, slot: str = "spin") -> tuple[float, float, float]:
    """Angular velocity, rad/s, about the directions of `Launch`: along, across and the normal.

    value: three numbers, or one about that across, with which the body rolls on; as numbers or as
    text with a unit.
    slot: what to call it in an error.
    Raises QuantityError as `parse_values`, and for any other count.
    """
    spin = parse_values(value, "spin", slot).tolist()
    if len(spin) not in (1, 3):
        expected = "one number, or three: about the directions along and across, and the normal"
        raise QuantityError(
            slot, f"{value!r}", expected, "Write for example '40 rad/s' or '0, 40, 0 rad/s'"
        )
    return (0.0, spin[0], 0.0) if len(spin) == 1 else (spin[0], spin[1], spin[2])
