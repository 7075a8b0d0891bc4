"""A robot dropped on its floor, and a recorded motion: what the force plate and each foot show."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import hcbench
from hcbench.checking import CheckSpec, check
from hcbench.checking.outcome import Verdict, judge_landings, read_limits
from hcbench.contact.mujoco import ConstantRestitution, add_to_spec
from hcbench.engines.mujoco.model.over_floor import drive_of
from hcbench.measuring.landing import as_record, as_text, labels
from hcbench.reporting.measurement_page import landing_page
from hcbench.sim.landing import PHASES, Landings
from hcbench.system.errors import UserError

G = 9.81
FLOOR = '<geom name="floor" type="plane" size="3 3 .1"/>'
STEP = 2e-5
BALL = f"""<mujoco><option timestep="{STEP}" gravity="0 0 -{G}"/><worldbody>{FLOOR}
<body name="ball" pos="0 0 .5"><freejoint/><geom name="ball" size=".05" mass="1" condim="1"
solref="-400000 -285"/></body></worldbody></mujoco>"""
_LEG = """<body name="{n}" pos="{x} {y} 0"><joint name="{n}" type="slide" axis="0 0 1" damping="5"/>
<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".01" mass=".1" contype="0" conaffinity="0"/>
<geom name="{n}_foot" pos="0 0 -.22" size=".02" mass=".1" solref=".01 .7"/></body>"""
_LEGS = {"fl": (0.2, 0.1), "fr": (0.2, -0.1), "rl": (-0.2, 0.1), "rr": (-0.2, -0.1)}


def robot(actuator: str) -> str:
    legs = "".join(_LEG.format(n=n, x=x, y=y) for n, (x, y) in _LEGS.items())
    drives = "".join(actuator.format(n=n) for n in _LEGS)
    return f"""<mujoco><option timestep="1e-3" integrator="implicitfast" gravity="0 0 -{G}"/>
<worldbody>{FLOOR}<body name="trunk" pos="0 0 .23"><freejoint/>
<geom type="box" size=".25 .12 .04" mass="5"/>{legs}</body></worldbody>
<actuator>{drives}</actuator></mujoco>"""


SERVOS = robot('<position joint="{n}" kp="2000" kv="60"/>')
MOTORS = robot('<motor joint="{n}" gear="2"/>')


@pytest.fixture(scope="module")
def standing() -> Landings:
    landings = hcbench.land(SERVOS, heights="1, 5 cm", tilt="0, 8 deg")
    assert isinstance(landings, Landings)
    return landings


def test_a_ball_lands_with_the_e_that_measure_finds() -> None:
    (drop,) = hcbench.land(BALL, heights=0.1).drops
    measured = hcbench.measure(BALL, "ball,floor", speeds=drop.speed_in, phases=2, diagnose=False)
    assert drop.speed_in == pytest.approx(math.sqrt(2 * G * 0.1), abs=G * STEP)
    assert drop.restitution == pytest.approx(measured.curve[0].restitution, abs=5e-3)
    assert drop.bouncing == 1  # comes back within the half second
    assert drop.feet[0].part == "ball"
    assert drop.feet[0].contact == pytest.approx(measured.impacts[0].duration, abs=2 * STEP)


def test_the_impulse_of_the_floor_stops_the_robot(standing: Landings) -> None:
    """∫ (F - W) dt = m v: the robot stands at the end of the half second."""
    drop = standing.drops[0]
    step = standing.timestep
    impulse = step * float((drop.force - drop.weight).sum())
    assert impulse == pytest.approx(standing.mass * drop.speed_in, rel=0.02)
    assert float(drop.force[-100:].mean()) == pytest.approx(drop.weight, rel=0.02)
    assert drop.restitution == 0.0
    assert [foot.part for foot in drop.feet] == [f"{n}_foot" for n in _LEGS]


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_a_ball_with_a_plugins_law_is_read_by_its_impulse(integrator: str) -> None:
    """The first impact gives m v (1 + e) in one step: an impulse, of which no force can be told."""
    spec = mujoco.MjSpec.from_string(BALL)
    spec.option.timestep = 2e-3
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    add_to_spec(spec, ConstantRestitution(0.6), geoms=("ball", "floor"))
    (drop,) = hcbench.land(spec.to_xml(), heights=0.2).drops
    speed = math.sqrt(2 * G * 0.2)
    assert drop.speed_in == pytest.approx(speed, abs=G * 2e-3)
    assert drop.restitution == pytest.approx(0.6, abs=G * 2e-3 / speed)
    assert drop.impulse == pytest.approx(1.6 * speed, abs=2 * G * 2e-3)
    assert math.isnan(drop.peak)
    (ball,) = drop.feet
    assert ball.speed == pytest.approx(speed, abs=G * 2e-3)
    assert math.isnan(ball.force_max)
    assert ball.bounces >= 1


def test_the_impulses_of_a_plugin_stop_a_robot() -> None:
    spec = mujoco.MjSpec.from_string(SERVOS)
    for foot in _LEGS:
        add_to_spec(spec, ConstantRestitution(0.6), geoms=(f"{foot}_foot", "floor"))
    landings = hcbench.land(spec.to_xml(), heights="20 cm")
    (drop,) = landings.drops
    momentum = landings.timestep * float((drop.force - drop.weight).sum())
    assert drop.speed_in == pytest.approx(math.sqrt(2 * G * 0.2), rel=0.01)
    assert momentum == pytest.approx(landings.mass * drop.speed_in, rel=0.02)
    assert len(drop.feet) == 4


def test_a_tilted_robot_lands_on_its_front_feet_first(standing: Landings) -> None:
    drop = next(d for d in standing.drops if d.tilt > 0)
    times = {foot.part: foot.touch for foot in drop.feet}
    assert times["fl_foot"] == times["fr_foot"] == 0.0
    assert min(times["rl_foot"], times["rr_foot"]) > 0.01


def test_a_function_of_the_state_controls_as_the_servos_do(standing: Landings) -> None:
    calls = []

    def hold(model: Any, data: Any) -> list[float]:
        calls.append(data.time)
        return [0.0] * model.nu

    landings = hcbench.land(SERVOS, heights="5 cm", controller=hold)
    same = next(d for d in standing.drops if (d.height, d.tilt) == (0.05, 0.0))
    assert landings.drops[0] == same
    assert len(calls) > 500
    assert hcbench.land(SERVOS, heights="5 cm", controller="ctrl").drops[0] == same


def test_motors_hold_the_pose_by_pd() -> None:
    held = hcbench.land(MOTORS, heights="2 cm")
    limp = hcbench.land(MOTORS, heights="2 cm", controller="pd:0,0")
    assert {foot.part for foot in held.drops[0].feet} == {f"{n}_foot" for n in _LEGS}
    assert "trunk" in {foot.part for foot in limp.drops[0].feet}
    assert "4 motors by PD" in held.controller


@pytest.mark.parametrize("pose", [0.0, 0.7, -1.2])
def test_a_servo_that_integrates_its_control_holds_a_bent_pose(pose: float) -> None:
    """The control of `intvelocity` is a rate: an angle as control turned the joint at 0.7 rad/s."""
    arm = f"""<mujoco><worldbody>{FLOOR}<body name="base" pos="0 0 9"><freejoint/><geom size=".1"/>
    <body><joint name="hinge" axis="0 1 0"/><geom size=".05" pos=".3 0 0"/></body>
    </body></worldbody><actuator>
    <intvelocity joint="hinge" kp="200" actrange="-3 3"/></actuator></mujoco>"""
    model = mujoco.MjModel.from_xml_string(arm)
    data = mujoco.MjData(model)
    data.joint("hinge").qpos = pose
    mujoco.mj_forward(model, data)
    drive, words = drive_of("pd", model, data, model.body("base").id)
    for _ in range(500):
        drive(data)
        mujoco.mj_step(model, data)
    assert data.joint("hinge").qpos[0] == pytest.approx(pose, abs=1e-3)
    assert words == "1 actuator that integrates its control, at 0"


@pytest.mark.parametrize(
    ("model", "options", "words"),
    [
        (BALL.replace("<freejoint/>", ""), {}, "no body falls: all are fixed to the world"),
        (BALL.replace(FLOOR, ""), {}, "nothing below to land on"),
        (BALL, {"gravity": 0}, "gravity that lets the robot fall"),
        (BALL, {"heights": 1e3}, "heights"),
        (SERVOS, {"controller": "lqr"}, "pd, pd:KP,KD, ctrl"),
        (SERVOS, {"controller": "pd:1"}, "two from 0 up"),
        (SERVOS, {"controller": lambda model, data: [1.0]}, "4 finite controls"),
        (
            SERVOS,
            {"controller": lambda model, data: "x"},
            "returned 'x'; expected 4 finite controls",
        ),
        (
            SERVOS,
            {"controller": lambda: None},
            r"a function of \(\); expected a function of \(model, data\)",
        ),
        (SERVOS, {"controller": 3}, "a function"),
    ],
)
def test_what_cannot_be_dropped_is_refused(model: str, options: dict[str, Any], words: str) -> None:
    with pytest.raises(UserError, match=words):
        hcbench.land(model, **{"heights": "1 cm", **options})


def test_two_robots_stand_side_by_side(standing: Landings) -> None:
    text = as_text([standing, standing])
    assert "MJCF text (1)" in text
    assert "MJCF text (2)" in text
    assert len(as_record(standing)["drops"][0]["force_n"]) == len(standing.drops[0].force)
    page = landing_page([standing, standing])
    assert page.count("fl_foot") == 8
    assert "data:image/svg+xml" in page


@pytest.fixture(scope="module")
def recorded() -> dict[str, np.ndarray[Any, Any]]:
    """A ball that bounces several times, with a sideways speed of 0.2 m/s."""
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    data.qvel[0] = 0.2
    rows = []
    for _ in range(60_000):
        rows.append((data.qpos.copy(), data.qvel.copy(), data.time))
        mujoco.mj_step(model, data)
    qpos, qvel, time = (np.array(column) for column in zip(*rows, strict=True))
    return {"qpos": qpos, "qvel": qvel, "time": time}


def test_robots_of_one_file_have_different_names(standing: Landings) -> None:
    models = ["a.xml", "b.xml", "a.xml", "a.xml (1)"]
    robots = [replace(standing, model=model) for model in models]
    assert labels(robots) == ["a.xml (1)", "b.xml", "a.xml (2)", "a.xml (1) (1)"]


def test_touchdowns_of_a_recorded_motion_have_the_speeds_of_its_falls(
    recorded: dict[str, np.ndarray[Any, Any]],
) -> None:
    motion = hcbench.measure_trajectory(BALL, recorded)
    (ball,) = motion.feet
    z, fast = recorded["qpos"][:, 2], []
    rising = recorded["qvel"][:, 2] > 0
    tops = [0, *np.flatnonzero(rising[:-1] & ~rising[1:])]
    fast = [math.sqrt(2 * G * (z[top] - 0.05)) for top in tops[: len(ball.speed)]]
    assert ball.speed[:4] == pytest.approx(fast[:4], abs=0.01)
    assert ball.slide[0] == pytest.approx(0.2)
    assert ball.band is None


# MuJoCo's contact of a sphere and a capsule begins with the sphere, that of a box and a capsule with
# the capsule.
ANVIL_AND_HAMMER = """<mujoco><worldbody>
<body name="anvil"><freejoint/><geom type="sphere" pos="-1 0 0" size=".1"/>
<geom type="box" pos="1 0 0" size=".1 .1 .1"/></body>
<body name="hammer"><freejoint/><geom type="capsule" size=".1 .05" euler="90 0 0"/></body>
</worldbody></mujoco>"""


def test_two_parts_that_move_are_one_pair_whichever_geoms_meet() -> None:
    """The hammer comes down on the sphere, then on the box, with 1 m/s and 2 m/s."""
    height = 0.2 + np.array([0.03, 0.02, 0.01, -0.001])  # m; they touch at 0.2 m
    states = len(height)
    qpos = np.zeros((2 * states, 14))
    qpos[:, [3, 10]] = 1.0
    qpos[:, 7] = np.repeat([-1.0, 1.0], states)
    qpos[:, 9] = np.tile(height, 2)
    qvel = np.zeros((2 * states, 12))
    qvel[:, 8] = -np.repeat([1.0, 2.0], states)
    motion = {"qpos": qpos, "qvel": qvel, "time": 0.1 * np.arange(2 * states)}
    (pair,) = hcbench.measure_trajectory(ANVIL_AND_HAMMER, motion, pair="anvil,hammer").feet
    assert pair.speed == pytest.approx([1.0, 2.0])


def test_check_holds_landings_and_motions_to_limits(
    tmp_path: Path, recorded: dict[str, np.ndarray[Any, Any]]
) -> None:
    (tmp_path / "robot.xml").write_text(SERVOS)
    (tmp_path / "ball.xml").write_text(BALL)
    arrays: dict[str, Any] = dict(recorded)
    np.savez(tmp_path / "states.npz", **arrays)
    lines = [
        "[[check]]\nname = 'soft'\nmodel = 'robot.xml'\nheights = '2 cm'\nrequire = 'e < 0.1, slip < 5 mm'",
        "[[check]]\nname = 'hard'\nmodel = 'robot.xml'\nheights = '2 cm'\nrequire = 'peak < 1'",
        "[[check]]\nname = 'slow'\nmodel = 'ball.xml'\ntrajectory = 'states.npz'\nrequire = 'normal < 3.1'",
        "[[check]]\nname = 'fast'\nmodel = 'ball.xml'\ntrajectory = 'states.npz'\nrequire = 'normal < 1 m/s'",
    ]
    (tmp_path / "checks.toml").write_text("\n".join(lines))
    report = check(CheckSpec(model=str(tmp_path / "checks.toml")))
    assert [outcome.verdict.value for outcome in report.outcomes] == [
        "passed",
        "failed",
        "passed",
        "failed",
    ]
    assert report.exit_code == 1
    assert "limit 'peak < 1'" in report.outcomes[1].message


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"require": "bounce < 3", "heights": "1 cm"}, "limits on e, peak"),
        ({"require": "e < 3 m", "heights": "1 cm"}, "require: e"),
        ({"heights": "1 cm"}, "given without limits"),
        ({"trajectory": "x.npz", "heights": "1 cm", "require": "outside < 1"}, "one of the two"),
    ],
)
def test_limits_that_cannot_be_meant_are_refused(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(UserError, match=words):
        check(CheckSpec(model="robot.xml", **fields))


@pytest.mark.parametrize(
    ("step", "note", "fails"),
    [
        ("2 ms", "", False),
        ("5 ms", "Too few steps in contact", False),
        ("20 ms", "The step is too long for the fall", True),
        ("100 ms", "The contact adds energy: the step does not resolve it: e up to", True),
    ],
)
def test_a_step_that_does_not_resolve_a_landing_is_named(step: str, note: str, fails: bool) -> None:
    """An e of 2.88 had exit code 0."""
    model = str(Path(__file__).parents[2] / "examples" / "quadruped.xml")
    landings = hcbench.land(model, heights="5 cm", timestep=step)
    assert any(note in each for each in landings.notes) or (not note and not landings.notes)
    assert all("Use a step of" in each for each in landings.notes)
    report = hcbench.check(model, require="e < 5", heights="5 cm", timestep=step)
    assert report.exit_code == int(fails)


def test_a_limit_holds_wherever_in_a_step_the_first_foot_touches(standing: Landings) -> None:
    """One place was tried: a millimetre of height made the same limit pass or fail."""
    drop = standing.drops[0]
    speed = math.sqrt(2.0 * G * drop.height)
    later = [drop.height + phase * standing.timestep * speed for phase in PHASES[1:]]
    seen = hcbench.land(SERVOS, heights=later).drops
    # A little higher is later in a step, and nothing else.
    for other, same in zip(drop.others, seen, strict=True):
        assert other.penetration == pytest.approx(same.penetration, rel=1e-6)
        assert other.peak == pytest.approx(same.peak, rel=1e-6)
    least, largest = drop.over_phases("penetration")
    assert (least, largest) == (
        min(drop.penetration, *(one.penetration for one in seen)),
        max(drop.penetration, *(one.penetration for one in seen)),
    )
    assert largest > 1.02 * drop.penetration
    limits = read_limits(f"penetration < {0.5e3 * (drop.penetration + largest)} mm", True)
    assert judge_landings(standing, limits)[0] is Verdict.FAILED
    assert f"{1e3 * least:.1f} ... {1e3 * largest:.1f}" in as_text([standing])
