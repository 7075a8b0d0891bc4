"""Two materials against each other: the ratio of their α, or of what they lose."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from hcbench.fitting.estimate import Estimate
from hcbench.fitting.heights import ratio
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from hcbench.fitting.result import FitResult

# Drops of each material: fewer hardly show how much drops differ.
_DROPS_TO_KNOW = 3


@dataclass(frozen=True, slots=True)
class Comparison:
    """Difference of two materials in α, or in 1 - e where e of both is constant.

    files: names of the other's.
    compared: "alpha", or "one_minus_e" where e of both is constant.
    ratio: of the first material's to the other's.
    """

    files: tuple[str, ...]
    compared: str
    ratio: Estimate
    few_drops: bool

    @property
    def differ(self) -> bool:
        """True if 1 lies outside the 95 % interval of the ratio."""
        return not self.ratio.low <= 1.0 <= self.ratio.high

    @property
    def line(self) -> str:
        """The verdict and the ratio, in words."""
        verdict = "no difference is seen"
        if self.differ:
            verdict = "the materials differ"
        compared = {"alpha": "α", "one_minus_e": "1 - e"}[self.compared]
        interval = f"{self.ratio.value:.3g}, 95 %: {self.ratio.low:.3g} ... {self.ratio.high:.3g}"
        return f"{verdict}: {compared} is {interval} times theirs"


def compare(one: FitResult, other: FitResult) -> Comparison:
    """The ratio of their α, or of 1 - e. Raises UserError where a side has neither."""
    files = tuple(s.name for s in other.sets)
    few = min(len(one.sets), len(other.sets)) < _DROPS_TO_KNOW
    if one.alpha is not None and other.alpha is not None:
        return Comparison(files, "alpha", ratio(_each(one, "alpha"), _each(other, "alpha")), few)
    if one.restitution is not None and other.restitution is not None:
        lost = ratio(_each(one, "restitution"), _each(other, "restitution"))
        return Comparison(files, "one_minus_e", lost, few)
    slot = "--against"
    if one.alpha is None and one.restitution is None:
        slot = "the files"
    raise UserError(slot, "no number to compare", "both with an α, or both with a constant e")


def _each(result: FitResult, name: str) -> list[Estimate]:
    """α of each drop, or 1 - e ("restitution"); that of all together
    where drops have none of their own.

    name: "alpha" or "restitution". Drops that have no such number are left out.
    """
    estimates = []
    for fitted in result.drops or [result]:
        estimate: Estimate | None = getattr(fitted, name)
        if estimate is None:
            continue
        if name == "restitution":
            # The ends of the interval change places.
            low = 1.0 - estimate.high
            high = 1.0 - estimate.low
            estimate = replace(estimate, value=1.0 - estimate.value, low=low, high=high)
        estimates.append(estimate)
    return estimates


def as_text(comparison: Comparison) -> str:
    """Verdict and ratio of a comparison, for a terminal."""
    lines = [f"against {', '.join(comparison.files)}", f"  {comparison.line}"]
    if comparison.few_drops:
        lines.append(
            "  With three drops or more of each, the difference from drop to drop is known better."
        )
    return "\n" + "\n".join(lines) + "\n"


def as_record(comparison: Comparison) -> dict[str, Any]:
    """The comparison as `--json` prints it."""
    return {
        "files": list(comparison.files),
        "compared": comparison.compared,
        "ratio": dataclasses.asdict(comparison.ratio),
        "differ": comparison.differ,
    }
