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
TARGETS = set(
    re.findall(r"^([a-z][\w-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
)
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
    texts = [
        re.sub(r"<<'(\w+)'\n.*?^\1$", "", text, flags=re.DOTALL | re.MULTILINE) for text in texts
    ]
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


def test_the_tests_run_on_every_system_python_and_end_of_the_versions() -> None:
    jobs = read(ROOT / ".github" / "workflows" / "test.yml")["jobs"]
    pythons = ["3.11", "3.12", "3.13", "3.14"]
    systems = ["ubuntu-latest", "macos-latest", "windows-latest"]
    assert jobs["test"]["strategy"]["matrix"] == {"os": systems, "python": pythons}
    assert jobs["newest"]["strategy"]["matrix"] == {"python": pythons}
    for leg in ("lowest", "newest"):
        assert commands(jobs[leg]) == [f"make test-{leg} PYTHON=python"]


# https://docs.github.com/en/communities/using-templates-to-encourage-useful-issues-and-pull-requests
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
LABELLED = {"textarea", "input", "dropdown", "checkboxes"}


@pytest.mark.parametrize(
    "path", [path for path in FORMS if path.stem != "config"], ids=lambda p: p.name
)
def test_github_can_load_an_issue_form(path: Path) -> None:
    form = read(path)
    assert (
        {"name", "description", "body"}
        <= set(form)
        <= {"name", "description", "body", "labels", "title"}
    )
    identities = [each["id"] for each in form["body"] if "id" in each]
    assert len(set(identities)) == len(identities)
    assert LABELLED & {each["type"] for each in form["body"]}
    for each in form["body"]:
        assert each["type"] in {"markdown", *LABELLED}
        assert set(each) <= {"type", "id", "attributes", "validations"}
        asked = {"value"} if each["type"] == "markdown" else {"label"}
        asked |= {"options"} if each["type"] in ("dropdown", "checkboxes") else set()
        assert asked <= set(each["attributes"]), each


def test_github_can_load_the_choice_of_issue_forms() -> None:
    config = read(ROOT / ".github" / "ISSUE_TEMPLATE" / "config.yml")
    assert config["blank_issues_enabled"] in (True, False)
    assert all({"name", "url", "about"} == set(link) for link in config.get("contact_links", []))


def test_github_can_load_the_updates_of_dependencies() -> None:
    content = read(ROOT / ".github" / "dependabot.yml")
    assert content["version"] == 2
    for update in content["updates"]:
        assert {"package-ecosystem", "directory", "schedule"} <= set(update)
        assert update["schedule"]["interval"] in ("daily", "weekly", "monthly")
        assert all("patterns" in group for group in update.get("groups", {}).values())
    assert {each["package-ecosystem"] for each in content["updates"]} == {"github-actions", "pip"}


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.name)
def test_no_workflow_pastes_an_expression_into_a_script(path: Path) -> None:
    pasted = [c for job in read(path)["jobs"].values() for c in commands(job) if "${{" in c]
    assert not pasted
