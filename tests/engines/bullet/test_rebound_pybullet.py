"""A robot of PyBullet tuned by its rebound: what is printed holds in a loop of plain PyBullet, at
phases that no search saw.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from bullet_hopper import FLOOR, ROBOT, run_in_client
from long_searches import long_search

import hcbench as hb
from hcbench.cli import run
from hcbench.engines.pybullet.model.drop_test import FIRST_S, LASTING, WorldDropBench
from hcbench.engines.pybullet.model.foot_springs import LinkSearch, _all_feet
from hcbench.engines.pybullet.model.open import load_files
from hcbench.engines.pybullet.model.under_test import unwritten
from hcbench.measuring.request import make_request
from hcbench.sim.landing import DROPS, HEIGHTS, MANY_REBOUNDS, PHASES, REBOUNDS, DropTest
from hcbench.sim.rebound_search import worse_of
from hcbench.system.errors import UserError
from hcbench.workers import process

p = pytest.importorskip("pybullet")
BulletClient = pytest.importorskip("pybullet_utils.bullet_client").BulletClient
pytestmark = pytest.mark.skipif(not process.CAN_FORK, reason="needs a system that forks")

G = 9.81
H = 1.0 / 240.0
TARGET = 4e-3
UNSEEN = (0.04, 0.13, 0.29, 0.39, 0.46, 0.54, 0.61, 0.71, 0.79, 0.88)


@pytest.fixture(scope="module")
def files() -> Iterator[tuple[str, str]]:
    """A robot of a trunk on a foot, and a floor whose top is half a metre up."""
    with TemporaryDirectory() as folder:
        names = (Path(folder) / "hopper.urdf", Path(folder) / "floor.urdf")
        names[0].write_text(ROBOT)
        names[1].write_text(FLOOR)
        yield str(names[0]), str(names[1])


@cache
def tuned(files: tuple[str, str], **target: Any) -> hb.TunedModel:
    return hb.tune_model(list(files), gravity=G, **target)


def landings(found: hb.TunedModel) -> tuple[DropTest, DropTest]:
    assert found.landing is not None
    return found.landing.before, found.landing.after


def dropped(files: tuple[str, str], lines: str, phase: float, seconds: float) -> dict[str, float]:
    """A drop from 10 cm with some lines in the script: rebound, m, and the speed at the end, m/s, of
    the centre of mass by its momentum; largest force over weight and penetration, m, by contacts.
    """
    world = BulletClient(p.DIRECT)
    height = max(HEIGHTS) + phase * H * (2.0 * G * max(HEIGHTS)) ** 0.5
    robot = world.loadURDF(files[0], [0, 0, 0.5 + 0.22 + height])
    floor = world.loadURDF(files[1])
    world.setGravity(0, 0, -G)
    world.setJointMotorControl2(robot, 0, p.POSITION_CONTROL, targetPosition=0, force=400)
    run_in_client(lines, world, hopper=robot, floor=floor)
    touched, flying, rising, fastest, peak, depth = False, 0, 0.0, 0.0, 0.0, 0.0
    for _ in range(round(seconds / H)):
        before = _speed(world, robot)
        world.stepSimulation()
        points = [one for one in world.getContactPoints(robot, floor) if one[9] > 0.0]
        peak = max(peak, sum(one[9] for one in points) / (2.5 * G))
        depth = max([depth, *(-one[8] for one in points)])
        flying = 0 if points else flying + 1
        rising = before if flying == 1 else rising
        touched |= bool(points)
        if touched and flying * H >= 0.005:
            fastest = max(fastest, rising)
    end = abs(_speed(world, robot))
    return {"rebound": fastest**2 / (2 * G), "peak": peak, "depth": depth, "end": end}


def _speed(world: Any, robot: int) -> float:
    foot = world.getLinkState(robot, 0, computeLinkVelocity=1, computeForwardKinematics=1)[6]
    return float((2.0 * world.getBaseVelocity(robot)[0][2] + 0.5 * foot[2]) / 2.5)


def test_the_centre_of_mass_rebounds_by_the_target_in_a_plain_loop(files: tuple[str, str]) -> None:
    found = tuned(files, rebound=TARGET)
    assert found.gains
    _, after = landings(found)
    drops = [dropped(files, found.text, drop.phase, 0.6) for drop in MANY_REBOUNDS]
    seen = [drop["rebound"] for drop in drops]
    assert np.mean(seen) == pytest.approx(TARGET, rel=0.1)
    assert np.mean(seen) == pytest.approx(after.rebound, rel=0.03)
    assert max(abs(one - np.mean(seen)) for one in seen) == pytest.approx(after.spread, rel=0.1)
    drops = [dropped(files, found.text, phase, 0.6) for phase in PHASES]
    assert max(drop["peak"] for drop in drops) <= 1.001 * after.peak
    assert max(drop["depth"] for drop in drops) <= 1.001 * after.depth


@pytest.mark.parametrize("target", [TARGET, 0.05])
def test_the_printed_spread_holds_at_phases_that_no_search_saw(
    files: tuple[str, str], target: float
) -> None:
    """The rebound jumps at one place in a step, which four phases hardly ever bracket."""
    found = tuned(files, rebound=target)
    _, after = landings(found)
    assert after.phases == len(MANY_REBOUNDS)
    unseen = [dropped(files, found.text, phase, 0.6)["rebound"] for phase in UNSEEN]
    outside = [one for one in unseen if abs(one - after.rebound) > 1.02 * after.spread]
    assert len(outside) <= 1


def test_the_lines_let_the_robot_rest(files: tuple[str, str]) -> None:
    assert dropped(files, tuned(files, rebound=TARGET).text, UNSEEN[0], 2.0)["end"] < 1e-3


def test_the_model_as_it_is_is_judged_by_the_same_drops(files: tuple[str, str]) -> None:
    before, after = landings(tuned(files, rebound=TARGET))
    many = [dropped(files, "", drop.phase, 0.6)["rebound"] for drop in MANY_REBOUNDS]
    assert before.rebound == pytest.approx(np.mean(many), abs=1e-6)
    drops = [dropped(files, "", phase, 0.6) for phase in PHASES]
    assert max(drop["peak"] for drop in drops) <= 1.001 * before.peak
    assert 0.5 * before.peak < max(drop["peak"] for drop in drops)
    assert not list(after.worse_than(before, TARGET))
    # Few drops last long enough to show a rest.
    assert (before.settled, after.settled) == (3, 3)


def test_links_that_land_and_are_of_no_pair_are_named() -> None:
    requests = [make_request("a_toe,plane.urdf", gravity=G)]
    search = cast(LinkSearch, SimpleNamespace(others=["b_toe", "c_toe"]))
    (said,) = _all_feet(search, requests)
    assert said.startswith("Other links land on the floor, too: b_toe, c_toe. Name them all: ")
    every = "--pair a_toe,plane.urdf --pair b_toe,plane.urdf --pair c_toe,plane.urdf."
    assert said.endswith(every)
    assert _all_feet(cast(LinkSearch, SimpleNamespace(others=[])), requests) == ()


def test_the_calls_that_no_line_makes_are_named() -> None:
    request = make_request(None, gravity=1.62, timestep="1/500 s")
    (said,) = unwritten(request)
    assert "setTimeStep(0.002) and setGravity(0, 0, -1.62)" in said
    assert unwritten(make_request(None)) == ()


def test_what_stops_already_is_left(
    files: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["tune", *files, "--gravity", "9.81", "--restitution", "0"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "has this rebound already: there is nothing to paste" in out
    assert "those of 3 of them, which last 10 s" in out


@long_search
def test_a_rebound_out_of_reach_is_refused_with_the_largest_one(files: tuple[str, str]) -> None:
    found = tuned(files, rebound=0.05)
    assert not found.gains
    assert found.landing is not None
    assert found.landing.reach is not None
    assert 2e-3 < found.landing.reach.rebound < 0.05
    assert "largest rebound up to 50 mm without a worse landing" in found.no_gain


@long_search
def test_no_random_spring_beats_the_largest_rebound_that_is_named(files: tuple[str, str]) -> None:
    """Random springs up to ten times 1/h: of those that land no worse none throws a tenth higher."""
    found = tuned(files, rebound=0.05)
    before, _ = landings(found)
    assert found.landing is not None
    assert found.landing.reach is not None
    requests = [make_request(None, gravity=G)]
    search = LinkSearch(WorldDropBench(load_files(list(files)), requests), before, 0.05)
    random = np.random.default_rng(42)
    for _ in range(40):
        frequency, damping = np.exp(random.uniform(np.log([20.0, 0.03]), np.log([10.0 / H, 3.7])))
        spring = search.spring(float(frequency), float(damping))
        if search.drop(spring, 0.5, REBOUNDS).rebound > 1.1 * found.landing.reach.rebound:
            assert list(search.drop(spring, before.seconds, DROPS).worse_than(before, 0.05))


@pytest.mark.parametrize(
    ("frequency", "damping"),
    [(60.0, 0.1), (150.0, 0.05), (150.0, 1.0), (2.0 / H, 0.05), (9.0 / H, 2)],
)
def test_drops_that_end_early_judge_as_whole_ones(
    files: tuple[str, str], frequency: float, damping: float
) -> None:
    """A drop ends once a force, a depth or the time to rest is beyond its limit."""
    bench = WorldDropBench(load_files(list(files)), [make_request(None, gravity=G)])
    drops = (LASTING[0], *REBOUNDS[1:3])
    before = bench.test(FIRST_S, drops)
    search = LinkSearch(bench, before, TARGET)
    spring = search.spring(frequency, damping)
    whole = search.drop(spring, FIRST_S, drops)
    is_whole = not list(whole.worse_than(before, TARGET))
    assert search.dropped(spring).is_no_worse(before, TARGET, FIRST_S, drops) is is_whole


def test_faster_springs_are_tried_after_those_of_the_grid(files: tuple[str, str]) -> None:
    bench = WorldDropBench(load_files(list(files)), [make_request(None, gravity=G)])
    search = LinkSearch(bench, bench.test(0.7, REBOUNDS), TARGET)
    frequencies = search._frequencies(7)
    assert frequencies[3] * H == pytest.approx(1.5)
    assert frequencies[-1] * H == pytest.approx(10.0)
    assert frequencies == sorted(frequencies)
    assert max(one.damping for one in search._row(frequencies[3])) == pytest.approx(1.4)
    assert max(one.damping for one in search._row(frequencies[4])) == pytest.approx(3.7)


def test_a_first_drop_may_be_as_bad_as_that_of_the_model(files: tuple[str, str]) -> None:
    """A shorter drop than the whole test, in which the robot has crept to its rest."""
    before, after = landings(tuned(files, rebound=TARGET))
    short = replace(before, creep=1.0, rest=math.nan)
    allowed = worse_of(before, short)
    assert (allowed.creep, allowed.rest) == (short.creep, before.rest)
    assert allowed.robot is before.robot
    crept = replace(after, creep=short.creep)
    assert any("creep" in phrase for phrase in crept.worse_than(before, TARGET))
    assert not list(crept.worse_than(allowed, TARGET))


@long_search
def test_a_restitution_with_which_the_robot_lands_worse_is_not_handed_out(
    files: tuple[str, str],
) -> None:
    found = tuned(files, restitution=0.8)
    assert found.landing is not None
    assert found.gains is (not found.landing.worse)


def test_what_is_no_robot_has_no_rebound(files: tuple[str, str], tmp_path: Path) -> None:
    block = tmp_path / "block.urdf"
    block.write_text(FLOOR.replace('mass value="0"', 'mass value="1"').replace("9 9 1", ".1 .1 .1"))
    with pytest.raises(UserError, match="no joint of"):
        hb.tune_model([str(block), files[1]], rebound="5 mm", gravity=G, engine="pybullet")
    with pytest.raises(UserError, match="gravity"):
        hb.tune_model(list(files), rebound="5 mm")
