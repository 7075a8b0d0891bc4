"""A study, or the folder of its report, as checks: each setting, α and step against its own law."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from hcbench.benchmark.results import RUN_KEY, Results
from hcbench.benchmark.run import run_study
from hcbench.benchmark.study import load_study
from hcbench.check.model import MAX_ERROR, Outcome, Report, Row, Verdict
from hcbench.impact import Status
from hcbench.laws.restitution import Restitution

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import pandas as pd

    from hcbench.laws.restitution import Reading

_GOOD = (Status.PARTED.value, Status.RESTED.value)


def check_study(
    path: Path,
    max_error: float = MAX_ERROR,
    reading: Reading = "law",
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Report:
    """Run a study and hold every row of its scores to one limit."""
    return check_results(run_study(load_study(path), jobs, progress), max_error, reading)


def check_results(results: Results, max_error: float = MAX_ERROR, reading: Reading = "law") -> Report:
    """Hold what a study found to a limit. reading: "law" for e of eq. (16), "linear" for 1 - α v."""
    groups = results.impacts.groupby(RUN_KEY, sort=False)
    return Report(tuple(_outcome(key, group, max_error, reading) for key, group in groups))


def _outcome(key: Any, impacts: pd.DataFrame, max_error: float, reading: Reading) -> Outcome:
    scene, engine, setting, alpha, timestep = key
    name = f"{scene} {engine} {setting} α = {alpha:.4g} s/m, step {timestep:g} s"
    against = Restitution(alpha, reading).description
    rows = tuple(
        _row(float(str(speed)), group, reading)
        for speed, group in impacts.groupby("speed_m_per_s", sort=False)
    )
    failed = sum(row.failed for row in rows)
    known = [row for row in rows if not math.isnan(row.error)]
    worst = max(known, key=lambda row: abs(row.error), default=None)
    if failed or worst is None:
        words = f"{failed} of {len(impacts)} impacts have no restitution"
        return Outcome(name, Verdict.FAILED, words, against, max_error, rows, worst)
    words = f"largest error {worst.error:+.3g} at {worst.speed_in:.4g} m/s, limit {max_error:g}"
    verdict = Verdict.PASSED if abs(worst.error) <= max_error else Verdict.FAILED
    return Outcome(name, verdict, words, against, max_error, rows, worst)


def _row(speed: float, impacts: pd.DataFrame, reading: Reading) -> Row:
    good = impacts[impacts["status"].isin(_GOOD)]
    if good.empty:
        nan = math.nan
        return Row(speed, nan, nan, nan, nan, nan, nan, len(impacts))
    e, want = good["restitution"].to_numpy(float), good[f"restitution_{reading}"].to_numpy(float)
    worst = int(abs(e - want).argmax())
    return Row(
        speed=speed,
        speed_in=float(good["speed_in_m_per_s"].mean()),
        restitution=float(e.mean()),
        lowest=float(e.min()),
        highest=float(e.max()),
        wanted=float(want[worst]),
        error=float(e[worst] - want[worst]),
        failed=len(impacts) - len(good),
    )
