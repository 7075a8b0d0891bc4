"""Results, their view and their page, made once for the tests of a room."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_results import small_results

from hcbench.benchmark.results import Results
from hcbench.reporting.build import build
from hcbench.reporting.view import View


@pytest.fixture(scope="session")
def results() -> Results:
    """Of five small settings."""
    return small_results()


@pytest.fixture(scope="session")
def view(results: Results) -> View:
    return View(results)


@pytest.fixture(scope="session")
def page(results: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(results, tmp_path_factory.mktemp("report"))
