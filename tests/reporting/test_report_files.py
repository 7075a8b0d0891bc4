"""A report's files: the same bytes for the same results, nothing of
this machine, nothing left behind.
"""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from pathlib import Path

import matplotlib as mpl
import pytest
from small_results import ALPHAS, answer, small_results

from hcbench.benchmark.results import ImpactTable, Results
from hcbench.reporting.build import build
from hcbench.system.errors import UserError
from hcbench.system.files import atomic_folder, write_text


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def test_a_later_report_leaves_no_figure_of_an_earlier_one(page: Path, tmp_path: Path) -> None:
    folder = tmp_path / "report"
    shutil.copytree(page.parent, folder)
    (folder / "study.toml").write_text("of the user", encoding="utf-8")
    results = Results.read(folder)
    none = [getattr(results, name).iloc[:0] for name in ("impacts", "loops", "scores")]
    table = ImpactTable.of(none[0], results.study)
    fewer = Results(results.study, [], results.versions, table, *none[1:])
    build(fewer, folder)
    assert "figures/overview.svg" in contents(page.parent).keys() - contents(folder).keys()
    fresh = contents(build(fewer, tmp_path / "fresh").parent)
    assert contents(folder) == {**fresh, "study.toml": b"of the user"}


def test_results_of_the_schema_before_are_read(tmp_path: Path) -> None:
    """Speeds of an answer had another key."""
    results = dataclasses.replace(
        small_results(), answers=[answer("single", "impulse", 1e-3, ALPHAS[0], 0.0)]
    )
    results.write(tmp_path)
    file = tmp_path / "summary.json"
    former = json.loads(file.read_text(encoding="utf-8").replace("speeds_m_per_s", "speeds_m_s"))
    file.write_text(json.dumps(former | {"schema": 3}), encoding="utf-8")
    assert Results.read(tmp_path).answers == results.answers


def test_same_results_same_bytes(page: Path, tmp_path: Path) -> None:
    """Built again, from the files of the first report, on a machine whose user likes other figures."""
    with mpl.rc_context({"lines.linewidth": 9.0, "font.size": 30.0, "axes.facecolor": "red"}):
        again = build(Results.read(page.parent), tmp_path / "elsewhere")
        assert mpl.rcParams["font.size"] == 30.0
    assert contents(again.parent) == contents(page.parent)


def test_files_beside_the_page(page: Path) -> None:
    names = set(contents(page.parent))
    assert {"index.html", "restitution.csv", "loops.csv", "scores.csv", "summary.json"} <= names
    assert {name for name in names if name.startswith("figures/")} == {
        "figures/overview.csv",
        "figures/overview.svg",
    }


def test_nothing_of_this_machine_or_day_is_in_the_files(page: Path) -> None:
    for name, content in contents(page.parent).items():
        for trace in (
            str(Path.home()),
            str(page.parent),
            str(Path(__file__).parent),
            "Software",
            "dc:date",
        ):
            assert trace.encode() not in content, (name, trace)


def test_page_loads_nothing(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    markup = re.sub(r"<script>.*?</script>", "", text, flags=re.S)
    loaded = re.findall(r'(?:src|srcset|data)="([^"]*)"', markup) + re.findall(
        r"url\(([^)]*)\)", markup
    )
    assert loaded
    assert all(
        link.startswith(("data:", "%23")) for link in loaded
    )  # or a part of the same picture
    assert "<script src" not in text
    assert not re.search(r"\b(fetch|XMLHttpRequest|import|WebSocket|sendBeacon)\b\s*\(", text)
    assert "@import" not in text
    assert len(text) < 6_000_000


def test_nothing_is_left_behind_where_nothing_can_be_written(
    results: Results, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UserError, match="can be written"):
        build(results, tmp_path / "file" / "report")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_file_that_cannot_be_written_is_named_by_the_users_folder(tmp_path: Path) -> None:
    with (
        pytest.raises(UserError, match=r"report/missing/x\.csv: No such file") as raised,
        atomic_folder(tmp_path / "report") as outer,
        atomic_folder(outer) as scratch,
    ):
        write_text(scratch / "missing" / "x.csv", "")
    assert ".hcbench-" not in str(raised.value)
