"""The field page: headline, tables, figures, features, and what to paste."""

from __future__ import annotations

import math
import os
import platform
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from hcbench._files import atomic_folder, write_text
from hcbench.reporting.field import matrix, probe
from hcbench.reporting.field.figures import drawings
from hcbench.reporting.field.headline import band, headline, left_out
from hcbench.reporting.field.view import Case, FieldView
from hcbench.reporting.page import PAGE, draw, render
from hcbench.reporting.wording import number, span, time
from hcbench.setting import Setting
from hcbench.sim import registry
from hcbench.sim.install import add_commands
from hcbench.tuning.snippet import snippet

if TYPE_CHECKING:
    from pathlib import Path

    from hcbench.benchmark.results import Results
    from hcbench.workers import WorkerPool

COST = "cost.csv"
_SEEN = 0.005  # of e: less is no bounce to anybody who looks


@dataclass(frozen=True, slots=True)
class Entry:
    """A cell of the tables of errors. grade: "good", "even" or "bad" beside the best constant; "none".

    down: below which speed a body stays down, in the column beside it. energy: in how many launches it never
    grew. notes: settings that are left out.
    """

    text: str
    setting: str
    grade: str
    down: str = ""
    energy: str = ""
    notes: tuple[str, ...] = ()


def build(results: Results, folder: Path, pool: WorkerPool | None = None) -> Path:
    """Write the field report into `folder` and return its page. All of it appears, or nothing.

    index.html, tables and figures are the same bytes for the same results; cost.csv is of this machine.
    """
    view = FieldView(results)
    with atomic_folder(folder, PAGE) as scratch:
        results.write(scratch)
        (scratch / "figures").mkdir()
        save = partial(draw, folder=scratch / "figures", png=not results.study.get("left_out"))
        figures = list(map(save, drawings(view))) if pool is None else pool.map(save, drawings(view))
        probes = {case.engine: probe_of_engine for case, probe_of_engine in _probes(view)}
        write_text(scratch / COST, _costs(view, probes))
        write_text(scratch / PAGE, _page(view, figures, {engine: p for engine, (_, p) in probes.items()}))
    return folder / PAGE


def _probes(view: FieldView) -> list[tuple[Case, tuple[Case, probe.Probe | None]]]:
    """Each engine's best setting at the step nearest to 1 ms, else its default, with its features."""
    probes = []
    scene = probe.scene_of(view)
    for engine in view.engines:
        steps = sorted(view.steps, key=lambda h: abs(math.log(h / 1e-3)))
        picks = [pick(engine, 0.0, h) for pick in (view.best, view.stock) for h in steps]
        case = next((case for case in picks if case is not None), None)
        if case is not None:
            probes.append((case, (case, probe.probe(_setting(view, case), scene))))
    return probes


def _setting(view: FieldView, case: Case) -> Setting:
    """What a case was made of."""
    for record in view.results.settings:
        key = (record["engine"], record["setting"], record["gravity_m_per_s2"], record["timestep_s"])
        if key == tuple(case):
            return Setting(case.engine, case.setting, case.timestep, record["options"])
    raise AssertionError(f"{case} is of the study")


def _costs(view: FieldView, probes: dict[str, tuple[Case, probe.Probe | None]]) -> str:
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    costs = [
        (view.title(c.engine), c.setting, c.timestep, p.cost) for c, p in probes.values() if p is not None
    ]
    return probe.csv_of(costs, machine)


def _page(view: FieldView, figures: list[dict[str, Any]], probes: dict[str, probe.Probe | None]) -> str:
    return render(
        "field.html",
        title="Engines side by side",
        view=view,
        headline=headline(view),
        figures={figure["name"]: figure for figure in figures},
        best=[_table(view, gravity, partial(_best_entry, view)) for gravity in view.gravities],
        stock=[_table(view, gravity, partial(_stock_entry, view)) for gravity in view.gravities],
        energy=[
            (view.title(engine), _energy(view, engine), matrix.energy_note(engine)) for engine in view.engines
        ],
        matrix=matrix.matrix(view, probes),
        columns=matrix.COLUMNS,
        settings=_settings(view),
        missing=list(view.study["missing"]),
        add_commands=add_commands,
        steps=[(time(h), band(view, h), number(view.constant_error(h))) for h in view.steps],
    )


def _table(view: FieldView, gravity: float, entry: Any) -> dict[str, Any]:
    """A row an engine, a cell a step."""
    where = f"under gravity, {gravity:g} m/s²" if gravity else "without gravity"
    rows = [(view.title(e), [entry(e, gravity, h) for h in view.steps]) for e in view.engines]
    downs = [any(cells[i].down for _, cells in rows) for i in range(len(view.steps))]
    return {"where": where, "rows": rows, "downs": downs}


def _best_entry(view: FieldView, engine: str, gravity: float, timestep: float) -> Entry:
    case, tried = view.best(engine, gravity, timestep), view.cases(engine, gravity, timestep)
    least = math.inf if case is None else view.error(case)
    nearer = [other for other in tried if math.isinf(view.error(other)) and view.off(other) < least]
    notes = tuple(left_out(view, other) for other in nearer)
    if case is None:
        return Entry("–" if notes or not tried else "loses impacts", "", "none", notes=notes)
    grade = _grade(view, case)
    notes += () if view.follows_law(case) else view.not_run(engine, gravity, timestep)
    grew = "" if grade == "bad" else f"energy never grew in {view.scenes(case)} launches"
    return Entry(number(least), case.setting, grade, _down(view, case), grew, notes)


def _down(view: FieldView, case: Case) -> str:
    below = view.stays_down(case)
    return "" if not below else "at all speeds" if math.isinf(below) else f"below {below:.3g} m/s"


def _stock_entry(view: FieldView, engine: str, gravity: float, timestep: float) -> Entry:
    case = view.stock(engine, gravity, timestep)
    if case is None:
        return Entry("–", "", "none")
    low, high = view.restitution(case)
    text = view.lost(case) or ("no bounce" if high < _SEEN else span(f"{low:.2f}", f"{high:.2f}"))
    gains = "; gains energy" if view.gains(case) else ""
    kept = "" if view.lost(case) or high < _SEEN else f"keeps {_height(low, high)}{gains}"
    return Entry(text, kept, _grade(view, case))


def _height(low: float, high: float) -> str:
    """The share of its height that a body keeps, at the least and the largest e."""
    return f"{span(f'{100 * low**2:.3g}', f'{100 * high**2:.3g}')} % of the height"


def _energy(view: FieldView, engine: str) -> list[Entry]:
    """The largest e of the engine with nothing set, of its own settings, and of plug-ins."""
    groups: dict[str, list[Case]] = {"stock": [], "own": [], "plug-in": []}
    for case in view.scores:
        recipe = view.recipe(case)
        if case.engine == engine and recipe is not None and math.isfinite(view.restitution(case)[1]):
            kind = "stock" if case.setting == "stock" else "own" if recipe.native else "plug-in"
            groups[kind].append(case)
    return [_largest(view, cases) for cases in groups.values()]


def _largest(view: FieldView, cases: list[Case]) -> Entry:
    case = max(cases, key=lambda case: view.restitution(case)[1], default=None)
    if case is None:
        return Entry("–", "", "none")
    largest, gains = view.restitution(case)[1], view.gains(case)
    where = f"{case.setting}, {time(case.timestep)}{', under gravity' if case.gravity else ''}"
    return Entry(number(largest), f"keeps {_height(largest, largest)}; {where}", "bad" if gains else "none")


def _grade(view: FieldView, case: Case) -> str:
    error = view.error(case)
    if view.follows_law(case):
        return "good"
    return "even" if error <= 1.25 * view.constant_error(case.timestep) else "bad"


def _settings(view: FieldView) -> list[dict[str, Any]]:
    """What to paste of each engine's best setting at each step, without gravity; one text once."""
    entries = []
    for engine in view.engines:
        if registry.base_name(engine) in view.engines[: view.engines.index(engine)]:
            continue  # another version of it has told
        texts: dict[tuple[str, str], list[float]] = {}
        notes: dict[str, tuple[str, ...]] = {}
        for h in view.steps:
            case = view.best(engine, view.gravities[0], h)
            if case is not None:
                text = snippet(_setting(view, case), "plane")
                texts.setdefault((case.setting, text), []).append(h)
                recipe = view.recipe(case)
                notes[case.setting] = (recipe.summary, *recipe.notes) if recipe else ()
        pasted = [
            {"title": f"{name}, {' and '.join(map(time, hs))}", "text": text}
            for (name, text), hs in texts.items()
        ]
        entries.append({"title": view.title(engine), "texts": pasted, "notes": notes})
    return [entry for entry in entries if entry["texts"]]
