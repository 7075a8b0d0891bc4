"""Processor time of one command of hcbench, and its part in the engines' steps.

python benchmarks/_stepping.py tune mujoco --alpha "0.3 s/m"    # prints both, s, as JSON

Engines run in this process, as in a worker of the command. What counts as steps are the calls that
take some: PyBullet's stepSimulation, MuJoCo's mj_step and rollout, and hcbench's loops in C over
mj_step, with what these read of each step. The rest is Python's start, imports, and what hcbench
does between steps and with them.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

_spent: list[float] = []  # s, by each call


def timed(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function; each call adds its processor time to `_spent`."""

    def run(*args: Any, **options: Any) -> Any:
        began = time.thread_time()
        try:
            return function(*args, **options)
        finally:
            _spent.append(time.thread_time() - began)

    return run


def time_steps() -> None:
    """Let each call that takes MuJoCo's steps be timed, in this process."""
    from hcbench.workers import mark_as_worker

    mark_as_worker()
    import mujoco
    from mujoco import rollout

    from hcbench.engines.mujoco.model import simulation

    mujoco.mj_step = timed(mujoco.mj_step)
    rollout.rollout = timed(rollout.rollout)
    library = simulation.loop_in_c()
    assert library is not None, "the loops in C take most of the steps: install a C compiler"
    for loop in ("advance", "follow"):
        setattr(library, loop, timed(getattr(library, loop)))
    if sys.argv[1] == "report":
        # Of the measured commands it alone runs PyBullet, whose import the others are spared.
        import pybullet

        pybullet.stepSimulation = timed(pybullet.stepSimulation)


def main() -> None:
    # As the command does, before NumPy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    time_steps()
    from hcbench import cli

    with Path(os.devnull).open("w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
        code = cli.run(sys.argv[1:])
    # 1: the command did all it does, and found a limit passed.
    if code not in (0, 1):
        sys.exit(code)
    print(json.dumps({"stepping": sum(_spent), "whole": time.process_time()}))


if __name__ == "__main__":
    main()
