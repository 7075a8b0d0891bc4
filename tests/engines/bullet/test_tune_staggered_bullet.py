"""PyBullet's own contact follows eq. (16): links of a ball that start to touch at staggered depths."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from hcbench.engines.pybullet.recipes import Contacts, FittedImpacts, fit_contacts
from hcbench.engines.pybullet.scene.options import read_options
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target, minimax_constant
from hcbench.scoring import score_loop
from hcbench.sim import registry
from hcbench.system.errors import SceneError, SettingError
from hcbench.terms.impact import Launch
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Setting
from hcbench.tuning.evaluate import rest_test

if TYPE_CHECKING:
    from hcbench.terms.impact import Impact

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
DAMPING = [
    7.6616,
    8.1812,
    9.3593,
    16.257,
    26.919,
    46.477,
    71.097,
    105.04,
    223.38,
    270.01,
    665.56,
    805.56,
]
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
# Links (start m, stiffness N/m, damping N s/m of the URDF) as the recipe found
# them; 1 ... 20 in/s, gravity.
FOUND = json.loads((Path(__file__).parent / "staggered_links.json").read_text(encoding="utf-8"))
# Step: α in s/in: largest error of e, and of the loop at 2, 8 and 16 in/s.
MUST = {
    1e-6: {
        0.002: (4e-4, 0.003),
        0.004: (8e-4, 0.004),
        0.008: (1.6e-3, 0.009),
        0.016: (2.2e-3, 0.022),
    },
    1e-5: {0.002: (3.5e-3, 0.02), 0.004: (3e-3, 0.02), 0.008: (6e-3, 0.02), 0.016: (9e-3, 0.03)},
}


def simulated(launches: list[Launch], **scene: Any) -> list[Impact]:
    return registry.engine("pybullet").run(replace(SCENE, **scene), SETTING, launches)


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_the_fits_model_of_bullets_step_is_bullets(gravity: float) -> None:
    speeds, phases = np.array([0.03, 0.1, 0.3, 0.5]), np.array([0.1, 0.4, 0.6, 0.9])
    launches = [Launch(v, p) for v, p in zip(speeds.tolist(), phases.tolist(), strict=True)]
    contacts = Contacts(np.array([ONSET]), np.array([STIFFNESS]), np.array([DAMPING]))
    model = FittedImpacts(speeds, phases, SCENE.mass, H, gravity, 400).restitution(contacts)[0]
    seen = [impact.restitution for impact in simulated(launches, gravity=gravity)]
    assert seen == pytest.approx(
        model, abs=1e-6 if gravity == 0 else 2e-5
    )  # it takes off a little lower
    assert seen == pytest.approx(closed_form.restitution(ALPHA, speeds), abs=2e-3)


def test_a_ball_that_slides_loses_mu_times_the_normal_impulse_and_no_e() -> None:
    straight, oblique = simulated(
        [Launch(0.2, 0.3), Launch(0.2, 0.3, slip=(2.0, 0.0))], friction=0.1
    )
    assert oblique.restitution == pytest.approx(straight.restitution, abs=1e-4)
    assert oblique.tangential is not None
    rubbed = math.hypot(*oblique.tangential.impulse)
    assert rubbed == pytest.approx(0.1 * oblique.tangential.normal_impulse, rel=1e-3)


def held_out(contacts: Contacts, law: HuntCrossley, timestep: float) -> float:
    """The largest error of e over 2000 impacts under gravity, in the model that is Bullet's."""
    random = np.random.default_rng(16)
    speeds, phases = random.uniform(INCH, 20 * INCH, 2000), random.uniform(0.0, 1.0, 2000)
    model = FittedImpacts(speeds, phases, SCENE.mass, timestep, 9.81, round(4e-4 / timestep))
    e = model.restitution(
        Contacts(*(of[None] for of in (contacts.onset, contacts.stiffness, contacts.damping)))
    )
    return float(np.abs(e[0] - closed_form.restitution(law.alpha, speeds)).max())


def test_four_links_are_found_that_follow_the_law_five_times_nearer_than_any_constant_e() -> None:
    law, timestep = HuntCrossley(SCENE.stiffness, ALPHA, SCENE.exponent), 1e-5
    target = Target(law, SCENE.mass, timestep, INCH, 20 * INCH, gravity=9.81)
    links = fit_contacts(target, law, 4, lambda contacts: contacts)
    assert held_out(links, law, timestep) < minimax_constant(target)[1] / 5


@pytest.mark.parametrize("found", FOUND, ids=lambda found: f"{found['alpha']}-{found['timestep']}")
def test_what_the_recipe_has_found_follows_the_law_and_its_loop_under_gravity(
    found: dict[str, Any],
) -> None:
    alpha, timestep = found["alpha"], found["timestep"]
    law = HuntCrossley(SCENE.stiffness, alpha / INCH, SCENE.exponent)
    x, k, c = np.array(found["links"]).T
    assert len(x) == 12
    error, loop = MUST[timestep][alpha]
    assert held_out(Contacts(x, k, c + timestep * k), law, timestep) < error
    links = [{"onset": x, "stiffness": k, "damping": c} for x, k, c in found["links"]]
    launches = [Launch.touching(v * INCH, 0.2, timestep, 9.81) for v in (2, 8, 16, 1, 11, 20)]
    setting = replace(SETTING, timestep=timestep, options={**OPTIONS, "links": links})
    impacts = registry.engine("pybullet").run(replace(SCENE, gravity=9.81), setting, launches)
    for impact in impacts:
        wanted = closed_form.restitution(law.alpha, impact.speed_in)
        assert impact.restitution == pytest.approx(wanted, abs=error)
    scores = [score_loop(impact, law, SCENE.mass) for impact in impacts[:3]]
    assert max(score.rms for score in scores if score is not None) < loop


def test_it_rests() -> None:
    rest = rest_test(registry.engine("pybullet"), SCENE, SETTING, seconds=0.05)
    assert rest.failures(SCENE.relative_radius, SETTING.timestep) == []


def test_the_script_writes_the_urdf_and_runs_by_itself(tmp_path: Path) -> None:
    text = registry.engine("pybullet").script(SCENE, SETTING)
    assert "hcbench" not in text
    command = [sys.executable, "-c", text]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    pairs = np.array(
        [line.split() for line in run.stdout.splitlines() if line[0] == "0"], dtype=float
    )
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
