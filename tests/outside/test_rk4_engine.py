"""Tests that the author of an engine writes for it."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import pytest

from hcbench import engine
from hcbench.sim import entry_points
from hcbench.system.errors import EngineFailed
from hcbench.testing import EngineConformance


class TestRk4(EngineConformance):
    engine = "rk4"
    scenes = ("steel-plane",)


class Wrong(EngineConformance):
    """Whose law is held to another α."""

    engine = "rk4"


def test_a_failure_shows_the_number_found_and_the_number_expected(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("hcbench.testing.ALPHA", 0.3)
    with pytest.raises(AssertionError, match=r"assert .*0\.0053\d+.* < .*0\.0001"):
        Wrong().test_restitution_is_what_the_role_promises("rk4.law", "steel-plane")


def test_an_engine_under_a_name_that_is_not_its_own_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    entry = EntryPoint("rk5", "rk4_engine:Rk4Engine", entry_points.GROUP)
    monkeypatch.setitem(entry_points.registered(), "rk5", entry)
    with pytest.raises(
        EngineFailed, match=r"rk4_engine:Rk4Engine has the name 'rk4'; .* name is 'rk5'"
    ):
        engine("rk5")
