"""Meaning of a table's columns, by the names in its header."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.column_names import EXPECTED_COLUMNS, NAMES, role_of
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from hcbench.fitting.table import Table
    from hcbench.terms.impact import Floats

# Columns that programs and people write besides the data; they say nothing of the bounces.
_BESIDE = frozenset(
    [
        "#",
        "n",
        "no",
        "no.",
        "nr",
        "nr.",
        "i",
        "k",
        "id",
        "index",
        "row",
        "number",
        "bounce",
        "bounces",
        "bounce_no",
        "bounce_number",
        "impact",
        "trial",
        "run",
        "drop",
        "ball",
        "frame",
        "step",
        "sample",
        "name",
        "file",
        "date",
        "note",
        "notes",
        "comment",
        "comments",
        "remark",
        "remarks",
        "color",
        "colour",
        "energy",
        "amplitude",
        "vx",
        "vy",
        "v_x",
        "v_y",
        "v_{x}",
        "v_{y}",
        "ax",
        "ay",
        "a_{x}",
        "a_{y}",
        "pixelx",
        "pixely",
    ]
) | {
    "bounce no",
    "bounce no.",
    "bounce number",
    "bounce #",
    "trial no",
    "x velocity",
    "y velocity",
    "velocity x",
}


@dataclass(frozen=True, slots=True)
class DataColumns:
    """The columns of a table by what they are: SI, shape (n,);
    uncertainties under "u_" and the name.
    """

    table: Table
    places: dict[str, int]

    def get(self, role: str) -> Floats:
        """A column of the file."""
        return self.table.column(self.places[role], NAMES[role.removeprefix("u_")][0])

    def uncertainty(self, role: str) -> Floats:
        """The standard uncertainties of a column, 0 where none are given."""
        name = f"u_{role}"
        if name not in self.places:
            return np.zeros(len(self.table.cells))
        values = self.get(name)
        self.require(name, values >= 0, "0 or more")
        return values

    def require(self, role: str, good: ArrayLike, expected: str) -> None:
        """Raise UserError for the first row that is not good."""
        bad = np.flatnonzero(~np.asarray(good, dtype=bool))
        if bad.size:
            i = int(bad[0])
            cell = self.table.cells[i][self.places[role]].strip()
            name = self.table.header[self.places[role]][0]
            where = f"{self.table.name}, line {self.table.lines[i]}"
            raise UserError(where, f"{name} {cell}", expected)


def columns_of(table: Table) -> DataColumns:
    """Identify the columns by the names in the header; columns that do not concern bounces are left
    out.

    Raises UserError for a name that is not known: it may change what the others mean.
    """
    places: dict[str, int] = {}
    named = {role_of(name) for name, _ in table.header}
    for i, (name, _) in enumerate(table.header):
        role = role_of(name)
        if _is_beside(table, i, role, named):
            continue
        if not role:
            got = f"a column {name!r}"
            raise UserError(table.name, got, EXPECTED_COLUMNS, "Leave other columns out")
        if role in places:
            raise UserError(
                table.name, f"two columns of {role.replace('u_', 'uncertainty of ')}", "one"
            )
        places[role] = i
    return DataColumns(table, places)


def _is_beside(table: Table, i: int, role: str, named: set[str]) -> bool:
    """Say whether programs write this column besides the data: row numbers, notes, another axis."""
    name = " ".join(table.header[i][0].split())
    if role == "interval":
        return "time" in named
    # A track of a video gives the place of the ball as x: only a force makes it a penetration.
    if role == "penetration":
        is_track = {"time", "height"} <= named and "force" not in named
        return name == "x" and is_track
    if role:
        return False
    if name in _BESIDE:
        return True
    numbers = [table.number(row[i]) for row in table.cells if i < len(row)]
    is_index = not name and numbers[:1] in ([0], [1]) and bool(np.all(np.diff(numbers) == 1))
    # pandas writes its index as a first column without a name.
    return is_index or not any(map(math.isfinite, numbers))
