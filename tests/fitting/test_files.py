"""Files and the command: what is read, and what is refused in one line."""

from __future__ import annotations

import io
import json
import math
import re
from pathlib import Path
from zipfile import ZipFile

import pytest
from measured_bounces import EXACT, synthesise, times_of, write
from table_dialects import workbook

import hcbench as hb
from hcbench.checking.baseline import parse_points
from hcbench.cli import run
from hcbench.fitting.read import read_datasets
from hcbench.fitting.which_law import LAWS
from hcbench.system.errors import UserError
from hcbench.terms.units import parse_uncertain


def test_the_command_hands_alpha_to_tune_and_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = times_of(synthesise.hunt_crossley(0.3), 4)
    path = write(tmp_path, "time [ms]\n" + "\n".join(f"{1e3 * t:.3f}" for t in times))
    points = tmp_path / "points.csv"
    assert run(["fit", path, "--gravity", "9.80665", "--json", "--write-points", str(points)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["law"] == "hunt-crossley, with or without e0"
    low, high = found["alpha_interval_95_s_per_m"]
    assert low < 0.3 < high
    assert low < found["alpha_s_per_m"] < high
    assert {law["law"] for law in found["laws"]} == set(LAWS)
    assert run(["fit", path]) == 0
    shown = capsys.readouterr().out
    assert 'hcbench tune mujoco --alpha "0.29' in shown and " +- 0.00" in shown
    assert len(parse_points(str(points))) == 20


def test_one_drop_below_itself_in_a_file_is_one_drop(tmp_path: Path) -> None:
    heights = "height [m]\n" + "\n".join(f"{0.8**n:.6f}" for n in range(8)) + "\n"
    assert len(read_datasets(Path(write(tmp_path, heights + "\n" + heights)), EXACT)) == 1


@pytest.mark.parametrize("place", ["XFD1048576", "B1048576", "XFD1000"])
def test_a_cell_far_from_the_others_is_named(tmp_path: Path, place: str) -> None:
    path = tmp_path / "drop.xlsx"
    content = workbook({"drop": [["height [m]"], ["0.4"], ["0.1"]]})
    with ZipFile(io.BytesIO(content)) as written, ZipFile(path, "w") as strayed:
        for member in written.namelist():
            text = written.read(member).decode()
            cell = f'<row><c r="{place}"><v>1</v></c></row></sheetData>'
            strayed.writestr(member, text.replace("</sheetData>", cell))
    with pytest.raises(UserError, match=f"a cell at {place}, far from the others"):
        read_datasets(path, EXACT)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time\n0.1\n0.2\n", "names no unit"),
        ("0.1\n0.2\n0.3\n", "a header"),
        ("time [s]\n0.1\nx\n", "line 3: 'x' under 'time'"),
        ("interval [s]\n0.1\nnan\n0.2\n", "line 3: 'nan'"),
        ("time [s]\n0.3\n0.2\n0.4\n0.5\n", "line 3: time 0.2; expected times that rise"),
        (
            "# sample rate: 1000 Hz\nsample,event\n100,touch\n600,touch\n550,touch\n",
            "line 5: sample 550; expected samples that rise",
        ),
        ("time [s]\n0.1\n0.4\n0.6\n", "3 touches"),
        ("height [m]\n0.4\n0.1\n1e400\n0.01\n", "line 4: '1e400' under 'height'"),
        ("height [m]\n0.4\n0.1\n0.05\nt\n0.01\n0.008\n", "the header 't' names no unit"),
        ("height [m]\n0.4\n0.\x001\n", "line 3: a null character"),
        ("height [m]\n0.4" + 70_000 * ",0.4" + "\n", "line 2: 280003 characters"),
        ("time [kg]\n0.1\n0.4\n0.6\n", "'kg'"),
        ("weather\n1\n", "'weather'"),
        ("speed [m/s],restitution\n1,0\n2,0\n3,0\n", "a rest only"),
        ("", "is empty"),
        ("time [s]\n", "no rows"),
    ],
)
def test_a_bad_file_is_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, says: str
) -> None:
    assert run(["fit", write(tmp_path, text)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line


def test_g_that_is_not_known_is_refused_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, "time [s]\n0.1\n0.4\n0.6\n0.7\n")
    assert run(["fit", path, "--gravity", "unknown"]) == 2
    assert "α g only" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        "0.31 +- 0.004 s/m",
        "0.31 s/m +- 0.004 s/m",
        "(0.31 ± 0.004) s/m",
        "0.31 +/- 0.004 s/m",
        "31e-2 ± 4e-3",
    ],
)
def test_a_quantity_may_have_an_uncertainty(text: str) -> None:
    assert parse_uncertain(text, "alpha") == pytest.approx((0.31, 0.004))


@pytest.mark.parametrize(
    "text", ["0.31 +- x s/m", "0.31 +- -1 s/m", "+- 0.1 s/m", "0.3 kg +- 0.1 s/m"]
)
def test_a_wrong_uncertainty_is_refused(text: str) -> None:
    with pytest.raises(UserError):
        parse_uncertain(text, "alpha")


TIMES = "time [s]\n0\n0.286\n0.488\n0.643\n0.77\n"
FALLS = "height [cm]\n" + "".join(f"{30 * 0.7**i:.6g}e{{power}}\n" for i in range(9))
LOOP = "penetration [um],rate [m/s],force [N]\n" + "".join(
    f"{10 * math.sin(0.05 * i):.6g},{0.5 * math.cos(0.05 * i):.6g},{{force}}\n"
    for i in range(1, 60)
)
PAIRS = "speed [m/s],restitution\n" + "".join(f"{0.1 + 1e-3 * i:.4f},0.9\n" for i in range(501))


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (TIMES, ("--gravity", "1e29"), "--gravity: 1e\\+29 m/s\\^2; expected 0 ... 1000 m/s"),
        (TIMES, ("--contact-time", "0.3"), "--contact-time: 0.3 s, and two touches 0.127 s apart"),
        (TIMES, ("--touches", "²:³"), "--touches: '²:³'; expected the first and the last"),
        (FALLS.format(power=149), (), "line 2: 30e149 under 'height'; expected 0, or 1e-12"),
        (
            TIMES.replace("\n0.", "\n0.0000000000000"),
            (),
            "line 3: .* under 'time'; expected 0, or 1e-12",
        ),
        (LOOP.format(force=0), (), "numbers that lead to no finite result"),
        (PAIRS, (), "501 impacts; expected up to 500"),
        (
            FALLS.format(power=0) + "".join(f"{0.9**i}\n" for i in range(1, 60)),
            (),
            "up to 60 touches",
        ),
    ],
)
def test_numbers_that_nobody_measures_are_refused_by_name(
    text: str,
    options: tuple[str, ...],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Tracebacks of NumPy and SciPy, or computations without an end."""
    (tmp_path / "a.csv").write_text(text)
    assert run(["fit", str(tmp_path / "a.csv"), *options]) == 2
    caught = capsys.readouterr()
    assert re.search(message, caught.err), caught.err
    assert len(caught.err.splitlines()) == 1
    assert caught.out == ""


def test_impacts_at_one_speed_are_refused_for_that(tmp_path: Path) -> None:
    (tmp_path / "pairs.csv").write_text("speed [m/s],restitution\n1,0.8\n1,0.81\n1,0.79\n")
    with pytest.raises(UserError, match="all at 1 m/s; expected two speeds or more"):
        hb.fit(tmp_path / "pairs.csv")


def test_a_fit_of_forces_prints_itself_in_a_few_lines(tmp_path: Path) -> None:
    depth = 1e-4  # m
    law = hb.law(alpha=0.3).force
    depths = [depth * (i + 1) / 30 for i in range(30)]
    ways = [(x, v) for v in (0.5, -0.5) for x in depths]
    rows = [f"{x},{v},{float(law.force(x, v))}" for x, v in ways]
    header = "penetration [m],rate [m/s],force [N]"
    (tmp_path / "loop.csv").write_text("\n".join([header, *rows]))
    lines = repr(hb.fit_force(tmp_path / "loop.csv")).splitlines()
    assert len(lines) <= 12
    assert lines[0].startswith("data      loop.csv: loop")
    assert float(lines[3].split()[1]) == pytest.approx(0.3, abs=1e-4)
