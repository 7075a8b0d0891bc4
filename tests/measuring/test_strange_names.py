"""Names in a model that no terminal and no XML takes as they are: every command reads and writes them."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import pytest

import hcbench as hb
from hcbench.cli import run
from hcbench.system.errors import LONGEST
from hcbench.system.text import joined_names, sanitized

mujoco = pytest.importorskip("mujoco")

NAMES = [
    "g" * 300,
    "a\nb",
    "a\u200bb",
    "a\u202eb",
    "a\tb",
    'a"b',
    "a'b",
    "a<b",
    "a&b",
    "a,b",
    "a-->b",
]


@pytest.fixture(params=NAMES, ids=range(len(NAMES)))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def model(name: str, tmp_path: Path) -> Path:
    attributes = [quoteattr(f"{each}{name}", {"\n": "&#10;", "\t": "&#9;"}) for each in "fb"]
    path = tmp_path / "model.xml"
    path.write_text(
        f"""<mujoco><worldbody>
        <geom name={attributes[0]} type="plane" size="1 1 1"/>
        <body pos="0 0 1"><freejoint/><geom name={attributes[1]} size=".1" mass="1"/></body>
        </worldbody></mujoco>""",
        encoding="utf-8",
    )
    return path


def _pair(name: str) -> str:
    return joined_names((f"b{name}", f"f{name}"))


def _is_printable(text: str) -> bool:
    return all(map(str.isprintable, text.splitlines()))


def test_a_pair_is_found_by_its_names_as_the_model_has_them_and_as_they_are_shown(
    model: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = joined_names((sanitized(f"b{name}"), sanitized(f"f{name}")))
    assert run(["pairs", str(model)]) == 0
    for pair in (_pair(name), shown):
        assert run(["measure", str(model), "--pair", pair, "--speeds", "1"]) == 0
    assert _is_printable(capsys.readouterr().out)


def test_a_name_that_is_not_there_is_one_printable_line(
    model: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["measure", str(model), "--pair", joined_names((f"z{name[:9]}", "x"))]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.isprintable()
    assert len(line) <= LONGEST + len("hcbench: ")


def test_the_lines_to_paste_load_in_the_model(model: Path, name: str) -> None:
    # The first setting will do.
    tuned = hb.tune_model(model, pair=_pair(name), restitution=0.9, speeds="0.5:1:2", max_error=1)
    text = tuned.text
    pasted = model.read_text(encoding="utf-8").replace("</mujoco>", f"{text}</mujoco>")
    loaded = mujoco.MjModel.from_xml_string(pasted)
    assert {loaded.geom(i).name for i in (loaded.pair_geom1[0], loaded.pair_geom2[0])} == {
        f"b{name}",
        f"f{name}",
    }


def test_a_junit_report_is_xml(model: Path, name: str, tmp_path: Path) -> None:
    report = tmp_path / "report.xml"
    words = ["--pair", _pair(name), "--alpha", "0.3", "--speeds", "1", "--junit", str(report)]
    assert run(["check", str(model), *words]) == 1
    (case,) = ElementTree.parse(report).iter("testcase")
    assert all(map(_is_printable, case.attrib.values()))


def test_a_long_name_is_found_with_its_kind_before_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "long.xml"
    name = "n" * 230
    path.write_text(
        f'<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><body pos="0 0 1">'
        f'<freejoint/><geom name="{name}" size=".1"/></body></worldbody></mujoco>'
    )
    assert run(["measure", str(path), "--pair", f"geom:{name},floor", "--speeds", "1"]) == 0
    assert capsys.readouterr().err == ""


def test_names_that_are_not_utf8_are_refused_with_their_byte(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "latin.xml"
    path.write_bytes(
        b'<mujoco><worldbody><geom name="fl\xf6r" type="plane" size="1 1 1"/><body pos="0 0 1">'
        b'<freejoint/><geom name="ball" size=".1"/></body></worldbody></mujoco>'
    )
    assert run(["pairs", str(path)]) == 2
    assert "has the byte 0xf6, not UTF-8" in capsys.readouterr().err
