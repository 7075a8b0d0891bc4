"""The table of errors at any α says what `tune` says, and knows where it does not."""

from __future__ import annotations

import os
from itertools import pairwise
from random import Random
from typing import Any

import pytest

import hcbench
from hcbench.sim import registry
from hcbench.tuning import usual, usual_errors
from hcbench.tuning.usual_errors import Condition, errors_of

TABLE = errors_of(["mujoco", "pybullet"])
ALL = os.environ.get("HCBENCH_ANSWERS")
FEW = [each for each in TABLE if (each["timestep"], each["gravity"], each["band"]) == (2e-3, 0.0, [])]
VERSIONS = usual.file_content()["versions"]


OTHERS = {engine: registry.require(engine) for engine in VERSIONS} != VERSIONS


@pytest.mark.skipif(OTHERS, reason="it is of other versions")
@pytest.mark.parametrize(
    "known", TABLE if ALL else FEW, ids=lambda known: f"{known['engine']}{known['band']}"
)
def test_a_row_and_the_plug_ins_band_are_those_of_tune(known: dict[str, Any]) -> None:
    condition, names = condition_of(known), known["names"]
    for alpha, *choices, _, _ in known["rows"] if ALL else known["rows"][4:5]:
        found = usual_errors.row(condition, alpha)
        for told, choice in zip(choices, found[1:], strict=True):
            assert (told and [names[told[0]], told[1]]) == (choice and [choice[0], approx(choice[1], 1e-2)])
    assert usual_errors.lows(condition) == known["lows"]


@pytest.mark.skipif(OTHERS, reason="it is of other versions")
@pytest.mark.parametrize(
    "known", TABLE if ALL else FEW, ids=lambda known: f"{known['engine']}{known['band']}"
)
def test_an_error_between_rows_is_within_a_tenth_of_what_tune_finds(known: dict[str, Any]) -> None:
    """At places that no row knows of: `make test-answers` asks ten of each condition."""
    rows, random = known["rows"], Random(f"{condition_of(known)}")
    told = [i for i in range(len(rows) - 1) if rows[i][3] or rows[i][4]]
    for i in random.sample(told, min(10, len(told)) if ALL else 1):
        share = random.uniform(0.05, 0.95)
        alpha = rows[i][0] * (rows[i + 1][0] / rows[i][0]) ** share
        found = usual_errors.row(condition_of(known), alpha)
        for line, choice in zip(rows[i][3:], found[1:], strict=True):
            if line is not None:
                assert choice is not None, alpha
                assert line[1] * (line[2] / line[1]) ** share == approx(choice[1], 0.1), alpha


def condition_of(known: dict[str, Any]) -> Condition:
    return Condition(*(known[name] for name in Condition._fields))


def approx(value: float, share: float) -> Any:
    return pytest.approx(value, rel=share)


def test_an_error_is_told_only_where_all_rows_around_lie_on_one_line() -> None:
    alphas = [0.1 * 1.1**i for i in range(usual_errors.AROUND)]
    smooth: list[list[Any]] = [[alpha, ["soft", 0.2 * alpha**0.5], None] for alpha in alphas]
    told = usual_errors.line(smooth, 3, 1)
    assert told == ["soft", *(pytest.approx(0.2 * alpha**0.5, rel=1e-3) for alpha in alphas[3:5])]
    for i in range(len(smooth)):
        other = [*smooth[:i], [alphas[i], ["hard", smooth[i][1][1]], None], *smooth[i + 1 :]]
        assert usual_errors.line(other, 3, 1) == ["hard or soft", *told[1:]]
        far = [*smooth[:i], [alphas[i], ["soft", 1.2 * smooth[i][1][1]], None], *smooth[i + 1 :]]
        assert usual_errors.line(far, 3, 1) is None
        assert usual_errors.line([*smooth[:i], [alphas[i], None, None], *smooth[i + 1 :]], 3, 1) is None
    assert usual_errors.line(smooth, 3, 2) is None


def test_what_is_told_between_two_rows_lies_near_both() -> None:
    for known in TABLE:
        for left, right in pairwise(known["rows"]):
            for kind, told in enumerate(left[3:], 1):
                for error, end in zip(told[1:] if told else (), (left[kind], right[kind]), strict=bool(told)):
                    assert error == approx(end[1], usual_errors.NEAR + 5e-3)
                    assert known["names"][end[0]] in known["names"][told[0]].split(" or ")


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
