"""What an engine's author writes to test it."""

from __future__ import annotations

from hcbench.testing import EngineConformance


class TestRk4(EngineConformance):
    engine = "rk4"
    scenes = ("steel-plane",)
