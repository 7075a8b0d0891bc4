"""The paper as a page: every figure redrawn, every printed number beside ours."""

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from hcbench.laws.published import LAWS
from hcbench.paper import impact_figures, vibroimpact_figures
from hcbench.paper.approximations import APPROXIMATIONS
from hcbench.paper.engines import engines_with_two_blocks
from hcbench.paper.printed_numbers import FACTOR_MASSES, factors, printed_numbers
from hcbench.paper.vibroimpact_figures import FULL, QUICK, Effort
from hcbench.reporting.curves import csv_of
from hcbench.reporting.page import PAGE, Drawing, draw, render
from hcbench.reporting.wording import engine_title, listed
from hcbench.sim import registry
from hcbench.system.files import atomic_folder, read_text, write_text

# Restitutions in the table of laws.
ASKED = (0.3, 0.5, 0.7, 0.9)


def drawings(effort: Effort) -> list[Drawing]:
    """All figures, in the page's order; nothing is drawn yet.

    effort: how much the figures of forced motion may compute.
    """
    functions: dict[str, Any] = {
        "figure-1": impact_figures.figure_1,
        "figure-2": impact_figures.figure_2,
        "figure-3": impact_figures.figure_3,
        "figure-4": impact_figures.figure_4,
        "figure-5": vibroimpact_figures.figure_5,
        "figure-6": vibroimpact_figures.figure_6,
        "figure-7": vibroimpact_figures.figure_7,
        "figure-8": vibroimpact_figures.figure_8,
        "figure-9": vibroimpact_figures.figure_9,
        "approximations": impact_figures.approximations_figure,
        "quadratic": impact_figures.quadratic_figure,
        "later-laws": impact_figures.later_laws_figure,
        "response": partial(vibroimpact_figures.response_figure, effort),
        "bifurcation": partial(vibroimpact_figures.bifurcation_figure, effort),
        "engines": partial(vibroimpact_figures.engines_figure, effort),
    }
    return [Drawing(name, function) for name, function in functions.items()]


def build(
    folder: Path,
    *,
    quick: bool = False,
    jobs: int = 1,
    tick: Callable[[int, int], None] | None = None,
) -> Path:
    """Write the page and its figures (SVG, PNG, and their numbers as CSV) into `folder` and return
    the page. All of it, or nothing. The same version gives the same bytes for any jobs.

    quick: few parameters in the figures of forced motion.
    jobs: processes for the largest of them.
    tick: called with (figures done, figures in all).

    Raises UserError where a file that hcbench did not write is in the way, OutputError where the
    folder cannot be written, EngineFailed where an engine crashes in the figure of engines.
    """
    effort = QUICK if quick else FULL
    plan = drawings(replace(effort, jobs=jobs))
    with atomic_folder(folder, PAGE) as scratch:
        (scratch / "figures").mkdir()
        figures = {}
        for done, drawing in enumerate(plan):
            if tick is not None:
                tick(done, len(plan))
            figures[drawing.name] = draw(drawing, scratch / "figures", csv=csv_of)
        if tick is not None:
            tick(len(plan), len(plan))
        write_text(scratch / PAGE, _page(figures, folder))
    return folder / PAGE


def engines_drawn_in(folder: Path) -> set[str]:
    """Engines whose motion the page in a folder shows, by their titles in it; empty without a page
    that can be read.
    """
    with suppress(OSError, ValueError):
        text = read_text(folder / PAGE)
        return {
            name for name in engines_with_two_blocks() if f"{engine_title(name)} plug-in" in text
        }
    return set()


def _page(figures: dict[str, dict[str, Any]], folder: Path) -> str:
    """The page as HTML text. figures: what `draw` returns of each drawing, by name."""
    numbers = printed_numbers()
    titles = []
    notes = []
    for name in engines_with_two_blocks():
        titles.append(engine_title(name))
        notes.append(registry.submodule(name, "two_blocks").NOTE)
    return render(
        "paper.html",
        folder=folder,
        figures=figures,
        numbers=numbers,
        counts=Counter(n.verdict for n in numbers),
        steps=APPROXIMATIONS,
        masses=FACTOR_MASSES,
        factors=factors(),
        asked=ASKED,
        laws=LAWS,
        engine_titles=listed(titles),
        engine_notes=" ".join(notes),
    )
