"""Sweeps that nothing happened to, and an engine that fails on command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from in_place import in_place
from small_sweeps import small
from sweep_engine import installed

from hcbench.benchmark import plan
from hcbench.benchmark.run import sweep
from hcbench.benchmark.study import study_from

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sweep writes a part for every 16 impacts."""
    monkeypatch.setattr(plan, "SHARD_IMPACTS", 16)


@pytest.fixture
def without_processes() -> Iterator[None]:
    """A sweep of the reference runs in this process."""
    with in_place():
        yield


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small sweep that nothing happened to."""
    folder = tmp_path_factory.mktemp("undisturbed")
    with pytest.MonkeyPatch.context() as patch, in_place():
        patch.setattr(plan, "SHARD_IMPACTS", 16)
        sweep(study_from(small()), folder)
    return folder


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    folder = tmp_path / "package"
    folder.mkdir()
    yield from (folder for _ in installed(folder, monkeypatch))
