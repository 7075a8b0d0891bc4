"""Limits on penetration and vibration at rest: with a target or alone, by command and by file."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from hcbench.cli import run

BALL = """<mujoco><option timestep="2e-3"/><worldbody><geom name="plate" type="plane" size="1 1 .1"/>
  <body name="ball" pos="0 0 1"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
LAUNCH = ["--pair", "ball,plate", "--speeds", "0.5", "--phases", "1"]


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    path = tmp_path / "ball.xml"
    path.write_text(BALL)
    return path


@pytest.mark.parametrize(
    ("limits", "code"),
    [
        (["--max-depth", "1 mm", "--max-vibration", "1e-4 m/s"], 0),
        (["--max-depth", "1 um"], 1),
        (["--max-depth", "1 mm", "--restitution", "0.9"], 1),  # it does not bounce
        (["--max-depth", "1 kg"], 2),
        (["--max-depth", "1 mm", "--gravity", "0"], 1),  # it does not rest
    ],
)
def test_the_exit_code_says_whether_the_pair_rests_within_its_limits(
    ball: Path, limits: list[str], code: int
) -> None:
    assert run(["check", str(ball), *LAUNCH, *limits]) == code


def test_a_limit_exceeded_is_told_with_its_cause(
    ball: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    junit = ball.with_name("junit.xml")
    assert (
        run(["check", str(ball), *LAUNCH, "--max-depth", "1 um", "--json", "--junit", str(junit)])
        == 1
    )
    (record,) = json.loads(capsys.readouterr().out)["checks"]
    assert "limit 0.001 mm" in record["message"]
    assert record["measurement"]["rest"]["penetration_m"] > 1e-6
    assert "soft-contact" in [cause["code"] for cause in record["measurement"]["rest_causes"]]
    failure = ET.parse(junit).getroot().find(".//failure")
    assert failure is not None
    assert "soft-contact" in str(failure.text)


def test_a_file_of_checks_takes_the_limits(ball: Path) -> None:
    checks = ball.with_name("checks.toml")
    checks.write_text(
        '[tool.hcbench]\nspeeds = "0.5 m/s"\nphases = 1\n[[tool.hcbench.check]]\nmodel = "ball.xml"\n'
        'pair = "ball,plate"\nmax-depth = "1 um"\n'
    )
    assert run(["check", str(checks)]) == 1
