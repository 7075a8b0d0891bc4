"""Tests of PyBullet: none of them is read where it is not installed."""

from hcbench.sim import registry

collect_ignore_glob = [] if registry.is_there("pybullet") else ["test_*.py"]
