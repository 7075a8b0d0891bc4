"""A scene that bounces as the recording did."""

from __future__ import annotations

import numpy as np
from measured_bounces import EXACT, synthesise, times_of

from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.fit import fit
from hcbench.fitting.replay import replay_text, touches_of
from hcbench.terms.impact import Trajectory


def test_touches_of_a_path_are_where_the_surfaces_met() -> None:
    t = np.arange(0.0, 1.0, 1e-3)
    height = np.where(t < 0.3, 0.3 - t, np.where(t < 0.31, -0.01, 0.9 * (t - 0.31)))
    height = np.where(t > 0.6, 0.9 * 0.29 - 2.0 * (t - 0.6), height)
    path = Trajectory(t, -height, -np.gradient(height, t), np.zeros(len(t)))
    touches = touches_of(path)
    assert abs(touches[0] - 0.3) < 2e-3


def test_a_scene_bounces_as_the_recording_did() -> None:
    """MuJoCo at 2 ms: a contact of the plug-in takes about a step,
    which the scene's α makes up for.
    """
    times = times_of(synthesise.hunt_crossley(0.3), 1, timing=5e-5, scatter=1e-3, most=12)
    scene = fit([TouchTimes("t", EXACT, times)]).scene("mujoco", 2e-3)
    assert len(scene.simulated) == len(scene.recorded) == 11
    assert scene.error < 0.01
    assert scene.alpha is not None and 0.3 < scene.alpha < 0.33
    assert 0.0 < scene.e_off < 0.02
    assert "largest error of a touch time" in replay_text(scene)
    assert "<mujoco" in scene.script
