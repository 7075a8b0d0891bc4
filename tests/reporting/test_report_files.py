"""A report's files: the same bytes for the same results, nothing of this machine, nothing left behind."""

from __future__ import annotations

import pickle
import re
import shutil
from pathlib import Path

import matplotlib as mpl
import pytest
from small_results import RUNS, small_results

from hcbench.benchmark.results import Results
from hcbench.errors import OutputError
from hcbench.reporting.build import build
from hcbench.reporting.conditions import Views, views
from hcbench.reporting.drawings import drawings
from hcbench.reporting.view import View


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_later_report_leaves_no_figure_of_an_earlier_one(page: Path, tmp_path: Path) -> None:
    folder = tmp_path / "report"
    shutil.copytree(page.parent, folder)
    (folder / "study.toml").write_text("of the user", encoding="utf-8")
    fewer = small_results([run for run in RUNS if run[1] == "stock"])
    build(fewer, folder)
    assert "figures/error-fine.svg" in contents(page.parent).keys() - contents(folder).keys()
    fresh = contents(build(fewer, tmp_path / "fresh").parent)
    assert contents(folder) == {**fresh, "study.toml": b"of the user"}


def test_same_results_same_bytes(page: Path, tmp_path: Path) -> None:
    """Built again, from the files of the first report, on a machine whose user likes other figures."""
    with mpl.rc_context({"lines.linewidth": 9.0, "font.size": 30.0, "axes.facecolor": "red"}):
        again = build(Results.read(page.parent), tmp_path / "elsewhere")
        assert mpl.rcParams["font.size"] == 30.0
    assert contents(again.parent) == contents(page.parent)


def test_files_beside_the_page(page: Path, view: View) -> None:
    names = set(contents(page.parent))
    assert {"index.html", "restitution.csv", "loops.csv", "scores.csv", "summary.json"} <= names
    drawn = {d.name for d in drawings(Views(None, view)) if d.draw is not None}
    assert {n for n in names if n.startswith("figures/")} == {
        f"figures/{name}.{kind}" for name in drawn for kind in ("svg", "png")
    }


def test_nothing_of_this_machine_or_day_is_in_the_files(page: Path) -> None:
    for name, content in contents(page.parent).items():
        for trace in (str(Path.home()), str(page.parent), str(Path(__file__).parent), "Software", "dc:date"):
            assert trace.encode() not in content, (name, trace)


def test_page_loads_nothing(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    markup = re.sub(r"<script>.*?</script>", "", text, flags=re.S)
    loaded = re.findall(r'(?:src|srcset|data)="([^"]*)"', markup) + re.findall(r"url\(([^)]*)\)", markup)
    assert loaded
    assert all(link.startswith(("data:", "%23")) for link in loaded)  # or a part of the same picture
    assert "<script src" not in text
    assert not re.search(r"\b(fetch|XMLHttpRequest|import|WebSocket|sendBeacon)\b\s*\(", text)
    assert "@import" not in text
    assert len(text) < 6_000_000


def test_nothing_is_left_behind_where_nothing_can_be_written(results: Results, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="can be written"):
        build(results, tmp_path / "file" / "report")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_view_can_be_sent_to_a_worker_while_its_page_is_made(results: Results) -> None:
    """A cached property that is computed while another thread pickles the view would stop the report."""
    view = views(results).main
    assert not view.head_on.empty
    assert "head_on" in vars(view)
    assert "head_on" not in view.__getstate__()
    assert pickle.loads(pickle.dumps(view)).head_on.equals(view.head_on)
