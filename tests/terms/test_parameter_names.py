"""Errors of the Python interface name its parameters; those of the command line name its options."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hcbench as hb
from hcbench import cli
from hcbench.checking.outcome import Report
from hcbench.fitting.force import ForceFit
from hcbench.fitting.result import FitResult
from hcbench.laws.conventions import Conversion
from hcbench.measuring.measure import CandidatePairs
from hcbench.reporting.ask import StudyReport
from hcbench.system.errors import HcbenchError
from hcbench.tuning.tuned_model import TunedModel

BALL = str(Path(__file__).parents[2] / "examples" / "good.xml")
RETURNED = (CandidatePairs, Conversion, FitResult, ForceFit, Report, StudyReport, TunedModel)


@pytest.fixture
def pairs(tmp_path: Path) -> str:
    path = tmp_path / "pairs.csv"
    path.write_text("speed [m/s],restitution\n0.1,0.9\n0.2,0.8\n0.3,0.7\n")
    return str(path)


@pytest.mark.parametrize(
    ("begins", "call"),
    [
        ("alpha: 1e+09 s/m", lambda _: hb.law(1e9)),
        ("timestep: 100 s", lambda _: hb.tune("mujoco", alpha=0.3, timestep=100)),
        (
            "coming_from: 'up there'",
            lambda _: hb.measure(BALL, "ball,plate", coming_from="up there"),
        ),
        ("touches: 'all'", lambda path: hb.fit(path, touches="all")),
        ("begin: 'now'", lambda path: hb.fit(path, begin="now")),
        ("end: 'now'", lambda path: hb.fit(path, end="now")),
        ("max_error: -1", lambda _: hb.check(BALL, "ball,plate", restitution=0.9, max_error=-1)),
        (
            "points: e = 2 at 0.1 m/s",
            lambda _: hb.tune("mujoco", points=[(0.1, 2.0)], timestep=1e-3),
        ),
        ("good.xml: no target", lambda _: hb.check(BALL, "ball,plate")),
        ("target: none", lambda _: hb.tune("mujoco", timestep=1e-3)),
        ("stiffness: missing", lambda _: hb.tune("mujoco", alpha=0.3, timestep=1e-3, exponent=2.0)),
        ("jobs: 0", lambda _: hb.check(BALL, "ball,plate", restitution=0.9, jobs=0)),
        ("jobs: 0", lambda _: hb.report(jobs=0)),
        ("jobs: 0", lambda _: hb.run_study(hb.load_study("reports/steel-1lb/study.toml"), jobs=0)),
        ("alpha: missing", lambda _: hb.law()),
        ("model: missing", lambda _: hb.measure()),  # type: ignore[call-arg]
        ("arguments: too many positional arguments", lambda _: hb.law(0.3, 1, 2, 3)),  # type: ignore[call-overload]
        ("speed: np.timedelta64", lambda _: hb.law(0.3).e(np.timedelta64(1, "s"))),  # type: ignore[arg-type]
    ],
)
def test_an_error_in_python_names_parameters(
    begins: str, call: Callable[[str], Any], pairs: str
) -> None:
    with pytest.raises(HcbenchError) as caught:
        call(pairs)
    assert str(caught.value).startswith(begins)
    assert "--" not in str(caught.value)


def test_a_number_beyond_bounds_is_admitted_as_the_error_says() -> None:
    with pytest.raises(HcbenchError, match=r"with hcbench\.terms\.bounds\.beyond_bounds\(\):"):
        hb.law(1e5)
    from hcbench.terms.bounds import beyond_bounds

    with beyond_bounds():
        assert hb.law(1e5).alpha == 1e5


@pytest.mark.parametrize(
    ("begins", "arguments"),
    [
        ("--alpha: 1e+09 s/m; expected 0 ... 10000 s/m. --beyond-bounds", ["law", "--alpha=1e9"]),
        ("target: none; expected one of --alpha", ["tune", "mujoco", "--timestep=1e-3"]),
        (
            "--points: 2; expected 0 ... 1",
            ["tune", "mujoco", "--timestep=1e-3", "--points=0.1:2 m/s"],
        ),
    ],
)
def test_an_error_of_a_command_names_options(
    begins: str, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(arguments) == 2
    assert capsys.readouterr().err.startswith(f"hcbench: {begins}")


def results() -> Iterator[type]:
    """Classes that the package names or that its verbs return, and that cannot be changed."""
    named = (getattr(hb, name) for name in hb._CLASSES)
    for each in (*named, *RETURNED):
        parameters = getattr(each, "__dataclass_params__", None)
        if inspect.isclass(each) and parameters is not None and parameters.frozen:
            yield each


@pytest.mark.parametrize("result", list(results()), ids=lambda each: each.__name__)
def test_a_result_cannot_be_changed_and_says_so(result: type) -> None:
    """Frozen dataclasses with slots raise a TypeError about `super` for names other than fields."""
    first = dataclasses.fields(result)[0].name
    for name in (first, "alpha", "no_such_name"):
        with pytest.raises(AttributeError, match=name):
            setattr(object.__new__(result), name, 9)


def test_a_relative_cache_is_a_folder_that_a_message_names_whole(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from hcbench.system.files import user_folder

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HCBENCH_CACHE", "relative")
    assert user_folder("cache") == tmp_path / "relative" / "hcbench"
