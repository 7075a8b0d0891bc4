"""Numbers between words: logs, markup, subtitles, lists of programs; and tables with several drops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from measured_bounces import EXACT

from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.heights import Heights, SpeedPairs
from hcbench.fitting.read import read_dataset, read_datasets
from hcbench.fitting.sheets import read_sheets
from hcbench.fitting.tables import tables_of
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

T = 0.3194 + np.concatenate([[0.0], np.cumsum(0.46 * 0.82 ** np.arange(7))])
H = 70.0 * 0.66 ** np.arange(8)


def lines(form: str, values: Iterable[float] = T) -> str:
    return "".join(
        form.format(i=i, x=x, ms=1e3 * x, later=x + 0.02) + "\n" for i, x in enumerate(values, 1)
    )


def between(begin: str, text: str, end: str) -> str:
    return f"{begin}\n{text}{end}\n"


NUMBERS = ", ".join(f"{t:.4f}" for t in T)
OF_TIMES = {
    "log": lines("Touch {i}: {x:.4f} s"),
    "log of a logger": lines("2026-03-01 12:00:0{x:.3f} DEBUG hit"),
    "serial monitor": lines("14:22:0{x:.3f} -> bounce {i} t={ms:.1f} ms"),
    "records": lines("Bounce {i}\n  Impact time: {x:.4f} s\n  Comment: ok\n"),
    "records in TOML": lines("[[touch]]\nn = {i}\ntime_s = {x:.4f}\n"),
    "elements": between('<touches unit="s">', lines("<t><n>{i}</n><time>{x:.4f}</time></t>"), ""),
    "attributes": between(
        '<impacts timeUnit="ms">', lines('<impact id="{i}" time="{ms:.1f}"/>'), "</impacts>"
    ),
    "one line": "<r>" + "".join(f'<t unit="s">{t:.4f}</t>' for t in T) + "</r>",
    "subtitles": lines("{i}\n00:00:0{x:.3f} --> 00:00:0{later:.3f}\nhit\n"),
    "points of Praat": 'class = "TextTier"\nxmin = 0\nxmax = 4\n'
    + lines('points [{i}]:\n    number = {x:.4f}\n    mark = "c{i}"'),
    "intervals of Praat": 'class = "IntervalTier"\nxmin = 0\nxmax = 4\n'
    + "".join(
        f'intervals [{i}]:\n  xmin = {a:.4f}\n  xmax = {b:.4f}\n  text = "f"\n'
        for i, (a, b) in enumerate(zip(T, [*T[1:], 4.0], strict=True), 1)
    ),
    "SQL": "CREATE TABLE touches (id INTEGER, time_s REAL);\n"
    + lines("INSERT INTO touches VALUES({i},{x:.4f});"),
    "SQL with names": lines("INSERT INTO touches (id, time_s) VALUES ({i}, {x:.4f});"),
    "ARFF": "@relation r\n@attribute touch numeric\n@attribute time_ms numeric\n@data\n"
    + lines("{i},{ms:.1f}"),
    "columns listed": "# Column 1: touch\n# Column 2: time (s)\n" + lines("{i} {x:.4f}"),
    "Python": f"import numpy as np\ntimes = np.array([{NUMBERS}])  # seconds\n",
    "R": f"> t <- c({NUMBERS})\n",
    "C": f"double time_s[] = {{{NUMBERS}}};\n",
    "MATLAB": ">> t_touch   % seconds\n\nt_touch =\n\n" + lines("    {x:.4f}") + "\n>>\n",
    "Julia": "julia> t\n8-element Vector{Float64}:\n" + lines(" {x:.4f}"),
    "no header, ms": lines("{ms:.1f} ms"),
}


@pytest.mark.parametrize("text", OF_TIMES.values(), ids=OF_TIMES)
def test_times_between_words_are_read(tmp_path: Path, text: str) -> None:
    path = tmp_path / "data.txt"
    path.write_text(text)
    found = read_dataset(path, EXACT)
    assert isinstance(found, TouchTimes)
    np.testing.assert_allclose(np.diff(found.times), np.diff(T), atol=1.1e-3)


def test_lists_of_two_speeds_have_their_units_behind_them(tmp_path: Path) -> None:
    path = tmp_path / "data.py"
    path.write_text("v_in = [1.0, 2.0, 3.0, 4.0]  # m/s\nv_out = [90, 170, 240, 300]  # cm/s\n")
    found = read_dataset(path, EXACT)
    assert isinstance(found, SpeedPairs)
    np.testing.assert_allclose(found.restitution, [0.9, 0.85, 0.8, 0.75])


@pytest.mark.parametrize(
    "text",
    [
        lines("temperature 21.{i} t={x:.4f}", 0.3 * np.arange(8)),
        lines("bounce {i} lost {x:.1f} cm", H),
        "n,2h (cm)\n" + lines("{i},{x:.1f}", H),
    ],
    ids=["another number", "another quantity", "a table that is refused"],
)
def test_other_numbers_between_words_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "data.txt"
    path.write_text(text)
    with pytest.raises(UserError):
        read_datasets(path, EXACT)


LOWER = 0.8 * H[:6]
SEVERAL = {
    "blank line": "height (cm)\n" + lines("{x:.2f}", H) + "\n" + lines("{x:.2f}", LOWER),
    "run": "run,bounce,height (cm)\n" + lines("1,{i},{x:.2f}", H) + lines("2,{i},{x:.2f}", LOWER),
    "Versuch": "Versuch;Sprung;Höhe (cm)\n"
    + lines("A;{i};{x:.2f}", H)
    + lines("B;{i};{x:.2f}", LOWER),
    "labels": "bounce,height (cm)\nRun 1\n"
    + lines("{i},{x:.2f}", H)
    + "Run 2\n"
    + lines("{i},{x:.2f}", LOWER),
}


@pytest.mark.parametrize("text", SEVERAL.values(), ids=SEVERAL)
def test_drops_below_one_another_are_parted(tmp_path: Path, text: str) -> None:
    path = tmp_path / "drops.csv"
    path.write_text(text)
    for found, heights in zip(read_datasets(path, EXACT), (H, LOWER), strict=True):
        assert isinstance(found, Heights)
        np.testing.assert_allclose(found.heights, 0.01 * heights, atol=1e-4)


def test_a_blank_line_within_a_drop_parts_nothing(tmp_path: Path) -> None:
    path = tmp_path / "drop.csv"
    path.write_text("height (cm)\n" + lines("{x:.2f}", H[:4]) + "\n" + lines("{x:.2f}", H[4:]))
    assert len(read_datasets(path, EXACT)) == 1


def test_a_film_with_empty_lines_is_one(tmp_path: Path) -> None:
    path = tmp_path / "film.csv"
    t = np.arange(200) / 120
    rows = "".join(f"{a:.4f},{abs(np.cos(5 * a)):.4f}\n\n" for a in t)
    path.write_text("time (s),height (m)\n" + rows)
    (sheet,) = read_sheets(path)
    assert [len(table.cells) for table in tables_of(sheet)] == [200]


def test_trials_with_their_average_are_drops(tmp_path: Path) -> None:
    path = tmp_path / "trials.csv"
    rows = lines("{i},{x:.2f},{ms:.2f},{x:.2f}", H)
    path.write_text("Bounce #,Trial 1 (cm),Trial 2 (mm),Average (cm)\n" + rows)
    assert [len(one.pairs()[0]) for one in read_datasets(path, EXACT)] == [7, 7]


def test_rebounds_measured_again_are_impacts_each_and_successive_ones_are_refused(
    tmp_path: Path,
) -> None:
    path = tmp_path / "rebounds.csv"
    head = "drop height (cm),rebound height 1 (cm),rebound height 2 (cm)\n"
    path.write_text(head + "20,15.3,15.4\n40,27.8,27.5\n60,38.7,39.5\n")
    assert len(read_dataset(path, EXACT).pairs()[0]) == 6
    path.write_text(head + "20,15.3,11.4\n40,27.8,21.5\n60,38.7,29.5\n")
    with pytest.raises(UserError, match="two columns"):
        read_datasets(path, EXACT)


CELLS = {
    "feet and inches": ("height", ["6' 0\"", "3' 10.25\"", "2' 5 1/2\""], [1.8288, 1.17475, 0.7493]),
    "fractions": ("height (in)", ["47 1/4", "30 3/8", "19½"], [1.20015, 0.771525, 0.4953]),
    "two units": ("height", ["1.301 m", "82.9 cm", "568 mm"], [1.301, 0.829, 0.568]),
    "under another": ("height (cm)", ["1.30 m", "82.9", "568 mm"], [1.30, 0.829, 0.568]),
    "parts": ("height", ["1 m 30 cm", "0 m 83 cm", "0 m 57 cm"], [1.30, 0.83, 0.57]),
    "Arabic digits": ("الارتفاع (سم)", ["١٣٠٫١", "٨٢٫٩", "٥٦٫٨"], [1.301, 0.829, 0.568]),
    "capitals": ("HEIGHT(CM)", ["130.1", "82.9", "56.8"], [1.301, 0.829, 0.568]),
    "siunitx": ("$h$ / \\si{\\centi\\metre}", ["130.1", "82.9", "56.8"], [1.301, 0.829, 0.568]),
}  # fmt: skip


@pytest.mark.parametrize(("name", "cells", "heights"), CELLS.values(), ids=CELLS)
def test_cells_have_units_fractions_and_digits_as_people_write_them(
    tmp_path: Path, name: str, cells: list[str], heights: list[float]
) -> None:
    path = tmp_path / "heights.csv"
    quoted = [cell.replace('"', '""') for cell in cells]
    path.write_text(f"n;{name}\n" + "".join(f'{i};"{c}"\n' for i, c in enumerate(quoted)))
    found = read_dataset(path, EXACT)
    assert isinstance(found, Heights)
    np.testing.assert_allclose(found.heights, heights, rtol=1e-9)


def test_bounces_not_seen_are_known_by_their_numbers(tmp_path: Path) -> None:
    path = tmp_path / "heights.csv"
    path.write_text("bounce,height (cm)\n0,80\n1,57\n3,29\n4,-\n5,15\n")
    found = read_dataset(path, EXACT)
    assert isinstance(found, Heights)
    assert found.which.tolist() == [0, 1, 3, 5]
    assert "no height of bounce 3, 5" in found.assumed


def test_times_of_two_touches_in_each_others_place_are_exchanged(tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    order = np.array([0, 1, 2, 4, 3, 5, 6, 7])
    path.write_text("touch,time (s)\n" + lines("{i},{x:.4f}", T[order]))
    found = read_dataset(path, EXACT)
    assert isinstance(found, TouchTimes)
    np.testing.assert_allclose(found.times, T, atol=1e-4)
    assert "read as exchanged" in found.assumed


@pytest.mark.parametrize(("kind", "values"), [("times", T), ("heights", H), ("times", np.diff(T))])
def test_a_refusal_of_an_unknown_name_says_what_to_ask_for(
    tmp_path: Path, kind: str, values: np.ndarray
) -> None:
    path = tmp_path / "data.csv"
    path.write_text(f"foo ({'s' if kind == 'times' else 'cm'})\n" + lines("{x:.4f}", values))
    with pytest.raises(UserError, match=f"Say --as {kind} if 'foo' has"):
        read_datasets(path, EXACT)
    found = read_dataset(path, EXACT, kind)
    assert found.kind == kind
    assert "'foo' read as" in found.assumed
