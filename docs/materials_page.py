"""The table of materials in docs/reference/materials.md, made from the file that ships in the wheel.

python docs/materials_page.py   writes it
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from hcbench.catalogue.find import materials
from hcbench.catalogue.material import MaterialPair

PAGE = Path(__file__).parent / "reference" / "materials.md"
BEGIN, END = "<!-- begin materials: python docs/materials_page.py -->\n", "<!-- end materials -->"
_COLUMNS = ("pair", "e or α", "speeds, m/s", "how it was measured", "source")


def table() -> str:
    """The table: one measurement in each row, those of a pair below each other."""
    lines = [f"| {' | '.join(_COLUMNS)} |", f"|{'---|' * len(_COLUMNS)}"]
    for _, group in groupby(materials(), key=lambda each: each.name):
        lines += map(_row, group)
    return "\n".join(lines) + "\n"


def _row(each: MaterialPair) -> str:
    numbers = each.numbers
    if each.points:
        numbers = "; ".join(f"{e:g} at {v:g}" for v, e in sorted(each.points))
    if each.uncertainty:
        numbers += f" ({each.uncertainty})"
    bodies = " on ".join(each.bodies)
    if each.size:
        bodies += f", {each.size}"
    how = each.measured
    if each.note:
        how += f". {each.note}"
    if each.friction:
        how += f" Friction: {each.friction}."
    source = f"{each.source.document}, {each.source.place}. Read: {each.source.read_at}."
    name = f"**{each.name}**, `{each.id}`: {bodies}"
    return f"| {name} | {numbers} | {_speeds(each)} | {how} | {each.source.level}: {source} |"


def _speeds(each: MaterialPair) -> str:
    if each.speed_range_m_per_s is None:
        return "not stated"
    low, high = each.speed_range_m_per_s
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def write() -> None:
    """Write the table into the page."""
    head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    PAGE.write_text(
        head + BEGIN + "\n" + table() + "\n" + END + rest.split(END)[1], encoding="utf-8"
    )


if __name__ == "__main__":
    write()
