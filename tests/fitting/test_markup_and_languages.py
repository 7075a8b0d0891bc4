"""Tables in markup, in languages with their encodings, and with columns that their units name."""

from __future__ import annotations

import html
import json
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from measured_bounces import EXACT, synthesise

from hcbench.fitting.column_names import role_of
from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.heights import Heights, SpeedPairs
from hcbench.fitting.read import read_dataset, read_datasets
from hcbench.fitting.track import Track
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence

PAGE = Path(__file__).parents[2] / "docs/reference/data.md"
V = np.linspace(0.5, 3.0, 9)
E = np.array([synthesise.hunt_crossley(0.2)(v) for v in V])
CELLS = [(f"{v:.4f}", f"{v * e:.4f}") for v, e in zip(V, E, strict=True)]
ENGLISH = ("impact velocity [m/s]", "rebound velocity [m/s]")


def joined(sep: str, before: str = "", after: str = "\n", of: Sequence[Sequence[str]] = ()) -> str:
    return "".join(f"{before}{sep.join(row)}{after}" for row in (of or CELLS))


HEAD = joined(" | ", of=[ENGLISH]).strip()
FORMS = {
    "HTML": "<table><tr>"
    + "".join(f"<th>{html.escape(name)}</th>" for name in ENGLISH)
    + "</tr>"
    + joined("&nbsp;</td><td>", "<tr><td>", "</td></tr>")
    + "</table>",
    "MediaWiki": '{| class="wikitable"\n! '
    + " !! ".join(ENGLISH)
    + joined(" || ", "\n|-\n| ", "")
    + "\n|}",
    "Jira": "||" + "||".join(ENGLISH) + "||\n" + joined("|", "|", "|\n"),
    "AsciiDoc": f"|===\n|{' |'.join(ENGLISH)}\n\n{joined(' |', '|')}|===\n",
    "YAML": "bounces:\n"
    + "".join(f"  - {ENGLISH[0]}: {a}\n    {ENGLISH[1]}: {b}\n" for a, b in CELLS),
    "a matrix of MATLAB": f"% {', '.join(ENGLISH)}\nv = [\n{joined(' ', '  ', ' ;' + chr(10))}];\n",
    "lists of Mathematica": '{{"'
    + '", "'.join(ENGLISH)
    + '"},\n'
    + joined(", ", "{", "},\n").rstrip(",\n")
    + "}\n",
    "JSON of pandas": json.dumps({"columns": ENGLISH, "data": [[*map(float, c)] for c in CELLS]}),
    "to_string of pandas": f"   {'  '.join(ENGLISH)}\n"
    + "".join(f"{i}  {a:>21}  {b:>22}\n" for i, (a, b) in enumerate(CELLS)),
    "print of R": "  impact.velocity..m.s. rebound.velocity..m.s.\n"
    + "".join(f"{i + 1} {a:>21} {b:>22}\n" for i, (a, b) in enumerate(CELLS)),
    "LaTeX with siunitx": f"\\begin{{tabular}}{{SS}}\n{{{'} & {'.join(ENGLISH)}}} \\\\ \\midrule\n"
    + "".join(f"\\num{{{a}}} & \\num{{{b}}} \\\\\n" for a, b in CELLS)
    + "\\end{tabular}\n",
    "LaTeX with commas in braces": f"{' & '.join(ENGLISH)} \\\\ \\hline\n"
    + joined(" & ", after=" \\\\\n").replace(".", "{,}"),
    "Gnuplot": f"# 1:{ENGLISH[0]}\t2:{ENGLISH[1]}\n" + joined("\t"),
    "Origin": "impact velocity\trebound velocity\nm/s\tm/s\n\tball 3\n" + joined("\t"),
    "a remark below": HEAD + "\n" + joined(" | ") + "\nMean e = 0.7\n",
}


def speeds_in(path: Path) -> tuple[np.ndarray, np.ndarray]:
    data = read_dataset(path, EXACT)
    assert isinstance(data, SpeedPairs)
    return data.speed, data.restitution


@pytest.mark.parametrize("form", FORMS)
def test_a_table_in_markup_is_read(tmp_path: Path, form: str) -> None:
    path = tmp_path / "table.txt"
    path.write_text(FORMS[form], encoding="utf-8")
    speed, restitution = speeds_in(path)
    np.testing.assert_allclose(speed, V, atol=1e-4)
    np.testing.assert_allclose(restitution, E, atol=5e-4)


LANGUAGES = [
    ("hastighet före stöt", "hastighet efter stöt", "cp1252"),
    ("hastighed før stød", "hastighed efter stød", "cp1252"),
    ("snelheid voor botsing", "snelheid na botsing", "cp1252"),
    ("prędkość przed zderzeniem", "prędkość po zderzeniu", "cp1250"),
    ("rychlost před nárazem", "rychlost po nárazu", "cp1250"),
    ("ütközés előtti sebesség", "ütközés utáni sebesség", "cp1250"),
    ("çarpma öncesi hız", "çarpma sonrası hız", "cp1254"),
    ("скорость до удара", "скорость после удара", "cp1251"),
    ("скорость до удара", "скорость после удара", "koi8_r"),
    ("швидкість до удару", "швидкість після удару", "cp1251"),
    ("ταχύτητα πριν", "ταχύτητα μετά", "cp1253"),
    ("衝突前の速度", "衝突後の速度", "cp932"),
    ("碰撞前速度", "碰撞后速度", "gb18030"),
    ("충돌 전 속도", "충돌 후 속도", "cp949"),
    ("nopeus ennen törmäystä", "nopeus törmäyksen jälkeen", "cp1252"),
    ("viteză înainte", "viteză după", "utf-8"),
]


@pytest.mark.parametrize(("before", "after", "encoding"), LANGUAGES)
def test_names_are_known_in_the_language_and_the_encoding_of_a_country(
    tmp_path: Path, before: str, after: str, encoding: str
) -> None:
    path = tmp_path / "table.csv"
    text = f"{before} (m/s);{after} (m/s)\n" + joined(";").replace(".", ",")
    path.write_bytes(text.encode(encoding))
    speed, restitution = speeds_in(path)
    np.testing.assert_allclose(speed, V, atol=1e-4)
    np.testing.assert_allclose(restitution, E, atol=5e-4)


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("Rücksprunghöhe", "height_out"),
        ("ruecksprunghoehe", "height_out"),
        ("Fallhöhe", "height_in"),
        ("fallhöjd", "height_in"),
        ("studshöjd", "height"),
        ("pudotuskorkeus", "height_in"),
        ("valhoogte", "height_in"),
        ("落下高さ", "height_in"),
        ("visszapattanási magasság", "height"),
        # Parts of two languages, endings of no known word, and quantities of something else.
        ("pressure", ""),
        ("validate", ""),
        ("temperature", ""),
        ("acceleration", ""),
        ("voltage", ""),
        ("angle", ""),
        ("przyspieszenie", ""),
        ("ускорение", ""),
        ("加速度", ""),
    ],
)
def test_a_compound_has_the_meaning_of_its_parts(name: str, role: str) -> None:
    assert role_of(name) == role


def film() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return synthesise.track(synthesise.hunt_crossley(0.3), 0.5, 1e-3, 2e-4, 120, rng)


def table(head: str, *columns: np.ndarray | list[int]) -> str:
    return head + "\n" + "".join(",".join(f"{x:.5g}" for x in r) + "\n" for r in zip(*columns))  # noqa: B905


def test_a_place_of_any_name_that_falls_with_g_is_the_height(tmp_path: Path) -> None:
    t, y = film()
    path = tmp_path / "film.csv"
    path.write_text(table("DEF=t / s,foo bar / mm,s_A1 / m", t, 0 * t + 400, y))
    data = read_dataset(path, EXACT)
    assert isinstance(data, Track)
    assert "'s_a1' read as the height" in data.assumed


@pytest.mark.parametrize(
    "columns",
    [
        ("time [s],foo [m],bar [m]", "two places that fall"),
        ("time [s],foo", "a place without a unit"),
        ("time [s],foo [N],bar [N]", "two forces"),
    ],
)
def test_columns_that_could_be_either_are_refused(tmp_path: Path, columns: tuple[str, str]) -> None:
    t, y = film()
    path = tmp_path / "film.csv"
    head = columns[0]
    path.write_text(table(head, t, *[y] * head.count(",")))
    with pytest.raises(UserError, match=r"foo.* as nothing"):
        read_datasets(path, EXACT)


def test_a_column_that_counts_is_no_interval(tmp_path: Path) -> None:
    flights = 0.4 * 0.8 ** np.arange(8)
    path = tmp_path / "flights.csv"
    path.write_text(table("interval,Δt (ms)", [*range(1, 9)], 1e3 * flights), encoding="utf-8")
    data = read_dataset(path, EXACT)
    assert isinstance(data, TouchTimes)
    np.testing.assert_allclose(np.diff(data.times), flights, atol=1e-4)


def test_a_column_named_sd_is_the_uncertainty_of_the_one_before(tmp_path: Path) -> None:
    heights = 0.6 * 0.7 ** np.arange(8)
    path = tmp_path / "heights.csv"
    path.write_text(table("height (cm),SD", 1e2 * heights, 0 * heights + 0.2))
    data = read_dataset(path, EXACT)
    assert isinstance(data, Heights)
    assert data.uncertainty == pytest.approx(2e-3)


def test_a_row_without_a_time_is_named(tmp_path: Path) -> None:
    times = np.concatenate([[0.2], 0.2 + np.cumsum(0.5 * 0.8 ** np.arange(9))])
    cells = [f"{t:.5f}" for t in times]
    cells[3] = ""
    path = tmp_path / "touches.csv"
    path.write_text("touch,time [s]\n" + "".join(f"{i},{t}\n" for i, t in enumerate(cells)))
    data = read_dataset(path, EXACT)
    assert isinstance(data, TouchTimes)
    assert data.numbers is not None
    assert data.numbers.tolist() == [0, 1, 2, 4, 5, 6, 7, 8, 9]
    assert "no time of touch 4" in data.assumed


def test_the_page_counts_the_languages() -> None:
    words = tomllib.loads(files("hcbench.fitting").joinpath("words.toml").read_text("utf-8"))
    languages = {one for meaning, each in words.items() if meaning != "unit" for one in each}
    assert f"in {len(languages)} languages" in PAGE.read_text("utf-8")
