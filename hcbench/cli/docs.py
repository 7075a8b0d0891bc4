"""hcbench docs: the documentation of the installed version, as text."""

from __future__ import annotations

import difflib
import re
from pathlib import Path

import click

from hcbench.cli.help import command
from hcbench.cli.terminal import show
from hcbench.system.errors import UserError
from hcbench.system.files import read_text
from hcbench.system.project import DOCUMENTATION, address

_TITLE = re.compile(r"^# (.+)$", re.MULTILINE)
# A page that is another file of the repository.
_INCLUDED = re.compile(r"```\{include\} (\S+)\n.*?```\n", re.DOTALL)


@command()
@click.argument("page", required=False)
def docs(page: str | None) -> None:
    """List the pages of the documentation, or print one.

    PAGE is a name of the list, such as howto/tune. Pages are Markdown.
    """
    pages = _pages()
    if page is not None:
        print(_text(pages[_known(page, list(pages))]), end="")
        return
    site = address("Documentation")
    if site:
        show(f"{site}\n")
    width = max(map(len, pages))
    for name, path in pages.items():
        title = _TITLE.search(_text(path))
        show(f"{name:<{width}}  {title[1] if title else ''}")
    show("\n`hcbench docs tutorial` prints one.")


def _pages() -> dict[str, Path]:
    """Files of the pages, by the names that a reader types: those of the top, then by folder."""
    folder = next(folder for folder in DOCUMENTATION if folder.is_dir())
    found = {}
    for path in folder.rglob("*.md"):
        name = path.relative_to(folder).with_suffix("").as_posix()
        if not name.startswith("_"):
            found[name] = path
    return dict(sorted(found.items(), key=lambda item: (item[0].count("/"), item[0])))


def _known(page: str, names: list[str]) -> str:
    """The name of a page that a reader means, with or without .md and its folder.

    Raises UserError for none or several.
    """
    wanted = page.removeprefix("docs/").removesuffix(".md").strip("/")
    same = [name for name in names if name == wanted or name.endswith(f"/{wanted}")]
    if wanted in names:
        return wanted
    if len(same) == 1:
        return same[0]
    near = same or difflib.get_close_matches(wanted, names, 3, 0.5)
    expected = f"one of: {', '.join(near)}" if near else "the name of a page"
    raise UserError("PAGE", repr(page), expected, "`hcbench docs` lists them")


def _text(path: Path) -> str:
    """The text of a page, with that of the file that it stands for."""
    text = read_text(path)
    return _INCLUDED.sub(lambda found: read_text(path.parent / found[1]), text)
