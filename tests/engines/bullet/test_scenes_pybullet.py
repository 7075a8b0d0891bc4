"""The URDFs of the shipped scenes as PyBullet itself loads them: the geometry is the paper's."""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import pytest

from hcbench.workers import call

if TYPE_CHECKING:
    from collections.abc import Sequence

SCENES = Path(__file__).parents[3] / "scenes"
MASS, R1, R2 = 0.45359237, 0.0254, 0.0508


def _depths(form: str, places: Sequence[tuple[float, float, float]]) -> list[float]:
    """Penetration that PyBullet itself sees, m, of a ball at each place."""
    import pybullet as bullet

    client = bullet.connect(bullet.DIRECT)
    ball = bullet.loadURDF(str(SCENES / f"steel-{form}" / "ball.urdf"), physicsClientId=client)
    plate = bullet.loadURDF(str(SCENES / f"steel-{form}" / "plate.urdf"), physicsClientId=client)
    depths = []
    for place in places:
        bullet.resetBasePositionAndOrientation(ball, place, [0, 0, 0, 1], physicsClientId=client)
        (point,) = bullet.getClosestPoints(ball, plate, 0.0, physicsClientId=client)
        depths.append(-point[8])
    bullet.disconnect(client)
    return depths


def test_the_plane_sees_the_penetration_of_the_equivalent_sphere() -> None:
    overlaps = np.geomspace(1e-9, 2.5e-5, 20)
    places = [(0.003, -0.01, R2 - overlap) for overlap in overlaps]
    np.testing.assert_allclose(call(_depths, "plane", places, limit=60), overlaps, atol=1e-16)


def test_the_cup_sees_its_penetration_on_the_axis_and_off_it() -> None:
    rng = np.random.default_rng(1975)
    overlaps = rng.uniform(1e-6, 2.5e-5, 300)
    offsets = np.where(np.arange(300) < 20, 0.0, rng.uniform(0.0, 9e-3, 300))  # of the centre, m
    turns = rng.uniform(0.0, 2 * math.pi, 300)
    heights = R2 - np.sqrt((R2 - R1 + overlaps) ** 2 - offsets**2)
    places = np.column_stack([offsets * np.cos(turns), offsets * np.sin(turns), heights])
    seen = call(_depths, "cup", [tuple(place) for place in places.tolist()], limit=60)
    np.testing.assert_allclose(seen, overlaps, rtol=0, atol=1e-8)


def test_the_shipped_cup_is_what_its_generator_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # a folder in scenes/ is a scene
    spec = importlib.util.spec_from_file_location("make_cup", SCENES / "make_cup.py")
    assert spec is not None and spec.loader is not None
    make_cup = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_cup)
    make_cup.main(tmp_path)
    for name in ("cup.cdf", "cup.obj"):
        assert (tmp_path / name).read_bytes() == (SCENES / "steel-cup" / name).read_bytes()


@pytest.mark.parametrize("form", ["plane", "cup"])
def test_the_body_is_one_pound_of_a_one_inch_sphere(form: str) -> None:
    inertial = (
        ElementTree.parse(SCENES / f"steel-{form}" / "ball.urdf").getroot().find("link/inertial")
    )
    assert inertial is not None
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    assert mass is not None and float(mass.get("value", "nan")) == MASS
    assert inertia is not None
    for axis in ("ixx", "iyy", "izz"):
        assert float(inertia.get(axis, "nan")) == pytest.approx(0.4 * MASS * R1**2, rel=1e-12)
