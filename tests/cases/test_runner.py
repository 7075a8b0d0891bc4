"""The runner that engines vendor: one file of the standard library,
verdicts, known failures, JUnit.
"""

from __future__ import annotations

import ast
import json
import os
import re
import signal
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from artificial_engines import FallsThrough

from hcbench import cli
from hcbench.cases import make
from hcbench.cases.hcbench_cases import junit, outcome, run
from hcbench.cases.score import (
    RUNNER,
    adapters,
    known_failures,
    regressions,
    run_engines,
    score,
    the_cases,
)
from hcbench.system.errors import EngineFailed

# Both of code alone: comments and docstrings help who copies a file. Characters, not lines: a limit
# on lines fills each of them.
RUNNER_CHARACTERS = 15_500
ADAPTER_LINES = 120


@pytest.fixture(scope="module")
def results() -> list[dict[str, Any]]:
    pytest.importorskip("pybullet")
    pytest.importorskip("pydrake")
    return run_engines(["mujoco", "pybullet", "drake"], jobs=2)


def test_it_is_one_small_file_of_the_standard_library() -> None:
    text = RUNNER.read_text(encoding="utf-8")
    assert sum(map(len, code_lines(text))) <= RUNNER_CHARACTERS
    assert "SPDX-License-Identifier: Apache-2.0" in text
    tree = list(ast.walk(ast.parse(text)))
    imported = {alias.name for node in tree if isinstance(node, ast.Import) for alias in node.names}
    imported |= {str(node.module) for node in tree if isinstance(node, ast.ImportFrom)}
    assert {name.partition(".")[0] for name in imported} <= sys.stdlib_module_names


def code_lines(text: str) -> list[str]:
    """Lines of Python, stripped, without docstrings, comments and empty ones."""
    said = set[int]()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            said |= {*range(node.lineno, 1 + (node.end_lineno or node.lineno))}
    lines = enumerate(map(str.strip, text.splitlines()), 1)
    return [line for i, line in lines if line and line[0] != "#" and i not in said]


EXAMPLES = {
    path.stem: path
    for path in (Path(__file__).parents[2] / "examples" / "cases").glob("*_adapter.py")
}
OF_ENGINES = {**adapters(), **EXAMPLES}


@pytest.mark.parametrize("path", OF_ENGINES.values(), ids=OF_ENGINES)
def test_an_adapter_is_small_and_needs_its_engine_alone(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(code_lines(text)) <= ADAPTER_LINES
    assert "import hcbench" not in text
    assert "from hcbench" not in text


def test_an_engine_in_two_dimensions_can_run_every_case() -> None:
    for case in the_cases()["cases"]:
        for world in (each["world"] for each in case["runs"]):
            assert world["gravity"][1] == 0
            for body in world["bodies"]:
                assert (
                    body["position"][1]
                    == body["velocity"][1]
                    == body["spin"][0]
                    == body["spin"][2]
                    == 0
                )


class ManyWorlds:
    """An engine without contacts that steps many worlds at once."""

    name, version, combine = "many", "1", None

    def __init__(self) -> None:
        self.worlds, self.batches = list[dict[str, Any]](), list[int]()

    def make(self, world: dict[str, Any]) -> None:
        if "materials" in world:
            raise NotImplementedError("has no materials")
        self.worlds.append(world)

    def start(self) -> None:
        self.at = [
            [[*b["position"], *b["velocity"], 0, 0, 0] for b in w["bodies"]] for w in self.worlds
        ]
        self.h = {world["timestep"] for world in self.worlds}
        self.batches.append(len(self.worlds))
        self.worlds = []

    def step(self) -> None:
        (h,) = self.h
        self.at = [
            [[*(x + h * v for x, v in zip(b, b[3:6], strict=False)), *b[3:]] for b in w]
            for w in self.at
        ]

    def state(self) -> list[list[list[float]]]:
        return self.at


def test_an_engine_of_many_worlds_gets_those_of_a_kind_at_once() -> None:
    engine, cases = ManyWorlds(), the_cases(["C05", "C07", "C10"])
    runs = run(engine, cases)["runs"]
    assert sorted(engine.batches) == [12, 12, 15, 15]  # two steps each; C10 is not made
    assert {"unsupported": "has no materials"} in runs["C10"]
    for case in cases["cases"][:2]:
        for each, done in zip(case["runs"], runs[case["id"]], strict=True):
            step, body, *_ = done["states"][-1]
            start = each["world"]["bodies"][0]
            moved = each["world"]["timestep"] * step * start["velocity"][0]
            assert body[0] == pytest.approx(start["position"][0] + moved)


def test_engines_do_what_they_are_known_to(results: list[dict[str, Any]]) -> None:
    for each in results:
        found = score(each)
        known = known_failures().get(found.engine, {})
        failed = {v["case"] for v in found.verdicts if v["verdict"] in ("fail", "error")}
        assert failed == set(known), found.name
        if not found.engine.endswith("-stock"):
            assert found.restitution == (None if found.engine == "drake" else "obeyed")


MANY = ("newton", "mujoco-warp", "mjx", "opensim", "physx", "rapier", "dart", "exudyn")


@pytest.mark.slow
@pytest.mark.skipif("HCBENCH_ENGINES" not in os.environ, reason="by `make test-engines`")
def test_engines_from_the_index_do_what_they_are_known_to() -> None:
    every = [score(each) for each in run_engines(MANY, jobs=2)]
    for found in every:
        failed = {v["case"] for v in found.verdicts if v["verdict"] in ("fail", "error")}
        assert failed == set(known_failures().get(found.engine, {})), found.name
        # Newton's Steel takes 18 s; JAX compiles MJX first.
        assert found.cpu_s < 30 or found.engine.startswith("mjx"), found.name


def test_without_its_package_an_engine_author_needs_two_files(tmp_path: Path) -> None:
    for path in (RUNNER, RUNNER.with_name("hcbench-cases-1.json"), adapters()["mujoco"]):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "known.json").write_text(json.dumps(known_failures()), encoding="utf-8")
    (tmp_path / "cases.py").rename(tmp_path / "adapter.py")
    command = [
        sys.executable,
        "hcbench_cases.py",
        "adapter.py",
        "--expected",
        "known.json",
        "--junit",
        "j.xml",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    tree = ElementTree.parse(tmp_path / "j.xml")
    assert len(list(tree.iter("testcase"))) == 2 * 18  # with the best known settings, and stock
    skipped = {case.get("classname") for case in tree.iter("testcase") if len(case)}
    assert skipped == {"hcbench-cases.mujoco", "hcbench-cases.mujoco-stock"}
    assert not list(tree.iter("failure"))


ABORTS = """\
import os
class Engine:
    name, version, combine = "mine", "1", None
    def make(self, world):
        if len(world["bodies"]) > 1:
            os.abort()
        raise TypeError("no colliders")
ENGINES = [Engine]
"""


def runner(folder: Path, adapter: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    (folder / "adapter.py").write_text(adapter, encoding="utf-8")
    command = [sys.executable, str(RUNNER), "adapter.py", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_an_engine_that_aborts_costs_its_own_case_and_an_error_is_told_once(
    tmp_path: Path,
) -> None:
    done = runner(tmp_path, ABORTS, "--out", "out.json", "--junit", "j.xml")
    assert done.returncode == 1
    assert done.stderr.count("TypeError: no colliders (adapter.py, line 7)") == 1
    (results,) = json.loads((tmp_path / "out.json").read_text("utf-8"))
    assert len(results["runs"]) == 18
    aborted = {case for case, runs in results["runs"].items() if "ended with" in runs[0]["error"]}
    assert aborted == {"C07", "C08", "C14", "C17", "C18"}  # those of several bodies
    assert len(list(ElementTree.parse(tmp_path / "j.xml").iter("failure"))) == 18


ENDS_ITS_RUNNER = """\
import os, signal
class Engine:
    name, version, combine = "mine", "1", None
    def make(self, world):
        if world["gravity"][2]:
            os.kill(os.getppid(), signal.SIGKILL)
        raise NotImplementedError("no balls")
ENGINES = [Engine]
"""


@pytest.mark.skipif(sys.platform == "win32", reason="has no SIGKILL")
def test_a_runner_that_is_killed_leaves_the_cases_before(tmp_path: Path) -> None:
    done = runner(tmp_path, ENDS_ITS_RUNNER, "--out", "out.json", "--junit", "j.xml")
    assert done.returncode == -signal.SIGKILL
    (results,) = json.loads((tmp_path / "out.json").read_text("utf-8"))
    assert [*results["runs"]] == ["C01"]  # the next one has gravity
    (case,) = ElementTree.parse(tmp_path / "j.xml").iter("testcase")
    assert case.get("name", "").startswith("C01 ")


HANGS = """\
import time
class Engine:
    name, version, combine = "mine", "1", None
    def make(self, world):
        self.count = len(world["bodies"])
    def step(self):
        if self.count > 1:
            time.sleep(3600)
        raise TypeError("cannot step")
    def state(self):
        return [[0] * 9] * self.count
ENGINES = [Engine]
"""


def test_an_engine_that_hangs_costs_its_own_case_and_the_limit_is_named(tmp_path: Path) -> None:
    done = runner(tmp_path, HANGS, "--out", "out.json", "--limit", "2")
    assert done.returncode == 1
    (results,) = json.loads((tmp_path / "out.json").read_text("utf-8"))
    late = {
        case
        for case, runs in results["runs"].items()
        if runs[0]["error"] == "took longer than --limit, 2 s"
    }
    assert late == {"C07", "C08", "C14", "C17", "C18"}  # those of several bodies
    assert len(results["runs"]) == 18


def only_c09(folder: Path) -> str:
    path = folder / "only.json"
    path.write_text(make.text(["C09"]), encoding="utf-8")
    return str(path)


def test_an_engine_whose_start_hangs_ends_the_run(tmp_path: Path) -> None:
    hangs = "import time\nENGINES = [lambda: time.sleep(3600)]"
    done = runner(tmp_path, hangs, "--limit", "1", "--cases", only_c09(tmp_path))
    assert done.returncode == 3
    assert "took longer than --limit, 1 s" in done.stderr


def test_the_command_hands_its_limit_on() -> None:
    with pytest.raises(EngineFailed, match=r"took longer than --limit, 0\.001 s"):
        run_engines(["mujoco"], only=["C09"], limit=1e-3)


@pytest.mark.parametrize(
    ("adapter", "arguments", "code", "said"),
    [
        ("import nothing_here", (), 3, "ModuleNotFoundError: .*(adapter.py, line 1)"),
        ("ENGINES = [lambda: 1 / 0]", (), 3, "ZeroDivisionError: .*(adapter.py, line 1)"),
        ("ENGINES = []", ("--expected", "none.json"), 2, "none.json"),
        ("ENGINES = []", (), 3, "adapter.py: ENGINES makes no engine"),
    ],
)
def test_the_runner_ends_as_a_command_should(
    tmp_path: Path, adapter: str, arguments: tuple[str, ...], code: int, said: str
) -> None:
    done = runner(tmp_path, adapter, *arguments)
    assert done.returncode == code
    assert re.search(said.replace("(", r"\(").replace(")", r"\)"), done.stderr)


ONE_CANNOT_BE_MADE = """\
class Engine:
    name, version, combine = "mine", "1", None
    def make(self, world):
        raise NotImplementedError("no balls")
ENGINES = [lambda: 1 / 0, Engine]
"""


def test_an_engine_that_cannot_be_made_is_an_error_and_the_next_one_runs(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    arguments = ("--cases", only_c09(tmp_path), "--out", "out.json")
    done = runner(tmp_path, ONE_CANNOT_BE_MADE, *arguments)
    assert done.returncode == 1
    assert "ENGINES[0] C09 failure" in done.stderr
    first, second = [score(each, only=["C09"]) for each in json.loads(out.read_text("utf-8"))]
    assert (first.engine, first.verdicts[0]["verdict"]) == ("ENGINES[0]", "error")
    assert re.match(r"ZeroDivisionError: .* \(adapter.py, line 5\)", first.verdicts[0]["why"])
    assert (second.engine, second.verdicts[0]["verdict"]) == ("mine", "unsupported")


COLOURS = """\
class Engine:
    name, version, combine = "mine", "1", None
    def make(self, world):
        raise TypeError("\\x1b[31mno\\x00 \\udc80<balls>")
ENGINES = [Engine]
"""


def test_junit_is_xml_whatever_an_engine_says(tmp_path: Path) -> None:
    runner(tmp_path, COLOURS, "--cases", only_c09(tmp_path), "--junit", "j.xml")
    (failure,) = ElementTree.parse(tmp_path / "j.xml").iter("failure")
    assert failure.get("message", "").startswith("error: TypeError: [31mno <balls> (adapter.py")


class LosesABody(FallsThrough):
    """State of the first body alone."""

    def state(self) -> list[list[float]]:
        return self.bodies[:1]


def test_a_state_without_one_of_the_bodies_is_an_error() -> None:
    on_meshes = the_cases(["C17", "C18"])
    found = score(run(LosesABody(), on_meshes), only=["C17", "C18"])
    for verdict in found.verdicts:
        assert verdict["verdict"] == "error"
        assert verdict["why"].startswith("ValueError: step 29: 1 bodies, not 2 ")


def test_a_vendored_folder_is_small_and_its_test_runs_alone(tmp_path: Path) -> None:
    folder = tmp_path / "bounces"
    assert cli.run(["cases", "vendor", "--case", "C01", "--case", "C05", str(folder)]) == 0
    size = sum(path.stat().st_size for path in folder.iterdir())
    assert size <= 45_000, "as docs/howto/cases.md says"
    for path in folder.glob("*.py"):
        if path.name != "adapter.py":
            assert "SPDX-License-Identifier: Apache-2.0" in path.read_text("utf-8")
    command = [sys.executable, "-I", "-m", "unittest", "discover", str(folder)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Ran 2 tests" in done.stderr
    assert "skipped=2" in done.stderr  # the outline of an adapter can make no world
    good = adapters()["mujoco"].read_text("utf-8")
    (folder / "adapter.py").write_text(good, encoding="utf-8")
    assert cli.run(["cases", "vendor", "--case", "C01", "--force", str(folder)]) == 0
    assert (folder / "adapter.py").read_text("utf-8") == good
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "skipped=1" in done.stderr  # stock MuJoCo has no restitution
    assert done.returncode == 0, done.stderr
    by_pytest = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir=."]
    done = subprocess.run(by_pytest, cwd=folder, capture_output=True, text=True, check=False)
    assert "1 passed, 1 skipped" in done.stdout


def test_a_symptom_is_asked_of_its_case_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["cases", "run", "mujoco", "--case", "C09", "--case", "C13"]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in shown[1:3]] == ["C09", "C13"]
    assert shown[3].split()[:2] == ["passed", "2"]
    assert len(shown) == 4
    assert cli.run(["cases", "run", "mujoco", "--case", "C99"]) == 2


def test_junit_tells_versions_apart(tmp_path: Path) -> None:
    out = tmp_path / "j.xml"
    assert cli.run(["cases", "run", "mujoco", "--case", "C09", "--junit", str(out)]) == 0
    names = [suite.get("name") for suite in ElementTree.parse(out).getroot()]
    about = version("mujoco")
    assert names == [f"hcbench-cases mujoco {about}", f"hcbench-cases mujoco-stock {about}"]


def verdict(word: str) -> dict[str, Any]:
    return {"case": "C01", "title": "Bounces", "verdict": word, "why": "e is 0", "worst": {}}


@pytest.mark.parametrize(
    ("word", "known", "kind"),
    [
        ("pass", False, "passed"),
        ("fail", False, "failure"),
        ("error", False, "failure"),
        ("unsupported", False, "skipped"),
        ("fail", True, "skipped"),
        ("pass", True, "failure"),
    ],
)
def test_a_known_failure_is_skipped_until_it_passes(word: str, known: bool, kind: str) -> None:
    expected = {"C01": "a reason"} if known else {}
    assert outcome(verdict(word), expected)[0] == kind
    suite = ElementTree.fromstring(junit([verdict(word)], "mine", expected))
    assert [part.tag for part in suite[0]] == [kind] * (kind != "passed")
    counts = [suite.get(name) for name in ("tests", "failures", "skipped")]
    assert counts == ["1", str(int(kind == "failure")), str(int(kind == "skipped"))]


def test_a_version_that_fails_what_another_passed_is_one_line(
    results: list[dict[str, Any]],
) -> None:
    runs = results[0]["runs"]
    failed = [{"error": "it stopped"}] * len(runs["C01"])
    before, after = score(results[0]), score({**results[0], "runs": {**runs, "C01": failed}})
    assert regressions([before, before]) == []
    (line,) = regressions([before, after])
    assert line.startswith("mujoco C01 ")
    assert "error" in line


def test_what_run_writes_score_reads_and_run_replaces(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "results.json"
    for _ in range(2):  # the second replaces the first without --force
        assert cli.run(["cases", "run", "mujoco", "--case", "C09", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert isinstance(json.loads(out.read_text("utf-8")), list)
    assert "C09" in printed


def test_the_command_judges_results_of_any_language(
    results: list[dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.json"
    mine.write_text(
        json.dumps({**results[0], "engine": {"name": "mine", "version": "7", "combine": None}}),
        "utf-8",
    )
    assert cli.run(["cases", "score", str(mine), "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)
    assert told["engine"] == "mine"
    assert told["passed"] == score(results[0]).passed
    for nothing in ("{}", "[]", "[1]"):
        mine.write_text(nothing, "utf-8")
        assert cli.run(["cases", "score", str(mine)]) == 2
    assert cli.run(["cases", "run", "nothing"]) == 2


def test_a_folder_gets_all_of_its_files_or_none(tmp_path: Path) -> None:
    mine = tmp_path / "test_hcbench_cases.py"
    mine.write_text("mine", "utf-8")
    assert cli.run(["cases", "vendor", str(tmp_path)]) == 2
    assert list(tmp_path.iterdir()) == [mine]


@pytest.mark.skipif(sys.platform != "linux", reason="no folder can be made in /proc of Linux alone")
def test_a_folder_that_cannot_be_made_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["cases", "vendor", "/proc/mine"]) == 3
    assert capsys.readouterr().err.startswith("hcbench: FOLDER: /proc/mine: ")
