"""An engine's crash becomes a row; work that an executor fails is asked for again."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pytest
from in_place import in_place
from small_sweeps import small, whole
from sweep_engine import note

from hcbench.benchmark.read import read
from hcbench.benchmark.run import sweep
from hcbench.benchmark.shard import Timeouts
from hcbench.benchmark.study import study_from
from hcbench.system.errors import CannotRun, SettingError

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = pytest.mark.usefixtures("small_parts")


def test_what_an_engine_dies_on_is_a_row_with_the_reason(tmp_path: Path, package: Path) -> None:
    study = study_from(small("tripping", "law"))
    phases = [(i + 0.5) / 4 for i in range(4)]
    at = [[study.speeds[i], phase] for i in (2, 10, 15) for phase in phases]
    note(
        package, segfault=at[:4], memory=at[4:8], error=at[8:]
    )  # all phases of a speed, as such things go
    sweep(study, tmp_path / "out", jobs=2)
    table = read(tmp_path / "out").impacts
    lost = table[table["status"] == "crashed"]
    assert lost[["speed_m_per_s", "phase"]].to_numpy().tolist() == at
    reasons = lost["reason"].tolist()
    assert set(reasons[:4]) == {"crashed with SIGSEGV"}
    assert set(reasons[4:8]) == {"MemoryError"}
    assert set(reasons[8:]) == {"RuntimeError: the solver lost its way"}
    note(package)
    with in_place():
        sweep(study, tmp_path / "well")
    kept = table["status"] != "crashed"
    pd.testing.assert_frame_equal(table[kept], read(tmp_path / "well").impacts[kept])
    summary = pd.read_csv(tmp_path / "out" / "_summary.csv")
    assert (summary["parted"].item(), summary["failed"].item()) == (68, 12)


def test_what_an_engine_hangs_on_is_a_row_with_the_reason(tmp_path: Path, package: Path) -> None:
    study = study_from(small("tripping", "law"))
    note(package, hang=[[study.speeds[6], 0.375]])
    sweep(study, tmp_path, jobs=2, timeouts=Timeouts(start=2.0, each=0.0))  # of processor time
    table = read(tmp_path).impacts
    lost = table[table["status"] == "crashed"]
    assert lost[["speed_m_per_s", "phase", "reason"]].to_numpy().tolist() == [
        [study.speeds[6], 0.375, "no answer within 2 s"]
    ]


def test_a_setting_that_the_engine_refuses_stops_the_sweep(tmp_path: Path) -> None:
    study = {**small("mujoco", "staggered"), "scene": "steel-cup"}
    with pytest.raises(SettingError, match="cup"):
        sweep(study_from(study), tmp_path)


class Failing(ThreadPoolExecutor):
    """Fails each task so many times before it runs it."""

    def __init__(self, times: int) -> None:
        super().__init__(2)
        self._times: dict[int, int] = {}
        self._most = times

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        (number,) = (shard.number for shard in args[1])
        self._times[number] = self._times.get(number, 0) + 1
        if self._times[number] > self._most:
            return super().submit(fn, *args, **kwargs)
        failed: Future[Any] = Future()
        failed.set_exception(ConnectionError("the machine\nwent away"))
        return failed


@pytest.mark.usefixtures("without_processes")
def test_a_part_that_an_executor_failed_is_asked_for_again(
    tmp_path: Path, undisturbed: Path
) -> None:
    with Failing(1) as executor:
        sweep(study_from(small()), tmp_path, executor=executor)
    assert whole(tmp_path) == whole(undisturbed)


@pytest.mark.usefixtures("without_processes")
def test_an_executor_that_keeps_failing_is_one_line(tmp_path: Path) -> None:
    with (
        Failing(9) as executor,
        pytest.raises(
            CannotRun, match=r"part \d 2 times: ConnectionError: the machine went away.*--resume"
        ),
    ):
        sweep(study_from(small()), tmp_path / "failing", executor=executor)
    with ThreadPoolExecutor(1) as closed:
        pass
    with pytest.raises(CannotRun, match=r"executor: .*shutdown.*--resume"):
        sweep(study_from(small()), tmp_path / "closed", executor=closed)


@pytest.mark.usefixtures("without_processes")
def test_a_worker_with_something_else_installed_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hcbench.benchmark import shard

    other = {"hcbench": "0.0.1", "numpy": np.__version__}
    monkeypatch.setattr(shard, "versions_here", lambda *engines: other)
    with pytest.raises(
        CannotRun, match=r"worker: has hcbench 0\.0\.1; expected hcbench .*same everywhere"
    ):
        sweep(study_from(small()), tmp_path)
