"""The bifurcation picture: 400 frequencies x 200 cycles of the forced steel body, by processes.

    python benchmarks/bench_vibroimpact.py [--quick]

Beside it SciPy's solve_ivp with events on a few of the same runs, scaled to all
of them: what one would write.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from hcbench.paper import constants
from hcbench.paper.vibroimpact.response import orbits
from hcbench.paper.vibroimpact.system import Sinusoid, VibroImpact

GAP, FORCE, BAND = 1.5e-3, 150.0, (60.0, 120.0)
LAW = constants.law(constants.ALPHAS[-1])
SYSTEM = VibroImpact(constants.MASS, GAP, LAW, LAW)


def picture(values: int, cycles: int, jobs: int) -> float:
    """Wall time of the picture, s."""
    start = time.perf_counter()
    orbits(
        SYSTEM,
        Sinusoid(FORCE, 1.0),
        "frequency",
        np.linspace(*BAND, values),
        cycles,
        min(60, cycles),
        jobs=jobs,
    )
    return time.perf_counter() - start


def plain(cycles: int) -> float:
    """Wall time of one run with solve_ivp, restarted at every touch and parting, s."""
    start = time.perf_counter()
    with np.errstate(
        all="ignore"
    ):  # its trial steps shoot far into the blocks before they are rejected
        for f in (70.0, 90.0, 110.0):
            _plain_run(f, cycles)
    return (time.perf_counter() - start) / 3.0


def _plain_run(f: float, cycles: int) -> None:
    half, a, k, m = GAP / 2, LAW.dissipation, LAW.stiffness, constants.MASS

    def rate(t: float, y: np.ndarray) -> list[float]:
        right, left = max(y[0] - half, 0.0), max(-y[0] - half, 0.0)
        push = -k * right**1.5 * (1 + a * y[1]) + k * left**1.5 * (1 - a * y[1])
        return [y[1], (FORCE * np.sin(2 * np.pi * f * t) + push) / m]

    def switch(t: float, y: np.ndarray) -> float:
        return float(abs(y[0]) - half)

    switch.terminal = True  # type: ignore[attr-defined]
    t, y, end = 0.0, np.array([0.0, 0.0]), cycles / f
    while t < end:
        run: Any = solve_ivp(
            rate, (t, end), y, "DOP853", rtol=1e-8, atol=1e-12, events=switch, max_step=0.1 / f
        )
        t, y = float(run.t[-1]), run.y[:, -1]
        t, y = t + 1e-9, y + 1e-9 * np.array(rate(t, y))  # off the switch, as everybody does


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="40 frequencies x 20 cycles")
    values, cycles = (40, 20) if parser.parse_args().quick else (400, 200)
    print(f"{values} frequencies x {cycles} cycles, {BAND[0]:g} ... {BAND[1]:g} Hz")
    for jobs in (1, 2):
        print(f"{jobs} process{'es' if jobs > 1 else '':<2} {picture(values, cycles, jobs):8.1f} s")
    few = 5
    whole = plain(few) / few * values * cycles
    print(f"solve_ivp, scaled from 3 runs of {few} cycles {whole:8.0f} s")


if __name__ == "__main__":
    main()
