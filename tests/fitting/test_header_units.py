"""Units in a header without brackets, and files of other kinds than a table."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from hcbench.fitting.column_names import role_of, split_header
from hcbench.fitting.sheets import read_sheets
from hcbench.fitting.table import unit_scale
from hcbench.system.errors import UserError


@pytest.mark.parametrize("unit", ["mph", "km/h", "ft/s", "in/s", "m/s"])
@pytest.mark.parametrize("header", ["speed {}", "speed in {}", "speed, {}", "speed_{}"])
def test_a_unit_of_speed_needs_no_brackets(header: str, unit: str) -> None:
    assert split_header(header.format(unit)) == ("speed", unit)


@pytest.mark.parametrize(
    "unit",
    ["m s-1", "m·s⁻¹", "m.s-1", "m*s^-1", "m s^-1", "mps", "m_s", "m_per_s", "meters per second"],
)
@pytest.mark.parametrize("header", ["speed [{}]", "speed_{}", "speed {}"])
def test_metres_a_second_are_read_in_every_spelling(header: str, unit: str) -> None:
    name, read = split_header(header.format(unit))
    assert (name, unit_scale("file", name, read, "speed")) == ("speed", 1.0)


@pytest.mark.parametrize(
    ("header", "name", "si"),
    [
        ("speed_kmh", "speed", 1 / 3.6),
        ("speed_kph", "speed", 1 / 3.6),
        ("speed [kmh]", "speed", 1 / 3.6),
        ("speed (km h-1)", "speed", 1 / 3.6),
        ("height_mm", "height", 1e-3),
        ("height_inches", "height", 0.0254),
        ("height in metres", "height", 1.0),
    ],
)
def test_other_units_are_read_as_people_spell_them(header: str, name: str, si: float) -> None:
    quantity = {"speed": "speed", "height": "position"}[name]
    read, unit = split_header(header)
    assert read == name
    assert unit_scale("file", name, unit, quantity) == pytest.approx(si)


@pytest.mark.parametrize(
    "word", ["uncertainty", "std", "sd", "SE", "error", "σ", "±", "error bar", "Unsicherheit"]
)
@pytest.mark.parametrize(("name", "role"), [("e", "u_restitution"), ("height", "u_height")])
def test_a_word_for_uncertainty_in_brackets_is_no_unit(name: str, role: str, word: str) -> None:
    found, unit = split_header(f"{name} ({word})")
    assert (role_of(found), unit) == (role, "")


@pytest.mark.parametrize("unit", ["m s-2", "m-1", "m/s-1", "s-1", "m s--1", "m s-12"])
def test_another_power_is_no_speed(unit: str) -> None:
    with pytest.raises(UserError, match="is not such a unit"):
        unit_scale("file", "speed", unit, "speed")


@pytest.mark.parametrize("header", ["time {}s", "time [{}s]", "time ({}s)", "time_{}s"])
@pytest.mark.parametrize("micro", ["\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}"])
def test_both_letters_for_micro_are_read(header: str, micro: str) -> None:
    assert split_header(header.format(micro)) == ("time", "\N{MICRO SIGN}s")


@pytest.mark.parametrize("name", ["drop.zip", "drop.csv"])
def test_a_table_in_a_zip_archive_is_read_whatever_its_suffix(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("drop.csv", "time [s]\n1\n")
        archive.writestr("meta/device.csv", "property,value\nversion,1.1\n")
    (sheet,) = read_sheets(path)
    assert sheet.rows == ((1, ("time [s]",)), (2, ("1",)))


def test_an_archive_without_tables_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "drop.zip", "w") as archive:
        archive.writestr("drop.png", "no table")
    with pytest.raises(UserError, match="a zip archive without tables"):
        read_sheets(tmp_path / "drop.zip")
