"""Advice of `tune` on a model that no setting brings to its target."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from hcbench.cli.tune_model import _cure
from hcbench.terms import units

if TYPE_CHECKING:
    from hcbench.tuning.tuned_model import TunedModel


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
@pytest.mark.parametrize("step", [2e-3, 1.0 / 240.0])
def test_the_step_to_try_is_a_quarter_of_the_models(engine: str, step: float) -> None:
    facts = SimpleNamespace(engine=engine, timestep=step)
    advice = _cure(cast("TunedModel", SimpleNamespace(pairs=[SimpleNamespace(facts=facts)])))
    words = advice.rpartition("--timestep ")[2]
    assert units.parse(words, "timestep") == pytest.approx(step / 4.0)
