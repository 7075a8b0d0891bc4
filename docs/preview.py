"""The picture that a link preview shows of a page: its title beside the law's curves, as PNG."""

from __future__ import annotations

import io
import textwrap
from functools import cache

import numpy as np
from matplotlib import get_data_path
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import ImageDraw
from PIL.Image import Image, fromarray
from PIL.ImageFont import FreeTypeFont, truetype

from hcbench.laws import closed_form
from hcbench.system.project import PURPOSE

# Pixels that previews of links have: Open Graph's usual 1.91 to 1.
WIDTH, HEIGHT = 1200, 630
_DOTS = 100
# Height of the title's letters, pixels: 34 points.
_TITLE = 47
_INK, _BLUE, _GREY = "#1f2328", "#0b62c4", "#59636e"
_ALPHAS = (0.1, 0.3, 0.6, 1.2)


def preview(title: str) -> bytes:
    """The picture of a page, by the title of the page."""
    picture = _without_title().copy()
    lines = textwrap.wrap(title, 22)[:5]
    ImageDraw.Draw(picture).multiline_text(
        (0.05 * WIDTH, 0.2 * HEIGHT), "\n".join(lines), fill=_INK, font=_title_font(), spacing=12
    )
    file = io.BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()


@cache
def _title_font() -> FreeTypeFont:
    """The font of the titles. Matplotlib brings it: it is the same on every machine."""
    return truetype(get_data_path() + "/fonts/ttf/DejaVuSans.ttf", _TITLE)


@cache
def _without_title() -> Image:
    """The part that all pictures share; it takes ten times as long as a title."""
    figure = Figure(figsize=(WIDTH / _DOTS, HEIGHT / _DOTS), dpi=_DOTS, facecolor="white")
    figure.text(0.05, 0.88, "hcbench", color=_BLUE, fontsize=30, fontweight="bold", va="center")
    purpose = "\n".join(textwrap.wrap(PURPOSE, 86))
    figure.text(0.05, 0.05, purpose, color=_GREY, fontsize=15, va="bottom")
    axes = figure.add_axes((0.62, 0.27, 0.33, 0.6))
    speeds = np.linspace(1e-3, 2.0, 100)
    for alpha in _ALPHAS:
        restitution = [float(closed_form.restitution(alpha, v)) for v in speeds]
        axes.plot(speeds, restitution, color=_BLUE, linewidth=3, alpha=1 - alpha / 2)
    axes.set(ylim=(0, 1), xlim=(0, 2), xlabel="impact speed, m/s", ylabel="restitution e")
    axes.spines[["top", "right"]].set_visible(False)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
