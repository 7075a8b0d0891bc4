"""JSON, JUnit, Markdown and the page have the same numbers, the same
bytes, and no markup of a model.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from checks import BROKEN, GOOD, SPEEDS, ask, one

from hcbench.checking import CheckSpec, Outputs, check
from hcbench.checking.baseline import read_baseline
from hcbench.checking.text import as_record_of, as_text
from hcbench.measuring import measure
from hcbench.measuring.text import as_record
from hcbench.measuring.text import as_text as measurement_text
from hcbench.reporting.measurement_page import measurement_page
from hcbench.system.errors import UserError


def test_all_forms_say_the_same(tmp_path: Path) -> None:
    files = Outputs(tmp_path / "j.xml", tmp_path / "m.md", tmp_path / "e.png", tmp_path / "b.json")
    report = check(ask(BROKEN, restitution=0.9), files)
    suite = ET.parse(tmp_path / "j.xml").getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("1", "1", "0")
    failure = suite.find("testsuite/testcase/failure")
    assert failure is not None
    message = one(report).message
    assert failure.get("message") == message
    assert message.split(",")[0] in (tmp_path / "m.md").read_text()
    assert (tmp_path / "e.png").read_bytes().startswith(b"\x89PNG")
    record = json.loads(json.dumps(as_record_of(report)).replace("NaN", "null"))
    assert record["exit_code"] == 1
    assert record["checks"][0]["message"] == message
    assert record["checks"][0]["measurement"]["causes"][0]["code"] == "solimp-mixing"
    assert read_baseline(tmp_path / "b.json", "broken.xml").request().speeds == (0.1, 0.5)


def test_nothing_is_written_of_what_was_not_measured(tmp_path: Path) -> None:
    file = tmp_path / "b.json"
    with pytest.raises(UserError, match=r"not written.*gone\.xml is not there"):
        check(ask(str(tmp_path / "gone.xml"), restitution=0.9), Outputs(baseline=file))
    assert not list(tmp_path.iterdir())


NASTY = "&lt;script&gt;alert(1)&lt;/script&gt; | `x` [a](javascript:b) &#27;[2J"


def nasty(tmp_path: Path) -> str:
    file = tmp_path / "<img src=x onerror=alert(2)>.xml"
    text = (
        Path(BROKEN)
        .read_text()
        .replace('name="ball"', f'name="{NASTY}"')
        .replace('"plate"', '"p&lt;b&gt;"')
    )
    file.write_text(text)
    return str(file)


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.seen: set[str] = set()
        self.attributes: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.add(tag)
        self.attributes |= {name for name, _ in attrs}


def test_no_name_in_a_model_becomes_markup_or_a_command(tmp_path: Path) -> None:
    model = nasty(tmp_path)
    report = check(
        CheckSpec(model=model, restitution=0.9, speeds=SPEEDS),
        Outputs(tmp_path / "j.xml", tmp_path / "m.md", tmp_path / "e.png"),
    )
    found = one(report).measurement
    assert found is not None
    tags = Tags()
    tags.feed(measurement_page(found))
    assert "script" not in tags.seen
    assert not [name for name in tags.attributes if name.startswith("on")]
    markdown = (tmp_path / "m.md").read_text()
    assert "<script" not in markdown
    assert "<img" not in markdown
    assert "](javascript" not in markdown
    assert "\x1b" not in as_text(report) + markdown + measurement_text(found)
    case = ET.parse(tmp_path / "j.xml").getroot().find("testsuite/testcase")
    assert case is not None
    assert case.get("name") == Path(model).name


def test_the_page_stands_alone(tmp_path: Path) -> None:
    measurement = measure(BROKEN, "ball,plate", speeds=[0.5], restitution=0.9)
    page = measurement_page(measurement)
    assert re.findall(r'(?:src|href)="(?!data:)', page) == []
    assert "solimp-mixing" not in page, "codes are for machines"
    assert "averages the solimp" in page
    assert f"They meet {measurement.facts.meeting}." in page
    assert "ball approaches from above, along 0 0 -1" in page
    assert page == measurement_page(measure(BROKEN, "ball,plate", speeds=[0.5], restitution=0.9))


def test_loops_are_in_the_record_and_on_the_page() -> None:
    text = (
        Path(GOOD)
        .read_text()
        .replace('solref="0 -9500"', 'solref="-10000 -20"')
        .replace('"0.002"', '"0.0002"')
    )
    found = measure(text, "ball,plate", speeds=SPEEDS)
    loops = as_record(found)["loops"]
    assert [loop["speed_m_per_s"] for loop in loops] == [0.1, 0.5]
    assert len(loops[0]["force_n"]) == len(loops[0]["penetration_m"]) <= 200
    assert "The loops" in measurement_page(found)
    assert "The loops" not in measurement_page(measure(GOOD, "ball,plate", speeds=SPEEDS)), (
        "one step does not make a loop"
    )


def test_the_record_of_a_measurement_is_whole() -> None:
    record = as_record(measure(GOOD, "ball,plate", speeds=SPEEDS, phases=4, alpha=0.3))
    assert record["score"]["impacts"] == 8
    assert record["law"]["alpha_s_per_m"] == 0.3
    assert len(record["impacts"]) == 8
    json.dumps(record)


def test_checks_made_again_give_the_same_bytes(tmp_path: Path) -> None:
    seen = set()
    for i in range(5):
        files = Outputs(tmp_path / f"{i}.xml", tmp_path / f"{i}.md")
        report = check(ask(BROKEN, restitution=0.9, speeds="0.1 m/s"), files)
        record = json.dumps(as_record_of(report))
        seen.add(
            (as_text(report), record, *(p.read_bytes() for p in (files.junit, files.markdown) if p))
        )
    assert len(seen) == 1


def test_another_process_gives_the_same_bytes() -> None:
    asked = f"CheckSpec(model={BROKEN!r}, pair='ball,plate', speeds={SPEEDS!r}, restitution=0.9)"
    imports = "from hcbench.checking import *; from hcbench.checking.text import as_text"
    code = f"{imports}; print(as_text(check({asked})), end='')"
    environment = {**os.environ, "PYTHONHASHSEED": "77", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout == as_text(check(ask(BROKEN, restitution=0.9)))
