"""Small studies to sweep, and what is in their folders."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hcbench.sim import registry

ENGINES: dict[str, Any] = {
    "scene": "steel-plane",
    "alphas": "0.004, 0.008 s/in",
    "speeds": "1:20:10 in/s",
    "loop_speeds": "4, 8 in/s",
    "phases": 4,
    "run": [
        {"engine": "reference", "recipe": "hunt-crossley", "timesteps": 1e-6},
        {"engine": "mujoco", "recipe": "spring-damper", "timesteps": "1e-5, 2e-5 s"},
        {"engine": "mujoco", "recipe": "stock", "timesteps": 2e-3},
    ],
}
if registry.is_there("pybullet"):
    ENGINES["run"] += [
        {"engine": "pybullet", "recipe": "restitution", "timesteps": 1e-3, "speeds": "2, 8 in/s"}
    ]


TESTS = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "support")]


def small(
    engine: str = "reference", recipe: str = "hunt-crossley", speeds: str = "1:20 in/s"
) -> dict[str, Any]:
    return {
        "scene": "steel-plane",
        "alphas": 0.3,
        "speeds": speeds,
        "loop_speeds": "4 in/s",
        "phases": 4,
        "run": [{"engine": engine, "recipe": recipe, "timesteps": 1e-5}],
    }


def whole(folder: Path) -> dict[str, bytes]:
    """Every file's bytes, by name."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "_damaged" not in path.parts
    }


def until(so: Callable[[], bool], process: subprocess.Popen[Any]) -> None:
    """Wait for what a process does while it runs."""
    end = time.monotonic() + 60
    while not so():
        assert time.monotonic() < end
        assert process.poll() is None
        time.sleep(0.02)


BOUNCING = """scene = "steel-plane"
alphas = "0.004, 0.008 s/in"
speeds = "4, 10, 16 in/s"
loop_speeds = "10 in/s"
phases = 2
train_height = "10 mm"
train_step = "1e-3 s"
"""


BOUNCING_RUNS = (("reference", "hunt-crossley"), ("mujoco", "impulse"), ("pybullet", "restitution"))


def bouncing(*engines: str) -> str:
    """A study file whose settings at 1e-3 s are dropped under gravity too."""
    runs = [
        f'[[run]]\nengine = "{engine}"\nrecipe = "{recipe}"\ntimesteps = "1e-3, 2e-3 s"\n'
        for engine, recipe in BOUNCING_RUNS
        if engine in engines
    ]
    return "".join([BOUNCING, *runs])
