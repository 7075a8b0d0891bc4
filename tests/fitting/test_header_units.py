"""Units in a header without brackets, and files of other kinds than a table."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from hcbench.fitting.table import read_lines, split_header
from hcbench.system.errors import UserError


@pytest.mark.parametrize("unit", ["mph", "km/h", "ft/s", "in/s", "m/s"])
@pytest.mark.parametrize("header", ["speed {}", "speed in {}", "speed, {}", "speed_{}"])
def test_a_unit_of_speed_needs_no_brackets(header: str, unit: str) -> None:
    assert split_header(header.format(unit)) == ("speed", unit)


@pytest.mark.parametrize("header", ["time {}s", "time [{}s]", "time ({}s)", "time_{}s"])
@pytest.mark.parametrize("micro", ["\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}"])
def test_both_letters_for_micro_are_read(header: str, micro: str) -> None:
    assert split_header(header.format(micro)) == ("time", "\N{MICRO SIGN}s")


@pytest.mark.parametrize("name", ["drop.zip", "drop.csv"])
def test_a_zip_archive_is_named_whatever_its_suffix(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("drop.csv", "time [s]\n1\n")
    with pytest.raises(UserError, match="a zip archive"):
        read_lines(path)
