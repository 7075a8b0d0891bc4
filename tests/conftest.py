"""Hooks of the whole suite: a test marked with a feature of MuJoCo runs where the installed one has
it.
"""

from __future__ import annotations

import gc
import os

# Before numpy is imported, here and in each process that a test starts: threads of its BLAS would
# wait for one another in loops, and take the processor from the other testers.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import re
import signal
from dataclasses import replace
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings
from once import FoundOnce, content

from hcbench.engines.mujoco import engine as mujoco_engine
from hcbench.sim import registry
from hcbench.tuning import ask, find
from hcbench.tuning.model import tune_job
from hcbench.tuning.tuned import make_tuned

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator


settings.register_profile(
    "same", derandomize=True, deadline=None
)  # examples do not change from run to run
settings.register_profile("random", max_examples=1000, deadline=None)  # `make test-random`
settings.load_profile("same")

collect_ignore = ["outside"]  # run on its own, as its author would
_QUICK = ("catalogue", "laws", "reporting", "scoring", "system", "terms")  # rooms
_LONGEST = (  # files: a twentieth of a tester's time and more
    "test_answer.py",
    "test_answers.py",
    "test_conformance.py",
    "test_docs.py",
    "test_sessions.py",
    "test_strangers_worlds.py",
    "test_tune_landing.py",
    "test_tune_model.py",
)
_MUJOCO_HAS = (
    ("adhesion", "MjModel", "pair_adhesion"),
    ("spec_plugins", "MjSpec", "activate_plugin"),
)


def pytest_configure(config: pytest.Config) -> None:
    # Engines that a user added are none of the tests', but for those of `make test-engines`.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as of a shell's job in the background
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # The tests start hundreds of processes: each would compile all that it imports.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["HCBENCH_DATA"] = os.environ.get("HCBENCH_ENGINES") or os.devnull
    config.addinivalue_line("markers", "slow: half a minute; -m 'not slow' leaves it out")
    config.addinivalue_line(
        "markers",
        "needs_engine(name): an engine that must be installed; by default the test's parameter",
    )
    config.addinivalue_line(
        "markers", "adhesion: needs a contact pair's adhesion, MuJoCo 3.11 or later"
    )
    config.addinivalue_line("markers", "locked_engines: pages show what the locked versions print")
    config.addinivalue_line(
        "markers", "spec_plugins: needs plug-ins in an MjSpec, later than MuJoCo 3.3.0"
    )


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, Any, Any]:
    # Nine thousand tests are made, and none is garbage: to look for some takes a sixth of the time.
    gc.disable()
    try:
        return (yield)
    finally:
        # Not frozen: Hypothesis looks for what refers to its generators, and finds nothing frozen.
        gc.enable()


def pytest_report_header() -> list[str]:
    left_out = "pybullet is not installed: tests/engines/bullet is left out"
    return [] if registry.is_there("pybullet") else [left_out]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    # The last files decide how long testers wait for one another: those of quick rooms.
    items.sort(key=_when)
    _leave_out_missing_engines(config, items)
    if not _has_locked_engines():
        for item in items:
            if item.get_closest_marker("locked_engines"):
                item.add_marker(
                    pytest.mark.skip(reason="pages show what the locked versions print")
                )
    for marker, kind, name in _MUJOCO_HAS:
        asking = [item for item in items if item.get_closest_marker(marker)]
        if asking and not hasattr(getattr(mujoco := pytest.importorskip("mujoco"), kind), name):
            for item in asking:
                item.add_marker(
                    pytest.mark.skip(reason=f"MuJoCo {mujoco.__version__} has no {kind}.{name}")
                )


def _when(item: pytest.Item) -> int:
    """Place of a test's file in the run: 0 first, 2 last."""
    if item.path.name in _LONGEST:
        return 0
    return 2 if item.path.parent.name in _QUICK else 1


def _has_locked_engines() -> bool:
    locked = (Path(__file__).parents[1] / "requirements-dev.txt").read_text(encoding="utf-8")
    try:
        return all(
            metadata.version(name) == version
            for name, version in re.findall(r"^(mujoco|pybullet)==([\d.]+)", locked, re.M)
        )
    except metadata.PackageNotFoundError:
        return False


def _leave_out_missing_engines(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip the first test of an engine that is not installed, and deselect its others."""
    there = cache(registry.is_there)
    missing: set[str] = set()
    kept, left_out = [], []
    for item in items:
        engine = _needed_engine(item)
        if not engine or there(engine):
            kept.append(item)
        elif engine in missing:
            left_out.append(item)
        else:
            missing.add(engine)
            item.add_marker(
                pytest.mark.skip(reason=f"{engine} is not installed: none of its tests are run")
            )
            kept.append(item)
    items[:] = kept
    config.hook.pytest_deselected(items=left_out)


def _needed_engine(item: pytest.Item) -> str:
    """The engine that a marker `needs_engine` names, or else the
    parameter `engine`, `name` or `recipe`.

    PyBullet, which has wheels for one Python alone, is also needed by a
    test with it among its parameters.
    """
    marker = item.get_closest_marker("needs_engine")
    if marker is None:
        callspec = getattr(item, "callspec", None)
        params = callspec.params.values() if callspec else ()
        _, _, of_name = item.name.partition("[")
        told = [of_name]
        for each in params:
            parts = each if isinstance(each, list | tuple) else [each]
            told += [part for part in parts if isinstance(part, str)]
        return "pybullet" if any(re.search(r"\bpybullet\b", text) for text in told) else ""
    if marker.args:
        return str(marker.args[0])
    params = item.callspec.params  # type: ignore[attr-defined]
    value = next(params[key] for key in ("engine", "name", "recipe") if key in params)
    return str(value).partition(".")[0]


@pytest.fixture
def nothing_kept() -> Iterator[None]:
    """No compiled scene is there from an earlier test, and none is left for a later one."""
    mujoco_engine.cached_pool.cache_clear()
    yield
    mujoco_engine.cached_pool.cache_clear()


@pytest.fixture
def with_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A folder for compiled plug-ins that outlives a process; a user
    without a home has none by default.
    """
    if not os.access(Path.home(), os.W_OK):
        monkeypatch.setenv("HCBENCH_CACHE", str(tmp_path / "cache"))


@pytest.fixture(scope="session")
def found_once(tmp_path_factory: pytest.TempPathFactory) -> FoundOnce:
    """Results that any process of this run has found."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "found"
    folder.mkdir(exist_ok=True)
    return FoundOnce(folder)


@pytest.fixture
def tuned_once(monkeypatch: pytest.MonkeyPatch, found_once: FoundOnce) -> None:
    """`tune` finds what an earlier test has asked: pages, commands and
    Python ask the same, and a test of a text needs no second search.
    """

    def tuned(recipe: Any, why: str, *question: Any) -> Any:
        # The result of `make_tuned` depends on nothing but its arguments.
        asked = repr((recipe.engine, recipe.name, why, *question))
        return found_once(asked, lambda: make_tuned(recipe, why, *question))

    def tuned_model(model: Any, *question: Any) -> Any:
        if (text := content(model)) is None:
            return tune_job(model, *question)
        *asked, output = question
        # A model of one file is written alike into any folder.
        asked.append(output if output.include else replace(output, folder=None))
        return found_once(repr((text, *asked)), lambda: tune_job(model, *question))

    monkeypatch.setattr(find, "make_tuned", tuned)
    monkeypatch.setattr(ask, "tune_job", tuned_model)
