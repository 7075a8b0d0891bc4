"""Columns of launches and impacts say to the last bit what their objects say."""

from __future__ import annotations

import dataclasses
import math
import pickle
from typing import TYPE_CHECKING

import numpy as np
import pytest

from hcbench.sim.columns import Impacts, Launches
from hcbench.terms.impact import Impact, Launch, Status, Trajectory

if TYPE_CHECKING:
    from collections.abc import Sequence

SENT = [
    Launch(0.3, 0.1),
    Launch(0.0, 0.9, 0.02),
    Launch(2.0, 0.5, 0.0),
    Launch(1.0, 0.2, None, (0.5, -0.1), (0.0, 3.0, 1.0)),
]


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_launches_are_those_of_their_objects(gravity: float) -> None:
    columns = Launches.of(SENT)
    for name in ("touch_speed", "flight_time"):
        ours = getattr(columns, name)(1e-3, gravity).tolist()
        assert ours == [getattr(launch, name)(1e-3, gravity) for launch in SENT]
    assert columns.clearance(1e-3).tolist() == [launch.clearance(1e-3) for launch in SENT]
    assert columns.is_oblique.tolist() == [launch.is_oblique for launch in SENT]
    assert list(columns) == SENT
    assert columns[1:3][-1] == SENT[2]
    assert list(pickle.loads(pickle.dumps(columns))) == SENT


@pytest.mark.parametrize(("gravity", "steps_most"), [(0.0, 2.0), (9.81, 2.0), (9.81, math.inf)])
def test_launches_that_are_to_touch_at_a_speed_are_those_of_their_objects(
    gravity: float, steps_most: float
) -> None:
    rng = np.random.default_rng(5)
    speeds, phases, slips = rng.uniform(1e-3, 1.0, (3, 200))
    spin = (0.0, 2.0, 0.0)
    columns = Launches.touching(speeds, phases, 1e-2, gravity, slips, spin, steps_most, 0.5)
    rows = zip(speeds.tolist(), phases.tolist(), slips.tolist(), strict=True)
    each = [
        Launch.touching(v, p, 1e-2, gravity, (s, 0.0), spin, steps_most, 0.5) for v, p, s in rows
    ]
    assert list(columns) == each


def test_impacts_are_those_of_their_objects() -> None:
    loop = Trajectory(*np.arange(12.0).reshape(4, 3))
    impacts = [
        Impact(SENT[0], Status.PARTED, "", 0.3, 0.2, 1e-3, 1e-5, 9.0, 3, loop),
        Impact(SENT[1], Status.RESTED, "at rest", 0.3, 0.0, 1e-3, 1e-5, 9.0, 3),
        Impact(SENT[2], Status.CRASHED, "no answer"),
    ]
    columns = Impacts.joined([Impacts.of(impacts[:2]), Impacts.of(impacts[2:])])
    given = [impact.launch for impact in columns.objects(SENT[:3])]
    assert all(one is other for one, other in zip(given, SENT, strict=False))
    _assert_same(list(columns), impacts)
    _assert_same([columns[2], columns[0]], [impacts[2], impacts[0]])
    np.testing.assert_array_equal(columns.restitution, [impact.restitution for impact in impacts])
    assert columns.is_measured.tolist() == [impact.is_measured for impact in impacts]


def _assert_same(ours: Sequence[Impact], theirs: Sequence[Impact]) -> None:
    for one, other in zip(ours, theirs, strict=True):
        for field in dataclasses.fields(Impact):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))
