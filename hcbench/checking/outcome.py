"""Results of checks."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from hcbench.measuring.curve import CurvePoint
from hcbench.measuring.measurement import Measurement
from hcbench.system.errors import CannotRun, HcbenchError, LimitPassed, UserError
from hcbench.system.text import Shown, sanitized
from hcbench.terms import units

if TYPE_CHECKING:
    from hcbench.sim.landing import Landings
    from hcbench.sim.touch import TrajectoryTouchdowns


class Verdict(StrEnum):
    """Result of a check."""

    PASSED = "passed"
    # Measured without a limit or a target.
    MEASURED = "measured"
    # A limit was exceeded.
    FAILED = "failed"
    # The user has to correct the request.
    MISTAKE = "mistake"
    COULD_NOT_RUN = "could not run"


_ERRORS: dict[Verdict, type[HcbenchError]] = {
    Verdict.FAILED: LimitPassed,
    Verdict.MISTAKE: UserError,
    Verdict.COULD_NOT_RUN: CannotRun,
}


@dataclass(frozen=True)
class Outcome:
    """The result of one check.

    name: of the check.
    against: what it was held against, in words.
    max_error: the limit; NaN where it was held against nothing.
    message: one line.
    rows: points of the measured curve.
    worst: the one that decides.
    measurement: None where the pair could not be measured, and for limits on landings.
    """

    name: str
    verdict: Verdict
    message: str
    against: str = ""
    max_error: float = math.nan
    rows: Sequence[CurvePoint] = ()
    worst: CurvePoint | None = None
    measurement: Measurement | None = None

    @property
    def line(self) -> str:
        """`PASSED name: message`."""
        return f"{self.verdict.value.upper()} {sanitized(self.name)}: {self.message}"

    @property
    def is_oblique(self) -> bool:
        """True if any launch was at an angle or spun."""
        if self.measurement is not None:
            return self.measurement.request.is_oblique
        return any(row.angle for row in self.rows)

    @property
    def exit_code(self) -> int:
        """The exit code of this check alone."""
        return _ERRORS[self.verdict].exit_code if self.verdict in _ERRORS else 0


@dataclass(frozen=True, repr=False)
class Report(Shown):
    """All checks of a run, in order."""

    outcomes: tuple[Outcome, ...] = ()

    def _lines(self) -> Iterator[str]:
        yield from (outcome.line for outcome in self.outcomes)

    def _rows(self) -> Iterator[dict[str, Any]]:
        for outcome in self.outcomes:
            about = {"check": outcome.name, "verdict": outcome.verdict.value}
            for row in outcome.rows:
                yield about | row.record(outcome.is_oblique)

    def raise_if_failed(self) -> None:
        """Raise the error of the first outcome with the report's exit code; nothing if that is 0.

        It is LimitPassed where a limit was exceeded, UserError for a mistake, CannotRun for the
        rest.
        """
        for outcome in self.outcomes:
            if outcome.exit_code == self.exit_code != 0:
                raise _ERRORS[outcome.verdict](
                    outcome.name, outcome.message, outcome.against or "a result"
                )

    @property
    def exit_code(self) -> int:
        """0 all within limits, 1 a limit exceeded, 2 a mistake, 3
        something could not run: the gravest.
        """
        return max((outcome.exit_code for outcome in self.outcomes), default=0)


# Name -> (attribute of a `Landing`, quantity).
LANDING = {
    "e": ("restitution", "number"),
    "peak": ("peak", "number"),
    "contact": ("contact", "time"),
    "slip": ("slip", "length"),
    "penetration": ("penetration", "length"),
    "bouncing": ("bouncing", "number"),
}
# Name -> quantity, of each foot of a recorded motion.
TRAJECTORY = {"outside": "number", "normal": "speed", "slide": "speed"}
# Words for a number that is NaN, by its name: what is missing there.
_MISSING = {
    "e": "unknown, without a speed",
    "peak": "without a force: impacts are impulses",
    "contact": "without a foot that touched",
    "slip": "without a foot that touched",
    "penetration": "without a foot that touched",
    "outside": "without a band that hcbench wrote",
    "normal": "unknown, without a speed",
    "slide": "unknown, without a speed",
}
_LIMIT = re.compile(r"\s*(?P<name>[a-z]+)\s*(?P<way>[<>])=?\s*(?P<value>.+?)\s*")


@dataclass(frozen=True, slots=True)
class Limit:
    """One bound of a measured number.

    most: whether `value` (SI) is the largest allowed; else the smallest.
    text: as given.
    """

    name: str
    value: float
    most: bool
    text: str

    def excess(self, value: float) -> float:
        """Share of the bound by which a value is beyond it; above 0 where it is exceeded, inf for
        NaN.

        value: SI. Of a bound of 0 the excess itself, SI.
        """
        if math.isnan(value):
            return math.inf
        beyond = value - self.value if self.most else self.value - value
        return beyond / (abs(self.value) or 1.0)


def read_limits(text: str, of_landing: bool) -> tuple[Limit, ...]:
    """Limits of a text such as "e < 0.3, slip < 5 mm", separated by commas; values in SI or with a
    unit.

    of_landing: whether they are on landings; else on the feet of a recorded motion.
    Raises UserError for a name that has no limit, QuantityError for a value that is not such a
    quantity. Only plain numbers may be in per cent: "5 %" is 0.05.
    """
    if of_landing:
        quantities = {name: quantity for name, (_, quantity) in LANDING.items()}
        example = "e < 0.3, slip < 5 mm"
    else:
        quantities = TRAJECTORY
        example = "outside < 5 %"
    limits = []
    for part in text.split(","):
        match = _LIMIT.fullmatch(part)
        if match is None or match["name"] not in quantities:
            expected = f"limits on {', '.join(quantities)}, such as {example!r}"
            raise UserError("require", repr(sanitized(part.strip(), 40)), expected)
        name = match["name"]
        value = match["value"]
        slot = f"require: {name}"
        if value.endswith("%") and quantities[name] == "number":
            number = units.parse(value.removesuffix("%").rstrip(), "number", slot) / 100
        else:
            number = units.parse(value, quantities[name], slot)
        words = " ".join(part.split())
        limits.append(Limit(name, number, match["way"] == "<", words))
    return tuple(limits)


def judge_landings(landings: Landings, limits: Sequence[Limit]) -> tuple[Verdict, str]:
    """The verdict on all limits in each drop, at each place of its touch in a step, and a message
    that names the worst.

    limits: on quantities of a landing, by the names of LANDING; SI. A number that is NaN exceeds
    any limit.
    """
    values = []
    for limit in limits:
        attribute, _ = LANDING[limit.name]
        for drop in landings.drops:
            where = f"a drop of {drop.height:.4g} m{_tilt(drop.tilt)}"
            values += [(limit, value, where) for value in drop.over_phases(attribute)]
    return _judge(values, f"{len(landings.drops)} drops")


def judge_touchdowns(motion: TrajectoryTouchdowns, limits: Sequence[Limit]) -> tuple[Verdict, str]:
    """The verdict on all limits in each foot, and a message that names the worst.

    motion: touchdowns of a recorded motion.
    limits: on "outside", the share of touchdowns outside the band of speeds, on "normal" or on
    "slide", the largest speeds, m/s.
    FAILED where no foot touched down. Without a band, a limit on "outside" is exceeded.
    """
    values = []
    count = 0
    for foot in motion.feet:
        count += len(foot.time)
        where = f"{foot.part} on {foot.other}"
        numbers = {
            "outside": foot.outside,
            "normal": foot.speed.max(),
            "slide": foot.slide.max(),
        }
        values += [(limit, float(numbers[limit.name]), where) for limit in limits]
    return _judge(values, f"{count} touchdowns")


def _tilt(tilt: float) -> str:
    return f" at {math.degrees(tilt):.3g} deg" if tilt else ""


def _judge(values: Sequence[tuple[Limit, float, str]], count: str) -> tuple[Verdict, str]:
    """The verdict, and the worst value in words; FAILED without any value.

    values: (limit, value in SI, where it was found).
    count: of what was looked at, in words.
    """
    if not values:
        return Verdict.FAILED, f"nothing that a limit could hold of: {count}"
    excesses = [limit.excess(value) for limit, value, _ in values]
    exceeded = sum(excess > 0 for excess in excesses)
    limit, value, where = values[excesses.index(max(excesses))]
    verdict = Verdict.FAILED if exceeded else Verdict.PASSED
    value_text = f"{value:.4g} (SI)"
    if math.isnan(value):
        value_text = _MISSING[limit.name]
    more = ""
    if exceeded > 1:
        more = f"; {exceeded} limits exceeded in {count}"
    return verdict, f"{limit.name} {value_text}, limit {limit.text!r}, in {sanitized(where)}{more}"
