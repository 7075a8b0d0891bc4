"""Engines in environments of their own: versions side by side, nothing
half-made, one line for what fails.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
import toy_engine
from packaging.requirements import Requirement

from hcbench import environments, load_scene, workers
from hcbench.benchmark.run import run_study
from hcbench.benchmark.study import study_from
from hcbench.cli import run
from hcbench.laws import closed_form
from hcbench.sim import entry_points, install, registry
from hcbench.sim.capabilities import opener
from hcbench.sim.model_under_test import Request
from hcbench.system.errors import EngineMissing, UserError
from hcbench.terms.impact import Launch
from hcbench.terms.setting import Setting

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.workers import Interpreter

SCENE = load_scene("steel-plane")
MODEL = Path(__file__).parents[2] / "examples" / "good.xml"
STUDY = {"scene": "steel-plane", "alphas": "0.008 s/in", "speeds": "8, 16 in/s", "phases": 1}


@pytest.fixture(scope="module")
def module_patch() -> Iterator[pytest.MonkeyPatch]:
    with pytest.MonkeyPatch.context() as patch:
        yield patch


@pytest.fixture(scope="module", autouse=True)
def index(tmp_path_factory: pytest.TempPathFactory, module_patch: pytest.MonkeyPatch) -> Path:
    """The packages there are, in place of an index."""
    folder = toy_engine.wheels(tmp_path_factory.mktemp("wheels"))
    (folder / "empty").mkdir()
    module_patch.setenv("UV_DEFAULT_INDEX", (folder / "empty").as_uri())
    module_patch.setenv("UV_INDEX_URL", (folder / "empty").as_uri())
    module_patch.setenv("UV_FIND_LINKS", str(folder))
    module_patch.setenv("UV_CACHE_DIR", str(folder / "cache"))
    return folder


@pytest.fixture(scope="module", autouse=True)
def adapter(
    tmp_path_factory: pytest.TempPathFactory, module_patch: pytest.MonkeyPatch
) -> Iterator[None]:
    yield from toy_engine.registered(tmp_path_factory.mktemp("adapter"), module_patch)


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory, index: Path) -> Path:
    """A data folder with toy@1.0, toy@2.0 and a MuJoCo that says it is 3.9."""
    folder = tmp_path_factory.mktemp("data")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HCBENCH_DATA", str(folder))
        assert run(["engines", "add", "toy@1.0", "toy@2.0", "mujoco@3.9"]) == 0
    return folder


@pytest.fixture
def there(shared: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The data folder that is looked into."""
    monkeypatch.setenv("HCBENCH_DATA", str(shared))
    return shared / "hcbench" / "engines"


@pytest.fixture
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data folder with nothing in it."""
    monkeypatch.setenv("HCBENCH_DATA", str(tmp_path))
    return tmp_path / "hcbench" / "engines"


def e_of(name: str, speed: float = 0.4) -> float:
    """Restitution in an engine, stock."""
    (impact,) = registry.engine(name).run(SCENE, Setting(name, "stock", 1e-6), [Launch(speed, 0.5)])
    return impact.restitution


def law(alpha: float, speed: float = 0.4) -> float:
    return float(closed_form.restitution(alpha, speed))


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


def test_the_python_of_hcbench_and_those_of_pyenv_are_found_by_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for version in ("3.11.0", "3.98.2", "3.98.10", "3.9.1"):
        python = tmp_path / "versions" / version / "bin" / "python"
        python.parent.mkdir(parents=True)
        python.touch()
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path))
    assert environments._known("3.98") == str(tmp_path / "versions" / "3.98.10" / "bin" / "python")
    assert environments._known(platform.python_version()) == sys.executable
    assert (
        environments._known("3.9")
        == environments._known("3.97")
        == environments._known("/usr/bin/python")
        == ""
    )


def test_versions_stand_side_by_side(there: Path) -> None:
    assert e_of("toy@1.0") == pytest.approx(law(0.1), abs=1e-9)
    assert e_of("toy@2.0") == pytest.approx(law(0.2), abs=1e-9)
    assert registry.engine("toy@1.0").version() == "1.0"
    assert registry.engine("toy@1.0").title == "Toy 1.0"


def test_the_newest_is_meant_where_no_version_is_named_and_none_is_beside(there: Path) -> None:
    assert e_of("toy") == pytest.approx(law(0.2), abs=1e-9)
    assert registry.engine("toy").version() == "2.0"


def test_a_study_compares_versions_and_is_the_same_bytes_for_any_jobs(there: Path) -> None:
    runs = [{"engine": f"toy{v}", "recipe": "stock", "timesteps": 1e-6} for v in ("@1.0", "")]
    study = study_from({**STUDY, "run": runs})
    one, two = (run_study(study, jobs) for jobs in (1, 2))
    assert one.impacts.equals(two.impacts)
    errors = one.scores.set_index("engine")["max_error_law"]
    assert errors["toy"] < errors["toy@1.0"]


def test_what_crashes_in_its_environment_costs_its_own_launch(there: Path) -> None:
    runs = [{"engine": "toy@1.0", "recipe": "stock", "timesteps": 1e-6}]
    crash = f"{toy_engine.CRASH_SPEED} m/s"
    impacts = run_study(study_from({**STUDY, "speeds": f"0.4 m/s, {crash}", "run": runs})).impacts
    assert impacts["status"].tolist() == ["parted", "crashed"]
    assert "SIGSEGV" in impacts["reason"].iloc[1]


def test_models_are_measured_checked_and_tuned_there(
    there: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    places = []

    def call(*args: Any, at: Interpreter, **limits: Any) -> Any:
        places.append(at.python)
        return workers.call(*args, at=at, **limits)

    monkeypatch.setattr(import_module("hcbench.measuring.measure"), "call", call)
    asked = [str(MODEL), "--pair", "ball,plate", "--engine", "mujoco@3.9", "--speeds", "0.5 m/s"]
    assert run(["measure", *asked]) == 0
    assert run(["check", *asked, "--restitution", "0.9", "--max-error", "0.02"]) == 0
    assert places == [str(there / "mujoco@3.9" / "bin" / "python")] * 2
    tuning = [
        "tune",
        "mujoco@3.9",
        "--restitution",
        "0.8",
        "--timestep",
        "1e-3",
        "--recipe",
        "impulse",
    ]
    capsys.readouterr()
    assert run([*tuning, "--gravity", "0", "--friction", "0"]) == 0
    assert "mujoco@3.9 impulse" in capsys.readouterr().out


def test_an_object_of_this_process_is_not_measured_in_another(there: Path) -> None:
    with pytest.raises(UserError, match=r"'mujoco@3\.9' is in an environment of its own"):
        opener(registry.engine("mujoco@3.9")).open(object(), Request())


def test_the_list_says_version_python_size_and_place(
    there: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["engines", "--json"]) == 0
    listed = {each["name"]: each for each in json.loads(capsys.readouterr().out)}
    own = listed["toy@2.0"]
    assert own["version"] == "2.0"
    assert own["where"] == str(there / "toy@2.0")
    assert own["python"].startswith("3.")
    assert own["size_bytes"] > 100
    assert "hcbench engines add toy" in listed["toy"]["install"] or not listed["toy"]["install"]
    assert listed["reference"]["version"]
    assert run(["engines", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (line,) = (line for line in lines if line.startswith("toy@2.0 "))
    assert " ".join(line.split()).startswith(f"toy@2.0 2.0, Python {own['python']}")
    assert len(lines) <= len(listed) + 2  # one line an engine


def test_beside_hcbench_it_works_without_any_environment(
    empty: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "toyphysics.py").write_text("ALPHA = 0.3\n")
    (tmp_path / "toyphysics-5.dist-info").mkdir()
    (tmp_path / "toyphysics-5.dist-info" / "METADATA").write_text(
        toy_engine.ABOUT.format("toyphysics", "5")
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert e_of("toy") == e_of("toy@5") == pytest.approx(law(0.3), abs=1e-9)
    assert not empty.exists()


def test_what_is_missing_is_said_with_the_command_that_adds_it(
    empty: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(EngineMissing, match=r"Try: hcbench engines add toy@1\.0"):
        e_of("toy@1.0")
    assert run(["tune", "toy@1.0", "--restitution", "0.8", "--timestep", "1e-3"]) == 3
    assert "Try: hcbench engines add toy@1.0" in one_line(capsys)
    with pytest.raises(UserError, match="'toys'"):
        registry.engine("toys@1.0")


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["toy@9.0"], 2, "there is no version of toyphysics==9.0"),
        (["toy@3.0"], 3, "installs, and does not run: OSError: libtoy.so: cannot open"),
        (["toy@4.0"], 2, "no wheel of it"),
        (["toy@"], 2, "a version after the @"),
        (["toy", "--python", "3.99"], 2, "'3.99' is not on this machine; expected one of: 3."),
        (["toy", "--python", "2.7"], 2, "'2.7' is not on this machine"),
        (["toy", "--python", ""], 2, "python: ''; expected a version or a path"),
        (["reference"], 2, "This one needs none"),
    ],
)
def test_what_cannot_be_added_leaves_nothing(
    empty: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, said: str
) -> None:
    assert run(["engines", "add", *arguments]) == code
    assert said in one_line(capsys)
    assert not empty.exists() or not list(empty.iterdir())


@pytest.mark.parametrize(
    "damage",
    [
        {"size_bytes": "x"},
        {"size_bytes": None},
        {"requirements": 7},
        {"schema": 2},
        {"python": "3\x1b[31m"},
        [],
    ],
)
def test_a_damaged_environment_is_none(
    empty: Path, capsys: pytest.CaptureFixture[str], damage: dict[str, Any] | list[Any]
) -> None:
    """`engines list` ended in a TypeError, or coloured the terminal."""
    folder = empty / "toy@1.0"
    folder.mkdir(parents=True)
    record = {
        "schema": 1,
        "engine": "toy",
        "version": "1.0",
        "python": "3.11",
        "size_bytes": 1,
        "requirements": [],
    }
    content = record | damage if isinstance(damage, dict) else damage
    (folder / environments.RECORD).write_text(json.dumps(content), encoding="utf-8")
    assert run(["engines", "list"]) == 0
    assert "toy@1.0" not in capsys.readouterr().out
    assert environments.installed() == []


def test_without_a_network_one_line_says_so(
    empty: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UV_FIND_LINKS", "")
    for index in ("http://127.0.0.1:9/simple", None):
        monkeypatch.setenv("UV_HTTP_RETRIES", "0")
        if index is None:
            monkeypatch.setenv("UV_OFFLINE", "1")
        else:
            monkeypatch.setenv("UV_INDEX_URL", index)
            monkeypatch.setenv("UV_DEFAULT_INDEX", index)
        assert run(["engines", "add", "toy"]) == 3
        assert "package index: cannot be reached for toy" in one_line(capsys)
        assert not list(empty.iterdir())


def fake_uv(folder: Path, then: str) -> str:
    """Code that runs `hcbench engines add toy` with a uv that does something else when it installs."""
    program = folder / "uv"
    program.write_text(
        f'#!/bin/sh\ncase "$1" in pip) {then};; *) exec "{sys.executable}" -m uv "$@";; esac\n'
    )
    program.chmod(0o755)
    return (
        f"import sys, uv; uv.find_uv_bin = lambda: {str(program)!r}\n"
        f"sys.path.insert(0, {str(Path(__file__).parents[1] / 'support')!r})\n"
        "from hcbench.cli import run; sys.exit(run(['engines', 'add', 'toy']))"
    )


def test_a_full_disk_is_said_in_one_line(
    empty: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import uv

    fake_uv(tmp_path, "echo 'failed to copy: No space left on device (os error 28)' >&2; exit 2")
    monkeypatch.setattr(uv, "find_uv_bin", lambda: str(tmp_path / "uv"))
    assert run(["engines", "add", "toy"]) == 3
    assert "no space for toy" in one_line(capsys)
    assert not list(empty.iterdir())


def test_killed_in_the_middle_nothing_is_there_and_the_next_one_cleans(
    empty: Path, tmp_path: Path
) -> None:
    code = fake_uv(tmp_path, "touch $HCBENCH_DATA/begun; exec sleep 60")
    paths = os.pathsep.join(sys.path)
    with subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": paths}
    ) as adding:
        while not (tmp_path / "begun").exists():
            assert adding.poll() is None
            time.sleep(0.02)
        adding.kill()
    (left,) = empty.iterdir()
    assert left.name.endswith(".scratch")
    assert environments.installed() == []
    with pytest.raises(UserError, match=r"no version of toyphysics==9\.0"):
        install.add("toy@9.0")
    assert not list(empty.iterdir())


def test_an_environment_of_another_hcbench_is_said_to_be_one(
    empty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = install.add("toy@1.0")
    assert install.add("toy@1.0") == made, "it is there already"
    record = made.folder / environments.RECORD
    content = json.loads(record.read_text())
    record.write_text(json.dumps({**content, "requirements": content["requirements"][1:]}))
    with pytest.raises(EngineMissing, match=r"without .*Try: hcbench engines add toy@1\.0"):
        registry.engine("toy@1.0").version()
    assert run(["engines", "add", "toy@1.0"]) == 0
    assert e_of("toy@1.0") == pytest.approx(law(0.1), abs=1e-9)
    assert run(["engines", "remove", "toy"]) == 0
    assert not list(empty.iterdir())
    assert run(["engines", "remove", "toy"]) == 2


@pytest.mark.parametrize(
    "marker",
    [
        "{python} and {extra}",
        "({python}) and ({extra})",
        "{extra} and {python}",
        "({python} and {extra})",
    ],
)
def test_a_requirement_of_an_engines_extra_keeps_its_other_condition(
    marker: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However the tool that built the adapter's package writes the two."""
    for python, holds in (("python_version >= '3.9'", True), ("python_version < '3.9'", False)):
        condition = marker.format(python=python, extra='extra == "toy"')
        dist = SimpleNamespace(name="toy-adapter", requires=[f"lib>=1; {condition}"])
        entry = SimpleNamespace(dist=dist)
        monkeypatch.setattr(entry_points, "entry_point", lambda _, entry=entry: entry)
        backend = registry.engine("toy").backend
        assert backend is not None
        (line,) = [line for line in install.requirements("toy", backend, "") if "lib" in line]
        needed = Requirement(line).marker
        assert needed is not None
        assert needed.evaluate() is holds
