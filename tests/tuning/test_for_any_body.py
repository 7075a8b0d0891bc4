"""A setting with which only balls keep their energy is never handed out without saying so."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

import hcbench as hb
from hcbench.cli import run
from hcbench.tuning.answer import Answer, Choice

pytestmark = pytest.mark.usefixtures("tuned_once")

G, STEP = 9.81, 2e-3
HALF = 0.02
ARGUMENTS = ["tune", "mujoco", "--alpha", "0.3", "--timestep", "2 ms", "--speeds", "0.1:2 m/s"]


def asked(**more: Any) -> Answer:
    return hb.tune("mujoco", alpha=0.3, timestep=STEP, speeds="0.1:2 m/s", **more)


def of_kind(answer: Answer, kind: Any) -> Choice:
    choice = answer.of(kind)
    assert choice is not None
    return choice


def box_on(text: str, shape: str = 'type="box" size="0.06 0.06 0.02"') -> Any:
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP}" gravity="0 0 {-G}"/><worldbody>'
        f'<geom name="plate" type="plane" size="9 9 1"/><body pos="0 0 {HALF}"><freejoint/>'
        f'<geom name="ball" {shape} mass="0.3"/></body></worldbody>{text}</mujoco>'
    )


def test_settings_for_spheres_end_with_exit_1_and_what_a_box_does(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run([*ARGUMENTS, "--settings"]) == 1
    caught = capsys.readouterr()
    assert "--corners: 'compliant-pairs' is for spheres:" in caught.err
    assert "x energy, at most 1.004 allowed" in caught.err
    assert "Balls need --corners 1, boxes on a face --corners 4." in caught.err
    assert "<pair geom1=" in caught.out, "the best there is gets printed all the same"


def test_who_says_that_balls_land_gets_them_with_exit_0(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run([*ARGUMENTS, "--settings", "--corners", "1"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "for spheres: a flat face gains energy" in out
    assert "or one e for all speeds: compliant, e within 0.26 from 0.1 to 2 m/s, for spheres" in out


def test_the_first_choice_is_for_any_body_where_there_is_one() -> None:
    answer = asked(kind="settings")
    settings, constant = of_kind(answer, "settings"), of_kind(answer, "constant")
    assert settings.flat is False
    assert constant.passivity is not None
    any_body = replace(constant, passivity=replace(constant.passivity, flat=True))
    native = replace(answer, asked=None, choices=(settings, any_body))
    assert native.best is any_body
    of_balls = replace(native, target=replace(native.target, corners_asked=True))
    assert of_balls.best is settings


def test_a_flat_box_bounces_as_promised_with_the_setting_for_its_four_corners() -> None:
    answer = asked(kind="settings", corners=4)
    choice = answer.best
    assert choice.kind == "settings"
    assert choice.flat is True
    assert choice.promise is not None
    model = box_on(choice.text)
    random = np.random.default_rng(41)
    for speed in np.geomspace(0.11, 1.9, 12):
        came, e = bounce(model, float(speed), float(random.uniform()))
        target = float(choice.promise.curve.at(came))
        assert abs(e - target) <= choice.max_error, f"{e:.4f} for {target:.4f} at {came:.4g} m/s"


def test_measure_names_a_ball_in_the_setting_of_four_corners_and_no_box() -> None:
    text = asked(kind="settings", corners=4).best.text
    for shape, names in (('type="box" size="0.06 0.06 0.02"', False), ('size="0.02"', True)):
        measured = hb.measure(box_on(text, shape), "ball,plate", rest=False)
        assert ("promised-corners" in measured.facts.changed) is names, shape


def test_a_pair_too_many_or_too_few_is_named_and_the_four_corners_are_still_four() -> None:
    text = asked(kind="settings", corners=4).best.text
    last = re.findall("<pair .*?/>", text)[-1]
    for changed, code in ((f"{last}{last}", "second-pair"), ("", "missing-pair")):
        edited = text.replace(last, changed)
        measured = hb.measure(box_on(edited), "ball,plate", rest=False)
        assert code in measured.facts.changed, code
        assert "promised-corners" not in measured.facts.changed, code


@pytest.mark.parametrize("engine", ["pybullet", "drake"])
def test_corners_are_refused_where_no_such_body_can_be_judged(engine: str) -> None:
    pytest.importorskip(engine if engine == "pybullet" else "pydrake")
    with pytest.raises(hb.HcbenchError, match=f"corners: 4 with '{engine}'; expected 1. Leave it"):
        hb.tune(engine, alpha=0.3, timestep="1 ms", corners=4)


@pytest.mark.needs_engine("pybullet")
def test_energy_names_the_bodies_that_were_judged() -> None:
    exact = of_kind(hb.tune("pybullet", alpha=0.3, timestep=STEP, kind="exact"), "exact")
    assert exact.energy.endswith("launches and drops of a ball")


def bounce(model: Any, speed: float, phase: float) -> tuple[float, float]:
    """Speed of a flat box at the touch plane, m/s, and e, both by the energy of free flight."""
    data = mujoco.MjData(model)
    height = min((2.0 + phase) * STEP * speed, 0.375 * speed**2 / G)
    data.qpos[2] = HALF + height
    data.qvel[2] = 0.5 * G * STEP - math.sqrt(speed**2 - 2.0 * G * height)
    came = speed
    was_down = False
    for _ in range(400):
        at_plane = (data.qvel[2] - 0.5 * G * STEP) ** 2 + 2.0 * G * (data.qpos[2] - HALF)
        is_down = data.qpos[2] <= HALF
        if was_down and not is_down:
            return came, math.sqrt(at_plane) / came
        if not was_down and not is_down:
            came = math.sqrt(at_plane)
        was_down = was_down or is_down
        mujoco.mj_step(model, data)
    return came, 0.0
