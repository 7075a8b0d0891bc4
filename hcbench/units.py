"""Quantities read from text with units, as SI floats, by Pint. A plain number is SI already."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.errors import QuantityError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

INCH = 0.0254  # m
POUND = 0.45359237  # kg
POUND_FORCE = 4.4482216152605  # N
PSI = 6894.757293168361  # Pa
STANDARD_GRAVITY = 9.80665  # m/s²
RANGE_COUNT = 20  # "1:20 in/s" without a count: 1, 2, ..., 20


@dataclass(frozen=True, slots=True)
class Quantity:
    """A kind of number: its SI unit, which a text must convert to, and an example for errors."""

    name: str
    unit: str
    example: str


QUANTITIES = {
    q.name: q
    for q in (
        Quantity("alpha", "s/m", "0.008 s/in"),
        Quantity("speed", "m/s", "16 in/s"),
        Quantity("timestep", "s", "1e-3 or 1 ms"),
        Quantity("mass", "kg", "1 lb"),
        Quantity("length", "m", "1 in"),
        Quantity("pressure", "Pa", "30e6 psi"),
        Quantity("acceleration", "m/s^2", "9.81 m/s^2"),
        Quantity("force", "N", "600 lbf"),
        Quantity("damping", "N*s/m", "100 N*s/m"),
        Quantity("frequency", "Hz", "100 Hz"),
        Quantity("stiffness", "N/m^n", "3.1e7 lbf/in^1.5"),
        Quantity("number", "", "1.5"),
    )
}

_PLAIN = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_NUMBER_FIRST = re.compile(rf"\s*({_PLAIN.pattern})\s*(.*)", re.DOTALL)


_LONGEST_UNIT = 60
_TOWER = re.compile(r"(\*\*|\^)[^*^/]*(\*\*|\^)|\d{4}")  # powers of powers: Pint would compute them


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(cache_folder=None)


@cache
def _factor(unit: str, si: str) -> float:
    """What one `unit` is in `si`; raises whatever Pint raises for text that is not such a unit."""
    registry = _registry()
    return float(registry.Quantity(1.0, registry.parse_units(unit)).to(si).magnitude)


def _si_unit(quantity: Quantity, exponent: float) -> str:
    return quantity.unit.replace("^n", f"^{exponent!r}")


def _scale(unit: str, quantity: Quantity, slot: str, text: str, exponent: float) -> float:
    si = _si_unit(quantity, exponent)
    if not unit:
        return 1.0
    wanted = f"a unit that converts to {si}" if si else "a plain number"
    if len(unit) > _LONGEST_UNIT or _TOWER.search(unit):
        raise QuantityError(
            slot, f"{text[:80]!r}: not a unit", wanted, f"Write for example {quantity.example!r}"
        )
    if not si:
        raise QuantityError(
            slot, f"{text!r} has the unit {unit!r}", wanted, f"Write for example {quantity.example!r}"
        )
    try:
        return _factor(unit, si)
    except Exception as error:  # Pint raises several unrelated kinds for text that is no unit
        why = "is not a known unit" if "Undefined" in type(error).__name__ else "does not fit"
        raise QuantityError(
            slot,
            f"{text!r}: {unit!r} {why}",
            wanted,
            f"Write for example {quantity.example!r}; plain numbers are SI",
        ) from None


def parse(value: object, quantity: str, slot: str = "", exponent: float = 1.5) -> float:
    """One quantity as an SI float.

    value: a number (SI already) or text such as "0.008 s/in". quantity: a name in QUANTITIES.
    slot: what to call it in an error. exponent: n in N/m^n, for a stiffness.
    Raises QuantityError for text that is no such quantity and for values that are not finite.
    """
    kind = QUANTITIES[quantity]
    slot = slot or quantity
    if isinstance(value, int | float | np.number) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
    elif isinstance(value, str):
        match = _NUMBER_FIRST.fullmatch(value)
        if match is None:
            raise QuantityError(
                slot, f"{value!r} is not a number", f"one like {kind.example!r}", "Plain numbers are SI"
            )
        number = float(match[1]) * _scale(match[4].strip(), kind, slot, value, exponent)
    else:
        raise QuantityError(slot, f"{value!r}", f"a number or text like {kind.example!r}")
    if not math.isfinite(number):
        raise QuantityError(slot, f"{value!r} is not finite", f"a finite number like {kind.example!r}")
    return number


def parse_values(value: object, quantity: str, slot: str = "") -> Floats:
    """Several quantities, shape (n,), SI: "4, 8, 16 in/s", "1:20 in/s" (20 even values), "1:20:5 in/s" (5).

    A list may mix all of these. Order is kept. Raises QuantityError.
    """
    kind = QUANTITIES[quantity]
    slot = slot or quantity
    if isinstance(value, list | tuple | np.ndarray):
        parts = [parse_values(v, quantity, slot) for v in value]
        if not parts:
            raise QuantityError(slot, "an empty list", f"at least one value like {kind.example!r}")
        return np.concatenate(parts)
    if not isinstance(value, str) or not re.search(r"[:,]", value):
        return np.array([parse(value, quantity, slot)])
    pieces = [piece.strip() for piece in value.split(",")]
    unit = _trailing_unit(pieces[-1])
    out: list[float] = []
    for piece in pieces:
        own = _trailing_unit(piece)
        numbers = piece.removesuffix(own).strip()
        scale = _scale(own or unit, kind, slot, value, 1.5)
        out.extend(_expand(numbers, slot, value) * scale)
    if not np.isfinite(out).all():
        raise QuantityError(slot, f"{value[:80]!r} is not finite", f"finite numbers like {kind.example!r}")
    return np.array(out)


_SPAN = re.compile(rf"\s*{_PLAIN.pattern}(?:\s*:\s*{_PLAIN.pattern})*\s*(?P<unit>[^\d\s.:+\-].*)?", re.DOTALL)


def _trailing_unit(piece: str) -> str:
    match = _SPAN.fullmatch(piece)
    return (match["unit"] or "").strip() if match else ""


def _expand(numbers: str, slot: str, text: str) -> Floats:
    parts = [part.strip() for part in numbers.split(":")]
    shape = 'a list like "4, 8, 16 in/s" or a range "1:20 in/s", "1:20:5 in/s" (first:last:count)'
    if len(parts) > 3 or not all(_PLAIN.fullmatch(part) for part in parts):
        raise QuantityError(slot, f"{text!r}", shape)
    values = [float(part) for part in parts]
    if len(values) == 1:
        return np.array(values)
    count = values[2] if len(values) == 3 else RANGE_COUNT
    if count != int(count) or not 2 <= count <= 100_000:
        raise QuantityError(
            slot, f"{text!r} asks for {count:g} values", "a whole number from 2 to 100000", shape
        )
    return np.linspace(values[0], values[1], int(count))


def require_positive(values: Floats | Iterable[float] | float, quantity: str, slot: str = "") -> None:
    """Raise QuantityError unless every value is above 0."""
    kind = QUANTITIES[quantity]
    for value in np.atleast_1d(np.asarray(values, dtype=float)):
        if not value > 0:
            raise QuantityError(
                slot or quantity,
                f"{value:g} {kind.unit}".strip(),
                "a value above 0",
                f"Write for example {kind.example!r}",
            )
