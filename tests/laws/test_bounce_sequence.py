"""A bounce train by closed form: heights follow the law, energy never rises."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from hcbench.laws import closed_form, ode
from hcbench.laws.force import HuntCrossley
from hcbench.sim import registry
from hcbench.terms.impact import Launch
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Setting

GRAVITY = 9.80665
ALPHA = 0.008 / 0.0254


def test_heights_of_a_train_follow_the_law() -> None:
    scene = dataclasses.replace(load_scene("steel-plane"), gravity=GRAVITY)
    setting = Setting("reference", "hunt-crossley", 1e-5, {"alpha": ALPHA})
    path = registry.engine("reference").trajectory(scene, setting, Launch(0.0, height=0.01), 0.4)
    gap = -path.penetration
    tops = gap[1:-1][(gap[1:-1] > gap[:-2]) & (gap[1:-1] >= gap[2:]) & (gap[1:-1] > 1e-4)]
    height, law = 0.01, HuntCrossley(scene.stiffness, ALPHA)
    for top in tops[:4]:
        speed = math.sqrt(2 * GRAVITY * height)
        # Gravity lets the body go deeper: e falls by 4e-4 below that of (16), which is without.
        impact = ode.impact(law, scene.mass, speed, gravity=GRAVITY)
        assert 0 < closed_form.restitution(ALPHA, speed) - impact.restitution < 1e-3
        height *= impact.restitution**2
        assert abs(top - height) < 1e-6 * height
    assert len(tops) >= 4
    energy = 0.5 * path.rate**2 - GRAVITY * path.penetration
    flying = path.force == 0
    assert (np.diff(energy[flying]) < 1e-12).all()


def test_without_gravity_a_body_leaves_once_and_for_good() -> None:
    scene = load_scene("steel-plane")
    setting = Setting("reference", "hunt-crossley", 1e-6, {"alpha": ALPHA})
    path = registry.engine("reference").trajectory(scene, setting, Launch(0.2), 1e-3)
    assert math.isclose(
        -path.rate[-1] / 0.2, float(closed_form.restitution(ALPHA, 0.2)), rel_tol=1e-12
    )
    assert path.force[-1] == 0
