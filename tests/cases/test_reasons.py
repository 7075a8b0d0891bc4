"""Reasons of known failures: what is named as the cause is removed in a run, and the case passes."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from typing import Any

import pytest

from hcbench.cases.hcbench_cases import judge, run
from hcbench.cases.run import adapters
from hcbench.cases.score import known_failures, measured, the_cases

# Of the engines in the development environment; each maker changes one thing of an adapter.
Maker = Callable[[dict[str, Any]], type]


def rapier_with_friction_of_the_rebound(adapter: dict[str, Any]) -> type:
    best: Any = adapter["RapierBodies"]

    class Cured(best):  # type: ignore[misc]
        """Friction times 1 + e: its limit is then that of the whole normal impulse."""

        def make(self, world: dict[str, Any]) -> None:
            super().make({**world, "friction": world["friction"] * (1 + world["restitution"])})

    return Cured


def dart_without_the_gravity_of_a_step(adapter: dict[str, Any]) -> type:
    best: Any = adapter["DartBodies"]

    class Cured(best):  # type: ignore[misc]
        """Before each step e v/(v + g h) in place of e: the rebound is then e v."""

        def make(self, world: dict[str, Any]) -> None:
            super().make(world)
            self.e = world["restitution"]
            *_, gravity_z = world["gravity"]
            self.gained = -gravity_z * world["timestep"]

        def step(self) -> None:
            (ball, _), *_ = self.moving
            fall = -ball.getLinearVelocity()[2] / self.length
            share = self.e * fall / (fall + self.gained) if fall > 0 else 0.0
            shape, *_ = ball.getShapeNodes()
            # The floor's restitution is the root of e = 1; mixing lowers each bounce by 1e-5.
            shape.getDynamicsAspect().setRestitutionCoeff((1 + share) * (1 + 1e-5) - 1)
            super().step()

    return Cured


def exudyn_with_a_contact_of_one_step(adapter: dict[str, Any]) -> type:
    best: Any = adapter["ExudynBodies"]

    class Cured(best):  # type: ignore[misc]
        """Twenty steps of the solver in one: its contact of 20 steps lasts one of the world."""

        def make(self, world: dict[str, Any]) -> None:
            super().make({**world, "timestep": world["timestep"] / 20})

        def step(self) -> None:
            for _ in range(20):
                super().step()

    return Cured


CURES: dict[tuple[str, str], Maker] = {
    ("rapier", "C06"): rapier_with_friction_of_the_rebound,
    ("dart", "C03"): dart_without_the_gravity_of_a_step,
    ("exudyn", "C02"): exudyn_with_a_contact_of_one_step,
    ("exudyn", "C16"): exudyn_with_a_contact_of_one_step,
}


@pytest.mark.parametrize(("engine", "case"), CURES)
def test_without_its_cause_a_case_passes(engine: str, case: str) -> None:
    pytest.importorskip({"dart": "dartpy", "rapier": "rapier3d"}.get(engine, engine))
    adapter = runpy.run_path(str(adapters()[engine]))
    cases = the_cases([case])
    (verdict,) = judge(run(CURES[engine, case](adapter)(), cases), cases)
    assert verdict["verdict"] == "pass", verdict["why"]


HERE = ("mujoco", "pybullet", "drake", "dart", "exudyn", "rapier")


def test_every_cause_that_is_named_is_removed_in_a_test() -> None:
    for engine in HERE:
        for case, reason in known_failures().get(engine, {}).items():
            assert ((engine, case) in CURES) != reason.startswith("Not known"), (engine, case)


def test_stock_settings_are_the_cause_where_the_best_known_ones_pass() -> None:
    verdicts = {}
    for score in measured():  # the newest version of an engine is the last
        verdicts[score.engine] = {v["case"]: v["verdict"] for v in score.verdicts}
    for engine, known in known_failures().items():
        best = engine.removesuffix("-stock")
        for case, reason in known.items():
            if engine != best:
                passes = verdicts[best][case] == "pass"
                assert passes == reason.startswith("Stock settings"), (engine, case)
