"""What figures and tables ask of Results, answered once: curves, which runs cover a band, what is coarse."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
import pandas as pd

from hcbench.benchmark.results import RUN_KEY, Results
from hcbench.impact import Floats, Loop
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.report.plot_style import PlotStyle, plot_styles
from hcbench.report.wording import NBSP, engine_title, span, time

REFERENCE = "reference"  # the engine of the law
LAW_SETTING = "hunt-crossley"  # its setting that is the law itself
CURVE_SPEEDS = 3  # from which a run says something about e over speed
STEPS_TO_RESOLVE = 10  # in the law's contact, from which a step resolves the contact
LOOP_POINTS = 241


class RunKey(NamedTuple):
    """One setting of one engine at one step."""

    engine: str
    setting: str
    timestep: float

    @property
    def is_law(self) -> bool:
        """Whether it is the law itself, which every figure shows anyway."""
        return (self.engine, self.setting) == (REFERENCE, LAW_SETTING)

    @property
    def title(self) -> str:
        """The engine's title and the setting."""
        return f"{engine_title(self.engine)} {self.setting}"

    @property
    def step(self) -> str:
        """The time step as people read it."""
        return time(self.timestep)


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

    def range_text(self, space: str = NBSP) -> str:
        """The range of e: "0.10 … 0.88"; one number where it hardly changes."""
        low, high = self.low.min(), self.high.max()
        return f"{low:.2f}" if high - low < 0.005 else span(f"{low:.2f}", f"{high:.2f}", space)


@dataclass(frozen=True)
class View:
    """Results as a report looks at them."""

    results: Results
    _curves: dict[tuple[RunKey, float], Curve] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        for key, rows in self.head_on.groupby(RUN_KEY, sort=False):
            self._curves[_run_and_alpha(key)] = _curve(rows, self.mass)

    @cached_property
    def head_on(self) -> pd.DataFrame:
        """Impacts at the study's smallest angle, 0 as a rule: what curves over speed are of."""
        impacts = self.results.impacts
        angles = impacts.get("angle_rad", pd.Series(0.0, impacts.index))
        return impacts.loc[angles == angles.min()]

    # The study and its law

    @property
    def study(self) -> Mapping[str, Any]:
        """The study, as JSON."""
        return self.results.study

    @property
    def mass(self) -> float:
        """Of the ball, kg."""
        return float(self.study["mass_kg"])

    @cached_property
    def alphas(self) -> list[float]:
        """α of the study, s/m, rising."""
        return sorted(float(a) for a in self.study["alphas"])

    @property
    def main_alpha(self) -> float:
        """The α that figures of one α show, s/m."""
        return float(self.study["main_alpha"])

    @property
    def band(self) -> Floats:
        """Ends of the study's band of impact speeds, m/s."""
        return np.array([min(self.study["speeds"]), max(self.study["speeds"])], dtype=float)

    @cached_property
    def speeds(self) -> Floats:
        """A fine grid over the study's band, m/s, from 0."""
        return np.linspace(0.0, max(self.study["speeds"]), 161)

    def law(self, alpha: float) -> HuntCrossley:
        """(16) for one α."""
        return HuntCrossley(float(self.study["stiffness"]), alpha, float(self.study["exponent"]))

    def law_loop(self, speed: float) -> Loop:
        """The law's loop at an impact speed (m/s) for the main α."""
        return closed_form.loop(self.law(self.main_alpha), self.mass, speed, LOOP_POINTS)

    @cached_property
    def contact_time(self) -> float:
        """How long the law's contact lasts at the study's speed for steps, s."""
        return float(
            closed_form.duration(self.law(self.main_alpha), self.mass, float(self.study["step_speed"]))
        )

    # Runs

    @cached_property
    def tabled_runs(self) -> list[RunKey]:
        """Runs over enough speeds to show a curve, in the study's order."""
        enough = min(CURVE_SPEEDS, len(self.study["speeds"]))
        tried = self.head_on.groupby(RUN_KEY, sort=False)["speed_m_per_s"].nunique()
        return list(dict.fromkeys(_run_and_alpha(key)[0] for key, n in tried.items() if n >= enough))

    @cached_property
    def band_runs(self) -> list[RunKey]:
        """Those of them that figures show: the law itself is in every panel already."""
        return [run for run in self.tabled_runs if not run.is_law]

    @cached_property
    def engines(self) -> list[str]:
        """Engines of the band runs, in the study's order, the reference left out."""
        return engines_of(self.band_runs)

    def resolves_contact(self, run: RunKey) -> bool:
        """Whether its step is short enough to see the contact from inside."""
        return run.timestep <= self.contact_time / STEPS_TO_RESOLVE * (1 + 1e-9)

    def runs_by_resolution(self, resolved: bool) -> list[RunKey]:
        """Band runs that resolve the contact, or do not; each setting at the step that most of them share."""
        group = [run for run in self.band_runs if self.resolves_contact(run) == resolved]
        steps = [run.timestep for run in group]
        common = max(sorted(set(steps)), key=steps.count, default=1.0)
        shown = {
            key: min((r for r in group if r[:2] == key), key=lambda run: abs(np.log(run.timestep / common)))
            for key in dict.fromkeys(run[:2] for run in group)
        }
        return [run for run in group if run == shown[run[:2]]]

    def is_plugin(self, run: RunKey) -> bool:
        """Does it need code of ours in the user's loop, rather than numbers in the user's model?"""
        return run in self._plugins

    @cached_property
    def _plugins(self) -> set[RunKey]:
        return {run_of_record(r) for r in self.results.settings if "law" in r["options"]}

    @cached_property
    def plot_styles(self) -> dict[tuple[str, str], PlotStyle]:
        """How each (engine, setting) is drawn."""
        runs = [run for run, _ in self._curves] + list(self.bounces)
        return plot_styles(((run.engine, run.setting) for run in runs), law=REFERENCE)

    def plot_style(self, run: RunKey) -> PlotStyle:
        """How a run is drawn."""
        return self.plot_styles[run.engine, run.setting]

    # What they did

    def curve(self, run: RunKey, alpha: float) -> Curve | None:
        """e over speed; None where the study has no such run or no impact of it came back."""
        curve = self._curves.get((run, alpha))
        return curve if curve is not None and curve.speed.size else None

    def score(self, run: RunKey, alpha: float | None = None) -> Mapping[str, Any] | None:
        """The score of a run for one α, else the main one."""
        return self._scores.get((run, self.main_alpha if alpha is None else alpha))

    def scores(self, run: RunKey) -> list[Mapping[str, Any]]:
        """The scores of a run, for each α that it ran for."""
        return [score for alpha in self.alphas if (score := self.score(run, alpha)) is not None]

    @cached_property
    def _scores(self) -> dict[tuple[RunKey, float], Mapping[str, Any]]:
        out: dict[tuple[RunKey, float], Mapping[str, Any]] = {}
        for row in self.results.scores.to_dict("records"):
            key = _run_and_alpha(tuple(row[k] for k in RUN_KEY))
            # A study may run one setting twice, over the band and at one speed: the band tells more.
            if key not in out or row["impacts"] > out[key]["impacts"]:
                out[key] = {str(k): v for k, v in row.items()}
        return out

    def step_curves(self) -> dict[tuple[str, str], pd.DataFrame]:
        """(engine, setting) -> e over several steps at the study's step speed for its main α, steps rising.

        Columns: timestep, low, middle, high (NaN where no impact came back).
        """
        impacts = self._of_main_alpha(self.head_on)
        here = impacts[np.isclose(impacts["speed_m_per_s"], self.study["step_speed"], rtol=1e-9)]
        out: dict[tuple[str, str], pd.DataFrame] = {}
        for key, rows in here.groupby(["engine", "setting"], sort=False):
            engine, setting = (str(part) for part in cast("tuple[Any, ...]", key))
            by_step = rows.groupby("timestep_s")["restitution"].agg(["min", "median", "max"])
            if len(by_step) > 1:
                columns = ["timestep", "low", "middle", "high"]
                out[engine, setting] = by_step.reset_index().set_axis(columns, axis=1)
        return out

    @cached_property
    def loops(self) -> dict[RunKey, dict[float, pd.DataFrame]]:
        """Loops for the main α: run -> impact speed (m/s) -> samples in time order."""
        out: dict[RunKey, dict[float, pd.DataFrame]] = {}
        if self.results.loops.empty:
            return out
        table = self._of_main_alpha(self.results.loops)
        for key, rows in table.groupby(["engine", "setting", "timestep_s", "speed_m_per_s"], sort=False):
            *run, speed = cast("tuple[Any, ...]", key)
            out.setdefault(_run(*run), {})[float(speed)] = rows
        return out

    @cached_property
    def bounces(self) -> dict[RunKey, pd.DataFrame]:
        """Successive bounces under gravity for the main α: run -> heights in the order of the bounces."""
        table = self._of_main_alpha(self.results.trains)
        groups = table.groupby(["engine", "setting", "timestep_s"], sort=False)
        return {_run(*cast("tuple[Any, ...]", key)): rows for key, rows in groups}

    def _of_main_alpha(self, table: pd.DataFrame) -> pd.DataFrame:
        return table[np.isclose(table["alpha_s_per_m"].astype(float), self.main_alpha, rtol=1e-9)]


def engines_of(runs: Iterable[RunKey]) -> list[str]:
    """The engines of some runs, in their order, the reference left out."""
    return list(dict.fromkeys(run.engine for run in runs if run.engine != REFERENCE))


def _run(engine: Any, setting: Any, timestep: Any) -> RunKey:
    return RunKey(str(engine), str(setting), float(timestep))


def run_of_record(record: Mapping[str, Any]) -> RunKey:
    """The run of one of the results' settings."""
    return _run(record["engine"], record["setting"], record["timestep_s"])


def _run_and_alpha(key: Hashable) -> tuple[RunKey, float]:
    *_, engine, setting, alpha, timestep = cast("tuple[Any, ...]", key)
    return _run(engine, setting, timestep), float(alpha)


def _curve(rows: pd.DataFrame, mass: float) -> Curve:
    """Fold phases; speeds that differ by round-off only are one speed."""
    good = rows[rows["restitution"].notna()]
    v_in, e = good["speed_in_m_per_s"].astype(float), good["restitution"].astype(float)
    error = (e - good["restitution_law"].astype(float)).abs()
    columns = {"speed": v_in, "e": e, "error": error, "loss": 0.5 * mass * v_in**2 * (1 - e**2)}
    by_speed = pd.DataFrame(columns).groupby(good["speed_m_per_s"].astype(float).round(12))
    return Curve(
        speed=by_speed["speed"].median().to_numpy(),
        low=by_speed["e"].min().to_numpy(),
        middle=by_speed["e"].median().to_numpy(),
        high=by_speed["e"].max().to_numpy(),
        error=by_speed["error"].max().to_numpy(),
        loss=by_speed["loss"].median().to_numpy(),
    )
