"""Sentences of the field page: who follows the law at a step, and what a version changed."""

from __future__ import annotations

import math
from itertools import combinations
from typing import TYPE_CHECKING

from hcbench.reporting.field.view import OWN, PLUGIN
from hcbench.reporting.wording import engine_title, error, listed, sentence, span, time
from hcbench.sim import registry

if TYPE_CHECKING:
    from hcbench.reporting.field.view import FieldView

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
    """Sentences that sort the engines at a step: those that follow the law by settings, by a
    plug-in, or not.
    """
    ran = [e for e in view.engines if view.cases(e, gravity, timestep, *OWN, PLUGIN)]
    own = _following(view, ran, gravity, timestep, *OWN)
    plugin = [e for e in _following(view, ran, gravity, timestep, PLUGIN) if e not in own]
    others = [e for e in _bases(ran) if e not in (*own, *plugin)]
    where = f"At {time(timestep)} {'under' if gravity else 'without'} gravity"
    follow = "follows" if len(own) < 2 else "follow"
    engines = (
        f"{_count(own)} {'engine' if len(own) == 1 else 'engines'} {follow}" if own else "no engine follows"
    )
    sentences = [f"{where}, {engines} the law by settings alone{_named(own)}."]
    if plugin:
        more = " more" if own else ""
        sentences.append(
            f"With a plug-in, {_count(plugin)}{more} {'do' if len(plugin) > 1 else 'does'}{_named(plugin)}."
        )
    if others:
        sentences.append(
            f"No setting that was run here follows it in {listed([*map(engine_title, others)], 'or')}."
        )
    return sentences


def _following(
    view: FieldView, engines: list[str], gravity: float, timestep: float, *kinds: str
) -> list[str]:
    """Engines whose best setting of some kinds follows the law, by their names without versions."""
    best = {engine: view.best(engine, gravity, timestep, *kinds) for engine in engines}
    return _bases([engine for engine, case in best.items() if case is not None and view.follows_law(case)])


def _bases(engines: list[str]) -> list[str]:
    return list(dict.fromkeys(registry.base_name(engine) for engine in engines))


def _count(engines: list[str]) -> str:
    return _WORDS[len(engines)] if len(engines) < len(_WORDS) else str(len(engines))


def _named(engines: list[str]) -> str:
    return f": {listed([engine_title(engine) for engine in engines])}" if engines else ""


def band(view: FieldView, timestep: float) -> str:
    """The impact speeds at a step: "0.0254 … 0.508 m/s"."""
    speeds = view.speeds(timestep)
    return f"{span(f'{speeds[0]:.3g}', f'{speeds[-1]:.3g}')} m/s"


def versions(view: FieldView) -> str:
    """Sentence on the differences between versions of an engine; "" if no engine ran in two."""
    words = []
    for one, other in combinations(view.engines, 2):
        if registry.base_name(one) != registry.base_name(other):
            continue
        differences = [
            float((a["restitution"] - b["restitution"].to_numpy()).abs().max())
            for case, a in view.impacts.items()
            if case.engine == one and (b := view.impacts.get(case._replace(engine=other))) is not None
        ]
        largest = max((d for d in differences if math.isfinite(d)), default=math.nan)
        runs = f"{len(differences)} runs"
        off = (
            f"bounce alike in all {runs}"
            if largest == 0.0
            else f"differ in e by up to {error(largest)} over {runs}"
        )
        words.append(f"{view.title(one)} and {view.title(other)} {off}")
    return sentence(f"{'; '.join(words)}.") if words else ""
