"""Settings rest as their target does and gain no energy with friction;
who asks for a plug-in gets one.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import hcbench as hb
from hcbench.laws.restitution import ConstantRestitution, Restitution
from hcbench.sim.passivity import LongestTrain
from hcbench.system.errors import SettingError

G = 9.81
HEIGHT = 0.2


def ideal_end(e: float) -> float:
    """End of a train of constant e after a drop from HEIGHT, s: its flights are a geometric series."""
    return math.sqrt(2.0 * HEIGHT / G) * (1.0 + e) / (1.0 - e)


@pytest.mark.parametrize("e", [0.5, 0.9, 0.99])
def test_a_train_of_constant_e_ends_when_its_series_does(e: float) -> None:
    train = LongestTrain(ConstantRestitution(e), error=0.0, fastest=2.0)
    assert train.rebounds_after([HEIGHT], G, 0.98 * ideal_end(e))[0] > 0.0
    assert train.rebounds_after([HEIGHT], G, 1.001 * ideal_end(e))[0] == 0.0


def test_an_error_never_allows_a_body_to_bounce_for_ever() -> None:
    speeds = np.geomspace(1e-4, 2.0, 20)
    law = Restitution(0.1)
    allowed = LongestTrain(law, error=0.5, fastest=2.0).restitution(speeds)
    np.testing.assert_allclose(1.0 - allowed, (1.0 - law.at(speeds)) / 2.0, rtol=1e-9)


def test_a_target_near_1_takes_the_setting_that_rests_as_late_as_it_does() -> None:
    answer = hb.tune("mujoco", restitution=0.99, timestep="1 ms", speeds="0.3:2 m/s")
    assert answer.best.max_error < 0.001
    assert ideal_end(0.99) > 30.0  # longer than a drop is simulated


def test_a_plug_in_that_was_asked_for_has_one_e() -> None:
    answer = hb.tune("mujoco", restitution=0.6, timestep="2 ms", kind="exact")
    assert answer.best.kind == "exact"
    assert 'key="restitution" value="0.6"' in answer.text
    assert [choice.kind for choice in answer.choices] == ["exact"]


def test_a_plug_in_refuses_several_points_by_name() -> None:
    with pytest.raises(SettingError, match="restitution-law"):
        hb.tune("mujoco", points=[(0.1, 0.9), (1.0, 0.7)], timestep="2 ms", kind="exact")


def test_what_gains_energy_where_it_slides_is_never_used() -> None:
    answer = hb.tune(
        "mujoco",
        alpha="0.7863 s/m",
        timestep="4.06 ms",
        speeds="0.0438:0.915 m/s",
        gravity=0,
        friction=0.83,
    )
    reasons = {never.setting: never.why for never in answer.never}
    assert "gains energy where it slides and spins" in reasons["impulse"]
    assert answer.best.max_e <= 1.002
