"""Style of all figures: colours, dashes and markers, axes and legends, the same on every page.

Figures are drawn with matplotlib's object interface, on its bundled font, from its default
settings: a user's matplotlibrc changes nothing, and the same numbers give the same bytes.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullLocator

from hcbench.laws.solvers import rising
from hcbench.reporting.wording import power_of_ten
from hcbench.terms.impact import Floats
from hcbench.terms.units import INCH

# After Okabe & Ito (2008) and Tol's muted set: told apart with any kind of colour vision; markers
# and dashes say the same again for print. INK is for text and axes.
INK = "#26303a"
GREY = "#8b949c"
SLATE = "#5b6670"
# The law: a broad pale band, on which curves can lie and still be seen.
LAW = "#b9c0c7"
BLUE = "#0072B2"
ORANGE = "#C98500"
GREEN = "#00805E"
PURPLE = "#8B3F75"
SKY = "#3A9BD0"
RED = "#B23A00"
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, RED, SLATE, "#3d3d9e", "#9a8a1f", INK)
# A target, or a limit.
LIMIT = "#D55E00"
# One for each colour: like colours differ in it, and where two lines of a figure run along each
# other the later one leaves the earlier one to be seen.
DASHES: tuple[Any, ...] = (
    "-", (0, (5, 1.5)), "-", (0, (9, 2)), (0, (1.5, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)), (0, (5, 1.5, 1.2, 1.5, 1.2, 1.5)), (0, (2.5, 1.2)), "-", "-",
)  # fmt: skip

_STYLE_FILE = Path(__file__).with_name("hcbench.mplstyle")

# Settings in reports: a hue a kind, a marker a recipe, dashes by engine; each line has its
# name beside it. Each hue has a contrast of 4.5 on white, and differs from the others in
# lightness or hue for any eye.
KIND_COLOURS = {"exact": BLUE, "settings": "#A65400", "constant": "#4F6B57", "stock": INK}
_RECIPES = {
    "stock": ("stock", "X"),
    "spring-damper": ("settings", "s"),
    "impulse": ("constant", "o"),
    "restitution": ("constant", "o"),
    "compliant": ("constant", "d"),
    "compliant-pairs": ("settings", "*"),
    "soft": ("settings", "D"),
    "two-pair": ("settings", "^"),
    "staggered": ("settings", "P"),
    "hunt-crossley": ("exact", "v"),
    "restitution-law": ("exact", "<"),
    "kelvin-voigt": ("exact", "h"),
}
_OTHER_MARKERS = (">", "p", "|", "8", "H")
_ENGINE_DASHES: tuple[tuple[float, ...], ...] = (
    (), (4.5, 1.6), (1.2, 1.2), (6.0, 1.5, 1.2, 1.5), (2.5, 1.0),
)  # fmt: skip
_STOCK_DASHES = (2.5, 1.5)


@contextmanager
def figure_defaults() -> Iterator[None]:
    """Set matplotlib's defaults for all figures of hcbench; after the block they are as before."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(mpl.rc_params_from_file(_STYLE_FILE, use_default_template=False))
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches, laid out so that nothing overlaps."""
    return Figure(figsize=(width, height), layout="constrained")


# Lines


@dataclass(frozen=True, slots=True)
class PlotStyle:
    """Style of one setting of one engine.

    kind: "exact" (a law in place of the contact), "settings", "constant"
    (one e for all speeds) or "stock".
    marker: as matplotlib names it.
    dashes: on-off lengths in points; () is a full line.
    """

    kind: str
    marker: str
    dashes: tuple[float, ...]

    @property
    def colour(self) -> str:
        """The hue of its kind."""
        return KIND_COLOURS[self.kind]

    @property
    def fill(self) -> str:
        """Colour inside the markers: hollow where the line is dashed."""
        return "white" if self.dashes else self.colour

    def line(self, **more: Any) -> dict[str, Any]:
        """Keyword arguments for `Axes.plot` of a line in this style.

        more: further ones, which take the place of those of the style.
        """
        style: dict[str, Any] = {
            "color": self.colour,
            "linestyle": (0, self.dashes) if self.dashes else "-",
            "marker": self.marker,
            "markerfacecolor": self.fill,
            "markeredgecolor": self.colour,
        }
        return {**style, **more}


MEASURED = PlotStyle("exact", "o", ())


def plot_styles(settings: Iterable[tuple[str, str]], law: str) -> dict[tuple[str, str], PlotStyle]:
    """A style for each (engine, setting).

    settings: pairs in the study's order.
    law: name of an engine.
    A known setting has its own marker, and a kind has its hue, in every study. Engines differ in
    their dashes, by their order in the study; `law`, the engine of the law itself, has full lines.
    """
    pairs = list(dict.fromkeys(settings))
    recipes = dict(_RECIPES)
    others = sorted({setting for _, setting in pairs} - set(_RECIPES))
    for setting, marker in zip(others, cycle(_OTHER_MARKERS), strict=False):
        recipes[setting] = ("settings", marker)
    engines = dict.fromkeys(engine for engine, _ in pairs if engine != law)
    dashes = {law: (), **dict(zip(engines, cycle(_ENGINE_DASHES), strict=False))}
    styles = {}
    for engine, setting in pairs:
        kind, marker = recipes[setting]
        # Stock looks alike in every engine.
        line = _STOCK_DASHES if kind == "stock" else dashes[engine]
        styles[engine, setting] = PlotStyle(kind, marker, line)
    return styles


def numbered_line(i: int) -> dict[str, Any]:
    """Colour and dashes of the i-th line of a figure."""
    return {"color": COLOURS[i], "linestyle": DASHES[i]}


def marker_stride(count: int, nth: int) -> tuple[int, int]:
    """(first, stride) of the points of the nth line that carry a marker, so that markers of
    neighbouring lines differ.
    """
    return (nth % 4, 4) if count > 8 else (0, 1)


def draw_band(axes: Axes, x: Floats, low: Floats, high: Floats, colour: str) -> None:
    """The range of values at each x, as over the phases of a time step: pale, behind its line."""
    axes.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0)


def draw_loop(axes: Axes, x: Floats, force: Floats, **line: Any) -> None:
    """The samples of a loop joined up, from the axis at touch and back to it at parting."""
    closed_x = np.concatenate([x[:1], x, x[-1:]])
    closed_force = np.concatenate([[0.0], force, [0.0]])
    axes.plot(closed_x, closed_force, **line)


# Axes


def speed_axis(axes: Axes, label: bool = True, inches: bool = True) -> None:
    """Impact speed along x in m/s, and in in/s on top for readers of the paper."""
    axes.xaxis.set_major_locator(MaxNLocator(6))
    if label:
        axes.set_xlabel("impact speed v, m/s")
    if inches:
        second_axis(axes, "top", "in/s")


def second_axis(
    axes: Axes, where: Literal["top", "right"], label: str, scale: float = INCH
) -> None:
    """Draw a second axis along x (top) or y (right) in other units.

    where: top or right.
    label: of the axis.
    scale: one such unit in the first's: 0.0254 for in/s over an axis in m/s.
    """
    functions = (lambda x: np.asarray(x) / scale, lambda x: np.asarray(x) * scale)
    if where == "top":
        second = axes.secondary_xaxis("top", functions=functions)
    else:
        second = axes.secondary_yaxis("right", functions=functions)
    second.spines[where].set_visible(False)
    second.tick_params(length=2.5, pad=1.5, labelsize=8, labelcolor=SLATE)
    axis = second.xaxis if where == "top" else second.yaxis
    axis.set_label_text(label, fontsize=8, color=SLATE)
    axis.labelpad = 2.0


def log_axis(axes: Axes, which: Literal["x", "y"]) -> None:
    """Make an axis, x or y, logarithmic, with powers of ten alone as ticks, labelled as "10⁻³"."""
    if which == "x":
        axes.set_xscale("log")
        axis: Axis = axes.xaxis
    else:
        axes.set_yscale("log")
        axis = axes.yaxis
    axis.set_major_locator(LogLocator(numticks=9))
    axis.set_major_formatter(FuncFormatter(lambda value, _: power_of_ten(value)))
    axis.set_minor_locator(NullLocator())


def set_ticks(
    axis: Axis, ticks: Sequence[float], text: Callable[[float], str] = "{:g}".format
) -> None:
    """These ticks and no others."""
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_major_formatter(FuncFormatter(lambda value, _: text(value)))
    axis.set_minor_locator(NullLocator())


# Labels


def declutter(positions: Sequence[float] | Floats, gap: float, low: float, high: float) -> Floats:
    """Positions nearest to these by least squares, at least `gap` apart, within `low` to `high`:
    for labels beside lines.

    positions: shape (n,), in any order; the result has their order.
    The gap gives way if there are more labels than room.
    """
    count = len(positions)
    gap = min(gap, (high - low) / max(count - 1, 1))
    # Less k gaps, the k-th position must only not fall: then each gap is kept.
    order = np.argsort(positions, kind="stable")
    steps = gap * np.arange(count)
    unclipped = rising(np.asarray(positions, dtype=float)[order] - steps)
    out: Floats = np.empty(count)
    out[order] = np.clip(unclipped, low, high - gap * (count - 1)) + steps
    return out


def legend_below(figure: Figure, handles: list[Line2D]) -> None:
    """One legend for all panels, under them, in as many columns as fit.

    handles: a line for each entry, one or more, which has its label.
    """
    labels = [str(h.get_label()) for h in handles]
    # Width of the longest entry in points, at the legend's font size.
    entry = 52 + 5.9 * max(map(len, labels))
    columns = max(1, int(72 * figure.get_figwidth() / entry))
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=min(columns, len(handles)),
        handlelength=2.8,
        columnspacing=1.6,
    )
