"""Table of the engines' features: each cell from the run, or from the engine's own folder with its
source.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING

from hcbench.reporting.field.view import NO_BOUNCE
from hcbench.reporting.wording import NBSP
from hcbench.sim import registry
from hcbench.sim.capabilities import DescribesContact, Feature, Features

if TYPE_CHECKING:
    from hcbench.reporting.field.probe import Probe
    from hcbench.reporting.field.view import FieldView

RUN = "this run"
_FOLDER = "hcbench's adapter"
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
    if not isinstance(adapter, DescribesContact) or adapter.features is None:
        return None
    return adapter.features.energy


def features(
    view: FieldView, probes: Mapping[str, Probe | None]
) -> list[tuple[str, list[Feature]]]:
    """(engine, its cells in the order of FEATURES).

    probes: by engine.
    """
    return [(engine, _cells(view, engine, probes.get(engine))) for engine in view.engines]


def _cells(view: FieldView, engine: str, probe: Probe | None) -> list[Feature]:
    """Cells of an engine, in the order of FEATURES."""
    base = registry.base_name(engine)
    adapter = registry.adapter(base)
    # An engine that steps another's models has that engine's contact, except what its notes say.
    contact = registry.adapter(getattr(adapter, "model_engine", base))
    cells: dict[str, Feature] = {}
    if isinstance(contact, DescribesContact) and contact.features is not None:
        for field in fields(Features):
            stated = getattr(contact.features, field.name)
            if stated is not None:
                cells[field.name] = stated
    nothing = Feature("–", "")
    cells["numbers"] = Feature(f"float{adapter.bits}", _FOLDER)
    # Without a probe nothing ran here that could be the source.
    source = ""
    if probe is not None:
        source = RUN
    cells["bits"] = Feature(_bits(probe), source)
    cells["threshold"] = _threshold(cells.get("threshold", nothing), _slowest_bounce(view, engine))
    return [cells.get(name, nothing) for name in FEATURES]


def _threshold(stated: Feature, seen: str) -> Feature:
    """Slowest bounce: the stated one, followed by the one seen in this run."""
    if not seen:
        return stated
    return Feature(
        f"{stated.text}; {seen}".removeprefix("–; "), f"{stated.source}; {RUN}".strip("; ")
    )


def _bits(probe: Probe | None) -> str:
    """Cell on whether a run repeats to the bit."""
    if probe is None:
        return "–"
    if not probe.repeats:
        return "no"
    if probe.alone:
        return "yes, alone or together"
    return "yes; alone others"


def _slowest_bounce(view: FieldView, engine: str) -> str:
    """From which speed on the engine bounces with nothing set, at the step of 1 ms or the nearest.

    "" where it did not run so, or bounces at every speed.
    """
    gravity = view.gravities[0]
    steps = [step for step in view.steps if view.stock(engine, gravity, step)]
    if not steps:
        return ""
    nearest = min(steps, key=lambda step: abs(math.log(step / 1e-3)))
    case = view.stock(engine, gravity, nearest)
    assert case is not None
    curve = view.curve(case)
    bounces = curve.speed[curve.highest >= NO_BOUNCE]
    if not len(bounces):
        return "nothing set: at no speed"
    slowest = float(bounces.min())
    lowest = float(view.speeds(case.timestep)[0])
    if slowest <= lowest * (1 + 1e-9):
        return ""
    return f"nothing set: {slowest:.2g}{NBSP}m/s"
