"""The house: imports run one way, and the front door is light."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from graphlib import TopologicalSorter
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pytest

import hcbench

ROOT = Path(hcbench.__file__).parent

# A room may import from its own floor and from those before it.
FLOORS = [
    {"system", "environments", "workers"},
    {"terms"},
    {"laws", "scoring", "catalogue"},
    {"recipes"},
    {"sim"},
    {"measuring", "tuning", "engines", "contact", "fitting"},
    {"benchmark", "cases"},
    {"reporting", "checking", "paper", "reality"},
    {"pytest_plugin", "cli", "testing"},
    {"__main__"},
]
FLOOR = {room: i for i, rooms in enumerate(FLOORS) for room in rooms}


def _room(path: Path) -> str:
    return _room_of(path.relative_to(ROOT).with_suffix("").parts)


def _room_of(parts: Sequence[str]) -> str:
    """The room of a module: itself where it has a floor of its own, else its package."""
    return parts[0]


MODULES = sorted(p for p in ROOT.rglob("*.py") if _room(p) not in ("__init__", "data"))


@cache
def _parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(_parsed(path)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hcbench"):
            parts = (node.module or "").split(".")
            found |= (
                {_room_of(parts[1:])} if len(parts) > 1 else {alias.name for alias in node.names}
            )
        elif isinstance(node, ast.Import):
            found |= {
                _room_of(a.name.split(".")[1:]) for a in node.names if a.name.startswith("hcbench.")
            }
    return found


def test_imports_run_one_way() -> None:
    wrong = []
    for path in MODULES:
        floor = FLOOR[_room(path)]
        upwards = {room for room in _imports(path) if FLOOR[room] > floor}
        if upwards:
            wrong.append(f"{path.relative_to(ROOT)} is on floor {floor} and imports {upwards}")
    assert not wrong


# The contract of an engine, whose methods call what runs it: that names the engine's type.
CONTRACT = "hcbench.sim.engine"


def _imported(node: ast.AST, typing: bool = False) -> Iterator[str]:
    """Modules, and what may be one, that a node imports: in functions and for types, too.

    typing: the node is a block for types alone.
    """
    of_contract = typing and isinstance(node, ast.ImportFrom) and node.module == CONTRACT
    if isinstance(node, ast.ImportFrom) and node.module and not of_contract:
        yield from (f"{node.module}.{alias.name}" for alias in node.names)
    for child in ast.iter_child_nodes(node):
        of_types = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test)
        yield from _imported(child, typing or of_types)


def test_no_circle_of_imports() -> None:
    named = {".".join(["hcbench", *p.relative_to(ROOT).with_suffix("").parts]): p for p in MODULES}
    files = {name.removesuffix(".__init__"): path for name, path in named.items()}
    graph: dict[str, set[str]] = {}
    for name, path in files.items():
        found = list(_imported(_parsed(path)))
        graph[name] = {
            full if full in files else full.rpartition(".")[0] for full in found
        } & files.keys()
    list(TopologicalSorter(graph).static_order())  # a CycleError names the modules


def test_only_the_front_door_imports_by_a_string() -> None:
    by_name = re.compile(r"import_module\(f?\"hcbench")
    assert [str(p) for p in MODULES if by_name.search(p.read_text(encoding="utf-8"))] == []


# Short re-exports that keep documented imports alive, other libraries' words, threads that cases
# cite, and examples that a user types.
ABOUT_ENGINES = {
    "contact/mjx.py",
    "contact/mujoco.py",
    "contact/newton.py",
    "contact/pybullet.py",
    "contact/warp.py",
    "cases/make.py",
    "cli/help.py",
    "tuning/ask.py",
    "laws/conventions.py",
}
# A small engine is one file, the others have a folder each.
ENGINES = {path.stem for path in (ROOT / "engines").iterdir() if not path.stem.startswith("__")}
SOURCES = sorted(p for p in ROOT.rglob("*") if p.suffix in (".py", ".c", ".h"))


def test_what_knows_an_engine_is_in_its_folder() -> None:
    wrong = []
    for path in SOURCES:
        name, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        if name in ABOUT_ENGINES:
            continue
        own = ""
        if name.startswith("engines/"):
            own = path.relative_to(ROOT / "engines").parts[0].removesuffix(".py")
        imported = set(re.findall(r"hcbench\.engines\.(\w+)", text)) & ENGINES
        if not imported <= {own}:
            wrong.append(f"{name} imports the inside of {imported - {own}}")
        if not own and re.search(r"(?i)mujoco|pybullet", text):
            wrong.append(f"{name} names an engine: only its folder does")
    assert len(SOURCES) > len(MODULES) > 100
    assert not wrong


def test_an_engine_comes_in_by_one_entry_point() -> None:
    mine = [
        entry
        for entry in distribution("hcbench").entry_points
        if entry.value.startswith("hcbench.engines")
    ]
    assert {entry.group for entry in mine} == {"hcbench.engines"}
    assert sorted(entry.name.replace("-", "_") for entry in mine) == sorted(ENGINES)


def test_measure_is_the_verb_whatever_was_imported_before() -> None:
    code = "import hcbench; {}; print(callable(hcbench.measure))"
    for first in (
        "pass",
        "import hcbench.measuring.measure",
        "from hcbench import measure; assert measure.__call__",
    ):
        done = subprocess.run(
            [sys.executable, "-c", code.format(first)], capture_output=True, text=True, check=True
        )
        assert done.stdout.split() == ["True"]
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
        "print(*(m for m in ('mujoco', 'pybullet', 'scipy.optimize') if m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
