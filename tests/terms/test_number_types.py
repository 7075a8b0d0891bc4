"""Numbers as other packages hand them over, at every kind of annotation that a verb has."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import pint
import pytest

from hcbench.measuring.request import make_request
from hcbench.system.errors import UserError
from hcbench.terms.arguments import checked
from hcbench.terms.options import BodyPair, Quantities, Quantity

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
