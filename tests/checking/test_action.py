"""The GitHub action: its script is run here, with a stand-in for hcbench that tells what it was given."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from hcbench.cli.check import check

ROOT = Path(__file__).parents[2]
ACTION = (ROOT / "action.yml").read_text(encoding="utf-8")
SCRIPT = textwrap.dedent(ACTION.rpartition("run: |\n")[2])

FAKE = """#!{python}
import os, sys
from pathlib import Path
Path(os.environ["SEEN"]).write_text("\\0".join(sys.argv[1:]))
for argument in sys.argv:
    if argument.startswith("--markdown="):
        Path(argument.partition("=")[2]).write_text("### reported\\n")
sys.exit(int(os.environ["CODE"]))
"""

pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="the action's shell is bash")


def run(tmp_path: Path, code: int = 0, **inputs: str) -> tuple[list[str], int, str, str]:
    """(arguments that hcbench got, exit code, step summary, outputs)."""
    fake = tmp_path / "bin" / "hcbench"
    fake.parent.mkdir()
    fake.write_text(FAKE.format(python=sys.executable))
    fake.chmod(0o755)
    names = re.findall(r"HCBENCH_([A-Z_]+): \$\{\{ inputs\.", ACTION.rpartition("id: check")[2])
    environment = {f"HCBENCH_{name}": "" for name in names} | {f"HCBENCH_{k}": v for k, v in inputs.items()}
    files = {name: str(tmp_path / name) for name in ("SEEN", "GITHUB_STEP_SUMMARY", "GITHUB_OUTPUT")}
    path = f"{fake.parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", SCRIPT],
        env={**os.environ, **environment, **files, "PATH": path, "CODE": str(code)},
        check=False,
    )
    seen = (tmp_path / "SEEN").read_text().split("\0")
    summary = (tmp_path / "GITHUB_STEP_SUMMARY").read_text()
    return seen, done.returncode, summary, (tmp_path / "GITHUB_OUTPUT").read_text()


def test_inputs_become_options(tmp_path: Path) -> None:
    seen, code, summary, outputs = run(
        tmp_path,
        MODEL="ball.urdf\nplate.urdf",
        PAIR="ball,plate",
        RESTITUTION="0.9",
        ARGS="--gravity=0\n--limit=9",
    )
    assert seen[0] == "check"
    assert seen[1].startswith("--markdown=")
    assert seen[2:] == [
        "--pair=ball,plate",
        "--restitution=0.9",
        "--gravity=0",
        "--limit=9",
        "--",
        "ball.urdf",
        "plate.urdf",
    ]
    assert (code, summary, outputs) == (0, "### reported\n", "exit-code=0\n")


@pytest.mark.parametrize("code", [1, 2, 3])
def test_the_exit_code_and_the_summary_come_through(tmp_path: Path, code: int) -> None:
    _, returned, summary, outputs = run(tmp_path, code, MAX_ERROR="0.01")
    assert returned == code
    assert summary == "### reported\n"
    assert outputs == f"exit-code={code}\n"


def test_no_input_is_run(tmp_path: Path) -> None:
    evil = "$(touch pwned) `touch pwned` ; touch pwned"
    seen, *_ = run(tmp_path, MODEL=evil, PAIR=evil, ARGS=evil)
    assert seen[-1] == evil
    assert f"--pair={evil}" in seen
    assert "${{" not in SCRIPT, "an expression in a script is pasted into it"
    assert not list(tmp_path.rglob("pwned")) + list(Path.cwd().glob("pwned"))


OWN = {"model", "args", "working-directory", "python-version", "install"}


def test_every_input_is_used_and_is_an_option_of_check() -> None:
    declared = re.findall(
        r"^  ([a-z-]+):$", ACTION.partition("inputs:")[2].partition("outputs:")[0], re.MULTILINE
    )
    for name in declared:
        assert f"inputs.{name} " in ACTION, name
    options = {flag.removeprefix("--") for option in check.params for flag in option.opts}
    assert set(declared) - OWN <= options
