"""Results that display themselves: as HTML in a notebook, and as a figure of matplotlib's."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Shown:
    """What `hcbench.reporting.notebook` can draw. It is found by its name, because figures stand above all
    results, and because matplotlib should load only to draw.
    """

    __slots__ = ()

    def plot(self) -> Figure:
        """Its main figure: restitution over impact speed, for `Figure.savefig` or a notebook."""
        figure: Figure = _notebook().figure_of(self)
        return figure

    def _repr_html_(self) -> str:
        """What it found in words, and its main figure: how Jupyter shows it."""
        html: str = _notebook().html_of(self)
        return html


def _notebook() -> Any:
    return import_module("hcbench.reporting.notebook")
