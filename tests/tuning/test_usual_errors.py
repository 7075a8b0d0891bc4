"""The table of errors at any α says what `tune` says, and knows where it does not."""

from __future__ import annotations

import os

import pytest

import hcbench
from hcbench.sim import registry
from hcbench.tuning import usual, usual_errors
from hcbench.tuning.usual_errors import Condition, errors_of

TABLE = errors_of(["mujoco", "pybullet"])
ALL = os.environ.get("HCBENCH_ANSWERS")
FEW = [each for each in TABLE if (each["timestep"], each["gravity"], each["band"]) == (2e-3, 0.0, [])]
VERSIONS = usual.file_content()["versions"]


@pytest.mark.skipif(
    {engine: registry.require(engine) for engine in VERSIONS} != VERSIONS, reason="it is of other versions"
)
@pytest.mark.parametrize(
    "known", TABLE if ALL else FEW, ids=lambda known: f"{known['engine']}{known['band']}"
)
def test_a_row_and_the_plug_ins_band_are_those_of_tune(known: dict[str, object]) -> None:
    condition = Condition(*(known[name] for name in Condition._fields))  # type: ignore[arg-type]
    table: dict[str, list[list[object]]] = known  # type: ignore[assignment]
    for row in table["rows"] if ALL else table["rows"][4:5]:
        found = usual_errors.row(condition, float(str(row[0])))
        for told, choice in zip(row[1:3], found[1:], strict=True):
            assert told == (choice and [choice[0], pytest.approx(choice[1], rel=1e-2)])
    assert usual_errors.lows(condition) == table["lows"]


def test_an_error_between_two_rows_is_known_only_of_one_setting() -> None:
    line = [[0.1, ["soft", 0.02], None], [0.2, ["soft", 0.03], None], [0.4, ["soft", 0.04], None]]
    kink = [line[0], [0.2, ["soft", 0.05], None], line[2]]
    other = [line[0], line[1], [0.4, ["hard", 0.04], None]]
    assert [usual_errors._joined(rows, 0) for rows in (line, kink, other)] == [
        [True, True],
        [False, True],
        [False, True],
    ]


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
