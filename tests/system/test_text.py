"""Numbers as lines for people have them."""

from __future__ import annotations

import pytest

from hcbench.system.text import rounded_down, rounded_up, time_step, two_digits


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


@pytest.mark.parametrize(
    ("limit", "below", "above"),
    [(1.68e-5, "1.6e-05", "1.7e-05"), (0.25, "0.25", "0.25"), (9.97, "9.9", "10")],
)
def test_a_limit_that_is_printed_is_kept_by_what_is_printed(
    limit: float, below: str, above: str
) -> None:
    assert (rounded_down(limit), rounded_up(limit)) == (below, above)
    assert float(below) <= limit <= float(above)
