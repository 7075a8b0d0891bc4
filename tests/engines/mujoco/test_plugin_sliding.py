"""Bodies that slide, spin and roll under MuJoCo's restitution plug-in neither sink nor jump: MuJoCo's
friction cones part a contact by friction times slip, which the plug-in takes back.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import mujoco
import numpy as np
import pytest
from contact_scenes import BOX, RADIUS, Scene, add_body, add_equality, world
from covering import every_pair

from hcbench.contact.mujoco import ConstantRestitution

SOLVERS = ("Newton", "CG", "PGS")
CONES = ("pyramidal", "elliptic")
INTEGRATORS = ("Euler", "RK4")
STOPS, H = ConstantRestitution(0.0), 2e-3


def _heights(scene: Scene, seconds: float) -> tuple[Any, Any]:
    """Heights of the first body, m, step by step, and the data at the end."""
    model = scene.model()
    data = scene.data(model)
    heights = []
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        heights.append(data.qpos[2])
    return np.array(heights), data


@pytest.mark.parametrize(("solver", "cone", "angle"), every_pair(SOLVERS, CONES, [0, 22, 45]))
def test_a_box_that_slides_keeps_its_height(solver: str, cone: str, angle: int) -> None:
    """Over 40 cm and more, along an edge of the pyramid and between two. The pyramid's friction is not along
    the slip, where there is a difference.
    """
    spec = world(H, cone=cone, solver=solver)
    add_body(spec, "box", (0, 0, RADIUS), BOX, (2 * RADIUS, 2 * RADIUS, RADIUS))
    turned = np.radians(angle)
    scene = Scene(spec, STOPS, [("box", [2 * np.cos(turned), 2 * np.sin(turned)])])
    heights, data = _heights(scene, 0.8)
    assert heights.max() < RADIUS + 1e-5
    assert heights.min() > RADIUS - 0.3e-3
    assert np.abs(data.qvel).max() < 1e-4


@pytest.mark.parametrize(
    ("solver", "cone", "condim", "integrator"), every_pair(SOLVERS, CONES, [4, 6], INTEGRATORS)
)
def test_a_ball_that_spins_on_the_spot_does_not_jump(
    solver: str, cone: str, condim: int, integrator: str
) -> None:
    """At e = 0, without gravity: friction against turning would part it at 5 mm of spin times rate."""
    spec = world(H, gravity=0.0, cone=cone, solver=solver, integrator=integrator)
    add_body(spec, "ball", (0, 0, RADIUS + 0.01), condim=condim)
    spec.body("ball").geoms[0].friction = [0.5, 0.005, 1e-4]
    scene = Scene(spec, STOPS, [("ball", [0, 0, -3, 0, 0, 20])])
    _, data = _heights(scene, 0.02)
    assert abs(data.qvel[2]) < 1e-9


@pytest.mark.parametrize(
    ("solver", "cone"), [pair for pair in product(SOLVERS, CONES) if pair != ("PGS", "elliptic")]
)
def test_friction_against_turning_slows_a_ball_by_its_weight(solver: str, cone: str) -> None:
    """By mu m g / (2/5 m r^2): 49 rad/s^2. PGS with elliptic cones gives a ball that turns no friction."""
    spec = world(H, cone=cone, solver=solver)
    add_body(spec, "ball", (0, 0, RADIUS), condim=4)
    spec.body("ball").geoms[0].friction = [0.5, 0.005, 1e-4]
    heights, data = _heights(Scene(spec, STOPS, [("ball", [0, 0, 0, 0, 0, 20])]), 0.3)
    slowed = 0.005 * 9.81 / (0.4 * RADIUS**2) * 0.3
    assert 20 - data.qvel[5] == pytest.approx(slowed, rel=0.04)
    assert np.abs(heights - RADIUS).max() < 1e-4


@pytest.mark.parametrize("kind", ["weld", "connect"])
@pytest.mark.parametrize(("solver", "cone"), list(product(SOLVERS, CONES)))
def test_bodies_whose_equality_is_broken_roll_no_deeper_than_on_native_contact(
    solver: str, cone: str, kind: str
) -> None:
    """Two cylinders that start at the same speeds, which the equality then takes 20 ms to correct."""
    deepest = []
    for law in (STOPS, None):
        spec = world(3e-3, cone=cone, solver=solver, friction=1.0)
        for i, name in enumerate(("a", "b")):
            at = (0.4 * i, 0, 0.1)
            add_body(spec, name, at, mujoco.mjtGeom.mjGEOM_CYLINDER, (0.2, 0.1, 0), friction=1.0)
        numbers = [0, 0, 0, 0.4, 0, 0, 1, 0, 0, 0, 1] if kind == "weld" else [0.2, 0, 0]
        add_equality(spec, kind, "a", "b", numbers)
        scene = Scene(spec, law, [(name, [3, 0, 0, 0, 10, 0]) for name in ("a", "b")])
        model = scene.model()
        data = scene.data(model)
        depth = 0.0
        for _ in range(100):
            mujoco.mj_step(model, data)
            depth = max(depth, -float(data.contact.dist.min(initial=0.0)))
        deepest.append(depth)
    own, native = deepest
    assert own <= native + 1e-3


@pytest.mark.parametrize(("stiff", "named"), [(0.01, 1), (0.02, 0)])
def test_a_free_body_that_may_land_deeper_than_on_native_contact_is_named_once(
    stiff: float, named: int
) -> None:
    """A step of 4 ms against a time constant of 10 or 20 ms: native contact lets a third of it in."""
    spec = world(4e-3)
    add_body(spec, "ball", (0, 0, RADIUS + 0.05))
    spec.geom("floor").solref = spec.body("ball").geoms[0].solref = [stiff, 1.0]
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        _heights(Scene(spec, STOPS, [("ball", [0, 0, -3])]), 0.1)
    finally:
        mujoco.set_mju_user_warning(None)
    assert sum('body 1 "ball" may land more than 1 mm deeper' in words for words in warned) == named
