"""Units: what a user types becomes the SI number it means, or one clear line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hcbench.system.errors import QuantityError
from hcbench.terms import units


@pytest.mark.parametrize(
    ("text", "quantity", "si"),
    [
        ("0.008 s/in", "alpha", 0.008 / 0.0254),
        ("16 in/s", "speed", 16 * 0.0254),
        ("1 lb", "mass", 0.45359237),
        ("3.1e7 lbf/in^1.5", "stiffness", 3.1e7 * 4.4482216152605 / 0.0254**1.5),
        ("1 ms", "timestep", 1e-3),
        ("9.81", "acceleration", 9.81),
        (0.25, "speed", 0.25),
        ("62000 psi", "pressure", 62000 * 4.4482216152605 / 0.0254**2),
    ],
)
def test_text_becomes_the_si_number_it_means(text: object, quantity: str, si: float) -> None:
    assert units.parse(text, quantity) == pytest.approx(si, rel=1e-15)


@pytest.mark.parametrize(
    ("si", "unit", "factor"),
    [(si, unit, f) for si, few in units._USUAL.items() for unit, f in few.items()],
)
def test_units_that_are_read_without_pint_are_those_of_pint(
    si: str, unit: str, factor: float
) -> None:
    assert factor == pytest.approx(units._factor(unit, si), rel=1e-15)


def test_a_stiffness_has_the_unit_of_its_exponent() -> None:
    assert units.parse("1 lbf/in", "stiffness", exponent=1.0) == pytest.approx(
        4.4482216152605 / 0.0254
    )
    with pytest.raises(QuantityError, match=r"N/m\^2"):
        units.parse("1 lbf/in", "stiffness", exponent=2.0)


def test_a_range_without_a_count_has_twenty_even_values() -> None:
    assert units.parse_values("1:20 in/s", "speed") == pytest.approx(np.arange(1, 21) * 0.0254)


def test_lists_and_ranges_mix_and_keep_their_order() -> None:
    found = units.parse_values("5 m/s, 1:2:3 m/s, 10 in/s", "speed")
    assert found == pytest.approx([5, 1, 1.5, 2, 0.254])
    assert units.parse_values(["1 in/s", 2], "speed") == pytest.approx([0.0254, 2])


@pytest.mark.parametrize(
    "text",
    [
        "",
        ",",
        "x",
        "1 furlongz",
        "1 kg",
        "nan",
        "inf",
        "1 2",
        "1:2:3:4 m/s",
        "1:x m/s",
        "1:2:1 m/s",
        "1:2:1e9 m/s",
        "1:2:2.5",
        "1 in/s, 2",
        "1, 2 in/s, 3 m/s",
        "1 m/s # of the sensor",
        "1 m/s 3",
        "1 m/s;2 m/s",
        "1 m/s/rad",
        True,
    ],
)
def test_what_is_no_speed_is_refused_with_the_slot_and_an_example(text: object) -> None:
    with pytest.raises(QuantityError) as caught:
        units.parse_values(text, "speed", "--speed")
    message = str(caught.value)
    assert message.startswith("--speed: ")
    assert "expected" in message
    assert "\n" not in message


@given(st.floats(1e-6, 1e5))
def test_inches_are_exactly_25_4_mm(value: float) -> None:
    assert units.parse(f"{value!r} in", "length") == pytest.approx(value * 0.0254, rel=4e-16)


@given(st.text(max_size=12))
def test_any_text_is_a_finite_number_or_a_quantity_error(text: str) -> None:
    try:
        found = units.parse_values(text, "alpha")
    except QuantityError:
        return
    assert all(math.isfinite(v) for v in found)


@pytest.mark.parametrize(
    ("text", "quantity", "meant"),
    [
        ("0,3 s/m", "alpha", "'0.3 s/m'"),
        ("--0.3", "alpha", "'-0.3'"),
        ("−0.3", "acceleration", "'-0.3'"),
        ("1 rpm", "frequency", "1/60 Hz"),
        ("6.28 rad/s", "frequency", "1/(2π) Hz"),
        ("360 deg/s", "frequency", "1/(2π) Hz"),
    ],
)
def test_a_near_miss_is_refused_with_what_was_meant(text: str, quantity: str, meant: str) -> None:
    with pytest.raises(QuantityError, match="expected") as caught:
        units.parse(text, quantity)
    assert meant in str(caught.value)


@pytest.mark.parametrize(
    "text", ["1,5", "0,3 m/s", "1,5:2,5:3 m/s", "1,5, 2", "1,250,000 m/s", "1,050 m/s", "1,234.5"]
)
def test_a_comma_that_may_be_a_decimal_point_makes_no_list(text: str) -> None:
    with pytest.raises(QuantityError, match="comma between digits"):
        units.parse_values(text, "speed")


@given(st.lists(st.floats(1e-3, 1e3), min_size=1, max_size=5), st.sampled_from([",", ", ", " , "]))
def test_a_unit_at_the_end_holds_for_the_whole_list_as_at_each_value(
    values: list[float], comma: str
) -> None:
    texts = [repr(value) for value in values]
    found = units.parse_values(f"{comma.join(texts)} in/s", "speed")
    assert found == pytest.approx(
        units.parse_values(comma.join(f"{t} in/s" for t in texts), "speed")
    )
    assert found == pytest.approx(np.array(values) * 0.0254)
    if len(texts) > 1:
        with pytest.raises(QuantityError, match="some values"):
            units.parse_values(f"{texts[0]} in/s{comma}{comma.join(texts[1:])}", "speed")
