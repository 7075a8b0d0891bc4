"""One folder of static files: the built documentation and the reports, with relative links (`make site`).

index.html      leads to docs/
docs/           what Sphinx built
reports/NAME/   each page of reports/ in the repository, and the files that it links to
previews/       a picture of each page, which chats and networks show beside a link to it

A link between them is the same relative path in the repository and in the folder, where the pages of
docs/ end in .html. Usage:

    python docs/site_folder.py docs/_build/html site
"""

from __future__ import annotations

import posixpath
import re
import shutil
import sys
from html import escape, unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from preview import HEIGHT, WIDTH, preview

from hcbench import __version__
from hcbench.reporting.page import PAGES
from hcbench.system.project import PURPOSE, address

REPORTS = Path(__file__).parents[1] / "reports"
START = "docs/index.html"
REDIRECT = f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>hcbench</title>
<meta http-equiv="refresh" content="0; url={START}"></head>
<body><a href="{START}">hcbench: the documentation</a></body></html>
"""
TO_MARKDOWN = re.compile(r'href="(\.\./\.\./docs/[^"#]+)\.md"')
_LOADED = ("src", "srcset", "data", "poster")  # attributes of what a browser asks for by itself
_NO_REQUEST = ("canonical", "author", "search", "index", "next", "prev")


class Page(HTMLParser):
    """The links of a page, its anchors, and what it asks other hosts for."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.requests: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Called by HTMLParser."""
        values = {name: value or "" for name, value in attrs}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        loaded = [values[name] for name in _LOADED if name in values]
        if tag == "link" and values.get("rel") not in _NO_REQUEST:
            loaded.append(values.get("href", ""))
        self.requests += [url for url in loaded if re.match(r"(https?:)?//", url)]
        # A preview's picture is asked for by who shows the link, and not by the reader's browser.
        shown = [values["content"]] if values.get("property") == "og:image" else []
        self.links += [*shown, *loaded, *([values["href"]] if "href" in values else [])]


def target(page: str, link: str) -> tuple[str, str] | None:
    """The file in the folder that a page's link names, and the anchor there; None for another host's."""
    url = urlsplit(link)
    if url.scheme or url.netloc:
        return None
    return posixpath.normpath(
        posixpath.join(posixpath.dirname(page), unquote(url.path))
    ) if url.path else page, url.fragment


def build(html: Path, out: Path) -> list[str]:
    """Write the folder and return what is wrong with it, a line a link."""
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(html, out / "docs", ignore=shutil.ignore_patterns(".*", "objects.inv"))
    (out / "index.html").write_text(REDIRECT, encoding="utf-8")
    (out / ".nojekyll").touch()  # GitHub Pages otherwise leaves out folders such as _static
    for page, _ in PAGES.values():
        if page.startswith("reports/") and (REPORTS.parent / page).is_file():
            _copy(page, out)
    texts = {
        p.relative_to(out).as_posix(): p.read_text(encoding="utf-8") for p in out.rglob("*.html")
    }
    for name, text in texts.items():
        if name.startswith("reports/"):
            text = TO_MARKDOWN.sub(r'href="\1.html"', text)  # noqa: PLW2901
        texts[name] = _with_preview(name, text, out)
        (out / name).write_text(texts[name], encoding="utf-8")
    return _wrong({name: Page(text) for name, text in texts.items()}, out)


def _copy(page: str, out: Path) -> None:
    """A page of the repository, and the files in its folder that it links to."""
    source = REPORTS.parent / page
    linked = [target(page, link) for link in Page(source.read_text(encoding="utf-8")).links]
    for name in {
        page,
        *(to[0] for to in linked if to and to[0].startswith(posixpath.dirname(page))),
    }:
        if (REPORTS.parent / name).is_file():
            (out / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(REPORTS.parent / name, out / name)


def _with_preview(name: str, text: str, out: Path) -> str:
    """A page with what a preview of its link shows; the picture is written beside the pages."""
    found = re.search(r"<title>(.*?)</title>", text, re.DOTALL)
    title = " ".join(unescape(found[1]).split()) if found else "hcbench"
    picture = f"previews/{name.removesuffix('.html')}.png"
    (out / picture).parent.mkdir(parents=True, exist_ok=True)
    (out / picture).write_bytes(preview(title.removesuffix(f" - hcbench {__version__}")))
    site = address("Documentation") or posixpath.relpath(".", posixpath.dirname(name))
    facts = {
        "title": title,
        "description": PURPOSE,
        "type": "website",
        "image": f"{site}/{picture}",
        "image:width": str(WIDTH),
        "image:height": str(HEIGHT),
    }
    lines = [
        f'<meta property="og:{key}" content="{escape(value)}">\n' for key, value in facts.items()
    ]
    return text.replace("</head>", "".join(lines) + "</head>", 1)


def _wrong(pages: dict[str, Page], out: Path) -> list[str]:
    """Links that lead nowhere, and requests to other hosts."""
    wrong = [
        f"{name} asks another host for {url}"
        for name, page in pages.items()
        for url in page.requests
    ]
    for name, page in pages.items():
        for link in page.links:
            linked = target(name, link)
            if linked is None:
                continue
            file, anchor = linked
            if not (out / file).is_file():
                wrong.append(f"{name} links to {link}, which is not in the site")
            # A fragment with "=" is a choice that the page's script reads.
            elif (
                anchor
                and "=" not in anchor
                and file in pages
                and unquote(anchor) not in pages[file].anchors
            ):
                wrong.append(f"{name} links to {link}, which has no such anchor")
    return wrong


if __name__ == "__main__":
    lines = build(Path(sys.argv[1]), Path(sys.argv[2]))
    print("\n".join(lines) or f"{sys.argv[2]}/index.html")
    sys.exit(1 if lines else 0)
