"""Numbers as lines for people have them."""

from __future__ import annotations

import pytest

from hcbench.system.text import time_step, two_digits


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (0.0279, "0.028"),
        (1.4e-4, "0.00014"),
        (9.64e-5, "9.6e-5"),
        (2.13e-5, "2.1e-5"),
        (1.04e-5, "1e-5"),
        (9.6e-6, "1e-5"),
        (1.26e-7, "1e-7"),
    ],
)
def test_an_error_has_two_digits_and_one_below_a_hundred_thousandth(
    error: float, text: str
) -> None:
    assert two_digits(error) == text


@pytest.mark.parametrize(
    ("step", "text"),
    [(1e-3, "0.001"), (1.0 / 240.0, "1/240"), (0.0125, "0.0125"), (1.0 / 3.0, "1/3")],
)
def test_a_step_is_a_short_decimal_or_a_rate(step: float, text: str) -> None:
    assert time_step(step) == text
