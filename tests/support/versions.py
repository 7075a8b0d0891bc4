"""Versions that hcbench works with: `python -m versions [WORDS]` runs its commands with each.

It writes the tables of docs/reference/versions.md. WORDS: run the rows whose name has one of them,
and keep what was measured of the others. A row is one environment: the newest of every package,
but for what its name says.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from table_dialects import workbook

from hcbench.environments import interpreters

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "versions.md"
MEASURED = Path(__file__).with_suffix(".json")
WORK = ROOT / ".venv-versions"
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
# The last version before the floor that pyproject.toml has.
BEFORE = {
    "mujoco": "3.10.0",
    "pybullet": "3.2.6",
    "numpy": "1.26.4",
    "scipy": "1.14.1",
    "pandas": "2.2.2",
    "matplotlib": "3.8.3",
    "pydantic": "2.10.6",
    "click": "8.1.8",
    "python-calamine": "0.2.3",
}
MUJOCOS = (
    "3.12.0",
    "3.13.0",
    "3.14.0",
    "3.15.0",
    "3.16.0",
    "3.17.0",
)  # between the floor and the newest
ADDED = tuple(
    f"mujoco@{version}"
    for version in (
        "3.3.0",
        "3.3.7",
        "3.4.0",
        "3.5.0",
        "3.6.0",
        "3.7.0",
        "3.8.0",
        "3.9.0",
        "3.10.0",
    )
)
_LIMIT_S = 600.0  # for one command, on a machine with other work
LAW = '--alpha "0.3 s/m" --timestep "2 ms" --speeds "0.1:2 m/s"'
CHECK = '--pair ball,plate --alpha "0.3 s/m" --speeds "0.1:2:3 m/s" --max-error 0.05'
# Seconds from a drop of .8 m to each touch; e is .8.
TOUCHES = (0.4039, 1.0501, 1.5670, 1.9806, 2.3114, 2.5761)
STUDY = """title = "One ball"
scene = "steel-plane"
alphas = "0.3 s/m"
speeds = "0.2 m/s"
phases = 1
train_height = "10 mm"
train_step = "1e-3 s"
[[run]]
engine = "ENGINE"
recipe = "impulse"
timesteps = "1e-3 s"
"""
DROPS = [["touch", "time (s)"], *([str(n), repr(t)] for n, t in enumerate(TOUCHES, 1))]
COMMANDS = (
    f"tune mujoco {LAW} --write-scene ball.xml",
    f"check ball.xml {CHECK}",
    "measure my.xml --pair ball,plate",
    'tune my.xml --pair ball,plate --restitution 0.9 --timestep "2 ms"',
    "pairs quadruped.xml",
    'land quadruped.xml --heights "5 cm"',
    "fit drop.wav",
    "fit drops.xlsx",
    'law --alpha "0.3 s/m" --speeds "0.5 m/s"',
    'convert --alpha "0.3 s/m" --speed "0.5 m/s"',
    "report --quick --out report",
    "sweep study.toml --out sweep -j 1",
    "cases run mujoco --case C01",
    "randomize my.xml --pair ball,plate --restitution 0.3:0.6 --worlds 16 --out worlds.npz",
    "engines",
    "plugin mujoco",
    "pytest test_bounce.py",
)
PYBULLET = ('tune pybullet --restitution 0.9 --timestep "2 ms"', "plugin pybullet")
OF_ADDED = (
    'tune ENGINE --restitution 0.9 --timestep "1 ms"',
    "measure my.xml --pair ball,plate --engine ENGINE",
    "check my.xml --pair ball,plate --restitution 0.9 --engine ENGINE",
    "report study.toml --out report",
    "cases run ENGINE --case C01",
)


@dataclass(frozen=True, slots=True)
class Row:
    """One environment. pins: versions in place of the newest.

    added: the engine that `hcbench engines add` adds to it; its commands are those of that engine.
    """

    name: str
    python: str = "3.11"
    pins: tuple[str, ...] = ()
    added: str = ""

    def commands(self) -> tuple[str, ...]:
        """The command lines without `hcbench`, but for those of pytest."""
        if self.added:
            return tuple(
                each.replace("ENGINE", self.added)
                for each in (f"engines add {self.added}", *OF_ADDED)
            )
        bullet = PYBULLET if self.python == "3.11" else ()
        return (*COMMANDS, *bullet)


def floors() -> dict[str, str]:
    """Each dependency's lowest version in pyproject.toml, in three numbers."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    found = re.findall(
        r'(?m)^  "([\w-]+)>=([\d.]+)[";,]', text.split("dependencies = [")[1].split("]")[0]
    )
    return {name: ".".join([*version.split("."), "0", "0"][:3]) for name, version in found}


def rows() -> Iterator[Row]:
    """Every environment of the table, the newest of each Python first."""
    for python in PYTHONS:
        yield Row(f"Python {python}", python)
    yield Row(
        "all at their floors",
        pins=tuple(f"{name}=={version}" for name, version in floors().items()),
    )
    for package, before in BEFORE.items():
        yield Row(f"{package} {floors()[package]}", pins=(f"{package}=={floors()[package]}",))
        yield Row(f"{package} {before}", pins=(f"{package}=={before}",))
    for version in MUJOCOS:
        yield Row(f"mujoco {version}", pins=(f"mujoco=={version}",))
    for engine in ADDED:
        yield Row(engine, added=engine)


def run(row: Row) -> dict[str, str]:
    """Results of a row by command: "" where it worked, or its exit code and last line."""
    python = next((each for each in interpreters() if each.startswith(f"{row.python}.")), "")
    if not python:
        return {"": f"not run: Python {row.python} is not on this machine"}
    environment = WORK / (f"Python {row.python}" if row.added else row.name).replace(" ", "-")
    reason = _install(row, environment, python)
    if reason:
        return {"": f"not installed: {reason}"}
    folder = WORK / "work"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in ("good.xml", "broken.xml", "quadruped.xml", "recording/drop.wav", "test_bounce.py"):
        shutil.copy(ROOT / "examples" / name, folder)
    shutil.copy(ROOT / "examples" / "good.xml", folder / "my.xml")
    (folder / "drops.xlsx").write_bytes(workbook({"drop": DROPS}))
    (folder / "study.toml").write_text(
        STUDY.replace("ENGINE", row.added or "mujoco"), encoding="utf-8"
    )
    said = {command: _said(environment, folder, command) for command in row.commands()}
    if row.pins:
        shutil.rmtree(environment)
    return said


def _install(row: Row, environment: Path, python: str) -> str:
    """Make an environment with the wheel; why it cannot be, or ""."""
    if (environment / "done").exists():
        return ""
    uv = [sys.executable, "-m", "uv"]
    shutil.rmtree(environment, ignore_errors=True)
    subprocess.run([*uv, "venv", "-q", "--python", _path_of(python), str(environment)], check=True)
    install = [
        *uv,
        "pip",
        "install",
        "-q",
        "--no-build",
        "--python",
        str(environment / "bin" / "python"),
    ]
    pinned = {pin.split("==")[0] for pin in row.pins}
    free = [f"{name}>={floor}" for name, floor in floors().items() if name not in pinned]
    if row.python != "3.11":
        free = [each for each in free if not each.startswith("pybullet")]
    done = subprocess.run(
        [*install, *row.pins, *free, "pyarrow", "pytest"],
        capture_output=True,
        text=True,
        check=False,
        cwd=WORK,
    )
    if done.returncode:
        text = " ".join(done.stderr.split())
        conflict = re.search(r"ecause (\S+ depends on \S+)", text)
        return conflict[1] if conflict else text[:200]
    subprocess.run([*install, "--no-deps", str(_wheel())], check=True, cwd=WORK)
    (environment / "done").touch()
    return ""


def _path_of(python: str) -> str:
    of_pyenv = (
        Path.home() / ".pyenv" / "versions" / python / "bin" / "python"
    )  # whose shims hide it from uv
    return str(of_pyenv) if of_pyenv.exists() else python


def _wheel() -> Path:
    """The wheel, built once a run of this script."""
    folder = WORK / "wheel"
    if not (folder / "built").exists():
        command = [
            sys.executable,
            "-m",
            "uv",
            "build",
            "--wheel",
            "-q",
            "-o",
            str(folder),
            str(ROOT),
        ]
        subprocess.run(command, check=True)
        (folder / "built").touch()
    return next(folder.glob("*.whl"))


def _said(environment: Path, folder: Path, command: str) -> str:
    program, _, rest = command.partition(" ")
    pytest = f'"{environment}/bin/python" -W ignore -m pytest -q {rest}'
    kept = {
        name: os.environ[name]
        for name in os.environ
        if not name.startswith(("PYTHON", "VIRTUAL_ENV"))
    }
    try:
        done = subprocess.run(
            pytest if program == "pytest" else f'"{environment}/bin/hcbench" {command}',
            shell=True,
            cwd=folder,
            env={**kept, "HCBENCH_DATA": str(WORK / "data")},
            capture_output=True,
            text=True,
            check=False,
            timeout=_LIMIT_S,
        )
    except subprocess.TimeoutExpired:
        return f"not run: no answer within {_LIMIT_S:g} s"
    if done.returncode == 0:
        return ""
    said = (done.stderr.strip() or done.stdout.strip() or "nothing said").replace("\n  ", " ")
    last = said.splitlines()[-1].removeprefix("hcbench: ").replace(str(WORK), "")
    return f"exit {done.returncode}: {re.split(r'[.] (?:Try|Set)', last)[0]}"


def tables() -> dict[str, str]:
    """The page's tables by their names."""
    measured = json.loads(MEASURED.read_text(encoding="utf-8"))
    known = {row.name: row for row in rows()}
    lines: dict[str, list[str]] = {"versions": [], "added": []}
    for name, row in known.items():
        said = measured.get(name, {"": "not run"})
        failed = {command: text for command, text in said.items() if text}
        number = f"{len(said) - len(failed)} of {len(said)}" if "" not in said else "–"
        why = "; ".join(
            f"`{_short(command)}` {text}" if command else text for command, text in failed.items()
        )
        lines["added" if row.added else "versions"].append(f"| {name} | {number} | {why} |")
    head = "| {} | commands that work | what does not |\n| --- | --- | --- |\n"
    return {
        "versions": head.format("the newest of all, but") + "\n".join(lines["versions"]),
        "added": head.format("added version") + "\n".join(lines["added"]),
    }


def _short(command: str) -> str:
    """The name of a command: its words before the first option or file."""
    return " ".join(word for word in command.split()[:2] if not re.search(r"[-.@]", word))


def page() -> str:
    """The page with its tables as they should be."""
    text = PAGE.read_text(encoding="utf-8")
    for name, content in tables().items():
        before, rest = text.split(f"<!-- {name} -->\n", 1)
        text = f"{before}<!-- {name} -->\n\n{content}\n\n<!-- end -->{rest.split('<!-- end -->', 1)[1]}"
    return text


def main(words: list[str]) -> int:
    """Run rows, one after the other, and write after each."""
    shutil.rmtree(WORK, ignore_errors=True)
    for row in rows():
        if words and not any(word in row.name for word in words):
            continue
        measured = json.loads(MEASURED.read_text(encoding="utf-8")) if MEASURED.exists() else {}
        said = run(row)
        if said.get("", "").startswith("not run") and row.name in measured:
            print(row.name, said[""], "; what was measured before is kept", flush=True)
            continue
        measured[row.name] = said
        print(
            row.name,
            {command: text for command, text in said.items() if text} or "all work",
            flush=True,
        )
        MEASURED.write_text(
            json.dumps(measured, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
        )
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
