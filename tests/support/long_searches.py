"""Tests that take long: searches, of `make test-searches`, and other
studies, of `make test-all` alone.
"""

import os

import pytest

LONG = "HCBENCH_SEARCHES" in os.environ
long_search = pytest.mark.skipif(not LONG, reason="a long search: make test-searches")
long_study = pytest.mark.skipif(not LONG, reason="a long study: make test-all")
