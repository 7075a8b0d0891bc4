"""Options are stated once: every way to give them takes all of them, and reads them alike."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import pytest

import hcbench
from hcbench.checking import CheckSpec, plan
from hcbench.checking.text import checks_of
from hcbench.cli.check import check, measure
from hcbench.cli.tune import tune
from hcbench.measuring.request import make_request
from hcbench.pytest_plugin import FixtureOptions
from hcbench.sim.model_under_test import Request
from hcbench.terms.options import LAUNCHES, LIMITS, OPTIONS

GIVEN: dict[str, str | bool] = {
    "speeds": "4, 8 in/s",
    "phases": "3",
    "timestep": "2 ms",
    "gravity": "0, 0, -1",
    "key": "home",
    "height": "1 cm",
    "qpos": "hip=30 deg",
    "state": "pose.json",
    "move": "joint:hip",
    "package": "robots=.",
    "coming_from": "above",
    "actuators": False,
    "angle": "0, 45 deg",
    "along": "0, 1, 0",
    "spin": "40 rad/s",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "pose.json").write_text('{"knee": 0.1}')
    monkeypatch.chdir(tmp_path)
    return tmp_path


def of_command(command: Any, name: str) -> Request:
    option = OPTIONS[name]
    value = (
        [f"--{option.flag}", str(GIVEN[name])]
        if GIVEN[name] is not False
        else [f"--no-{option.flag}"]
    )
    more = ["--angle", "1 deg"] if name == "along" else []
    options = command.make_context("x", ["m.xml", *value, *more]).params
    launch = {each: options[each] for each in LAUNCHES}
    return plan(CheckSpec(model="m.xml", **launch)).request


@pytest.mark.parametrize("name", LAUNCHES)
def test_a_command_a_file_and_a_call_read_an_option_alike(name: str, folder: Path) -> None:
    more: dict[str, Any] = {"angle": "1 deg"} if name == "along" else {}
    launch: dict[str, Any] = {name: GIVEN[name], **more}
    called = make_request(None, **launch)
    assert called != Request(adapt_phases=True)
    keys = "".join(
        f"{OPTIONS[n].flag} = {str(v).lower() if v is False else repr(v)}\n"
        for n, v in launch.items()
    )
    (folder / "checks.toml").write_text(f"[[check]]\nmodel = 'm.xml'\n{keys}")
    assert called == of_command(check, name) == of_command(measure, name)
    assert called == checks_of(folder / "checks.toml")[0].request


def keywords(function: Any) -> set[str]:
    return set(inspect.signature(function).parameters)


def test_every_option_is_tried_here() -> None:
    assert set(LAUNCHES) == set(GIVEN)


def test_the_command_the_file_the_fixture_and_the_call_have_every_option_of_a_check() -> None:
    assert set(OPTIONS) <= {option.name for option in check.params}
    assert {option.flag for option in OPTIONS.values()} <= {
        field.alias for field in CheckSpec.model_fields.values()
    }
    assert {*LAUNCHES, *LIMITS, "engine"} <= FixtureOptions.__annotations__.keys()
    assert set(OPTIONS) <= keywords(hcbench.check)
    assert set(LAUNCHES) <= keywords(hcbench.measure)


def test_every_option_of_tune_is_a_keyword_of_tune_or_of_tune_model() -> None:
    of_the_command = {"write_scene", "certify", "strict", "as_json", "beyond_bounds"}
    named = {str(option.name) for option in tune.params} - {"files"}  # the models
    assert named - of_the_command <= keywords(hcbench.tune) | keywords(hcbench.tune_model)


def test_an_unknown_option_is_refused_with_those_that_there_are() -> None:
    options: dict[str, Any] = {"restitutoin": 0.9}
    with pytest.raises(
        hcbench.HcbenchError, match=r"^restitutoin: unknown argument; expected one of: "
    ):
        hcbench.check("ball.xml", "ball,plate", **options)
