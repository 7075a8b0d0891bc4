"""Names of columns, the kind of number under each, and what a refusal of a table says of them."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from hcbench.system.errors import UserError
from hcbench.terms import units

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

# Names that a column may have, and the kind of number in it.
NAMES: dict[str, tuple[str, tuple[str, ...]]] = {
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
_ROLE_OF = {name: role for role, (_, names) in NAMES.items() for name in names}
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
# Sets of columns that are data, by their roles, and the kind of data.
DATA_KINDS: dict[frozenset[str], str] = {
    frozenset({"time"}): "times",
    frozenset({"height"}): "heights",
    frozenset({"time", "height"}): "track",
    frozenset({"speed", "restitution"}): "pairs",
    frozenset({"speed_in", "restitution"}): "pairs",
    frozenset({"speed_in", "speed_out"}): "speeds",
    frozenset({"interval"}): "times",
    frozenset({"height_in", "height_out"}): "rises",
    frozenset({"time", "force"}): "force",
    frozenset({"penetration", "rate", "force"}): "loop",
}
# A header and a number of each role, as a file may have them.
_EXAMPLES = {
    "time": ("time [s]", "0.32"),
    "interval": ("interval [s]", "0.41"),
    "height": ("height [cm]", "24.5"),
    "height_in": ("drop height [cm]", "50"),
    "height_out": ("rebound height [cm]", "31"),
    "speed": ("speed [m/s]", "1.2"),
    "speed_in": ("v_in [m/s]", "1.2"),
    "speed_out": ("v_out [m/s]", "0.9"),
    "restitution": ("restitution", "0.75"),
    "penetration": ("penetration [um]", "4.5"),
    "rate": ("rate [m/s]", "0.3"),
    "force": ("force [N]", "12"),
}
# Columns that a refusal shows, and letters of each name, at most.
_MOST_SHOWN = 4
_LETTERS = 24


def role_of(name: str) -> str:
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


@contextmanager
def explained(name: str, header: Sequence[tuple[str, str]]) -> Iterator[None]:
    """Add to each refusal of a table how hcbench read its header, and lines that it reads.

    name: what errors call the file. header: names with their units, "" for none.
    Raises the UserError of the block again, with the longer advice where it is about the table.
    """
    try:
        yield
    except UserError as error:
        if not error.slot.startswith(name):
            raise
        advice = [error.advice, _read_as(header)]
        # EXPECTED_COLUMNS are lines that are read: they do where no name was known.
        if error.expected != EXPECTED_COLUMNS or any(role_of(name) for name, _ in header):
            advice.append(_lines_that_are_read(header))
        text = ". ".join(filter(None, advice))
        raise type(error)(error.slot, error.got, error.expected, text) from error


def _read_as(header: Sequence[tuple[str, str]]) -> str:
    """Sentence on how hcbench read the columns: "Read: 'time [s]' as time in s, 'foo' as nothing"."""
    shown = []
    for name, unit in header[:_MOST_SHOWN]:
        role = role_of(name)
        cell = f"{name[:_LETTERS]} [{unit}]" if unit else name[:_LETTERS]
        meaning = "nothing"
        if role:
            bare = role.removeprefix("u_")
            meaning = _EXAMPLES[bare][0].partition(" [")[0]
            if role != bare:
                meaning = f"uncertainty of {meaning}"
            if units.QUANTITIES[NAMES[bare][0]].unit:
                meaning += f" in {unit}" if unit else " without a unit"
        shown.append(f"{cell!r} as {meaning}")
    if len(header) > _MOST_SHOWN:
        shown.append(f"and {len(header) - _MOST_SHOWN} more")
    return f"Read: {', '.join(shown)}" if shown else ""


def _lines_that_are_read(header: Sequence[tuple[str, str]]) -> str:
    """Lines of a table of the kind that a header is nearest to."""
    roles = {role_of(name) for name, _ in header}
    nearest = max(DATA_KINDS, key=lambda needed: len(needed & roles) - len(needed ^ roles) / 100)
    examples = [_EXAMPLES[role] for role in _EXAMPLES if role in nearest]
    names, numbers = zip(*examples, strict=True)
    return f"Lines that are read: {','.join(names)!r}, {','.join(numbers)!r}"
