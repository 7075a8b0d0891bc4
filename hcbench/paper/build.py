"""The paper as a page: every figure redrawn, every printed number beside ours."""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from hcbench._files import filled_folder, write_bytes, write_text
from hcbench.laws.published import LAWS
from hcbench.paper.approximations import APPROXIMATIONS
from hcbench.paper.drawings import drawings
from hcbench.paper.forced import FULL, QUICK
from hcbench.paper.numbers import FACTOR_MASSES, digits, factors, printed_numbers
from hcbench.report import style

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from hcbench.paper.drawings import Drawing
    from hcbench.paper.numbers import Printed

PAGE = "index.html"
ASKED = (0.3, 0.5, 0.7, 0.9)  # restitutions of the table of laws
WORDS = {"agrees": "agrees", "rounded": "agrees but for rounding", "differs": "differs"}


def build(
    folder: Path, *, quick: bool = False, jobs: int = 1, tick: Callable[[int, int], None] | None = None
) -> Path:
    """Write the page and its figures (SVG, PNG) into `folder` and return the page. All of it, or nothing.

    quick: few parameters in the two forced figures. jobs: processes for the largest of them. tick: told
    (figures done, figures in all). The same version gives the same bytes, whatever jobs is. Raises
    OutputError where the folder cannot be written.
    """
    plan = drawings(replace(QUICK if quick else FULL, jobs=jobs))
    with filled_folder(folder) as scratch:
        (scratch / "figures").mkdir()
        figures = []
        for done, drawing in enumerate(plan):
            if tick is not None:
                tick(done, len(plan))
            figures.append(_save(drawing, scratch / "figures"))
        if tick is not None:
            tick(len(plan), len(plan))
        write_text(scratch / PAGE, render(figures))
    return folder / PAGE


def _save(drawing: Drawing, folder: Path) -> dict[str, Any]:
    with style.drawing():
        drawn = drawing.draw()
        figure, measured = drawn if isinstance(drawn, tuple) else (drawn, "")
        svg, png = style.svg_bytes(figure), style.png_bytes(figure)
    write_bytes(folder / f"{drawing.name}.svg", svg)
    write_bytes(folder / f"{drawing.name}.png", png)
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    return {
        "section": drawing.section,
        "name": drawing.name,
        "title": drawing.title,
        "caption": drawing.caption + measured,
        "alt": drawing.alt,
        "width": width,
        "height": height,
        "source": "data:image/svg+xml;base64," + base64.b64encode(svg).decode("ascii"),
    }


def render(figures: list[dict[str, Any]]) -> str:
    """The page as text."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader("hcbench.paper"), PackageLoader("hcbench.report")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    numbers = printed_numbers()
    return environment.get_template("paper.html").render(
        figures=figures,
        numbers=[_number(n) for n in numbers],
        counts=_counts(numbers),
        steps=[_step(a) for a in APPROXIMATIONS],
        masses=[f"{m:.3g}" for m in FACTOR_MASSES],
        factors=[(f"{n:g}", [f"{x:.5f}" for x in row]) for n, row in factors()],
        asked=ASKED,
        laws=[_law(name) for name in LAWS],
    )


def _number(n: Printed) -> dict[str, str]:
    return {
        "where": n.where,
        "what": n.what,
        "printed": digits(n.value),
        "ours": digits(n.ours),
        "unit": n.unit,
        "difference": _apart(n.difference),
        "verdict": WORDS[n.verdict],
        "grade": {"agrees": "good", "rounded": "even", "differs": "bad"}[n.verdict],
        "note": n.note,
    }


def _apart(difference: float) -> str:
    """A relative difference in per cent, as a factor where it is large, "0" where it is round-off."""
    if abs(difference) > 0.5:
        return f"× {1.0 + difference:.3g}"
    return f"{100 * difference:+.2g} %".replace("-", "−") if abs(difference) > 5e-5 else "0"


def _counts(numbers: list[Printed]) -> dict[str, int]:
    return {verdict: sum(n.verdict == verdict for n in numbers) for verdict in WORDS} | {"all": len(numbers)}


def _typeset(text: str) -> str:
    """The paper's symbols as they are printed."""
    for plain, printed in (("v_i", "vᵢ"), ("v_o", "vₒ"), ("x_m", "xₘ"), (" - ", " − ")):
        text = text.replace(plain, printed)
    return text


def _step(step: Any) -> dict[str, str]:
    return {
        "equation": step.equation,
        "statement": _typeset(step.statement),
        "one": f"{step.reaches(0.01):.3g}",
        "ten": f"{step.reaches(0.1):.3g}",
    }


def _law(name: str) -> dict[str, Any]:
    law = LAWS[name]
    return {
        "name": name,
        "formula": _typeset(law.formula),
        "delivered": [f"{float(law.delivered(e)):.3f}" for e in ASKED],
        "reference": law.reference,
    }
