"""Numbers and names as people read them: one place that figures, tables and sentences go by."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from hcbench import units
from hcbench.errors import HcbenchError
from hcbench.sim import registry

if TYPE_CHECKING:
    from collections.abc import Sequence

INCH, POUND_FORCE = units.INCH, units.POUND_FORCE

NBSP = "\u00a0"  # between a number and its unit: never broken over two lines
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def engine_name(name: str) -> str:
    """An engine's title; its name where no engine of that name is installed."""
    try:
        return registry.engine(name).title or name
    except HcbenchError:
        return name


def setting_name(engine: str, setting: str) -> str:
    """The engine's title and the setting."""
    return f"{engine_name(engine)} {setting}"


def time(seconds: float) -> str:
    """ "1 µs", "0.2 ms", "4.17 ms"; thousandths of a unit are never shown."""
    for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if seconds >= size * (1 - 1e-9):
            return f"{seconds / size:.3g}{NBSP}{unit}"
    return f"{seconds / 1e-9:.3g}{NBSP}ns"


def about(seconds: float) -> str:
    """A time in two digits: "0.2 ms", "17 µs"."""
    return time(float(f"{seconds:.1e}"))


def alpha(value: float) -> str:
    """α in the paper's unit and in SI."""
    return f"{alpha_short(value)} ({value:.3g}{NBSP}s/m)"


def alpha_short(value: float) -> str:
    """α in the paper's unit."""
    return f"α{NBSP}={NBSP}{value * INCH:.3g}{NBSP}s/in"


def inches_per_second(value: float) -> str:
    """A speed in the paper's unit."""
    return f"{value / INCH:.3g}{NBSP}in/s"


def small(value: float) -> str:
    """A number that may be tiny, in two or three digits: "0.065", "2.1·10⁻⁵", "0"; round-off is "<10⁻¹²"."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    size = abs(value)
    if size < 1e-12:
        return "<10⁻¹²"
    if size >= 1e-3:
        return _scientific(value) if size >= 1e5 else f"{value:.3g}" if size < 1000 else f"{value:.0f}"
    return _scientific(value)


def _scientific(value: float) -> str:
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(_SUPERSCRIPT)}"


def power_of_ten(value: float) -> str:
    """ "10⁻³" for a tick; "" for what is no power of ten."""
    if value <= 0:
        return ""
    exponent = round(math.log10(value))
    if not math.isclose(value, 10.0**exponent, rel_tol=1e-6):
        return ""
    return {0: "1", 1: "10", -1: "0.1"}.get(exponent, f"10{str(exponent).translate(_SUPERSCRIPT)}")


def times(ratio: float) -> str:
    """ "8.1 times", "1/184 of"."""
    if ratio >= 1 or ratio <= 0:
        return f"{ratio:.3g} times"
    return f"1/{1 / ratio:.3g} of" if ratio < 0.5 else f"{ratio:.2f} of"


def percent(share: float) -> str:
    """ "3.2 %"."""
    return f"{small(100 * share)}{NBSP}%" if math.isfinite(share) else "–"


def listed(items: Sequence[str], last: str = "and") -> str:
    """ "a, b and c"."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {last} {items[-1]}"
