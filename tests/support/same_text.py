"""Texts that programs print, compared as a reader compares them: words by
their letters, numbers by value.

The last digits of a number are the processor's: its instructions and the kernels of NumPy and
OpenBLAS round sums in other orders. A number with a point or an exponent is the same within
`TOLERANCE`; counts, versions and dates have the same digits. In a shown text `...` stands for any
part; right after a number for its other digits.
"""

from __future__ import annotations

import math
import re

TOLERANCE = 1e-6  # relative: texts of up to six digits are the same digits
LEFT_OUT = "..."
_SHOWN = re.compile(
    r"(?<![\w.])(?P<number>[-+]?\d+(?:\.\d+(?:e[-+]?\d+)?|e[-+]?\d+))(?:(?P<cut>\.{3})|(?![\w.]))"
    r"|(?P<left_out>\.{3})"
)
_NUMBER = r"((?>[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?))"


def is_same(shown: str, printed: str) -> bool:
    """Say whether a printed text is the shown one."""
    match = re.fullmatch(_pattern(shown), printed, re.DOTALL)
    return match is not None and _has_the_values(shown, match)


def is_within(shown: str, printed: str) -> bool:
    """Say whether the shown text is a part of the printed one."""
    return any(
        _has_the_values(shown, match) for match in re.finditer(_pattern(shown), printed, re.DOTALL)
    )


def _pattern(shown: str) -> str:
    """A shown text as a regular expression with a group for each of its numbers."""
    pieces, end = list[str](), 0
    for match in _SHOWN.finditer(shown):
        number = _NUMBER * bool(match["number"])
        rest = ".*" * bool(match["cut"] or match["left_out"])
        pieces += [re.escape(shown[end : match.start()]), number, rest]
        end = match.end()
    return "".join([*pieces, re.escape(shown[end:])])


def _has_the_values(shown: str, match: re.Match[str]) -> bool:
    numbers = [number for number in _SHOWN.finditer(shown) if number["number"]]
    return all(_is_same_value(*pair) for pair in zip(numbers, match.groups(), strict=True))


def _is_same_value(shown: re.Match[str], printed: str) -> bool:
    value, other = float(shown["number"]), float(printed)
    if shown["cut"]:
        decimals = len(shown["number"].partition(".")[2])
        other = math.copysign(
            math.floor(abs(other) * 10**decimals * (1 + TOLERANCE)) / 10**decimals, other
        )
    return math.isclose(value, other, rel_tol=TOLERANCE)
