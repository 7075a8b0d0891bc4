"""Configuration of Sphinx, which builds the documentation: `make docs`."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.transforms import SphinxTransform

from hcbench import __version__
from hcbench.reporting.page import header, header_html

project, author, release = "hcbench", "The hcbench developers", __version__
copyright = author  # noqa: A001  the name that Sphinx reads
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx_click",
    "sphinx_copybutton",
]
exclude_patterns = ["_build", "_templates", "conf.py"]
myst_heading_anchors = 3
myst_enable_extensions = ["deflist"]
autodoc_member_order = "bysource"
autodoc_typehints = "none"
html_theme = "furo"
html_title = f"hcbench {release}"
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = html_show_sourcelink = False

_CODE = re.compile(r"(`[^`\n]+`)")


def _plain_text(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with `code`; Sphinx reads markup, in which * and | mean other things."""
    for i, line in enumerate(lines):
        parts = _CODE.split(line.strip())
        parts[::2] = [re.sub(r"([*|_\\])", r"\\\1", text) for text in parts[::2]]
        parts[1::2] = [f"`{code}`" for code in parts[1::2]]
        lines[i] = "".join(parts)


class _ReportLinks(SphinxTransform):
    """Links to pages of reports/ stay relative: the site's folder has them at the same place."""

    default_priority = 500

    def apply(self, **_: Any) -> None:
        for node in list(self.document.findall(addnodes.download_reference)):
            if "../reports/" in node["reftarget"]:
                node.replace_self(nodes.reference("", "", *node.children, refuri=node["reftarget"]))


def _notebook(app: Any, docname: str, source: list[str]) -> None:
    """The page of the notebook has its cells and their outputs."""
    if docname == "notebook":
        file = Path(app.srcdir) / "tutorial.ipynb"
        app.env.note_dependency(str(file))
        cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
        source[0] += "\n" + "\n\n".join(_cell(cell) for cell in cells)


def _cell(cell: dict[str, Any]) -> str:
    text = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return text.replace("# ", "## ", 1) if text.startswith("# ") else text
    parts = [f"```python\n{text}\n```"]
    for output in cell["outputs"]:
        data = output.get("data", {"text/plain": output.get("text", [])})
        kind = next(kind for kind in ("image/svg+xml", "text/html", "text/plain") if kind in data)
        shown = "".join(data[kind])
        if kind == "image/svg+xml":
            shown = shown[shown.index("<svg") :]
        parts.append(
            f"```text\n{shown}\n```"
            if kind == "text/plain"
            else f'```{{raw}} html\n<div class="table-wrapper container">\n{shown}\n</div>\n```'
        )
    return "\n\n".join(parts)


# What Furo's pages lack for readers who use a keyboard or hear them, as axe-core finds it: each
# heading a level, each landmark a name and no two of a kind, a key for all that scrolls.
_MENDS = (
    (re.compile(r'role="heading"(?! aria-level)'), 'role="heading" aria-level="2"'),
    (
        re.compile(r'<header class="mobile-header">(.*?)</header>', re.DOTALL),
        r'<nav aria-label="Menus" class="mobile-header">\1</nav>',
    ),
    (re.compile(r'<aside class="(sidebar-drawer)'), r'<aside aria-label="All pages" class="\1'),
    (re.compile(r'<aside class="(toc-drawer)'), r'<aside aria-label="This page" class="\1'),
    (re.compile(r"<th([^>]*)>(?:<p></p>)?</th>"), r"<td\1></td>"),
    (re.compile(r"<pre>"), '<pre tabindex="0">'),
    (
        re.compile(r'<div class="(table-wrapper)'),
        r'<div tabindex="0" role="group" aria-label="Table" class="\1',
    ),
)


def _accessible(body: str, site_header: str) -> str:
    """The body of a page, mended, with the header after the link that skips what all pages have."""
    for pattern, better in _MENDS:
        body = pattern.sub(better, body)
    return body.replace('<div class="page">', f'{site_header}<div class="page">', 1)


def _header(app: Any, pagename: str, templatename: str, context: dict[str, Any], tree: Any) -> None:
    """The header of every page of hcbench, with links from this one: docs/ and reports/ lie side by side."""

    def link(path: str) -> str:
        inside = path.removeprefix("docs/")
        name = inside if inside != path else f"../{path}"
        return str(context["pathto"](name, 1))

    context["site_header"] = header_html(header(link))
    context["accessible"] = _accessible


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("html-page-context", _header)
    app.add_transform(_ReportLinks)
    app.connect("source-read", _notebook)
    app.connect("autodoc-process-docstring", _plain_text)
