"""Results of checks."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from hcbench._notebook import Shown
from hcbench._text import sanitized
from hcbench.errors import CannotRun, HcbenchError, LimitPassed, UserError
from hcbench.impact import Floats
from hcbench.measuring.measurement import Measurement


class Verdict(StrEnum):
    """How a check ended."""

    PASSED = "passed"
    MEASURED = "measured"  # and held against nothing
    FAILED = "failed"  # a limit was exceeded
    MISTAKE = "mistake"  # something to correct in what was asked
    COULD_NOT_RUN = "could not run"


_ERRORS: dict[Verdict, type[HcbenchError]] = {
    Verdict.FAILED: LimitPassed,
    Verdict.MISTAKE: UserError,
    Verdict.COULD_NOT_RUN: CannotRun,
}


@dataclass(frozen=True, slots=True)
class SpeedRow:
    """All phases of one launch speed and angle; speeds in m/s, NaN for what there is not.

    restitution: the mean. error: the largest e - target, with its sign. failed: impacts without e.
    angle: from the normal, rad; None where no launch is oblique.
    """

    speed: float
    speed_in: float
    restitution: float
    lowest: float
    highest: float
    target: float
    error: float
    failed: int
    angle: float | None = None

    @property
    def place(self) -> str:
        """Where on the curve it is, in words."""
        angle = "" if self.angle is None else f" and {math.degrees(self.angle):.4g} deg"
        return f"{self.speed_in:.4g} m/s{angle}"

    def record(self) -> dict[str, Any]:
        """The outcome as JSON has it."""
        record = asdict(self)
        return record if self.angle is not None else {k: v for k, v in record.items() if k != "angle"}


def speed_row(
    speed: float, speed_in: Floats, e: Floats, target: Floats, failed: int, angle: float | None = None
) -> SpeedRow:
    """The row of the impacts at one launch speed and angle. target: NaN where there is none."""
    if not e.size:
        return SpeedRow(speed, *(math.nan,) * 6, failed=failed, angle=angle)
    error = e - target
    worst = int(np.argmax(np.where(np.isnan(error), -1.0, np.abs(error))))
    return SpeedRow(
        speed=speed,
        speed_in=float(speed_in.mean()),
        restitution=float(e.mean()),
        lowest=float(e.min()),
        highest=float(e.max()),
        target=float(target[worst]),
        error=float(error[worst]),
        failed=failed,
        angle=angle,
    )


def worst_of(rows: Sequence[SpeedRow]) -> SpeedRow | None:
    """The row with the largest error; None where no row has one."""
    return max(
        (row for row in rows if not math.isnan(row.error)), key=lambda row: abs(row.error), default=None
    )


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of one check.

    against: what it was held against, in words. max_error: the limit; NaN where it was held against nothing.
    message: one line. worst: the row that decides.
    """

    name: str
    verdict: Verdict
    message: str
    against: str = ""
    max_error: float = math.nan
    rows: tuple[SpeedRow, ...] = ()
    worst: SpeedRow | None = None
    measurement: Measurement | None = None

    @property
    def line(self) -> str:
        """`PASSED name: message`."""
        return f"{self.verdict.value.upper()} {sanitized(self.name)}: {self.message}"

    @property
    def exit_code(self) -> int:
        """The exit code of this check alone."""
        return _ERRORS[self.verdict].exit_code if self.verdict in _ERRORS else 0


@dataclass(frozen=True, slots=True, repr=False)
class Report(Shown):
    """All checks of a run, in order."""

    outcomes: tuple[Outcome, ...] = ()

    def _lines(self) -> Iterator[str]:
        yield from (outcome.line for outcome in self.outcomes)

    def _rows(self) -> Iterator[dict[str, Any]]:
        for outcome in self.outcomes:
            for row in outcome.rows:
                yield {"check": outcome.name, "verdict": outcome.verdict.value, **row.record()}

    def raise_if_failed(self) -> None:
        """Raises LimitPassed where a limit was exceeded, UserError for a mistake, CannotRun for the rest."""
        for outcome in self.outcomes:
            if outcome.exit_code == self.exit_code != 0:
                raise _ERRORS[outcome.verdict](outcome.name, outcome.message, outcome.against or "a result")

    @property
    def exit_code(self) -> int:
        """0 all within limits, 1 a limit exceeded, 2 a mistake, 3 something could not run: the gravest."""
        return max((outcome.exit_code for outcome in self.outcomes), default=0)
