"""Rows that only push carry eq. (16) too: in a true concave cup, on and off its axis."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np
import pytest
from long_searches import long_search
from plain_mujoco import INCH, STEEL_MASS, STEEL_STIFFNESS, pasted, simulated

from hcbench.engines.mujoco.recipes.staggered_push import STAGGERED_PUSH, staggered_push
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.system.errors import SettingError
from hcbench.terms.setting import Setting

HELD_OUT = np.array([1.0, 1.37, 3.3, 8.0, 20.0]) * INCH


def target_of(alpha: float, timestep: float, exponent: float = 1.5) -> Target:
    law = HuntCrossley(STEEL_STIFFNESS * 1.4e-5 ** (1.5 - exponent), alpha / INCH, exponent)
    return Target(law, STEEL_MASS, timestep, INCH, 20 * INCH)


@cache
def setting_for(target: Target) -> Setting:
    return STAGGERED_PUSH(target)


def cup(target: Target) -> mujoco.MjModel:
    """A ball of 1 in that is free in a cup of 2 in, a tendon's limit a
    row, pasted into a fresh scene.
    """
    setting = setting_for(target)
    limits = "".join(
        f'<spatial limited="true" range="0 {INCH + row["onset"]!r}" margin="0"'
        f' solreflimit="{" ".join(map(repr, row["solref"]))}"'
        f' solimplimit="{" ".join(map(repr, row["solimp"]))}">'
        '<site site="cup"/><site site="ball"/></spatial>'
        for row in setting.options["rows"]
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{target.timestep!r}" gravity="0 0 0"/><worldbody>'
        f'<site name="cup" pos="0 0 {2 * INCH!r}"/><body name="ball" pos="0 0 {INCH!r}"><freejoint/>'
        f'<geom type="sphere" size="{INCH!r}" mass="{STEEL_MASS!r}" contype="0" conaffinity="0"/>'
        f'<site name="ball"/></body></worldbody><tendon>{limits}</tendon></mujoco>'
    )


@pytest.mark.parametrize(
    ("alpha", "limit"),
    [
        pytest.param(0.002, 6e-5, marks=long_search),
        (0.008, 1.5e-4),
        pytest.param(0.016, 2.5e-4, marks=long_search),
    ],
)
def test_restitution_is_the_laws_without_adhesion(alpha: float, limit: float) -> None:
    target = target_of(alpha, 1e-6)
    setting = setting_for(target)
    assert all(row["adhesion"] == 0.0 for row in setting.options["rows"])
    flight = simulated(pasted(dict(setting.options), 1e-6, STEEL_MASS), 1e-6, HELD_OUT, 3.5e-4)
    assert np.abs(flight.restitution - target.restitution(HELD_OUT)[:, None]).max() < limit


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_in_a_true_cup_on_and_off_the_axis(angle: float) -> None:
    target = target_of(0.008, 1e-6)
    model = cup(target)
    data = mujoco.MjData(model)
    away = np.array([np.sin(angle), 0.0, -np.cos(angle)])
    speed = 8 * INCH
    data.qpos[:3] = np.array([0.0, 0.0, 2 * INCH]) + (INCH - 1.5e-6 * speed) * away
    data.qvel[:3] = speed * away
    x, force = [], []
    for _ in range(260):
        before = data.qvel[:3] @ away
        depth = np.linalg.norm(data.qpos[:3] - [0.0, 0.0, 2 * INCH]) - INCH
        mujoco.mj_step(model, data)
        x.append(depth)
        force.append(-STEEL_MASS * (data.qvel[:3] @ away - before) / 1e-6)
    e = -float(data.qvel[:3] @ away) / speed
    assert e == pytest.approx(float(target.restitution(speed)), abs=1e-4)
    assert np.abs(np.cross(data.qvel[:3], away)).max() < 1e-9 * speed
    truth = closed_form.loop(target.law, STEEL_MASS, speed, 2001)
    top, deep = len(truth.time) // 2, int(np.argmax(x))
    inside = np.flatnonzero(np.array(x) > 0)
    going_in = np.interp(np.array(x)[inside], truth.penetration[: top + 1], truth.force[: top + 1])
    coming_out = np.interp(
        np.array(x)[inside], truth.penetration[top:][::-1], truth.force[top:][::-1]
    )
    off = np.array(force)[inside] - np.where(inside <= deep, going_in, coming_out)
    assert float(np.sqrt(np.mean(off**2))) < 0.005 * truth.force.max()


def test_coarse_steps_soften_the_spring() -> None:
    target = target_of(0.008, 1e-3)
    setting = setting_for(target)
    flight = simulated(pasted(dict(setting.options), 1e-3, STEEL_MASS), 1e-3, HELD_OUT, 0.06)
    assert np.abs(flight.restitution - target.restitution(HELD_OUT)[:, None]).max() < 1e-3


@long_search
def test_the_same_answer_always() -> None:
    target = target_of(0.008, 1e-6)
    first = setting_for(target)
    staggered_push.cache_clear()
    assert first.key == STAGGERED_PUSH(target).key


def test_what_pushing_cannot_do_is_refused() -> None:
    with pytest.raises(SettingError, match="staggered"):
        STAGGERED_PUSH(target_of(0.0, 1e-6))
    with pytest.raises(SettingError, match="integrator"):
        STAGGERED_PUSH(target_of(0.008, 1e-6), "discrete")
    linear = Target(target_of(0.008, 1e-6).law, STEEL_MASS, 1e-6, INCH, 20 * INCH, reading="linear")
    with pytest.raises(SettingError, match="soft"):
        STAGGERED_PUSH(linear)
    lossy = HuntCrossley(STEEL_STIFFNESS, 0.04 / INCH)
    with pytest.raises(SettingError, match="may pull"):
        STAGGERED_PUSH(Target(lossy, STEEL_MASS, 1e-6, 0.1 * INCH, 40 * INCH))
