"""One page on one measurement: self-contained HTML that works offline and prints.

All text passes through the template's escaping, and the page's own policy forbids scripts and requests: no
name in a model can make it run anything.
"""

from __future__ import annotations

import base64
import math
from typing import TYPE_CHECKING

from hcbench._text import number, sanitized, without_empty
from hcbench.check.figure import curve_svg, loops_svg
from hcbench.measure.text import effective_mass, law_of, score_of

if TYPE_CHECKING:
    from hcbench.measure.measurement import Measurement

_TEMPLATE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>{{ model }}: how it bounces</title>
<style>
body { font: 16px/1.5 system-ui, sans-serif; color: #26303a; }
body { max-width: 46rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; line-height: 1.25; } h2 { font-size: 1.1rem; margin-top: 2rem; }
img { max-width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .15rem .7rem; border-bottom: 1px solid #e6e9ec; }
th:first-child, td:first-child { text-align: left; }
code { background: #f2f4f6; padding: .1rem .3rem; overflow-wrap: anywhere; } .cause { margin: 1rem 0; }
@media print { body { margin: 0; max-width: none; } }
</style>
</head>
<body>
<main>
<h1>{{ model }}: {{ pair[0] }} on {{ pair[1] }}</h1>
<p>{{ summary }}</p>
<figure><img src="{{ figure }}" alt="Restitution over impact speed: measured, asked by the model, wanted.">
</figure>
<h2>The curve</h2>
<table><tr>{% for name in header %}<th>{{ name }}</th>{% endfor %}</tr>
{% for row in rows %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}</table>
{% if loops %}<h2>The loops</h2>
<figure><img src="{{ loops }}" alt="Contact force over penetration, a loop a speed.">
</figure>{% endif %}
{% if failures %}<h2>What failed</h2>
<ul>{% for line in failures %}<li>{{ line }}</li>{% endfor %}</ul>{% endif %}
{% if causes %}<h2>Why</h2>{% for cause in causes %}<div class="cause"><b>{{ cause.title }}</b><br>
Found: {{ cause.evidence }}.<br>Fix: <code>{{ cause.fix }}</code></div>{% endfor %}
<p>{{ remedy }}</p>{% endif %}
<h2>What was found in the model</h2>
<table>{% for name, value in facts %}<tr><td>{{ name }}</td><td>{{ value }}</td></tr>
{% endfor %}</table>
{% for note in notes %}<p>{{ note }}</p>{% endfor %}
{% if figures %}<h2>Against eq. (16)</h2>
<table>{% for name, value in figures %}<tr><td>{{ name }}</td><td>{{ value }}</td></tr>
{% endfor %}</table>{% endif %}
</main>
</body>
</html>
"""
_HEADER = (
    "launched m/s", "at touch m/s", "e", "spread", "asked", "wanted", "steps in contact", "failed",
)  # fmt: skip


def measurement_page(found: Measurement) -> str:
    """The page as HTML text."""
    from jinja2 import Environment

    template = Environment(autoescape=True).from_string(_TEMPLATE)
    facts = found.facts
    loops = loops_svg(found)
    header, rows = without_empty(_HEADER, _rows(found), "failed")
    return template.render(
        model=sanitized(facts.model),
        pair=[sanitized(name) for name in facts.pair],
        summary=_summary(found),
        figure=_embedded(curve_svg(found)),
        loops=None if loops is None else _embedded(loops),
        header=header,
        rows=rows,
        failures=[
            f"{i.status.value} at {i.launch.speed:.4g} m/s: {sanitized(i.reason)}" for i in found.failed[:5]
        ],
        causes=found.causes,
        remedy=found.remedy,
        facts=_facts(found),
        notes=[sanitized(note) for note in facts.notes],
        figures=_figures(found),
    )


def _embedded(svg: bytes) -> str:
    return f"data:image/svg+xml;base64,{base64.b64encode(svg).decode()}"


def _summary(found: Measurement) -> str:
    known = [p for p in found.curve if not math.isnan(p.restitution)]
    if not known:
        return "No impact of it could be measured."
    low, high = min(p.lowest for p in known), max(p.highest for p in known)
    band = f"{known[0].speed_in:.3g} ... {known[-1].speed_in:.3g} m/s"
    words = f"Restitution between {low:.3f} and {high:.3f} at impact speeds of {band}"
    if found.spread > 0:
        words += f", up to {found.spread:.2g} apart by where in a time step the touch falls"
    words += "."
    return words + (" Energy is gained in some impacts." if found.energy_gained else "")


def _rows(found: Measurement) -> list[tuple[str, ...]]:
    asked = found.facts.asked or (math.nan,) * len(found.curve)
    out: list[tuple[str, ...]] = []
    for p, a in zip(found.curve, asked, strict=True):
        known = found.wanted is not None and not math.isnan(p.speed_in)
        want = float(found.wanted.at(p.speed_in)) if found.wanted and known else math.nan
        out.append(
            (
                f"{p.speed:.4g}",
                number(p.speed_in, ".4g"),
                number(p.restitution),
                number(p.highest - p.lowest, ".1e"),
                number(a),
                number(want),
                str(p.samples),
                str(p.failed or ""),
            )
        )
    return out


def _facts(found: Measurement) -> list[tuple[str, str]]:
    facts = found.facts
    rows = [
        ("engine", f"{facts.engine} {facts.version}"),
        ("what moves", sanitized(facts.moved)),
        ("time step", f"{facts.timestep:.6g} s"),
        ("gravity", f"{' '.join(f'{g:.4g}' for g in facts.gravity)} m/s²"),
        ("effective mass", f"{effective_mass(found):.4g} kg"),
        ("asks for", sanitized(facts.asked_words)),
    ]
    for name, value in facts.settings.items():
        shown = " ".join(f"{v:.6g}" for v in value) if isinstance(value, list) else str(value)
        rows.append((name, sanitized(shown)))
    return rows


def _figures(found: Measurement) -> list[tuple[str, str]]:
    score, law = score_of(found), law_of(found)
    if score is None or law is None:
        return []
    rows = [
        ("α fitted", f"{score.alpha_fit:.4g} s/m, rms of e {score.alpha_fit_rms:.2g}"),
        (f"largest error against α = {law.alpha:.4g} s/m", f"{score.max_error_law:.4g}"),
        ("the same against 1 - α v", f"{score.max_error_linear:.4g}"),
        ("the best constant e would err", f"{score.constant_error_law:.4g}"),
        ("energy lost goes as v to the power", number(score.energy_exponent, ".3g")),
    ]
    if score.loops:
        rows += [
            ("loop: force, rms over the largest", f"{score.loop_rms:.3g}"),
            ("loop: area over the law's", number(score.area_ratio, ".3g")),
            ("loop: largest force over the law's", f"{score.force_ratio:.3g}"),
            ("loop: duration over the law's", f"{score.duration_ratio:.3g}"),
            ("loop: first force over the largest", f"{score.touch_force:.3g}"),
            ("loop: share of the impulse that pulls", f"{score.tension_share:.3g}"),
        ]
    return rows
