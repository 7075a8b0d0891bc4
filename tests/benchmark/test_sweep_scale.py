"""A sweep of any size: few files in a folder, and a summary that costs the same however many parts it has."""

from __future__ import annotations

import itertools
import json
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from hcbench.benchmark.encodings import arrays
from hcbench.benchmark.files import TemporaryFiles
from hcbench.benchmark.results import RUN_KEY
from hcbench.benchmark.store import Store
from hcbench.benchmark.tables import ShardFiles, Summary, Totals

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

PARTS = 1100


def summary(setting: str, square: float) -> Summary:
    numbers = {"impacts": 5, "parted": 3, "rested": 1, "failed": 1, "sum_square_error_law": square}
    return {**dict.fromkeys(RUN_KEY, setting), **numbers, "max_error_law": square, "max_error_linear": 0.5}


def totals(parts: Iterable[Sequence[Summary]]) -> Totals:
    result = Totals()
    for part in parts:
        result.add(part)
    return result


def test_the_parts_of_a_large_sweep_lie_in_folders_of_at_most_a_thousand() -> None:
    files = TemporaryFiles()
    store, own = Store(files), [summary("a", 0.25)]
    about = {"hcbench.loops": b"", "hcbench.summary": json.dumps(own).encode()}
    for number in range(PARTS):
        store.write_shard(ShardFiles(number, arrays([], [], about), b"", own), PARTS)
    assert files.names() == []
    assert [len(files.names(folder)) for folder in files.folders()] == [1000, 100]
    assert dict(store.verified(PARTS)) == dict.fromkeys(range(PARTS), own)


def test_a_summary_is_the_same_for_every_order_and_holds_one_line_a_setting() -> None:
    squares = np.random.default_rng(3).uniform(0.0, 1.0, 60) ** 40
    parts = [[summary(name, square) for name in "ab"] for square in squares.tolist()]
    lines = totals(parts).lines()
    assert lines == totals(reversed(parts)).lines()
    assert len(lines) == 2
    (line, _) = lines.values()
    assert line["rms_error_law"] == math.sqrt(math.fsum(squares) / (4 * len(parts)))
    assert line["impacts"] == 5 * len(parts)
    assert line["max_error_law"] == squares.max()


@pytest.mark.parametrize("name", ["rms_error_law", "max_error_law", "max_error_linear"])
def test_a_setting_of_which_nothing_bounced_has_no_error(name: str) -> None:
    failed = {**summary("a", 0.0), "parted": 0, "rested": 0, "failed": 5}
    ((_, line),) = itertools.islice(totals([[failed]]).lines().items(), 1)
    assert math.isnan(line[name])
