"""A sweep on a Dask cluster of this machine beside hcbench's own
processes: processor time an impact.

    python benchmarks/bench_cluster.py [IMPACTS]

Scheduler and two workers are processes of their own, reached by tcp://. Both sweeps run in turns,
and write the same bytes. Prints a row of benchmarks/README.md for each step.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from bench_commands import parent, swept

from hcbench.benchmark.run import sweep
from hcbench.workers import WorkerPool

ROUNDS, JOBS, SETTLE_S, TICK = 3, 2, 10.0, os.sysconf("SC_CLK_TCK")
STEPS = {"1 ms": ("impulse", "1e-3 s", 1.0), "1 µs": ("spring-damper", "1e-6 s", 0.1)}
SCHEDULER = "from distributed.cli.dask_scheduler import main; main()"
WORKER = "from distributed.cli.dask_worker import main; main()"


@contextmanager
def running(code: str, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """A Python process, until the block ends."""
    quiet = subprocess.DEVNULL
    with subprocess.Popen(
        [sys.executable, "-c", code, *words], stdout=quiet, stderr=quiet
    ) as process:
        try:
            yield process
        finally:
            process.terminate()


def processor(*processes: int) -> float:
    """Seconds of a processor that processes and those that they started have taken until now."""
    total = 0.0
    for process in processes:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        total += sum(map(int, fields[11:13])) / TICK + processor(*children(process))
    return total


def children(process: int) -> list[int]:
    """The processes that one has started."""
    entries = [entry for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    return [int(entry.name) for entry in entries if parent(entry) == process]


def here() -> float:
    """Seconds of a processor that this process alone has taken until now."""
    now = os.times()
    return now.user + now.system


def spent(run: Callable[[], object], *counters: Callable[[], float]) -> list[float]:
    """By how much each counter grows while something runs."""
    before = [counter() for counter in counters]
    run()
    return [counter() - begun for counter, begun in zip(counters, before, strict=True)]


def compare(step: str, impacts: int, address: str, dask: Mapping[int, float], folder: Path) -> None:
    """Print both rows of a step. Engines are warm in both.

    dask: the processes of scheduler and workers, and which share of a core each takes without work.
    """
    recipe, timestep, share = STEPS[step]
    number, best = int(impacts * share), dict[str, list[float]]()
    study, scheduler = swept(number, recipe, timestep), next(iter(dask))

    def working(*processes: int) -> float:
        """Without what they take for the time that it lasts, which is long on a busy machine."""
        return processor(*processes) - time.perf_counter() * sum(dask[each] for each in processes)

    with WorkerPool(JOBS) as pool:
        for turn in range(ROUNDS):
            to = [folder / f"{recipe}-{name}-{turn}" for name in ("dask", "own")]
            each = {
                "Dask": spent(
                    lambda: sweep(study, to[0], scheduler=address),  # noqa: B023
                    *(here, lambda: working(scheduler), lambda: working(*set(dask) - {scheduler})),
                ),
                "own processes": spent(
                    lambda: sweep(study, to[1], executor=pool.threads),  # noqa: B023
                    *(here, lambda: 0.0, lambda: processor(*set(children(os.getpid())) - {*dask})),
                ),
            }
            for name, took in each.items():
                if turn:  # the first starts engines
                    best[name] = min(best.get(name, took), took, key=sum)
    for name, took in best.items():
        cells = [f"{1e6 * seconds / number:.3g}" for seconds in (*took, sum(took))]
        ratio = sum(took) / sum(best["own processes"])
        print(f"| {step}, {name} | {' | '.join(cells)} | {ratio:.2f} |", flush=True)


def main(impacts: int) -> None:
    """Start a cluster, and compare."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        where = folder / "scheduler.json"
        words = ("--scheduler-file", str(where), "--no-dashboard")
        one = (*words, "--nthreads", "1", "--no-nanny", "--local-directory", str(folder))
        codes = [
            (SCHEDULER, "--host", "127.0.0.1", "--port", "0", *words),
            *[(WORKER, *one)] * JOBS,
        ]
        processes = [stack.enter_context(running(*code)).pid for code in codes]
        while not where.is_file() or not (about := where.read_text()):
            time.sleep(0.1)
        time.sleep(SETTLE_S)
        counters = [partial(processor, process) for process in processes]
        without_work = spent(lambda: time.sleep(SETTLE_S), *counters)
        dask = {p: took / SETTLE_S for p, took in zip(processes, without_work, strict=True)}
        print("shares of a core without work:", *(f"{share:.3f}" for share in dask.values()))
        for step in STEPS:
            compare(step, impacts, json.loads(about)["address"], dask, folder)


if __name__ == "__main__":
    main(int(float(sys.argv[1])) if len(sys.argv) > 1 else 1_000_000)
