"""Models in other packages, of `make test-models`."""

import importlib.util
import os
from pathlib import Path

import pytest

outside = pytest.mark.skipif(
    "HCBENCH_MODELS" not in os.environ, reason="needs other packages: make test-models"
)


def found_file(name: str) -> Path:
    """A file of an installed package."""
    package, _, rest = name.partition("/")
    spec = importlib.util.find_spec(package)
    assert spec is not None, f"{package} is not installed: make test-models"
    assert spec.origin is not None
    return Path(spec.origin).parent / rest
