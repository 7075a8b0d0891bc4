"""Brent's minimum between bounds, of the book, beside SciPy's."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from hcbench.laws.solvers import minimum

FUNCTIONS: dict[str, Callable[[float], float]] = {
    "a parabola": lambda x: (x - 0.3) ** 2,
    "a corner": lambda x: abs(x - 0.3),
    "least at an end": math.exp,
    "flat": lambda x: (x - 0.3) ** 8,
    "steps": lambda x: math.floor(7 * abs(x - 0.3)) / 7,
    "many minima": lambda x: math.cos(9 * x) + 0.1 * x * x,
    "constant": lambda x: 1.0,
}


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("absolute", [1e-5, 1e-12, 0.1])
def test_bits_are_those_of_scipy(name: str, absolute: float) -> None:
    function = FUNCTIONS[name]
    ends = np.sort(np.random.default_rng(1).uniform(-5.0, 5.0, (40, 2)), axis=1)
    for low, high in ends.tolist():
        found = minimize_scalar(
            function, bounds=(low, high), method="bounded", options={"xatol": absolute}
        )
        assert minimum(function, low, high, absolute) == (found.x, found.fun)


def test_nan_ends_the_search_after_its_most_values() -> None:
    values = []

    def unknown(x: float) -> float:
        values.append(x)
        return math.nan

    assert math.isnan(minimum(unknown, 0.0, 1.0)[1])
    assert len(values) <= 500
