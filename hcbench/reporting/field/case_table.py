"""The cases on the page: which engines pass them, whose restitution
is obeyed, and why a case fails.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from hcbench.cases.score import EngineScore, regressions
from hcbench.reporting.field.cells import MatrixCell
from hcbench.reporting.wording import NBSP, engine_title, listed

_VERDICTS = {
    "pass": ("pass", "good"),
    "fail": ("fail", "bad"),
    "error": ("error", "bad"),
    "unsupported": ("–", "none"),
}
# Fate of the restitution that is asked for: in a cell, its grade, and in a sentence.
_OBEDIENCE = {
    "obeyed": ("obeyed", "good", "obeyed by {}"),
    "threshold": ("above {}", "even", "obeyed above some speed by {}"),
    "mixed": ("in part", "bad", "obeyed in part by {}"),
    "ignored": ("ignored", "bad", "ignored by {}"),
}


@dataclass(frozen=True, slots=True)
class CaseTable:
    """Verdicts of the conformance cases on each engine.

    titles: of the cases, by id.
    rows: of each engine its name and cells.
    why: id -> engine -> reason.
    changes: what another version of an engine changed.
    """

    sentence: str
    titles: dict[str, str]
    rows: Sequence[tuple[str, Sequence[MatrixCell]]]
    why: dict[str, dict[str, str]]
    changes: Sequence[str]


def case_table(scores: Sequence[EngineScore]) -> CaseTable:
    """The table of the engines that were measured: those that pass most
    first, versions in their order.
    """
    most: dict[str, int] = {}
    for one in scores:
        most[one.engine] = max(one.passed, most.get(one.engine, 0))
    ranked = sorted(scores, key=lambda one: (-most[one.engine], one.engine))
    titles: dict[str, str] = {}
    why: dict[str, dict[str, str]] = {}
    for one in ranked:
        for verdict in one.verdicts:
            case = verdict["case"]
            titles[case] = verdict["title"]
            reasons = why.setdefault(case, {})
            if verdict["why"]:
                reasons[_name(one)] = verdict["why"]
    rows = [(_name(one), list(_cells(one))) for one in ranked]
    return CaseTable(_sentence(ranked), titles, rows, why, regressions(scores))


def _name(one: EngineScore) -> str:
    return f"{_title(one)} {one.version}".strip()


def _title(one: EngineScore) -> str:
    title = engine_title(one.engine)
    return title[:1].upper() + title[1:]


def _sentence(scores: Sequence[EngineScore]) -> str:
    """Sentence that sorts the engines, in the last version of each, by their obedience to a set
    restitution.
    """
    last = {one.engine: one for one in scores}
    parts = []
    for word, (_, _, phrase) in _OBEDIENCE.items():
        engines = [_title(one) for one in last.values() if one.restitution == word]
        if engines:
            parts.append(phrase.format(listed(engines)))
    return f"The restitution that is set is {'; '.join(parts)}."


def _cells(one: EngineScore) -> Iterable[MatrixCell]:
    """Cells of one engine: its obedience, how many cases pass, then each verdict."""
    text, grade, _ = _OBEDIENCE.get(one.restitution or "", ("–", "none", ""))
    yield MatrixCell(text.format(f"{one.threshold:.2g}{NBSP}m/s"), grade=grade)
    yield MatrixCell(f"{one.passed} of {len(one.verdicts)}")
    for verdict in one.verdicts:
        text, grade = _VERDICTS[verdict["verdict"]]
        yield MatrixCell(text, grade=grade)
