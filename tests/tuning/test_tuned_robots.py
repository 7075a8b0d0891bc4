"""Robots that others wrote: no setting of their feet that is handed out lands worse, and a refusal
names the largest rebound.

`make test-models` tunes them all and writes the table of docs/reference/robots.md.
"""

from __future__ import annotations

import pytest
import robot_drops
from outside_models import outside
from robot_landings import QUADRUPED
from tuned_robots import (
    PAGE,
    TARGETS,
    TUNED,
    Answer,
    answer,
    counted,
    is_chance,
    on_the_page,
    row,
    write_page,
)

import hcbench as hb
from hcbench.sim.landing import WITHIN

# Some models use settings that later versions of MuJoCo drop.
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
MOST_CPU = 20.0  # s


def require_no_worse(found: Answer) -> None:
    """Assert that an answer has the target and nothing worse, or that it is a refusal: with the
    largest rebound, or for chance alone.
    """
    change = found.tuned.landing
    assert change is not None
    if not found.tuned.gains:
        assert change.reach is not None or is_chance(found)
        return
    assert not change.worse
    assert abs(change.after.rebound - found.target) <= max(WITHIN * found.target, 1e-3)


@outside
def test_robots_of_packages_land_no_worse_on_tuned_feet() -> None:
    answers = [answer(robot, target) for robot in TUNED for target in TARGETS]
    write_page(answers)
    for found in answers:
        require_no_worse(found)
        assert found.target or found.tuned.gains, found.robot


@pytest.mark.usefixtures("tuned_once")
def test_the_page_has_each_robot_and_says_what_the_readmes_quadruped_does() -> None:
    shown = [(line["robot"].removesuffix(" (falls)"), line["target, mm"]) for line in on_the_page()]
    assert shown == [(robot.name, f"{1e3 * target:g}") for robot in TUNED for target in TARGETS]
    tuned = hb.tune_model(robot_drops.QUADRUPED, robot_drops.FEET, rebound=20e-3)
    found = Answer(QUADRUPED, 20e-3, tuned, cpu=0.0)
    require_no_worse(found)
    line = next(each for each in on_the_page() if each["target, mm"] == "20")
    # The CPU time, which is last, is another on every machine.
    assert row(found)[:-1] == list(line.values())[:-1]


def test_the_page_says_how_many_robots_and_answers_it_has() -> None:
    assert counted(on_the_page()) in PAGE.read_text(encoding="utf-8")
    assert len(TUNED) * len(TARGETS) == len(on_the_page())


def test_the_page_refuses_or_has_the_rebound() -> None:
    for line in on_the_page():
        target, after = float(line["target, mm"]), float(line["rebound, mm"].split("/")[1])
        if line["answer"] == "refused":
            assert line["largest, mm"]
        else:
            assert abs(after - target) <= max(WITHIN * target, 1.0) + 0.05
        assert float(line["CPU s"]) <= MOST_CPU
