"""Adapter of the cases for Newton before 1.5: its Warp cannot capture a step on a CPU, or drops parts.

Newton's own Python runs it: `python hcbench_cases.py older_newton.py`.
"""

from __future__ import annotations

import runpy
from functools import partial
from pathlib import Path
from typing import Any

ADAPTER = Path(__file__).parents[2] / "hcbench" / "engines" / "newton" / "cases.py"
Best: Any = runpy.run_path(str(ADAPTER))["NewtonBodies"]


class Uncaptured(Best):  # type: ignore[misc]
    """Takes each step by Newton's calls, not by a graph of them."""

    def capture(self) -> None:
        pass

    def step(self) -> None:
        self.step_once()


ENGINES = [
    partial(Uncaptured, "XPBD", "average", {"enable_restitution": True, "iterations": 10}),
    partial(Uncaptured, "XPBD", "average", {}, "-stock"),
]
