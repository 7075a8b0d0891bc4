"""A text of `tune pybullet`, pasted into worlds of others, keeps its promise, or `measure` names
what broke it.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from long_searches import LONG
from pasted_into_bullet import FACTORS, bounces, pair_of, script_of, strangers

import hcbench
from hcbench.system.errors import HcbenchError

if TYPE_CHECKING:
    from pathlib import Path

    from hcbench.tuning.answer import Choice

pytestmark = [pytest.mark.needs_engine("pybullet"), pytest.mark.usefixtures("tuned_once")]
# The first 13 rows of the design have every level; a plain run takes the first of them.
WORLDS, EVERY_LEVEL = 80 if LONG else 4, 13
STEP = "1 ms"
LAUNCHES = [(share, phase) for share in (0.1, 0.5, 1.0) for phase in (0.15, 0.65)]


@cache
def choices() -> tuple[Choice, ...]:
    question: dict[str, Any] = {"timestep": STEP, "speeds": "0.1:0.5 m/s"}
    falling = hcbench.tune("pybullet", alpha=0.3, kind="exact", **question)
    one_e = hcbench.tune("pybullet", restitution=0.7, kind="constant", **question)
    return falling.choices[0], one_e.choices[-1]


def launches_of(choice: Choice) -> list[tuple[float, float]]:
    low, high = choice.speeds
    return [(low + share * (high - low), phase) for share, phase in LAUNCHES]


def says_why(script: Path, row: dict[str, Any], choice: Choice) -> bool:
    """True where `measure` refuses the world or names a cause."""
    low, high = choice.speeds
    speeds = f"{low}:{high}:3 m/s"
    try:
        measured = hcbench.measure(f"{script}:build", pair_of(row), speeds=speeds, rest=False)
    except HcbenchError:
        return True
    return bool(measured.causes)


def test_a_pasted_text_keeps_its_promise_or_measure_says_what_broke_it(tmp_path: Path) -> None:
    cases = [(row, choice) for row in strangers(WORLDS) for choice in choices()]
    launches = {id(choice): launches_of(choice) for choice in choices()}
    given = [
        (script_of(row, choice.text), row["gravity"], launches[id(choice)]) for row, choice in cases
    ]
    silent, kept = [], 0
    for (row, choice), (script, _, tried), e in zip(
        cases, given, bounces(given, tmp_path), strict=True
    ):
        # The text itself refuses bodies for which it was not written.
        if e is None:
            assert row["coordinates"] == "reduced" and choice.kind == "constant"
            continue
        assert choice.promise is not None
        error = np.abs(np.array(e) - [float(choice.promise.curve.at(v)) for v, _ in tried]).max()
        if error <= 1.25 * choice.max_error + 0.005:
            kept += 1
            continue
        world = tmp_path / "world.py"
        world.write_text(script)
        if not says_why(world, row, choice):
            silent.append((choice.kind, row, float(error)))
    print(f"{len(cases)} pastes, {kept} keep their promise, {len(silent)} break it silently")
    assert silent == []


def test_the_worlds_have_each_level_of_each_factor() -> None:
    rows = strangers(EVERY_LEVEL)
    for factor, levels in FACTORS.items():
        assert {row[factor] for row in rows} == set(levels)
