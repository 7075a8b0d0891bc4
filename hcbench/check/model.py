"""What a check is and what comes of it: frozen records."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from hcbench.errors import CannotRun, LimitPassed, UserError

if TYPE_CHECKING:
    from pathlib import Path

    from hcbench.check.baseline import Baseline
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.measure.measurement import Measurement
    from hcbench.sim.model_under_test import Request

MAX_ERROR = 0.02
MAX_DRIFT = 1e-4  # of e from a baseline: far above rounding, far below what anybody sees


class Verdict(StrEnum):
    """How a check ended."""

    PASSED = "passed"
    MEASURED = "measured"  # and held against nothing
    FAILED = "failed"  # a limit was passed
    MISTAKE = "mistake"  # something to correct in what was asked
    COULD_NOT_RUN = "could not run"


EXIT_CODES = {
    Verdict.PASSED: 0,
    Verdict.MEASURED: 0,
    Verdict.FAILED: LimitPassed.exit_code,
    Verdict.MISTAKE: UserError.exit_code,
    Verdict.COULD_NOT_RUN: CannotRun.exit_code,
}


@dataclass(frozen=True, slots=True)
class Check:
    """One model held against one thing: `wanted` or `baseline`; neither: only measured, for a new baseline.

    source: as in `measure`.
    max_error: largest |e - wanted| allowed at any speed and phase. limit: s, after which it counts as hung.
    """

    name: str
    source: Any
    request: Request
    wanted: RestitutionCurve | None = None
    baseline: Baseline | None = None
    max_error: float = MAX_ERROR
    engine: str | None = None
    limit: float = 60.0


@dataclass(frozen=True, slots=True)
class Row:
    """All phases of one launch speed. error: the largest e - wanted, with its sign; NaN without one."""

    speed: float
    speed_in: float
    restitution: float
    lowest: float
    highest: float
    wanted: float
    error: float
    failed: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one check.

    against: what it was held against, in words. message: one line. worst: the row that decides.
    """

    name: str
    verdict: Verdict
    message: str
    against: str = ""
    max_error: float = math.nan
    rows: tuple[Row, ...] = ()
    worst: Row | None = None
    found: Measurement | None = None

    @property
    def exit_code(self) -> int:
        """Of this check alone."""
        return EXIT_CODES[self.verdict]


@dataclass(frozen=True, slots=True)
class Report:
    """All checks of a run, in the order asked for."""

    outcomes: tuple[Outcome, ...] = field(default=())

    @property
    def exit_code(self) -> int:
        """0 all within limits, 1 a limit passed, 2 a mistake, 3 something could not run: the gravest."""
        return max((outcome.exit_code for outcome in self.outcomes), default=0)


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where to write what; None: not at all."""

    junit: Path | None = None
    markdown: Path | None = None
    png: Path | None = None
    baseline: Path | None = None
