"""The paper as a page: every figure redrawn, every printed number beside ours."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from hcbench.laws import closed_form, hertz, ode
from hcbench.laws.force import HuntCrossley
from hcbench.laws.hertz_elliptic import largest_shear
from hcbench.laws.published import LAWS
from hcbench.paper import constants, impact_figures, vibroimpact_figures
from hcbench.paper.approximations import APPROXIMATIONS
from hcbench.paper.vibroimpact_figures import FULL, QUICK, Effort, engines_with_two_blocks
from hcbench.reporting.page import PAGE, Drawing, csv_of, draw, render
from hcbench.reporting.wording import engine_title, four_digits, listed
from hcbench.sim import registry
from hcbench.system.files import atomic_folder, read_text, write_text
from hcbench.terms.units import INCH, POUND, POUND_FORCE, PSI

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
        drawn = set()
        for name in engines_with_two_blocks():
            if f"{engine_title(name)} plug-in" in text:
                drawn.add(name)
        return drawn
    return set()


def _page(figures: dict[str, dict[str, Any]], folder: Path) -> str:
    """The page as HTML text, with every number that the paper prints beside the one computed here.

    figures: what `draw` returns of each drawing, by name.
    folder: the page's own, for its links.
    """
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


# Every number that the paper prints and that can be computed, as printed and as computed here.

Agreement = Literal["agrees", "rounded", "differs"]
# Density of carbon steel, kg/m³.
STEEL_DENSITY = 7850.0


@dataclass(frozen=True, slots=True)
class Printed:
    """One number of the paper.

    where: section or equation.
    what: of what.
    printed: the digits as printed, ours: the value, both in `unit`.
    digits: how many of the printed digits are meant (two of 600 lb).
    note: where the difference comes from.
    """

    where: str
    what: str
    printed: str
    ours: float
    unit: str
    digits: int
    note: str = ""

    @property
    def value(self) -> float:
        """The printed digits as a number."""
        return float(self.printed)

    @property
    def verdict(self) -> Agreement:
        """agrees: the same after rounding; rounded: within one more
        unit of the last digit that is meant; differs: further away.
        """
        # Size of one unit of the last digit that is meant.
        last = 10.0 ** (math.floor(math.log10(abs(self.value))) + 1 - self.digits)
        units = abs(self.ours - self.value) / last
        if units <= 0.5 + 1e-9:
            return "agrees"
        return "rounded" if units <= 1.5 else "differs"

    @property
    def difference(self) -> float:
        """Relative difference of our number from the printed one."""
        return self.ours / self.value - 1.0


def printed_numbers() -> list[Printed]:
    """Every number that the paper prints, in its order."""
    return [*_first_sections(), *_constants(), *_stresses(), *_case()]


def _first_sections() -> Iterator[Printed]:
    """The numbers of sections 1.1 to 1.9, converted by the units that the paper names."""
    yield Printed("1.1", "impact speeds meant, 20 in/s", "50", 20 * INCH * 100, "cm/s", 2)
    yield Printed("1.2", "smallest α, 0.002 s/in", "0.08", 0.002 / INCH, "s/m", 1)
    yield Printed(
        "1.2",
        "largest α, 0.008 s/in",
        "0.32",
        0.008 / INCH,
        "s/m",
        2,
        "four times the rounded 0.08",
    )
    yield Printed("1.9", "E of steel, 30·10⁶ lb/in²", "2.068e11", 30e6 * PSI, "N/m²", 4)


def _constants() -> Iterator[Printed]:
    """K1 and K2 of eqs. (5) and (6), in the units in which the paper prints them."""
    pair = constants.pair()
    k1 = pair.K1 / PSI
    metric = pair.K1 * 1e-4
    slip = 2.19e7 * POUND_FORCE / 25.4
    yield Printed(
        "(5)", "K1 = (4/3) E/(2(1 - ν²))", "2.19e7", k1, "lb/in²", 3, "cut off, not rounded"
    )
    yield Printed(
        "(5)", "K1 in metric units", "3.83e6", metric, "N/cm²", 3,
        f"printed with 25.4 where 2.54² = 6.45 belongs: 2.19·10⁷ · 4.448/25.4 = {four_digits(slip)}",
    )  # fmt: skip
    k2 = pair.K2 / PSI * (POUND_FORCE / INCH**2) ** (1 / 3)
    k2_metric = pair.K2 * 1e4 ** (1 / 3)
    yield Printed("(6)", "K2 = 0.31 (6 E*²/π³)^(1/3)", "1.16e4", k2, "(lb/in²)^(2/3)", 3)
    yield Printed(
        "(6)",
        "K2 in metric units (R in cm, τ in N/m²)",
        "9.02e7",
        k2_metric,
        "mixed",
        3,
        "does not convert",
    )


def _stresses() -> Iterator[Printed]:
    """The stresses of section 1.10; the share of the shear is Hertz's for a Poisson's ratio of
    0.30.
    """
    share, _ = largest_shear(1.0, 0.30)
    yield Printed("1.10", "bearing stress, 200 000 lb/in²", "1.38e9", 200_000 * PSI, "N/m²", 3)
    yield Printed("1.10", "its highest limit, 500 000 lb/in²", "3.45e9", 500_000 * PSI, "N/m²", 3)
    yield Printed("1.10", "largest shear over largest pressure", "0.31", share, "", 2)
    yield Printed("1.10", "shear limit", "62000", share * 200_000, "lb/in²", 2)
    yield Printed("1.10", "shear limit in metric units", "4.27e8", 62_000 * PSI, "N/m²", 3)


def _case() -> Iterator[Printed]:
    """The numbers of sections 3.1 and 3.2, as printed and as computed from the law."""
    pair = constants.pair()
    k3 = pair.stiffness * INCH**1.5 / POUND_FORCE
    yield Printed("3.1", "weight of one pound", "4.448", POUND_FORCE, "N", 4)
    ball = 4.0 / 3.0 * math.pi * INCH**3 * STEEL_DENSITY / POUND
    note = "for a full ball of R1 = 1 in; the paper gives the body's shape at the contact only"
    yield Printed("3.1", "weight of the steel body", "1", ball, "lb", 2, note)
    yield Printed("3.1", "K3", "3.1e7", k3, "lb/in^1.5", 2)
    yield Printed("3.1", "K3 in metric units", "3.4e7", pair.stiffness * 0.01**1.5, "N/cm^1.5", 2)
    limit = pair.force_at_shear()
    yield Printed("3.1", "largest allowed force", "600", limit / POUND_FORCE, "lb", 2)
    note = "600 lb are 2669 N; 2690 N would be 605 lb"
    yield Printed("3.1", "600 lb in metric units", "2690", 600 * POUND_FORCE, "N", 3, note)
    yield Printed("3.1", "impact speed, 16 in/s", "40", 16 * INCH * 100, "cm/s", 2)
    law = constants.law(constants.ALPHAS[2])
    used = hertz.from_stiffness(law.stiffness, 2 * INCH)
    over = (
        used.shear_max(float(closed_form.force_max(law, constants.MASS, 16 * INCH)))
        / hertz.SHEAR_LIMIT
    )
    note = (
        f"of the limit at 16 in/s, α = 0.008 s/in: {100 * (over - 1):.1f} %; "
        '"not more than about 15 percent"'
    )
    yield Printed("3.1", "stress", "1.15", over, "of its limit", 2, note)
    yield Printed(
        "3.2",
        "largest α drawn, 0.016 s/in",
        "0.64",
        0.016 / INCH,
        "s/m",
        2,
        "twice the rounded 0.32",
    )
    yield Printed(
        "3.2", "λ/(α k), eq. (15)", "1.5", _factor(), "", 2, "from the law at speeds near 0"
    )


# Exponents n and masses, kg, at which the factor is read off.
FACTOR_EXPONENTS = (1.0, 1.25, 1.5, 2.0)
FACTOR_MASSES = (0.01, POUND, 100.0)


def factors() -> list[tuple[float, list[float]]]:
    """λ/(α k) read off simulated impacts: of each n of FACTOR_EXPONENTS, the factors of
    FACTOR_MASSES. Eq. (15) has no n and no m in it.

    In each λ/k = 1 s/m is put in, and the α of eq. (2) read off e at two speeds, as v goes to 0.
    """
    rows = []
    for exponent in FACTOR_EXPONENTS:
        law = HuntCrossley(constants.STIFFNESS, 2.0 / 3.0, exponent)
        factors_of_masses = []
        for mass in FACTOR_MASSES:
            # α = (1 - e)/v, whose error halves with v: taken on to v = 0 along a line.
            slow = (1.0 - ode.impact(law, mass, 0.004).restitution) / 0.004
            slower = (1.0 - ode.impact(law, mass, 0.002).restitution) / 0.002
            factors_of_masses.append(1.0 / (2.0 * slower - slow))
        rows.append((exponent, factors_of_masses))
    return rows


def _factor() -> float:
    """λ/(α k) that makes eq. (2) true for small speeds, from the exact restitution alone."""
    d = 1e-7
    e = float(closed_form.restitution(d / 1.5, 1.0))
    return d / (1.0 - e)
