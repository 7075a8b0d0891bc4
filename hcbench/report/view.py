"""What figures and tables ask of Results, answered once: curves, which runs cover a band, what is coarse."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
import pandas as pd

from hcbench.benchmark.results import RUN_KEY
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.report.style import Look, looks

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping

    from hcbench.benchmark.results import Results
    from hcbench.impact import Floats

REFERENCE = "reference"
TRUTH = "hunt-crossley"  # the reference's setting that is the law itself
BAND = 3  # speeds from which a run says something about e over speed
INSIDE = 10  # steps in the law's contact from which a step counts as fine: it sees the contact from inside


class Run(NamedTuple):
    """One setting of one engine at one step."""

    engine: str
    setting: str
    timestep: float


@dataclass(frozen=True, slots=True)
class Curve:
    """e over impact speed of one run for one α; arrays over speed, phases folded.

    speed: as measured, m/s. low, middle, high: least, median and largest e over the phases.
    error: largest |e - e of (16)| over the phases. loss: median of ½ m (v_i² - v_o²), J.
    """

    speed: Floats
    low: Floats
    middle: Floats
    high: Floats
    error: Floats
    loss: Floats


@dataclass(frozen=True)
class View:
    """Results as a report looks at them."""

    results: Results
    _curves: dict[tuple[Run, float], Curve] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        mass = float(self.study["mass_kg"])
        for key, rows in self.results.impacts.groupby(RUN_KEY, sort=False):
            run, alpha = _run_of(key)
            self._curves[run, alpha] = _curve(rows, mass)

    @property
    def study(self) -> Mapping[str, Any]:
        """The study, as JSON."""
        return self.results.study

    @cached_property
    def alphas(self) -> list[float]:
        """α of the study, s/m, rising."""
        return sorted(float(a) for a in self.study["alphas"])

    @property
    def main_alpha(self) -> float:
        """The α that figures of one α show, s/m."""
        return float(self.study["main_alpha"])

    def law(self, alpha: float) -> HuntCrossley:
        """(16) for one α."""
        return HuntCrossley(float(self.study["stiffness"]), alpha, float(self.study["exponent"]))

    def truth(self, alpha: float, speed: Floats) -> Floats:
        """e of (16)."""
        return np.asarray(closed_form.restitution(alpha, speed))

    @cached_property
    def contact_time(self) -> float:
        """How long the law's contact lasts at the study's speed for steps, s."""
        speed = float(self.study["step_speed"])
        return float(closed_form.duration(self.law(self.main_alpha), float(self.study["mass_kg"]), speed))

    @cached_property
    def speeds(self) -> Floats:
        """A fine grid over the study's band, m/s, from 0."""
        return np.linspace(0.0, max(self.study["speeds"]), 161)

    @property
    def band(self) -> Floats:
        """Ends of the study's band of impact speeds, m/s."""
        return np.array([min(self.study["speeds"]), max(self.study["speeds"])], dtype=float)

    @cached_property
    def looks(self) -> dict[tuple[str, str], Look]:
        """How each setting is drawn."""
        seen = [run for run, _ in self._curves] + list(self.trains)
        return looks(((run.engine, run.setting) for run in seen), law=REFERENCE)

    def look(self, run: Run) -> Look:
        """How a run is drawn."""
        return self.looks[run.engine, run.setting]

    def curve(self, run: Run, alpha: float) -> Curve | None:
        """e over speed; None where the study has no such run or no impact of it came back."""
        found = self._curves.get((run, alpha))
        return found if found is not None and found.speed.size else None

    @cached_property
    def tabled_runs(self) -> list[Run]:
        """Runs over enough speeds to show a curve, in the study's order."""
        enough = min(BAND, len(self.study["speeds"]))
        tried = self.results.impacts.groupby(RUN_KEY, sort=False)["speed_m_per_s"].nunique()
        return list(dict.fromkeys(_run_of(key)[0] for key, count in tried.items() if count >= enough))

    @cached_property
    def band_runs(self) -> list[Run]:
        """Those of them that figures show: the law itself is in every panel already."""
        return [run for run in self.tabled_runs if run[:2] != (REFERENCE, TRUTH)]

    @cached_property
    def engines(self) -> list[str]:
        """Engines of the band runs, in the study's order, the reference left out."""
        return list(dict.fromkeys(run.engine for run in self.band_runs if run.engine != REFERENCE))

    @cached_property
    def _plugins(self) -> set[Run]:
        return {
            Run(str(r["engine"]), str(r["setting"]), float(r["timestep_s"]))
            for r in self.results.settings
            if "law" in r["options"]
        }

    def is_plugin(self, run: Run) -> bool:
        """Does it need code of ours in the user's loop, rather than numbers in the user's model?"""
        return run in self._plugins

    def is_fine(self, run: Run) -> bool:
        """Does its step see the contact from inside?"""
        return run.timestep <= self.contact_time / INSIDE * (1 + 1e-9)

    def of_class(self, fine: bool) -> list[Run]:
        """Band runs with fine or coarse steps; of each setting the step that most settings share."""
        group = [run for run in self.band_runs if self.is_fine(run) == fine]
        return [run for run in group if run.timestep == self._shown_step(group, run)]

    @staticmethod
    def _shown_step(group: list[Run], run: Run) -> float:
        steps = [other.timestep for other in group]
        own = [o.timestep for o in group if (o.engine, o.setting) == (run.engine, run.setting)]
        common = max(sorted(set(steps)), key=steps.count)
        return min(own, key=lambda h: abs(np.log(h / common)))

    def step_curves(self) -> dict[tuple[str, str], pd.DataFrame]:
        """(engine, setting) -> table over rising step of e at the study's step speed for its main α.

        Columns: timestep, low, middle, high (NaN where no impact came back).
        """
        table = self.results.impacts
        here = table[
            np.isclose(table["speed_m_per_s"], self.study["step_speed"], rtol=1e-9)
            & np.isclose(table["alpha_s_per_m"], self.main_alpha, rtol=1e-9)
        ]
        out: dict[tuple[str, str], pd.DataFrame] = {}
        for key, rows in here.groupby(["engine", "setting"], sort=False):
            engine, setting = (str(part) for part in cast("tuple[Any, ...]", key))
            by_step = rows.groupby("timestep_s")["restitution"].agg(["min", "median", "max"])
            frame = by_step.reset_index()
            frame.columns = pd.Index(["timestep", "low", "middle", "high"])
            out[engine, setting] = frame
        return out

    def score(self, run: Run, alpha: float) -> Mapping[str, Any] | None:
        """The score of a run for one α."""
        return self._scores.get((run, alpha))

    @cached_property
    def _scores(self) -> dict[tuple[Run, float], Mapping[str, Any]]:
        out: dict[tuple[Run, float], Mapping[str, Any]] = {}
        for row in self.results.scores.to_dict("records"):
            key = _run_of(tuple(row[k] for k in RUN_KEY))
            # A study may run one setting twice, over the band and at one speed: the band tells more.
            if key not in out or row["impacts"] > out[key]["impacts"]:
                out[key] = {str(k): v for k, v in row.items()}
        return out

    @cached_property
    def loops(self) -> dict[Run, dict[float, pd.DataFrame]]:
        """Kept loops for the main α: run -> impact speed (m/s) -> samples in time order."""
        table = self.results.loops
        out: dict[Run, dict[float, pd.DataFrame]] = {}
        if table.empty:
            return out
        main = table[np.isclose(table["alpha_s_per_m"].astype(float), self.main_alpha, rtol=1e-9)]
        for key, rows in main.groupby(["engine", "setting", "timestep_s", "speed_m_per_s"], sort=False):
            engine, setting, step, speed = cast("tuple[Any, ...]", key)
            out.setdefault(Run(str(engine), str(setting), float(step)), {})[float(speed)] = rows
        return out

    @cached_property
    def trains(self) -> dict[Run, pd.DataFrame]:
        """Bounce trains for the main α: run -> heights in the order of the bounces."""
        table = self.results.trains
        main = table[np.isclose(table["alpha_s_per_m"].astype(float), self.main_alpha, rtol=1e-9)]
        out: dict[Run, pd.DataFrame] = {}
        for key, rows in main.groupby(["engine", "setting", "timestep_s"], sort=False):
            engine, setting, step = cast("tuple[Any, ...]", key)
            out[Run(str(engine), str(setting), float(step))] = rows
        return out


def _run_of(key: Hashable) -> tuple[Run, float]:
    _, engine, setting, alpha, timestep = cast("tuple[Any, ...]", key)
    return Run(str(engine), str(setting), float(timestep)), float(alpha)


def _curve(rows: pd.DataFrame, mass: float) -> Curve:
    """Fold phases; speeds that differ by round-off only are one speed."""
    good = rows[rows["restitution"].notna()]
    nominal = good["speed_m_per_s"].to_numpy(dtype=float)
    _, first, group = np.unique(np.round(nominal, 12), return_index=True, return_inverse=True)
    v_in, e = good["speed_in_m_per_s"].to_numpy(dtype=float), good["restitution"].to_numpy(dtype=float)
    error = np.abs(e - good["restitution_law"].to_numpy(dtype=float))
    loss = 0.5 * mass * v_in**2 * (1 - e**2)
    parts = [np.flatnonzero(group == i) for i in range(len(first))]

    def fold(values: Floats, how: Any) -> Floats:
        return np.array([how(values[part]) for part in parts])

    return Curve(
        speed=fold(v_in, np.median),
        low=fold(e, np.min),
        middle=fold(e, np.median),
        high=fold(e, np.max),
        error=fold(error, np.max),
        loss=fold(loss, np.median),
    )
