"""A refusal of a table says how its header was read, and shows lines that would be read."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from measured_bounces import EXACT

import hcbench as hb
from hcbench.fitting.column_names import DATA_KINDS
from hcbench.fitting.read import KINDS, read_datasets
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
    header = header.replace("squared [kg]", "energy_ratio [kg]")
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


DOWN = "0,80.0\n1,51.2\n2,32.8\n3,21.0\n4,13.4\n5,8.6\n"


@pytest.mark.parametrize(
    "header",
    [
        *("n,2h (cm)", "n,100 h (m)", "n,10 h (cm)", "n,h/2 (cm)", "n,height (cm)/2"),
        *("n,height*2 (cm)", "n,h×10 (cm)", "n,h - 5 (cm)", "n,h+6 (cm)", "n,1 - h (m)"),
    ],
)
def test_a_name_that_computes_is_no_name_of_the_quantity(tmp_path: Path, header: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(f"{header}\n{DOWN}")
    with pytest.raises(UserError, match="computes with its quantity"):
        read_datasets(path, EXACT)


@pytest.mark.parametrize(
    "header", ["n,h1 (cm)", "n,h_1 (cm)", "n,height 1 (cm)", "n,height 2 (cm)"]
)
def test_a_number_in_a_name_computes_nothing(tmp_path: Path, header: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(f"{header}\n{DOWN}")
    assert len(read_datasets(path, EXACT)) == 1


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("bounce,height (cm)\n0,80 %\n1,46 %\n2,30 %\n", "'%' under 'height'"),
        ("bounce,duration (s)\n1,0.8\n2,0.6\n4,0.3\n5,0.2\n", "flights are left out"),
        ("bounce,duration (s)\n1,0.2\n2,0.3\n3,0.4\n", "longer and longer"),
        ("bounce,duration (ms)\n1,4.3\n2,4.2\n3,4.1\n4,4.0\n", "at most 0.0043 s"),
        ("time (s),speed (m/s)\n0.1,1\n0.2,2\n0.3,3\n0.4,4\n", "times beside a speed"),
        ("drop,height (cm)\n1,61.2\n2,60.8\n3,60.1\n", "a row for each 'drop'"),
        ("mesure,hauteur (cm)\n1,61.2\n2,60.8\n3,60.1\n", "a row for each 'mesure'"),
        ("touch,time (25 fps)\n1,0:03:11\n2,0:04:07\n3,0:05:00\n", "frames in the times"),
        ("trial,height (cm)\n1,61.2\n2,60.8\n3,60.1\n", "a row for each 'trial'"),
        ("drop height (cm),height after 2 bounces (cm)\n80,40\n60,35\n", "first rebound"),
    ],
)
def test_what_a_table_says_beside_its_numbers_counts(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=says):
        read_datasets(path, EXACT)


def test_trials_beside_each_other_are_drops_whose_bounces_go_down(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    rows = [
        f"{n},{a},{0.99 * a:.3f},{1.01 * a:.3f}" for n, a in enumerate((80.0, 51.2, 32.8, 21.0))
    ]
    path.write_text("Bounce,Height 1 (cm),Height 2 (cm),Height 3 (cm)\n" + "\n".join(rows) + "\n")
    drops = read_datasets(path, EXACT)
    assert [len(drop.pairs()[0]) for drop in drops] == [3, 3, 3]


def test_the_height_of_the_balls_top_is_no_height_of_a_bounce(tmp_path: Path) -> None:
    """Such a height is a diameter too large."""
    path = tmp_path / "table.csv"
    path.write_text("bounce,height of top of ball [cm]\n1,36.7\n2,21.2\n3,15.1\n4,12.4\n")
    with pytest.raises(UserError, match="height of top of ball"):
        hb.fit(path)


# Anything that JSON has in place of a part of a notebook.
STRANGE = ["null", "1", "true", '"x"', '""', "[]", "{}", "[null]", "[[]]", '{"text/plain": 1}']
NOTEBOOKS = [
    '{"nbformat": 4, "cells": PART}',
    '{"nbformat": PART, "cells": []}',
    '{"nbformat": 4, "cells": [PART]}',
    '{"nbformat": 4, "cells": [{"source": PART}]}',
    '{"nbformat": 4, "cells": [{"outputs": PART}]}',
    '{"nbformat": 4, "cells": [{"outputs": [PART]}]}',
    '{"nbformat": 4, "cells": [{"outputs": [{"text": PART}]}]}',
    '{"nbformat": 4, "cells": [{"outputs": [{"data": PART}]}]}',
    '{"nbformat": 4, "cells": [{"outputs": [{"data": {"text/plain": PART}}]}]}',
]


@pytest.mark.parametrize("form", [*NOTEBOOKS, "PART", "[PART]", "[[1], PART]", '{"a": PART}'])
def test_json_of_wrong_types_is_refused_as_a_table(tmp_path: Path, form: str) -> None:
    path = tmp_path / "drop.ipynb"
    for part in STRANGE:
        path.write_text(form.replace("PART", part), encoding="utf-8")
        with pytest.raises(UserError):
            read_datasets(path, EXACT)


def test_a_notebook_with_damaged_cells_is_refused_as_one(tmp_path: Path) -> None:
    path = tmp_path / "drop.ipynb"
    path.write_text('{"nbformat": 4, "cells": [{"source": null}]}', encoding="utf-8")
    with pytest.raises(UserError, match="a notebook with damaged cells"):
        read_datasets(path, EXACT)
