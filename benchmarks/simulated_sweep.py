"""What the process takes that runs a sweep of any size: no engine runs, and each part is done at once.

    python benchmarks/simulated_sweep.py [IMPACTS]

Prints its processor time a part, the time that a summary takes at the end, the most files in a folder, its
memory, and how many cores of workers it keeps busy by that. Nothing is written to disk.
"""

from __future__ import annotations

import resource
import sys
import time
from collections import Counter
from concurrent.futures import Executor, Future
from typing import Any

from hcbench.benchmark.files import Files
from hcbench.benchmark.launch_grid import LaunchGrid
from hcbench.benchmark.plan import make_plan
from hcbench.benchmark.results import run_key
from hcbench.benchmark.run import Workers, run_plan
from hcbench.benchmark.shard import Timeouts
from hcbench.benchmark.store import Store
from hcbench.benchmark.study import study_from
from hcbench.benchmark.tables import ShardFiles, Summary, Totals

SPEEDS, ALPHAS = 100_000, 10
BYTES_AN_IMPACT, WORKER_S = 21, 5.6e-6  # of MuJoCo at 1 ms, as bench_commands.py measures
NUMBERS = {"parted": 1, "rested": 0, "failed": 0, "max_error_law": 0.5, "max_error_linear": 0.5}


class Counted(Files):
    """Files of which only the number in each folder is kept."""

    def __init__(self) -> None:
        self.where, self.counts = "nowhere", Counter[str]()

    def names(self, folder: str = "") -> list[str]:
        return []

    def folders(self) -> list[str]:
        return []

    def write(self, name: str, content: bytes) -> None:
        self.counts[name.rpartition("/")[0]] += 1


class Done(Executor):
    """Every part is done when it is handed out."""

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> Future[Any]:
        shard, done = args[0], Future[Any]()
        lines = [line_of(shard.grid, len(shard))]
        done.set_result(ShardFiles(shard.number, bytes(BYTES_AN_IMPACT * len(shard)), b"", lines))
        return done


def line_of(grid: LaunchGrid, impacts: int) -> Summary:
    """What a part adds to the summary."""
    key = run_key(grid.scene, grid.setting, grid.alphas[0])
    return {**key, **NUMBERS, "impacts": impacts, "sum_square_error_law": 1.0 / impacts}


def main(impacts: int) -> None:
    """Run it and print."""
    run = {"engine": "mujoco", "recipe": "impulse", "timesteps": "1e-3 s"}
    table = {"scene": "steel-plane", "alphas": f"0.001:0.01:{ALPHAS} s/in", "run": [run]}
    phases = impacts // (ALPHAS * SPEEDS)
    plan = make_plan(study_from({**table, "speeds": f"1:20:{SPEEDS} in/s", "phases": phases}))
    files = Counted()
    store, began = Store(files), time.process_time()
    run_plan(plan, store, Workers(Done(), lambda: 64), False, lambda _: None, Timeouts())
    part = (time.process_time() - began) / len(plan)
    size = plan.impacts / len(plan)
    totals = Totals()
    totals.add(line_of(grid, len(grid)) for grid in plan.grids)
    began = time.process_time()
    store.write_summary(plan.records, totals)
    summary = time.process_time() - began
    print(f"{plan.impacts:.3g} impacts in {len(plan)} parts: {1e6 * part:.0f} µs a part")
    print(f"most files in a folder: {max(files.counts.values())}, in {len(files.counts)} folders")
    print(f"a summary: {1e3 * summary:.2g} ms")
    print(f"memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    print(f"keeps {size * WORKER_S / part:.0f} cores busy at {1e6 * WORKER_S:g} µs an impact")


if __name__ == "__main__":
    main(int(float(sys.argv[1])) if len(sys.argv) > 1 else 10**9)
