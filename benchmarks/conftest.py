"""Fixtures of the benchmarks: candidates measured in turns, so that a
slower machine slows all alike.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from typing import Any

import pytest

import hcbench

Beside = Callable[..., dict[str, float]]  # `measure`, below


@pytest.fixture
def beside(benchmark: Any) -> Beside:
    """Measures candidates side by side: seconds each, the least of all rounds, for one of `per`.

    The last candidate is hcbench; the ratios are the others' times over its. must, aim:
    what the first ratio should be.
    """

    def measure(
        what: str,
        candidates: Mapping[str, Callable[[], Any]],
        *,
        per: Mapping[str, float] | float = 1.0,
        unit: str = "s",
        rounds: int = 5,
        must: str = "",
        aim: str = "",
    ) -> dict[str, float]:
        seconds: dict[str, list[float]] = {name: [] for name in candidates}

        def all_in_turn() -> None:
            for name, run in candidates.items():
                began = time.perf_counter()
                result = run()
                took = time.perf_counter() - began
                seconds[name].append(
                    result if isinstance(result, float) else took
                )  # its own clock's, if it has one

        benchmark.pedantic(all_in_turn, rounds=rounds, warmup_rounds=1)
        share = per if isinstance(per, Mapping) else dict.fromkeys(candidates, per)
        best = {name: min(times[1:] or times) / share[name] for name, times in seconds.items()}
        benchmark.extra_info.update(what=what, unit=unit, seconds=best, must=must, aim=aim)
        return best

    return measure


def pytest_benchmark_update_machine_info(config: Any, machine_info: dict[str, Any]) -> None:
    from hcbench.sim import registry

    machine_info["cores"] = len(os.sched_getaffinity(0))
    machine_info["load"] = os.getloadavg()[0]
    machine_info["hcbench"] = hcbench.__version__
    machine_info["engines"] = {
        name: registry.engine(name).version() for name in ("mujoco", "pybullet")
    }
