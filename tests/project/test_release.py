"""A release: a wheel that runs the examples of the README, with nothing else of the repository."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import numpy as np
import pytest

import hcbench

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
STUDY = """scene = "steel-plane"
alphas = "0.008 s/in"
speeds = "4, 16 in/s"
phases = 2
[[run]]
engine = "mujoco"
recipe = "impulse"
timesteps = 1e-3
"""
ENVIRONMENT = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}
COMMANDS = [
    'law --alpha "0.008 s/in" --speeds "4, 8, 12, 16 in/s"',
    "engines",
    "materials",
    'tune pybullet --alpha "0.3 s/m" --timestep "2 ms" --plugin --write-scene drop.py',
    "fit drop.wav",
    "measure my.xml",
    "measure my.xml --pair ball,plate",
    "check my.xml --pair ball,plate --restitution 0.9 --max-error 0.02 --junit out.xml --png error.png",
    "check my.xml --pair ball,plate --write-baseline bounce.json",
    'convert --alpha "0.008 s/in" --speed "8 in/s" --timestep 1e-3',
    "report my/study.toml --out my/report --jobs 2",
    "sweep my/study.toml --out my/sweep --jobs 2",
    "cases run mujoco pybullet --case C01 --case C09",
    "randomize my.xml --pair ball,plate --restitution 0.3:0.6 --worlds 16 --out worlds.npz",
    "plugin mujoco",
    "docs howto/tune",
]
README = re.findall(
    r"^\$ hcbench (.*)$", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE
)


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sdist, and the wheel that is built from it."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "uv", "build", "--quiet", "--out-dir", str(folder), str(ROOT)]
    # of its own, for users without a home
    has_home = os.access(Path.home(), os.W_OK)
    cache = {} if has_home else {"UV_CACHE_DIR": str(tmp_path_factory.mktemp("cache"))}
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, **cache}
    )
    if done.returncode and "fetch" in done.stderr:
        pytest.skip("no package index to take the build backend from")
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def installed(dist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command of an environment that has the wheel, its dependencies,
    and nothing of this repository.
    """
    folder = tmp_path_factory.mktemp("env")
    venv.create(folder, with_pip=False)
    paths = {"base": str(folder), "platbase": str(folder)}
    site = Path(sysconfig.get_path("purelib", "venv", paths))
    dependencies = {sysconfig.get_path("purelib"), str(Path(str(np.__file__)).parents[1])}
    (site / "dependencies.pth").write_text("\n".join(sorted(dependencies)) + "\n")
    (wheel,) = dist.glob("*.whl")
    scripts = Path(sysconfig.get_path("scripts", "venv", paths))
    python = str(scripts / "python")
    command = [
        sys.executable,
        "-m",
        "uv",
        "pip",
        "install",
        "-q",
        "--no-deps",
        "--python",
        python,
        str(wheel),
    ]
    subprocess.run(command, check=True)
    return scripts / "hcbench"


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("elsewhere")
    (folder / "my").mkdir()
    (folder / "my" / "study.toml").write_text(STUDY, encoding="utf-8")
    (folder / "my.xml").write_bytes((ROOT / "examples" / "good.xml").read_bytes())
    (folder / "drop.wav").write_bytes((ROOT / "examples" / "recording" / "drop.wav").read_bytes())
    return folder


@pytest.mark.parametrize("command", README)
def test_the_wheel_runs_what_the_readme_shows(
    installed: Path, elsewhere: Path, command: str
) -> None:
    done = subprocess.run(
        f'"{installed}" {command}',
        shell=True,
        cwd=elsewhere,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert all(line.startswith("warning: ") for line in done.stderr.splitlines())
    assert done.stdout


# One process for all: it starts for longer than most of them take.
RUN_ALL = """
import contextlib, io, json, shlex, sys
from hcbench.cli import run

printed = []
for command in json.load(sys.stdin):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run(shlex.split(command))
    printed.append([code, out.getvalue(), err.getvalue()])
print(json.dumps(printed))
"""


def test_the_wheel_runs_every_command(installed: Path, elsewhere: Path) -> None:
    done = subprocess.run(
        [str(installed.with_name("python")), "-c", RUN_ALL],
        cwd=elsewhere,
        env=ENVIRONMENT,
        input=json.dumps(COMMANDS),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    printed = dict(zip(COMMANDS, json.loads(done.stdout), strict=True))
    assert {command: err for command, (code, _, err) in printed.items() if code} == {}
    assert [command for command, (_, out, _) in printed.items() if not out] == []
    lines = [line for _, _, err in printed.values() for line in err.splitlines()]
    assert [line for line in lines if not line.startswith("warning: ")] == []


def test_every_command_of_the_readme_is_run_here() -> None:
    assert len(README) >= 2
    table = re.findall(r"`hcbench (\w+)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert set(table) <= {command.split()[0] for command in COMMANDS}


def test_it_is_the_wheel_that_ran(installed: Path, elsewhere: Path) -> None:
    code = "import hcbench; print(hcbench.__file__)"
    python = str(installed.with_name("python"))
    place = subprocess.run(
        [python, "-c", code],
        cwd=elsewhere,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert not Path(place.stdout.strip()).is_relative_to(ROOT)
    assert Path(place.stdout.strip()).is_relative_to(installed.parents[1])


def test_the_sdist_has_what_it_takes_to_test_and_to_cite(dist: Path) -> None:
    (sdist,) = dist.glob("*.tar.gz")
    with tarfile.open(sdist) as tar:
        names = {name.partition("/")[2] for name in tar.getnames()}
    assert {
        "CITATION.cff",
        "SECURITY.md",
        "LICENSE",
        "CHANGELOG.md",
        "README.md",
        "docs/index.md",
    } <= names
    assert {
        "tests/project/test_release.py",
        "examples/good.xml",
        "scenes/README.md",
        "hcbench/laws/impacts.c",
    } <= names


def test_the_wheel_has_its_licence_and_type_marker(dist: Path) -> None:
    (wheel,) = dist.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        names = file.namelist()
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert "hcbench/py.typed" in names
    assert not [name for name in names if name.startswith(("tests/", "benchmarks/"))]


def test_links_of_the_readme_work_on_the_package_index(dist: Path) -> None:
    (wheel,) = dist.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        (name,) = (name for name in file.namelist() if name.endswith("METADATA"))
        text = file.read(name).decode()
    repository, site = (PROJECT["urls"][key] for key in ("Source", "Documentation"))
    tag = f"v{PROJECT['version']}"
    places = (f"{site}/", f"{repository}/blob/{tag}/", f"{repository}/raw/{tag}/")
    links = re.findall(r"\]\(([^)]*)\)", text)
    assert len(links) > 15
    for link in links:
        place = next((place for place in places if link.startswith(place)), None)
        assert place, link
        assert (ROOT / link.removeprefix(place)).is_file(), link


def test_every_place_says_the_same_version() -> None:
    version = PROJECT["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\n## {version} (" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert hcbench.__version__ == version
