"""Table of the engines' features: each cell from the run, or from the engine's own folder with its
source.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from hcbench.reporting.field.view import NO_BOUNCE
from hcbench.reporting.wording import NBSP
from hcbench.sim import registry
from hcbench.sim.capabilities import DescribesContact, Feature, Features

if TYPE_CHECKING:
    from hcbench.reporting.field.probe import Probe
    from hcbench.reporting.field.view import FieldView

RUN, _FOLDER = "this run", "hcbench's adapter"
FEATURES = {
    "law": "its own law",
    "exponent": "exponent",
    "threshold": "bounces from",
    "numbers": "numbers",
    "bits": "same bits again",
    "licence": "licence",
}


def energy_note(engine: str) -> Feature | None:
    """Note on an e above 1 in an engine, from the engine's folder; None without one."""
    adapter = registry.adapter(registry.base_name(engine))
    features = adapter.features if isinstance(adapter, DescribesContact) else None
    return None if features is None else features.energy


def features(view: FieldView, probes: Mapping[str, Probe | None]) -> list[tuple[str, list[Feature]]]:
    """(engine, its cells in the order of FEATURES). probes: by engine."""
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
    from_run = {
        "numbers": Feature(f"float{adapter.bits}", _FOLDER),
        "bits": Feature(_bits(probe), RUN if probe else ""),
        "threshold": _threshold(stated.get("threshold", Feature("–", "")), _slowest_bounce(view, engine)),
    }
    return [{**stated, **from_run}.get(name, Feature("–", "")) for name in FEATURES]


def _threshold(stated: Feature, seen: str) -> Feature:
    """Slowest bounce: the stated one, followed by the one seen in this run."""
    if not seen:
        return stated
    return Feature(f"{stated.text}; {seen}".removeprefix("–; "), f"{stated.source}; {RUN}".strip("; "))


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
    bounces = curve.speed[curve.highest >= NO_BOUNCE]
    if not len(bounces):
        return "nothing set: at no speed"
    slowest, lowest = float(bounces.min()), float(view.speeds(case.timestep)[0])
    return "" if slowest <= lowest * (1 + 1e-9) else f"nothing set: {slowest:.2g}{NBSP}m/s"
