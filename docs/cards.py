"""Cards of the settings: a picture of e over speed, what a setting does, when to use it, and what it costs.

    python docs/cards.py measure   first writes settings/curves.json, from the reports' tables and launches
    python docs/cards.py           draws settings/*.svg and writes the cards into docs/reference/settings.md

What a setting does and when to use it is what its recipe says in code.
"""

from __future__ import annotations

import csv
import json
import math
import re
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from hcbench.laws import closed_form
from hcbench.laws.published import LAWS
from hcbench.recipes.target import steps_per_contact
from hcbench.sim import registry
from hcbench.system.errors import HcbenchError
from hcbench.terms.impact import Launch
from hcbench.tuning.ask import make_target

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reference" / "settings.md"
FOLDER = PAGE.with_name("settings")
CURVES = FOLDER / "curves.json"
REPORTS = ("field", "steel-1lb")
ALPHA = 0.008 / 0.0254  # s/m, of both reports
# (gravity in m/s², time step in s): a card shows the first in which its setting works, or else does best.
CONDITIONS = (
    *((9.81, h) for h in (2e-3, 1e-3, 1 / 240)),
    *((0.0, h) for h in (2e-3, 1e-3)),
    *((g, h) for h in (1e-4, 1e-5, 1e-6) for g in (9.81, 0.0)),
)
WORKS = 0.15  # error of e
NEAR = 1.08  # impact speeds this near to each other are one point: phases change them a little
PUBLISHED = {law.slug for law in LAWS.values()}  # docs/explanation/paper.md has them
# Engines that step MuJoCo's model, or take its contact: where no report has a setting, the card has MuJoCo's.
LIKE_MUJOCO = ("mjx", "mujoco-warp", "newton")
FIRST = ("mujoco", "pybullet")
BEGIN, END = "<!-- begin cards: python docs/cards.py -->\n", "<!-- end cards -->"


def measure() -> None:
    """Write what cards show of each setting: from the reports' tables, else measured here."""
    rows: dict[tuple[str, str, str], list[dict[str, str]]] = {}
    for report in REPORTS:
        with (ROOT / "reports" / report / "restitution.csv").open(encoding="utf-8") as file:
            for row in csv.DictReader(file):
                normal = row["scene"] == "steel-plane" and float(row["friction"]) == 0.0
                if normal and math.isclose(float(row["alpha_s_per_m"]), ALPHA, rel_tol=1e-6):
                    rows.setdefault((row["engine"], row["setting"], report), []).append(row)
    keys = sorted({key[:2] for key in rows if "@" not in key[0]})
    curves = [
        curve
        for key in keys
        if (curve := _from_tables(*key, [rows.get((*key, r), []) for r in REPORTS]))
    ]
    known = {(curve["engine"], curve["setting"]) for curve in curves}
    curves += [curve for key in _recipes() if key not in known and (curve := _measured(*key))]
    curves.sort(key=lambda curve: (curve["engine"], curve["setting"]))
    lines = ",\n".join(json.dumps(curve, ensure_ascii=False) for curve in curves)
    FOLDER.mkdir(exist_ok=True)
    CURVES.write_text(f"[\n{lines}\n]\n", encoding="utf-8")


def _recipes() -> Iterator[tuple[str, str]]:
    for engine in registry.names():
        if registry.is_there(engine):
            yield from (
                (engine, r.name)
                for r in registry.engine(engine).recipes()
                if r.name not in PUBLISHED
            )


def _from_tables(
    engine: str, setting: str, tables: list[list[dict[str, str]]]
) -> dict[str, Any] | None:
    columns = ("speed_m_per_s", "speed_in_m_per_s", "restitution", "samples", "penetration_max_m")
    curves = []
    for (gravity, step), rows in product(CONDITIONS, tables):
        impacts = [
            (*(_float(row[name]) for name in columns), row["status"])
            for row in rows
            if float(row["gravity_m_per_s2"]) == gravity
            and math.isclose(float(row["timestep_s"]), step)
        ]
        if impacts:
            curves.append(_curve(engine, setting, gravity, step, impacts))
    return _shown(curves)


def _shown(curves: list[dict[str, Any]]) -> dict[str, Any] | None:
    """The curve of a card: the first that works, or else the best; of a default the first."""
    if not curves or curves[0]["setting"].startswith("stock"):
        return curves[0] if curves else None
    return next((c for c in curves if _worst(c) < WORKS), min(curves, key=_worst))


def _float(text: str) -> float:
    return float(text) if text else math.nan


def _measured(engine: str, setting: str) -> dict[str, Any] | None:
    """Curve of a setting that no report has: seven speeds at two phases."""
    recipe = next(r for r in registry.engine(engine).recipes() if r.name == setting)
    curves: list[dict[str, Any]] = []
    for gravity, step in CONDITIONS:
        try:
            scene, target = make_target(
                timestep=step, alpha=ALPHA, gravity=gravity, scene="steel-plane"
            )
            scene = replace(scene, gravity=gravity)
            if steps_per_contact(target) < (
                recipe.steps_min_with_gravity if gravity else recipe.steps_min
            ):
                continue
            launches = [
                Launch.touching(float(v), phase, step, gravity)
                for v in np.linspace(target.speed_min, target.speed_max, 7)
                for phase in (0.25, 0.75)
            ]
            impacts = registry.engine(engine).run(scene, recipe(target), launches)
        except HcbenchError:
            continue
        seen = [
            (
                i.launch.speed,
                i.speed_in,
                i.restitution,
                i.samples,
                i.penetration_max,
                i.status.value,
            )
            for i in impacts
        ]
        curves.append(_curve(engine, setting, gravity, step, seen))
        if _worst(curves[-1]) < WORKS:
            break
    return _shown(curves)


def _curve(
    engine: str, setting: str, gravity: float, step: float, impacts: list[Any]
) -> dict[str, Any]:
    """[impact speed, mean e, lowest, highest] of each launch speed, and the cost; e = 0 of what rests."""
    points = []
    bounced = sorted(
        (i for i in impacts if i[-1] in ("parted", "rested") and i[1] > 0), key=lambda i: i[1]
    )
    while bounced:
        near = [i for i in bounced if i[1] <= NEAR * bounced[0][1]]
        bounced = bounced[len(near) :]
        e = [i[2] if i[-1] == "parted" else 0.0 for i in near]
        mean_speed = sum(i[1] for i in near) / len(near)
        points.append([_short(x) for x in (mean_speed, sum(e) / len(e), min(e), max(e))])
    parted = [i for i in impacts if i[-1] == "parted"]
    deep = [i[4] for i in parted if math.isfinite(i[4])]
    return {
        "engine": engine,
        "setting": setting,
        "gravity_m_per_s2": gravity,
        "timestep_s": step,
        "points": points,
        "steps": [int(min(i[3] for i in parted)), int(max(i[3] for i in parted))] if parted else [],
        "penetration_m": _short(max(deep)) if deep else None,
        "failed": sum(i[-1] not in ("parted", "rested") for i in impacts),
    }


def _short(x: float) -> float:
    return float(f"{x:.4g}")


def draw() -> None:
    """Draw every picture and write the cards."""
    curves = json.loads(CURVES.read_text(encoding="utf-8"))
    for curve in curves:
        picture_file(curve).write_text(picture(curve), encoding="utf-8")
    text = PAGE.read_text(encoding="utf-8")
    head, rest = text.split(BEGIN)
    PAGE.write_text(head + BEGIN + written(curves) + END + rest.split(END)[1], encoding="utf-8")


def written(curves: list[dict[str, Any]]) -> str:
    """The cards of all settings, as the page has them."""
    by_name = {(curve["engine"], curve["setting"]): curve for curve in curves}
    parts = []
    for engine in sorted(registry.names(), key=lambda name: (name not in FIRST, name)):
        recipes = [r for r in registry.engine(engine).recipes() if r.name not in PUBLISHED]
        if recipes and engine != "recorded":
            title = registry.engine(engine).title
            parts.append(f"## {title}\n")
            for recipe in recipes:
                own = by_name.get((engine, recipe.name))
                shared = by_name.get(("mujoco", recipe.name)) if engine in LIKE_MUJOCO else None
                parts.append(_card(title, recipe, own or shared))
    return "\n" + "\n".join(parts) + "\n"


def _card(title: str, recipe: Any, curve: dict[str, Any] | None) -> str:
    lines = [f"### {title}: {recipe.name}", "", *_wrapped(recipe.summary), ""]
    if curve and curve["points"]:
        low, high = curve["points"][0][0], curve["points"][-1][0]
        shown = title if curve["engine"] == recipe.engine else "MuJoCo"
        what = f"e of {recipe.name} in {shown} over speed, beside the law"
        lines += [f"![{what}](settings/{picture_file(curve).name})", ""]
        where = _condition(curve) if shown == title else f"in MuJoCo, {_condition(curve)}"
        lines += [f"- **Error of e**: {_error(curve)} from {low:.3g} to {high:.3g} m/s, {where}."]
    else:
        lost = curve is not None and curve["failed"]
        lines += [
            f"- **Error of e**: {'no impact came back' if lost else 'no report has an e of it'}."
        ]
    if curve and curve["steps"]:
        steps = " ... ".join(f"{n}" for n in dict.fromkeys(curve["steps"]))
        unit = "step" if steps == "1" else "steps"
        depth = (
            ""
            if curve["penetration_m"] is None
            else f", up to {_length(curve['penetration_m'])} deep"
        )
        lines += [f"- **Cost**: contacts of {steps} {unit}{depth}."]
    if recipe.notes:
        lines += [
            "- **When and how**:",
            *(line for note in recipe.notes for line in _wrapped(note, "  - ")),
        ]
    return "\n".join(lines).rstrip() + "\n"


def _wrapped(text: str, bullet: str = "") -> list[str]:
    text = re.sub(r"(?<![`\w])(<\w+>|--\w[\w-]*)(?!`)", r"`\1`", text)  # markup, and a dash
    return textwrap.wrap(text, 100, initial_indent=bullet, subsequent_indent=" " * len(bullet))


def _worst(curve: dict[str, Any]) -> float:
    """The largest error of e; infinite where nothing bounced nor came to rest."""
    law = [
        (float(closed_form.restitution(v, ALPHA)), low, high) for v, _, low, high in curve["points"]
    ]
    return max((max(abs(low - e), abs(high - e)) for e, low, high in law), default=math.inf)


def _error(curve: dict[str, Any]) -> str:
    worst = _worst(curve)
    return "below 0.0001" if worst < 1e-4 else f"{math.ceil(worst * 1e4 - 1e-9) / 1e4:.2g}"


def _condition(curve: dict[str, Any]) -> str:
    return f"at {_step(curve['timestep_s'])} {'with' if curve['gravity_m_per_s2'] else 'without'} gravity"


def _step(seconds: float) -> str:
    if math.isclose(seconds, 1 / 240):
        return "1/240 s"
    return f"{seconds * 1e3:g} ms" if seconds >= 1e-3 else f"{seconds * 1e6:g} µs"


def _length(metres: float) -> str:
    return f"{metres * 1e3:.2g} mm" if metres >= 1e-4 else f"{metres * 1e6:.2g} µm"


def picture_file(curve: dict[str, Any]) -> Path:
    """Path of the picture of a curve."""
    return FOLDER / f"{curve['engine']}-{curve['setting']}.svg"


WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 420, 210, 46, 12, 12, 40


def picture(curve: dict[str, Any]) -> str:
    """e over impact speed: the law as a line, the setting as points, with bars over the phases."""
    points = curve["points"]
    fastest = max((p[0] for p in points), default=1.0)
    highest = max([1.0, *(p[3] for p in points)])
    lowest = min([0.8, *(p[2] for p in points)])
    bottom, top = math.floor(lowest * 5) / 5, min(2.0, math.ceil(highest * 5 - 0.01) / 5)

    def at(v: float, e: float) -> tuple[str, str]:
        x = LEFT + (WIDTH - LEFT - RIGHT) * v / fastest / 1.04
        y = HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (min(e, top) - bottom) / (top - bottom)
        return f"{x:.1f}", f"{y:.1f}"

    law = [
        at(v, float(closed_form.restitution(v, ALPHA))) for v in np.linspace(0, 1.04 * fastest, 40)
    ]
    apart = 0.1 if top - bottom < 0.5 else 0.2
    grid = [bottom + apart * i for i in range(round((top - bottom) / apart) + 1)]
    step = 0.1 if fastest < 0.7 else 0.2
    speeds = [step * i for i in range(int(1.04 * fastest / step) + 1)]
    right, floor = str(WIDTH - RIGHT), str(HEIGHT - BOTTOM)
    lines = [f'<path d="M{LEFT} {at(0, e)[1]}H{right}" stroke="#d5d9dd"/>' for e in grid]
    lines += [
        f'<text x="{LEFT - 6}" y="{at(0, e)[1]}" dy="4" text-anchor="end">{e:.1f}</text>'
        for e in grid
    ]
    lines += [
        f'<text x="{at(v, bottom)[0]}" y="{HEIGHT - 24}" text-anchor="middle">{v:.1f}</text>'
        for v in speeds
    ]
    lines.append(f'<path d="M{LEFT} {floor}H{right}" stroke="#59636e"/>')
    lines.append(
        f'<path d="M{"L".join(" ".join(p) for p in law)}" stroke="#1f2328" stroke-width="1.6"/>'
    )
    for v, e, low, high in points:
        (x, y), below, above = at(v, e), at(v, low)[1], at(v, high)[1]
        lines.append(f'<path d="M{x} {below}V{above}" stroke="#0b62c4" stroke-width="2"/>')
        lines.append(f'<circle cx="{x}" cy="{y}" r="4" fill="#0b62c4"/>')
    middle = (LEFT + WIDTH - RIGHT) // 2
    lines.append(
        f'<text x="{middle}" y="{HEIGHT - 7}" text-anchor="middle">impact speed, m/s</text>'
    )
    lines.append(f'<text x="13" y="{TOP + 60}" text-anchor="middle">e</text>')
    size = f'viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size}'
    title = f"e of {curve['setting']} over speed, {_condition(curve)}; line: the law of α = {ALPHA:.3f} s/m"
    body = "\n".join(lines)
    style = ' font-family="system-ui,sans-serif" font-size="12" fill="none">'
    background = f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>'
    return f"{head}{style}\n<title>{title}</title>\n{background}\n{body}\n</svg>\n".replace(
        "<text ", '<text fill="#1f2328" '
    )


if __name__ == "__main__":
    if "measure" in sys.argv[1:]:
        measure()
    draw()
