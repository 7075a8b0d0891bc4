"""Sweeps that nothing happened to, and an engine that fails on command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from small_sweeps import ENGINES, small
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


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """Folders of sweeps that nothing happened to, by name."""
    folder = tmp_path_factory.mktemp("undisturbed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "SHARD_IMPACTS", 16)
        sweep(study_from(ENGINES), folder / "engines", jobs=2)
        sweep(study_from(small()), folder / "small")
    yield {name: folder / name for name in ("engines", "small")}


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    folder = tmp_path / "package"
    folder.mkdir()
    yield from (folder for _ in installed(folder, monkeypatch))
