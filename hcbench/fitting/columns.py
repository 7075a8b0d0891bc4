"""Meaning of a table's columns, by the names in its header."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from hcbench.fitting.table import Table
    from hcbench.terms.impact import Floats

# Names that a column may have, and the kind of number in it.
_NAMES: dict[str, tuple[str, tuple[str, ...]]] = {
    "time": (
        "time",
        (
            "time",
            "t",
            "touch",
            "touch time",
            "impact time",
            "time of impact",
            "event time",
            "zeit",
            "temps",
            "timestamp",
        ),
    ),
    "interval": (
        "time",
        (
            "interval",
            "intervals",
            "dt",
            "Δt",
            "δt",
            "time between bounces",
            "flight time",
            "flight",
        ),
    ),
    "height": (
        "position",
        ("height", "h", "y", "z", "position", "bounce height", "hoehe", "höhe", "hauteur"),
    ),
    "height_in": (
        "position",
        ("drop height", "drop", "h_drop", "h_in", "h0", "height in", "release height"),
    ),
    "height_out": (
        "position",
        ("rebound height", "rebound", "h_rebound", "h_out", "h1", "height out"),
    ),
    "speed": (
        "speed",
        (
            "speed",
            "v",
            "v_n",
            "vn",
            "impact speed",
            "approach speed",
            "impact velocity",
            "velocity",
        ),
    ),
    "speed_in": (
        "speed",
        (
            "v_in",
            "vin",
            "v in",
            "speed_in",
            "speed in",
            "v_i",
            "v_before",
            "v before",
            "speed before",
            "velocity in",
            "v1",
        ),
    ),
    "speed_out": (
        "speed",
        (
            "v_out",
            "vout",
            "v out",
            "speed_out",
            "speed out",
            "v_o",
            "v_after",
            "v after",
            "speed after",
            "velocity out",
            "rebound speed",
            "v2",
        ),
    ),
    "restitution": (
        "number",
        (
            "restitution",
            "e",
            "cor",
            "e_n",
            "en",
            "coefficient of restitution",
            "restitution coefficient",
            "cor e",
        ),
    ),
    "penetration": ("position", ("penetration", "x", "depth", "indentation", "approach")),
    "rate": ("speed", ("rate", "xdot", "penetration rate", "indentation rate")),
    "force": ("force", ("force", "f", "load")),
}
_ROLE_OF = {name: role for role, (_, names) in _NAMES.items() for name in names}
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
_BEFORE = (
    "u_",
    "u ",
    "sigma_",
    "sigma ",
    "sd_",
    "sd ",
    "uncertainty of ",
    "uncertainty ",
    "±",
    "d_",
)
_AFTER = (
    "_uncertainty",
    " uncertainty",
    "_error",
    " error",
    "_sd",
    " sd",
    "_sigma",
    " sigma",
    "_u",
    "_std",
)
EXPECTED_COLUMNS = (
    "columns such as time [s], height [cm], speed [m/s],restitution or v_in [m/s],v_out [m/s]"
)


@dataclass(frozen=True, slots=True)
class DataColumns:
    """The columns of a table by what they are: SI, shape (n,);
    uncertainties under "u_" and the name.
    """

    table: Table
    places: dict[str, int]

    def get(self, role: str) -> Floats:
        """A column of the file."""
        return self.table.column(self.places[role], _NAMES[role.removeprefix("u_")][0])

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
    named = {_role(name) for name, _ in table.header}
    for i, (name, _) in enumerate(table.header):
        role = _role(name)
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


def _role(name: str) -> str:
    """Role of a column with this name; "u_" and the role for an uncertainty, "" for an unknown
    name.
    """
    name = " ".join(name.split())
    if name in _ROLE_OF:
        return _ROLE_OF[name]
    bare_names = [*map(name.removeprefix, _BEFORE), *map(name.removesuffix, _AFTER)]
    for bare in bare_names:
        if bare != name and bare.strip() in _ROLE_OF:
            return f"u_{_ROLE_OF[bare.strip()]}"
    return ""


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
