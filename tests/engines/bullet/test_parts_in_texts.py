"""Texts for PyBullet name bodies and links as a script can: they run as they are printed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from bullet_hopper import FLOOR, ROBOT

import hcbench as hb
from hcbench.engines.pybullet.model.open import LiveWorld, open_live
from hcbench.engines.pybullet.scene.options import part_in_script
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

p = pytest.importorskip("pybullet")

WORLD = """from hcbench.engines.pybullet.model.open import LiveWorld


def build():
    import pybullet

    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setTimeStep(1e-3)
    hopper = pybullet.loadURDF({robot!r}, [0, 0, 1])
    floor = pybullet.loadURDF({floor!r})
{text}
    return LiveWorld(client, (hopper, 0), (floor, -1))
"""


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("ball", ("ball", -1)),
        ("plane.urdf", ("plane", -1)),
        ("robots/laikago-toes.urdf:11", ("laikago_toes", 11)),
        ("body:1", ("1", -1)),
        ("0", ("0", -1)),
        ("3rd.urdf", ("body_3rd", -1)),
        ("class", ("body_class", -1)),
    ],
)
def test_a_part_is_a_variable_and_a_link(name: str, part: tuple[str, int]) -> None:
    assert part_in_script(name) == part


@pytest.fixture
def files(tmp_path: Path) -> tuple[str, str]:
    names = (tmp_path / "hopper.urdf", tmp_path / "floor.urdf")
    names[0].write_text(ROBOT)
    names[1].write_text(FLOOR)
    return str(names[0]), str(names[1])


def test_the_plugins_text_for_a_foot_runs_as_it_is_printed(
    files: tuple[str, str], tmp_path: Path
) -> None:
    launch: Any = {"speeds": "0.2, 0.5 m/s", "rest": False, "diagnose": False, "actuators": False}
    as_it_is = hb.measure(files, "foot,floor.urdf", **launch)
    assert as_it_is.facts.in_text == ("hopper:0", "floor")
    band: Any = {"timestep": "1 ms", "speeds": "0.2:0.5 m/s", "kind": "exact"}
    text = hb.tune("pybullet", as_it_is.facts.in_text, alpha=0.3, **band).text
    lines = "\n".join(f"    {line}" for line in text.splitlines())
    script = tmp_path / "world.py"
    script.write_text(WORLD.format(robot=files[0], floor=files[1], text=lines))
    found = hb.measure(f"{script}:build", **launch)
    assert found.facts.promise is not None
    assert found.facts.promise.is_kept(found.impacts)


def test_a_file_that_cannot_be_written_is_refused_before_the_model_is_read(
    files: tuple[str, str], tmp_path: Path
) -> None:
    absent = str(tmp_path / "absent.urdf")
    with pytest.raises(UserError, match=r"write_model.*lines of a script"):
        hb.tune_model([absent, files[1]], restitution=0.5, write_model=tmp_path / "x.urdf")
    with pytest.raises(UserError, match=r"write_include.*lines of a script"):
        hb.tune_model([absent, files[1]], rebound="5 mm", write_include=tmp_path / "x.xml")


class Client:
    """An object as BulletClient of pybullet_utils is one: its client's number is a field."""

    def __init__(self, number: object) -> None:
        self._client = number


@pytest.mark.parametrize(
    ("source", "says"),
    [
        (Client("0"), "a client '0' of a Client"),
        (Client(None), "a client None of a Client"),
        (LiveWorld("0"), "a client '0' of a LiveWorld"),  # type: ignore[arg-type]
        (Client(77), "PyBullet client 77 is not connected"),
        (LiveWorld(0, first=1), "first 1, second None; expected both, or neither"),
        (LiveWorld(0, second=(1, 2)), r"first None, second \(1, 2\); expected both"),
        (1.5, "a float; expected a path or a PyBullet World"),
    ],
)
def test_what_is_no_live_world_is_refused(source: object, says: str) -> None:
    with pytest.raises(UserError, match=says):
        open_live(source, disconnect=False)
