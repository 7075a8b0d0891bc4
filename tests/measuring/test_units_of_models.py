"""Models in centimetres, millimetres or grams are recognised by what their bodies weigh."""

from __future__ import annotations

from pathlib import Path

import pytest

from hcbench.measuring import measure
from hcbench.sim.model_under_test import unit_notes
from hcbench.system.errors import QuantityError

BALL = """<mujoco><option timestep="1e-3" gravity="0 0 {gravity}"/><worldbody>
  <geom name="plate" type="plane" size="1 1 .1"/>
  <body name="ball" pos="0 0 {height}"><freejoint/><geom name="geom" size="{radius}" mass="{mass}"/></body>
  </worldbody></mujoco>"""
# A steel ball of 1 pound, in metres and kilograms.
RADIUS, MASS = 0.0238, 0.45


def notes(length: float, mass: float, gravity: float = -9.81) -> list[str]:
    """The notes on units of the ball, with so many units of length in a metre, of mass in a kg."""
    text = BALL.format(
        gravity=gravity, height=2 * length * RADIUS, radius=length * RADIUS, mass=mass * MASS
    )
    found = measure(text, "ball,plate", speeds=[0.5], phases=1, diagnose=False, rest=False)
    return [note for note in found.facts.notes if "kg/m^3" in note]


@pytest.mark.parametrize(
    ("length", "mass", "words"),
    [
        (100, 1, "in centimetres"),
        (1000, 1, "in millimetres?"),
        (1, 1000, "in grams"),
        (1000, 1000, "and grams"),
    ],
)
def test_a_ball_in_other_units_is_told(length: float, mass: float, words: str) -> None:
    pytest.importorskip("mujoco")
    (note,) = notes(length, mass)
    assert words in note


def test_a_ball_in_metres_and_kilograms_is_not() -> None:
    pytest.importorskip("mujoco")
    assert notes(1, 1) == []


@pytest.mark.parametrize(("per_metre", "unit"), [(100, "centimetres"), (1000, "millimetres")])
def test_the_earths_gravity_in_another_unit_is_refused(per_metre: float, unit: str) -> None:
    pytest.importorskip("mujoco")
    with pytest.raises(QuantityError, match=unit):
        notes(per_metre, 1, gravity=-9.81 * per_metre)


def test_a_urdf_in_millimetres_is_told(tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    link = (
        '<robot name="{name}"><link name="base"><inertial><mass value="{mass}"/><inertia ixx="1" ixy="0"'
        ' ixz="0" iyy="1" iyz="0" izz="1"/></inertial><collision><geometry><sphere radius="{radius}"/>'
        "</geometry></collision></link></robot>"
    )
    (tmp_path / "ball.urdf").write_text(link.format(name="ball", mass=0.45, radius=23.8))
    (tmp_path / "plate.urdf").write_text(link.format(name="plate", mass=0, radius=100))
    files = [tmp_path / "ball.urdf", tmp_path / "plate.urdf"]
    found = measure(files, speeds=[0.5], phases=1, diagnose=False, rest=False)
    assert any("millimetres" in note for note in found.facts.notes)


def test_things_that_people_use_are_plausible() -> None:
    """Foam, a balloon, a robot, an osmium ball."""
    for density in (20.0, 1.3, 300.0, 2.3e4):
        assert unit_notes("it", density, 1.0, 1.0) == []
    assert unit_notes("it", 0.0, 1.0, 1.0) == unit_notes("it", 1.0, 0.0, 0.0) == []
