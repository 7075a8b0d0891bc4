"""Robots on feet of MuJoCo's restitution plug-in: servos press them in
each step, and they come to rest.
"""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import pytest
from contact_scenes import require_plugins_in_specs
from covering import every_pair

import hcbench
from hcbench.checking.text import outcome_text
from hcbench.contact.mujoco import ConstantRestitution, Restitution, add_to_spec
from hcbench.measuring.landing import as_text as landing_text

if TYPE_CHECKING:
    Law = ConstantRestitution | Restitution

QUADRUPED = (Path(__file__).parents[3] / "examples" / "quadruped.xml").read_text(encoding="utf-8")
FEET = tuple(f"{side}_{end}_foot" for side in ("left", "right") for end in ("front", "hind"))
LEG = """
<body name="{side}" pos="0 {y} -.1">
  <joint name="{side}_hip" axis="0 1 0"/><geom fromto="0 0 0 .05 0 -.2" mass="1"/>
  <body pos=".05 0 -.2">
    <joint name="{side}_knee" axis="0 1 0"/><geom fromto="0 0 0 -.05 0 -.2" mass=".7"/>
    <body pos="-.05 0 -.2">
      <joint name="{side}_ankle" axis="0 1 0"/>
      <geom name="{side}_foot" class="foot" type="box" size=".11 .05 .015" pos="0 0 -.03" mass=".4"/>
    </body>
  </body>
</body>"""
SERVOS = "".join(
    f'<position joint="{side}_{joint}"/>'
    for side in ("left", "right")
    for joint in ("hip", "knee", "ankle")
)
BIPED = f"""
<mujoco>
  <option integrator="implicitfast"/>
  <default>
    <geom type="capsule" size=".03" contype="0" conaffinity="0"/>
    <joint damping="1" armature=".01"/><position kp="150" kv="6"/>
    <default class="foot"><geom contype="1" conaffinity="1"/></default>
  </default>
  <worldbody>
    <geom name="floor" class="foot" type="plane" size="2 2 .1"/>
    <body pos="0 0 .545">
      <freejoint/><geom type="box" size=".08 .12 .1" mass="8"/>
      {LEG.format(side="left", y=".1")}{LEG.format(side="right", y="-.1")}
    </body>
  </worldbody>
  <actuator>{SERVOS}</actuator>
</mujoco>"""
GRIPPER = """
<mujoco>
  <default><geom type="box" size=".01 .01 .01"/><position kp="400" kv="20"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body pos="0 0 .02"><freejoint/><geom name="cube" size=".02 .02 .02" mass=".1"/></body>
    <body pos="-.05 0 .02">
      <joint name="left" type="slide" axis="1 0 0"/><geom name="left_pad" mass=".05"/>
    </body>
    <body pos=".05 0 .02">
      <joint name="right" type="slide" axis="-1 0 0"/><geom name="right_pad" mass=".05"/>
    </body>
  </worldbody>
  <actuator><position joint="left" ctrlrange="0 .1"/><position joint="right" ctrlrange="0 .1"/></actuator>
</mujoco>"""
ROBOTS = {
    "quadruped": (QUADRUPED, [(foot, "floor") for foot in FEET]),
    "biped": (BIPED, [("left_foot", "floor"), ("right_foot", "floor")]),
    "gripper": (GRIPPER, [("cube", "floor"), ("left_pad", "cube"), ("right_pad", "cube")]),
}
LAWS = (
    ConstantRestitution(0.0),
    ConstantRestitution(0.3),
    ConstantRestitution(0.6),
    ConstantRestitution(0.9),
)


def robot(name: str, law: Law | None, **options: Any) -> Any:
    """A robot whose pairs have the law; None: native contact. options: of MuJoCo, by its names."""
    require_plugins_in_specs()
    source, pairs = ROBOTS[name]
    spec = mujoco.MjSpec.from_string(source)
    for option, value in options.items():
        setattr(spec.option, option, value)
    for pair in pairs:
        if law is not None:
            add_to_spec(spec, law, geoms=pair)
    return spec.compile()


def landing(model: Any, height: float, tilt: float = 0.0, seconds: float = 3.0) -> dict[str, float]:
    """Speeds and tilt after a drop, m and m/s; tilt: of the base, degrees. A gripper closes from
    where it is.
    """
    data = mujoco.MjData(model)
    if model.nu == 2:
        data.ctrl[:] = 0.05
    else:
        data.qpos[2] += height
        half = np.radians(tilt) / 2
        data.qpos[3:7] = [np.cos(half), 0.6 * np.sin(half), 0.8 * np.sin(half), 0.0]
    mujoco.mj_forward(model, data)
    start, deepest, steps = data.subtree_com[0].copy(), 0.0, round(seconds / model.opt.timestep)
    fastest = 0.0
    for step in range(steps):
        mujoco.mj_step(model, data)
        deepest = max(deepest, -float(np.min(data.contact.dist, initial=0.0)))
        if step > 0.9 * steps:
            fastest = max(fastest, float(np.abs(data.qvel).max()))
    travel = float(np.linalg.norm((data.subtree_com[0] - start)[:2]))
    return {"deepest": deepest, "fastest": fastest, "travel": travel}


@pytest.mark.parametrize(
    ("name", "law", "tilt"), every_pair(list(ROBOTS), [*LAWS, Restitution(0.3)], [0.0, 5.0])
)
def test_a_robot_rests_no_deeper_than_on_native_contact(name: str, law: Law, tilt: float) -> None:
    for height in (0.02, 0.1) if tilt == 0.0 else (0.05,):
        native = landing(robot(name, None), height, tilt)
        own = landing(robot(name, law), height, tilt)
        assert own["deepest"] < native["deepest"] + 1e-3
        assert own["fastest"] < 0.01
        if law != ConstantRestitution(0.9):  # a biped rocks on with that, and walks 60 mm
            assert own["travel"] < native["travel"] + 0.03


@pytest.mark.parametrize(
    "options", ({"timestep": 5e-4}, {"integrator": 0}, {"integrator": 1}, {"cone": 1})
)
def test_steps_integrators_and_cones_leave_a_robot_on_its_feet(options: dict[str, Any]) -> None:
    native = landing(robot("quadruped", None, **options), 0.1)
    own = landing(robot("quadruped", ConstantRestitution(0.6), **options), 0.1)
    assert own["deepest"] < native["deepest"] + 1e-3
    assert own["fastest"] < 1e-3


def errors_of_e(law: Law, seed: int, *, motors: bool) -> list[float]:
    """Errors of each foot's e against the law, in a landing with all joints in motion.

    What acts within the step does not count: h J M^-1 (motors + damping - Coriolis forces, all of
    the velocities after the impact, + J^T of the rows that rest).
    """
    h, off = 5e-5, mujoco.mjtDisableBit
    model = robot("quadruped", law, timestep=h, integrator=int(mujoco.mjtIntegrator.mjINT_EULER))
    model.opt.disableflags |= int(off.mjDSBL_EULERDAMP)
    if not motors:
        model.opt.disableflags |= int(off.mjDSBL_ACTUATION)
        model.opt.gravity[:] = 0.0
        model.dof_damping[:] = 0.0
    free, data = copy.copy(model), mujoco.MjData(model)
    free.opt.disableflags |= int(off.mjDSBL_CONTACT)
    mujoco.mj_forward(model, data)
    data.qpos[2] -= min(data.geom(foot).xpos[2] for foot in FEET) - 0.025 + 1e-6
    data.qvel[:] = np.random.default_rng(seed).normal(size=model.nv) * 0.3
    data.qvel[2] -= 1.5
    mujoco.mj_forward(model, data)
    rows = np.zeros((data.ncon, 3, model.nv))
    for row, contact in zip(rows, data.contact, strict=True):
        mujoco.mj_jac(model, data, row, None, contact.pos, model.geom_bodyid[contact.geom[1]])
    normal, before = rows[:, 2], data.qvel.copy()
    alone = mujoco.MjData(free)
    alone.qpos[:] = data.qpos
    mujoco.mj_step(model, data)
    acceleration, parting = np.zeros((1, model.nv)), data.qvel.copy()
    for _ in range(
        20
    ):  # the velocities after the impact are those of the step's end less what acts in it
        alone.qvel[:] = parting
        mujoco.mj_forward(free, alone)
        force = alone.qfrc_passive + alone.qfrc_actuator - alone.qfrc_bias + data.qfrc_constraint
        mujoco.mj_solveM(free, alone, acceleration, force[None])
        parting = data.qvel - h * acceleration[0]
    after = normal @ parting
    return [
        float(out / speed - law.at(speed))
        for speed, out in zip(-(normal @ before), after, strict=True)
    ]


@pytest.mark.parametrize("motors", [False, True])
@pytest.mark.parametrize("law", [*LAWS[1:], Restitution(0.3)], ids=str)
def test_each_foot_has_the_e_of_its_own_speed_and_motors_add_their_impulse(
    law: Law, motors: bool
) -> None:
    """With gravity e is of the speed at the touch plane, g h/2 from that of the step."""
    errors = [error for seed in range(5) for error in errors_of_e(law, seed, motors=motors)]
    assert len(errors) > 15
    assert np.abs(errors).max() < (1e-3 if motors else 2e-4)


@pytest.mark.parametrize(("iterations", "words"), [(1, 'iterations="1".*Set at least 5'), (5, "")])
def test_a_solver_that_stops_early_is_named_once_where_robots_stand(
    iterations: int, words: str
) -> None:
    model = robot("quadruped", LAWS[2], iterations=iterations)
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        mujoco.mj_step(model, mujoco.MjData(model), nstep=5)
    finally:
        mujoco.set_mju_user_warning(None)
    assert len(warned) == bool(words)
    assert re.search(words, "".join(warned))


def test_a_robot_lands_on_its_feet_where_the_solver_stops_after_one_iteration() -> None:
    """Feet are solved again after each step. On native contact this robot never rests."""
    native, own = (
        landing(robot("quadruped", law, iterations=1, integrator=0), 0.1)
        for law in (None, ConstantRestitution(0.6))
    )
    assert own["deepest"] < native["deepest"] + 1e-3
    assert own["travel"] < native["travel"] + 0.03
    assert own["fastest"] < 1e-3


@pytest.mark.parametrize(("step", "words"), [(4e-3, "may land more than 1 mm deeper"), (2e-3, "")])
def test_a_robot_that_may_land_deeper_than_on_native_contact_is_named(
    step: float, words: str
) -> None:
    """By more than 1 mm, and at a step of more than an eighth of the contact's time constant."""
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        landing(robot("quadruped", LAWS[0], timestep=step), 0.1, seconds=0.4)
    finally:
        mujoco.set_mju_user_warning(None)
    deeper = [one for one in warned if "deeper" in one]
    assert len(deeper) == bool(words)
    assert re.search(words, "".join(deeper))


WHEEL = """
<mujoco>
  <option timestep="0.005" iterations="1"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="leg" pos="0 0 .2">
      <freejoint/><geom type="box" size=".05 .05 .02"/>
      <body name="wheel" pos="0 .1 -.1">
        <joint name="axle" axis="0 1 0"/><geom name="tyre" type="cylinder" euler="90 0 0" size=".05 .02"/>
      </body>
    </body>
  </worldbody>
  <actuator><general joint="axle" biastype="affine" biasprm="1 0 -.01"/></actuator>
</mujoco>"""
STOPS = 'the solver stops after iterations="1"'
TURNS = "rad in a step of 0.005 s"
DEEPER = "mm deeper than on MuJoCo's own contact"


def driven_wheel() -> str:
    """A motor turns a wheel by more than 0.1 rad a step, and the solver stops early, as MJCF."""
    require_plugins_in_specs()
    spec = mujoco.MjSpec.from_string(WHEEL)
    add_to_spec(spec, ConstantRestitution(0.5), geoms=("tyre", "floor"))
    return str(spec.to_xml())


def test_a_landing_shows_each_warning_of_the_plugin_once() -> None:
    landings = hcbench.land(driven_wheel(), heights="5, 10 cm")
    assert len(set(landings.notes)) == len(landings.notes)
    assert all(any(words in note for note in landings.notes) for words in (STOPS, TURNS, DEEPER))
    shown = landing_text([landings])
    assert all(shown.count(f"note: {note}\n") == 1 for note in landings.notes)


def test_measure_and_check_show_the_plugins_warning_once(tmp_path: Path) -> None:
    file = tmp_path / "wheel.xml"
    file.write_text(driven_wheel(), encoding="utf-8")
    measured = hcbench.measure(file, "tyre,floor", speeds=(0.5, 1.0), phases=2, diagnose=False)
    assert sum(STOPS in note for note in measured.facts.notes) == 1
    (outcome,) = hcbench.check(
        file, "tyre,floor", restitution=0.5, speeds=(0.5, 1.0), phases=2
    ).outcomes
    assert outcome_text(outcome).count(STOPS) == 1


BOX = '<body pos="{at}"><freejoint/><geom {name} type="box" size=".1 .1 .1"/></body>'
STACK_AND_BOX = f"""
<mujoco>
  <option solver="PGS" iterations="1000"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1"/>
    {BOX.format(at="0 0 .1", name="")}{BOX.format(at=".02 0 .3", name="")}{BOX.format(at="0 .02 .5", name="")}
    {BOX.format(at="2 0 .1", name='name="box"')}
  </worldbody>
</mujoco>"""


def iterations(model: Any, height: float, steps: int) -> Any:
    """Iterations of the island that takes most, by step, after a drop; shape (steps,)."""
    data = mujoco.MjData(model)
    data.qpos[2] += height
    taken = np.zeros(steps)
    for step in range(steps):
        mujoco.mj_step(model, data)
        taken[step] = data.solver_niter[: max(1, data.nisland)].max()
    return taken


@pytest.mark.parametrize("integrator", ["EULER", "IMPLICITFAST"])
@pytest.mark.parametrize("name", ["quadruped", "biped"])
def test_newton_needs_about_two_iterations_while_a_robot_settles(
    name: str, integrator: str
) -> None:
    """Native contact needs one; rows as stiff as those that stand still would need three to five."""
    number = int(getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}"))
    settling = robot(name, Restitution(0.3), integrator=number)
    assert iterations(settling, 0.1, 1000).mean() < 2.5


@pytest.mark.parametrize("cone", ["PYRAMIDAL", "ELLIPTIC"])
def test_pgs_keeps_the_forces_of_native_contacts_that_it_starts_from(cone: str) -> None:
    """A stack on native contact beside a box on the plug-in's takes no
    more than without the plug-in.
    """
    require_plugins_in_specs()
    spec = mujoco.MjSpec.from_string(STACK_AND_BOX)
    spec.option.cone = getattr(mujoco.mjtCone, f"mjCONE_{cone}")
    native = iterations(spec.compile(), 0.0, 400)[200:].mean()
    add_to_spec(spec, ConstantRestitution(0.5), geoms=("box", "floor"))
    assert iterations(spec.compile(), 0.0, 400)[200:].mean() < 2 * native


HOLDING = """
<mujoco>
  <option timestep="0.001"/>
  <default><geom friction="1 .02 .001" condim="4"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 1"/>
    <body pos="0 0 .0301"><freejoint/><geom name="box" type="box" size=".03 .03 .03" mass="{mass}"/></body>
    <body pos="0 0 .2">
      <joint name="up" type="slide" axis="0 0 1" damping="20"/>
      <geom type="box" size=".1 .03 .01" mass="1" contype="0" conaffinity="0"/>
      <body pos="-.08 0 -.15">
        <joint name="left" type="slide" axis="1 0 0" damping="20"/>
        <geom name="left_pad" type="box" size=".01 .02 .04" mass=".1"/>
      </body>
      <body pos=".08 0 -.15">
        <joint name="right" type="slide" axis="-1 0 0" damping="20"/>
        <geom name="right_pad" type="box" size=".01 .02 .04" mass=".1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="up" kp="2000" kv="200"/>
    <position joint="left" kp="2000" kv="100"/><position joint="right" kp="2000" kv="100"/>
  </actuator>
</mujoco>"""


def lifted(model: Any) -> tuple[float, float]:
    """Rise of the box that a gripper lifts by .1 m, m, and its speed at the end."""
    data, h = mujoco.MjData(model), model.opt.timestep
    for step in range(round(1.2 / h)):
        closed, up = min(1.0, step * h / 0.2), min(1.0, max(0.0, (step * h - 0.4) / 0.5))
        data.ctrl[:] = [0.1 * up, 0.06 * closed, 0.06 * closed]
        mujoco.mj_step(model, data)
    return float(data.qpos[2]), float(np.abs(data.qvel).max())


@pytest.mark.parametrize("integrator", ["EULER", "IMPLICITFAST"])
@pytest.mark.parametrize("impratio", [1.0, 10.0, 100.0])
@pytest.mark.parametrize("mass", [0.05, 0.5])
def test_a_gripper_holds_and_lifts_as_on_native_contact(
    mass: float, impratio: float, integrator: str
) -> None:
    """Elliptic cones and stiff servos, with joint damping."""
    require_plugins_in_specs()
    spec = mujoco.MjSpec.from_string(HOLDING.format(mass=mass))
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, impratio
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    native, slow = lifted(spec.compile())
    for other in ("left_pad", "right_pad", "floor"):
        add_to_spec(spec, ConstantRestitution(0.5), geoms=("box", other))
    height, speed = lifted(spec.compile())
    assert native > 0.1
    assert height == pytest.approx(native, abs=2e-3)
    assert speed == pytest.approx(slow, abs=1e-3)


def steps_under_pgs(model: Any, data: Any, count: int) -> int:
    """Take steps; the iterations of PGS in them."""
    iterations = 0
    for _ in range(count):
        mujoco.mj_step(model, data)
        iterations += int(data.solver_niter[0])
    return iterations


@pytest.mark.parametrize(
    ("name", "cone"), [("quadruped", "PYRAMIDAL"), ("quadruped", "ELLIPTIC"), ("biped", "ELLIPTIC")]
)
def test_pgs_starts_from_the_forces_of_the_last_step(name: str, cone: str) -> None:
    """A robot that stands takes fewer of its iterations than on native
    contact, a copy of it the same steps, and mj_forward changes none.
    """
    taken, options = {}, {"cone": getattr(mujoco.mjtCone, f"mjCONE_{cone}")}
    for law in (None, ConstantRestitution(0.6)):
        model = robot(name, law, solver=mujoco.mjtSolver.mjSOL_PGS, **options)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=1000)
        taken[law is None] = steps_under_pgs(model, data, 100)
    twin = copy.copy(data)
    mujoco.mj_forward(model, twin)
    first = twin.qacc.copy()
    mujoco.mj_forward(model, twin)
    np.testing.assert_array_equal(twin.qacc, first)
    assert steps_under_pgs(model, data, 20) == steps_under_pgs(model, twin, 20)
    np.testing.assert_array_equal(twin.qacc, data.qacc)
    np.testing.assert_array_equal(twin.qpos, data.qpos)
    assert taken[False] <= 200
    assert taken[False] < taken[True]
