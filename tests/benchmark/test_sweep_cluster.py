"""A sweep on a Dask cluster."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from small_sweeps import TESTS, small, whole
from sweep_engine import note

from hcbench.benchmark import cluster
from hcbench.benchmark.run import sweep
from hcbench.benchmark.study import study_from
from hcbench.errors import CannotRun

pytestmark = pytest.mark.usefixtures("small_parts")


CLUSTER = """
import logging, os, sys
sys.path[:0] = {tests!r}
sys.path.insert(0, {package!r})
import hcbench
from distributed import Client, LocalCluster
from hcbench.errors import CannotRun
from hcbench.benchmark.study import study_from
from hcbench.benchmark import plan
from hcbench.benchmark.run import sweep
from small_sweeps import small

if __name__ == "__main__":
    logging.disable(logging.WARNING)
    plan.SHARD_IMPACTS = 16
    study = study_from(small("tripping", "law"))
    with LocalCluster(2, threads_per_worker=1, protocol="tcp://", dashboard_address=None) as workers:
        address = workers.scheduler_address
        pids = [worker.pid for worker in workers.workers.values()]
        killed = []
        def kill(now):
            if now.shards == 1 and not killed:
                with Client(address, set_as_default=False) as client:
                    one = next(iter(client.run(os.getpid).values()))
                killed.append(one)
                os.kill(one, 9)
        end = sweep(study, "file://" + {folder!r}, scheduler=address, progress=kill)
        assert killed and end.shards == 5, (killed, end)
        hcbench.__version__ = "9.9"
        try:
            sweep(study, {folder!r} + "-other", scheduler=address)
        except CannotRun as error:
            print(error)
"""


def test_a_dask_cluster_that_loses_a_worker_leaves_the_same_bytes(tmp_path: Path, package: Path) -> None:
    pytest.importorskip("distributed")
    note(package, sleep=0.2)
    script = CLUSTER.format(tests=TESTS, package=str(package), folder=str(tmp_path / "cluster"))
    path = tmp_path / "run_cluster.py"
    path.write_text(script)
    done = subprocess.run(
        [sys.executable, str(path)], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "has hcbench" in done.stdout and "expected hcbench 9.9" in done.stdout
    sweep(study_from(small("tripping", "law")), tmp_path / "whole")
    assert whole(tmp_path / "cluster") == whole(tmp_path / "whole")


def test_a_scheduler_that_is_not_there_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "_CONNECT_S", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense", "tcp://nonsense", "''"):
        with pytest.raises(CannotRun, match=f"{address} does not answer"):
            sweep(study_from(small()), tmp_path / "out", scheduler=address.strip("'"))


def test_without_dask_it_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(CannotRun, match=r"pip install distributed pyarrow"):
        sweep(study_from(small()), tmp_path, scheduler="tcp://127.0.0.1:8786")
