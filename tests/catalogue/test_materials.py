"""The materials that ship: each has a source, a place in it, a level and speeds; names find them."""

from __future__ import annotations

import csv
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import hcbench as hb
from hcbench import scoring
from hcbench.catalogue.find import FILE, Materials, as_record, find, materials, read_material
from hcbench.catalogue.material import LEVELS, MaterialPair, falling
from hcbench.cli import run
from hcbench.reality.page import PUBLISHED_SLOPES
from hcbench.system.errors import UserError

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs"))

import materials_page  # type: ignore[import-not-found]  # noqa: E402

ALL = materials()
WITH_POINTS = [each for each in ALL if each.points]


@pytest.mark.parametrize("each", ALL, ids=lambda each: each.id)
def test_an_entry_has_source_place_speeds_and_level(each: MaterialPair) -> None:
    assert " on " in each.name
    assert each.source.level in set(LEVELS) - {"own"}
    assert len(each.source.document) > 10
    assert each.source.place
    assert each.source.read_at
    # A quotation names the document that quotes, and a rule what it says of heights or speeds.
    if each.source.level == "S":
        assert re.search(r"quote|GitHub|YADE", each.source.read_at)
    if each.source.level == "R":
        assert each.measured.startswith("rule:")
    if each.speed_range_m_per_s is None:
        assert each.restitution is not None
    else:
        assert 0 <= each.speed_range_m_per_s[0] <= each.speed_range_m_per_s[1] <= 50
    for value, ends in (
        (each.restitution, each.restitution_interval),
        (each.alpha_s_per_m, each.alpha_interval_s_per_m),
    ):
        if ends is not None:
            assert value is not None
            assert ends[0] <= value <= ends[1]
            assert each.uncertainty


def test_there_are_forty_pairs_from_measurements() -> None:
    measured = {each.name for each in ALL if each.source.level != "R"}
    assert len(measured) >= 40
    assert len({each.id for each in ALL}) == len(ALL)
    # One pair's rows lie together: the first is the one that `--material` takes.
    names = [each.name for each in ALL]
    assert names == sorted(names, key=str.lower)


def test_the_page_says_how_many_pairs_there_are_and_shows_each() -> None:
    page = materials_page.PAGE.read_text(encoding="utf-8")
    assert f"The restitution of {len(ALL.names)} pairs of materials" in page
    for name in ("README.md", "docs/howto/tune.md", "docs/explanation/law.md", "CHANGELOG.md"):
        counts = re.findall(r"(\d+) pairs", (ROOT / name).read_text(encoding="utf-8"))
        assert f"{len(ALL.names)}" in counts, name
    body = page.split(materials_page.BEGIN)[1].split(materials_page.END)[0].strip()
    assert body == materials_page.table().strip()


def test_what_is_said_of_e_over_speed_is_in_the_table() -> None:
    """README and the page of reality say this; the how-to links to the table."""
    falls = []
    nearer = {"law": 0, "one e": 0}
    for each in WITH_POINTS:
        speeds, e = np.array(sorted(each.points)).T
        falls.append(e[0] - e[-1])
        _, rms = scoring.fit_alpha(speeds, e)
        nearer["law" if rms < e.std() else "one e"] += 1
    assert len(falls) == len({each.name for each in WITH_POINTS}) == 9
    assert min(falls) == pytest.approx(0.005, abs=5e-4)
    assert max(falls) == pytest.approx(0.352, abs=5e-4)
    assert nearer == {"law": 5, "one e": 4}
    said = "have a lower e at the fastest. One α of the law fits five of them better than one e does; one e"
    for page in ("README.md", "reports/reality/index.html"):
        text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
        assert f"{said} fits four better." in text
    marked = re.sub("`(.+?)`", r"<code>\1</code>", PUBLISHED_SLOPES)
    assert f"<li>{marked}</li>" in text
    alphas = {each.name for each in ALL if each.alpha_s_per_m is not None}
    assert alphas == {"steel on steel", "bronze on bronze", "ivory on ivory"}


def test_heights_of_the_student_reports_give_their_e() -> None:
    """Spot checks against the raw heights, cm: e is the root of the ratio of the means."""
    golf = dict(find("lab-golf-marble").points)
    heights = [63.7, 64.6, 63.2, 64.1, 63.8, 63.5, 63.7, 64.2, 64.3, 63.2]
    assert golf[3.96] == pytest.approx((np.mean(heights) / 80) ** 0.5, abs=5e-4)
    moss = find("moss-table-tennis-tabletop")
    assert moss.points[0] == (2.03, 0.867)
    itf = find("itf-tennis-concrete")
    assert itf.restitution_interval == pytest.approx(
        ((135 / 254) ** 0.5, (147 / 254) ** 0.5), abs=5e-4
    )
    assert itf.speeds == pytest.approx(((2 * 9.81 * 2.54) ** 0.5,), abs=5e-3)


def test_the_cube_is_that_of_our_own_reading() -> None:
    with (ROOT / "reports" / "reality" / "pairs.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    e = [float(row["restitution"]) for row in rows]
    assert find("acrylic cube on board").restitution == pytest.approx(np.median(e), abs=5e-4)


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("Rubber on Concrete", "factbook-handball"),
        ("concrete on rubber", "factbook-handball"),
        ("factbook-golf", "factbook-golf"),
        ("a soccer ball on steel", "fifa-pro-football-steel"),
        ("ping pong ball on table", "moss-table-tennis-tabletop"),
        ("ABS on aluminum", "hlosta-abs-aluminium"),
    ],
)
def test_a_name_finds_the_first_row_of_its_pair(name: str, found: str) -> None:
    assert find(name).id == found


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("rubber on concret", "'rubber on concrete'.*`hcbench materials` lists them"),
        ("granite on wood", "'baseball on wood'"),
        ("robot foot on wood", "No e of a robot's foot is published.*hcbench fit.*hcbench land"),
        ("", "a pair such as"),
        ("no-such.json", "No such file"),
    ],
)
def test_an_unknown_name_lists_the_nearest(name: str, expected: str) -> None:
    with pytest.raises(UserError, match=f"^material: .*{expected}"):
        find(name)


@pytest.mark.parametrize("name", [7, None, ["a"], object()])
def test_what_is_no_name_is_an_error_of_ours(name: object) -> None:
    with pytest.raises(UserError, match=r"^material: .*a pair such as"):
        find(name)


def test_where_sources_disagree_all_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    lawns = materials("croquet ball on lawn")
    assert [each.restitution for each in lawns] == [0.5, 0.15]
    assert run(["materials", "croquet ball on lawn"]) == 0
    printed = capsys.readouterr().out
    assert "e = 0.5 at 5 m/s" in printed
    assert "e = 0.15 at 6 m/s" in printed


def test_a_material_written_as_json_reads_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for each in ALL:
        path = tmp_path / f"{each.id}.json"
        assert run(["materials", each.id, "--json"]) == 0
        path.write_text(capsys.readouterr().out, encoding="utf-8")
        assert read_material(path) == each
        assert find(path) == each


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"restitution": 0.5}, "exactly one of"),
        ({"alpha_s_per_m": None}, "exactly one of"),
        ({"alpha_s_per_m": "0.2"}, "alpha_s_per_m: '0.2'; expected α in s/m"),
        ({"alpha_s_per_m": True}, "alpha_s_per_m: True"),
        ({"alpha_interval_s_per_m": [2, 1]}, "the lower number first"),
        ({"speed_range_m_per_s": None}, "speed_range_m_per_s, without which"),
        ({"speed_range_m_per_s": [-1, 1]}, "a speed in m/s"),
        ({"source": {"document": "x", "place": "y", "read_at": "z", "level": "Q"}}, "source.level"),
        ({"source": {"document": "x"}}, "source.place: missing"),
        ({"surprise": 1}, "surprise: unknown key"),
        ({"id": "A b"}, "id: 'A b'"),
        ({"kind": "hcbench baseline"}, "is not a material"),
        ({"schema": 2}, "schema: 2"),
    ],
)
def test_a_file_of_another_form_is_refused_by_its_key(
    change: dict[str, object], message: str, tmp_path: Path
) -> None:
    path = tmp_path / "my.json"
    path.write_text(json.dumps(as_record(find("steel on steel")) | change), encoding="utf-8")
    with pytest.raises(UserError, match=re.escape(message)):
        read_material(path)


def test_points_that_rise_by_chance_give_the_nearest_e_that_does_not() -> None:
    points = [(3.0, 0.7), (1.0, 0.8), (2.0, 0.9), (4.0, 0.6)]
    speeds, e = zip(*falling(points), strict=True)
    assert speeds == (1.0, 2.0, 3.0, 4.0)
    assert e == pytest.approx((0.85, 0.85, 0.7, 0.6))
    # Pooling goes back as far as it has to.
    assert [e for _, e in falling([(1, 0.5), (2, 0.4), (3, 0.9)])] == pytest.approx([0.6] * 3)
    for each in WITH_POINTS:
        values = [value for _, value in each.target.points]
        assert values == sorted(values, reverse=True)


def test_materials_are_a_table() -> None:
    frame = hb.materials().to_frame()
    assert len(frame) == len(ALL)
    assert {"restitution", "alpha_s_per_m", "speed_min_m_per_s", "document", "level"} <= set(frame)
    assert repr(hb.materials("steel on steel")).endswith(
        "α = 0.2 s/m (0.08 ... 0.32) up to 0.508 m/s"
    )
    assert isinstance(ALL[:2], Materials)


def test_the_file_ships_with_the_package() -> None:
    assert FILE.parent == Path(hb.__file__).parent / "catalogue"
    assert len(json.loads(FILE.read_text(encoding="utf-8"))) == len(ALL)
