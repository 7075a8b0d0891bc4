"""The table of errors at any α says what `tune` says, and knows where it does not."""

from __future__ import annotations

import math
import os
from random import Random
from typing import Any

import pytest

import hcbench
from hcbench.sim import registry
from hcbench.tuning import usual, usual_errors
from hcbench.tuning.usual_errors import Condition, errors_of

TABLE = errors_of(["mujoco", "pybullet"])
ALL = os.environ.get("HCBENCH_ANSWERS")
FEW = [
    each for each in TABLE if (each["timestep"], each["gravity"], each["band"]) == (2e-3, 0.0, [])
]
VERSIONS = usual.file_content()["versions"]
OTHERS = {
    engine: registry.require(engine) for engine in VERSIONS if registry.is_there(engine)
} != VERSIONS


@pytest.mark.skipif(OTHERS, reason="it is of other versions")
@pytest.mark.parametrize(
    "known", TABLE if ALL else FEW, ids=lambda known: f"{known['engine']}{known['band']}"
)
def test_a_row_and_the_plug_ins_band_are_those_of_tune(known: dict[str, Any]) -> None:
    condition, names = condition_of(known), known["names"]
    for alpha, *choices, _ in known["rows"] if ALL else known["rows"][4:5]:
        found = usual_errors.row(condition, alpha)
        for told, choice in zip(choices, found[1:], strict=True):
            assert (told and [names[told[0]], told[1]]) == (
                choice and [choice[0], approx(choice[1], 1e-2)]
            )
    assert usual_errors.lows(condition) == known["lows"]


@pytest.mark.skipif(OTHERS, reason="it is of other versions")
@pytest.mark.parametrize(
    "known", TABLE if ALL else FEW, ids=lambda known: f"{known['engine']}{known['band']}"
)
def test_an_error_of_one_e_between_rows_is_within_a_tenth_of_what_tune_finds(
    known: dict[str, Any],
) -> None:
    """At places that no row knows of: `make test-answers` asks ten of each condition."""
    rows, random = known["rows"], Random(f"{condition_of(known)}")
    told = [i for i in range(len(rows) - 1) if rows[i][3]]
    for i in random.sample(told, min(10, len(told)) if ALL else 1):
        share = random.uniform(0.05, 0.95)
        alpha = rows[i][0] * (rows[i + 1][0] / rows[i][0]) ** share
        constant = usual_errors.row(condition_of(known), alpha)[2]
        _, left, right = rows[i][3]
        assert left * (right / left) ** share == approx(constant[1], 0.1), alpha


def condition_of(known: dict[str, Any]) -> Condition:
    return Condition(*(known[name] for name in Condition._fields))


def approx(value: float, share: float) -> Any:
    return pytest.approx(value, rel=share)


def test_a_row_that_is_left_out_is_within_a_tenth_of_what_the_others_say() -> None:
    """So for all rows of the file: where they would not be, no error between rows is known."""
    told = 0
    for known in usual_errors.file_content():
        rows = known["rows"]
        for i in range(1, len(rows) - 1):
            line = usual_errors.line([*rows[:i], *rows[i + 1 :]], i - 1)
            if line is not None:
                told += 1
                share = math.log(rows[i][0] / rows[i - 1][0]) / math.log(
                    rows[i + 1][0] / rows[i - 1][0]
                )
                assert line[1] * (line[2] / line[1]) ** share == approx(rows[i][2][1], 0.1), (
                    known,
                    i,
                )
    assert told > 1500


def test_an_error_between_rows_is_known_only_where_all_around_lie_on_one_line() -> None:
    alphas = [0.1 * 1.1**i for i in range(usual_errors.AROUND)]
    smooth: list[list[Any]] = [[alpha, None, ["soft", 0.2 * alpha**0.5]] for alpha in alphas]
    ends = [pytest.approx(0.2 * alpha**0.5, rel=1e-3) for alpha in alphas[3:5]]
    assert usual_errors.line(smooth, 3) == ["soft", *ends]
    for i, (alpha, _, (_, error)) in enumerate(smooth):
        for other, told in (
            (["hard", error], ["hard or soft", *ends]),
            (["soft", 1.2 * error], None),
            (None, None),
        ):
            assert (
                usual_errors.line([*smooth[:i], [alpha, None, other], *smooth[i + 1 :]], 3) == told
            )


@pytest.mark.needs_engine("pybullet")
def test_slow_impacts_are_left_to_a_bullet_that_adds_a_steps_fall() -> None:
    """The faster e falls, the faster an impact must be for Bullet's plug-in to be exact."""
    lows = next(
        each["lows"]
        for each in TABLE
        if each["engine"] == "pybullet" and each["gravity"] and not each["band"]
    )
    assert [low for _, low in lows] == sorted(low for _, low in lows)
    alpha, low = lows[-1]
    answer = hcbench.tune("pybullet", timestep=1e-3, alpha=alpha, kind="exact")
    assert answer.best.speeds[0] == pytest.approx(low, rel=1e-3)
