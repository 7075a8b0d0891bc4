"""A launch in PyBullet knows nothing of those before it, and leaves the user's world as it was."""

from __future__ import annotations

from pathlib import Path

import pytest

from hcbench.engines.pybullet.model import in_child as forked
from hcbench.measuring import Measurement, measure
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
