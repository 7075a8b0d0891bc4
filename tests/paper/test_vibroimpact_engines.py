"""The mass between two blocks inside the engines, laid over the reference."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley, KelvinVoigt
from hcbench.paper import constants
from hcbench.paper.vibroimpact.simulate import simulate
from hcbench.paper.vibroimpact.system import Sinusoid, VibroImpact
from hcbench.paper.vibroimpact_figures import EngineTrajectory, simulate_in_engine
from hcbench.system.errors import UserError

LAW = constants.law(constants.ALPHAS[-1])
BOTH = pytest.mark.parametrize("where", ["mujoco", "pybullet"])
TUNED = pytest.mark.parametrize(
    "where", [pytest.param("mujoco", marks=pytest.mark.adhesion), "pybullet"]
)


def _system(gap: float, law: Any = LAW) -> VibroImpact:
    return VibroImpact(constants.MASS, gap, law, law)


@cache
def _reference(
    system: VibroImpact, position: float, velocity: float, until: float, drive: Sinusoid | None
) -> CubicHermiteSpline:
    """Position of the reference's mass at any time: between its steps by positions and velocities."""
    truth = simulate(system, position, velocity, until, drive)
    return CubicHermiteSpline(truth.time, truth.position, truth.velocity)


def _apart(
    found: EngineTrajectory,
    system: VibroImpact,
    position: float,
    velocity: float,
    drive: Sinusoid | None,
) -> float:
    """Largest distance from the reference, over its amplitude."""
    wanted = _reference(system, position, velocity, round(float(found.time[-1]), 5), drive)(
        found.time
    )
    return float(np.abs(found.position - wanted).max() / np.abs(wanted).max())


@pytest.fixture(autouse=True)
def _installed(request: pytest.FixtureRequest) -> None:
    if "where" in request.fixturenames:
        pytest.importorskip(request.getfixturevalue("where"))


@BOTH
def test_a_free_mass_bounces_between_the_blocks_as_the_reference_does(where: str) -> None:
    system = _system(1.5e-3)
    found = simulate_in_engine(where, system, 0.0, 0.4, 0.02, timestep=1e-5)
    assert _apart(found, system, 0.0, 0.4, None) < 2e-4


@BOTH
@pytest.mark.parametrize(
    ("gap", "drive", "until", "limit"),
    [
        (1.5e-3, Sinusoid(150.0, 90.0), 0.02, 2e-3),
        (0.0, Sinusoid(200.0, 500.0), 4e-3, 5e-3),
        (-1e-5, Sinusoid(400.0, 3000.0), 2e-3, 1e-2),
    ],
    ids=["clear", "no gap", "squeezed"],
)
def test_a_forced_mass_follows_the_reference_and_closer_at_finer_steps(
    where: str, gap: float, drive: Sinusoid, until: float, limit: float
) -> None:
    system = _system(gap)
    start = 0.1 if gap >= 0.0 else 0.0
    errors = [
        _apart(
            simulate_in_engine(where, system, 0.0, start, until, drive, timestep=h),
            system,
            0.0,
            start,
            drive,
        )
        for h in (8e-6, 2e-6)
    ]
    assert errors[1] < limit
    assert errors[1] < 0.5 * errors[0]


@BOTH
def test_both_blocks_press_at_once_on_a_squeezed_mass(where: str) -> None:
    system = _system(-1e-5)
    found = simulate_in_engine(
        where, system, 0.0, 0.0, 2e-3, Sinusoid(400.0, 3000.0), timestep=1e-6
    )
    wanted = system.resultant(found.position, found.velocity)
    assert np.abs(found.resultant - wanted).max() < 0.02 * np.abs(wanted).max()


@TUNED
def test_native_contact_is_right_at_the_first_impact(where: str) -> None:
    system = _system(1.5e-3)
    found = simulate_in_engine(where, system, 0.0, 0.4, 0.02, timestep=2e-6, tuned_at=0.4)
    free = np.abs(found.resultant) < 1e-6 * np.abs(found.resultant).max()
    after = found.velocity[free & (found.velocity < 0.0)][2]
    assert -after / 0.4 == pytest.approx(float(closed_form.restitution(LAW.alpha, 0.4)), abs=2e-3)


@TUNED
def test_staggered_pairs_stay_with_the_law_and_a_constant_restitution_parts_from_it(
    where: str,
) -> None:
    system, drive = _system(1.5e-3), Sinusoid(150.0, 90.0)
    found = simulate_in_engine(where, system, 0.0, 0.1, 0.03, drive, timestep=4e-6, tuned_at=0.4)
    apart = _apart(found, system, 0.0, 0.1, drive)
    assert apart < 0.015 if where == "mujoco" else apart > 0.3


@pytest.mark.adhesion
def test_staggered_pairs_of_both_blocks_add_up_to_the_summed_loop() -> None:
    """Rows share in the highest impedance: of the recipe's own 0.5 the two
    sides would disturb each other.
    """
    system = _system(-1e-5)
    drive = Sinusoid(1200.0, 3e3)
    found = simulate_in_engine("mujoco", system, 0.0, 0.0, 1e-3, drive, timestep=1e-6, tuned_at=0.4)
    wanted = system.resultant(found.position, found.velocity)
    assert np.abs(found.resultant - wanted).max() < 0.006 * np.abs(wanted).max()


@pytest.mark.needs_engine("pybullet")
def test_a_spring_damper_jumps_where_it_meets_a_block_and_the_law_does_not() -> None:
    system, drive = _system(-1e-5), Sinusoid(1200.0, 3e3)
    largest = []
    for tuned_at in (None, 0.4):
        found = simulate_in_engine(
            "pybullet", system, 0.0, 0.0, 2e-3, drive, timestep=1e-6, tuned_at=tuned_at
        )
        jump = np.abs(np.diff(found.resultant)).max()
        largest.append(float(jump / np.abs(found.resultant).max()))
    assert largest[0] < 0.05
    assert largest[1] > 0.1


def test_systems_that_an_engine_cannot_have_are_refused() -> None:
    with pytest.raises(UserError, match="the same law"):
        simulate_in_engine(
            "mujoco", VibroImpact(1.0, 1e-3, LAW, HuntCrossley(1e9, 0.1)), 0.0, 0.1, 0.01
        )
    with pytest.raises(UserError, match="the same law"):
        simulate_in_engine("mujoco", _system(1e-3, KelvinVoigt(1e6, 1.0)), 0.0, 0.1, 0.01)
    with pytest.raises(UserError, match="timestep: 0"):
        simulate_in_engine("mujoco", _system(1e-3), 0.0, 0.1, 0.01, timestep=0.0)
    with pytest.raises(UserError, match="tuned_at: -1"):
        simulate_in_engine("mujoco", _system(1e-3), 0.0, 0.1, 0.01, tuned_at=-1.0)
