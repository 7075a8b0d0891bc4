"""Pages that stand alone: figures are drawn, saved and embedded in the page with the numbers behind
them, and templates filled in; the header that every page has.
"""

from __future__ import annotations

import base64
import hashlib
import io
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from hcbench.reporting import wording
from hcbench.reporting.plot_style import figure_defaults
from hcbench.system import text as _text
from hcbench.system.files import read_text, write_bytes
from hcbench.system.project import CLONE, PURPOSE, address, install_line

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


# The header of every page: what hcbench is for, how to install it, and its other pages.

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

    install: what to type.
    where: words after it; "" where none are needed.
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
    """The link from a report's folder in reports/ of a clone to a page of the site, or to the file
    that it is made of; "" where that is not there, as in a source archive.

    folder: of the report.
    path: of the page in the site, such as docs/howto/measure.html.
    """
    if path.startswith("docs/"):
        path = path.removesuffix(".html") + ".md"
    link = f"../../{path}"
    return link if (folder / link).is_file() else ""


# The page itself.

PAGE = "index.html"
_CODE = re.compile(r"`([^`]+)`")


def _with_code(text: str) -> Markup:
    """A sentence as HTML, with what stands between backticks as code."""
    return Markup(_CODE.sub(r"<code>\1</code>", str(escape(text))))


# How templates write numbers and names.
_FILTERS: dict[str, Callable[..., str]] = {
    "alpha": wording.alpha,
    "alpha_short": wording.alpha_short,
    "difference": wording.difference,
    "engine_title": wording.engine_title,
    "fixed": _text.number,
    "four_digits": wording.four_digits,
    "percent": wording.percent,
    "sanitized": _text.sanitized,
    "typeset": wording.typeset,
    "plus_minus": lambda text: text.replace("+-", "±"),
    "sentence": wording.sentence,
    "with_code": _with_code,
}


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure of a page, by the name of its files; its title and
    caption stand in the page's template.

    draw: makes the figure, or a pair of it and the sentence that ends the caption, where something
    is measured in it; None where there is nothing to show.
    alt: text in place of the figure, for readers who cannot see it.
    why: the reason where there is nothing to show.
    """

    name: str
    draw: Callable[[], Figure | tuple[Figure, str]] | None
    alt: str = ""
    why: str = ""


def draw(
    drawing: Drawing,
    folder: Path | None = None,
    png: bool = True,
    csv: Callable[[Figure], bytes] | None = None,
) -> dict[str, Any]:
    """Draw a figure, save it in a folder, if any, as SVG and PNG, and
    return what a template needs of it.

    folder: an existing one; None: nothing is saved.
    png: whether to save a PNG too.
    csv: makes the table of a figure's numbers, which is saved beside it.

    The record has name, alt, why, source (the SVG as a data URL), width and height in pixels of
    CSS, and `measured`, the caption's end. A drawing without a function gives the record of an
    empty figure: source is "", and the last three are missing.

    Raises UserError or OutputError as `write_bytes`, and what the drawing raises.
    """
    record: dict[str, Any] = {
        "name": drawing.name,
        "alt": drawing.alt,
        "why": drawing.why,
        "source": "",
    }
    if drawing.draw is None:
        return record
    with figure_defaults():
        figure = drawing.draw()
        measured = ""
        if isinstance(figure, tuple):
            figure, measured = figure
        svg = svg_bytes(figure)
        if folder is not None:
            write_bytes(folder / f"{drawing.name}.svg", svg)
            if png:
                write_bytes(folder / f"{drawing.name}.png", png_bytes(figure))
            if csv is not None:
                write_bytes(folder / f"{drawing.name}.csv", csv(figure))
    # In the pixels of CSS, 96 to an inch.
    width, height = 96 * figure.get_size_inches()
    return {
        **record,
        "measured": measured,
        "source": _data_url(svg),
        "width": round(width),
        "height": round(height),
    }


def counted(
    figures: Iterable[dict[str, Any]], total: int, tick: Callable[[int, int], None] | None
) -> Iterator[dict[str, Any]]:
    """The figures, one after the other, with progress: `tick` is called with how many came, and of
    how many in total.
    """
    for done, figure in enumerate(figures, 1):
        yield figure
        if tick is not None:
            tick(done, total)


def _data_url(svg: bytes) -> Markup:
    """An SVG as the value of an attribute in double quotes: a quarter shorter than in base64."""
    text = (
        svg.decode().replace("%", "%25").replace("#", "%23").replace('"', "%22").replace("&", "%26")
    )
    return Markup("data:image/svg+xml," + " ".join(text.split()))


@dataclass(frozen=True, slots=True)
class Script:
    """A script that a page may run: the one with this digest."""

    text: str

    @property
    def sha256(self) -> str:
        """The digest of the script, as a content security policy names it."""
        return base64.b64encode(hashlib.sha256(self.text.encode()).digest()).decode()


def script(*names: str) -> Script:
    """Files of the package's templates, one after the other, as one script."""
    folder = Path(__file__).parent / "templates"
    return Script("\n".join(["", '"use strict";', *(read_text(folder / name) for name in names)]))


def render(
    template: str, script: Script | None = None, folder: Path | None = None, **content: Any
) -> str:
    """A page as text. Content is escaped, and the page's own policy forbids requests and all
    scripts but `script`: no name in a model or a study can make it run anything.

    template: name of a file in this package's templates.
    folder: the page's own, for the links of its header, see `page_header`.
    content: variables of the template; one that names another raises Jinja's UndefinedError.
    """
    page = _templates().get_template(template)
    return page.render(script=script, header=page_header(folder), **content)


def header_html(header: Header) -> str:
    """The header of a page as HTML, for pages that others make."""
    return _templates().get_template("site_header.html").render(header=header)


def _templates() -> Environment:
    """The templates of the package, with the filters that they use."""
    environment = Environment(
        loader=PackageLoader("hcbench.reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(_FILTERS)
    return environment


def svg_bytes(figure: Figure) -> bytes:
    """The figure as SVG with no date, no program name and no digits that cannot be seen."""
    buffer = io.BytesIO()
    # A dot of SVG is a point.
    figure.set_dpi(72)
    # Straight to the canvas: `savefig` would lay out and walk the whole figure twice.
    canvas: Any = FigureCanvasSVG(figure)
    canvas.print_svg(buffer, metadata={"Date": None, "Creator": None})
    # The layout is done, and need not be made again for PNG.
    figure.set_layout_engine("none")
    return _shortened(buffer.getvalue().decode()).encode()


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG, for places that show no SVG."""
    buffer = io.BytesIO()
    figure.set_dpi(110)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


_COORDINATES = re.compile(r' (?:d|x|y)="[^"]*"')
_LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}")
# A path of dots: short lines, one after the other.
_DOT = re.compile(r"M \S+ \S+(?:\s+L \S+ \S+){1,2}(?=\s)")
_DOTS = re.compile(rf' d="((?:{_DOT.pattern}\s*){{3,}})"')


def _shortened(svg: str) -> str:
    """An SVG with its coordinates rounded to 1/100 point: a third of the bytes gone and no
    pixel moved. Scales and other attributes stay, so that text keeps its size. A dot that several
    points make, as a motion that repeats does, stands once.
    """

    def short(number: re.Match[str]) -> str:
        """The number in two decimals, without zeros at its end."""
        return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")

    def rounded(path: re.Match[str]) -> str:
        """The attribute with coordinates, each long number in it short."""
        return _LONG_NUMBER.sub(short, path[0])

    def dots_once(path: re.Match[str]) -> str:
        """The attribute of a path of dots, with each dot once."""
        dots = dict.fromkeys(_DOT.findall(path[1]))
        return f' d="{" ".join(dots)}"'

    return _DOTS.sub(dots_once, _COORDINATES.sub(rounded, svg))


# The numbers behind a figure: each curve as it is drawn, as a table.

# Columns of the table. A panel is named by its title or its number.
COLUMNS = ("panel", "curve", "x_axis", "x", "y_axis", "y")
# Fewer points mark a place in the figure.
_LEAST_POINTS = 2


def curves_of(figure: Figure) -> pd.DataFrame:
    """A row for each point of each curve, in the units of the axes, which `x_axis` and `y_axis` name.

    Lines across a whole panel and single marks guide the eye alone: they are left out. A panel is
    named by its title or its number, a curve by its label or its number. Without curves the table
    has no rows.
    """
    # pandas is slow to import.
    import pandas as pd

    parts = []
    for number, axes in enumerate(figure.axes, 1):
        panel = axes.get_title() or f"{number}"
        x_axis = axes.get_xlabel() or _shared(axes, "x")
        y_axis = axes.get_ylabel() or _shared(axes, "y")
        for place, line in enumerate(axes.get_lines(), 1):
            x, y = (np.asarray(each, dtype=float) for each in line.get_data(orig=False))
            # A line across the panel is in shares of it, not in the units of its axes.
            if line.get_transform() != axes.transData or len(x) < _LEAST_POINTS:
                continue
            # Matplotlib gives a line without a label one that begins with an underscore.
            label = str(line.get_label())
            if label.startswith("_"):
                label = f"curve {place}"
            columns: dict[str, Any] = dict(
                zip(COLUMNS, (panel, label, x_axis, x, y_axis, y), strict=True)
            )
            parts.append(pd.DataFrame(columns))
    if not parts:
        return pd.DataFrame(columns=list(COLUMNS))
    return pd.concat(parts, ignore_index=True)


def _shared(axes: Axes, which: str) -> str:
    """The name that another panel gives to the axis which it shares with this one; "" without one.

    which: "x" or "y", of the axes of both panels.
    """
    group = axes.get_shared_x_axes() if which == "x" else axes.get_shared_y_axes()
    for other in group.get_siblings(axes):
        name: str = other.get_xlabel() if which == "x" else other.get_ylabel()
        if name:
            return name
    return ""


def csv_of(figure: Figure) -> bytes:
    """The table as CSV, in six digits, which do not depend on the processor."""
    text: str = curves_of(figure).to_csv(index=False, float_format="%.6g", lineterminator="\n")
    return text.encode()
