"""A baseline notices every change of a bounce; any other file is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checks import BROKEN, GOOD, SPEEDS, ask

from hcbench.checking import CheckSpec, Outputs, check, plan
from hcbench.checking.baseline import Baseline, read_baseline
from hcbench.checking.text import as_text, checks_of
from hcbench.sim.model_under_test import Request
from hcbench.system.errors import UserError


def test_a_baseline_catches_a_bounce_that_changed(tmp_path: Path) -> None:
    file = tmp_path / "baseline.json"
    assert check(ask(), Outputs(baseline=file)).exit_code == 0
    assert check(ask(baseline=file)).exit_code == 0
    report = check(ask(BROKEN, baseline=file))
    assert report.exit_code == 1
    assert "limit 0.0001" in as_text(report)
    assert check(ask(BROKEN, baseline=file, max_error=0.2)).exit_code == 0


def test_a_baseline_tells_what_else_changed(tmp_path: Path) -> None:
    file = tmp_path / "baseline.json"
    check(ask(), Outputs(baseline=file))
    record = json.loads(file.read_text())
    entry = record["checks"]["good.xml"]
    entry["version"], entry["timestep_s"] = "2.0.0", 0.001
    for impact in entry["impacts"]:
        impact["restitution"] = 0.8
    file.write_text(json.dumps(record))
    text = as_text(check(ask(baseline=file)))
    assert "mujoco was 2.0.0, is " in text
    assert "the step was 0.001 s, is 0.0002 s" in text
    # A step that a float32 rounded is the same.
    entry["timestep_s"] = float(np.float32(0.0002))
    file.write_text(json.dumps(record))
    assert "the step was" not in as_text(check(ask(baseline=file)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": 99}, "schema 99;"),
        (
            {"schema": 1},
            "schema 1, whose e has an earlier definition: speeds at a step's start or end",
        ),
        ({"schema": 1}, "Renew it: hcbench check MODEL --write-baseline FILE --force"),
        ({"kind": "shopping list"}, "is not a baseline"),
        ({"checks": {}}, "has nothing on"),
        ({"checks": {"good.xml": {"engine": "mujoco"}}}, "damaged"),
        ({"checks": {"good.xml": "text"}}, "damaged"),
        ({"checks": []}, "has nothing on"),
    ],
)
def test_a_baseline_that_is_not_one_is_refused(
    tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    file = tmp_path / "baseline.json"
    check(ask(), Outputs(baseline=file))
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    with pytest.raises(UserError, match=words):
        check(ask(baseline=file))


@pytest.mark.parametrize(
    "damage",
    [
        {"restitution": None},
        {"restitution": True},
        {"restitution": -1},
        {"restitution": 1e999},
        {"status": "crashed", "restitution": None},
        {"status": "crashed"},
        {"height_m": 1e308},
        {"speed_m_per_s": True},
        {"speed_m_per_s": 0.1, "phase": 0.5},
        {"speed_m_per_s": 1e308},
        {"slip_m_per_s": [0.1, 0.1]},
        {"slip_m_per_s": [1e300, 0.0]},
    ],
)
def test_a_damaged_baseline_is_refused(tmp_path: Path, damage: dict[str, Any]) -> None:
    impact = {"phase": 0.5, "height_m": None, "status": "parted", "restitution": 0.9}
    impacts = [{**impact, "speed_m_per_s": speed, **damage} for speed in (0.1, 0.5)]
    entry = {"engine": "mujoco", "version": "3", "timestep_s": 0.002, "impacts": impacts}
    file = tmp_path / "baseline.json"
    file.write_text(
        json.dumps({"schema": 2, "kind": "hcbench baseline", "checks": {"good.xml": entry}})
    )
    with pytest.raises(UserError, match="damaged"):
        plan(ask(baseline=file))


@pytest.mark.parametrize(
    "changed", [{"height_m": 0.1}, {"spin_rad_per_s": [0, 1, 0]}, {"slip_m_per_s": [0, 1]}]
)
def test_launches_of_a_baseline_that_would_not_be_made_are_damage(changed: dict[str, Any]) -> None:
    """Once such launches had no target, and the check passed."""
    impact = {"phase": 0.5, "height_m": None, "status": "parted", "restitution": 0.9}
    impacts = [{**impact, "speed_m_per_s": 0.1}, {**impact, "speed_m_per_s": 0.5, **changed}]
    with pytest.raises(ValueError, match="all of one request"):
        Baseline(engine="mujoco", version="3", timestep_s=2e-3, impacts=impacts)  # type: ignore[arg-type]


def baseline_at(folder: Path, *degrees: float) -> Path:
    """A baseline of launches at 0.1 and 0.5 m/s, at each of the angles."""
    impacts = []
    for launch in Request(
        speeds=(0.1, 0.5), phases=(0.5,), angle=tuple(map(math.radians, degrees))
    ).launches():
        impact = {"speed_m_per_s": launch.speed, "slip_m_per_s": launch.slip, "phase": 0.5}
        impacts.append({**impact, "height_m": None, "status": "parted", "restitution": 0.9})
    entry = {"engine": "mujoco", "version": "3", "timestep_s": 0.002, "impacts": impacts}
    file = folder / "baseline.json"
    file.write_text(
        json.dumps({"schema": 2, "kind": "hcbench baseline", "checks": {"good.xml": entry}})
    )
    return file


@pytest.mark.parametrize("degrees", [(20.0,), (30.0, 60.0), (45.0,)])
def test_a_baseline_with_an_angle_takes_the_same_angle_again(
    tmp_path: Path, degrees: tuple[float, ...]
) -> None:
    """A launch has 12 decimals of its angle; degrees in rad have more, and were refused."""
    file = baseline_at(tmp_path, *degrees)
    same = ", ".join(map(str, degrees)) + " deg"
    planned = plan(ask(angle=same, baseline=file))
    assert planned.baseline is not None
    made = {impact.launch for impact in planned.baseline.impacts}
    assert set(planned.request.launches()) == made
    with pytest.raises(UserError, match="angle: other launches"):
        plan(ask(angle="40 deg", baseline=file))


def test_a_baseline_takes_the_place_of_the_targets_of_a_file(tmp_path: Path) -> None:
    """Files with a `target`, or with limits on a landing, which no baseline has, were refused."""
    file = baseline_at(tmp_path, 0.0)
    model = f"model = '{GOOD}'\npair = 'ball,plate'\n"
    linear = f"[[check]]\nname = 'a'\n{model}alpha = 0.1\ntarget = 'linear'\n"
    landing = f"[[check]]\nname = 'b'\n{model}require = 'e < 0.3'\n"
    (tmp_path / "checks.toml").write_text(linear + landing)
    bounce, drop = checks_of(tmp_path / "checks.toml", file)
    assert bounce.baseline is not None and bounce.wanted is None
    assert drop.baseline is None and drop.against == "e < 0.3"


@pytest.mark.parametrize(
    ("asked", "is_written"),
    [
        ({}, True),
        ({"speeds": SPEEDS}, True),
        ({"speeds": "0.1, 0.6 m/s"}, False),
        ({"speeds": 0.1}, False),
        ({"phases": 1}, True),
        ({"phases": 4}, False),
        ({"height": "1 cm"}, False),
        ({"angle": "30 deg"}, False),
        ({"spin": "1 rad/s"}, False),
    ],
)
def test_launches_beside_a_baseline_are_those_that_it_has(
    tmp_path: Path, asked: dict[str, Any], is_written: bool
) -> None:
    """Others were ignored."""
    impact = {"phase": 0.5, "height_m": None, "status": "parted", "restitution": 0.9}
    impacts = [{**impact, "speed_m_per_s": speed} for speed in (0.1, 0.5)]
    entry = {"engine": "mujoco", "version": "3", "timestep_s": 0.002, "impacts": impacts}
    file = tmp_path / "baseline.json"
    file.write_text(
        json.dumps({"schema": 2, "kind": "hcbench baseline", "checks": {"good.xml": entry}})
    )
    spec = CheckSpec(model=GOOD, pair="ball,plate", baseline=file, **asked)
    if is_written:
        assert [launch.speed for launch in plan(spec).request.launches()] == [0.1, 0.5]
        return
    with pytest.raises(UserError, match=f"{next(iter(asked))}: other launches than the baseline's"):
        plan(spec)


def test_a_baseline_of_another_engine_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "baseline.json"
    check(ask(), Outputs(baseline=file))
    file.write_text(file.read_text().replace('"mujoco"', '"pybullet"'))
    report = check(ask(baseline=file))
    assert report.exit_code == 2
    assert "written with pybullet" in as_text(report)


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "null"])
def test_a_baseline_that_is_no_json(tmp_path: Path, text: str) -> None:
    file = tmp_path / "baseline.json"
    file.write_text(text)
    with pytest.raises(UserError, match=r"not JSON|not a baseline"):
        read_baseline(file, "good.xml")
    with pytest.raises(UserError, match="--write-baseline"):
        read_baseline(tmp_path / "gone.json", "good.xml")
