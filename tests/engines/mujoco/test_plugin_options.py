"""The restitution plug-in of MuJoCo under the options of a model:
solvers, cones, integrators, noslip.
"""

from __future__ import annotations

import os
import re
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from contact_scenes import (
    BOX,
    HALF,
    RADIUS,
    Scene,
    add_body,
    before_turning,
    plugged,
    rise,
    stack,
    tumbling,
    world,
)
from covering import every_pair
from plugin_options import CONES, INTEGRATORS, energy_won, rows, scenes

from hcbench.contact import mujoco as contact
from hcbench.contact.mujoco import ConstantRestitution, Restitution

LAW = Restitution(0.315)
ELASTIC = ConstantRestitution(1.0)
LONG = "HCBENCH_PLUGINS" in os.environ  # make test-plugins
PAGE = Path(__file__).parents[3] / "docs" / "reference" / "plugins.md"
SOURCE = Path(contact.__file__).parents[1] / "engines" / "mujoco" / "plugin" / "restitution.c"


def options(**given: Any) -> Any:
    return pytest.param(given, id=" ".join(str(value) for value in given.values()))


@pytest.mark.parametrize("cone", CONES)
@pytest.mark.parametrize(
    "option",
    [
        *(
            options(noslip=n, integrator=i)
            for n, i in ((1, "Euler"), (5, "implicitfast"), (20, "RK4"))
        ),
        *(options(solver="PGS", integrator=i) for i in ("Euler", "implicitfast")),
        *(options(solver="CG", integrator=i) for i in INTEGRATORS),
    ],
)
def test_no_solver_wins_energy_at_rest(option: dict[str, Any], cone: str) -> None:
    make = partial(stack, 4, 2e-3, friction=1.0, cone=cone, **option)
    assert rise(make, HALF, 0.2) < 1e-6


@pytest.mark.parametrize("cone", CONES)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_box_rests_on_a_slope(integrator: str, cone: str) -> None:
    """The box neither vibrates nor creeps at 15 degrees with friction 0.5."""
    spec = world(2e-3, integrator=integrator, cone=cone)
    turned = [np.cos(np.radians(7.5)), 0, np.sin(np.radians(7.5)), 0]
    spec.worldbody.first_geom().quat = turned
    tip = np.radians(15)
    add_body(
        spec, "box", (0.05 * np.sin(tip), 0, 0.05 * np.cos(tip)), BOX, (0.05,) * 3, quat=turned
    )
    model = Scene(spec, HALF).model()
    data, fastest = mujoco.MjData(model), 0.0
    mujoco.mj_step(model, data, nstep=500)
    start = data.qpos[:3].copy()
    for _ in range(500):
        mujoco.mj_step(model, data)
        fastest = max(fastest, float(np.abs(data.qvel[:3]).max()))
    assert fastest < 1e-6
    assert np.abs(data.qpos[:3] - start).max() < 1e-6


def error_of_corner(seed: int, integrator: str) -> float | None:
    """Error of e of a corner that spins: the impulse acts first, then
    the body turns freely for a step.

    None where this box does not meet the plate with one corner.
    """
    rng = np.random.default_rng(seed)
    law = Restitution(0.315)
    spec = world(
        2e-3, gravity=0.0, friction=float(rng.choice([0.0, 0.2, 1.0])), integrator=integrator
    )
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
    after = data.qvel.copy()
    after[3:] = before_turning(model, 1, after[3:])
    return abs(float(row[2] @ after) / speed - float(law.at(speed)))


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_corner_that_spins_parts_at_the_speed_of_the_law(integrator: str) -> None:
    errors = [
        error for seed in range(20) if (error := error_of_corner(seed, integrator)) is not None
    ]
    assert len(errors) > 7
    assert max(errors) < 1e-8


@pytest.mark.parametrize("cone", CONES)
@pytest.mark.parametrize(
    ("solver", "integrator"), [("CG", "Euler"), ("Newton", "implicitfast"), ("CG", "RK4")]
)
def test_a_thrown_box_wins_no_energy(solver: str, integrator: str, cone: str) -> None:
    make = partial(tumbling, 3, 2e-3, friction=0.5, cone=cone, solver=solver, integrator=integrator)
    assert rise(lambda law: make(law=law), HALF, 1.0) < 2e-4


@pytest.mark.parametrize(
    ("h", "integrator"), [(2.5e-4, "implicitfast"), (1e-3, "Euler"), (1e-3, "RK4")]
)
def test_an_ellipsoid_that_rolls_wins_no_energy(h: float, integrator: str) -> None:
    """Under Newton and elliptic cones, whose line search left stiffer rows
    a torque that no contact gives.
    """
    spec = world(h, friction=0.5, cone="elliptic", integrator=integrator)
    add_body(
        spec, "egg", (0, 0, 0.08), mujoco.mjtGeom.mjGEOM_ELLIPSOID, (0.03, 0.06, 0.04), friction=0.5
    )
    scene = Scene(spec, HALF, [("egg", [0.5, 0.2, -1.0, 4.0, 3.0, -5.0])])
    model = scene.model()
    data = scene.data(model)
    energies = []
    for _ in range(round(1.5 / h)):
        mujoco.mj_step(model, data)
        energies.append(data.energy.sum())
    lowest = np.minimum.accumulate(energies)
    assert (energies - lowest).max() < 2e-3 * energies[0]


def test_cg_is_refused_where_noslip_takes_its_forces() -> None:
    model = stack(1, 2e-3, HALF, solver="CG", noslip=1).model()
    with pytest.raises(mujoco.FatalError, match='set solver="Newton", or noslip_iterations="0"'):
        mujoco.mj_step(model, mujoco.MjData(model))


# What the page says of energy, by option


def documented() -> dict[str, tuple[float, float]]:
    """The page's table: largest energy won in a step and in all, of the energy at the start."""
    table = (
        PAGE.read_text(encoding="utf-8")
        .split("<!-- begin energy -->")[1]
        .split("<!-- end energy -->")[0]
    )
    cells = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in table.strip().splitlines()[2:]
    ]
    return {name: (float(step), float(total)) for name, step, total in cells}


def rounded_up(share: float) -> str:
    """A number of 1e-6 or more, rounded up to one digit."""
    digit = 10.0 ** np.floor(np.log10(max(share, 1e-6)))
    return f"{np.ceil(max(share, 1e-6) / digit - 1e-9) * digit:.0e}"


@pytest.mark.parametrize(("name", "option"), [pytest.param(*row, id=row[0]) for row in rows()])
def test_no_option_wins_more_energy_than_the_page_says(name: str, option: dict[str, Any]) -> None:
    flag = option.get("enable", option.get("disable", "")).upper()
    bits = mujoco.mjtEnableBit if "enable" in option else mujoco.mjtDisableBit
    if flag and not any(one.endswith(f"_{flag}") for one in bits.__members__):
        pytest.skip("this MuJoCo has no such flag")
    cones, seeds, seconds = (CONES, range(3), 1.0) if LONG else (CONES[:1], range(1), 0.3)
    seen = [
        energy_won(make, option, seconds) for cone in cones for make in scenes(seeds, cone, option)
    ]
    most = np.max(seen, axis=0)
    if LONG:
        print(f"| {name} | {rounded_up(most[0])} | {rounded_up(most[1])} |")
    assert (most <= np.array(documented()[name])).all()


def test_the_page_has_a_row_for_each_option() -> None:
    assert list(documented()) == [name for name, _ in rows()]


def test_no_flag_of_this_mujoco_is_untried() -> None:
    """A flag that a later MuJoCo brings must be measured, and named in
    the plug-in, before it passes.
    """
    text = SOURCE.read_text(encoding="utf-8").split("tried_flags =")[1].split(";")[0]
    tried = set(re.sub(r'["\n]', " ", text).upper().split())
    flags = {
        name.split("_", 1)[1]
        for bits in (mujoco.mjtEnableBit, mujoco.mjtDisableBit)
        for name in bits.__members__
        if name.startswith(("mjENBL_", "mjDSBL_"))
    }
    assert flags - tried <= {
        "OVERRIDE",
        "IPC",
    }  # refused; of the integrator `discrete`, which is refused
    known = {"mjINT_EULER", "mjINT_RK4", "mjINT_IMPLICIT", "mjINT_IMPLICITFAST", "mjINT_DISCRETE"}
    assert set(mujoco.mjtIntegrator.__members__) <= known
    assert set(mujoco.mjtSolver.__members__) <= {"mjSOL_PGS", "mjSOL_CG", "mjSOL_NEWTON"}
    assert set(mujoco.mjtCone.__members__) <= {"mjCONE_PYRAMIDAL", "mjCONE_ELLIPTIC"}


def test_a_flag_that_was_never_tried_is_named_once() -> None:
    model = stack(1, 2e-3, HALF).model()
    model.opt.enableflags |= 1 << 20
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        mujoco.mj_step(model, mujoco.MjData(model), nstep=5)
    finally:
        mujoco.set_mju_user_warning(None)
    assert len(warned) == 1
    assert "hcbench.restitution was never tried with the flag" in warned[0]


# Slow impacts


def test_an_impact_below_1_6_g_h_has_the_e_of_the_law_or_stays_down() -> None:
    h, g = 2e-3, 9.81
    spec = world(h)
    add_body(spec, "b", (0, 0, RADIUS), friction=0.0, condim=1)
    model = plugged(spec, [("b", "floor")], LAW)

    def bounced(ratio: float, start: float) -> float:
        data, speed = mujoco.MjData(model), ratio * g * h
        down = speed - g * h * (2 + start)
        data.qpos[2] = RADIUS + (speed**2 - down**2) / (2 * g)
        data.qvel[2] = -(down - g * h / 2)
        highest, touched = 0.0, False
        for _ in range(60):
            mujoco.mj_step(model, data)
            touched |= bool(data.qpos[2] <= RADIUS)
            parting = float(data.qvel[2]) - g * h / 2
            if touched and parting > 0 and data.qpos[2] > RADIUS:
                highest = max(highest, parting**2 + 2 * g * (float(data.qpos[2]) - RADIUS))
        return float(np.sqrt(highest)) / speed

    starts = np.linspace(0, 0.95, 20)
    for ratio in (1.6, 1.9, 3.0):
        e = float(LAW.at(ratio * g * h))
        assert [bounced(ratio, start) for start in starts] == pytest.approx([e] * 20, abs=1e-9)
    slow = np.array([bounced(1.0, start) for start in starts])
    assert ((slow < 0.5) | (slow > 0.98)).all()
    assert 0 < (slow < 0.5).sum() < 20


# Beside contacts that no law governs


@pytest.mark.parametrize(
    ("integrator", "cone", "friction"), every_pair(INTEGRATORS, CONES, [0.0, 0.5])
)
def test_native_contact_beside_an_impact_gains_no_energy(
    integrator: str, cone: str, friction: float
) -> None:
    """A ball hits the floor while it parts from one that lies on it, at 24 angles and speeds."""
    most = 0.0
    for seed in range(24):
        rng = np.random.default_rng(seed)
        spec = world(5e-4, gravity=0.0, integrator=integrator, cone=cone)
        angle = rng.uniform(-1.2, 1.2)
        away = 2 * RADIUS - rng.uniform(0, 1e-3)
        add_body(spec, "low", (0, 0, RADIUS - 1e-5), friction=friction)
        at = (away * np.sin(angle), 0, RADIUS + away * np.cos(angle))
        add_body(spec, "high", at, friction=friction)
        model = plugged(spec, [("low", "floor")], ELASTIC)
        data = mujoco.MjData(model)
        data.qvel[2] = -rng.uniform(0.3, 3.0)
        data.qvel[6:9] = rng.uniform(-1, 1), 0, rng.uniform(-1, 1)
        mass = np.repeat(model.body_mass[1:], 3)
        moving = [0, 1, 2, 6, 7, 8]
        first = float(mass @ data.qvel[moving] ** 2)
        mujoco.mj_step(model, data)
        most = max(most, float(mass @ data.qvel[moving] ** 2) / first - 1)
    assert most < 1e-3
