"""A sweep on a Dask cluster, and what becomes of it when a worker, the
scheduler or the user goes away.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from dask_processes import WORKER, kill, running, scheduler
from in_place import in_place
from small_sweeps import TESTS, small, until, whole
from sweep_engine import note

import hcbench
from hcbench.benchmark import run
from hcbench.benchmark.run import sweep
from hcbench.benchmark.study import load_study, study_from
from hcbench.system.errors import CannotRun

if TYPE_CHECKING:
    from hcbench.benchmark.run import Progress

pytestmark = pytest.mark.usefixtures("small_parts")

COMMAND = """
import sys
from hcbench.__main__ import main
from hcbench.benchmark import plan
plan.SHARD_IMPACTS = 16
sys.argv[1:] = {words!r}
main()
"""
LONG = small(speeds="1:20:2000 in/s")  # 500 parts
STUDY = """scene = "steel-plane"
alphas = 0.3
speeds = "1:20:200 in/s"
phases = 4
[[run]]
engine = "mujoco"
recipe = "spring-damper"
timesteps = 1e-6
"""


def test_a_cluster_that_loses_a_worker_leaves_the_same_bytes(tmp_path: Path, package: Path) -> None:
    note(package, sleep=0.2)
    path, study = [*TESTS, str(package)], study_from(small("tripping", "law"))
    with (
        running(scheduler(*path)) as (_, address),
        running(WORKER.format(path=path, address=address)) as (worker, _),
    ):

        def lose(now: Progress) -> None:
            if now.shards == 1:
                kill(worker)

        end = sweep(study, f"file://{tmp_path}/cluster", scheduler=address, progress=lose)
    assert (end.shards, worker.returncode) == (5, -signal.SIGKILL)
    note(package)
    with in_place():
        sweep(study, tmp_path / "whole")
    assert whole(tmp_path / "cluster") == whole(tmp_path / "whole")


def test_a_lost_scheduler_is_one_line_and_finished_parts_are_kept(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    undisturbed: Path,
) -> None:
    study, folder = study_from(small()), tmp_path / "sweep"
    with running(scheduler()) as (process, address):

        def lose(now: Progress) -> None:
            if now.shards == 2:
                kill(process)

        monkeypatch.setattr(run, "_CONNECT_S", 2.0)
        with pytest.raises(CannotRun) as caught:
            sweep(study, folder, scheduler=address, progress=lose)
    assert caught.value.exit_code == 3
    gone = f"scheduler: {address} went away, and did not come back within 2 s"
    expected = "one that lasts as long as the sweep. Then go on with --resume"
    assert str(caught.value) == f"{gone}; expected {expected}"
    assert capfd.readouterr() == ("", "")
    with in_place():
        assert sweep(study, folder, resume=True).resumed >= 2
    assert whole(folder) == whole(undisturbed)


def test_a_sweep_goes_on_with_a_scheduler_that_is_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, undisturbed: Path
) -> None:
    monkeypatch.setattr(run, "_CONNECT_S", 60.0)
    with running(scheduler()) as (first, address), ExitStack() as stack:

        def restart(now: Progress) -> None:
            if now.shards == 2:
                kill(first)
                stack.enter_context(running(scheduler(port=int(address.rpartition(":")[2]))))

        sweep(study_from(small()), tmp_path / "sweep", scheduler=address, progress=restart)
        assert first.returncode == -signal.SIGKILL
    assert whole(tmp_path / "sweep") == whole(undisturbed)


def test_without_workers_or_with_others_it_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(scheduler()) as (_, address):
        with monkeypatch.context() as other:
            other.setattr(hcbench, "__version__", "9.9")
            with pytest.raises(CannotRun, match=r"has hcbench .*expected hcbench 9\.9"):
                sweep(study_from(small()), tmp_path / "other", scheduler=address)

        async def remove(dask_scheduler: Any) -> None:
            for worker in list(dask_scheduler.workers):
                await dask_scheduler.remove_worker(worker, stimulus_id="test")

        def lose(now: Progress) -> None:
            from distributed import Client

            if now.shards == 1:
                with Client(address, set_as_default=False) as client:
                    client.run_on_scheduler(remove)
                monkeypatch.setattr(run, "_WORKERS_S", 0.5)

        with pytest.raises(CannotRun, match=r"has no workers after 0\.5 s; expected one.*--resume"):
            sweep(study_from(LONG), tmp_path / "out", scheduler=address, progress=lose)
        with pytest.raises(CannotRun, match=r"has no workers after 0\.5 s.*`dask worker`"):
            sweep(study_from(small()), tmp_path / "none", scheduler=address)


def test_an_interrupted_command_leaves_the_cluster_for_the_next(tmp_path: Path) -> None:
    study, folder = tmp_path / "study.toml", tmp_path / "sweep"
    study.write_text(STUDY)
    with running(scheduler()) as (_, address):
        words = ["sweep", str(study), "--out", str(folder), "--resume", "--scheduler", address]
        command = [sys.executable, "-c", COMMAND.format(words=words)]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
            until(lambda: len(list(folder.glob("part-*"))) >= 2, process)
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=60)
        assert (process.returncode, error) == (
            130,
            "hcbench: interrupted; nothing was left half-written\n",
        )
        end = sweep(load_study(study), folder, resume=True, scheduler=address)
    assert (end.resumed >= 2, end.shards) == (True, 50)


def test_a_scheduler_that_is_not_there_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(run, "_CONNECT_S", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense", "tcp://nonsense", "''"):
        with pytest.raises(CannotRun, match=f"{address} does not answer"):
            sweep(study_from(small()), tmp_path / "out", scheduler=address.strip("'"))


def test_without_dask_it_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(CannotRun, match=r"pip install distributed pyarrow"):
        sweep(study_from(small()), tmp_path, scheduler="tcp://127.0.0.1:8786")
