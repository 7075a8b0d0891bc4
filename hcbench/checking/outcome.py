"""Results of checks."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from hcbench.measuring.curve import CurvePoint
from hcbench.measuring.measurement import Measurement
from hcbench.system.errors import CannotRun, HcbenchError, LimitPassed, UserError
from hcbench.system.notebook import Shown
from hcbench.system.text import sanitized


class Verdict(StrEnum):
    """Result of a check."""

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


@dataclass(frozen=True, slots=True, repr=False)
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
        """Raises LimitPassed where a limit was exceeded, UserError for a mistake, CannotRun for the rest."""
        for outcome in self.outcomes:
            if outcome.exit_code == self.exit_code != 0:
                raise _ERRORS[outcome.verdict](outcome.name, outcome.message, outcome.against or "a result")

    @property
    def exit_code(self) -> int:
        """0 all within limits, 1 a limit exceeded, 2 a mistake, 3 something could not run: the gravest."""
        return max((outcome.exit_code for outcome in self.outcomes), default=0)
