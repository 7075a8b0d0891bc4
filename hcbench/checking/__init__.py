"""Checks whether a model's restitution is the target: by a law, a
constant, measured pairs or a baseline.

from hcbench.checking import CheckSpec, check

report = check(CheckSpec(models=("ball.xml",), pair="ball,plate", restitution=0.9))
sys.exit(report.exit_code)

Each name is imported when first used: `measure` plans as a check does, and judges nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hcbench.checking.command import Outputs
    from hcbench.checking.command import run_spec as check
    from hcbench.checking.judge import run_check, run_checks
    from hcbench.checking.outcome import Outcome, Report, Verdict
    from hcbench.checking.spec import Check, CheckSpec, plan

__all__ = [
    "Check",
    "CheckSpec",
    "Outcome",
    "Outputs",
    "Report",
    "Verdict",
    "check",
    "plan",
    "run_check",
    "run_checks",
]

# The module of each name.
_HOMES = {
    **dict.fromkeys(("Outputs", "check"), "command"),
    **dict.fromkeys(("run_check", "run_checks"), "judge"),
    **dict.fromkeys(("Outcome", "Report", "Verdict"), "outcome"),
    **dict.fromkeys(("Check", "CheckSpec", "plan"), "spec"),
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    there = "run_spec" if name == "check" else name
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), there)
