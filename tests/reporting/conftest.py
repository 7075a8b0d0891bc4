"""Results, their view and their page, made once for the tests of a room."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from small_results import small_results

from hcbench.benchmark.results import Results
from hcbench.reporting.build import build
from hcbench.reporting.view import View

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from playwright.sync_api import Browser, Page

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


@pytest.fixture(scope="session")
def results() -> Results:
    """Results of five small settings."""
    return small_results()


@pytest.fixture(scope="session")
def view(results: Results) -> View:
    return View(results)


@pytest.fixture(scope="session")
def page(results: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(results, tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    api = pytest.importorskip(
        "playwright.sync_api", reason="Playwright, which drives a browser, is not here"
    )
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"no browser here to open the page in: looked for {', '.join(BROWSERS)}")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program)
        yield browser
        browser.close()


@pytest.fixture
def opening(chromium: Browser) -> Iterator[Callable[..., Page]]:
    """Opens a page; what it asks for or complains of fails the test."""
    contexts, trouble = [], []

    def open_page(
        address: str, choice: str = "", width: int = 1300, to: str = "", **how: Any
    ) -> Page:
        contexts.append(chromium.new_context(viewport={"width": width, "height": 900}, **how))
        page = contexts[-1].new_page()
        page.on("console", lambda message: trouble.append(message.text))
        page.on("pageerror", lambda error: trouble.append(str(error)))
        page.on("request", lambda request: trouble.append(request.url))
        page.goto((to or address) + choice)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert [what for what in trouble if not what.startswith(("file:", "data:"))] == []
