"""PyBullet's own contact follows eq. (16): links of a ball that start to touch at staggered depths."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from hcbench.engines.pybullet.options import read_options
from hcbench.engines.pybullet.recipes.staggered_fit import Contacts, Impacts
from hcbench.errors import SceneError, SettingError
from hcbench.impact import Launch
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.scene import load_scene
from hcbench.setting import Setting
from hcbench.sim import registry
from hcbench.tune.evaluate import evaluate
from hcbench.tune.target import Target

if TYPE_CHECKING:
    from pathlib import Path

    from hcbench.impact import Impact

SCENE = load_scene("steel-plane")
ALPHA, H, INCH = 0.008 / 0.0254, 1e-6, 0.0254
# Fitted to α = 0.008 s/in over 1 ... 20 in/s: starts (m), k (N/m), c (N s/m) of the law.
ONSET = [
    *(0, 8.6877e-7, 1.1949e-6, 1.6436e-6, 2.2606e-6, 3.1094e-6),
    *(4.2768e-6, 5.8825e-6, 8.0911e-6, 1.1129e-5, 1.5307e-5, 2.1054e-5),
]
STIFFNESS = [
    *(2.9523e7, 2.6994e7, 4.368e6, 1.0012e7, 1.1734e7, 1.5593e7),
    *(1.5605e7, 1.9231e7, 2.5633e7, 2.0567e7, 3.7105e7, 3.9372e7),
]
DAMPING = [7.6616, 8.1812, 9.3593, 16.257, 26.919, 46.477, 71.097, 105.04, 223.38, 270.01, 665.56, 805.56]
LINKS = [
    {"onset": float(x), "stiffness": k, "damping": c - H * k}
    for x, k, c in zip(ONSET, STIFFNESS, DAMPING, strict=True)
]
WORLD = {
    "restitutionVelocityThreshold": 0.0,
    "contactSlop": 0.0,
    "contactERP": 0.0,
    "contactBreakingThreshold": 0.02,
}
OPTIONS: dict[str, Any] = {
    "world": WORLD,
    "ball": {"linearDamping": 0.0, "angularDamping": 0.0, "contactProcessingThreshold": 0.0},
    "plate": {"contactStiffness": 1e30, "contactDamping": 0.0},
    "links": LINKS,
}
SETTING = Setting("pybullet", "staggered", H, OPTIONS)


def fly(launches: list[Launch], **scene: Any) -> list[Impact]:
    return registry.engine("pybullet").run(replace(SCENE, **scene), SETTING, launches)


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_the_fits_model_of_bullets_step_is_bullets(gravity: float) -> None:
    speeds, phases = np.array([0.03, 0.1, 0.3, 0.5]), np.array([0.1, 0.4, 0.6, 0.9])
    launches = [Launch(v, p) for v, p in zip(speeds.tolist(), phases.tolist(), strict=True)]
    contacts = Contacts(np.array(ONSET), np.array([STIFFNESS]), np.array([DAMPING]))
    model = Impacts(speeds, phases, SCENE.mass, H, gravity, 400).restitution(contacts)[0]
    seen = [impact.restitution for impact in fly(launches, gravity=gravity)]
    assert seen == pytest.approx(model, abs=1e-6 if gravity == 0 else 2e-5)  # it takes off a little lower
    assert seen == pytest.approx(closed_form.restitution(ALPHA, speeds), abs=2e-3)


def test_a_ball_that_slides_loses_mu_times_the_normal_impulse_and_no_e() -> None:
    straight, oblique = fly([Launch(0.2, 0.3), Launch(0.2, 0.3, slip=(2.0, 0.0))], friction=0.1)
    assert oblique.restitution == pytest.approx(straight.restitution, abs=1e-4)
    assert oblique.tangential is not None
    rubbed = math.hypot(*oblique.tangential.impulse)
    assert rubbed == pytest.approx(0.1 * oblique.tangential.normal_impulse, rel=1e-3)


@pytest.mark.parametrize(
    ("alpha", "timestep", "error", "loop"), [(0.008, 1e-6, 1.6e-3, 0.012), (0.016, 1e-5, 9e-3, 0.03)]
)
def test_the_recipe_follows_the_law_and_its_loop_under_gravity(
    alpha: float, timestep: float, error: float, loop: float
) -> None:
    law, scene = HuntCrossley(SCENE.stiffness, alpha / INCH, SCENE.exponent), replace(SCENE, gravity=9.81)
    target = Target(law, scene.mass, timestep, INCH, 20 * INCH, gravity=9.81)
    setting = registry.recipe("pybullet.staggered")(target)
    found = evaluate(registry.engine("pybullet"), scene, setting, target)
    assert found.failed == 0
    assert found.max_error < error
    assert found.loop_rms < loop


def test_the_script_writes_the_urdf_and_runs_by_itself(tmp_path: Path) -> None:
    text = registry.engine("pybullet").script(SCENE, SETTING)
    assert "hcbench" not in text
    command = [sys.executable, "-c", text]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    pairs = np.array([line.split() for line in run.stdout.splitlines() if line[0] == "0"], dtype=float)
    assert pairs[:, 1] == pytest.approx(closed_form.restitution(ALPHA, pairs[:, 0]), abs=2e-3)
    assert (tmp_path / "ball.urdf").read_text(encoding="utf-8").count("<link") == 12
    assert "links = [" in registry.engine("pybullet").snippet(SETTING, "plane")


def test_links_that_cannot_be_are_refused() -> None:
    for key, value in (("onset", -1e-6), ("stiffness", 0.0)):
        with pytest.raises(SettingError, match=f"links.*{key}"):
            read_options({"links": [{**LINKS[0], key: value}]})
    with pytest.raises(SettingError, match="links"):
        read_options({**OPTIONS, "maximal_coordinates": True})
    deep = [*LINKS, {**LINKS[0], "onset": 0.06}]
    with pytest.raises(SceneError, match="larger ball"):
        registry.engine("pybullet").run(
            SCENE, replace(SETTING, options={**OPTIONS, "links": deep}), [Launch(0.1, 0.5)]
        )
