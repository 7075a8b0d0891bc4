"""The page's tables as rows of text; the template only lays them out."""

import math
from collections.abc import Mapping
from typing import Any, TypeAlias, cast

from hcbench.benchmark.bounce_sequence import RestAfterDrop
from hcbench.reporting import wording
from hcbench.reporting.advised import error_of, scenes_of
from hcbench.reporting.conditions import Views
from hcbench.reporting.drawings import class_heading
from hcbench.reporting.ranking import error_ratio, grade, lacks, lies_still, over_constant, verdict
from hcbench.reporting.view import REFERENCE, RunKey, View
from hcbench.scoring import CLAIMS
from hcbench.setting import Setting
from hcbench.tuning.snippet import snippet
from hcbench.units import INCH

Cells: TypeAlias = dict[str, Any]
_MARKS = {"good": "✓", "even": "=", "bad": "✗"}
_AGAINST_CONSTANT = {"good": "better than", "even": "as good as", "bad": "worse than"}
LONG = 7  # lines of what to paste, from where on it is folded
_PERCENT = ("loop_rms", "touch_force", "tension_share")


def ranking(view: View, with_gravity: View | None = None) -> list[Cells]:
    """Band runs in groups, best first: error for each α against the best constant e, loop or rest, verdict.

    Under gravity a group is a step, without it a class of steps. with_gravity: the same study under gravity,
    for what a setting lacks there.
    """
    runs = [run for run in view.band_runs if run.engine != REFERENCE]
    if view.gravity:
        steps = sorted({run.timestep for run in runs})
        groups = [
            (f"Step {wording.time(h)}, {view.band_text(h)}", [r for r in runs if r.timestep == h])
            for h in steps
        ]
    else:
        classes = [(c, [r for r in runs if view.resolves_contact(r) == c]) for c in (False, True)]
        groups = [(class_heading(view, resolved), of_class) for resolved, of_class in classes]
    ranked = []
    for heading, group in groups:
        # Ties stay in the study's order.
        group.sort(key=lambda run: (bool(lacks(view, run)), round(error_ratio(view, run), 3)))
        rows = [_ranking_row(view, run, with_gravity) for run in group]
        ranked.append({"heading": heading, "lines": lines_to_beat(view, group), "rows": rows})
    return [group for group in ranked if group["rows"]]


def _ranking_row(view: View, run: RunKey, with_gravity: View | None) -> Cells:
    score, rest = view.score(run) or {}, view.rests.get(run)
    loop = wording.percent(score["loop_rms"]) if score.get("loops") else "–"
    outcome = verdict(view, run)
    spoilt = wording.listed(lacks(with_gravity, run)) if with_gravity is not None else ""
    spoilt = f"under gravity {spoilt}" if spoilt else ""
    still = "comes to rest" if rest is not None and not outcome.lacks else ""
    scenes = scenes_of(view, run) if outcome.grade != "bad" else 0  # no praise without it
    energy = f"energy never grew in {scenes} launches and drops" if scenes else ""
    return {
        "run": run,
        "errors": [_error_cell(view, run, alpha) for alpha in view.alphas],
        "loop": loop if not view.gravity else wording.length(view.depths.get(run, math.nan)),
        "spread": wording.number(score.get("phase_spread", math.nan)),
        "steps": _depth_at_rest(view, run, rest) if view.gravity else score.get("samples_min", "–"),
        "verdict": outcome,
        "also": "; ".join(
            filter(None, [*outcome.lacks, still, energy] if view.gravity else [outcome.loop, energy, spoilt])
        ),
    }


def _depth_at_rest(view: View, run: RunKey, rest: RestAfterDrop | None) -> str:
    return wording.length(rest.depth) if rest is not None and lies_still(view, run) else "–"


def _error_cell(view: View, run: RunKey, alpha: float) -> Cells:
    error = error_of(view, run, alpha)
    if not math.isfinite(error):
        return {"text": "–", "grade": "none", "mark": "", "words": "not run"}
    against = grade(view, over_constant(view, run, alpha))
    return {
        "text": wording.error(error),
        "grade": against,
        "mark": _MARKS[against],
        "words": f"{_AGAINST_CONSTANT[against]} the best constant",
    }


def lines_to_beat(view: View, runs: list[RunKey]) -> list[str]:
    """The best constant's largest error for each α, over what these runs were sent at."""
    lines = []
    for alpha in view.alphas:
        score = next((s for run in runs if (s := view.score(run, alpha)) is not None), None)
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


def settings(by_gravity: Views) -> list[Cells]:
    """How each setting was set: one entry a setting, one text to paste for each place, step and α.

    Those under gravity come first; a text that is the same in several places stands once.
    """
    entries: dict[tuple[str, str], Cells] = {}
    texts: dict[tuple[str, str], dict[str, Cells]] = {}
    several = len(by_gravity.shown) > 1
    for view in by_gravity.shown:
        for record in view.results.settings:
            run = view.run_of(record)
            if run not in view.band_runs or run.engine == REFERENCE:
                continue
            key = run.engine, run.label
            notes = list(record.get("notes", []))
            entries.setdefault(key, {"run": run, "summary": record["summary"], "notes": notes})
            # A reader has a ball on a floor, even where the study has a cup.
            text = snippet(Setting(*run[:3], record["options"]), "plane")
            new = {"text": text, "step": run.timestep, "gravity": view.gravity, "alphas": [], "of": []}
            stated = texts.setdefault(key, {}).setdefault(f"{run.timestep} {text}", new)
            stated["alphas"].append(float(record["alpha_s_per_m"]))
            stated["of"].append((view.gravity, run, stated["alphas"][-1]))
    for key, entry in entries.items():
        entry["texts"] = sorted(
            (_text(by_gravity.main, several, **text) for text in texts[key].values()),
            key=lambda text: not text["main"],
        )
    pasted = [text for entry in entries.values() for text in entry["texts"] if text["text"]]
    for number, each in enumerate(pasted, 1):
        each["id"] = f"paste-{number}"
    return list(entries.values())


def _text(
    view: View, several: bool, text: str, step: float, gravity: float, alphas: list[float], of: list[Any]
) -> Cells:
    different = list(dict.fromkeys(alphas))
    every = len(different) == len(view.alphas) > 1
    which = "every α" if every else wording.listed([wording.alpha_short(a) for a in different])
    main = any(math.isclose(a, view.main_alpha, rel_tol=1e-9) for a in alphas)
    where = (", for gravity" if gravity else ", without gravity") if several else ""
    title = f"step {wording.time(step)}, {which}{where}"
    return {"text": text, "title": title, "main": main, "of": of, "lines": text.count("\n") + 1}


def failed_impacts(by_gravity: Views) -> list[Cells]:
    """Impacts without a bounce, counted by gravity, setting and what became of them."""
    return [row for view in by_gravity.shown for row in _failed(view, len(by_gravity.shown) > 1)]


def _failed(view: View, several: bool) -> list[Cells]:
    impacts = view.results.impacts
    failed = impacts[impacts["status"] != "parted"].groupby(
        ["scene", "engine", "setting", "status"], sort=False
    )
    rows = []
    for key, group in failed:
        steps = sorted({float(h) for h in group["timestep_s"]})
        run = view.run_of({**group.iloc[0].to_dict(), "timestep_s": steps[0]})
        text = f"{len(steps)} steps, {wording.time(steps[0])} … {wording.time(steps[-1])}"
        reasons = list(dict.fromkeys(str(reason or "") for reason in group["reason"]))
        more = f"; and {len(reasons) - 1} more like it" if len(reasons) > 1 else ""
        where = ("under gravity" if view.gravity else "without gravity") if several else ""
        rows.append(
            {
                "run": run,
                "steps": ", ".join(filter(None, [text if len(steps) > 1 else run.step, where])),
                "status": str(cast("tuple[Any, ...]", key)[-1]),
                "impacts": len(group),
                "reason": reasons[0] + more,
            }
        )
    return rows
