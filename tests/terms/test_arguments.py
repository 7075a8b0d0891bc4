"""Arguments of the Python interface: numbers as other packages hand them over and values of a caller's own
classes are taken for what they are, or refused by the parameter's name; the command line names its options.
"""

from __future__ import annotations

import dataclasses
import inspect
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import pint
import pytest

import hcbench as hb
from hcbench import cli
from hcbench.checking.outcome import Report
from hcbench.fitting.force import ForceFit
from hcbench.fitting.result import FitResult
from hcbench.laws.conventions import Conversion
from hcbench.measuring.measure import CandidatePairs
from hcbench.measuring.request import make_request
from hcbench.reporting.ask import StudyReport
from hcbench.system.errors import HcbenchError, UserError
from hcbench.terms.arguments import checked
from hcbench.terms.options import BodyPair, Quantities, Quantity
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
    with pytest.raises(HcbenchError, match=r"with hcbench\.beyond_bounds\(\):"):
        hb.law(1e5)
    with pytest.raises(HcbenchError, match=r"with hcbench\.beyond_bounds\(\):"):
        hb.law(0.3).e(1e308)
    with hb.beyond_bounds():
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


QUANTITY = pint.UnitRegistry().Quantity


@checked
def _takes(
    number: float = 0.0,
    count: int = 0,
    word: str = "",
    one: Quantity | None = None,
    many: Quantities | None = None,
    pair: BodyPair | None = None,
    points: Sequence[tuple[Quantity, float]] = (),
    several: Iterable[float] = (),
    two: tuple[float, float] = (0.0, 0.0),
    names: Mapping[str, float] | None = None,
    choice: Literal["a", "b"] = "a",
    array: np.ndarray[Any, Any] | None = None,
) -> dict[str, Any]:
    return locals()


NAMES = list(_takes())
STRANGE: dict[str, Any] = {
    "Pint scalar": QUANTITY(1.0, "m/s"),
    "Pint array": QUANTITY([1.0, 2.0], "m/s"),
    "array of no dimension": np.array(1.0),
    "whole array of no dimension": np.array(1),
    "truth of no dimension": np.array(True),
    "text of no dimension": np.array("a"),
    "NumPy float": np.float32(1.0),
    "NumPy truth": np.bool_(True),
    "duration": np.timedelta64(1, "s"),
    "duration of no dimension": np.array(np.timedelta64(1, "s")),
    "open file": io.BytesIO(b"1"),
    "set": {1.0},
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", STRANGE)
def test_a_strange_value_is_taken_or_refused_by_its_name(kind: str, name: str) -> None:
    try:
        taken = _takes(**{name: STRANGE[kind]})[name]
    except UserError as error:
        assert error.slot == name
        return
    assert not isinstance(taken, np.ndarray) or taken.ndim
    if kind.startswith("duration"):
        # Never a plain number: that would drop its unit.
        assert not isinstance(taken, int | float)


def test_a_tuple_of_no_parts_takes_none() -> None:
    @checked
    def takes(nothing: tuple[()] = ()) -> int:
        return len(nothing)

    assert takes(()) == takes([]) == 0  # type: ignore[arg-type]
    with pytest.raises(UserError, match=r"nothing: .* expected 0 values"):
        takes((1,))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["number", "one", "many"])
@pytest.mark.parametrize("value", [np.array(2.0), np.float64(2.0), np.array(2)])
def test_an_array_of_no_dimension_is_a_number(name: str, value: Any) -> None:
    assert _takes(**{name: value})[name] == 2.0


@pytest.mark.parametrize(
    "gravity", [QUANTITY(981.0, "cm/s^2"), np.array(9.81), QUANTITY([0.0, 0.0, -9.81], "m/s^2")]
)
def test_gravity_is_read_from_any_of_them(gravity: Any) -> None:
    assert make_request(gravity=gravity).gravity == pytest.approx((0.0, 0.0, -9.81))


def test_gravity_in_a_unit_of_another_kind_is_refused() -> None:
    with pytest.raises(UserError, match="gravity"):
        make_request(gravity=QUANTITY(9.81, "m/s"))


def test_launches_are_read_from_arrays_of_no_dimension() -> None:
    given: dict[str, Any] = {
        name: np.array(value)
        for name, value in (("speeds", 1.0), ("phases", 2), ("timestep", 0.001))
    }
    request = make_request(**given)
    assert (request.speeds, request.phases, request.timestep) == ((1.0,), (0.25, 0.75), 0.001)


MODEL = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body pos="0 0 1"><freejoint/><geom name="ball" size=".1" mass="1"/></body></worldbody></mujoco>"""


class Word(str):
    """A kind of text of the caller's own, which a worker process cannot import."""

    __slots__ = ()


class Silent:
    """An object that fails when it is shown."""

    def __repr__(self) -> str:
        raise RuntimeError("not shown")


def test_a_callers_kind_of_text_is_text(tmp_path: Path) -> None:
    path = tmp_path / "ball.xml"
    path.write_text(MODEL)
    landed = hb.land(path, heights=0.01, controller=Word("pd"))
    assert landed.controller == hb.land(path, heights=0.01).controller


@pytest.mark.parametrize(
    ("call", "slot"),
    [
        (hb.law, "alpha"),
        (lambda bad: hb.law(0.1, exponent=bad), "exponent"),
        (hb.measure, "model"),
        (lambda bad: hb.measure("ball.xml", pair=bad), "pair"),
        (lambda bad: hb.land("ball.xml", controller=bad), "controller"),
        (hb.fit, "files"),
    ],
)
def test_an_object_that_cannot_be_shown_is_refused_by_its_type(
    call: Callable[[Any], Any], slot: str
) -> None:
    with pytest.raises(UserError, match="a Silent") as refused:
        call(Silent())
    assert refused.value.slot == slot


def test_a_column_of_pandas_is_an_array() -> None:
    column = pd.Series([1.0, 2.0], index=[7, 7])
    assert hb.law(0.3).e(column).tolist() == hb.law(0.3).e([1.0, 2.0]).tolist()
    several: Any = hb.law(column)
    assert several.alphas.tolist() == [1.0, 2.0]
    with pytest.raises(UserError, match=r"^speed: "):
        hb.law(0.3).e(pd.Series([1.0, None], dtype="Float64"))
    with pytest.raises(UserError, match=r"^speed: "):
        hb.law(0.3).e(np.array([1, 2], "m8[ns]"))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: hb.fit("h.csv", against=5), "text, a path or a list, each item text or a path$"),  # type: ignore[arg-type]
        (lambda: make_request(phases=True), "whole number, text or a list, each item a number$"),
        (
            lambda: hb.randomize(BALL, "ball,plate", restitution=0.5, worlds=10**11),
            "a whole number, up to 2147483647$",
        ),
    ],
)
def test_types_are_expected_in_words(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        call()
