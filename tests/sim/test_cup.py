"""The true cup bounces a ball alike on its axis and off it; drops end at
the speed and phase asked for.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hcbench.benchmark.study import study_from
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.system.errors import SceneError, StudyError
from hcbench.terms.impact import Impact, Launch
from hcbench.terms.scene import load_scene

CUP = load_scene("steel-cup")
ALPHA = 0.008 / 0.0254


def impacts(recipe: str, timestep: float, off_axis: float, launches: list[Launch]) -> list[Impact]:
    scene = dataclasses.replace(CUP, off_axis=off_axis)
    law = HuntCrossley(CUP.stiffness, ALPHA, CUP.exponent)
    setting = registry.recipe(recipe)(Target(law, CUP.mass, timestep, 0.1, 0.5))
    return registry.engine(setting.engine).run(scene, setting, launches)


@pytest.mark.parametrize(
    ("recipe", "timestep", "close"),
    [
        ("mujoco.impulse", 1e-3, 1e-9),
        ("mujoco.spring-damper", 1e-6, 1e-9),
        ("pybullet.restitution", 1e-3, 1e-6),
        ("pybullet.spring-damper", 1e-6, 2e-3),  # Bullet's field of distances is right to 1e-8 m
    ],
)
def test_launched_along_the_normal_a_ball_parts_as_on_the_axis(
    recipe: str, timestep: float, close: float
) -> None:
    launches = [Launch(speed, phase) for speed in (0.1, 0.5) for phase in (0.2, 0.7)]
    on, off = (impacts(recipe, timestep, place, launches) for place in (0.0, 5e-3))
    for one, other in zip(on, off, strict=True):
        assert abs(one.restitution - other.restitution) < close
        assert one.speed_in == pytest.approx(other.speed_in, rel=1e-9)


def test_off_the_axis_gravity_acts_by_its_part_along_the_normal() -> None:
    scene = dataclasses.replace(CUP, off_axis=5e-3, gravity=9.81)
    assert scene.normal_gravity == pytest.approx(9.81 * math.sqrt(1 - (5 / 25.4) ** 2))
    centre, away = np.array([0.0, 0.0, 0.0254]), np.array(scene.normal)
    assert np.linalg.norm(scene.touch_offset - centre) == pytest.approx(0.0254)
    np.testing.assert_allclose(centre - 0.0254 * away, scene.touch_offset, atol=1e-12)


def test_only_a_cup_has_an_axis_to_be_off() -> None:
    with pytest.raises(SceneError, match="off_axis"):
        dataclasses.replace(load_scene("steel-plane"), off_axis=1e-3)
    with pytest.raises(SceneError, match="off_axis"):
        dataclasses.replace(CUP, off_axis=0.03)


@given(st.floats(0.001, 3.0), st.floats(0.0, 0.999), st.sampled_from([1e-3, 2e-3, 1 / 240]))
def test_a_drop_ends_at_the_speed_asked_for_from_about_rest(
    speed: float, phase: float, timestep: float
) -> None:
    """Semi-implicit steps h keep (v + g h/2)² + 2 g z, so that a fall from
    rest has gained g h/2 at once.

    The fall starts with less than one step's gain: no more is needed to touch at the phase. A speed
    that a fall from rest gains before the phase comes is reached from rest, at an earlier phase.
    """
    gravity = 9.81
    launch = Launch.dropped(speed, phase, timestep, gravity)
    assert launch.height is not None
    gain = gravity * timestep
    assert 0.0 <= launch.speed <= gain * (1 + 1e-9)
    touch = math.sqrt((launch.speed + gain / 2) ** 2 + 2 * gravity * launch.height)
    assert touch == pytest.approx(max(speed, gain / 2), rel=1e-9)
    steps = (touch - launch.speed) / gain - 0.5
    if speed < gain * (phase + 0.5):
        assert launch.speed == 0.0
        assert steps < phase + 1e-9
    else:
        assert abs(steps - phase - round(steps - phase)) < 1e-9 * (1 + steps)


def test_heights_need_gravity_and_stand_alone() -> None:
    run = {"engine": "mujoco", "recipe": "impulse", "timesteps": "1e-3 s", "heights": "1, 10 mm"}
    study = {"scene": "steel-cup", "alphas": "0.008 s/in", "speeds": "4, 8 in/s"}
    heavy = {**run, "gravity": "9.81 m/s^2"}
    assert study_from({**study, "run": [heavy]}).runs[0].speeds == pytest.approx(
        (0.14007, 0.44294), rel=1e-4
    )
    for wrong in (run, {**heavy, "speeds": "4 in/s"}):
        with pytest.raises(StudyError, match="run 1: heights"):
            study_from({**study, "run": [wrong]})
