"""Numbers of a state or pose: a boolean or a text is none, whatever NumPy would make of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hcbench.measuring.request import read_joints, read_state
from hcbench.system.errors import QuantityError


@pytest.mark.parametrize("value", [True, [0, True], [[0, 1], [True, 0]], ["1"], None, 10**400])
def test_a_state_file_has_numbers_alone(value: Any, tmp_path: Path) -> None:
    state = tmp_path / "state.json"
    state.write_text(json.dumps({"hip": value}))
    with pytest.raises(QuantityError, match=r"hip: .* expected numbers"):
        read_state(state)


def test_a_whole_array_of_booleans_is_no_pose() -> None:
    with pytest.raises(QuantityError, match="hip"):
        read_joints({"hip": np.array([True, False])})


def test_equalities_are_active_or_not() -> None:
    """MuJoCo has them as booleans, and earlier as numbers."""
    for given in ([True, False], [1, 0], np.array([True, False])):
        assert read_joints({"eq_active": given}) == (("eq_active", (1.0, 0.0)),)


def test_a_joint_in_a_mapping_may_have_a_unit() -> None:
    assert read_joints({"knee": "180 deg"}) == (("knee", (np.pi,)),)
