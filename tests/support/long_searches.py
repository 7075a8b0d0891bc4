"""Tests whose search takes long, of `make test-searches`."""

import os

import pytest

LONG = "HCBENCH_SEARCHES" in os.environ
long_search = pytest.mark.skipif(not LONG, reason="a long search: make test-searches")
