"""A sweep of any size: few files in a folder, and a summary that costs the
same however many parts it has.
"""

from __future__ import annotations

import itertools
import json
import math
import re
import sys
from concurrent.futures import Executor, Future
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from hcbench.benchmark import plan, run
from hcbench.benchmark.results import RUN_KEY
from hcbench.benchmark.shard import Timeouts
from hcbench.benchmark.store import Store, TemporaryFiles
from hcbench.benchmark.tables import ShardFiles, Summary, Totals, arrays

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

PARTS = 1100
ROOT = Path(__file__).parents[2]


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """benchmarks/simulated_sweep.py."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    yield import_module("simulated_sweep")
    del sys.modules["simulated_sweep"]


def summary(setting: str, square: float) -> Summary:
    numbers = {"impacts": 5, "parted": 3, "rested": 1, "failed": 1, "sum_square_error_law": square}
    return {
        **dict.fromkeys(RUN_KEY, setting),
        **numbers,
        "max_error_law": square,
        "max_error_linear": 0.5,
    }


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


def test_a_sweep_of_many_parts_has_few_files_in_a_folder_and_reads_none_of_them(
    monkeypatch: pytest.MonkeyPatch, simulated: Any
) -> None:
    monkeypatch.setattr(plan, "SHARD_IMPACTS", 8)
    monkeypatch.setattr(run, "_SUMMARY_S", 0.0)  # after each part
    reads = []
    for impacts in (12_000, 24_000):
        files = simulated.counted(simulated.planned(impacts))
        assert sum(files.counts.values()) >= 2 * impacts / 8, "a summary for each part"
        assert max(count for folder, count in files.counts.items() if folder) == 1000
        reads.append(files.reads)
    assert reads[0] == reads[1]


class Recorded(Executor):
    """An executor whose tasks are counted."""

    def __init__(self, inner: Executor) -> None:
        self._inner, self.sizes = inner, list[int]()

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> Future[Any]:
        self.sizes.append(len(args[1]))
        return self._inner.submit(fn, *args)


@pytest.mark.parametrize(("task_s", "most"), [(0.0, 1), (0.004, 4), (9.0, 16)])
def test_short_parts_go_to_a_cluster_together(
    monkeypatch: pytest.MonkeyPatch, simulated: Any, task_s: float, most: int
) -> None:
    monkeypatch.setattr(plan, "SHARD_IMPACTS", 8)
    parts, executor = simulated.planned(1000), Recorded(simulated.Done())  # each takes 1 ms
    workers = run.Workers(executor, lambda: 1, task_s=task_s)
    run.run_plan(parts, Store(simulated.Counted()), workers, False, lambda _: None, Timeouts())
    assert sum(executor.sizes) == len(parts)
    assert executor.sizes[0] == 1
    assert max(executor.sizes) == most


class Forgetful(Executor):
    """An executor of a scheduler that is started again: what it took before has no answer."""

    def __init__(self, inner: Executor) -> None:
        self._inner, self.taken = inner, 0

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> Future[Any]:
        self.taken += 1
        return Future() if self.taken == 1 else self._inner.submit(fn, *args)


def test_a_task_that_a_scheduler_forgot_is_handed_out_again(
    monkeypatch: pytest.MonkeyPatch, simulated: Any
) -> None:
    monkeypatch.setattr(plan, "SHARD_IMPACTS", 8)
    parts, executor = simulated.planned(100), Forgetful(simulated.Done())
    workers = run.Workers(
        executor, lambda: 1, start=lambda: "second" if executor.taken else "first"
    )
    run.run_plan(parts, Store(simulated.Counted()), workers, False, lambda _: None, Timeouts())
    assert executor.taken == len(parts) + 1


def test_the_page_plans_10_9_impacts_as_they_are_cut(simulated: Any) -> None:
    text = (ROOT / "docs/reference/sweeps.md").read_text(encoding="utf-8")
    rows = dict(
        re.findall(
            r"^\| ([^|]+?) +\| ([^|]+?) +\|$", text.partition("## Plan for")[2], re.MULTILINE
        )
    )
    parts = len(simulated.planned(10**9))
    folders = math.ceil(parts / 1000)
    assert rows["parts"] == f"{parts:_}".replace("_", " ")
    assert rows["most files in a folder"] == f"1000, in {folders} folders"
    written = float(rows["processor time of a part that is sent and written"].removesuffix(" ms"))
    for step, microseconds in simulated.WORKER_US.items():
        engines = 1e-6 * microseconds * 1e9
        minutes = max(1e-3 * written * parts, engines / simulated.CORES) / 60
        cells = re.search(
            rf"^\| {step} \| ([^|]+) µs \| ([^|]+) \| ([^|]+) min \|$", text, re.MULTILINE
        )
        assert cells is not None
        limit = engines / parts / (1e-3 * written)
        assert cells.groups() == (f"{microseconds:g}", f"{limit:.0f}", f"{minutes:.2g}")
