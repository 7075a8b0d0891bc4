"""Units: what a user types becomes the SI number it means, or one clear line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hcbench import units
from hcbench.errors import QuantityError


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


def test_a_stiffness_has_the_unit_of_its_exponent() -> None:
    assert units.parse("1 lbf/in", "stiffness", exponent=1.0) == pytest.approx(4.4482216152605 / 0.0254)
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


@given(st.floats(1e-6, 1e6))
def test_inches_are_exactly_25_4_mm(value: float) -> None:
    assert units.parse(f"{value!r} in", "length") == pytest.approx(value * 0.0254, rel=4e-16)


@given(st.text(max_size=12))
def test_any_text_is_a_finite_number_or_a_quantity_error(text: str) -> None:
    try:
        found = units.parse_values(text, "alpha")
    except QuantityError:
        return
    assert all(math.isfinite(v) for v in found)
