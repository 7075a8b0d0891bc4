"""Robots that land on feet of MuJoCo's restitution plug-in, beside native contact.

`make test-models` lets those of other packages land, too, and writes the
table of docs/reference/plugins.md.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import mujoco
import numpy as np
import pytest
from gain_tables import on_the_page, write_table
from outside_models import outside
from robot_landings import (
    GRAVITY,
    HEIGHTS,
    LAWS,
    QUADRUPED,
    ROBOTS,
    Drop,
    Landings,
    compiled,
    feet_of,
    land,
    released,
)

from hcbench.contact.mujoco import ConstantRestitution

# Some models use settings that later versions of MuJoCo drop.
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

TABLE = "landings"
HEAD = (
    "robot, step",
    "drops",
    "named",
    "fall",
    "deeper, mm",
    "gain, %",
    "do not rest",
    "further at e up to 0.3, mm",
    "further, mm",
)


def require_what_the_page_says(found: Landings, name: str) -> None:
    """Assert the page's limits of all landings, and the claim of those
    that the plug-in does not name.
    """
    said, shown = on_the_page(TABLE)[found.label(name)], found.row(name)[1:]
    for column in range(3, 8):
        assert float(shown[column]) <= float(said[column]), (name, HEAD[column + 1])
    quiet = [i for i, named in enumerate(found.named()) if not named]
    assert all(found.deeper()[i] < 1e-3 for i in quiet), name
    assert all(found.own[i].gain < 1e-3 for i in quiet), name
    assert not any(found.restless()[i] for i in quiet), name


@outside
def test_robots_of_packages_land_as_on_native_contact_or_are_named() -> None:
    """Those that are named land again at the step that the warning names."""
    every = []
    for robot in ROBOTS:
        every.append((robot.name, Landings.of(robot, LAWS, phases=2, seconds=4.0)))
        if (step := every[-1][1].advised()) is not None:
            every.append((robot.name, Landings.of(robot, LAWS, phases=2, seconds=4.0, step=step)))
    rows = [found.row(name) for name, found in every]
    write_table(TABLE, [f"| {' | '.join(cells)} |" for cells in (HEAD, ["---"] * len(HEAD), *rows)])
    for name, found in every:
        require_what_the_page_says(found, name)


def travels_of_ant(model: Any) -> list[float]:
    """Distances from the start at which an ant ends after 12 drops with a tilted base, mm."""
    found = []
    for height, phase in itertools.product(HEIGHTS, (0.0, 0.25, 0.5, 0.75)):
        data = released(model, Drop(height, phase, tilt=5.0))
        start = data.subtree_com[0, :2].copy()
        mujoco.mj_step(model, data, nstep=round(4.0 / model.opt.timestep))
        mujoco.mj_comPos(model, data)
        found.append(1e3 * float(np.linalg.norm(data.subtree_com[0, :2] - start)))
    return found


@outside
def test_an_ant_that_hops_travels_on_springy_native_contact_as_well() -> None:
    """No further with the law; and no less at a finer step. Where hops
    lead is by chance, so that another processor has other numbers.
    """
    ant = next(robot for robot in ROBOTS if robot.name == "gymnasium ant")
    dull, springy = compiled(ant, None, 2.5e-3), compiled(ant, None, 0.5e-3)
    feet = feet_of(ant, springy)
    springy.geom_solref[feet], springy.geom_priority[feet] = (-20000.0, -8.0), 1
    springy.geom_solimp[feet] = (0.99, 0.99, 0.001, 0.5, 2.0)
    assert max(travels_of_ant(dull)) < 25.0
    farthest = max(travels_of_ant(springy))
    for step in (2.5e-3, 0.5e-3):
        hops = travels_of_ant(compiled(ant, ConstantRestitution(0.9), step))
        assert 50.0 < max(hops) < 150.0 < farthest


def forward_of_doggo(step: float, friction: float) -> float:
    """Way ahead of a doggo with e = 0.9 after a flat drop from 10 cm, mm."""
    doggo = next(robot for robot in ROBOTS if robot.name == "safety_gymnasium doggo")
    model = compiled(doggo, ConstantRestitution(0.9), step)
    model.geom_friction[:, 0] = friction
    data = released(model, Drop(height=0.1, phase=0.0, tilt=0.0))
    start = float(data.subtree_com[0, 0])
    mujoco.mj_step(model, data, nstep=round(4.0 / step))
    mujoco.mj_comPos(model, data)
    return 1e3 * (float(data.subtree_com[0, 0]) - start)


@outside
def test_a_doggo_is_thrown_forward_by_its_shins_which_slope_the_same_way() -> None:
    """At any step. Without friction its feet cannot push it: Euler's steps alone move it."""
    assert all(80.0 < forward_of_doggo(step, 1.0) < 95.0 for step in (2.5e-3, 0.5e-3))
    assert abs(forward_of_doggo(0.5e-3, 0.0)) < 5.0


def test_the_readmes_quadruped_lands_as_the_page_says() -> None:
    require_what_the_page_says(Landings.of(QUADRUPED, LAWS, phases=1, seconds=2.0), QUADRUPED.name)


@pytest.mark.parametrize("options", [{}, {"integrator": 2}, {"solver": 0, "cone": 1}])
def test_feet_that_slide_do_not_sink(options: dict[str, Any]) -> None:
    """They go in by what they travel down in a step until they touch, and then stay there.

    MuJoCo's cones part what slides, and what the servos change of the slip
    is not known before the solver.
    """
    model = compiled(QUADRUPED, LAWS[0])
    for option, value in options.items():
        setattr(model.opt, option, value)
    landing = land(model, QUADRUPED, Drop(height=0.05, phase=0.0, tilt=0.0, along=1.0), 1.5)
    assert landing.depth < math.sqrt(2 * GRAVITY * 0.05) * model.opt.timestep
    assert landing.stands


def test_the_page_has_each_robot() -> None:
    names = {label.rpartition(",")[0] for label in on_the_page(TABLE)}
    assert names == {robot.name for robot in ROBOTS}


def test_robots_that_hardly_bounce_travel_no_more_than_the_page_says() -> None:
    """But for those that fall over on native contact."""
    rows = on_the_page(TABLE).values()
    assert max(float(cells[6]) for cells in rows if cells[2] == "0") == 22
