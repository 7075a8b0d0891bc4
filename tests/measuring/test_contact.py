"""Meaning of a contact in a robot's words: each number against a closed form or a loop of its own."""

from __future__ import annotations

import functools
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hcbench.measuring import measure
from hcbench.measuring.contact import ContactMeaning, as_lines, spring_and_damper
from hcbench.measuring.text import as_text
from hcbench.sim.rest import creep_of

mujoco = pytest.importorskip("mujoco")

MASS, G = 2.0, 9.81
PLATE = '<geom name="plate" type="plane" size="9 9 .1" {contact}/>'
MODEL = (
    '<mujoco><option timestep="1e-3" {option}/><worldbody>'
    + PLATE
    + '<body name="body" pos="0 0 .5"><freejoint/><geom name="geom" mass="2" {shape} {contact}/></body>'
    "</worldbody></mujoco>"
)
BALL = 'type="sphere" size=".1"'
BOX = 'type="box" size=".1 .1 .05"'
# A constant impedance d, for closed forms.
D = 0.9
CONSTANT = f'solimp="{D} {D} .001 .5 2"'


def text(shape: str, contact: str, option: str = "") -> str:
    return MODEL.format(shape=shape, contact=contact, option=option)


@functools.cache
def meaning(model: Any, pair: str = "body,plate", speeds: str = "0.3, 1") -> ContactMeaning:
    found = measure(model, pair, speeds=speeds, contact=True, diagnose=False, rest=False)
    assert found.contact is not None
    return found.contact


def test_stiffness_and_damping_are_those_of_mujocos_spring_on_the_mass() -> None:
    """solref (-k, -b) and a constant impedance d: F = m (k x + b v + d g), and d k x = (1 - d) k x
    at rest: there the contact is 1/(1 - d) times as stiff.
    """
    found = meaning(text(BALL, f'condim="1" solref="-4000 -20" {CONSTANT}'))
    for impact in found.impacts:
        assert impact.stiffness == pytest.approx(MASS * 4000.0)
        assert impact.damping == pytest.approx(MASS * 20.0)
        assert impact.damping_ratio == pytest.approx(20.0 / (2.0 * math.sqrt(4000.0)))
        assert impact.misfit < 1e-9
    assert found.carried.load == pytest.approx(MASS * G, rel=1e-6)
    assert found.carried.stiffness == pytest.approx(MASS * 4000.0 / (1.0 - D), rel=1e-4)
    assert (found.carried.holds, found.carried.holds_most) == (0.0, 0.0)


def test_under_more_weight_a_spring_yields_as_much_more() -> None:
    found = meaning(text(BALL, f'condim="1" solref="-4000 -20" {CONSTANT}'))
    own = found.carried.loads[0].penetration
    for load in found.carried.loads:
        assert load.force == pytest.approx(load.times * MASS * G, rel=1e-4)
        assert load.penetration == pytest.approx(load.times * own, rel=1e-3)


@pytest.mark.parametrize(("cone", "weakest"), [("elliptic", 0.5), ("pyramidal", 0.5 / 2**0.5)])
def test_friction_holds_up_to_the_slope_that_it_says(cone: str, weakest: float) -> None:
    """Gravity turned towards the diagonal of the contact's axes, in plain steps of a box."""
    model = text(BOX, f'friction=".5" {CONSTANT}', f'cone="{cone}"')
    found = meaning(model).carried
    assert found.holds == pytest.approx(math.atan(weakest), rel=1e-3)
    assert found.holds_most == pytest.approx(math.atan(0.5), rel=1e-3)
    assert _slides(model, 0.97 * found.holds) < 5e-3
    assert _slides(model, 1.05 * found.holds) > 5e-2


def _slides(text: str, angle: float) -> float:
    """Speed, m/s, after half a second on a slope, rad, that falls along (1, 1)."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[2] = 0.05
    down = math.sin(angle) / math.sqrt(2.0)
    model.opt.gravity[:] = G * down, G * down, -G * math.cos(angle)
    mujoco.mj_step(model, data, 500)
    return float(np.linalg.norm(data.qvel[:2]))


def test_creep_is_that_of_the_friction_constraint() -> None:
    """At rest R f = -b v of each of a box's four contacts, R = (1 - d)/(d m), b = 2/(dmax tc), and
    4 f = m g sin θ (MuJoCo's documentation, Computation: constraint model).
    """
    found = meaning(
        text(BOX, f'friction=".5" solref=".02 1" {CONSTANT}', 'cone="elliptic"')
    ).carried
    assert found.slope == pytest.approx(math.radians(10.0))
    damping = 2.0 / (D * 0.02)
    assert found.creep == pytest.approx(
        (1.0 - D) / D * G * math.sin(found.slope) / (4.0 * damping), rel=1e-3
    )


def test_a_ball_that_rolls_down_a_slope_does_not_creep() -> None:
    assert math.isnan(meaning(text(BALL, f'friction=".5" {CONSTANT}')).carried.creep)


def test_what_turns_on_its_place_creeps_and_what_rolls_down_does_not() -> None:
    assert creep_of(5e-5, spin=3e-3, lever=0.01) == 5e-5
    assert math.isnan(creep_of(0.5, spin=30.0, lever=0.02))
    assert creep_of(0.5, spin=1.0, lever=0.02) == 0.5


def test_a_landing_peaks_as_in_a_loop_of_plain_mujoco() -> None:
    from robot_drops import FEET, QUADRUPED, drop

    found = meaning(str(QUADRUPED), FEET[0], speeds="0.5")
    model = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    peak = found.peaks[-1]
    assert peak.height == 0.1
    seen = [drop(model, 0.1, phase, 0.5).peak for phase in (0.0, 0.25, 0.5, 0.75)]
    assert (peak.lowest, peak.highest) == pytest.approx((min(seen), max(seen)), rel=1e-3)
    assert peak.lowest < 0.99 * peak.highest


def test_the_largest_stable_step_is_the_last_at_which_no_launch_gains() -> None:
    model = text(BALL, 'condim="1" solref="-1e5 -100" solimp=".99 .99 .001 .5 2"')
    found = meaning(model, speeds="1")
    stable = found.largest_stable_step
    assert [step.is_stable for step in found.steps][-2:] == [True, False]
    assert stable == found.steps[-2].timestep
    assert max(_restitutions(model, stable)) <= 1.0
    assert max(_restitutions(model, 2.0 * stable)) > 1.0


def _restitutions(text: str, step: float) -> list[float]:
    """e by energy at 1 m/s and 32 phases, in plain steps without gravity."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = step
    found = []
    for phase in (np.arange(32) + 0.5) / 32:
        data = mujoco.MjData(model)
        data.qpos[2] = 0.1 + (2.0 + phase) * step
        data.qvel[2] = -1.0
        mujoco.mj_step(model, data, 400)
        # The height to which it would rise from here tells its speed at the plate.
        height = float(data.qpos[2]) - 0.1
        found.append(math.sqrt(max(0.0, float(data.qvel[2]) ** 2 + 2.0 * G * height)))
    return found


def test_without_weight_there_is_no_load_and_no_landing() -> None:
    found = meaning(text(BALL, CONSTANT, 'gravity="0 0 0"'))
    assert (found.carried.loads, found.peaks) == ((), ())
    words = "\n".join(as_lines(found))
    assert "stiffness, N/m" in words
    assert "at rest" not in words
    assert "dropped" not in words


def test_one_speed_has_one_column() -> None:
    first, *_ = as_lines(meaning(text(BALL, CONSTANT), speeds="0.5"))
    assert first.count("m/s") == 1


def test_a_function_of_a_users_file_makes_a_world_for_each_step(tmp_path: Path) -> None:
    """The trials of causes end the first world, and each step takes one of its own."""
    pytest.importorskip("pybullet")
    lines = (
        "import pybullet as p",
        "def world():",
        "    p.connect(p.DIRECT)",
        "    p.setGravity(0, 0, -9.81)",
        "    for shape, mass in ((p.GEOM_SPHERE, 1), (p.GEOM_PLANE, 0)):",
        "        form = p.createCollisionShape(shape, radius=0.1)",
        "        p.createMultiBody(mass, form, basePosition=[0, 0, 0.3 * mass])",
    )
    (tmp_path / "world.py").write_text("\n".join(lines))
    found = measure(f"{tmp_path}/world.py:world", "body:0,body:1", speeds=[1.0], contact=True)
    assert found.contact is not None
    assert found.contact.carried.load == pytest.approx(G, rel=0.01)
    assert not math.isnan(found.contact.largest_stable_step)
    assert found.causes


def test_too_few_steps_tell_no_spring() -> None:
    same = np.ones(9)
    assert all(math.isnan(number) for number in spring_and_damper(same, same, same))
    stiff = text(BALL, 'condim="1" solref="-1e7 0" solimp=".99 .99 .001 .5 2"')
    assert all(math.isnan(impact.stiffness) for impact in meaning(stiff).impacts)


def test_what_slides_on_a_rail_has_no_friction_to_hold_it() -> None:
    rail = text(BALL, CONSTANT).replace("<freejoint/>", '<joint type="slide" axis="0 0 1"/>')
    carried = meaning(rail).carried
    assert carried.load == pytest.approx(MASS * G, rel=1e-4)
    assert math.isnan(carried.holds)
    assert math.isnan(carried.creep)


def test_neighbours_of_the_same_e_share_a_line() -> None:
    lines = as_lines(meaning(text(BALL, 'condim="1" solref=".02 1"')))
    assert [line for line in lines if "... 0.016 s" in line and line.endswith("  0.000")]
    assert [line for line in lines if line.startswith("contact time") and "stays" in line]


def test_what_servos_do_while_a_foot_touches_is_said_to_its_end() -> None:
    """The note ended in "gravit...", and a row had no number."""
    robot = Path(__file__).parents[2] / "examples" / "quadruped.xml"
    found = measure(
        robot, "left_front_foot,floor", speeds="0.1, 1", contact=True, diagnose=False, rest=False
    )
    said = " ".join(as_text(found).split())
    (words,) = re.findall(
        r"In % of the impulse of their contact, they press the two together: (.*?)\. ", said
    )
    taken = {name: int(share) for name, share in re.findall(r"([a-z][a-z ]+) (\d+) %", words)}
    assert {"actuators", "gravity and motion of the links"} <= taken.keys()
    assert 90 < sum(taken.values()) <= 101  # of a foot that stays: hardly any turns its speed
    assert "stiffness, N/m" in said
    assert "damping ratio" not in said


def test_a_spring_and_a_damper_are_found_beside_a_constant_force() -> None:
    x, v = np.linspace(0.0, 1e-3, 9), np.cos(np.linspace(0.0, 3.0, 9))
    stiffness, damping, misfit = spring_and_damper(x, v, 3e4 * x + 20.0 * v + 5.0)
    assert (stiffness, damping) == pytest.approx((3e4, 20.0))
    assert misfit < 1e-9


def test_what_was_not_asked_for_is_not_measured() -> None:
    found = measure(text(BALL, CONSTANT), "body,plate", speeds="1", diagnose=False)
    assert found.contact is None


# What a stranger's models found: numbers that looked right.
GUIDED = (
    '<mujoco><worldbody><geom name="plate" type="plane" size="1 1 1" euler="0 3 0"/>'
    '<body name="body" pos="0 0 .1"><joint type="slide" axis="0 0 1"/>'
    '<geom size=".05" mass="1"/></body></worldbody></mujoco>'
)
SKIDS = (
    '<mujoco><worldbody><geom name="plate" type="plane" size="1 1 1"/>'
    '<body name="drone" pos="0 0 .1"><freejoint/>'
    '<geom name="body" type="capsule" fromto="-.1 .1 0 .1 .1 0" size=".01" mass=".5"/>'
    '<geom name="other" type="capsule" fromto="-.1 -.1 0 .1 -.1 0" size=".01" mass=".5"/>'
    "</body></worldbody></mujoco>"
)
RAMP = (
    '<mujoco><worldbody><geom name="plate" type="plane" size="2 2 1" euler="0 15 0"/>'
    '<body name="body" pos="0 0 .2" euler="0 15 0"><freejoint/>'
    '<geom type="box" size=".1 .1 .02" mass="1"/></body></worldbody></mujoco>'
)


@pytest.mark.parametrize("model", [GUIDED, SKIDS])
def test_friction_alone_does_not_hold_what_joints_guide_or_another_contact_holds(
    model: str,
) -> None:
    carried = meaning(model).carried
    assert carried.load > 0.0
    assert math.isnan(carried.weakest)
    assert math.isnan(carried.creep)


# The contact with the post is found, but does not act within its gap.
NEAR_A_POST = """<mujoco><worldbody><geom name="plate" type="plane" size="1 1 1"/>
<geom type="box" pos=".202 0 .1" size=".1 .1 .1" margin=".02" gap=".02"/>
<body name="body" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>
</worldbody></mujoco>"""
# A contact of a flex has the geom -1; the box is the last geom.
BESIDE_A_FLEX = """<mujoco><worldbody><geom name="plate" type="plane" size="3 3 1"/>
<body name="rag" pos="2 0 .05"><flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" dim="2"
radius=".01" mass=".1"><contact selfcollide="none"/></flexcomp></body>
<body name="body" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("model", [NEAR_A_POST, BESIDE_A_FLEX])
def test_contacts_that_do_not_touch_the_body_do_not_hold_it(model: str) -> None:
    """Between its axes a pyramidal cone with a friction of 1 bears 1/√2 of the load."""
    assert meaning(model).carried.weakest == pytest.approx(math.sqrt(0.5), rel=1e-3)


def test_on_a_ramp_the_slope_would_be_another_one() -> None:
    assert math.isnan(meaning(RAMP).carried.creep)


def test_the_force_of_a_stage_of_rk4_tells_no_stiffness() -> None:
    contact = f'condim="1" solref="-4000 -20" {CONSTANT}'
    found = meaning(text(BALL, contact, option='integrator="RK4"'))
    assert all(math.isnan(impact.stiffness) for impact in found.impacts)
