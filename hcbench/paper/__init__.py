"""Hunt and Crossley 1975: its figures drawn again, and the numbers behind them.

>>> import hcbench as hb
>>> loops = hb.paper.data("figure-4")
>>> sorted(set(loops.curve))
['12 in/s', '16 in/s', '4 in/s', '8 in/s']
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.system.errors import UserError
from hcbench.terms.arguments import checked

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["data", "figure", "names"]


def names() -> tuple[str, ...]:
    """Names of the figures, in the page's order."""
    return tuple(_drawings(quick=True))


@checked
def figure(name: str, *, quick: bool = False) -> Figure:
    """A figure of the paper's page, as `hcbench paper` draws it.

    Parameters
    ----------
    name : text
        Such as "figure-4"; `names` lists them.
    quick : bool
        Fewer parameters in the figures of forced motion, which take minutes.

    Returns
    -------
    matplotlib.figure.Figure
        In hcbench's style, regardless of matplotlib's settings.

    Raises
    ------
    UserError
        For an unknown name.

    """
    from hcbench.reporting.plot_style import figure_defaults

    drawings = _drawings(quick)
    if name not in drawings:
        raise UserError("name", f"{name!r:.80}", f"one of: {', '.join(drawings)}")
    with figure_defaults():
        drawn = drawings[name]()
    found: Figure = drawn[0] if isinstance(drawn, tuple) else drawn
    return found


@checked
def data(name: str, *, quick: bool = False) -> pd.DataFrame:
    """The numbers behind a figure, as `hcbench paper` writes them beside it (CSV).

    Parameters
    ----------
    name : text
        Such as "figure-4"; `names` lists them.
    quick : bool
        Fewer parameters in the figures of forced motion, which take minutes.

    Returns
    -------
    pandas.DataFrame
        A row for each point of each curve: `panel`, `curve`, and `x` and `y` in the units that `x_axis`
        and `y_axis` name, as drawn. `hcbench.law(...).loop` has loops in SI.

    Raises
    ------
    UserError
        For an unknown name.

    """
    from hcbench.reporting.page import curves_of

    return curves_of(figure(name, quick=quick))


def _drawings(quick: bool) -> dict[str, Any]:
    """Functions that draw the figures, by name."""
    from hcbench.paper.page import drawings
    from hcbench.paper.vibroimpact_figures import FULL, QUICK

    return {each.name: each.draw for each in drawings(QUICK if quick else FULL)}
