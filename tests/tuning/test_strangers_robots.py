"""Robots of a stranger in `tune` and `land`: advice that was not true, controls of a keyframe that
were left out, and drops of the two that could not be compared.
"""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from typing import Any

import numpy as np
import pytest

import hcbench as hb
from hcbench.cli.tune_model import _same_drops, landing_sentences
from hcbench.measuring.landing import make_drops
from hcbench.measuring.request import make_request
from hcbench.sim.landing import DROPS, TILTS, DropTest, Reach, RobotDrop, few_steps, kv_factor
from hcbench.sim.model_under_test import ModelSetting, Output, Texts
from hcbench.system.errors import QuantityError
from hcbench.tuning.landing import _tuned
from hcbench.tuning.tuned_model import LandingChange

mujoco = pytest.importorskip("mujoco")

from robot_drops import FEET, QUADRUPED  # noqa: E402

from hcbench.engines.mujoco.model.causes.motion import _change_of_approach  # noqa: E402
from hcbench.engines.mujoco.model.drop_test import ModelDropBench, landing  # noqa: E402
from hcbench.engines.mujoco.model.foot_springs import PairSearch, stiffened  # noqa: E402

_PEG = '<geom name="peg{n}" pos="{x} {y} -.05" size=".01" mass=".02"/>'
_JAW = """<body name="jaw{n}" pos="{x} 0 .03">
<joint name="jaw{n}" type="slide" axis="{a} 0 0" damping="2"/>
<geom type="box" size=".008 .02 .05" pos="0 0 .05" mass=".06"/></body>"""
_SERVO = '<position joint="jaw{n}" kp="400" kv="4"/>'
PEGS = [f"peg{n},bench" for n in range(4)]
GRIP = 'ctrl=".02 .02"'


def gripper(ctrl: str) -> str:
    """A hand on four pegs, whose jaws squeeze a cube 10 cm over it by the ctrl of a keyframe."""
    corners = [(-0.06, -0.05), (-0.06, 0.05), (0.06, -0.05), (0.06, 0.05)]
    pegs = "".join(_PEG.format(n=n, x=x, y=y) for n, (x, y) in enumerate(corners))
    jaws = _JAW.format(n=0, x=-0.04, a=1) + _JAW.format(n=1, x=0.04, a=-1)
    pose = "0 0 .062 1 0 0 0 .0004 .0004 0 0 .162 1 0 0 0"
    return f"""<mujoco>
<option timestep=".002" integrator="implicitfast" cone="elliptic" impratio="10"/>
<worldbody><geom name="bench" type="plane" size="1 1 .1"/>
<body name="hand" pos="0 0 .062"><freejoint/>
<geom type="box" size=".08 .06 .03" mass=".7"/>{pegs}{jaws}</body>
<body name="cube" pos="0 0 .162"><freejoint/>
<geom type="box" size=".0318 .02 .02" mass=".1"/></body></worldbody>
<actuator>{_SERVO.format(n=0)}{_SERVO.format(n=1)}</actuator>
<keyframe><key name="hold" qpos="{pose}" {ctrl}/></keyframe></mujoco>"""


def bench_of(text: str, pairs: list[str], **given: Any) -> ModelDropBench:
    spec = mujoco.MjSpec.from_string(text)
    return ModelDropBench(spec, "a robot", [make_request(pair, **given) for pair in pairs])


@pytest.mark.parametrize("drop", [DROPS[0], DROPS[-1]])
def test_a_hand_that_is_dropped_keeps_its_grip(drop: RobotDrop) -> None:
    """The cube stayed where it was in the world, and the servos held the jaws where they were."""
    bench = bench_of(gripper(GRIP), PEGS, key="hold")
    data = mujoco.MjData(bench.model)
    state = bench._release(drop)
    mujoco.mj_setState(bench.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    data.ctrl[:] = bench._controls
    mujoco.mj_step(bench.model, data, nstep=500)
    assert np.linalg.norm(data.body("cube").xpos - data.body("hand").xpos) == pytest.approx(
        0.1, abs=2e-3
    )
    assert bench.robot.controller.endswith("by the pose's ctrl; it holds 'cube'")


def test_land_and_tune_give_servos_the_same_controls() -> None:
    landed = hb.land(gripper(GRIP), heights=0.02, key="hold")
    assert landed.controller == "2 position servos hold their joints by the pose's ctrl"
    assert "It holds 'cube', dropped with it." in landed.notes
    # A keyframe without ctrl has zeros: the servos hold the angles of its pose.
    assert bench_of(gripper(""), PEGS, key="hold")._controls == pytest.approx([4e-4, 4e-4])
    moved = bench_of(gripper(GRIP), PEGS, key="hold", qpos="jaw0=-0.01")
    assert moved._controls == pytest.approx([-0.01, 0.02])


def test_what_a_keyframe_moves_by_mocap_stays_where_it_is_put() -> None:
    """Drops put it back to where the model has it: here under the hand."""
    pad = '<body name="pad" mocap="true"><geom type="box" size="1 1 .01"/></body>'
    text = gripper(f'{GRIP} mpos="5 0 0"').replace("<worldbody>", f"<worldbody>{pad}")
    free = bench_of(gripper(GRIP), PEGS, key="hold").test(0.4, DROPS[:1])
    moved = bench_of(text, PEGS, key="hold").test(0.4, DROPS[:1])
    assert (moved.peak, moved.depth) == pytest.approx((free.peak, free.depth))


@cache
def before() -> DropTest:
    return landing(QUADRUPED, [make_request(pair) for pair in FEET], None)


def test_land_makes_the_tilted_drops_of_tune() -> None:
    """`land` tilted about y alone: other feet, other depths."""
    words = _same_drops(LandingChange(before(), before(), 0.02), (str(QUADRUPED),))
    assert words == ' --heights "2, 5, 10 cm" --tilt "0, 5 deg about 0.6 0.8 0"'
    (landed,) = hb.land(QUADRUPED, heights=0.1, tilt="5 deg about 0.6 0.8 0").drops
    bench = ModelDropBench(
        mujoco.MjSpec.from_file(str(QUADRUPED)), "", [make_request(pair) for pair in FEET]
    )
    judged = bench.test(0.6, [RobotDrop(0.1, TILTS[-1], 0.0)])
    assert landed.penetration == pytest.approx(judged.depth, rel=0.01)
    assert landed.peak == pytest.approx(judged.peak, rel=0.01)


def test_an_axis_of_a_tilt_is_three_numbers() -> None:
    assert make_drops(tilt="5 deg about 0 2 0") == make_drops(tilt="5 deg")
    for wrong in ("0 0 0", "1 0", "x y z", "nan 0 0"):
        with pytest.raises(QuantityError, match="three numbers, such as 5 deg about 1 0 0"):
            make_drops(tilt=f"5 deg about {wrong}")


def test_few_steps_are_said_with_the_setting() -> None:
    """A robot was handed out with exit 0, of which `land` then said that it bounces by chance."""
    brief = dataclasses.replace(before(), contact=3e-3)
    h = brief.robot.timestep
    setting = ModelSetting("feet as springs", (), lambda _: None, lambda *_: Texts("lines"))  # type: ignore
    notes = _tuned(setting, LandingChange(before(), brief, 0.02), Output()).notes
    assert notes == few_steps(3e-3, h)
    assert notes[0].endswith("Use a step of 5e-05 s.")
    assert few_steps(13 * h, h) == few_steps(math.nan, h) == ()


def test_a_contact_lasts_until_the_robot_leaves_the_floor() -> None:
    bench = bench_of(gripper(GRIP), PEGS, key="hold")
    stays = bench.test(0.5, DROPS[:1])
    # A fall of 2 cm, and then contact to the end.
    assert stays.contact == pytest.approx(0.5 - math.sqrt(2 * 0.02 / 9.81), abs=5e-3)


def sentences(reach: Reach) -> str:
    return " ".join(landing_sentences(LandingChange(before(), before(), 0.2, reach)))


def test_stiffer_servos_are_advised_where_all_drops_have_shown_them() -> None:
    shown = sentences(Reach(0.01, ((2.0, math.nan), (4.0, 0.198))))
    assert "with kp times 4 and kv times 2 a contact has 198 mm" in shown
    none = sentences(Reach(0.01, ((2.0, math.nan), (4.0, math.nan))))
    assert "would do" not in none
    assert "with stiffer servos, up to kp times 4 and kv times 2, either" in none


def test_what_the_touch_alone_promises_is_no_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice the kp was to give 55 mm; done so, twice that was to give 58 mm, and so on."""
    search = PairSearch(QUADRUPED, [make_request(pair) for pair in FEET], before(), 0.09)
    judged: list[float] = []

    def refused(_: PairSearch, factor: float) -> float:
        judged.append(factor)
        return math.nan

    monkeypatch.setattr(PairSearch, "largest_of_few", lambda _: 1.0)
    monkeypatch.setattr(PairSearch, "_judged_with", refused)
    ((factor, rebound),) = search.stiffer()
    assert judged == [factor] == [2.0]
    assert math.isnan(rebound)


def test_stiffer_servos_have_the_gains_that_are_printed() -> None:
    plain = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    stiff = stiffened(QUADRUPED, 2.0).compile()
    assert kv_factor(2.0) == 1.4
    assert stiff.actuator_gainprm[:, 0] == pytest.approx(2.0 * plain.actuator_gainprm[:, 0])
    assert stiff.actuator_biasprm[:, 1] == pytest.approx(2.0 * plain.actuator_biasprm[:, 1])
    assert stiff.actuator_biasprm[:, 2] == pytest.approx(1.4 * plain.actuator_biasprm[:, 2])


def test_a_smaller_step_is_advised_where_something_shows_that_it_helps() -> None:
    worse = dataclasses.replace(before(), depth=2.0 * before().depth)
    change = LandingChange(before(), worse, 0.02, Reach(0.01))
    assert "smaller step" not in " ".join(landing_sentences(change))
    gaining = dataclasses.replace(before(), gain=0.2)
    change = LandingChange(gaining, worse, 0.02, Reach(0.01))
    assert "first take a smaller step" in " ".join(landing_sentences(change))


def test_drops_end_with_the_first_in_which_something_is_worse() -> None:
    """One tilted drop was made, and then all: a peak is that of a flat one."""
    requests = [make_request(pair) for pair in FEET]
    bench = ModelDropBench(mujoco.MjSpec.from_file(str(QUADRUPED)), "", requests)
    tilted, flat = (bench.test(0.4, [RobotDrop(0.1, tilt, 0.75)]) for tilt in reversed(TILTS))
    assert flat.peak > tilted.peak
    between = 0.5 * (flat.peak + tilted.peak)
    whole = landing(QUADRUPED, requests, dataclasses.replace(before(), seconds=0.4))
    like = dataclasses.replace(whole, peak=min(between / 1.2, between - 2.0))
    first = landing(QUADRUPED, requests, like, until_worse=True)
    assert (first.drops, first.flat) == (1, 1)


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (-12.0, "they added 12 times the speed at touch to the approach"),
        (-0.3, "they added 30 % of the speed at touch to the approach"),
        (0.07, "they took 7 % of the speed at touch from the approach"),
    ],
)
def test_what_servos_did_is_said_in_words(share: float, words: str) -> None:
    """The cause said "found -12 of the speed at touch"."""
    assert _change_of_approach(share) == f"while the two touched, {words}"
