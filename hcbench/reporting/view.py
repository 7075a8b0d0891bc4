"""Views of Results for figures and tables: curves, runs that cover a band, steps too coarse for a
contact.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
import pandas as pd

from hcbench.benchmark.bounce_sequence import RestAfterDrop
from hcbench.benchmark.results import RUN_KEY, Folded, Key, Results
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.measuring.curve import Curve, CurvePoint
from hcbench.reporting.plot_style import PlotStyle, plot_styles
from hcbench.reporting.wording import NBSP, engine_title, span, time
from hcbench.terms.impact import Floats
from hcbench.terms.resolution import STEPS_OF_A_LOOP

# The engine that simulates the law itself.
REFERENCE = "reference"
# The setting with nothing set.
STOCK = "stock"
# The setting of REFERENCE that is the law itself.
LAW_SETTING = "hunt-crossley"
# A run with so many speeds or more says something about e over speed.
CURVE_SPEEDS = 3
# Columns that identify a run.
_RUN = ["scene", "engine", "setting", "timestep_s"]
# Phrases for a scene's form.
_PLACES = {"plane": "on a flat plate", "cup": "in the cup"}


class RunKey(NamedTuple):
    """One setting of one engine at one step.

    timestep: s.
    place: a phrase for the scene, such as "in the cup", if it is not the study's own; else "".
    """

    engine: str
    setting: str
    timestep: float
    place: str = ""

    @property
    def is_law(self) -> bool:
        """True if a run is the law itself, which every figure shows anyway."""
        return (self.engine, self.setting) == (REFERENCE, LAW_SETTING)

    @property
    def title(self) -> str:
        """Title of the engine, the setting, and the scene if it is not the study's."""
        engine = engine_title(self.engine)
        if self.setting == STOCK:
            return f"{engine}, {self.name}"
        return f"{engine} {self.label}"

    @property
    def name(self) -> str:
        """The setting, as it stands beside a line."""
        return "nothing set" if self.setting == STOCK else self.setting

    @property
    def label(self) -> str:
        """The setting, and where it ran if not in the study's own scene."""
        return f"{self.setting} {self.place}" if self.place else self.setting

    @property
    def step(self) -> str:
        """The time step as people read it."""
        return time(self.timestep)


@dataclass(frozen=True)
class View:
    """Results of a study as a report looks at them. A run is one setting of one engine at one step
    (`RunKey`), with several α. What goes by run and α alone, such as `head_on`, needs results of one
    gravity and one scene: `tables.under` picks them.
    """

    results: Results

    @property
    def folded(self) -> Mapping[Key, Folded]:
        """The impacts by RUN_KEY."""
        return self.results.table.folded

    @cached_property
    def head_on(self) -> dict[tuple[RunKey, float], Folded]:
        """Impacts at the smallest angle that the study launches at, 0 as a rule, by run and α, s/m:
        curves over speed are of these.
        """
        least = min((folded.angle for folded in self.folded.values()), default=0.0)
        chosen = {}
        for key, folded in self.folded.items():
            if folded.angle == least:
                chosen[self._run_and_alpha(key)] = folded
        return chosen

    # The study and its law

    @property
    def study(self) -> Mapping[str, Any]:
        """The study, as JSON."""
        return self.results.study

    @property
    def gravity(self) -> float:
        """Into the plate, m/s²."""
        return float(self.study["gravity"])

    @property
    def in_inches(self) -> bool:
        """True if speeds are shown in in/s, as the study has them; else they are in m/s."""
        return str(self.study.get("speed_unit", "in/s")) == "in/s"

    @property
    def mass(self) -> float:
        """Mass of the ball, kg."""
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

    def band_text(self, timestep: float) -> str:
        """The impact speeds of the runs at a step that launch straight down, or at the smallest
        angle, as text: "0.025 … 0.51 m/s".

        timestep: s, of one such run at least; raises ValueError for any other.
        """
        of_step = []
        for (run, _), folded in self.head_on.items():
            if run.timestep == timestep:
                of_step.append(folded.curve.speed)
        speeds = np.concatenate(of_step)
        return f"{span(f'{speeds.min():.3g}', f'{speeds.max():.3g}')}{NBSP}m/s"

    @cached_property
    def speeds(self) -> Floats:
        """A fine grid over the study's band, m/s, from 0."""
        return np.linspace(0.0, max(self.study["speeds"]), 161)

    def law(self, alpha: float) -> HuntCrossley:
        """(16) for one α."""
        return HuntCrossley(float(self.study["stiffness"]), alpha, float(self.study["exponent"]))

    @cached_property
    def contact_time(self) -> float:
        """Duration of the law's contact at the study's speed for steps, s."""
        return float(
            closed_form.duration(
                self.law(self.main_alpha), self.mass, float(self.study["step_speed"])
            )
        )

    # Runs

    @cached_property
    def tabled_runs(self) -> list[RunKey]:
        """Runs over enough speeds to show a curve, in the study's order."""
        enough = min(CURVE_SPEEDS, len(self.study["speeds"]))
        # A dict keeps each run once, in order.
        runs: dict[RunKey, None] = {}
        for (run, _alpha), folded in self.head_on.items():
            if len(folded.curve) >= enough:
                runs[run] = None
        return list(runs)

    @cached_property
    def band_runs(self) -> list[RunKey]:
        """Runs that figures show, without the law itself, which is in every panel already."""
        return [run for run in self.tabled_runs if not run.is_law]

    @cached_property
    def engines(self) -> list[str]:
        """Engines of the band runs, in the study's order, the reference left out."""
        return engines_of(self.band_runs)

    def resolves_contact(self, run: RunKey) -> bool:
        """Say whether a run's step is short enough to resolve the contact."""
        return run.timestep <= self.contact_time / STEPS_OF_A_LOOP * (1 + 1e-9)

    def runs_by_resolution(self, resolved: bool) -> list[RunKey]:
        """Runs over a band of speeds that resolve the contact, or do not; each setting at the step
        that most of them share, or the nearest to it, by ratio, that the setting ran with.

        resolved: which of the two, by `resolves_contact`. The order is the study's.
        """
        group = [run for run in self.band_runs if self.resolves_contact(run) == resolved]
        steps = [run.timestep for run in group]
        # The shortest of the steps that are equally common.
        common = max(sorted(set(steps)), key=steps.count, default=1.0)

        def distance(run: RunKey) -> float:
            return abs(math.log(run.timestep / common))

        nearest: dict[tuple[str, str], RunKey] = {}
        for run in group:
            setting = (run.engine, run.setting)
            if setting not in nearest or distance(run) < distance(nearest[setting]):
                nearest[setting] = run
        return [run for run in group if run == nearest[run.engine, run.setting]]

    def is_plugin(self, run: RunKey) -> bool:
        """Say whether the run needs code of hcbench in the user's loop, rather than numbers in the
        user's model.
        """
        return run in self._plugins

    @cached_property
    def _plugins(self) -> set[RunKey]:
        plugins = set()
        for record in self.results.settings:
            if "law" in record["options"]:
                plugins.add(self.run_of(record))
        return plugins

    @cached_property
    def plot_styles(self) -> dict[tuple[str, str], PlotStyle]:
        """Style of each (engine, setting) of the study: those planned, those that ran and those
        that were dropped, so that one setting looks the same in every figure.
        """
        settings = [(run["engine"], run["recipe"]) for run in self.study["runs"]]
        settings += [(run.engine, run.setting) for run, _ in self.head_on]
        settings += [(run.engine, run.setting) for run in self.bounces]
        return plot_styles(settings, law=REFERENCE)

    def plot_style(self, run: RunKey) -> PlotStyle:
        """The style in which figures draw a run."""
        return self.plot_styles[run.engine, run.setting]

    # What they did

    def curve(self, run: RunKey, alpha: float) -> Curve | None:
        """e over speed; None where the study has no such run or no impact of it came back."""
        return self._curves.get((run, alpha))

    @cached_property
    def _curves(self) -> dict[tuple[RunKey, float], Curve]:
        """Curves by run and α; without those of which no impact came back."""
        curves = {}
        for where, folded in self.head_on.items():
            curve = folded.curve.measured()
            if len(curve):
                curves[where] = curve
        return curves

    def score(self, run: RunKey, alpha: float | None = None) -> Mapping[str, Any] | None:
        """The score of a run for one α, s/m, else the main one; None where it did not run for it."""
        if alpha is None:
            alpha = self.main_alpha
        return self._scores.get((run, alpha))

    @cached_property
    def answers(self) -> dict[tuple[str, float, str], Mapping[str, Any]]:
        """Answers of `hcbench tune` under this gravity: (engine, step, α in nine digits) -> as
        JSON.
        """
        answers: dict[tuple[str, float, str], Mapping[str, Any]] = {}
        for answer in self.results.answers:
            if answer["gravity"] == self.gravity:
                step = float(answer["timestep"])
                answers[answer["engine"], step, f"{answer['alpha']:.9g}"] = answer
        return answers

    def scores(self, run: RunKey) -> list[Mapping[str, Any]]:
        """The scores of a run, for each α that it ran for."""
        return [score for alpha in self.alphas if (score := self.score(run, alpha)) is not None]

    @cached_property
    def _scores(self) -> dict[tuple[RunKey, float], Mapping[str, Any]]:
        """Scores by run and α, that of the most impacts where a study has several."""
        out: dict[tuple[RunKey, float], Mapping[str, Any]] = {}
        for row in self.results.scores.to_dict("records"):
            key = self._run_and_alpha(tuple(row[k] for k in RUN_KEY))
            # A study may run one setting twice, over the band and at
            # one speed: the band tells more.
            if key not in out or row["impacts"] > out[key]["impacts"]:
                out[key] = {str(k): v for k, v in row.items()}
        return out

    def step_curves(self) -> dict[RunKey, list[tuple[float, CurvePoint]]]:
        """Error of e over the time step: run without its step -> (step, s; point of the curve at
        the study's speed for steps), for the main α, steps rising.

        The run's own step is then 0. Runs at one step only are left out.
        """
        rows: dict[RunKey, list[tuple[float, CurvePoint]]] = {}
        for (run, alpha), one in self.head_on.items():
            if one.at_step is not None and self._is_main(alpha):
                rows.setdefault(run._replace(timestep=0.0), []).append((run.timestep, one.at_step))
        several = {}
        for run, points in rows.items():
            if len(points) > 1:
                several[run] = sorted(points, key=lambda point: point[0])
        return several

    @cached_property
    def bounces(self) -> dict[RunKey, pd.DataFrame]:
        """Successive bounces under gravity for the main α: run ->
        rows of TRAIN_COLUMNS in the order of the bounces.
        """
        groups = self._of_main_alpha(self.results.trains).groupby(_RUN, sort=False)
        return {self._run(*cast("tuple[Any, ...]", key)): rows for key, rows in groups}

    @cached_property
    def rests(self) -> dict[RunKey, RestAfterDrop]:
        """Rest of the bodies after a drop under gravity for the main α."""
        rests = {}
        for row in self._of_main_alpha(self.results.rests).to_dict("records"):
            rest = RestAfterDrop(float(row["depth_m"]), float(row["motion_m"]))
            rests[self.run_of(row)] = rest
        return rests

    def run_of(self, record: Mapping[Any, Any]) -> RunKey:
        """The run of one of the results' settings, or of a row of a table."""
        return self._run(*(record[name] for name in _RUN))

    def _run(self, scene: Any, engine: Any, setting: Any, timestep: Any = 0.0) -> RunKey:
        """The run with these values of its key.

        scene, engine, setting: names, or texts of NumPy.
        timestep: s.
        Raises KeyError for a scene that the study does not have.
        """
        place = ""
        if scene != self.study["scene"]:
            place = _PLACES[self.study["scenes"][scene]["form"]]
        return RunKey(str(engine), str(setting), float(timestep), place)

    def _run_and_alpha(self, key: Key) -> tuple[RunKey, float]:
        values = dict(zip(RUN_KEY, key, strict=True))
        return self.run_of(values), float(values["alpha_s_per_m"])

    @cached_property
    def depths(self) -> dict[RunKey, float]:
        """Greatest penetration of each run for the main α, m."""
        return {run: folded.depth for run, folded in self.of_main_alpha()}

    def of_main_alpha(self) -> Iterator[tuple[RunKey, Folded]]:
        """The runs for the main α; one that ran under several conditions comes with each."""
        for key, folded in self.folded.items():
            run, alpha = self._run_and_alpha(key)
            if self._is_main(alpha):
                yield run, folded

    def _is_main(self, alpha: float) -> bool:
        return math.isclose(alpha, self.main_alpha, rel_tol=1e-9)

    def _of_main_alpha(self, table: pd.DataFrame) -> pd.DataFrame:
        return table[np.isclose(table["alpha_s_per_m"].astype(float), self.main_alpha, rtol=1e-9)]


def engines_of(runs: Iterable[RunKey]) -> list[str]:
    """The engines of some runs, in their order, the reference left out."""
    return list(dict.fromkeys(run.engine for run in runs if run.engine != REFERENCE))
