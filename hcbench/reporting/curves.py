"""The numbers behind a figure: each curve as it is drawn, as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Columns of the table. A panel is named by its title or its number.
COLUMNS = ("panel", "curve", "x_axis", "x", "y_axis", "y")
# Fewer points mark a place in the figure.
_LEAST_POINTS = 2


def curves_of(figure: Figure) -> pd.DataFrame:
    """A row for each point of each curve, in the units of the axes, which `x_axis` and `y_axis` name.

    Lines across a whole panel and single marks guide the eye alone: they are left out. A panel is
    named by its title or its number, a curve by its label or its number. Without curves the table
    has no rows.
    """
    # pandas is slow to import.
    import pandas as pd

    parts = []
    for number, axes in enumerate(figure.axes, 1):
        panel = axes.get_title() or f"{number}"
        x_axis = axes.get_xlabel() or _shared(axes, "x")
        y_axis = axes.get_ylabel() or _shared(axes, "y")
        for place, line in enumerate(axes.get_lines(), 1):
            x, y = (np.asarray(each, dtype=float) for each in line.get_data(orig=False))
            if line.get_transform() != axes.transData or len(x) < _LEAST_POINTS:
                continue
            # Matplotlib gives a line without a label one that begins with an underscore.
            label = str(line.get_label())
            if label.startswith("_"):
                label = f"curve {place}"
            columns: dict[str, Any] = dict(
                zip(COLUMNS, (panel, label, x_axis, x, y_axis, y), strict=True)
            )
            parts.append(pd.DataFrame(columns))
    if not parts:
        return pd.DataFrame(columns=list(COLUMNS))
    return pd.concat(parts, ignore_index=True)


def _shared(axes: Axes, which: str) -> str:
    """The name that another panel gives to an axis which it shares with this one; "" without one.

    which: "x" or "y".
    """
    group = axes.get_shared_x_axes() if which == "x" else axes.get_shared_y_axes()
    for other in group.get_siblings(axes):
        name: str = other.get_xlabel() if which == "x" else other.get_ylabel()
        if name:
            return name
    return ""


def csv_of(figure: Figure) -> bytes:
    """The table as CSV, in six digits, which do not depend on the processor."""
    text: str = curves_of(figure).to_csv(index=False, float_format="%.6g", lineterminator="\n")
    return text.encode()
