"""Runs checks, those of files each in a process that may crash, hang or run out of memory, and
judges what they measure.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.benchmark.results import CONDITIONS, RUN_KEY, Results
from hcbench.checking.outcome import Outcome, Report, Verdict, judge_landings, judge_touchdowns
from hcbench.laws.restitution import Reading, Restitution
from hcbench.measuring.curve import Curve, CurvePoint, curve_of, curve_of_columns, worst_of
from hcbench.measuring.landing import land_job, touchdowns_job, unresolved
from hcbench.measuring.measure import Job, measure_job
from hcbench.measuring.measurement import TOLERANCE, Measurement
from hcbench.system.errors import HcbenchError, UserError
from hcbench.system.text import sanitized, time_step
from hcbench.terms.impact import Impact, Launch, Status

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import pandas as pd

    from hcbench.checking.baseline import Baseline
    from hcbench.checking.spec import Check

_NO_END = (Status.CRASHED, Status.UNFINISHED)
# Name of a quantity at rest -> (size of the printed unit in SI, printed unit).
_REST_UNITS = {"penetration": (1e-3, "mm"), "vibration": (1.0, "m/s")}


def run_checks(
    checks: Sequence[Check], progress: Callable[[int, int], None] | None = None
) -> Report:
    """Run all checks, one after the other; the others still run after one fails.

    progress: called with (done, in all). Errors become outcomes; only an interruption is raised.
    """
    outcomes = []
    for i, check in enumerate(checks, 1):
        outcomes.append(run_check(check))
        if progress is not None:
            progress(i, len(checks))
    return Report(tuple(outcomes))


def run_check(check: Check) -> Outcome:
    """Run one check. Errors come back as outcomes: UserError as a mistake, all others as could not
    run.
    """
    try:
        if check.limits:
            return _judge_limits(check)
        return judge(check, _measure(check))
    except UserError as error:
        verdict = Verdict.MISTAKE
        message = str(error)
    except HcbenchError as error:
        verdict = Verdict.COULD_NOT_RUN
        message = str(error)
    except Exception as error:
        verdict = Verdict.COULD_NOT_RUN
        message = f"unexpected {type(error).__name__}: {sanitized(error)}"
    return Outcome(check.name, verdict, message, check.against, check.allowed)


def _judge_limits(check: Check) -> Outcome:
    """Verdict on a robot's landings, or on its recorded motion, held to limits.

    A step that does not resolve the landing fails, whatever the limits.
    Raises UserError for what cannot be dropped and for a motion that cannot be read, EngineFailed
    where the worker died or hung.
    """
    job = Job(check.source, check.engine, check.request, None, TOLERANCE, diagnose=False)
    if check.drops is not None:
        landings = land_job(job, check.drops, check.limit)
        verdict, message = judge_landings(landings, check.limits)
        if reasons := unresolved(landings):
            verdict, message = Verdict.FAILED, reasons[0]
    else:
        motion = touchdowns_job(job, check.trajectory, check.limit)
        verdict, message = judge_touchdowns(motion, check.limits)
    return Outcome(check.name, verdict, message, check.against)


def _measure(check: Check) -> Measurement:
    """Measure the pair of a check, and look for causes where its e is held against something.

    A file is measured in a worker process, within the check's limit; a model object in this one,
    without a limit.
    Raises UserError for a pair that cannot be measured, EngineFailed for an engine that crashed or
    took longer.
    """
    tolerance = TOLERANCE
    if check.wanted is not None:
        tolerance = min(check.max_error, TOLERANCE)
    # Causes of a wrong e are of use only where e is held against something, or nothing else is.
    is_of_e = check.wanted is not None or check.baseline is not None or check.rest is None
    job = Job(
        check.source,
        check.engine,
        check.request,
        check.wanted,
        tolerance,
        diagnose=is_of_e,
        rest=check.rest,
    )
    return measure_job(job, check.limit)


def judge(check: Check, measurement: Measurement) -> Outcome:
    """The outcome of a check: its measurement held to the target e, to a baseline, or to nothing;
    then to the limits at rest.

    The verdict is on the phase with the largest error of e, at any speed.
    Raises UserError for a baseline of another engine.
    """
    wanted = _wanted(check, measurement)
    rows = curve_of(measurement.impacts, wanted)
    verdict, message = _verdict(check, measurement, rows)
    verdict, message = _with_rest(check, measurement, verdict, message)
    return Outcome(
        name=check.name,
        verdict=verdict,
        message=message,
        against=_against(check, rows),
        max_error=check.allowed,
        rows=rows,
        worst=worst_of(rows) or rows[0],
        measurement=measurement,
    )


def _against(check: Check, rows: Sequence[CurvePoint]) -> str:
    """The target in words. An uncertain α is named with the error of e that it allows.

    rows: points of the measured curve; that error is the largest at their impact speeds, m/s.
    """
    wanted = check.wanted
    speeds = np.array([row.speed_in for row in rows if not math.isnan(row.speed_in)])
    if not isinstance(wanted, Restitution) or not wanted.uncertainty or not speeds.size:
        return check.against
    margin = wanted.margin(speeds)
    tight = ""
    if margin > check.max_error:
        tight = ": more than the limit, so a failure may be the measurement's"
    return f"{check.against}, by which e is known to ± {margin:.2g} (95 %){tight}"


def _wanted(check: Check, measurement: Measurement) -> Callable[[Impact], float]:
    """Function that gives the target e of an impact; NaN for one that is held against nothing.

    check: has a curve over speed, a baseline, or neither.
    Raises UserError for a baseline of another engine.
    """
    if check.baseline is not None:
        return _wanted_of_baseline(check.baseline, measurement.facts.engine)
    curve = check.wanted
    if curve is None:
        return lambda _: math.nan
    return lambda impact: float(curve.at(impact.speed_in))


def _wanted_of_baseline(baseline: Baseline, engine: str) -> Callable[[Impact], float]:
    """Function of an impact: e of the same launch in a baseline; NaN for launches that it has not.

    engine: that the model runs in.
    Raises UserError for a baseline of another engine.
    """
    if baseline.engine != engine:
        raise UserError(
            "baseline",
            f"written with {baseline.engine}, and the model runs in {engine}",
            "the same engine",
            "Write a baseline of its own for each engine",
        )
    before = baseline.by_launch

    def wanted(impact: Impact) -> float:
        then = before.get(impact.launch)
        return math.nan if then is None else then.restitution

    return wanted


def _verdict(
    check: Check, measurement: Measurement, rows: Sequence[CurvePoint]
) -> tuple[Verdict, str]:
    """The verdict on the bounce alone, and the sentence that says why.

    rows: points of the measured curve. Impacts without an e fail it, unless they ended in the same
    way in the baseline; else the largest error of e decides. COULD_NOT_RUN where none has an e and
    one crashed or did not end; MEASURED for a check without a target.
    """
    endless = [impact for impact in measurement.failed if impact.status in _NO_END]
    if endless and not measurement.measured:
        return Verdict.COULD_NOT_RUN, f"no impact ended: {sanitized(endless[0].reason)}"
    failed = _newly_failed(check, measurement)
    if failed:
        first = failed[0]
        share = f"{len(failed)} of {len(measurement.impacts)} impacts"
        where = f"{first.launch.speed:.4g} m/s, phase {first.launch.phase:.3g}"
        why = f"{first.status.value} at {where}: {sanitized(first.reason)}"
        return Verdict.FAILED, f"{share} have no restitution: {why}"
    worst = worst_of(rows)
    if worst is not None:
        verdict, message = _within(worst, check.max_error)
        if verdict is Verdict.FAILED:
            message += _changes(check, measurement)
        return verdict, message
    if check.wanted is None and check.baseline is None:
        return Verdict.MEASURED, f"at {len(rows)} speeds, and held against nothing: no verdict"
    return Verdict.FAILED, "nothing was measured that could be held against it"


def _with_rest(
    check: Check, measurement: Measurement, verdict: Verdict, message: str
) -> tuple[Verdict, str]:
    """The verdict on the bounce joined with that on the pair at rest, where that has limits.

    verdict, message: on the bounce; MEASURED becomes PASSED where only the rest has limits.
    """
    if check.rest is None or verdict is Verdict.COULD_NOT_RUN:
        return verdict, message
    sentences = []
    if verdict is not Verdict.MEASURED:
        sentences.append(message)
    if measurement.rest is None:
        sentences.append("nothing holds the two together at rest")
        return Verdict.FAILED, "; ".join(sentences)
    beyond = check.rest.beyond(measurement.rest)
    if not beyond:
        sentences.append(f"at rest {measurement.rest.text}")
        passed = Verdict.PASSED if verdict is Verdict.MEASURED else verdict
        return passed, "; ".join(sentences)
    for name, (value, most) in beyond.items():
        si, unit = _REST_UNITS[name]
        sentences.append(f"{name} at rest {value / si:.3g} {unit}, limit {most / si:g} {unit}")
    return Verdict.FAILED, "; ".join(sentences)


def _within(worst: CurvePoint, max_error: float) -> tuple[Verdict, str]:
    message = f"largest error {worst.worst_phase:+.3g} at {worst.place}, limit {max_error:g}"
    if abs(worst.worst_phase) > max_error:
        return Verdict.FAILED, message
    return Verdict.PASSED, message


def _newly_failed(check: Check, measurement: Measurement) -> list[Impact]:
    """Impacts that have no e now, unless they ended the same way in the baseline."""
    before: dict[Launch, Status] = {}
    if check.baseline is not None:
        before = {impact.launch: impact.status for impact in check.baseline.impacts}
    return [impact for impact in measurement.failed if before.get(impact.launch) != impact.status]


def _changes(check: Check, measurement: Measurement) -> str:
    """Words on how the engine's version and the time step differ from the baseline's, in brackets,
    to be appended; "" where they are the same.
    """
    baseline = check.baseline
    if baseline is None:
        return ""
    facts = measurement.facts
    changes = []
    if baseline.version != facts.version:
        changes.append(f"{facts.engine} was {baseline.version}, is {facts.version}")
    before, now = time_step(baseline.timestep_s), time_step(facts.timestep)
    # One that a float32 has rounded is the same.
    if before != now:
        changes.append(f"the step was {before} s, is {now} s")
    if not changes:
        return ""
    return f" ({'; '.join(changes)})"


def judge_results(results: Results, max_error: float, reading: Reading = "law") -> Report:
    """Hold what a study found to a limit: each setting, α and step against its own law.

    max_error: of e, at any phase.
    reading: "law" for e of eq. (16), "linear" for 1 - α v.
    """
    keys = results.table.folded
    return Report(
        tuple(_judge_run(key, results.table.rows([key]), max_error, reading) for key in keys)
    )


def _conditions(run: Mapping[str, Any]) -> str:
    """Gravity and other conditions of a setting, as a phrase; "" where there are none.

    run: values of a study's run by the keys of RUN_KEY, SI; one of 0 is left out.
    """
    texts = ("gravity {:g} m/s^2", "{:g} m off the axis", "friction {:g}")
    phrase = ""
    for name, text in zip(CONDITIONS, texts, strict=True):
        if run[name]:
            phrase += ", " + text.format(run[name])
    return phrase


def _judge_run(key: Any, impacts: pd.DataFrame, max_error: float, reading: Reading) -> Outcome:
    """The verdict on one setting, α and step of a study: FAILED where an impact has no e, or the
    largest error of e at any phase is above the limit.

    key: values of RUN_KEY.
    impacts: n rows of a study's table, SI.
    max_error: of e, the limit.
    reading: which law's e is the target.
    """
    run = dict(zip(RUN_KEY, key, strict=True))
    alpha = run["alpha_s_per_m"]
    setting = f"{run['scene']} {run['engine']} {run['setting']}"
    name = f"{setting} α = {alpha:.4g} s/m, step {run['timestep_s']:g} s{_conditions(run)}"
    against = Restitution(alpha, reading).description
    rows = _rows(impacts, reading)
    failed = sum(row.failed for row in rows)
    worst = worst_of(rows)
    if failed or worst is None:
        verdict = Verdict.FAILED
        message = f"{failed} of {len(impacts)} impacts have no restitution"
    else:
        verdict, message = _within(worst, max_error)
    return Outcome(
        name=name,
        verdict=verdict,
        message=message,
        against=against,
        max_error=max_error,
        rows=rows,
        worst=worst,
    )


def _rows(impacts: pd.DataFrame, reading: Reading) -> Curve:
    """One point for each speed and angle of a study's impacts, in their order.

    impacts: n rows, with the columns of a study's table, SI.
    reading: which law's e is the target: that of the column restitution_law or restitution_linear.
    """
    place = ["speed_m_per_s"]
    angle = np.zeros(len(impacts))
    # Only studies with oblique launches have this column.
    if "angle_rad" in impacts:
        place.append("angle_rad")
        angle = impacts["angle_rad"].to_numpy(float)
    return curve_of_columns(
        np.asarray(impacts.groupby(place, sort=False).ngroup(), dtype=np.int64),
        speed=impacts["speed_m_per_s"].to_numpy(float),
        angle=angle,
        phase=impacts["phase"].to_numpy(float),
        speed_in=impacts["speed_in_m_per_s"].to_numpy(float),
        restitution=impacts["restitution"].to_numpy(float),
        target=impacts[f"restitution_{reading}"].to_numpy(float),
        samples=impacts["samples"].to_numpy(int),
    )
