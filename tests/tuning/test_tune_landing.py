"""A robot's feet tuned by its landing: what is printed holds in a loop of plain MuJoCo, at heights
and phases that no search saw.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hcbench as hb
from hcbench.cli import run
from hcbench.sim.drop_test import HEIGHTS, PHASES
from hcbench.system.errors import UserError

mujoco = pytest.importorskip("mujoco")

from robot_drops import FEET, QUADRUPED, drop  # noqa: E402

UNSEEN = (0.07, 0.39, 0.61, 0.88)


def tuned(**target: Any) -> hb.TunedModel:
    return hb.tune_model(QUADRUPED, FEET, **target)


@pytest.mark.parametrize("rebound", [0.005, 0.02])
def test_the_centre_of_mass_rebounds_by_the_target_at_phases_that_no_search_saw(
    rebound: float,
) -> None:
    found = tuned(rebound=rebound)
    assert found.gains
    assert found.landing is not None
    assert not set(UNSEEN) & set(PHASES)
    model = mujoco.MjModel.from_xml_string(found.written)
    seen = [drop(model, max(HEIGHTS), phase, 1.0).rebound for phase in UNSEEN]
    assert np.mean(seen) == pytest.approx(rebound, rel=0.1)
    assert np.mean(seen) == pytest.approx(found.landing.after.rebound, rel=0.05)


def test_nothing_else_is_worse_at_heights_and_tilts_that_no_search_saw() -> None:
    found = tuned(rebound="5 mm")
    before = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    after = mujoco.MjModel.from_xml_string(found.written)
    for height, phase, tilt in ((0.035, 0.39, 0.0), (0.07, 0.61, -0.05)):
        was, now = (drop(model, height, phase, 3.0, tilt) for model in (before, after))
        assert now.rest < max(1.2 * was.rest, was.rest + 0.3)
        assert now.peak < max(1.5 * was.peak, was.peak + 2.0)
        assert now.depth < max(1.2 * was.depth, was.depth + 5e-4)
        assert now.travel < max(1.5 * was.travel, was.travel + 0.02)


def test_the_judge_agrees_with_a_plain_loop() -> None:
    """Of the model as it is: the worst of one height, flat."""
    landing = tuned(restitution=0.0).landing
    assert landing is not None
    model = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    seen = [drop(model, 0.1, phase, 2.0) for phase in PHASES]
    assert max(one.depth for one in seen) <= landing.before.depth * 1.001
    assert max(one.depth for one in seen) > landing.before.depth * 0.8
    assert max(one.peak for one in seen) <= landing.before.peak * 1.001
    assert max(one.rest for one in seen) <= landing.before.rest + 0.01
    assert landing.before.rebound == pytest.approx(np.mean([one.rebound for one in seen]), abs=1e-6)


def test_an_e_of_0_of_a_robot_that_does_not_rebound_leaves_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pairs = [word for pair in FEET for word in ("--pair", pair)]
    assert run(["tune", str(QUADRUPED), *pairs, "--restitution", "0"]) == 0
    assert "has this rebound already: there is nothing to paste" in capsys.readouterr().out


def test_a_rebound_out_of_reach_is_refused_with_the_largest_one_and_what_would_help(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pairs = [word for pair in FEET for word in ("--pair", pair)]
    out = tmp_path / "tuned.xml"
    asked = ["tune", str(QUADRUPED), *pairs, "--rebound", "90 mm", "--write-model", str(out)]
    assert run([*asked, "--json"]) == 1
    captured = capsys.readouterr()
    record = json.loads(captured.out)["landing"]
    assert 0.02 < record["largest"]["rebound_m"] < 0.09
    assert record["largest"]["stiffer"][0]["kp_factor"] == 2.0
    assert f"is {1e3 * record['largest']['rebound_m']:.3g} mm" in captured.err
    assert not out.exists()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rebound": "5 m"}, "less than the drop"),
        ({"rebound": "5 mm", "restitution": 0.5}, "one target"),
        ({"rebound": "-1 mm"}, "0"),
    ],
)
def test_what_is_no_rebound_is_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        tuned(**given)


def test_a_body_without_actuators_has_no_rebound_of_its_own() -> None:
    good = QUADRUPED.with_name("good.xml")
    with pytest.raises(UserError, match="no actuator drives"):
        hb.tune_model(good, "ball,plate", rebound="5 mm")
