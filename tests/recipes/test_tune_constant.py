"""One number for a band of speeds: what theory leaves is all that is
left, in MuJoCo and in PyBullet.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plain_mujoco import INCH, STEEL_MASS, STEEL_STIFFNESS, pasted, simulated

from hcbench.engines.mujoco.recipes.one_row import IMPULSE, SPRING_DAMPER
from hcbench.engines.pybullet.recipes import RESTITUTION
from hcbench.engines.pybullet.recipes import SPRING_DAMPER as BULLET_SPRING_DAMPER
from hcbench.laws.closed_form import duration
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.recipe import Recipe
from hcbench.recipes.target import (
    Target,
    contact_time,
    minimax_constant,
    require_end,
    resolvable_law,
    spring_damper_rates,
    steps_per_contact,
)
from hcbench.system.errors import SettingError
from hcbench.terms.resolution import STEPS_MOST

SPEEDS = np.array([1.0, 1.9, 4.7, 11.0, 20.0]) * INCH
ALPHAS = (0.002, 0.004, 0.008, 0.016)


def target_of(alpha: float, timestep: float, **more: Any) -> Target:
    return Target(
        HuntCrossley(STEEL_STIFFNESS, alpha / INCH), STEEL_MASS, timestep, INCH, 20 * INCH, **more
    )


@pytest.mark.parametrize(
    ("alpha", "constant", "residual"),
    [
        (0.002, 0.97977, 0.0182),
        (0.004, 0.96095, 0.0351),
        (0.008, 0.92694, 0.0651),
        (0.016, 0.87020, 0.1141),
    ],
)
def test_the_best_constant_and_what_it_leaves(
    alpha: float, constant: float, residual: float
) -> None:
    e, left = minimax_constant(target_of(alpha, 1e-3))
    assert e == pytest.approx(constant, abs=1e-5)
    assert left == pytest.approx(residual, abs=5e-5)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 3.0])
def test_a_law_that_steps_do_not_resolve_is_softened_until_they_do(exponent: float) -> None:
    """The shortest contact of the band then lasts as many steps as were asked for."""
    stiff = Target(HuntCrossley(STEEL_STIFFNESS, 0.3, exponent), STEEL_MASS, 1e-3, 0.1, 0.5)
    for steps in (24.0, 60.0):
        soft = resolvable_law(stiff, steps)
        ends = duration(soft, STEEL_MASS, np.array([0.1, 0.5]))
        assert float(ends.min()) == pytest.approx(steps * 1e-3, rel=1e-9)
        assert soft.alpha == 0.3
        resolved_steps = replace(stiff, law=soft)
        assert steps_per_contact(resolved_steps) == pytest.approx(steps, rel=1e-9)
    resolved = Target(HuntCrossley(1e4, 0.3, exponent), STEEL_MASS, 1e-4, 0.1, 0.5)
    assert resolvable_law(resolved) == resolved.law


@pytest.mark.parametrize(
    ("exponent", "shortest_at"), [(1.0, "low"), (1.2, "within"), (2.0, "high")]
)
def test_the_shortest_contact_of_a_lossy_law_need_not_be_the_fastest(
    exponent: float, shortest_at: str
) -> None:
    """Loss makes the contact of a fast impact longer; stiffening by depth, n > 1, makes it shorter."""
    law = HuntCrossley(1e6, 3.0, exponent)
    target = Target(law, 0.1, 1e-5, 0.1, 0.6)
    times = duration(law, 0.1, np.geomspace(0.1, 0.6, 1001))
    least = int(times.argmin())
    assert (least == 0, least == 1000) == (shortest_at == "low", shortest_at == "high")
    assert steps_per_contact(target) == pytest.approx(float(times.min()) / 1e-5, rel=1e-3)
    # The contact with the most steps that an evaluation ends with is the shortest.
    require_end(replace(target, timestep=1.01 * float(times.min()) / STEPS_MOST))


@pytest.mark.parametrize("timestep", [5e-4, 1e-3, 2e-3, 4e-3])
@pytest.mark.parametrize("alpha", ALPHAS)
def test_impulse_leaves_what_theory_leaves(alpha: float, timestep: float) -> None:
    target = target_of(alpha, timestep)
    flight = simulated(
        pasted(dict(IMPULSE(target).options), timestep, STEEL_MASS), timestep, SPEEDS, 10 * timestep
    )
    error = np.abs(flight.restitution - target.restitution(SPEEDS)[:, None]).max()
    assert error == pytest.approx(minimax_constant(target)[1], abs=1e-6)


def test_impulse_rests_under_gravity() -> None:
    target = target_of(0.008, 1e-3)
    xml = pasted(dict(IMPULSE(target).options), 1e-3, STEEL_MASS, gravity=9.81)
    flight = simulated(xml, 1e-3, np.array([0.44]), 6.0, phases=2)
    x, v = flight.x[0, :, -2000:], flight.v[0, :, -2000:]
    assert np.abs(v).max() < 1e-5
    assert 0 < x.max() < 1e-3 * 2 * INCH


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize("timestep", [1e-6, 1e-3])
def test_spring_damper_has_the_constant_at_every_speed(timestep: float, integrator: str) -> None:
    target = target_of(0.008, timestep)
    e, _ = minimax_constant(target)
    setting = SPRING_DAMPER(target, integrator)
    lasts = contact_time(target)
    flight = simulated(
        pasted(dict(setting.options), timestep, STEEL_MASS),
        timestep,
        SPEEDS,
        1.3 * lasts + 4 * timestep,
    )
    # The phase of the touch is what 20 steps leave; it has no mean.
    assert np.abs(flight.restitution.mean(axis=1) - e).max() < (2e-4 if timestep < 1e-5 else 1e-3)
    assert np.ptp(flight.restitution.mean(axis=1)) < 1e-9
    steps = (flight.x > 0).sum(axis=-1).mean()
    assert steps * timestep == pytest.approx(lasts, rel=0.1)


@pytest.mark.parametrize("e", [0.14, 0.5, 0.9, 0.999])
def test_the_closed_form_of_a_contact_that_only_pushes(e: float) -> None:
    beta, omega = spring_damper_rates(e, 1.0, "impulse")
    t = np.linspace(0.0, 1.0, 200_001)
    x = np.exp(-beta * t) * np.sin(omega * t) / omega
    v = np.exp(-beta * t) * (np.cos(omega * t) - beta / omega * np.sin(omega * t))
    force = (omega**2 + beta**2) * x + 2 * beta * v
    assert (force[:-1] > 0).all()
    assert force[-1] == pytest.approx(0.0, abs=1e-6 * force.max())
    assert -v[-1] == pytest.approx(e, rel=1e-9)


def bullet(
    options: dict[str, Any], timestep: float, speeds: np.ndarray, phases: int = 4
) -> np.ndarray:
    """Restitution by PyBullet's own calls, in the order in which they work; shape (speeds, phases)."""
    import pybullet as p

    client = p.connect(p.DIRECT)
    radius, found = 2 * INCH, np.zeros((len(speeds), phases))
    try:
        for (i, j), _ in np.ndenumerate(found):
            v = float(speeds[i])
            p.resetSimulation(physicsClientId=client)
            p.setGravity(0, 0, 0, physicsClientId=client)
            p.setTimeStep(timestep, client)
            p.setPhysicsEngineParameter(physicsClientId=client, **options["world"])
            plane = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
            sphere = p.createCollisionShape(p.GEOM_SPHERE, radius=radius, physicsClientId=client)
            plate = p.createMultiBody(0, plane, physicsClientId=client)
            height = radius + (2 + (j + 0.37) / phases) * timestep * v
            ball = p.createMultiBody(
                STEEL_MASS,
                sphere,
                basePosition=[0, 0, height],
                useMaximalCoordinates=options["maximal_coordinates"],
                physicsClientId=client,
            )
            p.changeDynamics(ball, -1, physicsClientId=client, **options["ball"])
            p.changeDynamics(plate, -1, physicsClientId=client, **options["plate"])
            p.resetBaseVelocity(ball, [0, 0, -v], physicsClientId=client)
            for _ in range(3000):
                p.stepSimulation(client)
                above = p.getBasePositionAndOrientation(ball, client)[0][2] > radius
                rate = p.getBaseVelocity(ball, client)[0][2]
                if above and rate > 0:
                    break
            p.stepSimulation(client)
            found[i, j] = p.getBaseVelocity(ball, client)[0][2] / v
    finally:
        p.disconnect(client)
    return found


@pytest.mark.needs_engine("pybullet")
@pytest.mark.parametrize("timestep", [1e-5, 5e-4, 1 / 240])
def test_bullet_bounces_with_the_constant(timestep: float) -> None:
    target = target_of(0.016, timestep)
    measured = bullet(dict(RESTITUTION(target).options), timestep, SPEEDS)
    error = np.abs(measured - target.restitution(SPEEDS)[:, None]).max()
    assert error == pytest.approx(minimax_constant(target)[1], abs=1e-6)


@pytest.mark.needs_engine("pybullet")
@pytest.mark.parametrize(("alpha", "timestep"), [(0.016, 1e-6), (0.002, 1e-5), (0.008, 1e-3)])
def test_bullet_spring_damper_has_the_constant(alpha: float, timestep: float) -> None:
    target = target_of(alpha, timestep)
    setting = BULLET_SPRING_DAMPER(target)
    assert setting.options["ball"]["contactDamping"] >= 0
    measured = bullet(dict(setting.options), timestep, SPEEDS[[0, -1]])
    assert np.abs(measured - minimax_constant(target)[0]).max() < 4e-3
    assert np.abs(measured.mean(axis=1) - minimax_constant(target)[0]).max() < 1e-3


def test_bullet_cannot_keep_all_energy() -> None:
    with pytest.raises(SettingError, match="restitution"):
        BULLET_SPRING_DAMPER(target_of(0.0, 1e-3))


@pytest.mark.parametrize(
    ("recipe", "integrator"), [(IMPULSE, "RK4"), (IMPULSE, "discrete"), (SPRING_DAMPER, "discrete")]
)
def test_integrators_that_break_a_recipe_are_refused(recipe: Recipe, integrator: str) -> None:
    with pytest.raises(SettingError, match="integrator"):
        recipe(target_of(0.008, 1e-3), integrator)


def test_an_overdamped_contact_is_refused_with_what_works() -> None:
    with pytest.raises(SettingError, match="impulse"):
        SPRING_DAMPER(target_of(0.008, 1e-3, reading="points", points=((0.1, 0.1),)))


def test_targets_that_no_contact_has_are_refused() -> None:
    with pytest.raises(SettingError, match="not rising"):
        target_of(0.008, 1e-3, reading="points", points=((0.1, 0.7), (0.2, 0.8)))
    with pytest.raises(SettingError, match=r"0 \.\.\. 1"):
        target_of(0.008, 1e-3, reading="points", points=((0.1, 1.2),))
    with pytest.raises(SettingError, match="points"):
        target_of(0.008, 1e-3, reading="points")
    with pytest.raises(SettingError, match="law"):
        target_of(0.06, 1e-3, reading="linear")
    with pytest.raises(SettingError, match="lower speed"):
        Target(HuntCrossley(1e9, 0.1), 1.0, 1e-3, 2.0, 1.0)
    for mass, timestep in ((0.0, 1e-3), (1.0, -1.0), (math.nan, 1e-3)):
        with pytest.raises(SettingError):
            Target(HuntCrossley(1e9, 0.1), mass, timestep, 0.1, 1.0)


def test_points_are_joined_by_straight_lines_and_held_beyond() -> None:
    target = target_of(0.008, 1e-3, reading="points", points=((0.3, 0.7), (0.1, 0.9)))
    assert target.restitution(np.array([0.05, 0.2, 0.5])) == pytest.approx([0.9, 0.8, 0.7])
