"""The page in a real browser: headless Chromium, spoken to over a
pipe, with nothing else installed.
"""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import json
import os
import select
import shutil
import signal
import time
from typing import TYPE_CHECKING, Any

import pytest
from small_results import small_results

from hcbench.benchmark.results import ImpactTable
from hcbench.reporting.build import build

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import pandas as pd

    from hcbench.benchmark.results import Results

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--headless --no-sandbox --disable-gpu --no-first-run --disable-background-networking --disable-sync"
    " --disable-component-update --disable-quic --disable-dev-shm-usage --remote-debugging-pipe"
)
PATIENCE = 60.0  # s, for a busy machine
HOSTILE = "<script>document.title = 'taken'</script>"


class Browser:
    """Chromium's DevTools protocol over a pipe: JSON messages with a zero byte after each."""

    def __init__(self, program: str, profile: Path) -> None:
        from_us, to_browser = os.pipe()
        from_browser, to_us = os.pipe()
        quiet = os.open(os.devnull, os.O_RDWR)
        inherited = [(os.POSIX_SPAWN_DUP2, quiet, fd) for fd in (0, 1, 2)]
        # Chromium reads from 3 and writes to 4; high numbers first, lest
        # one pipe end covers another.
        high = [os.dup(fd) for fd in (from_us, to_us)]
        inherited += [(os.POSIX_SPAWN_DUP2, high[0], 3), (os.POSIX_SPAWN_DUP2, high[1], 4)]
        arguments = [program, *FLAGS.split(), f"--user-data-dir={profile}", "about:blank"]
        self.process = os.posix_spawn(
            program, arguments, os.environ, file_actions=inherited, setpgroup=0
        )
        for fd in (from_us, to_us, quiet, *high):
            os.close(fd)
        self.reader, self.writer = from_browser, to_browser
        self.waiting, self.number = b"", 0
        self.events: list[dict[str, Any]] = []
        self.session: str | None = None

    def close(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process, signal.SIGKILL)
        os.waitpid(self.process, 0)
        os.close(self.reader)
        os.close(self.writer)

    def receive(self) -> dict[str, Any]:
        end = time.monotonic() + PATIENCE
        while b"\0" not in self.waiting:
            ready, _, _ = select.select([self.reader], [], [], max(0.0, end - time.monotonic()))
            chunk = os.read(self.reader, 1 << 20) if ready else b""
            if not chunk:
                pytest.fail("the browser fell silent")
            self.waiting += chunk
        message, _, self.waiting = self.waiting.partition(b"\0")
        return dict(json.loads(message))

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self.number += 1
        message: dict[str, Any] = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.writer, json.dumps(message).encode() + b"\0")
        while True:
            answer = self.receive()
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return dict(answer["result"])
            self.events.append(answer)

    def open(self, url: str) -> None:
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Network", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.resize(1280)
        self.call("Page.navigate", url=url)
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self.events.append(self.receive())

    def resize(self, width: int) -> None:
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)

    def value(self, expression: str) -> Any:
        answer = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"]["value"]

    def seen(self, method: str) -> list[dict[str, Any]]:
        return [event["params"] for event in self.events if event["method"] == method]


@pytest.fixture(scope="module")
def results() -> Results:
    """Results with a title and a setting's name that try to be scripts."""
    plain = small_results(title=f"A ball {HOSTILE}")

    def renamed(table: pd.DataFrame) -> pd.DataFrame:
        return table.replace({"setting": {"impulse": HOSTILE}})

    return dataclasses.replace(
        plain,
        settings=[
            {**s, "setting": HOSTILE} if s["setting"] == "impulse" else s for s in plain.settings
        ],
        table=ImpactTable.of(renamed(plain.impacts), plain.study),
        loops=renamed(plain.loops),
        scores=renamed(plain.scores),
    )


@pytest.fixture(scope="module")
def page(results: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(results, tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="module")
def browser(page: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None or os.name != "posix":
        pytest.skip(f"no browser here to open the page in: looked for {', '.join(BROWSERS)}")
    browser = Browser(program, tmp_path_factory.mktemp("profile"))
    try:
        browser.open(page.as_uri())
        yield browser
    finally:
        browser.close()


def test_the_page_raises_no_errors(browser: Browser) -> None:
    browser.value(
        "new Promise(done => requestAnimationFrame(() => setTimeout(() => done(0), 100)))"
    )
    assert [e["entry"]["text"] for e in browser.seen("Log.entryAdded")] == []
    assert browser.seen("Runtime.consoleAPICalled") == []
    assert browser.seen("Runtime.exceptionThrown") == []


def test_the_page_asks_the_network_for_nothing(browser: Browser, page: Path) -> None:
    asked = [event["request"]["url"] for event in browser.seen("Network.requestWillBeSent")]
    assert page.as_uri() in asked
    assert [url for url in asked if url != page.as_uri() and not url.startswith("data:")] == []


def test_the_still_picture_is_drawn_and_described(browser: Browser) -> None:
    images = browser.value(
        "Promise.all([...document.images].map(i => i.decode().then(() =>"
        " ({alt: i.alt, wide: i.naturalWidth, figure: i.closest('figure').id}))))"
    )
    assert [image["figure"] for image in images] == ["figure-overview"]
    assert images[0]["wide"] > 300
    assert "wrong by at most" in images[0]["alt"]


def test_figures_show_ink_not_blank_paper(browser: Browser) -> None:
    """A figure whose SVG is broken decodes to white; these have pixels of many kinds."""
    kinds = browser.value(
        "Promise.all([...document.images].map(async i => { await i.decode();"
        " const c = document.createElement('canvas'); c.width = i.width; c.height = i.height;"
        " const g = c.getContext('2d'); g.drawImage(i, 0, 0, i.width, i.height);"
        " const p = new Uint32Array(g.getImageData(0, 0, c.width, c.height).data.buffer);"
        " return new Set(p).size; }))"
    )
    assert min(kinds) > 100


def test_names_stay_text(browser: Browser) -> None:
    assert browser.value("document.title").startswith(f"A ball {HOSTILE}")
    assert (
        browser.value("document.querySelector('header .kicker').textContent") == f"A ball {HOSTILE}"
    )
    browser.value("change({engine: 'single', step: 1e-3}), 0")
    assert HOSTILE in browser.value("document.querySelector('.ranking').textContent")
    assert browser.value("[...document.scripts].map(s => s.id)") == ["explorer-data", ""]


def test_every_link_within_the_page_leads_somewhere(browser: Browser, page: Path) -> None:
    links = browser.value("[...document.querySelectorAll('a')].map(a => a.getAttribute('href'))")
    for link in links:
        if link.startswith("#"):
            assert browser.value(f"document.querySelector({json.dumps(link)}) !== null"), link
        else:
            assert (page.parent / link).is_file()


@pytest.mark.parametrize("width", [360, 800, 1280, 1920])
def test_nothing_sticks_out_at_any_width(browser: Browser, width: int) -> None:
    browser.resize(width)
    assert browser.value("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("width", [360, 390])
def test_on_a_phone_verdicts_and_captions_are_on_the_screen(browser: Browser, width: int) -> None:
    browser.resize(width)
    ends = (
        "[...document.querySelectorAll({!r})].filter(e => e.checkVisibility())"
        ".map(e => Math.round(e.getBoundingClientRect().right))"
    )
    for what in (
        ".ranking th, .ranking td:not(:empty)",
        "caption",
        "figcaption",
        "#explorer-curve",
    ):
        found = browser.value(ends.format(what))
        assert found, what
        assert 0 < min(found) <= max(found) <= width, what
    words = browser.value(
        "[...document.querySelectorAll('.ranking tr:not(.line) td:last-child b')].map(e => e.offsetHeight)"
    )
    assert min(words) > 10, "every verdict is shown"
    overlaps = browser.value(
        "[...document.querySelectorAll('.ranking tr')].some(row => [...row.children].some((a, i) =>"
        " [...row.children].some((b, j) => {"
        " const p = a.getBoundingClientRect(), q = b.getBoundingClientRect();"
        " return i < j && p.right > q.left + 1 && q.right > p.left + 1 && p.bottom > q.top + 1"
        " && q.bottom > p.top + 1; })))"
    )
    assert overlaps is False


def test_it_prints(browser: Browser) -> None:
    printed = base64.b64decode(browser.call("Page.printToPDF", printBackground=True)["data"])
    assert printed.startswith(b"%PDF")
    assert 2 <= printed.count(b"/Type /Page\n") + printed.count(b"/Type /Page/") <= 4
