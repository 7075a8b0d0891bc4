"""Colours and small marks that the paper's figures share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.report.style import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# After Okabe & Ito (2008): told apart with any kind of colour vision.
BLUE, ORANGE, GREEN, PURPLE, SKY, GREY, BAD = (
    "#0072B2", "#C98500", "#00805E", "#8B3F75", "#3A9BD0", "#8b949c", "#B23A00",
)  # fmt: skip
INKS = (BLUE, ORANGE, GREEN, PURPLE, SKY, BAD, "#5b6670", "#3d3d9e", "#9a8a1f", INK)
# One for each ink: inks of like hue differ in it, and where two lines of a figure run along each other the
# later one leaves the earlier one to be seen.
DASHES = (
    "-", (0, (5, 1.5)), "-", (0, (9, 2)), (0, (1.5, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)), (0, (5, 1.5, 1.2, 1.5, 1.2, 1.5)), (0, (2.5, 1.2)), "-", "-",
)  # fmt: skip


def numbered(i: int) -> dict[str, Any]:
    """Colour and dashes of the i-th line of a figure."""
    return {"color": INKS[i], "linestyle": DASHES[i]}


def bare(axes: Axes, x: str, y: str, ticks: bool = False) -> None:
    """A sketch's axes: names, and numbers only where they mean something."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if not ticks:
        axes.set_xticks([])
        axes.set_yticks([])


def mark(axes: Axes, letter: str, x: float, y: float, dx: float, dy: float) -> None:
    """A letter beside a point; dx, dy in points."""
    axes.plot([x], [y], marker="o", markersize=3.0, color=INK, linestyle="none", clip_on=False)
    axes.annotate(letter, (x, y), (dx, dy), textcoords="offset points", fontsize=9.5, annotation_clip=False)


def span(axes: Axes, x: float, name: str) -> None:
    """A dashed line down from the end of a loop, with its name below."""
    axes.axvline(x, ymax=0.9, color=INK, linewidth=0.7, linestyle=(0, (3, 2)))
    axes.annotate(name, (x, 0.0), (3, 3), textcoords="offset points", fontsize=9.5)
