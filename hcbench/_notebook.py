"""Results that show themselves: as HTML in a notebook, and as a figure of matplotlib's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import hcbench

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Shown:
    """A result that hcbench draws: its figures stand above all results, and matplotlib is loaded late."""

    __slots__ = ()

    def plot(self) -> Figure:
        """Its main figure: restitution over impact speed, for `Figure.savefig` or a notebook."""
        figure: Figure = hcbench._figures().figure_of(self)
        return figure

    def _repr_html_(self) -> str:
        """What it found in words, and its main figure: how Jupyter shows it."""
        html: str = hcbench._figures().html_of(self)
        return html
