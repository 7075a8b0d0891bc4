"""Checks of the examples, for the tests of `hcbench check`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hcbench.checking import CheckSpec, Report

EXAMPLES = Path(__file__).parents[2] / "examples"


GOOD, BROKEN = str(EXAMPLES / "good.xml"), str(EXAMPLES / "broken.xml")


SPEEDS = "0.1, 0.5 m/s"


def ask(model: str = GOOD, **more: Any) -> CheckSpec:
    return CheckSpec(**{"model": model, "pair": "ball,plate", "speeds": SPEEDS, **more})


def one(report: Report) -> Any:
    (outcome,) = report.outcomes
    return outcome


CRASH = "import os, signal\n\ndef build():\n    os.kill(os.getpid(), signal.SIGSEGV)\n"
