"""A refusal of a table says how its header was read, and shows lines that would be read."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

import hcbench as hb
from hcbench.fitting.column_names import DATA_KINDS
from hcbench.fitting.read import KINDS
from hcbench.system.errors import LONGEST, UserError

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("time\n1\n2\n", "'time' as time without a unit"),
        ("time [kg]\n1\n2\n", "'time [kg]' as time in kg"),
        ("time [s]\n1\nx\n", "'time [s]' as time in s"),
        ("time [s]\n3\n2\n4\n5\n", "'time [s]' as time in s"),
        ("time [s]\n1\n4\n6\n", "'time [s]' as time in s"),
        ("time [s]\n", "'time [s]' as time in s"),
        ("time [s]\n1,000\n2,000\n", "'time [s]' as time in s"),
        ("time [s],foo\n1,2\n2,3\n", "'time [s]' as time in s, 'foo' as nothing"),
        ("time [s],t [ms]\n1,2\n", "'time [s]' as time in s, 't [ms]' as time in ms"),
        ("height [cm]\n3\n2\n2.5\n", "'height [cm]' as height in cm"),
        ("drop [cm],rebound [cm]\n3,5\n", "'rebound [cm]' as rebound height in cm"),
        ("vin [m/s],vout [m/s]\n1,2\n", "'vout [m/s]' as v_out in m/s"),
        ("speed [m/s],e,u_e\n1,.5,-1\n", "'u_e' as uncertainty of restitution"),
        ("force [N]\n1\n2\n", "'force [N]' as force in N"),
        ("a,b,c,d,e,f\n1,2,3,4,5,6\n", "'d' as nothing, and 2 more"),
        ("a,b\n1,2\n", "'a' as nothing, 'b' as nothing"),
    ],
)
def test_a_refusal_says_what_each_column_was_taken_for(
    tmp_path: Path, text: str, read: str
) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(UserError) as refused:
        hb.fit_force(path) if "force" in text else hb.fit(path)
    message = str(refused.value)
    assert f"Read: {read}" in message or ("Read: " in message and read in message)
    assert "Lines that are read: '" in message or "columns such as time [s]" in message
    assert len(message) <= LONGEST


@pytest.mark.parametrize("text", ["", "# a comment\n", "0.1\n0.2\n"])
def test_a_file_without_a_header_is_shown_one(tmp_path: Path, text: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=r"Lines that are read: 'time \[s\]', '0.32'"):
        hb.fit(path)


@pytest.mark.parametrize("roles", DATA_KINDS)
def test_the_lines_that_a_refusal_shows_are_read(tmp_path: Path, roles: frozenset[str]) -> None:
    path = tmp_path / "table.csv"
    of_kind = DATA_KINDS[roles]
    assert of_kind in KINDS
    # One row refuses any kind; what is refused then is no longer the header.
    header = ",".join(f"{role} [kg]" for role in sorted(roles)).replace("height_in", "drop")
    path.write_text(f"{header}\n{','.join('1' for _ in roles)}\n".replace("height_out", "h_out"))
    read = hb.fit_force if "force" in roles else hb.fit
    with pytest.raises(UserError) as refused:
        read(path)
    shown = re.search(r"Lines that are read: '(.*)', '(.*)'", str(refused.value))
    assert shown is not None
    path.write_text(f"{shown[1]}\n{shown[2]}\n")
    with pytest.raises(UserError) as refused:
        read(path)
    assert "unit" not in refused.value.got and "a column" not in refused.value.got
