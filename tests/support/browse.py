"""Every page of the built site in a browser, wide, on a phone and in the dark (`make browse`).

A page is wrong that axe-core finds fault with, that scrolls sideways, that asks another host or
complains, that shows nothing for a second, or that is larger than 1.2 MB. Usage:

    python -m browse site
"""

from __future__ import annotations

import shutil
import sys
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
LOOKS: tuple[tuple[int, Any], ...] = ((1300, "light"), (380, "light"), (1300, "dark"))
MOST_BYTES = 1_200_000
# Until something is drawn, ms.
LONGEST = 1000.0
VIOLATIONS = """axe.run(document, {resultTypes: ["violations"]})
  .then(r => r.violations.map(v => `${v.id}: ${v.nodes[0].target.join(" ")}`))"""
PAINT = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? 0"


def wrong(browser: Browser, page: Path, width: int, scheme: Any, axe: str) -> Iterator[str]:
    """Yield what is wrong with a page, as it is seen at a width, px, in a colour scheme.

    axe: the source of axe-core, which the page's own policy would refuse.
    """
    context = browser.new_context(
        viewport={"width": width, "height": 900}, color_scheme=scheme, bypass_csp=True
    )
    trouble: list[str] = []
    tab = context.new_page()
    tab.on("pageerror", lambda error: trouble.append(str(error)))
    tab.on("request", lambda request: trouble.append(request.url))
    # A page that leads on at once, as the site's index does, is left where it leads.
    tab.goto(page.as_uri(), wait_until="networkidle")
    yield from (each for each in trouble if not each.startswith(("file:", "data:")))
    paint = tab.evaluate(PAINT)
    if paint > LONGEST:  # once more, as another program may have taken the processor
        tab.reload(wait_until="networkidle")
        paint = tab.evaluate(PAINT)
    if paint > LONGEST:
        yield f"nothing is drawn for {paint:.0f} ms"
    if (wide := tab.evaluate("document.scrollingElement.scrollWidth")) > width:
        yield f"scrolls sideways: {wide} px wide"
    tab.evaluate(axe)
    yield from tab.evaluate(VIOLATIONS)
    context.close()


def browse(site: Path) -> int:
    """Look at all pages of a site and print what is wrong; return how many lines that are."""
    try:
        from playwright.sync_api import sync_playwright

        axe = (resources.files("axe_playwright_python") / "axe.min.js").read_text("utf-8")
    except ImportError as error:
        print(f"not looked at: {error.name} is not installed; `make test` installs it")
        return 0
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        print(f"not looked at: no browser here; install Chromium, as one of: {', '.join(PROGRAMS)}")
        return 0
    found = 0
    pages = sorted(site.resolve().rglob("*.html"))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        for page in pages:
            name = page.relative_to(site.resolve())
            lines = [
                f"{width} px, {scheme}: {line}"
                for width, scheme in LOOKS
                for line in wrong(browser, page, width, scheme, axe)
            ]
            if (size := page.stat().st_size) > MOST_BYTES:
                lines.append(f"{size} bytes")
            found += len(lines)
            for line in lines:
                print(f"{name}: {line}", flush=True)
        browser.close()
    print(f"{len(pages)} pages, {found} faults")
    return found


if __name__ == "__main__":
    sys.exit(1 if browse(Path(sys.argv[1])) else 0)
