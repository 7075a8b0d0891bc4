"""The default report's page: its size, on paper too, its contrast, and an answer for any α that loads. Its
files: the same bytes for the same results, nothing of this machine, nothing left behind.
"""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
import pytest
from browser_checks import CONTRAST
from pasted import bounces, bullet_bounces, plain_mujoco
from small_results import ALPHAS, answer, small_results

import hcbench
from hcbench.benchmark.results import ImpactTable, Results
from hcbench.contact.mujoco import load
from hcbench.laws import closed_form
from hcbench.reporting.build import build
from hcbench.system.errors import UserError
from hcbench.system.files import atomic_folder, write_text
from hcbench.system.text import two_digits
from hcbench.tuning.usual_errors import errors_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from playwright.sync_api import Page


FILE = Path(__file__).parents[2] / "reports" / "steel-1lb" / "index.html"
ALPHA = 0.25  # none of the study's, one that people type
BETWEEN = 0.27  # none that was run
LAUNCHES = [(0.05, 0.1), (0.2, 0.6), (0.5, 0.35)]
MOST = {"bytes": 1_200_000, "words": 1_800, "code blocks": 3, "pixels": 9_000, "sheets": 3}
# What a page shows: colours of text in plots, and the ground behind them.
SMALLEST = """() => Math.min(...[...document.querySelectorAll("body *")].filter(e => e.checkVisibility()
  && [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim()))
  .map(e => parseFloat(getComputedStyle(e).fontSize)))"""


@pytest.fixture
def opened(opening: Callable[..., Page]) -> Callable[..., Page]:
    def at(choice: str = "", **how: Any) -> Page:
        return opening(FILE.as_uri(), choice and f"#{choice}", **how)

    return at


def choice(engine: str, **more: object) -> str:
    asked = {
        "engine": engine,
        "step": 2e-3,
        "gravity": 9.81,
        "alpha": ALPHA,
        "first": "foot",
        "second": "floor",
    }
    return "&".join(f"{name}={value}" for name, value in {**asked, **more}.items())


def spoken(low: float, high: float) -> str:
    """A band of speeds, m/s, as the page says it: two digits, rounded to its inside."""
    low, high = (
        float(Decimal(f"{speed:.12g}").normalize(Context(prec=2, rounding=way)))
        for speed, way in ((low, ROUND_CEILING), (high, ROUND_FLOOR))
    )
    if low >= 0.1:
        return f"{low:g} to {high:g} m/s"
    return " to ".join(f"{1e3 * v:g} mm/s" if v < 0.1 else f"{v:g} m/s" for v in (low, high))


def test_the_page_is_short() -> None:
    text = FILE.read_text(encoding="utf-8")
    shown = re.sub(r"<script.*?</script>|<style>.*?</style>|<[^>]*>", " ", text, flags=re.S)
    found = {
        "bytes": len(text.encode()),
        "words": len(unescape(shown).split()),
        "code blocks": text.count("<pre"),
    }
    assert {name: value for name, value in found.items() if value > MOST[name]} == {}


def test_in_a_browser_too_and_on_paper(opened: Callable[..., Page]) -> None:
    page = opened()
    closed = "document.querySelectorAll('option:not(:checked)').forEach(each => each.remove())"
    page.evaluate(closed)  # the words of a list that nobody has opened
    assert len(page.locator("body").inner_text().split()) <= MOST["words"]
    assert page.evaluate("document.documentElement.scrollHeight") <= MOST["pixels"]
    paper = page.pdf(prefer_css_page_size=True)
    assert len(re.findall(rb"/Type /Page\b", paper)) <= MOST["sheets"]
    assert re.search(rb"/MediaBox \[0 0 59[45]\S* 84[12]\S*\]", paper), "A4"
    page.emulate_media(media="print")
    assert page.evaluate(SMALLEST) >= 12, "9 pt"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_in_plots_stands_out(opened: Callable[..., Page], scheme: Any) -> None:
    for asked in ("", choice("pybullet")):
        page = opened(asked, color_scheme=scheme)
        for tab in ("loop", "steps"):
            page.click(f"#explorer-tab-{tab}")
            found = page.evaluate(CONTRAST)
            assert len(found) > 30
            assert [text for ratio, text in found if ratio < 4.5] == []


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_a_plug_in_for_any_alpha_is_copied_in_a_minute_and_bounces_by_the_law(
    opened: Callable[..., Page], engine: str, tmp_path: Path
) -> None:
    page = opened(permissions=["clipboard-read", "clipboard-write"])
    page.select_option("#explorer-engine", engine)
    page.select_option("#explorer-alpha", "other")
    page.fill("#explorer-own-alpha", str(ALPHA))
    page.fill("#explorer-first-name", "foot")
    page.fill("#explorer-second-name", "floor")
    page.get_by_role("tab", name="Plug-in").click()
    page.click("#explorer-copy")
    page.get_by_text("Copied.").wait_for()
    text = page.evaluate("navigator.clipboard.readText()")
    if engine == "mujoco":
        load()
        e = bounces(plain_mujoco(text, 2e-3, 9.81), LAUNCHES)
    else:
        (e,) = bullet_bounces([(text, 2e-3, 9.81, LAUNCHES)], tmp_path)
    law = closed_form.restitution(ALPHA, np.array([speed for speed, _ in LAUNCHES]))
    assert e == pytest.approx(law.tolist(), abs=1e-6)


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
@pytest.mark.parametrize("alpha", [ALPHA, BETWEEN])
def test_errors_at_any_alpha_are_those_of_tune(
    opened: Callable[..., Page], engine: str, alpha: float
) -> None:
    """Between α that were run one e has a near error, and settings have the command; without
    friction, as the table is.
    """
    answer = hcbench.tune(engine, timestep=2e-3, alpha=alpha, friction=0)
    titles = {"settings": "Settings only", "constant": "One e", "exact": "Plug-in"}
    page = opened(choice(engine, alpha=alpha, friction=0))
    shown = (
        page.locator("#explorer-kinds").get_by_role("tab").evaluate_all("e => e.map(t => t.value)")
    )
    kinds = {found.kind for found in answer.choices}
    assert kinds <= set(shown) if alpha == BETWEEN else kinds == set(shown)
    for found in answer.choices:
        tab = page.get_by_role("tab", name=titles[found.kind]).inner_text()
        if alpha == BETWEEN and found.kind == "settings":
            assert "at the nearest α" in tab
            continue
        ((mark, error, band),) = re.findall(r"e within (≈ )?(\S+) from (.*m/s)", tab)
        assert bool(mark) == (alpha == BETWEEN and found.kind == "constant")
        if not mark:
            assert error == two_digits(found.max_error)
        assert float(error) == pytest.approx(found.max_error, rel=0.1)
        assert band == spoken(*found.speeds)


def test_between_alphas_that_were_run_settings_have_the_command_and_the_errors_around(
    opened: Callable[..., Page],
) -> None:
    (rows,) = (
        each["rows"]
        for each in errors_of(["mujoco"])
        if (each["timestep"], each["gravity"], each["band"]) == (2e-3, 9.81, [])
    )
    at = max(i for i, row in enumerate(rows) if row[0] < BETWEEN)
    near = [row[1] for row in rows[at - 1 : at + 3]]
    errors = [two_digits(known[1]) for known in near if known]
    page = opened(choice("mujoco", alpha=BETWEEN, kind="settings"))
    text = page.locator("#explorer-paste-text").inner_text()
    assert text.startswith(f'hcbench tune mujoco --alpha "{BETWEEN} s/m" --timestep "0.002 s"')
    shown = page.get_by_role("tab", name="Settings only").inner_text()
    assert f"{min(errors, key=float)} … {max(errors, key=float)} at the nearest α" in shown
    assert (", or none" in shown) == (len(errors) < len(near))


def test_off_the_table_the_text_is_the_command(opened: Callable[..., Page]) -> None:
    page = opened(choice("mujoco", alpha=5, kind="settings"))
    text = page.locator("#explorer-paste-text").inner_text()
    assert text.startswith(
        'hcbench tune mujoco --alpha "5 s/m" --timestep "0.002 s" --gravity 9.81'
    )
    assert '--speeds "0.0314:0.508 m/s"' in text
    assert '--pair "foot,floor"' in text
    assert page.get_by_role("tab", name="Plug-in").count() == 1


def test_alpha_in_words_and_the_drops_lag(opened: Callable[..., Page]) -> None:
    page = opened()
    kept = 100 * float(closed_form.restitution(page.evaluate("state.alpha"), 1.0))
    assert f"keeps {kept:.0f} % of its speed" in page.locator("#explorer-plain").inner_text()
    page.get_by_role("tab", name="Plug-in").click()
    assert "an engine acts once a step of 2 ms" in page.locator("#explorer-lag").inner_text()


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
