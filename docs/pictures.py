"""Pictures of explanations and how-tos, from the law and the reports' tables: `python docs/pictures.py`."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hcbench.laws import closed_form

DOCS = Path(__file__).parent
SCORES = DOCS.parent / "reports" / "reality" / "scores.csv"
REPORT = DOCS.parent / "reports" / "steel-1lb" / "index.html"
INK, BLUE, GREY = "#1f2328", "#0b62c4", "#59636e"


def pictures() -> dict[Path, str]:
    """Each file with its SVG."""
    return {
        DOCS / "drop.svg": drop(),
        DOCS / "explanation" / "law.svg": law(),
        DOCS / "howto" / "reality.svg": cubes(),
    }


def svg(width: int, height: int, title: str, lines: Sequence[str]) -> str:
    """A picture on white, so that it is read in dark pages too."""
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    font = 'font-family="system-ui,sans-serif" font-size="13"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} {font}>'
    background = f'<rect width="{width}" height="{height}" fill="#fff"/>'
    return "\n".join([head, f"<title>{title}</title>", background, *lines, "</svg>\n"])


# A drop of the report: touches, partings (s) and heights after each (m).
Bounces = tuple[Sequence[float], Sequence[float], Sequence[float]]
# How many times slower than life the picture plays, and the time that it shows, s.
SLOWER, SHOWN = 4, 0.56
STOPS = 112  # of each ball's way


def drop() -> str:
    """Three balls that fall side by side, moving: the law, MuJoCo at its own default step as it is, and with
    hcbench's plug-in, as measured for the report. They lie still for readers who want no motion.
    """
    found = re.search(r'id="explorer-data">(.*?)</script>', REPORT.read_text("utf-8"), re.DOTALL)
    assert found is not None
    data = json.loads(found[1])
    height, gravity, alpha = data["dropHeight"], data["dropGravity"], data["drops"][0]["alpha"]
    runs = {
        run["setting"]: (run["touch"], run["parting"], run["height"])
        for run in data["drops"]
        if (run["engine"], run["step"]) == ("mujoco", 0.002)
    }
    balls: list[tuple[str, str, Bounces]] = [
        ("the law", GREY, bounces_of_law(alpha, height, gravity)),
        ("MuJoCo as it is", INK, runs["stock"]),
        ("with what hcbench prints", BLUE, runs["restitution-law"]),
    ]
    floor, reach, radius = 150, 110, 11
    styles, shapes = [], [f'<path d="M20 {floor}H620" stroke="{INK}"/>']
    for i, (name, colour, bounces) in enumerate(balls):
        x = 120 + 200 * i
        frames = []
        for stop in range(STOPS + 1):
            up = height_at(bounces, SHOWN * stop / STOPS, height, gravity) / height
            frames.append(f"{100 * stop / STOPS:.3g}%{{transform:translateY({-reach * up:.1f}px)}}")
        styles.append(f"@keyframes b{i}{{{''.join(frames)}}}")
        moves = f"animation:b{i} {SLOWER * SHOWN:.2f}s linear infinite"
        shapes.append(
            f'<circle cx="{x}" cy="{floor - radius}" r="{radius}" fill="{colour}" style="{moves}"/>'
            f'<text x="{x}" y="{floor + 22}" text-anchor="middle" fill="{INK}">{name}</text>'
        )
    styles.append("@media(prefers-reduced-motion:reduce){circle{animation:none!important}}")
    title = (
        f"A steel ball dropped from {1e3 * height:.0f} mm, {SLOWER} times slower: by the law it bounces,"
        " in MuJoCo as it is it does not, with what hcbench prints it bounces as by the law"
    )
    return svg(640, 190, title, [f"<style>{''.join(styles)}</style>", *shapes])


def bounces_of_law(alpha: float, height: float, gravity: float) -> Bounces:
    """Ten bounces by the law. Its contact, under a millisecond, is left out."""
    speed = math.sqrt(2 * height * gravity)
    time = speed / gravity
    touches, heights = [], []
    for _ in range(10):
        speed *= float(closed_form.restitution(alpha, speed))
        touches.append(time)
        heights.append(speed**2 / (2 * gravity))
        time += 2 * speed / gravity
    return touches, touches, heights


def height_at(bounces: Bounces, time: float, height: float, gravity: float) -> float:
    """Height of a ball, m, at a time after it was let go from `height`, s; 0 in a contact and at rest."""
    touches, partings, heights = bounces
    first = touches[0] if len(touches) else math.sqrt(2 * height / gravity)
    if time < first:
        return max(0.0, height - gravity * time**2 / 2)
    last = max((i for i, parting in enumerate(partings) if parting <= time), default=None)
    if last is None:
        return 0.0
    flight = time - partings[last]
    return max(0.0, math.sqrt(2 * gravity * heights[last]) * flight - gravity * flight**2 / 2)


def law() -> str:
    """e of the law and 1 - α v over α v."""
    left, floor, width, height = 46, 200, 440, 190
    alpha_v = np.linspace(0.0, 1.0, 41)

    def path(e: np.ndarray, colour: str) -> str:
        points = zip(left + width * alpha_v, floor - height * e, strict=True)
        line = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
        return f'<path d="M{line}" fill="none" stroke="{colour}" stroke-width="2"/>'

    exact = np.array([float(closed_form.restitution(v, 1.0)) for v in alpha_v])
    lines = [
        f'<path d="M{left} {floor - height * e:.1f}h{width}" stroke="#d5d9dd"/>'
        f'<text x="{left - 8}" y="{floor - height * e + 4:.1f}" text-anchor="end" fill="{INK}">{e:.1f}</text>'
        for e in np.linspace(0, 1, 6)
    ]
    lines += [
        f'<text x="{left + width * v:.1f}" y="{floor + 18}" text-anchor="middle" fill="{INK}">{v:.1f}</text>'
        for v in np.linspace(0, 1, 6)
    ]
    lines += [path(1.0 - alpha_v, GREY), path(exact, BLUE)]
    lines += [
        f'<text x="{left + 270}" y="{floor - 125}" fill="{BLUE}">e of the law</text>',
        f'<text x="{left + 200}" y="{floor - 70}" fill="{GREY}">1 - α v</text>',
        f'<text x="{left + width / 2:.0f}" y="{floor + 36}" text-anchor="middle" fill="{INK}">α v</text>',
        f'<text x="12" y="{floor - height / 2:.0f}" fill="{INK}">e</text>',
    ]
    return svg(500, 244, "Restitution of the law and its approximation over α v", lines)


def cubes() -> str:
    """The mean distance between measured and simulated tosses of the cube, of each engine and setting."""
    with SCORES.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["set"] == "cube"]
    rows.sort(key=lambda row: float(row["error"]))
    left, top, step, width = 290, 28, 22, 300
    largest = max(float(row["error_high"]) for row in rows)
    lines = [f'<text x="{left}" y="18" fill="{INK}">mean distance over a toss, % of a width</text>']
    for i, row in enumerate(rows):
        name = " ".join(filter(None, (row["engine"], row["setting"], row["cone"])))
        y, length = top + i * step, width * float(row["error"]) / largest
        lines += [
            f'<text x="{left - 8}" y="{y + 14}" text-anchor="end" fill="{INK}">{name}</text>',
            f'<rect x="{left}" y="{y + 3}" width="{length:.1f}" height="14" fill="{BLUE}"/>',
            f'<text x="{left + length + 6:.1f}" y="{y + 14}" fill="{INK}">{float(row["error"]):.3g}</text>',
        ]
    title = "Distance between measured and simulated tosses of a cube, by engine and setting"
    return svg(left + width + 60, top + len(rows) * step + 10, title, lines)


if __name__ == "__main__":
    for path, text in pictures().items():
        path.write_text(text, encoding="utf-8")
