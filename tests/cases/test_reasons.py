"""Reasons of known failures: what is named as the cause is removed in a run, and the case passes."""

from __future__ import annotations

import os
import runpy
import subprocess
from collections.abc import Callable
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from hcbench.cases.hcbench_cases import judge, run, run_apart
from hcbench.cases.score import adapters, known_failures, measured, the_cases

SUPPORT = Path(__file__).parents[1] / "support"
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


def rapier_with_one_point_of_contact(adapter: dict[str, Any]) -> type:
    best: Any = adapter["RapierBodies"]
    rapier = adapter["rapier"]

    class Middle:
        """Replaces the points of a contact by the one in their middle."""

        def modify_solver_contacts(self, contact: Any) -> None:
            if len(contact.solver_contacts) < 2:
                return
            first, *others = contact.solver_contacts
            points = [each.point for each in (first, *others)]
            x, y = (fmean(getattr(point, axis) for point in points) for axis in "xy")
            for _ in others:
                contact.remove_solver_contact(1)
            above, below = (x, y, first.point.z), (x, y, first.point.z - first.dist)
            contact.set_solver_contact(0, point=above, point2=below)

    class Cured(best):  # type: ignore[misc]
        def set_world(self) -> None:
            super().set_world()
            self.world.physics_hooks = Middle()

        def _insert(self, collider: Any, *others: Any) -> None:
            hooked = collider.active_hooks(rapier.ActiveHooks.MODIFY_SOLVER_CONTACTS)
            super()._insert(hooked, *others)

    return Cured


CURES: dict[tuple[str, str], Maker] = {
    ("rapier", "C05"): rapier_with_friction_of_the_rebound,
    ("rapier", "C06"): rapier_with_friction_of_the_rebound,
    ("rapier", "C08"): rapier_with_one_point_of_contact,
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


def test_two_alike_surfaces_of_dart_bounce_with_the_restitution_of_the_pair() -> None:
    pytest.importorskip("dartpy")
    adapter = runpy.run_path(str(adapters()["dart"]))
    cases = the_cases(["C11"])  # two balls of one restitution
    (verdict,) = judge(run(adapter["DartBodies"](), cases), cases)
    measured, true, _ = verdict["worst"]["restitution"]
    assert measured == pytest.approx(true, abs=1e-9)  # of states in nine digits


# Of the engines with an environment of their own: case, and place in ENGINES of tests/support/cured_*.
CURED: dict[tuple[str, str], int] = {
    ("newton-xpbd", "C03"): 0,
    ("newton-xpbd", "C04"): 1,
    ("newton-xpbd", "C05"): 3,
    ("newton-xpbd", "C06"): 2,
    ("newton-semiimplicit", "C04"): 4,
    ("newton-semiimplicit", "C09"): 5,
    ("newton-semiimplicit", "C17"): 5,
    ("newton-semiimplicit", "C18"): 5,
    ("newton-featherstone", "C04"): 6,
    ("newton-featherstone", "C09"): 7,
    ("newton-featherstone", "C17"): 7,
    ("newton-featherstone", "C18"): 7,
    ("physx", "C05"): 0,
}


@pytest.mark.slow
@pytest.mark.skipif("HCBENCH_ENGINES" not in os.environ, reason="by `make test-engines`")
@pytest.mark.parametrize(("engine", "case"), CURED)
def test_without_its_cause_a_case_passes_in_an_engine_from_the_index(
    engine: str, case: str
) -> None:
    package, *_ = engine.split("-")
    engines = Path(os.environ["HCBENCH_ENGINES"]) / "hcbench" / "engines"
    python = sorted(engines.glob(f"{package}@*/bin/python"))[-1]

    def start(arguments: list[str]) -> subprocess.CompletedProcess[str]:
        command = [str(python), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    cases = the_cases([case])
    cured = SUPPORT / f"cured_{package}.py"
    (verdict,) = judge(run_apart(cured, CURED[engine, case], cases, start), cases)
    assert verdict["verdict"] == "pass", verdict["why"]


def best_known(engine: str) -> str:
    """The engine's name without "-stock"."""
    return engine.removesuffix("-stock")


def test_every_cause_that_is_named_is_removed_in_a_test() -> None:
    known = known_failures()
    named = {
        (engine, case)
        for engine, reasons in known.items()
        for case, reason in reasons.items()
        if engine == best_known(engine) and reason != "Not known"
    }
    assert named == {*CURES, *CURED}


def test_stock_settings_are_the_cause_where_the_best_known_ones_pass() -> None:
    verdicts = {}
    for score in measured():  # the newest version of an engine is the last
        verdicts[score.engine] = {v["case"]: v["verdict"] for v in score.verdicts}
    known = known_failures()
    for engine in known:
        best = best_known(engine)
        for case, reason in known[engine].items():
            if engine != best:
                if verdicts[best][case] == "pass":
                    assert reason == "Stock settings: with the best known ones it passes"
                else:
                    assert reason == known[best][case], (engine, case)
