"""Texts of tune keep friction: in plain MuJoCo bodies slide, spin and roll on it as promised."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from friction_questions import faults, question
from long_searches import LONG
from rigid_capsule import RigidCapsule

import hcbench as hb
from hcbench.contact.mujoco import load
from hcbench.sim import registry
from hcbench.terms.setting import Setting
from hcbench.tuning import evaluate
from hcbench.tuning.answer import Answer, Choice

pytestmark = pytest.mark.usefixtures("tuned_once")

# Drawn once, before the questions were asked; of 200, one is asked each time.
SEED = 3699553
QUESTIONS = range(200) if LONG else (4,)
G, STEP = 9.81, 2e-3
SLOPE = math.radians(5)
BALL = (0.05, 'type="sphere" size="0.05"')
BOX = (0.02, 'type="box" size="0.06 0.06 0.02"')
CAPSULE = (0.03, 'type="capsule" size="0.03 0.05" euler="0 90 0"')


@cache
def answer(friction: float | None = None, kind: Any = None) -> Answer:
    return hb.tune("mujoco", alpha=0.3, timestep=STEP, friction=friction, kind=kind)


def choices() -> list[Choice]:
    load()
    return list(answer().choices)


def body_in(text: str, body: tuple[float, str]) -> Any:
    """A body of 0.3 kg that touches a plane, with a text of hcbench."""
    height, shape = body
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP}" gravity="0 0 {-G}"/><worldbody>'
        f'<geom name="plate" type="plane" size="9 9 1"/><body pos="0 0 {height}"><freejoint/>'
        f'<geom name="ball" {shape} mass="0.3"/></body></worldbody>{text}</mujoco>'
    )


def test_a_text_has_the_friction_of_two_geoms_unless_the_user_says_none() -> None:
    settings = answer().of("settings")
    assert settings is not None
    model = body_in(settings.text, BALL)
    assert model.pair_dim[0] == 3
    assert model.pair_friction[0, :2] == pytest.approx(body_in("", BALL).geom_friction[0, 0])
    without = answer(0.0, "settings").of("settings")
    assert without is not None
    assert list(body_in(without.text, BALL).pair_dim) == [1, 1]


@pytest.mark.parametrize("body", [BALL, BOX, CAPSULE], ids=["ball", "box", "capsule"])
def test_what_is_laid_on_a_slope_of_5_degrees_stays_there(body: tuple[float, str]) -> None:
    for choice in choices():
        model = body_in(choice.text, body)
        if body is BALL:  # it would roll
            model.opt.gravity[:] = 0.0, 0.0, -G
        else:
            model.opt.gravity[:] = G * math.sin(SLOPE), 0.0, -G * math.cos(SLOPE)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, round(1.0 / STEP))
        start = data.qpos[:2].copy()
        mujoco.mj_step(model, data, round(1.0 / STEP))
        assert np.linalg.norm(data.qpos[:2] - start) < 1e-4, choice.line


def test_a_ball_laid_down_sliding_rolls_at_five_sevenths_of_its_speed_and_never_hops() -> None:
    """A solid ball whose friction has stopped its slip rolls at 5/7 of the speed it slid with."""
    for choice in choices():
        model = body_in(choice.text, BALL)
        data = mujoco.MjData(model)
        data.qvel[0] = 1.0
        highest = 0.0
        for _ in range(round(1.0 / STEP)):
            mujoco.mj_step(model, data)
            highest = max(highest, float(data.qpos[2]) - BALL[0])
        assert data.qvel[0] == pytest.approx(5 / 7, rel=2e-3), choice.line
        assert highest < G * STEP**2, choice.line


def test_a_ball_thrown_with_spin_gains_no_energy() -> None:
    spins = [(0.0, 40.0, 0.0), (10.0, -30.0, 20.0)]
    for choice in choices():
        model = body_in(choice.text, BALL)
        for speed in (0.1, 0.5):
            for spin in spins:
                data = mujoco.MjData(model)
                data.qpos[2] += 2.5 * STEP * speed
                data.qvel[:] = 0.5, 0.0, -speed, *spin
                energies = []
                for _ in range(100):
                    mujoco.mj_step(model, data)
                    if not data.ncon:
                        v = data.qvel[:3] - [0.0, 0.0, G * STEP / 2]
                        turning = 0.4 * BALL[0] ** 2 * data.qvel[3:] @ data.qvel[3:]
                        energies.append(v @ v / 2 + turning / 2 + G * data.qpos[2])
                assert max(energies) <= 1.0005 * energies[0], choice.line


def test_what_throws_up_a_sliding_ball_is_never_used_and_the_reason_says_so() -> None:
    found = hb.tune("mujoco", restitution=0.9, timestep=STEP)
    reasons = {never.setting: never.why for never in found.never}
    assert "hop of a ball, laid down sliding" in reasons["impulse"]
    assert all(choice.setting.name != "impulse" for choice in found.choices)


def test_energy_never_grew_in_as_many_launches_as_were_judged() -> None:
    for choice in choices():
        evaluated = choice.tuned.evaluation.launches if choice.tuned else 0
        assert choice.passivity is not None
        tried = choice.passivity.bounces.tried
        tried += sum(finding.tried for finding in choice.passivity.sliding)
        if choice.flat:
            tried += sum(finding.tried for finding in choice.passivity.boxes)
        assert f"energy never grew in {evaluated + tried} launches and drops" in choice.energy
        assert choice.passivity.sliding


@pytest.mark.needs_engine("pybullet")
def test_bullets_text_writes_a_friction_where_one_was_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Bodies of Bullet have a friction of their own, which a text leaves; `test_answer.py` has one."""
    monkeypatch.setattr(evaluate, "_RANDOM", 20)  # the text is the same for any launches
    question: dict[str, Any] = {"restitution": 0.9, "timestep": STEP, "kind": "constant"}
    asked = hb.tune("pybullet", speeds="0.3:0.5 m/s", friction=0.4, **question)
    assert "lateralFriction=0.4" in asked.text


def test_a_force_law_that_takes_the_place_of_mujocos_contact_has_friction_too() -> None:
    engine = registry.engine("mujoco")
    law = {"kind": "force", "alpha": 0.3, "stiffness": 1e9, "exponent": 1.5}
    setting = engine.with_friction(Setting("mujoco", "hunt-crossley", 1e-5, {"law": law}), 0.5)
    assert '<config key="friction" value="0.5" />' in engine.snippet(setting, "plane")


def test_a_setting_for_one_point_says_that_a_flat_box_gains_energy_and_measure_names_it() -> None:
    question: dict[str, Any] = {"restitution": 0.5, "speeds": "0.3:2 m/s", "kind": "constant"}
    one_point = hb.tune("mujoco", timestep=STEP, **question).of("constant")
    assert one_point is not None
    assert one_point.flat is False
    assert "a flat face gains energy" in one_point.energy
    exact = hb.tune("mujoco", timestep=STEP, **question).of("exact")
    assert exact is not None
    assert "flat" not in exact.energy
    for choice, names_it in ((one_point, True), (exact, False)):
        measured = hb.measure(body_in(choice.text, BOX), "ball,plate", rest=False)
        assert ("promised-corners" in measured.facts.changed) is names_it


def test_the_bodies_that_tune_throws_print_no_warning_of_the_plugin(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    hb.tune("mujoco", alpha=0.6, timestep="3.5 ms", speeds="0.1:0.2 m/s", kind="exact")
    assert capfd.readouterr().err == ""
    assert not list(tmp_path.iterdir())


@pytest.mark.adhesion
@pytest.mark.parametrize("number", QUESTIONS)
def test_a_random_question_with_friction_has_answers_that_plain_mujoco_keeps(number: int) -> None:
    """e within the printed error, straight and spinning; no gain, no hop, no creep on 5 degrees."""
    assert list(faults(question(SEED, number))) == []


@pytest.mark.needs_engine
@pytest.mark.parametrize("engine", ["dart", "rapier", "drake"])
def test_friction_is_refused_by_name_where_no_sliding_body_can_be_judged(engine: str) -> None:
    with pytest.raises(hb.HcbenchError) as refused:
        hb.tune(engine, alpha=0.3, timestep="1 ms", friction=0.5)
    assert str(refused.value).startswith(f"friction: 0.5 with '{engine}'; expected 0. Leave it out")


def test_no_text_of_drake_takes_the_friction_of_its_bodies_away() -> None:
    """Drake's own friction, 0.5, of a shape that states none."""
    setting = Setting("drake", "discrete", 1e-3, {"point_stiffness": 1e5, "dissipation": 0.4})
    text = registry.engine("drake").snippet(setting, "plane")
    assert "drake.CoulombFriction(0.5, 0.5)" in text


@pytest.mark.parametrize("mu", [0.3, 1.14])
def test_a_capsule_that_slides_along_its_axis_hops_no_higher_than_a_rigid_one(mu: float) -> None:
    """The plug-in's e near 1 and much friction lift it off its ends, and so does the ideal body.

    An end that meets the plane at e = 0.99 has lost nothing of its speed, and friction tilts the
    capsule onto its front end again and again: sliding becomes height, and energy never grows.
    """
    load()
    gravity, step, e = 1.62, 1e-3, 0.995
    plugin = (
        '<extension><plugin plugin="hcbench.restitution"><instance name="contact">'
        '<config key="geom1" value="ball"/><config key="geom2" value="plate"/>'
        f'<config key="restitution" value="{e}"/></instance></plugin></extension>'
    )
    friction = f'friction="{mu} 0.005 0.0001"'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco>{plugin}<option timestep="{step}" gravity="0 0 {-gravity}"/><worldbody>'
        f'<geom name="plate" type="plane" size="9 9 1" {friction}/><body pos="0 0 0.03">'
        f'<freejoint/><geom name="ball" {CAPSULE[1]} mass="0.03" {friction}/></body></worldbody>'
        "</mujoco>"
    )
    ideal, ours = [], []
    for tilt in (0.0, 1e-6, -1e-6, 1e-5, -1e-5, 1e-4, -1e-4):
        rigid = RigidCapsule(e, mu, gravity, tilt)
        ideal.append(rigid.highest(0.7, 2e-4))
        data = mujoco.MjData(model)
        data.qvel[0] = 1.0
        data.qpos[3:7] = [math.cos(tilt / 2), 0.0, math.sin(tilt / 2), 0.0]
        highest = 0.0
        for _ in range(round(0.7 / step)):
            mujoco.mj_step(model, data)
            highest = max(highest, float(data.qpos[2]) - CAPSULE[0])
        ours.append(highest)
        assert rigid.gain < 1e-3
    if mu > 1.0:
        assert max(ideal) > 3e-3, "the ideal body hops"
    assert max(ours) < 1.5 * max(ideal) + 1e-4
    # All of its energy of sliding would lift it so high, m.
    assert max(ours) < 0.5 / gravity
