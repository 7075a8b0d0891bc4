"""The field page in a real browser: its choices, what a cell opens to, a
phone, the dark, and axe-core.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from browser_checks import CONTRAST

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, Page

PAGE = (Path(__file__).parents[2] / "reports" / "field" / "index.html").as_uri()
CELL = "#step=0.001&gravity=9.81&engine=mujoco&column=settings"
CUT = """[...document.querySelectorAll(".matrix td, .matrix th, h1, h2, p, li, .panel pre")]
    .filter(e => e.scrollWidth > e.clientWidth + 1).map(e => e.textContent.slice(0, 60))"""


@pytest.fixture
def page(chromium: Browser) -> Iterator[Page]:
    trouble: list[str] = []
    page = chromium.new_page(viewport={"width": 1300, "height": 900})
    page.on("console", lambda message: trouble.append(message.text))
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.goto(PAGE + CELL)
    yield page
    page.close()
    assert trouble == []


def engines(page: Page) -> list[str]:
    return page.locator(".matrix tbody tr:not(.panel) th").all_inner_texts()


def test_a_cell_opens_to_its_curve_its_text_and_its_source_at_an_address(page: Page) -> None:
    panel = page.locator(".panel")
    title = panel.locator("h2").inner_text()
    assert title.startswith("MuJoCo ")
    assert "compliant-pairs" in title
    assert panel.locator("#field-curve .line").count() == 1
    text, command = panel.locator("pre").all_inner_texts()
    assert "<pair geom1=" in text
    assert command.startswith("hcbench tune mujoco --recipe compliant-pairs ")
    assert panel.locator("a[href='scores.csv']").count() == 1
    page.locator(".matrix tr:not(.panel) td.bad a").first.click()
    page.wait_for_url("**column=stock**")
    assert panel.locator("h2").inner_text() != title


def test_the_table_follows_the_step_and_sorts_by_any_column(page: Page) -> None:
    first = page.locator("#field-answer").inner_text()
    page.select_option("#field-step", label="1\u00a0µs")
    assert page.locator("#field-answer").inner_text() != first
    assert page.locator("#field-step option:checked").inner_text() == "1\u00a0µs"
    before = engines(page)
    page.click("[data-column=version] button")
    assert sorted(engines(page)) == sorted(before)
    assert engines(page) != before
    assert page.locator("[data-column=version]").get_attribute("aria-sort") == "ascending"
    assert "sort=version" in page.url


@pytest.mark.parametrize(("width", "scheme"), [(1300, "light"), (380, "dark")])
def test_axe_finds_nothing_and_nothing_is_cut(page: Page, width: int, scheme: str) -> None:
    pytest.importorskip(
        "axe_playwright_python", reason="axe-core, which checks accessibility, is not here"
    )
    page.set_viewport_size({"width": width, "height": 900})
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    page.evaluate((resources.files("axe_playwright_python") / "axe.min.js").read_text("utf-8"))
    violations = page.evaluate(
        "axe.run(document, {resultTypes: ['violations']}).then(r => r.violations)"
    )
    assert [(each["id"], each["nodes"][0]["html"]) for each in violations] == []
    assert page.evaluate(CUT) == []
    contrasts = page.evaluate(CONTRAST)
    assert len(contrasts) > 15
    assert [text for ratio, text in contrasts if ratio < 4.5] == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
