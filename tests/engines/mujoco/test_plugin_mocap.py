"""Mocap bodies under MuJoCo's restitution plug-in: one that moves evenly has a speed there, which
MuJoCo itself gives to none.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import pytest
from contact_scenes import require_plugins_in_specs

from hcbench.contact.mujoco import ConstantRestitution, add_to_spec

if TYPE_CHECKING:
    from collections.abc import Callable

SCENE = """<mujoco><option timestep="{h}" integrator="{integrator}"/><worldbody>
<body name="lift" mocap="true"><geom type="box" size="6 6 .5" pos="0 0 -.5"/></body>
<body name="load" pos="0 0 {z}"><freejoint/><geom type="{shape}" size=".1 .1 .1" mass="1"/></body>
</worldbody></mujoco>"""


def _model(
    e: float | None, h: float = 2e-3, z: float = 0.1, shape: str = "box", **more: str
) -> Any:
    require_plugins_in_specs()
    text = SCENE.format(h=h, z=z, shape=shape, integrator=more.get("integrator", "Euler"))
    spec = mujoco.MjSpec.from_string(text)
    if e is not None:
        add_to_spec(spec, ConstantRestitution(e), bodies=("lift", "load"))
    return spec.compile()


def _moved(
    model: Any, height: Callable[[float], float], steps: int, data: Any | None = None
) -> tuple[Any, float]:
    """Data after these steps of a floor at `height` of the time, and the deepest contact, m."""
    data = mujoco.MjData(model) if data is None else data
    deepest = 0.0
    for _ in range(steps):
        data.mocap_pos[0, 2] = height(data.time)
        mujoco.mj_step(model, data)
        deepest = max(deepest, -float(data.contact.dist.min(initial=0.0)))
    return data, deepest


def _swings(time: float) -> float:
    return float(0.05 * np.sin(6 * time))


@pytest.mark.parametrize("e", [0.0, 0.7])
@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_what_rests_on_a_floor_that_rises_and_falls_goes_with_it(shape: str, e: float) -> None:
    """Native contact lets it in by 11 mm; it starts at 0.3 m/s at once, and slows by 1.8 m/s^2."""
    deepest = {}
    for law in (None, e):
        data, deepest[law] = _moved(_model(law, shape=shape), _swings, 250)
        gap = data.qpos[2] - 0.1 - _swings(data.time - 2e-3)
        assert abs(gap) < 2e-3
    assert deepest[e] < 0.2 * deepest[None]


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize("speed", [-0.5, 0.5])
def test_a_ball_parts_from_a_floor_that_moves_at_e_times_the_speed_between_them(
    speed: float, integrator: str
) -> None:
    model = _model(0.5, h=1e-3, z=0.1 + 0.02, shape="sphere", integrator=integrator)
    model.opt.gravity[2] = 0.0
    data = mujoco.MjData(model)
    data.qvel[2] = -2.0
    data, _ = _moved(model, lambda time: speed * time, 30, data)
    assert data.qvel[2] - speed == pytest.approx(0.5 * (2.0 + speed), rel=1e-6)


def test_a_floor_that_turns_carries_what_lies_on_it() -> None:
    """At 1 rad/s, 0.5 m from the axis, by friction. Native contact lets it lie in its place."""
    model = _model(0.0)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.5
    for _ in range(500):
        data.mocap_quat[0] = [np.cos(data.time / 2), 0, 0, np.sin(data.time / 2)]
        mujoco.mj_step(model, data)
    assert np.hypot(*data.qpos[:2]) == pytest.approx(0.5, abs=5e-3)
    assert np.arctan2(data.qpos[1], data.qpos[0]) == pytest.approx(1.0, abs=0.05)


def test_a_floor_that_moves_in_some_steps_only_has_native_contact_then_and_is_named() -> None:
    """By 50 Hz here. Its speed in these steps, ten times as high, would throw the load."""
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    highest = []
    try:
        for e in (None, 0.7):
            data, _ = _moved(_model(e), lambda time: _swings(0.02 * np.floor(time / 0.02)), 130)
            highest.append(data.qpos[2])
    finally:
        mujoco.set_mju_user_warning(None)
    native, own = highest
    assert own == pytest.approx(native, abs=5e-3)
    assert sum('mocap body 1 "lift" still moves unevenly' in words for words in warned) == 1


def test_a_copy_in_motion_goes_on_as_the_first_does() -> None:
    model = _model(0.7)
    data, _ = _moved(model, _swings, 50)
    other = copy.copy(data)
    for one in (data, other):
        _moved(model, _swings, 50, one)
    np.testing.assert_array_equal(data.qpos, other.qpos)
