"""The reasons of known failures, where a sentence there has numbers:
measured with the adapter itself.
"""

from __future__ import annotations

import copy
import runpy
from typing import Any

import pytest

from hcbench.cases.hcbench_cases import run
from hcbench.cases.run import adapters
from hcbench.cases.score import known_failures, the_cases


def normal_restitution(degrees: float, friction: float) -> float:
    """e of MuJoCo's ball without spin in the oblique case, at a step of 1/240 s."""
    oblique = copy.deepcopy(the_cases(["C05"]))
    (case,) = oblique["cases"]
    number = 3 * (15, 30, 45, 60, 75).index(int(degrees)) + 1
    case["runs"] = case["runs"][number : number + 1]
    world = case["runs"][0]["world"]
    world["friction"] = friction
    results: Any = run(runpy.run_path(str(adapters()["mujoco"]))["MujocoBodies"](), oblique)
    (done,) = results["runs"]["C05"]
    return float(-done["states"][-1][1][5] / world["bodies"][0]["velocity"][2])


@pytest.mark.parametrize(("degrees", "friction", "e"), [(45, 0.2, 0.47), (75, 0.05, 0.94)])
def test_mujocos_elliptic_cone_couples_friction_and_normal_force(
    degrees: float, friction: float, e: float
) -> None:
    assert normal_restitution(degrees, 0.0) == pytest.approx(0.80, abs=0.005)
    assert normal_restitution(degrees, friction) == pytest.approx(e, abs=0.01)
    assert f"{e:.2f}" in known_failures()["mujoco"]["C05"]
