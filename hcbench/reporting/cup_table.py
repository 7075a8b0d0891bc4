"""The same settings on the axis of the cup, off it, and on the
equivalent flat plate: differences of e.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from hcbench.benchmark.results import RUN_KEY, Key, Results
from hcbench.reporting import wording
from hcbench.reporting.conditions import Views

if TYPE_CHECKING:
    import pandas as pd

_RUN = ["gravity_m_per_s2", "engine", "setting", "timestep_s"]
_SCENE = RUN_KEY.index("scene")
_OFF_AXIS = RUN_KEY.index("off_axis_m")
_LAUNCH = ["speed_m_per_s", "phase"]


def rows(by_gravity: Views, results: Results) -> list[dict[str, Any]]:
    """Runs of the main α at several places: the largest error of e on the cup's axis, and at each
    other place the largest difference of e from there, launch by launch.
    """
    study = results.study
    view = by_gravity.main
    if study["form"] != "cup":
        return []
    shown = []
    for run, keys in _keys_by_run(results, view.main_alpha).items():
        if all(key[_SCENE] == study["scene"] and key[_OFF_AXIS] == 0.0 for key in keys):
            continue
        gravity = run[_RUN.index("gravity_m_per_s2")]
        group = results.table.rows(keys)
        in_cup = group["scene"] == study["scene"]
        on_axis = group["off_axis_m"] == 0.0
        by_launch = group.set_index(_LAUNCH)["restitution"]
        axis = by_launch[(in_cup & on_axis).to_numpy()]
        off_axis = by_launch[(in_cup & ~on_axis).to_numpy()]
        flat = by_launch[(~in_cup).to_numpy()]
        if len(axis) and (len(off_axis) or len(flat)):
            shown.append(
                {
                    "run": view.run_of({**group.iloc[0].to_dict(), "scene": study["scene"]}),
                    "dropped": float(gravity) > 0,
                    "error": _error(group[in_cup & on_axis]),
                    "off_axis": _difference(axis, off_axis),
                    "flat": _difference(axis, flat),
                }
            )
    return shown


def _keys_by_run(results: Results, alpha: float) -> dict[tuple[Any, ...], list[Key]]:
    """Values of _RUN -> keys of its impacts without friction, for one α (s/m), at every place."""
    runs: dict[tuple[Any, ...], list[Key]] = {}
    for key in results.table.folded:
        values = dict(zip(RUN_KEY, key, strict=True))
        if values["friction"] == 0.0 and math.isclose(values["alpha_s_per_m"], alpha, rel_tol=1e-9):
            run = tuple(values[name] for name in _RUN)
            runs.setdefault(run, []).append(key)
    return runs


def _error(rows: pd.DataFrame) -> str:
    return wording.error(float((rows["restitution"] - rows["restitution_law"]).abs().max()))


def _difference(axis: pd.Series, other: pd.Series) -> str:
    """Largest difference of e between launches made at both places; "–" where there are none."""
    return wording.error(float((other - axis).dropna().abs().max())) if len(other) else "–"
