"""The true values of the cases by another route, and the readings that judge them."""

from __future__ import annotations

import copy
import hashlib
from typing import Any

import pytest
from ideal_engine import Ideal

from hcbench.cases.hcbench_cases import judge, run
from hcbench.cases.make import FILE, text
from hcbench.cases.score import EngineScore, score, the_cases

CASES = the_cases()
MEASURED = "C06"  # whose truth is a measurement: the other route is that of rigid bodies
NEAR = {"C01": 0.0025, "C10": 0.0025, "C11": 0.0025}  # a spring and damper in 600 steps
IDS = [case["id"] for case in CASES["cases"]]


@pytest.fixture(scope="module")
def ideal() -> dict[str, Any]:
    return run(Ideal(), CASES)


FROZEN = "f788df919b46dd6c71f6232cbda7e2fd6566524ee567a979049b38f3d1e02959"


def test_the_file_is_what_its_maker_writes_and_what_was_frozen() -> None:
    assert FILE.read_text(encoding="utf-8") == text()
    digest = hashlib.sha256(text().encode()).hexdigest()
    assert digest == FROZEN, "a better case comes in the next set: docs/reference/cases-history.md"


@pytest.mark.parametrize("number", range(len(IDS)), ids=IDS)
def test_impacts_that_are_integrated_come_to_the_true_values(
    ideal: dict[str, Any], number: int
) -> None:
    verdict = judge(ideal, CASES)[number]
    assert verdict["verdict"] == "pass", verdict["why"]
    for measured, true, _ in verdict["worst"].values():
        assert measured == pytest.approx(
            true, abs=0.0125 if IDS[number] == MEASURED else NEAR.get(IDS[number], 1e-3)
        )


@pytest.fixture
def spoilt(ideal: dict[str, Any]) -> dict[str, Any]:
    return copy.deepcopy(ideal)


def scored(results: dict[str, Any]) -> EngineScore:
    return score(results)


def test_an_engine_without_an_error_obeys(ideal: dict[str, Any]) -> None:
    assert scored(ideal).restitution == "obeyed"
    assert scored(ideal).threshold == 0.0
    assert scored(ideal).passed == len(IDS)


def replace_runs(results: dict[str, Any], make: type[Ideal]) -> dict[str, Any]:
    normal_and_slow = {**CASES, "cases": CASES["cases"][:2]}
    results["runs"].update(run(make(), normal_and_slow)["runs"])
    return results


class WithThreshold(Ideal):
    """Restitution 0 for impacts slower than 0.2 m/s."""

    def _collide(self, a: int, b: int) -> None:
        was = self.ratio, self.e
        if abs(self.v[a][2]) < 0.2:
            self.e = 0.0
        super()._collide(a, b)
        self.ratio, self.e = was


class WithoutRestitution(Ideal):
    """Every ball parts at 0.6."""

    def make(self, world: dict[str, Any]) -> None:
        super().make({**world, "restitution": 0.6})


class WithLittleRestitution(Ideal):
    """Parts at 0.5 to 0.6, by a tenth of what is asked for: wrong, but no
    number that makes no difference.
    """

    def make(self, world: dict[str, Any]) -> None:
        super().make({**world, "restitution": 0.5 + 0.1 * world["restitution"]})


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (WithThreshold, "threshold"),
        (WithoutRestitution, "ignored"),
        (WithLittleRestitution, "mixed"),
    ],
)
def test_how_restitution_is_obeyed_has_a_word(
    spoilt: dict[str, Any], make: type[Ideal], word: str
) -> None:
    found = scored(replace_runs(spoilt, make))
    assert found.restitution == word
    if word == "threshold":
        assert 0.1 < found.threshold < 0.2
    assert found.verdicts[0]["verdict"] == "fail"
