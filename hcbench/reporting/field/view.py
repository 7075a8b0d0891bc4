"""Results of a field study as its page looks at them, and the sentences on its top."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from hcbench import scoring
from hcbench.benchmark.results import RUN_KEY, Folded, Key, Results
from hcbench.measuring.curve import Curve
from hcbench.recipes.recipe import Recipe, Role
from hcbench.reporting.view import REFERENCE
from hcbench.reporting.wording import engine_title, error, listed, sentence, span, time
from hcbench.sim import registry
from hcbench.sim.passivity import MOST_E
from hcbench.terms.resolution import FOLLOWS

# Results of a field study as its page looks at them: by engine, setting, gravity and step.

_KEY = ["engine", "setting", "gravity_m_per_s2", "timestep_s"]
# Kinds of settings.
CONSTANT = "constant"
SETTINGS = "settings"
PLUGIN = "plugin"
STOCK = "stock"
# Kinds of settings of the engine's own contact.
OWN = (CONSTANT, SETTINGS)
# An engine whose e is lower at every speed counts as one that does not bounce.
NO_BOUNCE = 0.05


class Case(NamedTuple):
    """One setting of one engine, with its version, at one step: gravity in m/s², timestep in s."""

    engine: str
    setting: str
    gravity: float
    timestep: float


@dataclass(frozen=True)
class FieldView:
    """Results of a field study for its main α, arranged by engine and condition. A condition is a
    gravity (m/s²) and a step (s); a `Case` is one setting of one engine under it.
    """

    results: Results

    def __getstate__(self) -> dict[str, Any]:
        """The field alone: threads of a pool pickle a view while the page
        computes its cached properties.
        """
        return {"results": replace(self.results, table=self.results.table.without_rows())}

    @property
    def study(self) -> Mapping[str, Any]:
        """The study, as JSON."""
        return self.results.study

    @property
    def alpha(self) -> float:
        """The main α, s/m."""
        return float(self.study["main_alpha"])

    @cached_property
    def _speeds(self) -> dict[float, Any]:
        return {case.timestep: folded.curve.speed.round(12) for case, folded in self.folded.items()}

    def speeds(self, timestep: float) -> Any:
        """Impact speeds of every engine at a step, with gravity and without, m/s, rising."""
        return self._speeds[timestep]

    def constant_error(self, timestep: float) -> float:
        """Error of the best constant e over the band of a step."""
        _, error = scoring.best_constant(self.alpha, self.speeds(timestep))
        return error

    @cached_property
    def scores(self) -> dict[Case, Mapping[str, Any]]:
        """Each case's score, in the study's order."""
        scores: dict[Case, Mapping[str, Any]] = {}
        for row in self._of_alpha(self.results.scores).to_dict("records"):
            scores[self._case(row)] = {str(name): value for name, value in row.items()}
        return scores

    @cached_property
    def folded(self) -> dict[Case, Folded]:
        """Impacts of each case, folded over speed, under the α that the page is about."""
        of_case = {}
        for key, folded in self._of_main:
            values = dict(zip(RUN_KEY, key, strict=True))
            of_case[self._case(values)] = folded
        return of_case

    @property
    def _of_main(self) -> list[tuple[Key, Folded]]:
        """(key of a run, its impacts as `Folded`) of the α that the page is about, of all runs."""
        place = RUN_KEY.index("alpha_s_per_m")
        of_main = []
        for key, folded in self.results.table.folded.items():
            if math.isclose(key[place], self.alpha, rel_tol=1e-9):
                of_main.append((key, folded))
        return of_main

    @cached_property
    def impacts(self) -> dict[Case, pd.DataFrame]:
        """Each case's impacts, a row each."""
        impacts = {}
        for case, (key, _) in zip(self.folded, self._of_main, strict=True):
            impacts[case] = self.results.table.rows([key])
        return impacts

    @cached_property
    def loops(self) -> dict[Case, pd.DataFrame]:
        """Each case's loop at the study's speed for steps, rows of LOOP_COLUMNS in time order; a
        case without a kept loop at that speed is left out.
        """
        table = self._of_alpha(self.results.loops)
        if table.empty:
            return {}
        here = table[
            np.isclose(table["speed_m_per_s"].astype(float), self.study["step_speed"], rtol=1e-9)
        ]
        groups = here.groupby(_KEY, sort=False)
        return {self._case(rows.iloc[0].to_dict()): rows for _, rows in groups}

    @cached_property
    def engines(self) -> list[str]:
        """Engines that ran, in the study's order, without the reference."""
        engines = dict.fromkeys(case.engine for case in self.scores)
        engines.pop(REFERENCE, None)
        return list(engines)

    @cached_property
    def gravities(self) -> list[float]:
        """Without first."""
        return sorted({case.gravity for case in self.scores})

    @cached_property
    def steps(self) -> list[float]:
        """Time steps of all engines, s, rising."""
        return sorted({case.timestep for case in self.scores if case.engine != REFERENCE})

    def title(self, engine: str) -> str:
        """Name of the engine, with the version that ran."""
        plain = registry.base_name(engine)
        return f"{engine_title(plain)} {self.results.versions.get(engine, '')}".strip()

    def recipe(self, case: Case) -> Recipe | None:
        """The recipe that made the setting of a case; None where this hcbench has no such recipe."""
        return registry.recipes(registry.base_name(case.engine)).get(case.setting)

    def kind(self, case: Case) -> str:
        """Kind of a case's setting: STOCK; CONSTANT, one e for all speeds; SETTINGS, whose e falls
        with speed; or PLUGIN. "" where this hcbench has no such recipe.
        """
        recipe = self.recipe(case)
        if recipe is None:
            return ""
        if not recipe.native:
            return PLUGIN
        return {Role.STOCK: STOCK, Role.CONSTANT_E: CONSTANT}.get(recipe.role, SETTINGS)

    def cases(self, engine: str, gravity: float, timestep: float, *kinds: str) -> list[Case]:
        """An engine's settings of some kinds at a step, OWN where none
        is named, in the study's order; empty where it ran none.

        engine: as it ran, with its version.
        gravity: m/s².
        timestep: s.
        """
        wanted = kinds or OWN
        cases = []
        for case in self.scores:
            here = case.engine == engine and case.gravity == gravity and case.timestep == timestep
            if here and self.kind(case) in wanted:
                cases.append(case)
        return cases

    def best(self, engine: str, gravity: float, timestep: float, *kinds: str) -> Case | None:
        """The setting nearest to the law that loses no impact and gains no energy; None for none.

        engine: its name.
        gravity: m/s².
        timestep: s.
        kinds: of settings, such as PLUGIN; OWN without any. One that bounces over the whole band is
        before any that stays down somewhere.
        """

        def badness(case: Case) -> tuple[bool, float]:
            return self.stays_down(case) > 0.0, self.error(case)

        cases = self.cases(engine, gravity, timestep, *kinds)
        # The error of one that loses impacts or gains energy is infinite.
        good = [case for case in cases if math.isfinite(self.error(case))]
        return min(good, key=badness, default=None)

    def stock(self, engine: str, gravity: float, timestep: float) -> Case | None:
        """The engine with nothing set; None where it did not run so."""
        case = Case(engine, "stock", gravity, timestep)
        return case if case in self.scores else None

    def error(self, case: Case) -> float:
        """`off` the law; inf where impacts were lost, energy gained, or nothing bounced."""
        off = self.off(case)
        if self.scores[case]["failed"] or self.gains(case) or math.isnan(off):
            return math.inf
        return off

    def choice(self, case: Case) -> Mapping[str, Any] | None:
        """Choice of `hcbench tune`, as JSON, for the case's engine, gravity, step and α that has
        its setting and the same band of speeds; None if there is none.
        """
        speeds = self.speeds(case.timestep)
        ends = [speeds[0], speeds[-1]]
        for answer in self.results.answers:
            conditions = (answer["engine"], answer["gravity"], answer["timestep"])
            if conditions != (case.engine, case.gravity, case.timestep):
                continue
            if not math.isclose(answer["alpha"], self.alpha, rel_tol=1e-9):
                continue
            for choice in answer["choices"]:
                same_band = np.allclose(ends, choice["speeds_m_per_s"], rtol=1e-3)
                if same_band and choice["setting"] == case.setting:
                    return dict(choice)
        return None

    def scenes(self, case: Case) -> int:
        """In how many launches of a case energy never grew, where the case gains none."""
        choice = self.choice(case)
        return len(self.folded[case]) if choice is None else int(choice["scenes"])

    def off(self, case: Case) -> float:
        """Largest |e - e of the law| of the impacts that parted: as `tune` has found it, where it
        has an answer with this setting, else in this study; NaN where no impact parted.
        """
        choice = self.choice(case)
        if choice is not None:
            return float(choice["max_error"])
        return self.folded[case].off_parted

    def stays_down(self, case: Case) -> float:
        """Speed from which on every impact bounces, m/s; 0 if all do, inf if the fastest does not.

        Slower ones that come to rest have no e and do not count as errors.
        """
        # The fastest that came to rest, m/s; NaN for none.
        rested = self.folded[case].rested
        if math.isnan(rested):
            return 0.0
        speeds = self.speeds(case.timestep)
        above = speeds[speeds > rested * (1.0 + 1e-9)]
        return float(min(above, default=math.inf))

    def gains(self, case: Case) -> bool:
        """True if a body left with more energy than it came with, by more than chance."""
        return bool(self.scores[case]["energy_gained"]) and not self.largest_e(case) <= MOST_E

    def restitution(self, case: Case) -> tuple[float, float]:
        """The least and the largest e over speeds and phases; NaN where no impact came back."""
        return self.folded[case].restitution

    def largest_e(self, case: Case) -> float:
        """The largest e over speeds and phases; NaN where no impact came back."""
        _, largest = self.restitution(case)
        return largest

    def lost(self, case: Case) -> str:
        """The commonest status of the impacts if none gave an e; "" if any did."""
        counts = self.folded[case].status
        if "parted" in counts or "rested" in counts:
            return ""
        # The first by name of those that are equally common.
        return min(counts, key=lambda status: (-counts[status], status))

    def curve(self, case: Case) -> Curve:
        """e over the speeds from which an impact came back."""
        return self.folded[case].curve.measured()

    def follows_law(self, case: Case) -> bool:
        """True if a case's error of e is below a tenth of the best constant e's."""
        return self.error(case) <= FOLLOWS * self.constant_error(case.timestep)

    def _case(self, row: Mapping[Any, Any]) -> Case:
        engine, setting, gravity, timestep = (row[name] for name in _KEY)
        return Case(str(engine), str(setting), float(gravity), float(timestep))

    def _of_alpha(self, table: pd.DataFrame) -> pd.DataFrame:
        return table[np.isclose(table["alpha_s_per_m"].astype(float), self.alpha, rtol=1e-9)]


# Sentences of the field page: who follows the law at a step, and what a version changed.

_WORDS = (
    "no",
    "one",
    "two",
    "three",
    "four",
    "five",
    "six",
    "seven",
    "eight",
    "nine",
    "ten",
    "eleven",
    "twelve",
)


def headline(view: FieldView, gravity: float, timestep: float) -> list[str]:
    """Sentences that sort the engines: those that follow the law by settings, by a plug-in alone,
    or not.

    gravity: m/s².
    timestep: s, at which they ran. An engine that ran in several versions is named once.
    """
    # With versions; all further lists have names without versions, each name once.
    ran = [engine for engine in view.engines if view.cases(engine, gravity, timestep, *OWN, PLUGIN)]
    by_settings = _following(view, ran, gravity, timestep, *OWN)
    by_plugin = _following(view, ran, gravity, timestep, PLUGIN)
    by_plugin_only = [engine for engine in by_plugin if engine not in by_settings]
    others = [engine for engine in _bases(ran) if engine not in (*by_settings, *by_plugin_only)]
    condition = "without gravity"
    if gravity:
        condition = "under gravity"
    engines_follow = _engines_follow(by_settings)
    sentences = [
        f"At {time(timestep)} {condition}, {engines_follow} the law by settings alone{_named(by_settings)}."
    ]
    if by_plugin_only:
        count = _count(by_plugin_only)
        if by_settings:
            count += " more"
        verb = "does"
        if len(by_plugin_only) > 1:
            verb = "do"
        sentences.append(f"With a plug-in, {count} {verb}{_named(by_plugin_only)}.")
    if others:
        titles = listed(list(map(engine_title, others)), "or")
        sentences.append(f"No setting that was run here follows it in {titles}.")
    return sentences


def _engines_follow(engines: list[str]) -> str:
    """ "no engine follows", "one engine follows", "two engines follow"."""
    if not engines:
        return "no engine follows"
    if len(engines) == 1:
        return f"{_count(engines)} engine follows"
    return f"{_count(engines)} engines follow"


def _following(
    view: FieldView, engines: list[str], gravity: float, timestep: float, *kinds: str
) -> list[str]:
    """Engines whose best setting of some kinds follows the law, by their names without versions.

    engines: with their versions, as they ran.
    timestep: s.
    gravity: m/s².
    kinds: of settings, such as PLUGIN.
    """
    following = []
    for engine in engines:
        best = view.best(engine, gravity, timestep, *kinds)
        if best is not None and view.follows_law(best):
            following.append(engine)
    return _bases(following)


def _bases(engines: list[str]) -> list[str]:
    return list(dict.fromkeys(registry.base_name(engine) for engine in engines))


def _count(engines: list[str]) -> str:
    """Number of engines, up to twelve in words."""
    number = len(engines)
    if number < len(_WORDS):
        return _WORDS[number]
    return str(number)


def _named(engines: list[str]) -> str:
    """Titles of engines after a colon; "" for none."""
    if not engines:
        return ""
    return f": {listed(list(map(engine_title, engines)))}"


def band(view: FieldView, timestep: float) -> str:
    """The impact speeds at a step: "0.0254 … 0.508 m/s"."""
    speeds = view.speeds(timestep)
    return f"{span(f'{speeds[0]:.3g}', f'{speeds[-1]:.3g}')} m/s"


def versions(view: FieldView) -> str:
    """Sentence on how far e differs between versions of an engine, each two of them; "" if no
    engine ran in two.
    """
    words = []
    for one, other in combinations(view.engines, 2):
        if registry.base_name(one) != registry.base_name(other):
            continue
        differences = _differences_of_e(view, one, other)
        largest = max(filter(math.isfinite, differences), default=math.nan)
        runs = f"{len(differences)} runs"
        if largest == 0.0:
            off = f"bounce alike in all {runs}"
        else:
            off = f"differ in e by up to {error(largest)} over {runs}"
        words.append(f"{view.title(one)} and {view.title(other)} {off}")
    if not words:
        return ""
    return sentence(f"{'; '.join(words)}.")


def _differences_of_e(view: FieldView, one: str, other: str) -> list[float]:
    """Largest |difference of e| over the launches of each case that both engines ran; NaN
    where an e is missing in all rows.

    one, other: engines with their versions.
    """
    differences = []
    for case, impacts in view.impacts.items():
        others = view.impacts.get(case._replace(engine=other))
        if case.engine == one and others is not None:
            # Row by row, as both have the same launches in the same order;
            # pandas would go by the index.
            difference = impacts["restitution"] - others["restitution"].to_numpy()
            differences.append(float(difference.abs().max()))
    return differences
