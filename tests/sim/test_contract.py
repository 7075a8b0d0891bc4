"""One contract, one way to run an impact: whoever asks, one contact has
one status and one restitution.
"""

from __future__ import annotations

import dataclasses
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hcbench.engines.mujoco.scene.mjcf import model_xml
from hcbench.laws.force import HuntCrossley
from hcbench.measuring import measure
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.sim.stop import CONTACT_S, End, StopRule
from hcbench.system.errors import SettingError, UserError
from hcbench.terms.impact import Impact, Launch, Status
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Setting
from hcbench.testing import setting_for

OUTSIDE = Path(__file__).parents[1] / "outside"
PLANE = load_scene("steel-plane")
HEAVY = dataclasses.replace(PLANE, gravity=9.80665)
SOFT_SPRING = {"rows": [{"solref": [-9e4, -1.2], "solimp": [0.5, 0.5, 0.001, 0.5, 2.0]}]}


def test_an_engine_of_someone_elses_is_one_file_and_one_entry_point() -> None:
    lines = (OUTSIDE / "rk4_engine.py").read_text(encoding="utf-8").count("\n")
    assert lines <= 160
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "--noconftest",
        str(OUTSIDE),
    ]
    done = subprocess.run(
        [*command, "-c", os.devnull, "--rootdir", str(OUTSIDE)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(OUTSIDE)},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    passed = re.search(r"(\d+) passed", done.stdout)
    assert passed
    assert int(passed[1]) >= 14


# --- one contact, one status
# ---------------------------------------------------------------------------


def by_the_benchmark(setting: Setting, speed: float, scene: Any = HEAVY) -> Impact:
    (impact,) = registry.engine(setting.engine).run(scene, setting, [Launch(speed, 0.5)])
    return impact


def by_measure(setting: Setting, speed: float, scene: Any = HEAVY) -> Impact:
    text = model_xml(scene, setting)
    (impact,) = measure(text, "ball,plate", speeds=[speed], phases=[0.5], diagnose=False).impacts
    return impact


def test_a_body_that_rings_on_a_soft_spring_is_unfinished_whoever_asks() -> None:
    setting = Setting("mujoco", "soft spring", 2.5e-5, SOFT_SPRING)
    for impact in (by_the_benchmark(setting, 1e-3), by_measure(setting, 1e-3)):
        assert impact.status is Status.UNFINISHED
        assert "still in contact, and not at rest" in impact.reason
        assert np.isnan(impact.restitution)


@pytest.mark.parametrize("speed", [0.1, 0.3])
@pytest.mark.parametrize("recipe", ["stock", "impulse", "spring-damper"])
@pytest.mark.parametrize("scene", [PLANE, HEAVY], ids=["without gravity", "under gravity"])
def test_benchmark_and_measure_agree_on_a_model(recipe: str, speed: float, scene: Any) -> None:
    setting = setting_for(f"mujoco.{recipe}", "steel-plane")
    one, other = by_the_benchmark(setting, speed, scene), by_measure(setting, speed, scene)
    assert one.status is other.status
    assert one.samples == other.samples
    assert one.restitution == pytest.approx(other.restitution, abs=1e-9)


@pytest.mark.needs_engine("pybullet")
def test_a_slow_contact_is_followed_to_its_end() -> None:
    # 12 kg at 3 mm/s on a spring of a second's half period: longer than any
    # impact of steel, and a bounce.
    heavy = dataclasses.replace(PLANE, mass=12.0)
    spring = {"solref": [-3.0, -0.3], "solimp": [0.9999, 0.9999, 0.001, 0.5, 2.0]}
    soft = Setting("pybullet", "soft", 1e-3, _bullet_spring(12.0 * 3.0, 12.0 * 0.3))
    impact = by_the_benchmark(soft, 3e-3, heavy)
    assert impact.status is Status.PARTED, impact.reason
    assert impact.duration > 1.5
    rows = Setting("mujoco", "soft", 1e-3, {"rows": [spring]})
    (impact,) = registry.engine("mujoco").run(PLANE, rows, [Launch(3e-3)])
    assert impact.status is Status.PARTED, impact.reason
    assert impact.duration > 1.5


def _bullet_spring(stiffness: float, damping: float) -> dict[str, Any]:
    made = dict(setting_for("pybullet.spring-damper", "steel-plane").options)
    return {
        **made,
        "ball": {**made["ball"], "contactStiffness": stiffness, "contactDamping": damping},
    }


def test_the_stop_rule_does_not_depend_on_how_steps_are_chunked() -> None:
    rng = np.random.default_rng(7)
    x, v = rng.normal(size=(2, 5, 400))
    f = np.where(x > 0.5, x, 0.0)
    launches = [Launch(float(speed)) for speed in rng.uniform(0.1, 1.0, 5)]
    ends = []
    for chunk in (400, 7, 1):
        rule = StopRule.for_launches(launches, 1e-3, 9.8)
        counts, why = np.zeros(5, np.int64), np.zeros(5, np.int64)
        for start in range(0, 400, chunk):
            part = slice(start, start + chunk)
            now, reason = rule.add(x[:, part], v[:, part], f[:, part])
            fresh = (counts == 0) & (now > 0)
            counts[fresh], why[fresh] = now[fresh], reason[fresh]
        ends.append((counts.tolist(), why.tolist()))
    assert ends[0] == ends[1] == ends[2]


def test_a_long_fall_at_a_fine_step_is_waited_for() -> None:
    # 2 m at 1 µs: longer than any contact may last.
    rule = StopRule.for_launches([Launch(0.0, height=2.0)], 1e-6, 9.81)
    assert rule.flight_steps[0] > (2 * 2.0 / 9.81) ** 0.5 / 1e-6


def test_a_contact_that_neither_parts_nor_rests_is_unfinished_after_five_seconds() -> None:
    rule = StopRule.for_launches([Launch(1.0)], 0.01, 0.0)
    step = np.arange(700.0)
    ringing = 1e-3 * np.sin(step)[None]
    counts, why = rule.add(np.full((1, 700), 1e-3), ringing, np.ones((1, 700)))
    assert why.tolist() == [End.UNFINISHED]
    assert counts[0] == CONTACT_S / 0.01 + 1


def test_a_body_that_creeps_in_an_overlap_without_any_force_is_at_rest() -> None:
    rule = StopRule.for_launches([Launch(1.0)], 0.01, 0.0)
    force = np.zeros((1, 300))
    force[0, :3] = 1.0
    counts, why = rule.add(np.full((1, 300), 1e-5), np.where(force > 0, 0.5, -1e-5), force)
    assert why.tolist() == [End.RESTED]
    assert counts[0] == 3 + 128


# --- one mistake, one refusal
# --------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_a_step_too_coarse_for_the_force_law_is_refused_however_the_ball_gets_its_speed(
    engine: str,
) -> None:
    law = HuntCrossley(PLANE.stiffness, 0.315, PLANE.exponent)
    recipe = registry.recipe(f"{engine}.hunt-crossley")
    setting = recipe(Target(law, PLANE.mass, 1.4e-5, 0.0254, 0.508))
    fall = 0.05
    speed = (2 * HEAVY.gravity * fall) ** 0.5
    refused = []
    for launch in (Launch(speed), Launch(0.0, height=fall)):
        with pytest.raises(SettingError) as error:
            registry.engine(engine).run(
                HEAVY, dataclasses.replace(setting, timestep=4e-5), [launch]
            )
        refused.append((error.value.exit_code, type(error.value)))
    assert refused[0] == refused[1] == (2, SettingError)


# --- oblique launches
# ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "recipe", ["mujoco.impulse", "mujoco.spring-damper", "pybullet.restitution"]
)
def test_without_friction_slip_and_spin_leave_the_normal_restitution_as_it_is(recipe: str) -> None:
    setting = setting_for(recipe, "steel-plane")
    straight = Launch(0.3, 0.3)
    oblique = dataclasses.replace(straight, slip=(0.5, -0.2), spin=(3.0, 0.0, 7.0))
    one, other = registry.engine(setting.engine).run(PLANE, setting, [straight, oblique])
    assert oblique.is_oblique
    assert other.launch == oblique
    assert other.restitution == pytest.approx(one.restitution, abs=1e-9)


def test_a_recipe_of_no_known_name_is_answered_by_what_lists_recipes() -> None:
    with pytest.raises(UserError, match="`hcbench engines -v` lists them"):
        registry.recipe("zzz.qqq")
    with pytest.raises(UserError, match="`hcbench engines` lists them"):
        registry.engine("zzz")
