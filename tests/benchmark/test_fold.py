"""Summaries of impacts on a page do not depend on the parts in which they are read, nor grow with
them.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from hcbench import scoring
from hcbench.benchmark.results import FOLDED, MOST_SPEEDS, Folded, Folder
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley

LAW, MASS = HuntCrossley(stiffness=3.4064e10, alpha=0.315, exponent=1.5), 0.45359237
PHASES = 4


def study(speeds: np.ndarray) -> dict[str, Any]:
    step_speed = float(speeds[len(speeds) // 2])
    about = {"mass_kg": MASS, "step_speed": step_speed, "phases": PHASES, "runs": []}
    return {**about, "speeds": speeds.tolist()}


def impacts(speeds: np.ndarray) -> dict[str, np.ndarray]:
    """Impacts by the law but for 0.001 of e from phase to phase; the slowest comes to rest, the
    fastest is lost.
    """
    asked, phase = (
        np.repeat(speeds, PHASES),
        np.tile((np.arange(PHASES) + 0.5) / PHASES, len(speeds)),
    )
    law = closed_form.restitution(LAW.alpha, asked)
    status = np.full(len(asked), "parted", dtype=object)
    status[:PHASES], status[-PHASES:] = "rested", "diverged"
    e = np.where(status == "parted", law + 1e-3 * phase, 0.0)
    e[-PHASES:] = np.nan
    samples = np.full(len(asked), 7)
    columns = (asked, phase, status, asked, e, law, 1e-4 * asked, samples)
    return dict(zip(FOLDED, columns, strict=True))


def folded(speeds: np.ndarray, parts: int) -> Folded:
    folder, columns = Folder(study(speeds)), impacts(speeds)
    place = folder.place(columns["speed_m_per_s"])
    cuts = np.flatnonzero(np.r_[True, place[1:] != place[:-1]])
    for own in np.array_split(np.arange(len(cuts)), parts):
        begin, end = cuts[own[0]], cuts[own[-1] + 1] if own[-1] + 1 < len(cuts) else len(place)
        folder.add({name: values[begin:end] for name, values in columns.items()})
    return folder.folded()


@pytest.mark.parametrize("count", [12, 3 * MOST_SPEEDS])
def test_impacts_fold_the_same_in_parts_and_at_once(count: int) -> None:
    speeds = np.linspace(0.01, 1.0, count)
    np.testing.assert_equal(asdict(folded(speeds, 5)), asdict(folded(speeds, 1)))


def test_a_curve_has_each_speed_and_the_range_over_its_phases() -> None:
    speeds = np.linspace(0.01, 1.0, 12)
    one = folded(speeds, 1)
    assert (dict(one.status), len(one)) == ({"rested": 4, "parted": 40, "diverged": 4}, 48)
    assert one.curve.speed == pytest.approx(speeds, rel=1e-15)
    assert one.curve.highest[1:-1] - one.curve.lowest[1:-1] == pytest.approx(0.75e-3, abs=1e-9)
    assert np.isnan(one.curve.restitution[-1])
    assert len(one.curve.measured()) == 11
    assert one.off_parted == pytest.approx(0.875e-3, abs=1e-9)
    assert one.rested == speeds[0]
    assert one.depth == pytest.approx(1e-4)


def test_of_more_speeds_than_a_page_can_show_neighbours_are_one_with_the_largest_error_of_all() -> (
    None
):
    one = folded(np.linspace(0.01, 1.0, 3 * MOST_SPEEDS), 1)
    assert len(one.curve) == MOST_SPEEDS
    assert np.nanmax(np.abs(one.curve.worst_phase[1:])) == pytest.approx(0.875e-3, abs=1e-9)
    assert len(one) == 3 * MOST_SPEEDS * PHASES


def test_a_score_in_parts_is_that_of_all_at_once() -> None:
    speeds = np.linspace(0.01, 1.0, 40)
    columns = impacts(speeds)
    e, asked = columns["restitution"], columns["speed_m_per_s"]
    measured = scoring.Measured(
        speed=asked,
        launch=np.repeat(np.arange(len(speeds)), PHASES),
        parted=columns["status"] == "parted",
        rested=columns["status"] == "rested",
        speed_in=asked,
        e=e,
        energy_lost=1 - e**2,
        samples=columns["samples"],
        gained=False,
    )
    scores = []
    for parts in (1, 4):
        tally = scoring.Tally(LAW, MASS)
        for rows in np.array_split(np.arange(len(e)), parts):
            fields = {
                name: getattr(measured, name) for name in scoring.Measured.__dataclass_fields__
            }
            tally.add(
                scoring.Measured(**{n: v if n == "gained" else v[rows] for n, v in fields.items()})
            )
        scores.append({n: v for n, v in asdict(tally.score()).items() if v is not None})
    whole, in_parts = scores
    assert in_parts == pytest.approx(whole, rel=1e-7, nan_ok=True)
    assert math.isclose(whole["alpha_fit"], LAW.alpha, rel_tol=0.05)
