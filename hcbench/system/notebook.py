"""Results that show themselves: in a few lines of text, as a table of
pandas, in a notebook, as a figure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import hcbench
from hcbench.system.text import COLUMNS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import pandas as pd
    from matplotlib.figure import Figure

# Lines of a repr, at most.
_LINES = 12


class Shown:
    """A result in at most 12 lines of text, as a table of pandas, and as that table in a notebook.

    A subclass states `_lines` and `_rows`.
    """

    __slots__ = ()

    def _lines(self) -> Iterable[str]:
        """The result in lines."""
        raise NotImplementedError

    def _rows(self) -> Iterable[Mapping[str, Any]]:
        """The rows of `to_frame`, SI; units stand in the names."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """The result in at most 12 lines of at most 100 columns."""
        lines = []
        for line in self._lines():
            if len(line) > COLUMNS:
                lines.append(line[: COLUMNS - 3] + "...")
            else:
                lines.append(line)
        if len(lines) > _LINES:
            lines[_LINES - 1 :] = ["..."]
        return "\n".join(lines)

    def to_frame(self) -> pd.DataFrame:
        """The result as a table of pandas; numbers are SI, and the columns' names have the units."""
        # pandas is slow to import.
        import pandas as pd

        return pd.DataFrame(list(self._rows()))

    def _repr_html_(self) -> str:
        """The table as Jupyter shows it."""
        html: str = self.to_frame().to_html(index=False, na_rep="", border=0)
        return html


class Drawn(Shown):
    """A result that hcbench draws: its figures stand above all results,
    and matplotlib is loaded late.
    """

    __slots__ = ()

    def plot(self) -> Figure:
        """The main figure: restitution over impact speed, for `Figure.savefig` or a notebook."""
        figure: Figure = hcbench._figures().figure_of(self)
        return figure

    def _repr_html_(self) -> str:
        """Show the text and the main figure in Jupyter."""
        html: str = hcbench._figures().html_of(self)
        return html
