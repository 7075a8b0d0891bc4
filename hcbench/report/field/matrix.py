"""The table of features: each cell from the run, or from the engine's own folder with its source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from hcbench.report.field.view import NO_BOUNCE, has_law
from hcbench.report.wording import NBSP, listed, number, percent, time
from hcbench.sim import registry
from hcbench.sim.features import Features

if TYPE_CHECKING:
    from hcbench.report.field.probe import Probe
    from hcbench.report.field.view import Case, FieldView

RUN = "this run"
COLUMNS = {
    "law": "its own law",
    "exponent": "exponent",
    "by_speed": "e(v) or the law",
    "loop": "loop readable",
    "numbers": "numbers",
    "bits": "same bits again",
    "threshold": "bounces from",
    "files": "opens",
    "licence": "licence",
}


@dataclass(frozen=True, slots=True)
class Cell:
    """What is in a cell, and where it is from."""

    text: str
    source: str


def matrix(view: FieldView, probes: Mapping[str, Probe | None]) -> list[tuple[str, list[Cell]]]:
    """(engine, its cells in the order of COLUMNS). probes: by engine."""
    return [(engine, _cells(view, engine, probes.get(engine))) for engine in view.engines]


def _cells(view: FieldView, engine: str, probe: Probe | None) -> list[Cell]:
    base = registry.base_name(engine)
    module, adapter = registry.submodule(base, "features"), registry.engine(base)
    said: dict[str, Cell] = {}
    if module is not None and isinstance(module.FEATURES, Features):
        said = {f.name: Cell(**_of(getattr(module.FEATURES, f.name))) for f in fields(Features)}
    files = listed([*adapter.suffixes, *adapter.opens]) or "–"
    from_run = {
        "by_speed": _by_speed(view, engine),
        "loop": _loop(view, engine),
        "numbers": Cell(f"float{adapter.bits}", "the contract of its folder"),
        "bits": Cell(_bits(probe), RUN if probe else ""),
        "threshold": said.get("threshold", Cell("–", "")),
        "files": Cell(files, "the contract of its folder"),
    }
    seen = _slowest_bounce(view, engine)
    if seen:
        stated = from_run["threshold"]
        from_run["threshold"] = Cell(
            f"{stated.text}; {seen}".removeprefix("–; "), f"{stated.source}; {RUN}".strip("; ")
        )
    return [{**said, **from_run}.get(name, Cell("–", "")) for name in COLUMNS]


def _of(feature: object) -> dict[str, str]:
    return {"text": feature.text, "source": feature.source}  # type: ignore[attr-defined]


def _by_speed(view: FieldView, engine: str) -> Cell:
    """The best of its settings that are meant to follow the law, its own and put in."""
    words = []
    for native, how in ((True, "its own"), (False, "put in")):
        found = [
            case
            for h in view.steps
            for case in view.cases(engine, view.gravities[0], h, native)
            if has_law(view.recipe(case)) and np.isfinite(view.error(case))
        ]
        if found:
            case = min(found, key=view.error)
            words.append(f"{how}: {case.setting}, {number(view.error(case))} at {time(case.timestep)}")
    return Cell("; ".join(words) or "no", RUN)


def _loop(view: FieldView, engine: str) -> Cell:
    """How near the loop's area is to the energy lost, of the case seen best."""
    least, best = 1.0, None
    for case, rows in view.loops.items():
        if case.engine == engine and len(rows) > 3 and (off := _area_error(view, case)) < least:
            least, best = off, case
    if best is None:
        return Cell("no: turned in a step", RUN)
    return Cell(f"yes, its area is the energy lost to {percent(max(least, 1e-12))}", RUN)


def _area_error(view: FieldView, case: Case) -> float:
    rows = view.loops[case]
    x, force = (rows[name].to_numpy(dtype=float) for name in ("penetration_m", "force_n"))
    x, force = np.concatenate([[0.0], x, [0.0]]), np.concatenate([[0.0], force, [0.0]])
    area = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(x)))
    impact = view.impacts[case]
    here = impact[np.isclose(impact["speed_m_per_s"].astype(float), view.study["step_speed"], rtol=1e-9)]
    lost = (
        0.5 * float(view.study["mass_kg"]) * (here["speed_in_m_per_s"] ** 2 - here["speed_out_m_per_s"] ** 2)
    )
    return abs(area - float(lost.median())) / max(float(lost.median()), 1e-12)


def _bits(probe: Probe | None) -> str:
    if probe is None:
        return "–"
    return {(True, True): "yes, alone or together", (True, False): "yes; alone others"}.get(
        (probe.repeats, probe.alone), "no"
    )


def _slowest_bounce(view: FieldView, engine: str) -> str:
    """From which speed on the engine as it comes bounces, at the step of 1 ms or the nearest."""
    near = [h for h in view.steps if view.stock(engine, view.gravities[0], h)]
    case = (
        view.stock(engine, view.gravities[0], min(near, key=lambda h: abs(np.log(h / 1e-3))))
        if near
        else None
    )
    if case is None:
        return ""
    curve = view.curve(case)
    bounces = curve[curve["high"] >= NO_BOUNCE] if len(curve) else curve
    if not len(bounces):
        return "as it comes at no speed"
    slowest = float(bounces.index.min())
    return "" if slowest <= float(view.speeds[0]) * (1 + 1e-9) else f"as it comes {slowest:.2g}{NBSP}m/s"
