"""A fix is tried in forked copies of the loaded world: the bits of one that is loaded again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hcbench.engines.pybullet.model import open as opening
from hcbench.engines.pybullet.model import under_test
from hcbench.engines.pybullet.model.under_test import PybulletModel, open_world
from hcbench.measuring.request import make_request
from hcbench.sim import simulate
from hcbench.sim.model_under_test import Suspect
from hcbench.workers import process

p = pytest.importorskip("pybullet")
DATA = Path(pytest.importorskip("pybullet_data").getDataPath())
pytestmark = pytest.mark.skipif(not process.CAN_FORK, reason="needs a system that forks")


@pytest.fixture
def loads(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Files that were loaded, a list each time."""
    loaded: list[Any] = []
    load = opening.load_files

    def noted(files: Any, packages: Any) -> Any:
        loaded.append(files)
        return load(files, packages)

    monkeypatch.setattr(under_test, "load_files", noted)
    return loaded


@pytest.fixture(params=["cube_small.urdf", "r2d2.urdf"])
def opened(request: pytest.FixtureRequest, loads: list[Any]) -> Iterator[PybulletModel]:
    asked = make_request(None, speeds=[0.2, 1.0], phases=2)
    files = [str(DATA / request.param), str(DATA / "plane.urdf")]
    with open_world(files, asked, None) as model:
        yield model


def bounces(model: PybulletModel) -> list[str]:
    impacts = simulate.impacts_in(model, model.request.launches())
    return [repr((i.status, i.speed_in, i.speed_out, i.samples)) for i in impacts]


def half(bullet: Any) -> None:
    """Restitution 0.5, at half the step."""
    for body in bullet.bodies():
        for link in range(-1, bullet.getNumJoints(body)):
            bullet.changeDynamics(body, link, restitution=0.5**0.5)
    bullet.setPhysicsEngineParameter(fixedTimeStep=1 / 480)


FIX = Suspect("half", "e is not 0.5.", "", "", half)


def test_a_fix_in_forks_bounces_as_in_a_world_loaded_again(
    opened: PybulletModel, loads: list[Any]
) -> None:
    before = bounces(opened)
    with opened.fixed([FIX]) as fixed:
        tried, timestep, facts = bounces(fixed), fixed.timestep, fixed.facts()
    assert timestep == pytest.approx(1 / 480)
    assert len(loads) == 1
    assert bounces(opened) == before != tried
    with opened._made_again([FIX]) as again:
        assert bounces(again) == tried
        assert again.facts() == facts
    assert opened.timestep == pytest.approx(1 / 240)


@pytest.mark.parametrize("forks", [True, False])
def test_a_fix_of_a_fixed_model_keeps_the_first(
    opened: PybulletModel, monkeypatch: pytest.MonkeyPatch, forks: bool
) -> None:
    """A world made again had the second alone."""
    monkeypatch.setattr(under_test, "can_fork", lambda _: forks)
    nothing = Suspect("nothing", "Changes nothing.", "", "", lambda _: None)
    with opened.fixed([FIX]) as first, first.fixed([nothing]) as second:
        assert second.timestep == pytest.approx(1 / 480)
