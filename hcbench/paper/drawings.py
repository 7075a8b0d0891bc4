"""Every figure of the page: its place, title, caption, alternative text, and how it is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal

from hcbench.paper import forced, impacts, later_figures, vibroimpact_figures
from hcbench.paper.engines import engines_with_two_blocks
from hcbench.report.wording import engine_name, listed
from hcbench.sim import registry

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure

    from hcbench.paper.forced import Effort

Section = Literal["impact", "gap", "steps", "later", "forced"]


@dataclass(frozen=True, slots=True)
class Drawing:
    """name: of its files. title, caption: caption says what is ours. alt: for who cannot see it.

    draw: makes the figure and, where something is measured in it, the sentence that ends the caption.
    """

    section: Section
    name: str
    title: str
    caption: str
    alt: str
    draw: Callable[[], Figure | tuple[Figure, str]]


def drawings(effort: Effort) -> list[Drawing]:
    """All figures, in the page's order; `effort` is of the forced ones."""
    return [*_impact(), *_gap(), *_steps(), *_later(), *_forced(effort)]


def _impact() -> list[Drawing]:
    return [
        Drawing(
            "impact",
            "figure-1",
            "Fig. 1. The loop of a damped spring, and the loop to be expected",
            "(a) eq. (4) until x = 0: force c vᵢ at the very touch (A), and tension before parting (C to D)."
            " (b) eq. (16). The paper sketches both; here they are computed, with the same restitution"
            " 0.663 (α v = 0.5) and the same contact time. Dashed: the springs alone.",
            "Two loops of force over approach. The left one starts at a force above zero and ends below"
            " zero; the right one starts and ends at zero.",
            impacts.figure_1,
        ),
        Drawing(
            "impact",
            "figure-2",
            "Fig. 2. Impact without loss, F = k xⁿ",
            "The area under the curve is the kinetic energy at touch, eq. (8). Ours: four exponents, and"
            " the speed on the way in by eq. (10).",
            "Power curves from 0 to 1 for n = 1, 1.25, 1.5 and 2, the area under n = 1.5 shaded, and the"
            " speed falling from 1 to 0.",
            impacts.figure_2,
        ),
        Drawing(
            "impact",
            "figure-3",
            "Fig. 3. The loss is the area of the loop",
            "Eq. (16) at α v = 0.5. The step behind (12) takes the ways in and out to lose alike; the"
            " shares are ours. Dashed: the spring alone.",
            "A loop of force over approach, split by the elastic curve into an upper part, 58 per cent,"
            " and a lower part, 42 per cent.",
            impacts.figure_3,
        ),
        Drawing(
            "impact",
            "figure-4",
            "Fig. 4. Loops of the steel body of section 3.1",
            "In closed form, no integration: K3 = 3.1·10⁷ lb/in^1.5, 1 lb, impacts at 4, 8, 12 and 16"
            " in/s. The paper shows two α of which 0.008 s/in can be read; here are the four that section"
            " 3.2 names. At 16 in/s the force passes 600 lb and the shear stress its limit by about 11 per"
            " cent; 12 in/s stays within.",
            "Four panels, one for each α, each with loops at four speeds. Loops grow with the speed and"
            " widen with α; the largest peaks near 850 lb at 0.9 thousandths of an inch.",
            impacts.figure_4,
        ),
    ]


def _gap() -> list[Drawing]:
    return [
        Drawing(
            "gap",
            "figure-5",
            "Fig. 5. An elastic mass between two blocks",
            "(a) with clearance, (b) with none, (c) fastened to a spring: (b) and (c) have the same law"
            " of force but only (c) can pull.",
            "Force over position: flat in the middle of a gap, one straight line without a gap.",
            vibroimpact_figures.figure_5,
        ),
        Drawing(
            "gap",
            "figure-6",
            "Fig. 6. The fastened mass, damped as eq. (4) has it",
            "Free vibration in closed form, ζ = 0.04: thin ellipses that shrink exponentially.",
            "A spiral of thin ellipses along a straight line.",
            vibroimpact_figures.figure_6,
        ),
        Drawing(
            "gap",
            "figure-7",
            "Fig. 7. No gap: two half loops that meet at a point",
            "One cycle of free motion by eq. (16) on both sides; the second half is smaller by what the"
            " first has lost. The paper draws flat contacts (left); spheres (right) are ours.",
            "Two loops, one above and one below, that meet at the origin with a sharp point.",
            vibroimpact_figures.figure_7,
        ),
        Drawing(
            "gap",
            "figure-8",
            "Fig. 8. Squeezed, with impacts: two loops add up",
            "A gap of −2 and spheres on both sides, settled under a drive: the swing is larger than ½ |g|"
            " (dotted), so each block is left and met again. Computed, where the paper sketches.",
            "Left: two overlapping loops, the right block's above and the left block's below. Right:"
            " their sum, one slanted loop.",
            vibroimpact_figures.figure_8,
        ),
        Drawing(
            "gap",
            "figure-9",
            "Fig. 9. Squeezed, no impact: the ellipse of Kelvin and Voigt",
            "The same at a smaller swing: no block is left. Dashed: the ellipse of the linearised law, for"
            " the same swing and frequency; the two differ with the square of the swing.",
            "Left: two slim loops apart from each other. Right: their sum, which lies on an ellipse.",
            vibroimpact_figures.figure_9,
        ),
    ]


def _steps() -> list[Drawing]:
    return [
        Drawing(
            "steps",
            "approximations",
            "How good the paper's own steps are",
            "Relative error of each step against what eq. (16) does, over α v alone: neither k nor m"
            " enters, and n only for the depth (8), here 3/2. Dots: where it errs by 1 % and by 10 %, the"
            " numbers of the table. Grey: the α v of the loops in Fig. 4.",
            "Seven rising lines, log-log. Loss (3) is the least exact, loss from depth (11) the most.",
            later_figures.approximations_figure,
        ),
        Drawing(
            "steps",
            "quadratic",
            "The other choice of section 2.2: q = 2",
            "λ2 = (3/8) α √(2 k m (n + 1)), derived from ∮ = (11): the printed constant cannot be read."
            " Its restitution is close to that of (16), but near x = 0 the damping outweighs the spring"
            " and pulls, the very fault of (4).",
            "Left: restitution over α v, the curves of q = 1 and q = 2 nearly alike. Right: the loop of q"
            " = 2 falls below zero before parting.",
            later_figures.quadratic_figure,
        ),
    ]


def _later() -> list[Drawing]:
    return [
        Drawing(
            "later",
            "later-laws",
            "Laws that came after: what is asked, what is delivered",
            "F = k xⁿ (1 + χ v/vᵢ) with each law's χ(e). What each delivers follows exactly from χ,"
            " whatever k, n and m are; no simulation.",
            "Restitution delivered over asked for ten laws. Exact lies on the diagonal, Carvalho-Martins"
            " and Hu-Guo near it, Lee-Wang farthest above.",
            later_figures.later_laws_figure,
        ),
    ]


def _forced(effort: Effort) -> list[Drawing]:
    names = engines_with_two_blocks()
    own = (registry.submodule(name, "two_blocks").REMARK for name in names)
    remarks = " ".join(["The plug-ins lie on the reference.", *own])
    return [
        Drawing(
            "forced",
            "response",
            "Response of the squeezed mass over frequency",
            "The steel body of section 3.1 squeezed by 5 µm on each side, α = 0.016 s/in. A small force"
            " gives the linear resonance; a large one opens a side, bends the peak to lower frequencies"
            " and flattens it.",
            "Resonance curves. The one for 4 N lies on the linear curve, those for 120 N and 400 N lean"
            " to the left.",
            partial(forced.response_figure, effort),
        ),
        Drawing(
            "forced",
            "bifurcation",
            "Significantly at variance: with clearance",
            "The same body in a gap of 1.5 mm under 150 N: velocity at the same phase of each cycle. A"
            " line is a motion that repeats, several lines one that repeats after several cycles, a cloud"
            " one that does not. Above by eq. (16), below by the piecewise linear model of the paper's"
            " reference [3].",
            "Two bifurcation pictures over 60 to 120 Hz. Periodic and chaotic windows lie at different"
            " frequencies in the two.",
            partial(forced.bifurcation_figure, effort),
        ),
        Drawing(
            "forced",
            "engines",
            f"The same mass in {listed([engine_name(name) for name in names])}",
            "The scene two-blocks. Left: in a gap of 1.5 mm under 150 N at 90 Hz. Right: squeezed by 5 µm,"
            f" the summed loop of its twelfth cycle under 1200 N at 3 kHz. {remarks} Largest distance from"
            " the reference, of position (left) and force (right), over its largest value:",
            f"Left: position over time. Right: force over position. {remarks}",
            partial(forced.engines_figure, effort),
        ),
    ]
