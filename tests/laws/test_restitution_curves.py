"""Curves of restitution over impact speed, as the steps of engines use them."""

from __future__ import annotations

import numpy as np
import pytest

from hcbench.laws.restitution import Restitution


@pytest.mark.parametrize("alpha", [0.08, 0.3, 0.63])
def test_a_step_that_leaves_at_the_rebound_keeps_the_laws_e_at_the_touch_plane(
    alpha: float,
) -> None:
    """Semi-implicit steps keep a square of speed in free flight; a body at rest in the plane stays."""
    curve, h, g = Restitution(alpha), 1e-3, 9.81
    depth, rate = (
        axis.ravel() for axis in np.meshgrid(np.linspace(-2e-5, 2e-5, 9), [0.03, 0.2, 1.0])
    )
    touch = np.sqrt((rate + g * h / 2) ** 2 - 2 * g * depth)
    leaves = curve.rebound(depth, rate, h, g)
    after = np.sqrt((g * h / 2 - leaves) ** 2 - 2 * g * (depth - h * leaves))
    assert after / touch == pytest.approx(curve.at(touch), rel=1e-12)
    assert curve.rebound(0.0, 0.0, h, g) == 0.0
