"""The header of every page: what hcbench is for, how to install it, and its other pages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hcbench.system.project import CLONE, PURPOSE, address, install_line

# Pages of the site: title -> path in it, and the command that writes or prints the page.
PAGES = {
    "docs": ("docs/index.html", "hcbench docs"),
    "report": ("reports/steel-1lb/index.html", "hcbench report"),
    "field": ("reports/field/index.html", "hcbench report field"),
    "reality": ("reports/reality/index.html", "hcbench report reality"),
    "paper": ("reports/paper/index.html", "hcbench paper"),
    "materials": ("docs/reference/materials.html", "hcbench materials"),
    "cases": ("docs/reference/cases.html", "hcbench docs reference/cases"),
}


@dataclass(frozen=True, slots=True)
class Entry:
    """A page, by its title in the header: a link to it; without one, the command that shows it."""

    title: str
    link: str
    command: str


@dataclass(frozen=True, slots=True)
class Header:
    """Texts and links of a header, as its template names them.

    install: what to type. where: words after it; "" where none are needed.
    """

    purpose: str
    install: str
    where: str
    entries: tuple[Entry, ...]


def header(link: Callable[[str], str]) -> Header:
    """The header of a page.

    link: gives the link to a path of the site, "" where the page has none.
    """
    entries = [Entry(title, link(path), command) for title, (path, command) in PAGES.items()]
    source = address("Source")
    if source:
        entries.append(Entry("source", source, ""))
    where = "" if source else "in a clone"
    return Header(PURPOSE, install_line(), where, tuple(entries))


def page_header(folder: Path | None = None) -> Header:
    """The header of a page that is written into a folder, None for one that may go anywhere.

    A report in the clone's own folder reports/ links to the files beside it. Any other page links
    to the site's address, or names commands while there is none: it must work alone.
    """
    site = address("Documentation")
    if folder is not None and folder.resolve().parent == CLONE / "reports":
        return header(lambda path: _in_clone(folder, path))
    return header(lambda path: f"{site}/{path}" if site else "")


def _in_clone(folder: Path, path: str) -> str:
    """The link from a folder of reports/ to a page of the site, or to the file that it is made of;
    "" where that is not there, as in a source archive.
    """
    if path.startswith("docs/"):
        path = path.removesuffix(".html") + ".md"
    link = f"../../{path}"
    return link if (folder / link).is_file() else ""
