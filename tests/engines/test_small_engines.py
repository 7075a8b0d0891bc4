"""Drake, DART, Exudyn and Rapier: what each does to a bounce, by closed forms and loops of our own."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest
from free_flight import speed_at_plane
from long_searches import LONG

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Impact, Launch, Status
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Setting

PLANE, CUP = load_scene("steel-plane"), load_scene("steel-cup")
ALPHAS = tuple(a / 0.0254 for a in (0.002, 0.004, 0.008, 0.016))  # s/m
SPEEDS, PHASES = (0.033, 0.17, 0.49), (0.07, 0.61)  # m/s, and of a step: in no recipe
G = 9.80665


def target(alpha: float, timestep: float, gravity: float = 0.0) -> Target:
    law = HuntCrossley(PLANE.stiffness, alpha, 1.5)
    return Target(law, PLANE.mass, timestep, 0.0254, 0.508, gravity=gravity)


def simulated(setting: Setting, *launches: Launch, scene: Any = PLANE) -> list[Impact]:
    pytest.importorskip(
        {"drake": "pydrake", "dart": "dartpy", "rapier": "rapier3d"}.get(setting.engine, "exudyn")
    )
    return registry.engine(setting.engine).run(scene, setting, launches)


def off_law(recipe: str, alpha: float, timestep: float, scene: Any = PLANE) -> float:
    launches = [Launch(v, p) for v in SPEEDS for p in PHASES]
    impacts = simulated(registry.recipe(recipe)(target(alpha, timestep)), *launches, scene=scene)
    law = closed_form.restitution(alpha, np.array([i.speed_in for i in impacts]))
    return float(np.abs(np.array([i.restitution for i in impacts]) - law).max())


@pytest.mark.parametrize("alpha", ALPHAS if LONG else (ALPHAS[0], ALPHAS[-1]))
@pytest.mark.parametrize(
    ("recipe", "timestep", "most"),
    [
        ("drake.continuous", 1e-6, 1e-8),
        ("dart.restitution-law", 1e-3, 7e-16),
        ("exudyn.contact-law", 1e-6, 2.1e-5),
        ("exudyn.hunt-crossley", 1e-6, 1.1e-6),
        ("rapier.restitution-law", 1 / 60, 3.4e-7),
    ],
)
def test_the_law_is_as_near_as_documented(
    recipe: str, timestep: float, most: float, alpha: float
) -> None:
    assert off_law(recipe, alpha, timestep) <= most


def test_drakes_continuous_plant_has_the_laws_e_at_any_step() -> None:
    assert off_law("drake.continuous", ALPHAS[2], 1 / 60) <= 1e-8


@pytest.mark.parametrize("timestep", [1e-6, 1e-4, 1 / 240])
@pytest.mark.parametrize(("engine", "most"), [("dart", 1e-14), ("rapier", 3.4e-7)])
def test_restitution_set_is_restitution_got(engine: str, most: float, timestep: float) -> None:
    setting = registry.recipe(f"{engine}.restitution")(target(ALPHAS[2], timestep))
    ends = closed_form.restitution(ALPHAS[2], np.array([0.0254, 0.508]))
    for impact in simulated(setting, *(Launch(v, p) for v in SPEEDS for p in PHASES)):
        assert impact.restitution == pytest.approx(float(ends.mean()), abs=most)


# --- Drake
# ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("stiffness", "off"), [(1.6e7, -0.0092), (1.6e8, -0.029)])
def test_drakes_discrete_plant_damps_by_itself(stiffness: float, off: float) -> None:
    """e times exp(-π ω h/2), ω² = k/m, at every speed and for every approximation but `sap`."""
    alpha, h = ALPHAS[1], 1e-6
    share = math.exp(-math.pi * math.sqrt(stiffness / PLANE.mass) * h / 2)
    contact = {"point_stiffness": 2 * stiffness, "dissipation": 1.5 * alpha}
    for approximation in ("similar", "lagged"):
        options = {"approximation": approximation, **contact}
        for impact in simulated(
            Setting("drake", "mine", h, options), Launch(0.033, 0.3), Launch(0.49, 0.8)
        ):
            law = float(closed_form.restitution(alpha, impact.speed_in))
            assert impact.restitution == pytest.approx(share * law, abs=0.05 * (1 - share))
            assert impact.restitution - law == pytest.approx(off * law, rel=0.05)


def test_drakes_stock_dissipation_is_a_hundred_times_that_of_steel() -> None:
    free = Setting("drake", "mine", 1e-3, {"plant": "continuous", "accuracy": 1e-8})
    for speed, e in ((0.0254, 0.53), (0.508, 0.039)):
        (impact,) = simulated(free, Launch(speed))
        assert impact.restitution == pytest.approx(
            float(closed_form.restitution(50 / 1.5, speed)), abs=1e-6
        )
        assert impact.restitution == pytest.approx(e, abs=0.005)


def test_drakes_contact_is_linear_in_depth() -> None:
    setting = registry.recipe("drake.continuous")(target(ALPHAS[2], 1e-6))
    (impact,) = simulated(setting, Launch(0.3))
    assert impact.loop is not None
    x, v = impact.loop.penetration[1:], impact.loop.rate[1:]
    law = HuntCrossley(setting.options["point_stiffness"] / 2, ALPHAS[2], 1.0).force(
        np.maximum(x, 0), v
    )
    assert impact.loop.force[1:-1] == pytest.approx(law[:-1], abs=1e-9 * law.max())


def test_drakes_soft_spring_is_stiffer_under_gravity() -> None:
    soft, stiffer = (
        registry.recipe("drake.discrete")(target(ALPHAS[2], 1e-6, g)).options["point_stiffness"]
        for g in (0.0, G)
    )
    assert stiffer > 3 * soft


# --- DART
# ----------------------------------------------------------------------------------------------


def dart_bounce(speed: float, e: float, gravity: float = 0.0) -> float:
    """e at the touch plane, at a step of 1 ms, of a scene in metres: a loop of our own."""
    dart = pytest.importorskip("dartpy")
    world, step = dart.simulation.World(), 1e-3
    world.setTimeStep(step)
    world.setGravity([0, 0, -gravity])
    plate, ball = dart.dynamics.Skeleton("plate"), dart.dynamics.Skeleton("ball")
    _, ground = plate.createWeldJointAndBodyNodePair()
    _, body = ball.createFreeJointAndBodyNodePair()
    floor = ground.createShapeNode(dart.dynamics.BoxShape([9, 9, 0.2]))
    floor.setRelativeTranslation([0, 0, -0.1])
    for shape, value in ((floor, 1.0), (body.createShapeNode(dart.dynamics.SphereShape(0.05)), e)):
        shape.createCollisionAspect()
        shape.createDynamicsAspect()
        shape.getDynamicsAspect().setRestitutionCoeff(value)
    world.addSkeleton(plate)
    world.addSkeleton(ball)
    ball.setPositions([0, 0, 0, 0, 0, 0.05 + 2.5 * step * speed])
    ball.setVelocities([0, 0, 0, 0, 0, -speed])
    speeds = [0.0]
    while (velocity := float(ball.getVelocities()[5])) < -0.5 * speed:
        speeds.append(speed_at_plane(float(ball.getPositions()[5]) - 0.05, velocity, gravity, step))
        world.step()
    return (
        speed_at_plane(float(ball.getPositions()[5]) - 0.05, velocity, gravity, step) / speeds[-1]
    )


@pytest.mark.parametrize("gravity", [0.0, G])
def test_darts_loop_of_our_own_gives_what_the_engine_gives(gravity: float) -> None:
    setting = Setting("dart", "mine", 1e-3, {"restitution": 0.9})
    with_gravity = dataclasses.replace(PLANE, gravity=gravity)
    (impact,) = simulated(setting, Launch(0.4), scene=with_gravity)
    if gravity:  # it reverses v + g h, a step's gain too much
        assert impact.restitution > 0.915
    else:
        assert impact.restitution == pytest.approx(1.9 / (1 + 1e-5) - 1, abs=1e-14)
    assert dart_bounce(0.4, 0.9, gravity) == pytest.approx(impact.restitution, abs=1e-13)


def test_dart_does_not_bounce_below_a_tenth_of_a_unit_a_second() -> None:
    def in_metres(speed: float, units: float = 1.0) -> float:
        options = {"restitution": 0.9, "units_per_metre": units}
        return simulated(Setting("dart", "mine", 1e-4, options), Launch(speed))[0].restitution

    assert in_metres(0.1112) == pytest.approx(0.9, abs=2e-5)
    assert in_metres(0.1110) < 0.02
    assert in_metres(0.1110, units=100.0) == pytest.approx(0.9, abs=2e-5)
    assert in_metres(2.0, units=100.0) == pytest.approx(0.5, abs=2e-5)  # no faster than 100 cm/s


def test_dart_rests_by_its_law_and_goes_on_bouncing_by_one_restitution() -> None:
    """The ball bounces on at e g h/(1 - e), where the threshold lets it; from 20 mm at 1 ms."""
    pytest.importorskip("dartpy")
    engine, with_gravity = registry.engine("dart"), dataclasses.replace(PLANE, gravity=G)
    for recipe, speed in (
        ("restitution-law", 0.0),
        ("restitution", 0.9269 * G * 1e-3 / (1 - 0.9269)),
    ):
        setting = registry.recipe(f"dart.{recipe}")(target(ALPHAS[2], 1e-3))
        path = engine.trajectory(with_gravity, setting, Launch(0.0, height=0.02), 6.0)
        assert np.abs(path.rate[-1000:]).max() == pytest.approx(speed, rel=0.1, abs=1e-6)


def test_a_band_that_dart_cannot_bounce_is_refused() -> None:
    wide = dataclasses.replace(target(0.0, 1e-3), speed_min=1e-4)
    with pytest.raises(SettingError, match=r"speeds: from 0\.0001 m/s on"):
        registry.recipe("dart.restitution")(wide)


# --- Exudyn
# --------------------------------------------------------------------------------------------


def test_exudyns_force_is_the_laws_in_the_cup_and_on_the_plane() -> None:
    setting = registry.recipe("exudyn.contact-law")(target(ALPHAS[3], 1e-6))
    for scene in (PLANE, CUP):
        (impact,) = simulated(setting, Launch(0.4), scene=scene)
        assert impact.loop is not None
        x, v = impact.loop.penetration[1:-1], impact.loop.rate[1:-1]
        law = HuntCrossley(PLANE.stiffness, ALPHAS[3], 1.5).force(np.maximum(x, 0), v)
        assert impact.loop.force[1:-1] == pytest.approx(law, abs=1e-6 * law.max())


def test_exudyn_loses_less_than_the_law_above_its_threshold() -> None:
    setting = registry.recipe("exudyn.contact-law")(target(ALPHAS[2], 1e-6))
    loss, threshold = (
        1 - setting.options["restitutionCoefficient"],
        setting.options["minimumImpactVelocity"],
    )
    assert loss / threshold == pytest.approx(ALPHAS[2])
    (impact,) = simulated(setting, Launch(2 * threshold))
    expected = float(closed_form.restitution(loss / (2 * threshold), 2 * threshold))
    assert impact.restitution == pytest.approx(expected, abs=2e-4)


def test_exudyns_stock_ball_goes_through_the_plate() -> None:
    (impact,) = simulated(registry.recipe("exudyn.stock")(target(ALPHAS[2], 1e-3)), Launch(0.4))
    assert impact.status is Status.DIVERGED
    assert "went through the plate" in impact.reason


@pytest.mark.parametrize("alpha", ALPHAS)
def test_exudyn_softens_what_its_steps_cannot_resolve(alpha: float) -> None:
    assert off_law("exudyn.contact-law", alpha, 1e-3) < 1e-3


# --- Rapier
# --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gravity", [0.0, G])
def test_rapier_turns_round_the_speed_of_the_steps_start(gravity: float) -> None:
    rapier, step, e = pytest.importorskip("rapier3d"), 1 / 60, 0.75
    world = rapier.PhysicsWorld(gravity=(0, 0, -gravity))
    world.integration_parameters.dt = step
    handle = world.rigid_bodies.insert(
        rapier.RigidBody.dynamic(translation=(0, 0, 0.1), linvel=(0, 0, -0.5))
    )
    world.colliders.insert(rapier.Collider.halfspace((0, 0, 1), restitution=e))
    world.colliders.insert_with_parent(
        rapier.Collider.ball(0.05, restitution=e), handle, world.rigid_bodies
    )
    body, before = world.rigid_bodies[handle], 0.5
    while body.linvel.z < 0:
        before = -body.linvel.z
        world.step()
    assert body.linvel.z / before == pytest.approx(e, abs=2e-7)
    if not gravity:
        (impact,) = simulated(Setting("rapier", "mine", step, {"restitution": e}), Launch(0.5))
        assert impact.restitution == pytest.approx(e, abs=2e-7)


@pytest.mark.needs_engine("rapier")
def test_rapiers_flight_keeps_what_four_substeps_keep() -> None:
    with_gravity, step = dataclasses.replace(PLANE, gravity=G), 1 / 60
    setting = Setting("rapier", "mine", step, {"restitution": 0.75})
    path = registry.engine("rapier").trajectory(
        with_gravity, setting, Launch(0.5, height=0.1), 6 * step
    )
    assert not path.force.any()
    kept = (path.rate + G * step / 8) ** 2 - 2 * G * path.penetration
    assert np.ptp(kept) < 2e-6 * kept[0]


@pytest.mark.parametrize("step", [1e-3, 1 / 240, 1 / 60])
def test_a_ball_that_leaves_rapier_slower_than_1_3_g_h_stays(step: float) -> None:
    with_gravity, phases = dataclasses.replace(PLANE, gravity=G), (0.2, 0.5, 0.8)
    for e, share in itertools.product((0.9, 0.5), (0.5, 0.8, 1.1, 1.2, 1.3, 1.5, 2.0)):
        speed = share * G * step / e  # that of the step's start, which it touches in
        launches = [Launch(speed, phase, height=phase * step * speed) for phase in phases]
        for impact in simulated(
            Setting("rapier", "mine", step, {"restitution": e}), *launches, scene=with_gravity
        ):
            assert impact.status is (Status.PARTED if share >= 1.3 else Status.RESTED)
