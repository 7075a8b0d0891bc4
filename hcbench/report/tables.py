"""The page's tables as rows of text; the template only lays them out."""

import math
from collections.abc import Mapping
from typing import Any, TypeAlias, cast

from hcbench.report import wording
from hcbench.report.drawings import class_heading
from hcbench.report.ranking import error_ratio, grade, over_constant, verdict
from hcbench.report.view import REFERENCE, RunKey, View, run_of_record
from hcbench.scoring import CLAIMS
from hcbench.setting import Setting
from hcbench.tune.snippet import snippet
from hcbench.units import INCH

Cells: TypeAlias = dict[str, Any]
_MARKS = {"good": "✓", "even": "=", "bad": "✗"}
_AGAINST_CONSTANT = {"good": "better than", "even": "as good as", "bad": "worse than"}
_PERCENT = ("loop_rms", "touch_force", "tension_share")


def ranking(view: View) -> list[Cells]:
    """Band runs in classes of step, best first: error for each α against the line to beat, loop, verdict."""
    groups = []
    for resolved in (False, True):
        runs = [
            run
            for run in view.band_runs
            if view.resolves_contact(run) == resolved and run.engine != REFERENCE
        ]
        runs.sort(key=lambda run: round(error_ratio(view, run), 3))  # ties stay in the study's order
        if runs:
            rows = [_ranking_row(view, run) for run in runs]
            groups.append({"heading": class_heading(view, resolved), "rows": rows})
    return groups


def _ranking_row(view: View, run: RunKey) -> Cells:
    score = view.score(run) or {}
    return {
        "run": run,
        "errors": [_error_cell(view.score(run, alpha)) for alpha in view.alphas],
        "loop": wording.percent(score["loop_rms"]) if score.get("loops") else "–",
        "spread": wording.number(score.get("phase_spread", math.nan)),
        "steps": score.get("samples_min", "–"),
        "verdict": verdict(view, run),
    }


def _error_cell(score: Mapping[str, Any] | None) -> Cells:
    if score is None or not math.isfinite(score["max_error_law"]):
        return {"text": "–", "grade": "none", "mark": "", "words": "not run"}
    against = grade(over_constant(score))
    return {
        "text": wording.number(score["max_error_law"]),
        "grade": against,
        "mark": _MARKS[against],
        "words": f"{_AGAINST_CONSTANT[against]} the best constant",
    }


def lines_to_beat(view: View) -> list[str]:
    """The best constant's largest error for each α."""
    lines = []
    for alpha in view.alphas:
        scores = (view.score(run, alpha) for run in view.band_runs)
        score = next((s for s in scores if s is not None), None)
        lines.append(wording.number(score["constant_error_law"]) if score is not None else "–")
    return lines


def claims(view: View) -> list[Cells]:
    """The paper's claims for each run over a band, the law's too: over all α, the worst answer counts."""
    return [
        {
            "run": run,
            "cells": [_claim_cell([_tristate(s[claim]) for s in view.scores(run)]) for claim in CLAIMS],
        }
        for run in view.tabled_runs
    ]


def _tristate(value: Any) -> bool | None:
    """True, False or None, whether it comes from memory or was read back from a file."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return None
    return value == "True" if isinstance(value, str) else bool(value)


def _claim_cell(answers: list[bool | None]) -> Cells:
    judged = [answer for answer in answers if answer is not None]
    if not judged:
        return {"mark": "–", "words": "not resolved", "grade": "none"}
    if all(judged):
        return {"mark": "✓", "words": "pass", "grade": "good"}
    share = f" for {judged.count(False)} of {len(judged)} α" if any(judged) else ""
    return {"mark": "✗", "words": f"fail{share}", "grade": "bad"}


def score_cell(score: Mapping[str, Any], column: str) -> str:
    """One score of a run, as text."""
    value = score[column]
    if column == "energy_gained":
        return "yes" if _tristate(value) else "no"
    if column in ("samples_min", "loops"):
        return str(value)
    if column in _PERCENT:
        return wording.percent(value)
    if column == "energy_exponent" and math.isfinite(value):
        return f"{value:.2f}"
    return wording.number(value * INCH if column == "alpha_fit" else value)


def settings(view: View) -> list[Cells]:
    """How each setting was set: one entry a setting, one text to paste for each step and α it ran over."""
    entries: dict[tuple[str, str], Cells] = {}
    alphas: dict[tuple[str, str], dict[tuple[float, str], list[float]]] = {}
    form, radius = str(view.study["form"]), float(view.study["relative_radius_m"])
    for record in view.results.settings:
        run = run_of_record(record)
        if run not in view.band_runs or run.engine == REFERENCE:
            continue
        key = run.engine, run.setting
        notes = list(record.get("notes", []))
        entries.setdefault(key, {"run": run, "summary": record["summary"], "notes": notes})
        text = snippet(Setting(*run, record["options"]), form, radius)
        of_text = alphas.setdefault(key, {}).setdefault((run.timestep, text), [])
        of_text.append(float(record["alpha_s_per_m"]))
    for key, entry in entries.items():
        texts = [_text(view, step, text, of_text) for (step, text), of_text in alphas[key].items()]
        entry["texts"] = sorted(texts, key=lambda text: not text["main"])
    return list(entries.values())


def _text(view: View, timestep: float, text: str, alphas: list[float]) -> Cells:
    every = len(alphas) == len(view.alphas) > 1
    which = "every α" if every else wording.listed([wording.alpha_short(a) for a in alphas])
    main = any(math.isclose(a, view.main_alpha, rel_tol=1e-9) for a in alphas)
    return {"text": text, "title": f"step {wording.time(timestep)}, {which}", "main": main}


def failed_impacts(view: View) -> list[Cells]:
    """Impacts without a bounce, counted by setting and what became of them."""
    impacts = view.results.impacts
    failed = impacts[impacts["status"] != "parted"].groupby(["engine", "setting", "status"], sort=False)
    rows = []
    for key, group in failed:
        engine, setting, status = (str(part) for part in cast("tuple[Any, ...]", key))
        steps = sorted({float(h) for h in group["timestep_s"]})
        run = RunKey(engine, setting, steps[0])
        several = f"{len(steps)} steps, {wording.time(steps[0])} … {wording.time(steps[-1])}"
        reasons = list(dict.fromkeys(str(reason or "") for reason in group["reason"]))
        more = f"; and {len(reasons) - 1} more like it" if len(reasons) > 1 else ""
        rows.append(
            {
                "run": run,
                "steps": several if len(steps) > 1 else run.step,
                "status": status,
                "impacts": len(group),
                "reason": reasons[0] + more,
            }
        )
    return rows
