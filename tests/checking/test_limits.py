"""Limits on landings: of several that are exceeded, the one by the largest share is named. Limits on
penetration and vibration at rest: with a target or alone, by command and by file.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from hcbench.checking.outcome import Limit, Verdict, judge_landings, read_limits
from hcbench.cli import run
from hcbench.sim.landing import Footfall, Landing, Landings
from hcbench.system.errors import QuantityError


def landings(e: float, slip: float, penetration: float) -> Landings:
    """One drop in which a foot slips, m, and goes so deep, m."""
    foot = Footfall("foot", 0.0, 1.0, 0.0, 0.01, 0, 50.0, slip, penetration)
    none = np.zeros(0)
    drop = Landing(0.1, 0.0, 1.0, e, 10.0, (foot,), none, none)
    return Landings(
        "engine", "1", "dog", "base", "floor", "its pose", "pd", 1.0, 1e-3, 9.81, (drop,)
    )


@pytest.mark.parametrize(
    ("text", "excesses"),
    [
        ("slip < 5 mm", {0.004: -0.2, 0.005: 0.0, 0.010: 1.0}),
        ("e > 0.2", {0.3: -0.5, 0.1: 0.5, math.nan: math.inf}),
        ("bouncing < 0", {0.0: 0.0, 2.0: 2.0}),
    ],
)
def test_a_value_is_beyond_a_limit_by_a_share_of_it(
    text: str, excesses: dict[float, float]
) -> None:
    """A limit of 0 has no share: the value itself counts."""
    (limit,) = read_limits(text, of_landing=True)
    assert isinstance(limit, Limit)
    for value, excess in excesses.items():
        assert limit.excess(value) == pytest.approx(excess)


def test_only_a_limit_of_a_plain_number_may_be_in_per_cent() -> None:
    """5 % of no length was taken as 0.05 m."""
    assert [limit.value for limit in read_limits("e < 5 %, bouncing < 50%", True)] == [0.05, 0.5]
    for text in ("slip < 5 %", "contact < 5%", "e < 5 %%"):
        name = text.split()[0]
        with pytest.raises(QuantityError, match=f"^require: {name}: .* is in per cent"):
            read_limits(text, of_landing=True)
    with pytest.raises(QuantityError, match=r"^require: normal: .* is in per cent"):
        read_limits("normal < 5 %", of_landing=False)


@pytest.mark.parametrize(
    ("e", "slip", "named"),
    [(0.4, 0.010, "slip 0.01 (SI)"), (0.6, 0.006, "e 0.6 (SI)"), (0.1, 0.004, "slip 0.004 (SI)")],
)
def test_the_value_nearest_to_its_limit_or_farthest_beyond_is_named(
    e: float, slip: float, named: str
) -> None:
    """Twice a slip of 5 mm is worse than 4/3 of an e of 0.3, although 5 mm are the smaller number."""
    limits = read_limits("e < 0.3, slip < 5 mm", of_landing=True)
    verdict, message = judge_landings(landings(e, slip, 0.0), limits)
    assert message.startswith(named)
    assert (verdict is Verdict.PASSED) == (e < 0.3)


@pytest.mark.parametrize(
    ("limit", "missing"),
    [
        ("peak < 3", "peak without a force: impacts are impulses, limit"),
        ("slip < 5 mm", "slip without a foot that touched, limit"),
        ("contact < 5 ms", "contact without a foot that touched, limit"),
        ("penetration < 5 mm", "penetration without a foot that touched, limit"),
    ],
)
def test_a_number_that_is_not_there_exceeds_its_limit_and_is_told(limit: str, missing: str) -> None:
    """No force of the floor is known where impacts are impulses; without feet nothing slips."""
    landed = landings(0.4, 0.0, 0.0)
    (drop,) = landed.drops
    without = replace(landed, drops=(replace(drop, feet=(), impulse=1.0),))
    verdict, message = judge_landings(without, read_limits(limit, of_landing=True))
    assert verdict is Verdict.FAILED
    assert message.startswith(missing)


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
