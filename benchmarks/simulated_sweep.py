"""Memory and time of a process that runs a sweep of any size: no engine
runs, and parts are done at once.

    python benchmarks/simulated_sweep.py [IMPACTS]

First IMPACTS without files: processor time a part, files in a folder, memory, and the time of a
summary. Then some parts whose bytes come from worker processes and are written to disk: processor
time a part, and how many cores of engines keep this process busy.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import Executor, Future
from typing import Any

from hcbench.benchmark import shard as shards
from hcbench.benchmark.plan import Plan, Shard, make_plan
from hcbench.benchmark.results import run_key
from hcbench.benchmark.run import Workers, run_plan
from hcbench.benchmark.shard import Timeouts
from hcbench.benchmark.store import Files, Store, open_files
from hcbench.benchmark.study import study_from
from hcbench.benchmark.tables import ShardFiles, Summary
from hcbench.workers import WorkerPool

SPEEDS, ALPHAS, PHASES = 100_000, 10, 1000  # 10⁹ impacts
CORES, SAMPLE = 64, 4_000_000  # impacts whose bytes are sent and written
BYTES_AN_IMPACT = 21  # of MuJoCo at 1 ms
WORKER_US = {"1 ms": 5.6, "10 µs": 17.4, "1 µs": 102.0}  # an impact of MuJoCo: bench_commands.py
NUMBERS = {"parted": 1, "rested": 0, "failed": 0, "max_error_law": 0.5, "max_error_linear": 0.5}


class Counted(Files):
    """Files of which only the number in each folder is kept. reads:
    how often anything was looked at.
    """

    def __init__(self) -> None:
        self.where, self.counts, self.reads = "nowhere", Counter[str](), 0

    def names(self, folder: str = "") -> list[str]:
        self.reads += 1
        return []

    def folders(self) -> list[str]:
        self.reads += 1
        return []

    def write(self, name: str, content: bytes) -> None:
        self.counts[name.rpartition("/")[0]] += 1


class Done(Executor):
    """Every part is done when it is handed out, and took 1 ms."""

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> Future[Any]:
        done = Future[Any]()
        done.set_result(([part_without_engine(shard) for shard in args[1]], 1e-3 * len(args[1])))
        return done


def part_without_engine(shard: Shard, *_: Any) -> ShardFiles:
    """Bytes as long as a part's, and what it adds to the summary."""
    key = run_key(shard.grid.scene, shard.grid.setting, shard.grid.alphas[0])
    line: Summary = {
        **key,
        **NUMBERS,
        "impacts": len(shard),
        "sum_square_error_law": 1.0 / len(shard),
    }
    return ShardFiles(shard.number, bytes(BYTES_AN_IMPACT * len(shard)), b"", [line])


def planned(impacts: int) -> Plan:
    """A study of so many impacts of MuJoCo at 1 ms."""
    run = {"engine": "mujoco", "recipe": "impulse", "timesteps": "1e-3 s"}
    phases = min(PHASES, max(1, impacts // (ALPHAS * SPEEDS)))
    speeds = f"1:20:{min(SPEEDS, impacts // (ALPHAS * phases))} in/s"
    table = {"scene": "steel-plane", "alphas": f"0.001:0.01:{ALPHAS} s/in", "run": [run]}
    return make_plan(study_from({**table, "speeds": speeds, "phases": phases}))


def counted(plan: Plan) -> Counted:
    """Run a plan without engine, worker and disk."""
    files = Counted()
    run_plan(plan, Store(files), Workers(Done(), lambda: CORES), False, lambda _: None, Timeouts())
    return files


def sent_and_written(plan: Plan) -> None:
    """Run a plan without engine: worker processes send bytes, which are written to disk."""
    import simulated_sweep  # by this name the worker processes find it

    shards.simulate_shard = simulated_sweep.part_without_engine
    with tempfile.TemporaryDirectory() as folder, WorkerPool(2) as pool:
        workers = Workers(pool.threads, lambda: CORES)
        run_plan(plan, Store(open_files(folder)), workers, False, lambda _: None, Timeouts())


def main(impacts: int) -> None:
    """Run both and print."""
    plan = planned(impacts)
    began = time.process_time()
    files = counted(plan)
    part = (time.process_time() - began) / len(plan)
    print(f"{plan.impacts:.3g} impacts in {len(plan)} parts: {1e6 * part:.0f} µs a part")
    folders = [number for name, number in files.counts.items() if name]
    print(f"most files in a folder: {max(folders)}, in {len(folders)} folders")
    print(f"memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    sample, began = planned(SAMPLE), time.process_time()
    sent_and_written(sample)
    part = (time.process_time() - began) / len(sample)
    print(f"a part that is sent and written: {1e3 * part:.2g} ms")
    for step, microseconds in WORKER_US.items():
        engines = 1e-6 * microseconds * plan.impacts
        minutes = max(len(plan) * part, engines / CORES) / 60
        limit = engines / len(plan) / part
        print(
            f"{step}: {limit:.0f} cores keep this process busy; {CORES} cores take {minutes:.2g} min"
        )


if __name__ == "__main__":
    main(int(float(sys.argv[1])) if len(sys.argv) > 1 else 10**9)
