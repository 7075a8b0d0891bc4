"""Measured pairs of speed and e are read as people write them, or refused by their line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from checks import ask

from hcbench.checking import CheckSpec, check
from hcbench.checking.baseline import read_pairs
from hcbench.system.errors import UserError
from hcbench.system.files import MOST_BYTES


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("# only a remark\n", "has no rows of numbers"),
        ("speed,restitution\n1,0.9\n", "names no unit"),
        ("1,0.9\n2,0.8\n", "expected a header"),
        ("speed [kg],restitution\n1,0.9\n", "'kg' under 'speed' is not such a unit"),
        ("speed [wibble],e\n1,0.9\n", "'wibble' under 'speed' is not such a unit"),
        ("speed [m/s],e\n", "no rows"),
        ("speed [m/s],e\n1,fast\n", "line 2: 'fast'"),
        ("speed [m/s],e\n1,nan\n", "columns speed, e"),
        ("speed [m/s],e\n1,0.9\n2,nan\n", "line 3: 'nan'"),
        ("speed [m/s],e\n\n1,0.9\n1,0.8\n", "line 4: speed 1; expected each speed once"),
        ("speed [m/s],e\n1.5,0.9,3\n0.7,0.8,3\n", "3 cells"),
        ("speed [m/s],e\n2,0,0,9\n3,0,0,8\n", "4 cells"),
        ("speed [m/s],e\n1,1.4\n", "line 2: e 1.4"),
        ("speed [m/s],e\n-1,0.4\n", "above 0"),
    ],
)
def test_pairs_that_cannot_be_used_name_their_line(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "pairs.csv"
    file.write_text(text)
    with pytest.raises(UserError, match=re.escape(words)) as caught:
        read_pairs(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "v (m/s),e\n0.5,0.9\n0.1,0.95\n",
        "e;v {m/s}\n0.9;0.5\n0.95;0.1\n",
        "\ufeffspeed [m/s]\trestitution\n0.1\t0.95\n0.5\t0.9\n",
        "speed [cm/s],coefficient of restitution\n50,0.9\n10,0.95\n",
        "speed [m/s],e,remark\n0.5,0.9,good\n0.1,0.95,good\n",
    ],
)
def test_pairs_are_read_as_people_write_them(tmp_path: Path, text: str) -> None:
    file = tmp_path / "pairs.csv"
    file.write_text(text, encoding="utf-8")
    assert [x for pair in read_pairs(file) for x in pair] == pytest.approx([0.1, 0.95, 0.5, 0.9])


def test_an_input_without_an_end_is_not_read_to_it(tmp_path: Path) -> None:
    endless = tmp_path / "endless.toml"
    endless.symlink_to("/dev/zero")
    longest = tmp_path / "longest.toml"
    with longest.open("wb") as file:
        file.truncate(MOST_BYTES + 1)
    for path, reason in ((endless, "a pipe or a device"), (longest, "has more than")):
        for spec in (ask(points=path), ask(baseline=path), CheckSpec(model=str(path))):
            with pytest.raises(UserError, match=reason):
                check(spec)


def test_pairs_from_no_file_or_no_text(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is not a file"):
        read_pairs(tmp_path / "gone.csv")
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(UserError, match="neither text"):
        read_pairs(tmp_path / "bytes.csv")
