"""The page's tables as plain rows; the template only lays them out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

from hcbench.report import findings, wording
from hcbench.report.figures import class_heading
from hcbench.report.view import REFERENCE, Run, View
from hcbench.scoring import CLAIMS, RESOLVED
from hcbench.setting import Setting
from hcbench.tune.snippet import paste

if TYPE_CHECKING:
    from collections.abc import Mapping

Row = dict[str, Any]
_GRADES = {"good": "✓", "even": "=", "bad": "✗"}
_STATUS = {
    "rested": "came to rest in contact",
    "no-touch": "never touched",
    "diverged": "diverged",
    "crashed": "its engine crashed",
}


def run_cell(view: View, run: Run) -> Row:
    """A run as the template names it: with the look that it has in the figures."""
    look = view.look(run)
    return {
        "engine": wording.engine_name(run.engine),
        "setting": run.setting,
        "step": wording.time(run.timestep),
        "colour": look.colour,
        "dashes": " ".join(f"{d:g}" for d in look.dashes),
    }


def ranking(view: View) -> list[Row]:
    """Band runs in classes of step, best first: error for each α against the line to beat, loop, verdict."""
    out = []
    for fine in (False, True):
        runs = [r for r in view.band_runs if view.is_fine(r) == fine and r.engine != REFERENCE]
        runs.sort(key=lambda run: round(findings.ratio(view, run), 3))  # ties stay in the study's order
        if runs:
            out.append(
                {"heading": class_heading(view, fine), "rows": [_ranking_row(view, run) for run in runs]}
            )
    return out


def _ranking_row(view: View, run: Run) -> Row:
    main = view.score(run, view.main_alpha) or {}
    said = findings.verdict(view, run)
    return {
        "run": run_cell(view, run),
        "errors": [_error_cell(view.score(run, alpha)) for alpha in view.alphas],
        "loop": wording.percent(main["loop_rms"]) if main.get("loops") else "–",
        "spread": wording.small(main.get("phase_spread", math.nan)),
        "steps": main.get("samples_min", "–"),
        "grade": said.grade,
        "verdict": said.restitution,
        "loop_verdict": said.loop,
    }


def _error_cell(score: Mapping[str, Any] | None) -> Row:
    if score is None or not math.isfinite(score["max_error_law"]):
        return {"text": "–", "grade": "none", "mark": "", "words": "not run"}
    grade = findings.grade(findings.over_line(score))
    meaning = {"good": "better than", "even": "as good as", "bad": "worse than"}[grade]
    return {
        "text": wording.small(score["max_error_law"]),
        "grade": grade,
        "mark": _GRADES[grade],
        "words": f"{meaning} the best constant",
    }


def lines_to_beat(view: View) -> list[str]:
    """The best constant's largest error for each α."""
    out = []
    for alpha in view.alphas:
        found = (view.score(run, alpha) for run in view.band_runs)
        score = next((s for s in found if s is not None), None)
        out.append(wording.small(score["constant_error_law"]) if score is not None else "–")
    return out


def claims(view: View) -> list[Row]:
    """The paper's claims for each run over a band, the law's too: over all α, the worst answer counts."""
    out = []
    for run in view.tabled_runs:
        scores = [s for s in (view.score(run, alpha) for alpha in view.alphas) if s is not None]
        cells = [_claim_cell([_tri(score[claim]) for score in scores]) for claim in CLAIMS]
        out.append({"run": run_cell(view, run), "cells": cells})
    return out


def _tri(value: Any) -> bool | None:
    """True, False or None, whether it comes from memory or was read back from a file."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return None
    return value == "True" if isinstance(value, str) else bool(value)


def _claim_cell(answers: list[bool | None]) -> Row:
    judged = [answer for answer in answers if answer is not None]
    if not judged:
        return {"mark": "–", "words": "not resolved", "grade": "none"}
    if all(judged):
        return {"mark": "✓", "words": "pass", "grade": "good"}
    share = "" if not any(judged) else f" for {judged.count(False)} of {len(judged)} α"
    return {"mark": "✗", "words": f"fail{share}", "grade": "bad"}


BOUNCE_COLUMNS = {
    "max_error_law": "largest error, law",
    "rms_error_law": "rms error, law",
    "constant_error_law": "best constant's, law",
    "max_error_linear": "largest error, 1 − αv",
    "rms_error_linear": "rms error, 1 − αv",
    "constant_error_linear": "best constant's, 1 − αv",
    "phase_spread": "spread over phases",
    "alpha_fit": "fitted α, s/in",
    "energy_exponent": "p of ΔE ∝ vᵖ",
    "energy_gained": "gains energy",
}
LOOP_COLUMNS = {
    "samples_min": "fewest steps in contact",
    "loops": "loops judged",
    "loop_rms": "rms of force",
    "area_ratio": "area / law's",
    "force_ratio": "force / law's",
    "penetration_ratio": "depth / law's",
    "duration_ratio": "duration / law's",
    "touch_force": "force at touch",
    "tension_share": "tension share",
}


def scores(view: View) -> list[Row]:
    """Every score of every band run: for each α, the main one first, a table of bounces and one of loops."""
    order = sorted(view.alphas, key=lambda a: (abs(a - view.main_alpha) > 1e-12, a))
    out = []
    for alpha in order:
        found = [(run, view.score(run, alpha)) for run in view.tabled_runs]
        tables = []
        for caption, columns in (("Bounce", BOUNCE_COLUMNS), ("Loop", LOOP_COLUMNS)):
            rows = [
                {"run": run_cell(view, run), "cells": [_score_cell(score, c) for c in columns]}
                for run, score in found
                if score is not None
            ]
            tables.append({"caption": caption, "columns": list(columns.values()), "rows": rows})
        out.append({"alpha": wording.alpha(alpha), "tables": tables})
    return out


def _score_cell(score: Mapping[str, Any], column: str) -> str:
    value = score[column]
    if column == "energy_gained":
        return "yes" if _tri(value) else "no"
    if column in ("samples_min", "loops"):
        return str(value)
    if column == "alpha_fit":
        value = value * wording.INCH
    if column.startswith("loop_") or column in ("touch_force", "tension_share"):
        return wording.percent(value)
    return f"{value:.2f}" if column == "energy_exponent" and math.isfinite(value) else wording.small(value)


def settings(view: View) -> list[Row]:
    """How each setting was set: one entry a setting, one text to paste for each step and α it ran over."""
    shown = set(view.band_runs)
    out: dict[tuple[str, str], Row] = {}
    for record in view.results.settings:
        run = Run(str(record["engine"]), str(record["setting"]), float(record["timestep_s"]))
        if run not in shown or run.engine == REFERENCE:
            continue
        entry = out.setdefault(
            (run.engine, run.setting),
            {
                "run": run_cell(view, run),
                "summary": record["summary"],
                "notes": list(record.get("notes", [])),
                "texts": {},
            },
        )
        setting = Setting(run.engine, run.setting, run.timestep, record["options"])
        key = run.timestep, paste(setting, str(view.study["form"]), float(view.study["relative_radius_m"]))
        entry["texts"].setdefault(key, []).append(float(record["alpha_s_per_m"]))
    for entry in out.values():
        texts = [_text(view, step, text, alphas) for (step, text), alphas in entry["texts"].items()]
        entry["texts"] = sorted(texts, key=lambda text: not text["main"])
    return list(out.values())


def _text(view: View, timestep: float, text: str, alphas: list[float]) -> Row:
    every = len(alphas) == len(view.alphas) > 1
    named = "every α" if every else wording.listed([wording.alpha_short(a) for a in alphas])
    main = any(math.isclose(a, view.main_alpha, rel_tol=1e-9) for a in alphas)
    return {"text": text, "title": f"step {wording.time(timestep)}, {named}", "main": main}


def lost(view: View) -> list[Row]:
    """Impacts without a bounce, counted by setting and what became of them."""
    table = view.results.impacts
    out = []
    for key, rows in table[table["status"] != "parted"].groupby(["engine", "setting", "status"], sort=False):
        engine, setting, status = (str(part) for part in cast("tuple[Any, ...]", key))
        steps = sorted({float(h) for h in rows["timestep_s"]})
        run = run_cell(view, Run(engine, setting, steps[0]))
        if len(steps) > 1:
            run["step"] = f"{len(steps)} steps, {wording.time(steps[0])} … {wording.time(steps[-1])}"
        reasons = list(dict.fromkeys(str(reason or "") for reason in rows["reason"]))
        more = f"; and {len(reasons) - 1} more like it" if len(reasons) > 1 else ""
        what = _STATUS.get(status, status)
        out.append({"run": run, "status": what, "count": len(rows), "reason": reasons[0] + more})
    return out


def provenance(view: View) -> list[tuple[str, str]]:
    """What was run, in both systems of units where the paper's readers want that."""
    study = view.study
    gravity = float(study["gravity"])
    radius, mass = float(study["relative_radius_m"]), float(study["mass_kg"])
    return [
        ("scene", f"{study['scene']} ({study['form']})"),
        ("mass", f"{mass:.6g} kg ({mass / 0.45359237:.3g} lb)"),
        ("relative radius", f"{1e3 * radius:.4g} mm ({radius / wording.INCH:.3g} in)"),
        ("stiffness k", f"{float(study['stiffness']):.5g} N/m^{float(study['exponent']):g}"),
        ("exponent n", f"{float(study['exponent']):g}"),
        ("gravity", f"{gravity:g} m/s²" if gravity else "off: free flight at the plate"),
        ("α", "; ".join(f"{a * wording.INCH:.3g} s/in ({a:.3g} s/m)" for a in view.alphas)),
        ("impact speeds", f"{len(study['speeds'])} from {findings.band(view)}"),
        ("phases", f"{study['phases']} places in a time step for the touch to fall"),
        ("impacts", str(len(view.results.impacts))),
        ("a loop is scored from", f"{RESOLVED} steps in contact"),
    ]
