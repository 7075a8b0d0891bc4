"""A fit in a notebook: its table and its curve."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from hcbench.fitting.result import band, headline, odds_text
from hcbench.fitting.which_law import LAWS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.axes import Axes

    from hcbench.fitting.result import FitResult


def as_html(result: FitResult) -> str:
    """The result, every law with its odds, and readings to check, as HTML tables."""
    facts = _rows(headline(result).items())
    laws = _rows(
        (fit.law.name, LAWS[fit.law.name].formula, odds_text(odds))
        for fit, odds in zip(result.fits, result.odds, strict=True)
    )
    head = "<thead><tr><th>law</th><th>e</th><th>odds</th></tr></thead>"
    notes = ""
    for flag in result.flags:
        notes += f"<p>check: {escape(flag.file)}, {escape(flag.touch)}</p>"
    return f"<table>{facts}</table><table>{head}{laws}</table>{notes}"


def _rows(rows: Iterable[tuple[str, ...]]) -> str:
    """HTML of a table's body."""
    lines = []
    for row in rows:
        cells = "".join(f"<td>{escape(cell)}</td>" for cell in row)
        lines.append(f"<tr>{cells}</tr>")
    body = "".join(lines)
    return f"<tbody>{body}</tbody>"


def draw_curve(axes: Axes, result: FitResult, of_law: str, of_data: Sequence[str]) -> None:
    """e over impact speed: the data as one reads them off, the law with its 95 % band.

    of_law, of_data: colours, of the data one a file.
    """
    speeds, e, low, high = band(result)
    axes.fill_between(speeds, low, high, color=of_law, alpha=0.18, linewidth=0)
    axes.plot(speeds, e, color=of_law, label=f"{result.best.law.name}, 95 % band")
    for i, s in enumerate(result.sets):
        colour = of_data[i % len(of_data)]
        axes.plot(*s.pairs(), linestyle="none", marker="o", color=colour, label=s.name)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("impact speed v, m/s")
    axes.set_ylabel("restitution e")
    axes.legend(loc="best")
