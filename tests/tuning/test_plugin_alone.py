"""The plug-in's answer takes the options of any other: what is wrong is refused, one speed serves."""

from __future__ import annotations

from typing import Any

import pytest

from hcbench.cli import run

PLUGIN = ["tune", "mujoco", "--restitution", "0.6", "--timestep", "2 ms", "--plugin"]


def test_an_integrator_that_the_engine_lacks_is_refused_also_for_the_plug_in(capsys: Any) -> None:
    assert run([*PLUGIN, "--integrator", "garbage"]) == 2
    assert "--integrator: 'garbage' for 'mujoco'; expected one of: Euler" in capsys.readouterr().err


@pytest.mark.parametrize("speeds", ["1 m/s", "1:1 m/s"])
def test_the_plug_in_serves_a_single_speed(speeds: str, capsys: Any) -> None:
    assert run([*PLUGIN, "--speeds", speeds]) == 0
    assert '--speeds "1 m/s"' in capsys.readouterr().out
