"""The restitution plug-in of MuJoCo under the options of a model: solvers, cones, integrators, noslip."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import pytest
from contact_scenes import BOX, HALF, Scene, add_body, rise, stack, tumbling, world

from hcbench.contact.mujoco import Restitution

if TYPE_CHECKING:
    from hcbench.impact import Floats

INTEGRATORS = ("Euler", "implicit", "implicitfast", "RK4")
CONES = ("pyramidal", "elliptic")


def options(**given: Any) -> Any:
    return pytest.param(given, id=" ".join(str(value) for value in given.values()))


@pytest.mark.parametrize("cone", CONES)
@pytest.mark.parametrize(
    "option",
    [
        *(options(noslip=n, integrator=i) for n, i in ((1, "Euler"), (5, "implicitfast"), (20, "RK4"))),
        *(options(solver="PGS", integrator=i) for i in ("Euler", "implicitfast")),
        *(options(solver="CG", integrator=i) for i in ("Euler", "RK4")),
    ],
)
def test_no_solver_wins_energy_at_rest(option: dict[str, Any], cone: str) -> None:
    make = partial(stack, 4, 2e-3, friction=1.0, cone=cone, **option)
    assert rise(make, HALF, 0.2) < 1e-6


@pytest.mark.parametrize("cone", CONES)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_box_rests_on_a_slope(integrator: str, cone: str) -> None:
    """It neither vibrates nor creeps: 15 degrees, friction .5."""
    spec = world(2e-3, integrator=integrator, cone=cone)
    turned = [np.cos(np.radians(7.5)), 0, np.sin(np.radians(7.5)), 0]
    spec.worldbody.first_geom().quat = turned
    tip = np.radians(15)
    add_body(spec, "box", (0.05 * np.sin(tip), 0, 0.05 * np.cos(tip)), BOX, (0.05,) * 3, quat=turned)
    model = Scene(spec, HALF).model()
    data, fastest = mujoco.MjData(model), 0.0
    mujoco.mj_step(model, data, nstep=500)
    start = data.qpos[:3].copy()
    for _ in range(500):
        mujoco.mj_step(model, data)
        fastest = max(fastest, float(np.abs(data.qvel[:3]).max()))
    assert fastest < 1e-6
    assert np.abs(data.qpos[:3] - start).max() < 1e-6


def turned_freely(inertia: Floats, w: Floats, h: float) -> Floats:
    """Angular velocity of a free body after h, by Euler's equations; inertia (3, 3), body axes."""
    inverse = np.linalg.inv(inertia)

    def rate(w: Floats) -> Floats:
        return -inverse @ np.cross(w, inertia @ w)

    for _ in range(24):
        k = h / 24
        a = rate(w)
        b = rate(w + k / 2 * a)
        c = rate(w + k / 2 * b)
        w = w + k / 6 * (a + 2 * b + 2 * c + rate(w + k * c))
    return w


def error_of_corner(seed: int, integrator: str) -> float | None:
    """Error of e of a corner that spins: the impulse acts first, then the body turns freely for a step.

    None where this box does not meet the plate with one corner.
    """
    rng = np.random.default_rng(seed)
    law = Restitution(0.315)
    spec = world(2e-3, gravity=0.0, friction=float(rng.choice([0.0, 0.2, 1.0])), integrator=integrator)
    size = np.array([0.1, 0.05, 0.03])
    add_body(spec, "box", (0, 0, 1), BOX, size, quat=rng.normal(size=4))
    model = Scene(spec, law).model()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.qpos[2] = float(np.abs(data.geom("box").xmat.reshape(3, 3)[2]) @ size) - 1e-7
    data.qvel[:] = rng.normal(size=6) * [0.7, 0.7, 0.3, 6, 6, 6] - [0, 0, 0.6, 0, 0, 0]
    mujoco.mj_forward(model, data)
    row = np.zeros((3, 6))
    mujoco.mj_jac(model, data, row, None, data.contact[0].pos if data.ncon else np.zeros(3), 1)
    speed = -float(row[2] @ data.qvel)
    if data.ncon != 1 or speed < 0.05:
        return None
    mujoco.mj_step(model, data)
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[1])
    inertia = axes.reshape(3, 3) @ np.diag(model.body_inertia[1]) @ axes.reshape(3, 3).T
    after = data.qvel.copy()
    for _ in range(12):  # the angular velocity that free motion takes to what the engine returned
        after[3:] += data.qvel[3:] - turned_freely(inertia, after[3:], model.opt.timestep)
    return abs(float(row[2] @ after) / speed - float(law.at(speed)))


@pytest.mark.parametrize(
    ("integrator", "most"), [("Euler", 2.1e-3), ("implicit", 2.1e-3), ("implicitfast", 2.1e-3), ("RK4", 1e-8)]
)
def test_a_corner_that_spins_parts_at_the_speed_of_the_law(integrator: str, most: float) -> None:
    errors = [error for seed in range(40) if (error := error_of_corner(seed, integrator)) is not None]
    assert len(errors) > 15
    assert max(errors) < most


@pytest.mark.parametrize("cone", CONES)
@pytest.mark.parametrize(
    ("solver", "integrator"), [("CG", "Euler"), ("Newton", "implicitfast"), ("CG", "RK4")]
)
def test_a_thrown_box_wins_no_energy(solver: str, integrator: str, cone: str) -> None:
    make = partial(tumbling, 3, 2e-3, friction=0.5, cone=cone, solver=solver, integrator=integrator)
    assert rise(lambda law: make(law=law), HALF, 1.0) < 2e-4


@pytest.mark.parametrize("integrator", ["implicit", "implicitfast"])
def test_cg_is_refused_where_the_step_takes_its_forces(integrator: str) -> None:
    model = stack(1, 2e-3, HALF, solver="CG", integrator=integrator).model()
    with pytest.raises(mujoco.FatalError, match='set solver="Newton", or integrator="Euler"'):
        mujoco.mj_step(model, mujoco.MjData(model))
