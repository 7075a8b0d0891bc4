"""The files under .github: a YAML parser reads them, and the commands in them exist."""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TARGETS = set(re.findall(r"^([a-z][\w-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
# Programs that a workflow may start, besides make and python -m, whose arguments are looked up.
PROGRAMS = {"make", "python", ".venv/bin/uv"}


def read(path: Path) -> dict[str, Any]:
    """The mapping of a YAML file; GitHub's key `on` is true to a parser of YAML 1.1."""
    content: dict[Any, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    if True in content:
        content["on"] = content.pop(True)
    return content


def commands(job: dict[str, Any]) -> list[str]:
    """The command lines of a job's steps, without the text of here-documents."""
    texts = [step["run"] for step in job["steps"] if "run" in step]
    texts = [re.sub(r"<<'(\w+)'\n.*?^\1$", "", text, flags=re.DOTALL | re.MULTILINE) for text in texts]
    return [line.strip() for text in texts for line in text.splitlines() if line.strip()]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.name)
def test_github_can_load_a_workflow(path: Path) -> None:
    workflow = read(path)
    assert {"name", "on", "permissions", "jobs"} <= set(workflow)
    for name, job in workflow["jobs"].items():
        assert {"runs-on", "timeout-minutes", "steps"} <= set(job), name
        needed = job.get("needs", [])
        assert set([needed] if isinstance(needed, str) else needed) <= set(workflow["jobs"]), name
        for step in job["steps"]:
            assert ("run" in step) != ("uses" in step), step
            assert re.fullmatch(r"[\w.-]+(/[\w.-]+)+@\S+", step.get("uses", "a/b@v1")), step


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.name)
def test_the_commands_of_a_workflow_exist(path: Path) -> None:
    for job in read(path)["jobs"].values():
        for command in commands(job):
            program, *arguments = command.split()
            assert program in PROGRAMS, command
            if program == "make":
                assert arguments[0] in TARGETS, command
            if arguments[:1] == ["-m"]:
                assert find_spec(arguments[1]) or arguments[1] == "pip", command


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.name)
def test_no_workflow_pastes_an_expression_into_a_script(path: Path) -> None:
    pasted = [c for job in read(path)["jobs"].values() for c in commands(job) if "${{" in c]
    assert not pasted
