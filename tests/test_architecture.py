"""The house: imports run one way, and the front door is light."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import hcbench

ROOT = Path(hcbench.__file__).parent

# A room may import from its own floor and from those before it.
FLOORS = [
    {"errors", "units", "fields", "_compile", "_files", "_text", "workers"},
    {"impact", "setting", "scene", "laws", "reference"},
    {"sim", "scoring", "tune.recipe", "tune.search", "tune.target"},  # recipes are part of an engine
    {"measure", "tune", "engines", "contact"},
    {"benchmark"},
    {"report", "check", "paper"},
    {"pytest_plugin", "cli"},
]
FLOOR = {room: i for i, rooms in enumerate(FLOORS) for room in rooms}


def _room(path: Path) -> str:
    return _room_of(path.relative_to(ROOT).with_suffix("").parts)


def _room_of(parts: Sequence[str]) -> str:
    """Of a module's name below hcbench: the module where it has a floor of its own, else its package."""
    module = ".".join(parts[:2])
    return module if module in FLOOR else parts[0]


MODULES = sorted(p for p in ROOT.rglob("*.py") if _room(p) not in ("__init__", "data"))


def _imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hcbench"):
            parts = (node.module or "").split(".")
            found |= {_room_of(parts[1:])} if len(parts) > 1 else {alias.name for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {_room_of(a.name.split(".")[1:]) for a in node.names if a.name.startswith("hcbench.")}
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_run_one_way(path: Path) -> None:
    floor = FLOOR[_room(path)]
    upwards = {room for room in _imports(path) if FLOOR[room] > floor}
    assert not upwards, f"{path.relative_to(ROOT)} is on floor {floor} and imports {upwards}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_file_can_be_read_in_one_sitting(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 335


def test_every_public_name_is_there() -> None:
    assert sorted(hcbench._HOMES) == sorted(hcbench.__all__)
    for name in hcbench.__all__:
        assert getattr(hcbench, name).__module__.startswith("hcbench.")


def test_measure_is_the_verb_whatever_was_imported_before() -> None:
    code = "import hcbench; {}; print(callable(hcbench.measure), hcbench.measure.Wanted is hcbench.Wanted)"
    for first in (
        "pass",
        "import hcbench.measure.measurement",
        "from hcbench import measure; assert measure.__call__",
    ):
        done = subprocess.run(
            [sys.executable, "-c", code.format(first)], capture_output=True, text=True, check=True
        )
        assert done.stdout.split() == ["True", "True"]
    verb: Any = hcbench.measure
    with pytest.raises(hcbench.HcbenchError, match="no-such"):
        verb("no-such.xml", pair="ball,plate")


def test_importing_hcbench_imports_nothing_heavy() -> None:
    heavy = ("numpy", "scipy", "pandas", "mujoco", "pybullet")
    code = f"import hcbench, sys; print(*(m for m in {heavy} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_listing_engines_does_not_import_them() -> None:
    code = (
        "from hcbench.sim import registry; import sys; [registry.engine(n) for n in registry.names()];"
        "print(*(m for m in ('mujoco', 'pybullet') if m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
