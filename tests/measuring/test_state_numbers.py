"""Numbers of a state or pose: a boolean or a text is none, whatever NumPy would make of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import hcbench as hb
from hcbench.engines.mujoco.model.start_pose import require_plausible_model, start_pose
from hcbench.measuring.request import make_request, read_joints, read_state
from hcbench.system.errors import QuantityError, SceneError, UserError
from hcbench.system.text import gravity_text


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


def test_a_file_of_another_kind_is_no_state(tmp_path: Path) -> None:
    state = tmp_path / "state.pt"
    state.write_bytes(b"\x80\x02\xd9")
    with pytest.raises(
        UserError, match=r"state\.pt is neither \.npz nor text; expected a \.npz or"
    ):
        read_state(state)


def test_gravity_is_one_number_along_minus_z_alone() -> None:
    """A model whose gravity acts upwards had the heading of one that falls."""
    assert gravity_text((0.0, 0.0, -9.81)) == "9.81"
    assert gravity_text((0.0, 0.0, 0.0)) == "0"
    assert gravity_text((0.0, 0.0, 9.81)) == "0 0 9.81"


@pytest.mark.parametrize(("half", "is_refused"), [(0.0, False), (-1.0, True)])
def test_a_half_size_of_a_plane_is_0_or_more(half: float, is_refused: bool) -> None:
    """The size of 0 means an infinite plane; MuJoCo compiles one below 0, too."""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom name="floor" type="plane" size="{half} 1 1"/></worldbody></mujoco>'
    )
    if not is_refused:
        require_plausible_model(model, "m.xml")
        return
    with pytest.raises(SceneError, match=r"m\.xml: size -1 of geom floor"):
        require_plausible_model(model, "m.xml")


def test_a_position_out_of_bounds_is_named_by_the_body_of_its_free_joint() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body name='ball'><freejoint/><geom size='.1'/></body>"
        "</worldbody></mujoco>"
    )
    with pytest.raises(QuantityError, match=r"^qpos: ball: 1e\+300 m"):
        start_pose(model, make_request(qpos="ball=0,0,1e300"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": [0, 1, "x"]}, "^trajectory: time: not numbers alone; expected seconds"),
        ({"time": [0, 2, 1]}, "^trajectory: time does not rise"),
        ({"time": [0, 1]}, "^trajectory: 3 states in qpos, 3 in qvel and 2 in time"),
        ({"qvel": np.full((3, 6), np.nan)}, "^trajectory: qvel: numbers that are not finite"),
        ({"qpos": np.zeros((3, 7))}, "^trajectory: the quaternion of 'ball' is 0"),
    ],
)
def test_a_recording_that_cannot_be_read_names_its_array(
    change: dict[str, Any], message: str
) -> None:
    qpos = np.tile([0.0, 0, 1, 1, 0, 0, 0], (3, 1))
    recorded: dict[str, Any] = {"qpos": qpos, "qvel": np.zeros((3, 6)), "time": [0.0, 1.0, 2.0]}
    good = Path(__file__).parents[2] / "examples" / "good.xml"
    with pytest.raises(UserError, match=message):
        hb.measure_trajectory(good, recorded | change)
