"""Small results, and the settings in them, for the tests of pages."""

from __future__ import annotations

import dataclasses

import pandas as pd
from small_results import ALPHAS, SCENE

from hcbench.benchmark.results import REST_COLUMNS, ImpactTable, Results
from hcbench.reporting.view import RunKey

LAW = RunKey("explicit", "law", 1e-6)


SPRING = RunKey("explicit", "spring-damper", 1e-6)


IMPULSE = RunKey("single", "impulse", 1e-3)


STOCK = RunKey("single", "stock", 2e-3)


def dropped(results: Results, gravity: float, **rests: tuple[float, float]) -> Results:
    """The same results as if they had been measured under gravity; rests:
    depth and motion, m, by setting.
    """

    def heavy(table: pd.DataFrame) -> pd.DataFrame:
        return table.assign(gravity_m_per_s2=gravity)

    rows = []
    for run in (LAW, SPRING, IMPULSE, STOCK):
        rest = rests.get(run.setting.replace("-", "_"), (1e-9, 0.0))
        rows.append((SCENE, gravity, 0.0, 0.0, *run[:2], ALPHAS[1], run.timestep, 6.0, *rest))
    return dataclasses.replace(
        results,
        settings=[{**record, "gravity_m_per_s2": gravity} for record in results.settings],
        table=ImpactTable.of(heavy(results.impacts).assign(penetration_max_m=1e-7), results.study),
        loops=heavy(results.loops).iloc[:0],
        scores=heavy(results.scores),
        rests=pd.DataFrame(rows, columns=REST_COLUMNS),
    )
