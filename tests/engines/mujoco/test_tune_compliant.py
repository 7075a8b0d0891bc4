"""MuJoCo's compliant pairs at robots' steps: what they promise, in loops
over mj_step that share no code.

Random speeds and phases that no fit saw; e of the speeds at the touch plane, by what a step of
semi-implicit Euler keeps in free flight.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from long_searches import long_search

import hcbench
from hcbench.engines.mujoco.backend import has_feature
from hcbench.engines.mujoco.recipes import compliant
from hcbench.engines.mujoco.recipes.compliant import (
    IMPRATIO,
    pushing_row,
    spring_and_damper_rows,
    whole_step_row,
)
from hcbench.engines.mujoco.scene.mjcf import pair_attributes
from hcbench.engines.mujoco.scene.rows import ConstraintRow
from hcbench.laws import closed_form
from hcbench.laws.restitution import MeasuredRestitution, Restitution, RestitutionCurve
from hcbench.recipes.target import Target
from hcbench.terms.scene import load_scene
from hcbench.tuning.find import tune

G, R, MASS = 9.81, 0.1, 0.5
LAW = Restitution(0.315)
BAND = (0.1, 3.0)
ADHESIVE = has_feature(mujoco, "adhesion")


@cache
def rows(
    curve: RestitutionCurve, timestep: float, corners: int = 1, adhesive: bool = ADHESIVE
) -> tuple[ConstraintRow, ...]:
    return tuple(spring_and_damper_rows(curve, BAND, timestep, G, corners, adhesive))


def model(
    given: tuple[ConstraintRow, ...],
    timestep: float,
    friction: float = 0.0,
    shape: str = "sphere",
    g: float = G,
) -> Any:
    if friction:
        given = (given[0].with_friction(friction, timestep, IMPRATIO), *given[1:])
    texts = (
        " ".join(f"{key}={text!r}" for key, text in pair_attributes(row).items()) for row in given
    )
    pairs = "".join(f'<pair geom1="ball" geom2="plate" {text}/>' for text in texts)
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{timestep}" gravity="0 0 {-g}" cone="elliptic" impratio="{IMPRATIO}"/><worldbody>
      <geom name="plate" type="plane" size="9 9 .1" contype="0" conaffinity="0"/>
      <body pos="0 0 {R}"><freejoint/><geom name="ball" type="{shape}" size="{R} {R} {R}" mass="{MASS}"
      contype="0" conaffinity="0"/></body></worldbody><contact>{pairs}</contact></mujoco>""")


def bounce(model: Any, speed: float, phase: float, slip: float = 0.0) -> tuple[float, float, float]:
    """(e, impulse of friction, normal impulse) of a touch at this speed and phase, N s."""
    data, h, g = mujoco.MjData(model), model.opt.timestep, -model.opt.gravity[2]
    t = (1 + phase) * h
    data.qpos[2] = R + speed * t - g * t * t / 2
    data.qvel[2], data.qvel[0] = -(speed - g * t - g * h / 2), slip
    touched, before = 0, 0.0
    for step in range(2_000):
        z, w = data.qpos[2] - R, float(data.qvel[2])
        if z < 0 and not touched:
            touched, before = step, w
        if touched and z >= 0 and w > 0:
            out = math.sqrt((w - g * h / 2) ** 2 + 2 * g * z)
            normal = MASS * (w - before + g * h * (step - touched))
            return out / speed, MASS * (slip - float(data.qvel[0])), normal
        mujoco.mj_step(model, data)
    return 0.0, math.nan, math.nan


def at_random(count: int = 150, lowest: float = BAND[0]) -> list[tuple[float, float, float]]:
    """(speed, phase, slip); the band's lowest speed among them."""
    random = np.random.default_rng(20)
    speeds = random.uniform(lowest, BAND[1], count)
    speeds[:10] = lowest
    return list(zip(speeds, random.uniform(0, 1, count), random.uniform(0, 3, count), strict=True))


@pytest.mark.adhesion
@pytest.mark.parametrize(
    ("timestep", "most", "sliding"), [(1e-3, 0.022, 0.03), (2e-3, 0.04, 0.045), (5e-3, 0.065, 0.08)]
)
def test_e_falls_as_the_law_at_robots_steps_with_friction_too(
    timestep: float, most: float, sliding: float
) -> None:
    smooth, rough = (model(rows(LAW, timestep), timestep, mu) for mu in (0.0, 0.5))
    assert smooth.npair == 2
    assert smooth.ngeom == 2
    off, off_sliding, off_friction = [], [], []
    for speed, phase, slip in at_random():
        wanted = float(closed_form.restitution(0.315, speed))
        off.append(abs(bounce(smooth, speed, phase)[0] - wanted))
        e, along, normal = bounce(rough, speed, phase, slip)
        off_sliding.append(abs(e - wanted))
        off_friction.append(abs(along - min(0.5 * normal, MASS * slip / 3.5)) / (0.5 * normal))
    assert max(off) < most
    assert max(off_sliding) < sliding
    assert max(off_friction) < 0.05


@pytest.mark.parametrize(
    ("curve", "most"),
    [
        (Restitution(0.05), 0.045),
        (Restitution(0.165), 0.035),
        (
            MeasuredRestitution(((0.1, 0.98), (0.5, 0.91), (1.0, 0.84), (2.0, 0.75), (3.0, 0.67))),
            0.035,
        ),
    ],
    ids=["hard", "rubber", "pairs of rubber"],
)
def test_other_materials(curve: RestitutionCurve, most: float) -> None:
    smooth = model(rows(curve, 2e-3), 2e-3)
    off = [
        abs(bounce(smooth, speed, phase)[0] - float(curve.at(speed)))
        for speed, phase, _ in at_random()
    ]
    assert max(off) < most


def test_rows_that_may_not_pull() -> None:
    smooth = model(rows(LAW, 2e-3, adhesive=False), 2e-3)
    off = [
        abs(bounce(smooth, speed, phase)[0] - float(LAW.at(speed)))
        for speed, phase, _ in at_random()
    ]
    assert max(off) < 0.04


@pytest.mark.parametrize(
    ("timestep", "depth", "buzz"), [(1e-3, 1e-4, 1e-6), (2e-3, 3e-4, 1e-5), (5e-3, 1e-3, 3e-4)]
)
def test_it_rests_after_a_drop(timestep: float, depth: float, buzz: float) -> None:
    resting = model(rows(LAW, timestep), timestep, 0.5)
    data = mujoco.MjData(resting)
    data.qpos[2] += 0.02
    heights = []
    for _ in range(round(6 / timestep)):
        mujoco.mj_step(resting, data)
        heights.append(float(data.qpos[2]) - R)
    last = np.array(heights[round(5 / timestep) :])
    assert 0 < -last.mean() < depth
    assert np.ptp(last) < buzz


@pytest.mark.parametrize("corners", [1, 4])
@pytest.mark.parametrize(("tilt", "slip"), [(0.0, 0.0), (0.3, 0.0), (0.7, 1.0)])
def test_a_box_gains_no_energy_and_stays(corners: int, tilt: float, slip: float) -> None:
    box = model(rows(LAW, 2e-3, corners), 2e-3, 0.5, "box")
    data, h, inertia = mujoco.MjData(box), 2e-3, box.body_inertia[1]
    data.qpos[2] += 0.1 + 0.5 * R * tilt
    data.qpos[3:6] = math.cos(tilt / 2), 0.8 * math.sin(tilt / 2), 0.6 * math.sin(tilt / 2)
    data.qvel[0], data.qvel[2] = slip, -1.0
    energy, places = [], []
    for _ in range(round(10 / h)):
        v, w, z = data.qvel[:3], data.qvel[3:], data.qpos[2]
        energy.append(0.5 * MASS * v @ v + 0.5 * inertia @ w**2 + MASS * G * (z - 0.5 * h * v[2]))
        places.append(data.qpos[:3].copy())
        mujoco.mj_step(box, data)
    assert max(energy) < energy[0] * (1 + 1e-9)
    assert np.abs(places[-1] - places[len(places) // 2]).max() < 1e-3


@pytest.mark.parametrize(("e", "most"), [(0.914, 0.03), (0.7, 0.065), (0.5, 0.115)])
def test_one_e_with_friction(e: float, most: float) -> None:
    row = pushing_row(MeasuredRestitution(((1.0, e),)), (0.3, 3.0), 2e-3, G)
    rough = model((row,), 2e-3, 0.5)
    off, off_friction = [], []
    for speed, phase, slip in at_random(lowest=0.3):
        found, along, normal = bounce(rough, speed, phase, slip)
        off.append(abs(found - e))
        off_friction.append(abs(along - min(0.5 * normal, MASS * slip / 3.5)) / (0.5 * normal))
    assert max(off) < most
    assert max(off_friction) < 0.04


@given(e=st.floats(0.05, 1.0), phase=st.floats(0, 0.999), speed=st.floats(0.05, 5.0))
def test_whole_steps_are_exact_without_gravity(e: float, phase: float, speed: float) -> None:
    """Tested for the row by itself; its impedance is 1e-4."""
    row, h = whole_step_row(e, 2e-3), 2e-3
    x, v = (1 - phase) * h * speed, speed
    for _ in range(3):
        v -= h * (row.stiffness * x + row.damping * v)
        x += h * v
    assert -v / speed == pytest.approx(e, abs=1e-4)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_what_tune_prints_is_what_others_find(friction: float) -> None:
    scene = load_scene("steel-plane")
    law = Target(closed_law(scene), MASS, 2e-3, *BAND, gravity=G, friction=friction)
    tuned = tune("mujoco", law, scene, recipe="compliant-pairs")
    given = tuple(ConstraintRow(**_plain(row)) for row in tuned.setting.options["rows"])
    pasted = model((given[0], *given[1:]), 2e-3)
    found = [
        abs(bounce(pasted, speed, phase, slip if friction else 0.0)[0] - float(LAW.at(speed)))
        for speed, phase, slip in at_random(400)
    ]
    assert max(found) < 1.1 * tuned.evaluation.max_error
    assert tuned.evaluation.max_error < 1.5 * max(found), "and no more than what they find"
    assert tuned.rests
    assert not tuned.evaluation.deep


@long_search
@pytest.mark.adhesion
def test_half_the_damping_of_the_spring_is_nearer_and_vibrates_13_times_as_fast(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The trade that the recipe's note tells of."""
    question: dict[str, Any] = {"alpha": 0.3, "timestep": 2e-3, "speeds": "0.1:2 m/s"}
    question |= {"friction": 0.0, "recipe": "compliant-pairs"}
    calm = hcbench.tune("mujoco", **question).tuned
    for name in ("_LEAST", "_CALM"):
        monkeypatch.setattr(compliant, name, getattr(compliant, name) / 2.0)
    lowest = compliant._LOWEST.copy()
    lowest[1] -= math.log(2.0)
    monkeypatch.setattr(compliant, "_LOWEST", lowest)
    compliant._rows_for.cache_clear()
    lively = hcbench.tune("mujoco", **question).tuned
    compliant._rows_for.cache_clear()
    assert (calm.error, lively.error) == pytest.approx((0.028, 0.024), abs=5e-4)
    assert lively.rest.vibration / calm.rest.vibration == pytest.approx(13.0, rel=0.1)
    (told,) = (note for note in calm.recipe.notes if note.startswith("With half"))
    assert "0.024 for 0.028" in told
    assert "13 times" in told


def closed_law(scene: Any) -> Any:
    from hcbench.laws.force import HuntCrossley

    return HuntCrossley(scene.stiffness, 0.315, scene.exponent)


def _plain(row: Any) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in row.items()}
