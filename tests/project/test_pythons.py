"""The wheel in every Python of this machine, in environments of its own: `make test-pythons`.

Takes minutes and the package index. Each command runs as a stranger
would run it, from an empty folder.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hcbench.environments import interpreters

ROOT = Path(__file__).parents[2]


def minor_of(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")[:2]))


ASKED = "HCBENCH_PYTHONS" in os.environ
# uv asks each Python of the machine, which takes a second: not where the suite alone is collected
NEWEST = {minor_of(version): version for version in reversed(interpreters() if ASKED else [])}
PYTHONS = [version for minor, version in NEWEST.items() if (3, 11) <= minor <= (3, 14)]
pytestmark = pytest.mark.skipif(not ASKED, reason="by `make test-pythons`")
ADD = "hcbench engines add pybullet --python 3.11"
COMMANDS = [
    "report --quick --out quick",
    "report field --quick --out field",
    "paper --quick --out paper",
    'tune mujoco --alpha "0.008 s/in" --timestep 1e-3',
    "measure my.xml --pair ball,plate",
    "check my.xml --pair ball,plate --restitution 0.9",
    "fit drop.wav",
]
STUDY = """title = "Two environments"
scene = "steel-plane"
alphas = "0.008 s/in"
speeds = "8 in/s"
phases = 1
train_height = "10 mm"
train_step = "1e-3 s"
[[run]]
engine = "pybullet@3.2.7"
recipe = "restitution"
timesteps = "1e-3 s"
[[run]]
engine = "mujoco@3.3.0"
recipe = "impulse"
timesteps = "1e-3 s"
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "uv", "build", "--wheel", "-q", "-o", str(folder), str(ROOT)],
        check=True,
    )
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module", params=PYTHONS)
def installed(
    request: pytest.FixtureRequest, wheel: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """An empty folder beside a new environment with the wheel."""
    folder = tmp_path_factory.mktemp(f"python{request.param}")
    uv = [sys.executable, "-m", "uv"]
    subprocess.run([*uv, "venv", "-q", "--python", request.param, str(folder / "env")], check=True)
    python = str(folder / "env" / "bin" / "python")
    subprocess.run([*uv, "pip", "install", "-q", "--python", python, str(wheel)], check=True)
    (folder / "my.xml").write_bytes((ROOT / "examples" / "good.xml").read_bytes())
    (folder / "drop.wav").write_bytes((ROOT / "examples" / "recording" / "drop.wav").read_bytes())
    (folder / "two.toml").write_text(STUDY, encoding="utf-8")
    return folder


def run(folder: Path, command: str) -> subprocess.CompletedProcess[str]:
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}
    return subprocess.run(
        f'"{folder}/env/bin/hcbench" {command}',
        shell=True,
        cwd=folder,
        env={**kept, "HCBENCH_DATA": str(folder / "data")},
        capture_output=True,
        text=True,
        check=False,
    )


def engines_in(table: Path) -> set[str]:
    with table.open(encoding="utf-8") as file:
        return {row["engine"] for row in csv.DictReader(file)}


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: " ".join(c.split()[:2]))
def test_what_a_stranger_types_first_runs(installed: Path, command: str) -> None:
    done = run(installed, command)
    assert done.returncode == 0, done.stderr
    if command.startswith("report") and "pybullet" in done.stderr:
        page = installed / command.rsplit(maxsplit=1)[-1] / "index.html"
        assert ADD in done.stderr
        assert ADD in page.read_text(encoding="utf-8")


def test_an_engine_by_name_ends_with_the_command_that_adds_it_and_then_runs(
    installed: Path,
) -> None:
    missing = run(installed, "tune pybullet@3.2.6 --restitution 0.9 --timestep 1e-3")
    assert missing.returncode == 3
    assert "hcbench engines add pybullet@3.2.6 --python 3.11" in missing.stderr
    for name in ("pybullet --python 3.11", "mujoco@3.3.0"):
        added = run(installed, f"engines add {name}")
        assert added.returncode == 0, added.stderr
    done = run(installed, "report --quick --out full")
    assert done.returncode == 0, done.stderr
    assert "left out" not in done.stderr
    assert "pybullet" in engines_in(installed / "full" / "trains.csv")
    done = run(installed, "report two.toml --out two")
    assert done.returncode == 0, done.stderr
    for table in ("restitution", "trains"):
        assert engines_in(installed / "two" / f"{table}.csv") == {"pybullet@3.2.7", "mujoco@3.3.0"}
