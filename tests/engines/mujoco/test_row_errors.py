"""The search for spring and damper rows takes the same steps in C and in NumPy, and leaves in C what
is worse than its limit.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

pytest.importorskip("mujoco")

from hcbench.engines.mujoco.recipes import row_pair
from hcbench.engines.mujoco.recipes.compliant import _bounds, spring_and_damper_rows
from hcbench.engines.mujoco.recipes.row_pair import RowFit
from hcbench.measuring import Wanted

needs_compiler = pytest.mark.skipif(row_pair._library() is None, reason="no C compiler")


def a_fit(rk4: bool, adhesive: bool, fall: float, corners: float) -> RowFit:
    random = np.random.default_rng(1)
    target = random.uniform(0.3, 0.95, 60)
    target[::5] = np.nan
    bounds = _bounds(0.1, 0.002, 9.81 * (fall > 0.0), corners)
    return RowFit(
        random.uniform(0.06, 1.0, 60),
        random.random(60),
        target,
        fall,
        corners,
        adhesive,
        rk4,
        *bounds,
    )


@needs_compiler
@pytest.mark.parametrize(
    ("rk4", "adhesive", "fall", "corners"),
    list(product([False, True], [False, True], [0.0, 0.04, 0.3], [1.0, 4.0])),
)
def test_errors_in_c_have_the_bits_of_those_in_numpy(
    rk4: bool, adhesive: bool, fall: float, corners: float
) -> None:
    fit = a_fit(rk4, adhesive, fall, corners)
    settings = np.random.default_rng(2).uniform(fit.lowest - 0.2, fit.highest + 0.2, (40, 6))
    known = fit._errors(fit.numbers(settings))
    assert np.unique(known).size > 10
    whole = fit.errors(settings, np.full(40, np.inf))
    assert whole.tobytes() == known.tobytes()
    limit = np.full(40, np.median(known))
    limited = fit.errors(settings, limit)
    worse = known > limit
    assert limited[~worse].tobytes() == known[~worse].tobytes()
    assert (limited[worse] > limit[worse]).all()
    assert (limited[worse] < known[worse]).any()


@needs_compiler
def test_a_search_in_c_finds_the_rows_of_one_in_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    question = (Wanted(alpha=0.3), (0.0314, 0.508), 2e-3, 9.81, 1, True)
    found = spring_and_damper_rows(*question)
    monkeypatch.setattr(row_pair, "_library", lambda: None)
    assert found == spring_and_damper_rows(*question)
