"""Runs checks, each in a process that may crash, hang or run out of memory, and judges what they measure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench._text import sanitized, time_step
from hcbench.benchmark.results import CONDITIONS, RUN_KEY, Results
from hcbench.checking.limits import judge_landings, judge_touchdowns
from hcbench.checking.outcome import Outcome, Report, Verdict
from hcbench.errors import HcbenchError, UserError
from hcbench.impact import Impact, Status
from hcbench.laws.restitution import Reading, Restitution
from hcbench.measuring.curve import Curve, CurvePoint, curve_of, curve_of_columns, worst_of
from hcbench.measuring.landing import land_job
from hcbench.measuring.measure import Job, measure_job
from hcbench.measuring.measurement import TOLERANCE, Measurement
from hcbench.measuring.trajectory import touchdowns_job

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import pandas as pd

    from hcbench.checking.spec import Check

_NO_END = (Status.CRASHED, Status.UNFINISHED)


def run_checks(checks: Sequence[Check], progress: Callable[[int, int], None] | None = None) -> Report:
    """Run all checks; the others still run after one fails.

    progress: called with (done, in all).
    """
    outcomes = []
    for i, check in enumerate(checks, 1):
        outcomes.append(run_check(check))
        if progress is not None:
            progress(i, len(checks))
    return Report(tuple(outcomes))


def run_check(check: Check) -> Outcome:
    """One check; errors come back as outcomes."""
    try:
        return _judge_limits(check) if check.limits else judge(check, _measure(check))
    except UserError as error:
        verdict, message = Verdict.MISTAKE, str(error)
    except HcbenchError as error:
        verdict, message = Verdict.COULD_NOT_RUN, str(error)
    except Exception as error:
        verdict = Verdict.COULD_NOT_RUN
        message = f"unexpected {type(error).__name__}: {sanitized(error)}"
    return Outcome(check.name, verdict, message, check.against, check.allowed)


def _judge_limits(check: Check) -> Outcome:
    """A robot's landings, or its recorded motion, held to limits."""
    job = Job(check.source, check.engine, check.request, None, TOLERANCE, diagnose=False)
    if check.drops is not None:
        verdict, message = judge_landings(land_job(job, check.drops, check.limit), check.limits)
    else:
        verdict, message = judge_touchdowns(touchdowns_job(job, check.trajectory, check.limit), check.limits)
    return Outcome(check.name, verdict, message, check.against)


def _measure(check: Check) -> Measurement:
    tolerance = TOLERANCE if check.wanted is None else min(check.max_error, TOLERANCE)
    bounces = check.wanted is not None or check.baseline is not None or check.rest is None
    what = (check.source, check.engine, check.request, check.wanted, tolerance)
    job = Job(*what, diagnose=bounces, rest=check.rest)
    return measure_job(job, check.limit)


def judge(check: Check, measurement: Measurement) -> Outcome:
    """Hold a measurement against what the check says. Raises UserError for a baseline of another engine."""
    wanted = _wanted(check, measurement)
    rows = curve_of(measurement.impacts, wanted)
    verdict, message = _with_rest(check, measurement, *_verdict(check, measurement, rows))
    worst = worst_of(rows) or rows[0]
    return Outcome(
        check.name, verdict, message, _against(check, rows), check.allowed, rows, worst, measurement
    )


def _against(check: Check, rows: Sequence[CurvePoint]) -> str:
    """The target in words; of an uncertain α, how wrong it lets e be."""
    speeds = np.array([row.speed_in for row in rows if not math.isnan(row.speed_in)])
    if not isinstance(check.wanted, Restitution) or not check.wanted.uncertainty or not speeds.size:
        return check.against
    margin = check.wanted.margin(speeds)
    tight = ": more than the limit, so a failure may be the measurement's" if margin > check.max_error else ""
    return f"{check.against}, by which e is known to ± {margin:.2g} (95 %){tight}"


def _wanted(check: Check, measurement: Measurement) -> Callable[[Impact], float]:
    """e wanted of an impact; NaN where it is held against nothing."""
    curve, baseline, engine = check.wanted, check.baseline, measurement.facts.engine
    if baseline is None:
        return lambda impact: math.nan if curve is None else float(curve.at(impact.speed_in))
    if baseline.engine != engine:
        raise UserError(
            "baseline",
            f"written with {baseline.engine}, and the model runs in {engine}",
            "the same engine",
            "Write a baseline of its own for each engine",
        )
    before = baseline.by_launch
    return lambda impact: before[impact.launch].restitution if impact.launch in before else math.nan


def _verdict(check: Check, measurement: Measurement, rows: Sequence[CurvePoint]) -> tuple[Verdict, str]:
    endless = [impact for impact in measurement.failed if impact.status in _NO_END]
    if endless and not measurement.measured:
        return Verdict.COULD_NOT_RUN, f"no impact ended: {sanitized(endless[0].reason)}"
    failed = _newly_failed(check, measurement)
    if failed:
        first, share = failed[0], f"{len(failed)} of {len(measurement.impacts)} impacts"
        where = f"{first.launch.speed:.4g} m/s, phase {first.launch.phase:.3g}"
        why = f"{first.status.value} at {where}: {sanitized(first.reason)}"
        return Verdict.FAILED, f"{share} have no restitution: {why}"
    worst = worst_of(rows)
    if worst is not None:
        verdict, message = _within(worst, check.max_error)
        return verdict, message + (_changes(check, measurement) if verdict is Verdict.FAILED else "")
    if check.wanted is None and check.baseline is None:
        return Verdict.MEASURED, f"at {len(rows)} speeds, and held against nothing: no verdict"
    return Verdict.FAILED, "nothing was measured that could be held against it"


def _with_rest(check: Check, measurement: Measurement, verdict: Verdict, message: str) -> tuple[Verdict, str]:
    """A verdict on the bounce, and on the pair at rest where that has limits."""
    if check.rest is None or verdict is Verdict.COULD_NOT_RUN:
        return verdict, message
    bounced = [] if verdict is Verdict.MEASURED else [message]
    if measurement.rest is None:
        return Verdict.FAILED, "; ".join([*bounced, "nothing holds the two together at rest"])
    beyond = check.rest.beyond(measurement.rest)
    if not beyond:
        passed = Verdict.PASSED if verdict is Verdict.MEASURED else verdict
        return passed, "; ".join([*bounced, f"at rest {measurement.rest.text}"])
    units = {"penetration": (1e-3, "mm"), "vibration": (1.0, "m/s")}
    words = [
        f"{name} at rest {value / si:.3g} {unit}, limit {most / si:g} {unit}"
        for name, (value, most) in beyond.items()
        for si, unit in [units[name]]
    ]
    return Verdict.FAILED, "; ".join([*bounced, *words])


def _within(worst: CurvePoint, max_error: float) -> tuple[Verdict, str]:
    message = f"largest error {worst.worst_phase:+.3g} at {worst.place}, limit {max_error:g}"
    return Verdict.FAILED if abs(worst.worst_phase) > max_error else Verdict.PASSED, message


def _newly_failed(check: Check, measurement: Measurement) -> list[Impact]:
    """Impacts that have no e now, unless they ended the same way in the baseline."""
    before = {} if check.baseline is None else {i.launch: i.status for i in check.baseline.impacts}
    return [impact for impact in measurement.failed if before.get(impact.launch) != impact.status]


def _changes(check: Check, measurement: Measurement) -> str:
    """Sentences on what has changed since the baseline, apart from the bounce."""
    baseline, facts = check.baseline, measurement.facts
    if baseline is None:
        return ""
    changes = []
    if baseline.version != facts.version:
        changes.append(f"{facts.engine} was {baseline.version}, is {facts.version}")
    if baseline.timestep_s != facts.timestep:
        changes.append(f"the step was {time_step(baseline.timestep_s)} s, is {time_step(facts.timestep)} s")
    return f" ({'; '.join(changes)})" if changes else ""


def judge_results(results: Results, max_error: float, reading: Reading = "law") -> Report:
    """Hold what a study found to a limit: each setting, α and step against its own law.

    reading: "law" for e of eq. (16), "linear" for 1 - α v.
    """
    keys = results.table.folded
    return Report(tuple(_judge_run(key, results.table.rows([key]), max_error, reading) for key in keys))


def _conditions(run: Mapping[str, Any]) -> str:
    """Gravity and other conditions of a setting, as a phrase; "" where there are none."""
    words = ("gravity {:g} m/s^2", "{:g} m off the axis", "friction {:g}")
    return "".join(
        f", {text.format(run[key])}" for key, text in zip(CONDITIONS, words, strict=True) if run[key]
    )


def _judge_run(key: Any, impacts: pd.DataFrame, max_error: float, reading: Reading) -> Outcome:
    run = dict(zip(RUN_KEY, key, strict=True))
    alpha, where = run["alpha_s_per_m"], _conditions(run)
    named = f"{run['scene']} {run['engine']} {run['setting']}"
    name = f"{named} α = {alpha:.4g} s/m, step {run['timestep_s']:g} s{where}"
    against = Restitution(alpha, reading).description
    rows = _rows(impacts, reading)
    failed, worst = sum(row.failed for row in rows), worst_of(rows)
    if failed or worst is None:
        verdict = Verdict.FAILED
        message = f"{failed} of {len(impacts)} impacts have no restitution"
    else:
        verdict, message = _within(worst, max_error)
    return Outcome(name, verdict, message, against, max_error, rows, worst)


def _rows(impacts: pd.DataFrame, reading: Reading) -> Curve:
    """One point for each speed and angle of a study's impacts, in their order."""
    place = ["speed_m_per_s", *(["angle_rad"] if "angle_rad" in impacts else [])]
    return curve_of_columns(
        np.asarray(impacts.groupby(place, sort=False).ngroup(), dtype=np.int64),
        speed=impacts["speed_m_per_s"].to_numpy(float),
        angle=impacts["angle_rad"].to_numpy(float) if len(place) > 1 else np.zeros(len(impacts)),
        phase=impacts["phase"].to_numpy(float),
        speed_in=impacts["speed_in_m_per_s"].to_numpy(float),
        restitution=impacts["restitution"].to_numpy(float),
        target=impacts[f"restitution_{reading}"].to_numpy(float),
        samples=impacts["samples"].to_numpy(int),
    )
