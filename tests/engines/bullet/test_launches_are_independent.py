"""A launch in PyBullet knows nothing of those before it, and leaves the user's world as it was."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from long_searches import long_study

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.engines.pybullet.model import in_child as forked
from hcbench.engines.pybullet.model import under_test
from hcbench.engines.pybullet.model.open import _load
from hcbench.measuring import Measurement, Wanted, measure
from hcbench.measuring.request import make_request
from hcbench.sim.simulate import impacts_in
from hcbench.terms.impact import Launch
from hcbench.workers import process

p = pytest.importorskip("pybullet")
DATA = Path(pytest.importorskip("pybullet_data").getDataPath())


def simulated(files: tuple[str, str], speeds: list[float], gravity: float) -> Measurement:
    paths = [str(DATA / name) for name in files]
    return measure(paths, speeds=speeds, phases=1, gravity=gravity, diagnose=False, rest=False)


@pytest.mark.parametrize(
    ("files", "gravity"),
    [
        (("jenga/jenga.urdf", "jenga/jenga.urdf"), 0.0),
        (("cube_small.urdf", "cube_small.urdf"), 0.0),
        (("duck_vhacd.urdf", "plane.urdf"), 9.81),
        (("random_urdfs/007/007.urdf", "block.urdf"), 9.81),
        (("r2d2.urdf", "plane.urdf"), 9.81),
    ],
)
def test_a_launch_has_the_bits_of_one_in_a_fresh_world(
    files: tuple[str, str], gravity: float
) -> None:
    speeds = [0.1, 0.100001, 0.5]
    together = simulated(files, speeds, gravity).impacts
    alone = [simulated(files, [speed], gravity).impacts[0] for speed in speeds]
    assert [i.speed_out for i in together] == [i.speed_out for i in alone]
    assert all(i.is_measured for i in together)


@pytest.mark.parametrize("angle", ["0 deg", "30 deg"])
def test_one_copy_of_a_world_of_two_bodies_has_all_launches_with_the_bits_of_a_copy_for_each(
    angle: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    copies: list[object] = []

    class Counted(forked.CopyOfWorld):  # type: ignore[misc]
        def __init__(self, *args: Any) -> None:
            copies.append(self)
            super().__init__(*args)

    monkeypatch.setattr(under_test, "CopyOfWorld", Counted)
    paths = [str(DATA / "cube_small.urdf"), str(DATA / "plane.urdf")]
    request = make_request(None, gravity=9.81, angle=angle, speeds=[0.5, 1.3])

    def impacts() -> tuple[int, str]:
        copies.clear()
        with under_test.open_world(paths, request, None) as world:
            found = impacts_in(world, request.launches())
            with world.fixed(world.suspects(found, Wanted(restitution=0.8))) as fixed:
                found += impacts_in(fixed, request.launches())
        return len(copies), repr(found)

    shared = impacts()
    monkeypatch.setattr(under_test, "keeps_nothing", lambda _: False)
    each = impacts()
    assert (shared[0], each[0]) == (2, 0)
    assert shared[1] == each[1]


def test_a_launch_that_flies_off_leaves_nothing_to_the_next() -> None:
    paths = [str(DATA / "cube_small.urdf"), str(DATA / "plane.urdf")]

    def last_of(*speeds: float) -> str:
        request = make_request(None, gravity=9.81)
        with under_test.open_world(paths, request, None) as world:
            launches = [Launch(speed) for speed in speeds]
            for launch in launches[:-1]:
                with closing(world.release([launch])) as simulation:
                    simulation.advance(3)
            return repr(impacts_in(world, launches[-1:]))

    assert last_of(1e300, 0.5) == last_of(0.5)


@pytest.mark.parametrize(
    ("files", "substeps", "kept"),
    [
        (("cube_small.urdf", "plane.urdf"), 1, True),
        (("cube_small.urdf", "plane.urdf"), 2, False),
        (("cube_small.urdf", "cube_small.urdf", "plane.urdf"), 1, False),
        (("pendulum5.urdf", "plane.urdf"), 1, False),
    ],
)
def test_only_two_bodies_without_joints_and_substeps_are_put_back_whole(
    files: tuple[str, ...], substeps: int, kept: bool
) -> None:
    bullet = BulletClient.direct()
    try:
        for name in files:
            bullet.loadURDF(str(DATA / name))
        bullet.setPhysicsEngineParameter(numSubSteps=substeps)
        assert forked.keeps_nothing(bullet) is kept
    finally:
        bullet.disconnect()


def test_a_robot_moves_by_the_same_bits_without_what_a_camera_sees() -> None:
    def moved(load: Callable[[], Any]) -> list[Any]:
        bullet.resetSimulation()
        bullet.setGravity(0, 0, -9.81)
        bullet.loadURDF(str(DATA / "plane.urdf"))
        robot = load()
        states = []
        for _ in range(100):
            bullet.stepSimulation()
            states += [bullet.getBasePositionAndOrientation(robot), bullet.getBaseVelocity(robot)]
            states += [bullet.getJointState(robot, joint) for joint in range(15)]
        return states

    path = DATA / "r2d2.urdf"
    bullet = BulletClient.direct()
    try:
        whole = moved(lambda: bullet.loadURDF(str(path)))
        assert whole == moved(lambda: _load(bullet, path, ())[0])
    finally:
        bullet.disconnect()


@pytest.mark.parametrize("can_fork", [True, False])
def test_a_live_world_is_left_as_it_was_and_every_launch_in_it_is_the_first(
    can_fork: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "CAN_FORK", can_fork and process.CAN_FORK)
    client = p.connect(p.DIRECT)
    try:
        p.loadURDF(str(DATA / "plane.urdf"), physicsClientId=client)
        box = p.loadURDF(str(DATA / "cube_small.urdf"), [0, 0, 0.4], physicsClientId=client)
        found = measure(
            client,
            ("body:1", "body:0"),
            speeds=[0.1, 0.100001],
            phases=1,
            diagnose=False,
            rest=False,
        )
        assert p.getBasePositionAndOrientation(box, physicsClientId=client)[0] == (0, 0, 0.4)
        assert p.getContactPoints(physicsClientId=client) == ()
    finally:
        p.disconnect(client)
    first, second = found.impacts
    assert second.restitution == pytest.approx(first.restitution, abs=1e-6)


def test_a_crash_in_a_copy_of_the_process_is_reported() -> None:
    import os

    from hcbench.system.errors import EngineFailed

    if not process.CAN_FORK:
        pytest.skip("this system does not fork")
    with pytest.raises(EngineFailed, match="SIGABRT"):
        forked.run_forked(os.abort)


@long_study
def test_the_scatter_over_phases_is_found_where_four_phases_miss_it() -> None:
    files = [str(DATA / "sphere_small.urdf"), str(DATA / "kuka_iiwa/model.urdf")]
    found = measure(files, speeds=[0.5, 2.0], diagnose=False, rest=False).curve
    dense = measure(files, speeds=[0.5, 2.0], phases=51, diagnose=False, rest=False).curve
    few = measure(files, speeds=[0.5, 2.0], phases=4, diagnose=False, rest=False).curve
    for point, truth in zip(found, dense, strict=True):
        assert point.highest == pytest.approx(truth.highest, abs=2e-3)
        assert point.restitution == pytest.approx(truth.restitution, abs=5e-3)
    assert max(b.highest - a.highest for a, b in zip(few, dense, strict=True)) > 5e-3


def test_two_bodies_of_one_file_have_fixes_of_their_own() -> None:
    found = measure([str(DATA / "cube_small.urdf")] * 2, speeds=[0.5], phases=1)
    fix = next(c.fix for c in found.causes if c.code == "no-restitution")
    assert "changeDynamics(cube_small, -1" in fix
    assert "changeDynamics(cube_small_2, -1" in fix
    assert "e = 0.9 is assumed" in found.remedy
    assert found.law is None  # an e near 0 at one speed is no α
