"""Engines whose faults are built in get the verdicts that follow from them, and no others."""

from __future__ import annotations

import artificial_engines as artificial
import pytest

from hcbench.cases.hcbench_cases import judge, run
from hcbench.cases.score import the_cases

CASES = the_cases()
ONE_BALL = {"C01", "C02", "C03", "C09", "C10", "C11", "C16"}

# What each fails: by its construction, not by what it was measured to.
FAILS: list[tuple[type[artificial.OneBall], set[str]]] = [
    # Exact at the floor, wherever and whenever that is; one step of travel is nobody's fault.
    (artificial.Predictive, set()),
    (artificial.TwoStep, set()),
    # Exact too, a second step of travel deep in the floor.
    (artificial.Late, {"C16"}),
    # e (v + g h) from the place where the step began: a bounce at e = 1 gains 2 g h/v.
    (artificial.PredictiveAtTheEnd, {"C03"}),
    # A rebound of a fifth of the depth is added; slow impacts have wide limits.
    (artificial.Biased, {"C01", "C03", "C09", "C10", "C11"}),
    # The ball's weight presses a contact of 20 steps, at a speed of 4 steps of gravity, for good.
    (artificial.Soft, {"C02", "C03", "C16"}),
]


@pytest.mark.parametrize(("engine", "fails"), FAILS, ids=lambda each: getattr(each, "__name__", ""))
def test_a_verdict_is_that_of_the_fault_which_is_built_in(
    engine: type[artificial.OneBall], fails: set[str]
) -> None:
    verdicts = {each["case"]: each for each in judge(run(engine(), CASES), CASES)}
    ran = {case for case, each in verdicts.items() if each["verdict"] != "unsupported"}
    assert ran == ONE_BALL
    found = {case for case in ran if verdicts[case]["verdict"] != "pass"}
    assert found == fails, [verdicts[case]["why"] for case in found ^ fails]


@pytest.mark.parametrize("engine", [artificial.Predictive, artificial.Late, artificial.TwoStep])
def test_the_reading_is_exact_whenever_an_exact_engine_acts(
    engine: type[artificial.OneBall],
) -> None:
    for verdict in judge(run(engine(), CASES), CASES):
        if verdict["case"] in ("C01", "C10", "C11"):
            measured, true, _ = verdict["worst"]["restitution"]
            assert measured == pytest.approx(true, abs=1e-6)  # of states in nine digits


class Hovering(artificial.Predictive):
    """Stops a ball 20 mm above the floor, for good, as Box2D does; an earlier reading gave it 1.07."""

    def _meet(self, before: float) -> None:
        if self.z + self.v * self.h < self.touch + 0.02:
            self.v = 0.0


def test_a_ball_that_hovers_does_not_bounce() -> None:
    zero = the_cases(["C09"])
    (verdict,) = judge(run(Hovering(), zero), zero)
    assert verdict["verdict"] == "pass"
    assert verdict["worst"]["restitution"][0] == 0.0


class InASkin(artificial.Predictive):
    """Stops a ball, then moves it out of a skin of 5 mm without a velocity, as Box2D does."""

    def _meet(self, before: float) -> None:
        skin = self.touch + 0.005
        if self.z + self.v * self.h < skin:
            self.v = 0.0
            self.z += 0.2 * max(0.0, skin - self.z)


def test_what_moves_a_ball_out_of_a_skin_is_no_bounce() -> None:
    cases = the_cases(["C01", "C11"])
    for verdict in judge(run(InASkin(), cases), cases):
        assert verdict["worst"]["restitution"][0] == pytest.approx(0.0, abs=1e-6)


def test_an_engine_without_contacts_passes_no_case() -> None:
    verdicts = judge(run(artificial.FallsThrough(), CASES), CASES)
    assert {each["verdict"] for each in verdicts} == {"fail"}, verdicts


def test_a_body_that_ends_in_another_has_not_stopped_on_it() -> None:
    on_meshes = the_cases(["C17", "C18"])
    for verdict in judge(run(artificial.FallsThroughMeshes(), on_meshes), on_meshes):
        assert verdict["verdict"] == "fail"
        # It ends 100 mm under its touch, after a fall of 90 mm.
        assert verdict["worst"]["rise"][0] == pytest.approx(-10 / 9)
        assert verdict["why"].startswith("rise -1.111, not 0 within 0.02")


def test_a_ball_that_ends_under_the_floor_has_restitution_of_a_flight_that_went_on() -> None:
    zero = the_cases(["C09"])
    (verdict,) = judge(run(artificial.FallsThrough(), zero), zero)
    assert verdict["worst"]["restitution"][:2] == [-1.0, 0.0]
