"""A model that ends its process costs its own check; the others run."""

from __future__ import annotations

from pathlib import Path

import pytest
from checks import CRASH, GOOD, ask

from hcbench.checking import CheckSpec, Verdict, check, plan, run_check

HANG = "def build():\n    while True: pass\n"


HUNGRY = "def build():\n    return bytearray(1 << 45)\n"


LEAVES = "import sys\n\ndef build():\n    sys.exit(0)\n"


RAISES = "def build():\n    raise RuntimeError('first\\nsecond')\n"


NOTHING = "def build():\n    pass\n"


@pytest.mark.parametrize(
    ("code", "exit_code", "words"),
    [
        (CRASH, 3, "SIGSEGV"),
        (HANG, 3, "no answer within"),
        (HUNGRY, 3, "memory"),
        (LEAVES, 2, "SystemExit"),
        (RAISES, 2, "RuntimeError: first"),
        (NOTHING, 2, "returned None"),
    ],
)
def test_a_model_that_takes_its_process_down_is_reported_and_the_rest_runs(
    tmp_path: Path, code: str, exit_code: int, words: str
) -> None:
    (tmp_path / "setup.py").write_text(code)
    (tmp_path / "pyproject.toml").write_text(
        f"""[tool.hcbench]
speeds = "0.5 m/s"
[[tool.hcbench.check]]
model = "setup.py:build"
limit = "{1 if code == HANG else 60} s"
restitution = 0.9
[[tool.hcbench.check]]
model = {GOOD!r}
pair = "ball,plate"
restitution = 0.9
"""
    )
    report = check(CheckSpec(model=str(tmp_path / "pyproject.toml")))
    bad, good = report.outcomes
    assert bad.exit_code == report.exit_code == exit_code
    assert words in bad.message
    assert "\n" not in bad.message
    assert good.verdict is Verdict.PASSED


def test_a_mujoco_model_that_asks_for_all_memory_could_not_run(tmp_path: Path) -> None:
    file = tmp_path / "hungry.xml"
    file.write_text(Path(GOOD).read_text().replace("<default>", '<size memory="900G"/><default>'))
    outcome = run_check(plan(ask(str(file), restitution=0.9)))
    assert outcome.exit_code == 3, outcome.message
