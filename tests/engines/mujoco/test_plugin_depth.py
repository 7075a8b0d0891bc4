"""Depth of what keeps moving in contact under MuJoCo's restitution plug-in.

Rows of the solver hold velocities; depth is what these leave. 16 dropped bodies here, 160
under `make test-plugins`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest

from hcbench.contact import mujoco as contact

LONG = "HCBENCH_PLUGINS" in os.environ
DEEPER = 1e-3  # m, the depth beyond that of native contact from which on the page speaks of it

SHAPES = {
    "disc": 'type="cylinder" size=".05 .003"',
    "puck": 'type="cylinder" size=".03 .011"',
    "can": 'type="cylinder" size=".03 .06"',
    "rod": 'type="cylinder" size=".008 .12"',
    "plate": 'type="box" size=".07 .05 .004"',
    "box": 'type="box" size=".04 .03 .025"',
    "egg": 'type="ellipsoid" size=".06 .035 .02"',
    "capsule": 'type="capsule" size=".02 .05"',
}
STEPS = (0.5e-3, 1e-3, 2e-3, 4e-3)


def with_laws(world: str, pairs: dict[tuple[str, str], float], options: str = "") -> str:
    """MJCF of a world whose pairs of geoms have an e each."""
    instances = "".join(
        f'<instance name="{one}-{other}"><config key="geom1" value="{one}"/>'
        f'<config key="geom2" value="{other}"/><config key="restitution" value="{e}"/></instance>'
        for (one, other), e in pairs.items()
    )
    plugin = f'<plugin plugin="hcbench.restitution">{instances}</plugin>' if instances else ""
    floor = '<geom name="floor" type="plane" size="9 9 .1"/>'
    return (
        f"<mujoco><extension>{plugin}</extension><option {options}/>"
        f"<worldbody>{floor}{world}</worldbody></mujoco>"
    )


@dataclass
class Depths:
    """Depth, m, of the deepest contact in all of a run, and in its last half second.

    energy: at the start, J; rose: the most that it rose after its lowest, J.
    warned: what the plug-in said.
    """

    most: float
    last: float
    energy: float
    rose: float
    warned: list[str]

    @property
    def named(self) -> bool:
        return bool(self.warned)


Control = Callable[[Any, Any], None]


def depths(
    text: str,
    seconds: float,
    velocity: tuple[float, ...] = (),
    control: Control = lambda model, data: None,
) -> Depths:
    contact.load()
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(model)
    data.qvel[: len(velocity)] = velocity
    count, warned = round(seconds / model.opt.timestep), list[str]()
    depth, energy = np.zeros(count), np.zeros(count)
    mujoco.set_mju_user_warning(warned.append)
    try:
        for step in range(count):
            control(model, data)
            mujoco.mj_step(model, data)
            depth[step] = -float(data.contact.dist.min()) if data.ncon else 0.0
            energy[step] = float(data.energy.sum())
    finally:
        mujoco.set_mju_user_warning(None)
    rose = float((energy - np.minimum.accumulate(energy)).max())
    late = round(0.5 / model.opt.timestep)
    return Depths(float(depth.max()), float(depth[-late:].max()), energy[0], rose, warned)


EGG = (
    '<body pos="0 0 .04"><freejoint/>'
    '<geom name="egg" type="ellipsoid" size=".06 .04 .04" mass=".3"/></body>'
)


@pytest.mark.parametrize("step", [2e-3, 1e-3])
def test_an_ellipsoid_that_rolls_stays_on_the_floor_and_keeps_its_energy(step: float) -> None:
    """At a speed of 0 along the normal it sank by 6 mm a second, and lost what it sank."""
    text = with_laws(EGG, {("egg", "floor"): 0.3}, f'timestep="{step}"')
    seen = depths(text, 8.0, (1.0, 0.0, 0.0, 3.0, 25.0, 0.0))
    assert seen.last < 0.75e-3
    assert seen.rose < 0.01 * seen.energy


def disc(height: float, tilt: float) -> str:
    return (
        f'<body pos="0 0 {height}" euler="{tilt} 0 0"><freejoint/>'
        f'<geom name="disc" {SHAPES["disc"]}/></body>'
    )


@pytest.mark.parametrize("e", [0.0, 0.3])
@pytest.mark.parametrize("step", [2e-3, 1e-3])
def test_a_disc_that_wobbles_down_does_not_sink(step: float, e: float) -> None:
    text = with_laws(disc(0.04, 35.0), {("disc", "floor"): e}, f'timestep="{step}"')
    seen = depths(text, 4.0, (0.0, 0.0, 0.0, 1.0, 5.0, 2.0))
    assert seen.last < 0.35e-3 + DEEPER
    mass = 1000 * np.pi * 0.05**2 * 0.006
    assert seen.rose < mass * 9.81 * seen.most  # what the landing sank is lifted


def test_what_a_landing_left_deep_is_lifted_and_does_not_hop() -> None:
    """A box that falls by a metre at 4 ms meets the floor up to 18 mm deep."""
    box = '<body pos="0 0 1.0308"><freejoint/><geom name="box" type="box" size=".04 .03 .025"/></body>'
    seen = depths(with_laws(box, {("box", "floor"): 0.0}, 'timestep="0.004"'), 4.0)
    assert seen.most > 3e-3
    assert seen.last < 0.5e-3
    assert seen.rose < 0.02 * seen.energy  # 18 mm of a metre


def test_a_body_that_starts_inside_the_floor_is_lifted_slowly() -> None:
    """Native contact throws it out."""
    box = (
        '<body pos="0 0 .021"><freejoint/><geom name="box" type="box" size=".04 .03 .025"/></body>'
    )
    text = with_laws(box, {("box", "floor"): 0.9}, 'timestep="0.002"')
    contact.load()
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    fastest = 0.0
    for _ in range(1000):
        mujoco.mj_step(model, data)
        fastest = max(fastest, float(data.qvel[2]))
    assert fastest < 0.6 * 1.1 * 9.81 * 0.002
    assert -float(data.contact.dist.min()) == pytest.approx(0.35e-3, abs=0.05e-3)


HAND = """
<body name="guide" mocap="true" pos="-.12 0 .07"/>
<body name="hand" pos="-.12 0 .07"><freejoint/>
  <geom name="hand" type="box" size=".03 .06 .04" mass=".8"/></body>
<body pos="0 0 .06"><freejoint/><geom name="box" type="box" size=".06 .05 .06" mass=".7"/></body>
"""


def welded_hand(options: str, seconds: float) -> Depths:
    """A hand that a weld draws after a mocap body pushes a box at 0.25 m/s."""
    pairs = {("hand", "box"): 0.0, ("box", "floor"): 0.0}
    text = with_laws(HAND, pairs, options).replace(
        "</mujoco>", '<equality><weld body1="guide" body2="hand"/></equality></mujoco>'
    )

    def push(model: Any, data: Any) -> None:
        data.mocap_pos[0, 0] = -0.12 + 0.25 * (data.time + model.opt.timestep)

    return depths(text, seconds, control=push)


def test_a_hand_on_a_weld_pushes_a_box_without_going_into_it() -> None:
    """A solution of the contacts that the weld's own forces would gain energy by was given up for
    none at all, and the box sank into the hand by 12 mm a second.
    """
    assert welded_hand('timestep="0.002"', 3.0).most < 0.6e-3


def test_under_rk4_a_hand_on_a_weld_goes_into_the_box_as_the_page_says_and_is_named() -> None:
    """A fault that is known."""
    seen = welded_hand('timestep="0.001" integrator="RK4"', 2.0)
    assert seen.last == pytest.approx(1.4e-3 * 2.0, rel=0.5)
    assert any("1 mm deeper than its speed" in one for one in seen.warned)


def dropped(seed: int) -> tuple[str, str, tuple[float, ...]]:
    """A body of a random pose, with its law and without, and its velocity."""
    draw = np.random.default_rng([4711, seed])
    names = list(SHAPES)
    step, shape = STEPS[seed // len(names) % len(STEPS)], names[seed % len(names)]
    turn, height = draw.uniform(-90.0, 90.0, 3), draw.uniform(0.12, 0.4)
    options = (
        f'timestep="{step}" cone="{draw.choice(["elliptic", "pyramidal"])}" '
        f'integrator="{draw.choice(["Euler", "implicit", "implicitfast", "RK4"])}"'
    )
    world = (
        f'<body pos="0 0 {height}" euler="{turn[0]} {turn[1]} {turn[2]}"><freejoint/>'
        f'<geom name="{shape}" {SHAPES[shape]} condim="{draw.choice([3, 4, 6])}" '
        f'friction="{draw.choice([0.3, 0.6, 1.0])} .001 .0001"/></body>'
    )
    law = {(shape, "floor"): float(draw.choice([0.0, 0.3, 0.6]))}
    velocity = (*draw.uniform(-0.5, 0.5, 2), 0.0, *draw.uniform(-8.0, 8.0, 3))
    return with_laws(world, law, options), with_laws(world, {}, options), velocity


# 21 seeds apart: each of the eight shapes once, and every step.
@pytest.mark.parametrize("seed", range(160) if LONG else range(0, 160, 21))
def test_a_dropped_body_ends_no_deeper_than_on_native_contact_or_is_named(seed: int) -> None:
    text, native, velocity = dropped(seed)
    seen, of_native = depths(text, 2.5, velocity), depths(native, 2.5, velocity)
    assert seen.last < of_native.last + DEEPER or seen.named


WEDGE = """
<geom name="slope" type="box" size=".3 .3 .01" pos="-.05 0 .03" euler="0 20 0"/>
<geom name="wall" type="box" size=".01 .3 .3" pos=".1 0 .2"/>
<body pos=".03 0 .12"><freejoint/><geom name="ball" size=".03" mass=".2"/></body>
"""


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_a_ball_between_a_slope_and_a_wall_stays_where_it_touches_both(integrator: str) -> None:
    """The wall's rows let go what parted by a rounding, so that the slope pressed it in by 3 mm a
    second.
    """
    pairs = {("ball", "slope"): 0.3, ("ball", "wall"): 0.3}
    text = with_laws(WEDGE, pairs, f'timestep="0.002" integrator="{integrator}"')
    seen = depths(text, 4.0)
    assert seen.last < 0.04e-3
    assert not seen.named


TUBE = """
<geom name="left" type="box" size=".01 .1 .2" pos="-.05 0 .2"/>
<geom name="right" type="box" size=".01 .1 .2" pos=".05 0 .2"/>
<body pos="-.008 0 .05"><freejoint/><geom name="one" size=".03" mass=".1"/></body>
<body pos=".008 0 .12"><freejoint/><geom name="two" size=".03" mass=".1"/></body>
"""


def test_balls_that_press_each_other_against_walls_stay_between_them() -> None:
    """They sank into the walls by 17 mm in 6 s, or were thrown by forces that undid each other."""
    names = ("one", "two")
    pairs = {(ball, other): 0.3 for ball in names for other in ("left", "right", "floor")}
    seen = depths(with_laws(TUBE, {**pairs, names: 0.3}, 'timestep="0.002"'), 4.0)
    assert seen.last < 0.35e-3
    assert seen.rose < 0.01 * seen.energy


PUSHED = """
<body name="hand" mocap="true" pos="-.1 0 .06">
  <geom name="hand" type="box" size=".02 .1 .05"/></body>
<body pos="0 0 .05"><freejoint/><geom name="box" type="box" size=".05 .05 .05" mass="1"/></body>
{more}
"""
PUSHES = {("hand", "box"): 0.3, ("box", "floor"): 0.3}


def pushing(speed: float) -> Control:
    def push(model: Any, data: Any) -> None:
        data.mocap_pos[0, 0] = -0.1 + speed * (data.time + model.opt.timestep)

    return push


@pytest.mark.parametrize("step", [1e-3, 2e-3])
@pytest.mark.parametrize("speed", [0.02, 0.15])
def test_a_mocap_hand_pushes_a_box_without_going_into_it_or_throwing_it(
    speed: float, step: float
) -> None:
    """Hand and floor rub with a coefficient of 1: forces of both that undo each other went up to
    6e6 N, and the hand in by 40 mm.
    """
    text = with_laws(PUSHED.format(more=""), PUSHES, f'timestep="{step}"')
    seen = depths(text, 4.0, control=pushing(speed))
    assert seen.most < 0.5e-3
    assert not seen.named
    assert seen.rose < 0.5 * 1.0 * (1.6 * speed) ** 2 + 1e-4  # the hand sends it on at 1.3 times


def test_a_mocap_hand_that_jams_a_box_against_a_wall_is_named_and_throws_nothing() -> None:
    """Impacts between a body that is moved and one that cannot move have no end."""
    wall = '<geom name="wall" type="box" size=".02 .3 .1" pos=".12 0 .1"/>'
    text = with_laws(PUSHED.format(more=wall), {**PUSHES, ("box", "wall"): 0.3}, "")
    seen = depths(text, 1.0, control=pushing(0.1))
    (said,) = (one for one in seen.warned if "jams" in one)
    assert 'mocap body "hand" jams body 2 at ' in said
    assert seen.rose < 0.05


def test_each_pair_that_starts_inside_is_named_up_to_the_fifth() -> None:
    """A user who mends the first that is named would find the next one, run by run."""
    boxes = "".join(
        f'<body name="b{k}" pos="{k} 0 .02"><freejoint/>'
        f'<geom name="g{k}" type="box" size=".03 .03 .03"/></body>'
        for k in range(7)
    )
    text = with_laws(boxes, {(f"g{k}", "floor"): 0.3 for k in range(7)}, "")
    said = depths(text, 0.02).warned
    for k in range(5):
        assert sum(f'body "b{k}" starts 9.98 mm inside body "world"' in one for one in said) == 1
    assert sum("more than 5 pairs start inside each other" in one for one in said) == 1
    assert len(said) == 6
