"""Numbers and names as people read them: used by figures, tables and sentences alike."""

import math
from collections.abc import Sequence

from hcbench.sim import registry
from hcbench.system.errors import HcbenchError
from hcbench.system.text import two_digits
from hcbench.terms.units import INCH

# Stands between a number and its unit: browsers never break a line there.
NBSP = "\u00a0"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def engine_title(name: str) -> str:
    """An engine's title; its name where no engine of that name is installed."""
    try:
        return registry.engine(name).title or name
    except HcbenchError:
        return name


def time(seconds: float) -> str:
    """A time, s, in three digits: "1 µs", "0.2 ms", "4.17 ms"; "1/240 s" and "1/60 s", the steps
    that engines use.
    """
    for rate in (240, 60):
        if math.isclose(seconds, 1 / rate, rel_tol=1e-9):
            return f"1/{rate}{NBSP}s"
    for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if seconds >= size * (1 - 1e-9):
            return f"{seconds / size:.3g}{NBSP}{unit}"
    return f"{seconds / 1e-9:.3g}{NBSP}ns"


def length(metres: float) -> str:
    """A length, m, in two digits: "3 µm", "0.98 mm", "1.2 m"; "0 µm" below 0.1 µm, "–" for NaN."""
    for size, unit in ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm")):
        if abs(metres) >= 0.0995 * size:
            return f"{float(f'{metres / size:.2g}'):g}{NBSP}{unit}"
    return f"0{NBSP}µm" if math.isfinite(metres) else "–"


def alpha(value: float) -> str:
    """α in SI and in the paper's unit."""
    return f"{alpha_short(value)} ({value * INCH:.3g}{NBSP}s/in)"


def alpha_short(value: float) -> str:
    """α in SI."""
    return f"α{NBSP}={NBSP}{value:.3g}{NBSP}s/m"


def span(low: str, high: str, space: str = NBSP) -> str:
    """ "1 … 20"; "1" where both ends are the same."""
    return low if low == high else f"{low}{space}…{space}{high}"


def number(value: float) -> str:
    """A number in two or three digits: "0.065", "2.1·10⁻⁵", "0"; from 1000 to 10⁵ all digits before
    the point; "<10⁻¹²" for round-off, "–" for no finite number.
    """
    if not math.isfinite(value):
        return "–"
    size = abs(value)
    if 0 < size < 1e-12:
        return f"<{_power_of_ten(-12)}"
    if size and not 1e-3 <= size < 1e5:
        return _scientific(f"{value:.1e}")
    return f"{value + 0.0:.3g}" if size < 1000 else f"{value:.0f}"


def error(value: float) -> str:
    """An error of e as `hcbench tune` writes it: "0.028", "1e-7" at the
    least; "–" for no finite number.
    """
    return two_digits(max(value, 1e-7)) if math.isfinite(value) else "–"


def four_digits(value: float) -> str:
    """ "1.5", "62000", "2.198·10⁷"."""
    if 1e-3 <= abs(value) < 1e6:
        return f"{float(f'{value:.4g}'):g}"
    mantissa, exponent = f"{value:.3e}".split("e")
    return _scientific(f"{float(mantissa):g}e{exponent}")


def difference(relative: float) -> str:
    """A relative difference: "+3.2 %", "× 3.96" where it is large, "0" where it is round-off."""
    if abs(relative) > 0.5:
        return f"× {1.0 + relative:.3g}"
    return f"{100 * relative:+.2g} %".replace("-", "−") if abs(relative) > 5e-5 else "0"


def typeset(text: str) -> str:
    """A formula with the paper's symbols as they are printed."""
    for typed, printed in (("v_i", "vᵢ"), ("v_o", "vₒ"), ("x_m", "xₘ"), (" - ", " − ")):
        text = text.replace(typed, printed)
    return text


def _scientific(text: str) -> str:
    """ "2.1e-05" as "2.1·10⁻⁵"."""
    mantissa, exponent = text.split("e")
    return f"{mantissa}·{_power_of_ten(int(exponent))}"


def _power_of_ten(exponent: int) -> str:
    return f"10{str(exponent).translate(_SUPERSCRIPT)}"


def power_of_ten(value: float) -> str:
    """Format a tick as "10⁻³"; "" unless the value is a power of ten."""
    if value <= 0:
        return ""
    exponent = round(math.log10(value))
    if not math.isclose(value, 10.0**exponent, rel_tol=1e-6):
        return ""
    return {0: "1", 1: "10", -1: "0.1"}.get(exponent, _power_of_ten(exponent))


def percent(share: float) -> str:
    """ "3.2 %"."""
    return f"{number(100 * share)}{NBSP}%" if math.isfinite(share) else "–"


def sentence(text: str) -> str:
    """Text with a capital first letter, except the symbol e."""
    return text if text.startswith("e ") else text[:1].upper() + text[1:]


def listed(items: Sequence[str], last: str = "and") -> str:
    """ "a, b and c"."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {last} {items[-1]}"
