"""The table of features: each cell from the run, or from the engine's own folder with its source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from hcbench.reporting.field.view import NO_BOUNCE, has_law
from hcbench.reporting.wording import NBSP, listed, number, percent, time
from hcbench.sim import registry
from hcbench.sim.capabilities import DescribesContact, Feature, Features, OpensModels

if TYPE_CHECKING:
    from hcbench.reporting.field.probe import Probe
    from hcbench.reporting.field.view import Case, FieldView

RUN, _FOLDER = "this run", "hcbench's adapter"
_AREA = 0.02  # of the energy lost: how far off the area of a loop may be that says something
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


def energy_note(engine: str) -> Feature | None:
    """What is known of an e above 1 in an engine, from its folder."""
    adapter = registry.adapter(registry.base_name(engine))
    features = adapter.features if isinstance(adapter, DescribesContact) else None
    return None if features is None else features.energy


def matrix(view: FieldView, probes: Mapping[str, Probe | None]) -> list[tuple[str, list[Feature]]]:
    """(engine, its cells in the order of COLUMNS). probes: by engine."""
    return [(engine, _cells(view, engine, probes.get(engine))) for engine in view.engines]


def _cells(view: FieldView, engine: str, probe: Probe | None) -> list[Feature]:
    base = registry.base_name(engine)
    adapter = registry.adapter(base)
    # An engine that steps another's models has that engine's contact, except what its notes say.
    contact = registry.adapter(getattr(adapter, "model_engine", base))
    stated: dict[str, Feature] = {}
    if isinstance(contact, DescribesContact) and contact.features is not None:
        named = [f.name for f in fields(Features)]
        stated = {name: one for name in named if (one := getattr(contact.features, name)) is not None}
    files = listed([*adapter.suffixes, *adapter.opens]) if isinstance(adapter, OpensModels) else "–"
    from_run = {
        "by_speed": _by_speed(view, engine),
        "loop": _loop(view, engine),
        "numbers": Feature(f"float{adapter.bits}", _FOLDER),
        "bits": Feature(_bits(probe), RUN if probe else ""),
        "threshold": stated.get("threshold", Feature("–", "")),
        "files": Feature(files, _FOLDER),
    }
    seen = _slowest_bounce(view, engine)
    if seen:
        threshold = from_run["threshold"]
        from_run["threshold"] = Feature(
            f"{threshold.text}; {seen}".removeprefix("–; "), f"{threshold.source}; {RUN}".strip("; ")
        )
    return [{**stated, **from_run}.get(name, Feature("–", "")) for name in COLUMNS]


def _by_speed(view: FieldView, engine: str) -> Feature:
    """The best of its settings that should follow the law, its own and plug-ins."""
    words = []
    for native, how in ((True, "its own"), (False, "plug-in")):
        candidates = [
            case
            for h in view.steps
            for case in view.cases(engine, view.gravities[0], h, native)
            if has_law(view.recipe(case)) and np.isfinite(view.error(case))
        ]
        if candidates:
            case = min(candidates, key=view.error)
            words.append(f"{how}: {case.setting}, {number(view.error(case))} at {time(case.timestep)}")
    return Feature("; ".join(words) or "no", RUN)


def _loop(view: FieldView, engine: str) -> Feature:
    """How near the loop's area is to the energy lost, of the best resolved case."""
    seen = [case for case in view.loops if case.engine == engine and view.scores[case]["loops"]]
    off = min((_area_error(view, case) for case in seen), default=1.0)
    if off > _AREA:
        return Feature("no: a step holds a whole bounce" if not seen else "no: it is not the force", RUN)
    return Feature(f"yes: its area is the energy lost within {percent(max(off, 1e-12))}", RUN)


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
    """From which speed on the engine bounces with nothing set, at the step of 1 ms or the nearest."""
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
        return "nothing set: at no speed"
    slowest, lowest = float(bounces.index.min()), float(view.speeds(case.timestep)[0])
    return "" if slowest <= lowest * (1 + 1e-9) else f"nothing set: {slowest:.2g}{NBSP}m/s"
