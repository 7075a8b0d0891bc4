"""Tables of a covering design of dialects: read as they say, or refused; none is misread."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest
from measured_bounces import EXACT
from table_dialects import Dialect, data, dialects

from hcbench.fitting import read
from hcbench.fitting.datasets import Dataset, TouchTimes
from hcbench.fitting.heights import Heights, SpeedPairs
from hcbench.fitting.read import read_dataset
from hcbench.fitting.track import Track
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path


def is_right(found: Dataset, kind: str) -> bool:
    """Say whether a data set is the one that was written."""
    truth = [column.values for column in data(kind)]
    if isinstance(found, TouchTimes):
        flights = np.diff(truth[0]) if kind == "times" else truth[0]
        return len(found.times) == len(flights) + 1 and np.allclose(
            np.diff(found.times), flights, atol=2e-5
        )
    if isinstance(found, Heights):
        return kind == "heights" and np.allclose(found.heights, truth[0], rtol=1e-4, atol=2e-6)
    if isinstance(found, Track):
        rate = len(found.times) / float(np.ptp(found.times))
        return kind == "track" and abs((found.drop or 0.0) - 0.5) < 5e-3 and abs(rate - 120) < 6
    assert isinstance(found, SpeedPairs)
    v, e = (column.values for column in data("pairs"))
    speeds, es = found.pairs()
    order = np.argsort(speeds)
    return len(speeds) >= len(v) - 2 and np.allclose(
        np.interp(speeds[order], v, e), es[order], atol=5e-4
    )


def outcome(dialect: Dialect, folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """ "right", "refused" or "misread"."""
    path = folder / dialect.name
    path.write_bytes(dialect.content)
    pulses: list[tuple[np.ndarray, np.ndarray]] = []
    monkeypatch.setattr(read, "fit_pulse", lambda _, setup, t, f: pulses.append((t, f)))
    try:
        if dialect.kind != "force":
            return "right" if is_right(read_dataset(path, EXACT), dialect.kind) else "misread"
        read.read_force(path, EXACT)
    except UserError as error:
        assert "Read: " in str(error) or "Lines that are read" in str(error)
        return "refused"
    if not pulses:
        return "refused"
    (t, force), (times, forces) = pulses[0], (column.values for column in data("force"))
    is_whole = len(t) >= len(times) - 2
    return "right" if is_whole and np.allclose(np.interp(t, times, forces), force) else "misread"


@pytest.mark.parametrize("seed", [1, 5])
def test_of_a_design_of_dialects_nearly_all_are_read_and_none_is_misread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    came = Counter(outcome(one, tmp_path, monkeypatch) for one in dialects(24, seed))
    assert came["misread"] == 0
    assert came["right"] >= 22
