"""The GitHub action: a YAML parser reads it, and its steps run here as
GitHub's runner would run them.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from hcbench.cli.check import check
from hcbench.cli.help import OLD_FLAGS

ROOT = Path(__file__).parents[2]
ACTION: dict[str, Any] = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
STEPS: list[dict[str, Any]] = ACTION["runs"]["steps"]
SCRIPTS = [step for step in STEPS if "run" in step]

# Stands in for hcbench and for python: writes down its arguments, ends with the exit code that the
# test sets. A shell starts Python, since the first line of a script takes no path with spaces.
STAND_IN = """#!/bin/sh
'''exec' "{python}" "$0" "$@"
' '''
import os, sys
from pathlib import Path
name = Path(sys.argv[0]).name
Path(os.environ["SEEN"], name).write_bytes("\\0".join(sys.argv[1:]).encode())
for argument in sys.argv:
    if argument.startswith("--markdown="):
        Path(argument.partition("=")[2]).write_text("### reported\\n")
sys.exit(int(os.environ[f"{{name.upper()}}_CODE"]))
"""
EXPRESSION = re.compile(r"\$\{\{(.*?)\}\}", re.DOTALL)
# Each would leave a file named "pwned" if a shell ran it.
EVIL = [
    "$(touch pwned) `touch pwned` ; touch pwned",
    "'; touch pwned; '",
    '"; touch pwned; "',
    "' \" $(touch pwned)\n$(touch pwned)",
    "a\\\n&& touch pwned || touch pwned",
    "${{ inputs.pair }}$(touch pwned)",
]

needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="the action's shell is bash")


@dataclass(frozen=True)
class Run:
    """Traces of one run of the action: arguments by program, exit code, summary, outputs."""

    arguments: dict[str, list[str]]
    code: int
    summary: str
    outputs: dict[str, str]


def expand(text: str, values: dict[str, str]) -> str:
    """The text with its expressions replaced by their values, as the
    runner does before a shell sees it.
    """

    def value(match: re.Match[str]) -> str:
        names = [name.strip() for name in match[1].split("||")]
        return next((values[name] for name in names if values[name]), "")

    return EXPRESSION.sub(value, text)


def run(tmp_path: Path, codes: tuple[int, int] = (0, 0), **inputs: str) -> Run:
    """Run the scripts of the action up to the first that fails; codes
    are those of pip and of hcbench.
    """
    seen = tmp_path / "seen"
    work = tmp_path / "work"
    programs = tmp_path / "bin"
    for folder in (seen, work, programs):
        folder.mkdir()
    for name in ("python", "hcbench"):
        (programs / name).write_text(STAND_IN.format(python=sys.executable))
        (programs / name).chmod(0o755)

    given = {name.replace("_", "-"): text for name, text in inputs.items()}
    values = {
        f"inputs.{name}": given.get(name, field["default"])
        for name, field in ACTION["inputs"].items()
    }
    values["github.action_path"] = "/the/action"
    files = {"GITHUB_STEP_SUMMARY": tmp_path / "summary", "GITHUB_OUTPUT": tmp_path / "output"}
    for file in files.values():
        file.touch()
    environment = {
        **os.environ,
        **{name: str(file) for name, file in files.items()},
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        "SEEN": str(seen),
        "PYTHON_CODE": str(codes[0]),
        "HCBENCH_CODE": str(codes[1]),
    }

    code = 0
    for step in SCRIPTS:
        script = tmp_path / "step.sh"
        script.write_text(expand(step["run"], values), encoding="utf-8")
        own = {name: expand(text, values) for name, text in step.get("env", {}).items()}
        done = subprocess.run(
            ["bash", "--noprofile", "--norc", "-e", "-o", "pipefail", str(script)],
            env={**environment, **own},
            cwd=work / expand(step.get("working-directory", "."), values),
            check=False,
        )
        code = done.returncode
        if code:
            break
    arguments = {file.name: file.read_bytes().decode().split("\0") for file in seen.iterdir()}
    lines = files["GITHUB_OUTPUT"].read_text().splitlines()
    outputs = {name: text for name, _, text in (line.partition("=") for line in lines)}
    return Run(arguments, code, files["GITHUB_STEP_SUMMARY"].read_text(), outputs)


def test_github_can_load_it() -> None:
    assert all(
        isinstance(ACTION[key], str) and ACTION[key] for key in ("name", "description", "author")
    )
    for name, field in ACTION["inputs"].items():
        assert isinstance(field["description"], str), name
        assert isinstance(field["default"], str), name
        assert set(field) <= {"description", "default", "required"}, name
    assert ACTION["runs"]["using"] == "composite"
    for step in STEPS:
        assert ("run" in step) != ("uses" in step), step
        assert ("shell" in step) == ("run" in step), step
    assert {step["shell"] for step in SCRIPTS} == {"bash"}


def test_an_expression_names_something_that_there_is() -> None:
    known = {f"inputs.{name}" for name in ACTION["inputs"]} | {"github.action_path"}
    known |= {f"steps.{step['id']}.outputs.exit-code" for step in STEPS if "id" in step}
    texts = (ROOT / "action.yml").read_text(encoding="utf-8")
    named = {name.strip() for found in EXPRESSION.findall(texts) for name in found.split("||")}
    assert named <= known
    assert {name for name in known if name.startswith("inputs.")} <= named, (
        "an input that nothing uses"
    )


@needs_bash
def test_inputs_become_options(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        model="ball.urdf\nplate.urdf",
        pair="ball,plate",
        restitution="0.9",
        max_error="0.02",
        args="--gravity=0\n--limit=9",
    )
    seen = done.arguments["hcbench"]
    assert seen[0] == "check"
    assert seen[1].startswith("--markdown=")
    assert seen[2:] == [
        "--pair=ball,plate",
        "--restitution=0.9",
        "--max-error=0.02",
        "--gravity=0",
        "--limit=9",
        "--",
        "ball.urdf",
        "plate.urdf",
    ]
    assert (done.code, done.summary, done.outputs) == (0, "### reported\n", {"exit-code": "0"})


@needs_bash
@pytest.mark.parametrize(
    ("asked", "installed"), [("", "/the/action"), ("hcbench==9", "hcbench==9")]
)
def test_pip_installs_the_action_itself_or_what_is_asked(
    tmp_path: Path, asked: str, installed: str
) -> None:
    done = run(tmp_path, install=asked)
    assert done.arguments["python"] == ["-m", "pip", "install", "--quiet", "--", installed]


@needs_bash
def test_an_installation_that_fails_ends_the_action(tmp_path: Path) -> None:
    done = run(tmp_path, codes=(1, 0))
    assert done.code == 1
    assert "hcbench" not in done.arguments


@needs_bash
@pytest.mark.parametrize("code", [1, 2, 3])
def test_a_check_that_fails_fails_the_step_and_keeps_its_summary(tmp_path: Path, code: int) -> None:
    done = run(tmp_path, codes=(0, code), max_error="0.01")
    assert done.code == code
    assert done.summary == "### reported\n"
    assert done.outputs == {"exit-code": str(code)}


@needs_bash
@pytest.mark.parametrize("evil", EVIL)
def test_no_input_is_run(tmp_path: Path, evil: str) -> None:
    texts = {name.replace("-", "_"): evil for name in ACTION["inputs"]}
    done = run(tmp_path, (0, 0), **{**texts, "working_directory": "."})
    seen = done.arguments["hcbench"]
    lines = evil.splitlines()
    named = set(ACTION["inputs"]) - {
        "model",
        "args",
        "working-directory",
        "python-version",
        "install",
    }
    assert seen[2:] == [
        *[f"--{name}={evil}" for name in ACTION["inputs"] if name in named],
        *lines,
        "--",
        *lines,
    ]
    assert done.arguments["python"][-1] == evil
    assert (done.code, done.outputs) == (0, {"exit-code": "0"})
    assert not list(tmp_path.rglob("pwned"))


def test_no_script_has_an_expression_in_it() -> None:
    assert not [step["run"] for step in SCRIPTS if EXPRESSION.search(step["run"])]


def test_every_input_is_an_option_of_check() -> None:
    options = {flag.removeprefix("--") for option in check.params for flag in option.opts}
    own = {"model", "args", "working-directory", "python-version", "install"}
    old = {flag.removeprefix("--") for flag in OLD_FLAGS["check"]}
    assert set(ACTION["inputs"]) - own <= options | old
