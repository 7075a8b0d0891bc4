"""Two materials against each other: the ratio of their α, or of what they lose."""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from hcbench.errors import UserError
from hcbench.fitting.drops import ratio
from hcbench.fitting.estimates import Estimate

if TYPE_CHECKING:
    from hcbench.fitting.result import FitResult


def compared(one: FitResult, other: FitResult) -> tuple[str, Estimate]:
    """What is compared, and its ratio with a 95 % interval. Raises UserError where a side has no number."""
    if one.alpha is not None and other.alpha is not None:
        return "α", ratio(_each(one, "alpha"), _each(other, "alpha"))
    if one.restitution is not None and other.restitution is not None:
        return "1 - e", ratio(_each(one, "restitution"), _each(other, "restitution"))
    sides = [(one, "the files"), (other, "--against")]
    silent = next(
        (what for side, what in sides if side.alpha is None and side.restitution is None), "--against"
    )
    raise UserError(silent, "no number to compare", "both with an α, or both with a constant e")


def _each(result: FitResult, name: str) -> list[Estimate]:
    drops = [getattr(drop, name) for drop in result.drops] or [getattr(result, name)]
    estimate = [one for one in drops if one is not None]
    if name == "alpha":
        return estimate
    return [replace(e, value=1.0 - e.value, low=1.0 - e.high, high=1.0 - e.low) for e in estimate]


def against_text(one: FitResult, other: FitResult) -> str:
    """Whether the materials differ, and by how much, for a terminal."""
    what, estimate = compared(one, other)
    interval = f"{estimate.value:.3g}, 95 %: {estimate.low:.3g} ... {estimate.high:.3g}"
    names = ", ".join(s.name for s in other.sets)
    verdict = "no difference is seen" if estimate.low <= 1.0 <= estimate.high else "the materials differ"
    lines = [f"against {names}", f"  {verdict}: {what} is {interval} times theirs"]
    if min(len(one.sets), len(other.sets)) < 3:
        lines.append("  With three drops or more of each, the difference from drop to drop is known better.")
    return "\n" + "\n".join(lines) + "\n"


def against_record(one: FitResult, other: FitResult) -> dict[str, Any]:
    """The same for `--json`."""
    what, estimate = compared(one, other)
    return {
        "files": [s.name for s in other.sets],
        "compared": "alpha" if what == "α" else "one_minus_e",
        "ratio": dataclasses.asdict(estimate),
        "differ": not estimate.low <= 1.0 <= estimate.high,
    }
