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
    """Sentences that sort the engines at a step (s): those that follow the law by settings, by a
    plug-in, or not.

    gravity: m/s².
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

    timestep: s; gravity: m/s². kinds: of settings, such as PLUGIN.
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
    """Sentence on the differences between versions of an engine; "" if no engine ran in two."""
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
    """Largest |difference of e| in each case that both engines ran; NaN
    where an e is missing in all rows.
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
