"""Checks whether a model's restitution is the target: by a law, a
constant, measured pairs or a baseline.

from hcbench.checking import CheckSpec, check

report = check(CheckSpec(models=("ball.xml",), pair="ball,plate", restitution=0.9))
sys.exit(report.exit_code)
"""

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
