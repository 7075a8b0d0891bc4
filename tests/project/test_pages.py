"""The pages of the documentation: short how-tos, a picture or an output on each, made from data."""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path

import pytest

from hcbench.laws import closed_form
from hcbench.sim import registry

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS))

import cards  # type: ignore[import-not-found]  # noqa: E402
import pictures  # type: ignore[import-not-found]  # noqa: E402

PAGES = sorted(p for p in DOCS.rglob("*.md") if "_build" not in p.parts)
HOW_TOS = [p for p in PAGES if p.parent.name == "howto"]
CODE = re.compile(r"^ *```.*?^ *```$|<!--.*?-->|^<!--- .*?$", re.MULTILINE | re.DOTALL)
SHOWN = re.compile(
    r"!\[[^\]]+\]\([^)]+\.(svg|png)\)|^```(console\n\$ .*\n(?!```)|text\n)", re.MULTILINE
)


def name(page: Path) -> str:
    return page.relative_to(DOCS).as_posix()


@pytest.mark.parametrize("page", HOW_TOS, ids=name)
def test_a_how_to_has_at_most_400_words(page: Path) -> None:
    words = CODE.sub("", page.read_text(encoding="utf-8")).split()
    assert len(words) <= 400, len(words)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_a_page_has_a_picture_or_an_output(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    if included := re.fullmatch(r"```{include} (\S+)\n:relative-images:\n```\n", text):
        text = (page.parent / included[1]).read_text(encoding="utf-8")
    assert SHOWN.search(text)


@pytest.mark.parametrize(
    "page", [*PAGES, ROOT / "README.md", ROOT / "examples" / "README.md"], ids=str
)
def test_no_page_advises_a_package_that_is_not_published(page: Path) -> None:
    assert not re.search(r"pip install ['\"]?hcbench", page.read_text(encoding="utf-8"))


def test_the_pages_of_the_reports_are_linked() -> None:
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    for report in (p.parent for p in (ROOT / "reports").glob("*/index.html")):
        assert f"reports/{report.name}/index.html)" in text


def test_every_setting_has_a_card_with_its_picture() -> None:
    page = cards.PAGE.read_text(encoding="utf-8")
    for engine in set(registry.names()) - {"recorded", "toy"}:
        for recipe in registry.engine(engine).recipes():
            heading = f"\n### {registry.engine(engine).title}: {recipe.name}\n"
            assert recipe.name in cards.PUBLISHED or heading in page


def test_cards_and_pictures_are_those_of_their_data() -> None:
    curves = json.loads(cards.CURVES.read_text(encoding="utf-8"))
    text = cards.PAGE.read_text(encoding="utf-8")
    assert text.split(cards.BEGIN)[1].split(cards.END)[0] == cards.written(curves)
    drawn = {
        cards.picture_file(curve): cards.picture(curve) for curve in curves
    } | pictures.pictures()
    assert all(path.read_text(encoding="utf-8") == svg for path, svg in drawn.items())
    assert set(cards.FOLDER.glob("*.svg")) <= set(drawn)


def test_the_dropped_balls_of_the_picture_rise_as_measured() -> None:
    """By the law to e² of the height; MuJoCo as it is stays down; the plug-in rises as the law."""
    svg = pictures.drop()
    rises = []
    for ball in re.findall(r"@keyframes b\d\{((?:[\d.]+%\{[^}]*\})+)\}", svg):
        places = [-float(y) for y in re.findall(r"translateY\((-?[\d.]+)px\)", ball)]
        landed = next(i for i, up in enumerate(places) if up < 0.02 * places[0])
        rises.append(max(places[landed:]) / places[0])
    law, stock, ours = rises
    e = float(closed_form.restitution(0.315, math.sqrt(2 * 9.81 * 0.01)))
    assert law == pytest.approx(e**2, abs=0.01)
    assert stock < 0.01
    assert ours == pytest.approx(law, rel=0.03)
