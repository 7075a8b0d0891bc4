"""Impacts read from poses: what was put into synthetic tosses is read from
them, and what the cube's say.
"""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest

from hcbench.reality import cube
from hcbench.reality.impacts import ImpactRead, read_impacts
from hcbench.reality.motion import Tosses
from hcbench.reality.study import twins
from hcbench.sim.toss import engines

WHOLE = pytest.mark.skipif(
    "HCBENCH_REALITY" not in os.environ, reason="make test-reality: all tosses"
)


@pytest.mark.parametrize(
    ("changes", "good"),
    [
        ({"u_e": 0.049}, True),
        ({"u_e": 0.051}, False),
        ({"second": 0.0051}, True),
        ({"second": 0.0049}, False),
        ({"frames_after": 3}, True),
        ({"frames_after": 2}, False),
    ],
)
def test_an_impact_is_good_if_its_e_is_known_and_one_vertex_was_struck(
    changes: dict[str, float], good: bool
) -> None:
    """Known to 0.05, from three frames after it, with the next vertex 5 mm above the plate."""
    read = ImpactRead(
        number=0, order=0, time=0.1, speed_in=1.0, speed_out=0.3, e=0.3, u_e=0.01, friction=0.2,
        u_friction=0.01, slip=0.5, duration=0.01, second=0.02, frames_after=8,
        chi_square=1.0, energy_lost=0.5,
    )  # fmt: skip
    assert replace(read, **changes).good == good  # type: ignore[arg-type]


def first(tosses: Tosses) -> list[ImpactRead]:
    """Good impacts that end a toss' first flight."""
    return [
        each for each in read_impacts(tosses.body, tosses.motions) if each.good and each.order == 0
    ]


def synthetic(e: float, tosses: Tosses, timestep: float) -> list[ImpactRead]:
    """Impacts read from what an exact plug-in simulates."""
    module = dict(engines())["mujoco"]
    setting = next(each for each in module.SETTINGS if each.key == "plug-in constant e, elliptic")
    made = twins(module, tosses.body, setting, (e, 0.18), tosses.motions, timestep)
    return first(Tosses(tosses.body, made))


@pytest.mark.spec_plugins
def test_the_reading_returns_the_e_and_the_friction_of_a_simulation() -> None:
    impacts = synthetic(0.2, cube.cases((0,)).of(lambda each: each.number % 30 == 0), 1e-4)
    assert np.median([each.e for each in impacts]) == pytest.approx(0.2, abs=0.003)
    assert np.median([each.chi_square for each in impacts]) == pytest.approx(1.0, abs=0.3)
    # Where a slip ends or turns within the contact, less acts against its first direction.
    assert np.percentile([each.friction for each in impacts], 90) == pytest.approx(0.18, abs=0.01)


def test_e_of_the_cube() -> None:
    """e of every third toss; e of all of them is 0.248."""
    tosses = cube.cases((0, 1, 2, 3)).of(lambda each: each.number % 3 == 0)
    impacts = first(tosses)
    assert np.median([each.e for each in impacts]) == pytest.approx(0.245, abs=0.015)
    assert np.median([each.friction for each in impacts if each.slip > 0.3]) == pytest.approx(
        0.176, abs=0.01
    )


@WHOLE
def test_e_of_all_tosses() -> None:
    impacts = first(cube.cases((0, 1, 2, 3)))
    assert np.median([each.e for each in impacts]) == pytest.approx(0.245, abs=0.01)
    spread = np.std([each.e for each in impacts])
    assert spread > 3 * np.median([each.u_e for each in impacts])


@WHOLE
@pytest.mark.parametrize("e", [0.2, 0.3])
def test_the_reading_of_many_synthetic_tosses(e: float) -> None:
    impacts = synthetic(e, cube.cases((0,)), 1e-4)
    assert np.median([each.e for each in impacts]) == pytest.approx(e, abs=0.003)
