"""How figures look: one colour and marker a recipe, one line a engine, the same in every figure and table.

Figures are drawn with matplotlib's object interface, on its bundled font, from its default settings: a user's
matplotlibrc changes nothing, and the same numbers give the same bytes.
"""

from __future__ import annotations

import io
import re
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator
from scipy.optimize import isotonic_regression

from hcbench.report.wording import INCH, power_of_ten

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

    from hcbench.impact import Floats

INK = "#26303a"  # text and axes
LAW = "#b9c0c7"  # the law: a broad pale band that curves can lie on and still be seen
LINEAR = "#5b6670"

# Colours after Okabe & Ito (2008) and Tol's muted set: told apart with any kind of colour vision; markers and
# dashes say the same again for print.
_RECIPES = {
    "stock": ("#D55E00", "X"),
    "spring-damper": ("#E69F00", "s"),
    "impulse": ("#0072B2", "o"),
    "restitution": ("#0072B2", "o"),
    "soft": ("#CC79A7", "D"),
    "two-pair": ("#56B4E9", "^"),
    "staggered": ("#009E73", "P"),
    "hunt-crossley": ("#882255", "v"),
    "restitution-law": ("#332288", "<"),
    "kelvin-voigt": ("#8a8a2b", "h"),
}
_SPARE = (("#661100", ">"), ("#117733", "p"), ("#44AA99", "d"), ("#AA4499", "8"), ("#6699CC", "H"))
_DASHES: tuple[tuple[float, ...], ...] = ((), (4.5, 1.6), (1.2, 1.2), (6.0, 1.5, 1.2, 1.5), (2.5, 1.0))

_RC: dict[str, Any] = {
    "axes.edgecolor": "#8b949c",
    "axes.formatter.useoffset": False,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 9.5,
    "axes.linewidth": 0.7,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlecolor": INK,
    "axes.titlesize": 10.5,
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "grid.color": "#e6e9ec",
    "grid.linewidth": 0.7,
    "legend.fontsize": 9.5,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "lines.markersize": 5.0,
    "svg.fonttype": "path",
    "svg.hashsalt": "hcbench",
    "text.color": INK,
    "text.parse_math": False,  # a setting's name may hold any sign
    "xtick.color": "#6b747c",
    "xtick.labelcolor": INK,
    "xtick.labelsize": 8.5,
    "ytick.color": "#6b747c",
    "ytick.labelcolor": INK,
    "ytick.labelsize": 8.5,
}


@dataclass(frozen=True, slots=True)
class Look:
    """How one setting of one engine is drawn. dashes: on-off lengths in points; () is a full line."""

    colour: str
    marker: str
    dashes: tuple[float, ...]
    hollow: bool

    def line(self, **more: Any) -> dict[str, Any]:
        """Keyword arguments for `Axes.plot`."""
        style: dict[str, Any] = {
            "color": self.colour,
            "linestyle": (0, self.dashes) if self.dashes else "-",
            "marker": self.marker,
            "markerfacecolor": "white" if self.hollow else self.colour,
            "markeredgecolor": self.colour,
        }
        return {**style, **more}


def looks(settings: Iterable[tuple[str, str]], law: str) -> dict[tuple[str, str], Look]:
    """A Look for each (engine, setting).

    A known setting has its own colour and marker, whatever else is in the study. Engines differ in their
    dashes, by their order in the study; `law`, the engine of the law itself, has full lines.
    """
    pairs = list(dict.fromkeys(settings))
    new_names = sorted({s for _, s in pairs} - set(_RECIPES))
    recipes = {**_RECIPES, **dict(zip(new_names, cycle(_SPARE), strict=False))}
    engines = dict.fromkeys(e for e, _ in pairs if e != law)
    dashes = {law: (), **dict(zip(engines, cycle(_DASHES), strict=False))}
    return {(e, s): Look(*recipes[s], dashes[e], hollow=bool(dashes[e])) for e, s in pairs}


@contextmanager
def drawing() -> Iterator[None]:
    """Matplotlib as hcbench wants it, and back to what it was after."""
    with mpl.rc_context():
        mpl.rcdefaults()
        for name, value in _RC.items():
            mpl.rcParams[name] = value  # type: ignore[index]
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches, laid out so that nothing overlaps."""
    return Figure(figsize=(width, height), layout="constrained")


def svg_bytes(figure: Figure) -> bytes:
    """The figure as SVG with no date, no program name and no digits that nobody can see."""
    buffer = io.BytesIO()
    figure.set_dpi(72)
    # Straight to the canvas: `savefig` would lay out and walk the whole figure twice.
    canvas: Any = FigureCanvasSVG(figure)
    canvas.print_svg(buffer, metadata={"Date": None, "Creator": None})
    figure.set_layout_engine("none")  # laid out once, for PNG too
    return _shortened(buffer.getvalue().decode()).encode()


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG, for places that show no SVG."""
    buffer = io.BytesIO()
    figure.set_dpi(110)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


_PATH = re.compile(r' (?:d|x|y)="[^"]*"')
_LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}")


def _shortened(svg: str) -> str:
    """Coordinates to 1/100 point: a third of the bytes gone and no pixel moved. Text keeps its scale."""

    def short(number: re.Match[str]) -> str:
        return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")

    return _PATH.sub(lambda path: _LONG_NUMBER.sub(short, path[0]), svg)


def speed_axis(axes: Axes, label: bool = True, inches: bool = True) -> None:
    """Impact speed along x in m/s, and in in/s on top for readers of the paper."""
    axes.xaxis.set_major_locator(MaxNLocator(6))
    if label:
        axes.set_xlabel("impact speed v, m/s")
    if inches:
        inch_axis(axes, "top", "in/s")


def inch_axis(axes: Axes, where: Literal["top", "right"], label: str, scale: float = INCH) -> None:
    """A second axis along x (top) or y (right) in the paper's units; `scale` is one such unit in SI."""
    functions = (lambda x: np.asarray(x) / scale, lambda x: np.asarray(x) * scale)
    if where == "top":
        second = axes.secondary_xaxis("top", functions=functions)
    else:
        second = axes.secondary_yaxis("right", functions=functions)
    second.spines[where].set_visible(False)
    second.tick_params(length=2.5, pad=1.5, labelsize=8, labelcolor=LINEAR)
    axis = second.xaxis if where == "top" else second.yaxis
    axis.set_label_text(label, fontsize=8, color=LINEAR)
    axis.labelpad = 2.0


def log_axis(axes: Axes, which: str) -> None:
    """A log axis with plain powers of ten."""
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(LogLocator(numticks=9))
    axis.set_major_formatter(FuncFormatter(lambda value, _: power_of_ten(value)))
    axis.set_minor_locator(NullLocator())


def every_few(count: int, nth: int) -> tuple[int, int]:
    """Which of `count` points of the nth line carry a marker: not the same ones as its neighbours' do."""
    return (nth % 4, 4) if count > 8 else (0, 1)


def spread_apart(wanted: Floats, gap: float, low: float, high: float) -> Floats:
    """Places nearest to `wanted` at least `gap` apart, within low ... high: for labels beside lines.

    The gap gives way where there are more labels than room.
    """
    count = len(wanted)
    gap = min(gap, (high - low) / max(count - 1, 1))
    order = np.argsort(wanted, kind="stable")
    steps = gap * np.arange(count)
    free = isotonic_regression(np.asarray(wanted, dtype=float)[order] - steps).x
    out: Floats = np.empty(count)
    out[order] = np.clip(free, low, high - gap * (count - 1)) + steps
    return out


def legend_below(figure: Figure, handles: list[Line2D]) -> None:
    """One legend for all panels, under them, in as many columns as fit."""
    labels = [str(h.get_label()) for h in handles]
    entry = 52 + 5.9 * max(map(len, labels))  # points, at the legend's font size
    columns = max(1, int(72 * figure.get_figwidth() / entry))
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=min(columns, len(handles)),
        handlelength=2.8,
        columnspacing=1.6,
    )
