"""The gate: models held against a law, a constant, measured pairs, or their own past.

report = check_models(Ask(models=("ball.xml",), pair="ball,plate", restitution=0.9))
print(as_text(report)); sys.exit(report.exit_code)
"""

from __future__ import annotations

from hcbench.check.command import check, write_outputs
from hcbench.check.model import Check, Outcome, Outputs, Report, Verdict
from hcbench.check.plan import Ask, plan
from hcbench.check.run import run_check, run_checks

__all__ = [
    "Ask",
    "Check",
    "Outcome",
    "Outputs",
    "Report",
    "Verdict",
    "check",
    "plan",
    "run_check",
    "run_checks",
    "write_outputs",
]
