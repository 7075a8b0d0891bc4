"""Runs checks, one after the other, each in a process that may crash, hang or run out of memory."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

from hcbench._text import sanitized
from hcbench.check.model import Check, Outcome, Report, Row, Verdict
from hcbench.errors import HcbenchError, UserError
from hcbench.impact import Status
from hcbench.measure.measure import Job, measure_job
from hcbench.measure.measurement import TOLERANCE

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.impact import Impact
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.measure.measurement import Measurement


def run_checks(checks: Sequence[Check], progress: Callable[[int, int], None] | None = None) -> Report:
    """All of them; whatever one of them does, the others still run.

    progress: called with (done, in all).
    """
    outcomes = []
    for i, check in enumerate(checks):
        outcomes.append(run_check(check))
        if progress is not None:
            progress(i + 1, len(checks))
    return Report(tuple(outcomes))


def run_check(check: Check) -> Outcome:
    """One check; errors come back as outcomes."""
    try:
        return judge(check, _measured(check))
    except UserError as error:
        return Outcome(check.name, Verdict.MISTAKE, sanitized(error), _against(check), _limit(check))
    except HcbenchError as error:
        return Outcome(check.name, Verdict.COULD_NOT_RUN, sanitized(error), _against(check), _limit(check))
    except Exception as error:
        words = f"unexpected {type(error).__name__}: {sanitized(error)}"
        return Outcome(check.name, Verdict.COULD_NOT_RUN, words, _against(check), _limit(check))


def _measured(check: Check) -> Measurement:
    wanted = check.wanted
    tolerance = min(check.max_error, TOLERANCE) if wanted is not None else TOLERANCE
    request = check.request
    if check.baseline is not None:
        height = check.baseline.impacts[0][0].height
        request = dataclasses.replace(
            request, speeds=check.baseline.speeds, height=height, skip_redundant_phases=False
        )
    job = Job(check.source, check.engine, request, wanted, tolerance, diagnose=True)
    return measure_job(job, check.limit)


def judge(check: Check, found: Measurement) -> Outcome:
    """Hold a measurement against what the check says. Raises UserError for a baseline of another engine."""
    expected = _expectation(check, found)
    rows = tuple(_row(found, speed, expected) for speed in found.request.speeds)
    worst = max(rows, key=lambda row: -1.0 if math.isnan(row.error) else abs(row.error), default=None)
    verdict, message = _verdict(check, found, rows, worst)
    return Outcome(check.name, verdict, message, _against(check), _limit(check), rows, worst, found)


def _against(check: Check) -> str:
    if check.baseline is not None:
        return f"the baseline of {check.baseline.engine} {check.baseline.version}"
    return check.wanted.description if check.wanted is not None else "nothing: measured only"


def _limit(check: Check) -> float:
    """Largest error allowed; NaN where there is nothing to err against."""
    return math.nan if check.wanted is None and check.baseline is None else check.max_error


def _expectation(check: Check, found: Measurement) -> Callable[[Impact], float]:
    if check.baseline is not None:
        return _of_baseline(check, found)
    if check.wanted is None:
        return lambda _: math.nan
    wanted: RestitutionCurve = check.wanted
    return lambda impact: float(wanted.at(impact.speed_in))


def _of_baseline(check: Check, found: Measurement) -> Callable[[Impact], float]:
    baseline = check.baseline
    assert baseline is not None
    if baseline.engine != found.facts.engine:
        raise UserError(
            "baseline",
            f"written with {baseline.engine}, and the model runs in {found.facts.engine}",
            "the same engine",
            "Write a baseline of its own for each engine",
        )
    known = {launch: e for launch, _, e in baseline.impacts}
    return lambda impact: known.get(impact.launch, math.nan)


def _row(found: Measurement, speed: float, expected: Callable[[Impact], float]) -> Row:
    point = next(p for p in found.curve if p.speed == speed)
    mine = [i for i in found.measured if i.launch.speed == speed]
    pairs = [(i.restitution, expected(i)) for i in mine]
    errors = [(e - want, want) for e, want in pairs if not math.isnan(want)]
    error, want = max(errors, key=lambda pair: abs(pair[0]), default=(math.nan, math.nan))
    return Row(
        speed, point.speed_in, point.restitution, point.lowest, point.highest, want, error, point.failed
    )


def _verdict(check: Check, found: Measurement, rows: Sequence[Row], worst: Row | None) -> tuple[Verdict, str]:
    if (crashed := [i for i in found.failed if i.status is Status.CRASHED]) and not found.measured:
        return Verdict.COULD_NOT_RUN, f"no impact ended: {sanitized(crashed[0].reason)}"
    lost = _lost(check, found)
    if lost:
        return Verdict.FAILED, lost
    if worst is None or math.isnan(worst.error):
        if check.wanted is None and check.baseline is None:
            return Verdict.MEASURED, f"at {len(rows)} speeds, and held against nothing: no verdict"
        return Verdict.FAILED, "nothing was measured that could be held against it"
    where = f"largest error {worst.error:+.3g} at {worst.speed_in:.4g} m/s"
    if abs(worst.error) > check.max_error:
        return Verdict.FAILED, f"{where}, limit {check.max_error:g}{_versions(check, found)}"
    return Verdict.PASSED, f"{where}, limit {check.max_error:g}"


def _lost(check: Check, found: Measurement) -> str:
    """Impacts that have no e now, unless they had none in the baseline."""
    known = {launch: status for launch, status, _ in check.baseline.impacts} if check.baseline else {}
    new = [i for i in found.failed if known.get(i.launch) != i.status.value]
    if not new:
        return ""
    first = new[0]
    where = f"{first.launch.speed:.4g} m/s, phase {first.launch.phase:.3g}"
    return (
        f"{len(new)} of {len(found.impacts)} impacts have no restitution: {first.status.value} at {where}: "
        f"{sanitized(first.reason)}"
    )


def _versions(check: Check, found: Measurement) -> str:
    """What has changed since the baseline, apart from the bounce."""
    baseline, facts = check.baseline, found.facts
    if baseline is None:
        return ""
    changed = []
    if baseline.version != facts.version:
        changed.append(f"{facts.engine} was {baseline.version}, is {facts.version}")
    if baseline.timestep != facts.timestep:
        changed.append(f"the step was {baseline.timestep:g} s, is {facts.timestep:g} s")
    return f" ({'; '.join(changed)})" if changed else ""
