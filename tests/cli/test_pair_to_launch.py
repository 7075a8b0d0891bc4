"""The pair that a list of pairs says to measure next."""

from dataclasses import replace

from hcbench.cli.check import _to_launch
from hcbench.sim.model_under_test import CandidatePair

LEGS = CandidatePair(
    bodies=("shin", "foot"),
    geoms=("shin", "foot"),
    types=("capsule", "capsule"),
    pair="shin,foot",
    joint="hinge",
    effective_mass=60.0,
    distance=0.09,
    touching=False,
)
FLOOR = replace(LEGS, bodies=("foot", "world"), pair="foot,floor", distance=0.2)


def test_a_foot_over_the_floor_comes_before_two_legs() -> None:
    assert _to_launch([LEGS, FLOOR]) is FLOOR


def test_what_touches_comes_first() -> None:
    touching = replace(LEGS, touching_in=("stand",))
    assert _to_launch([touching, FLOOR]) is touching


def test_without_a_mass_the_first_is_taken() -> None:
    one = replace(LEGS, effective_mass=float("nan"))
    assert _to_launch([one, one]) is one
    assert _to_launch([one, FLOOR]) is FLOOR
