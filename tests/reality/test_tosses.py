"""Tosses in engines: free flight, and the errors of settings on measured tosses."""

from __future__ import annotations

import os
from functools import cache
from typing import Any

import numpy as np
import pytest

from hcbench.reality import cube, ellipse
from hcbench.reality.data_sets import Cell, committed, outcome_of, search, smooth_least, values_of
from hcbench.reality.motion import SettingErrors
from hcbench.sim.toss import GRAVITY, POSITION, SPIN, VELOCITY, Body, Toss, engines

WHOLE = pytest.mark.skipif(
    "HCBENCH_REALITY" not in os.environ, reason="make test-reality: all tosses"
)
MODULES = dict(engines())
VALIDATION = cube.VALIDATION


@cache
def judged(data: str, engine: str, setting: str, parts: tuple[int, ...]) -> SettingErrors:
    """A setting with the committed parameters."""
    cell = Cell(data, engine, setting, (), parts)
    values = values_of(committed(), data, cell)
    assert values is not None
    return outcome_of(Cell(data, engine, setting, values, parts))


@pytest.mark.parametrize("name", ["mujoco", "pybullet"])
def test_a_toss_flies_along_a_parabola_with_its_spin(name: str) -> None:
    """Faster than 100 rad/s too, where Bullet clips what is not told otherwise."""
    module = MODULES[name]
    body = Body("sphere", (0.02,) * 3, 0.0027, (7.2e-7,) * 3)
    start = Toss(
        np.array([0.0, 0.0, 1.0]),
        np.array([1.0, 0, 0, 0]),
        np.array([1.0, 0, 0.5]),
        np.array([0, 300.0, 0]),
        50,
    )
    (states,) = module.simulate(body, module.SETTINGS[0], (), 2e-3, [start])
    time = 2e-3 * np.arange(51)
    assert states[:, POSITION][:, 2] == pytest.approx(
        1.0 + 0.5 * time - 0.5 * GRAVITY * time**2, abs=1e-9
    )
    assert states[:, VELOCITY][:, 2] == pytest.approx(0.5 - GRAVITY * time, abs=1e-9)
    assert states[:, SPIN][:, 1] == pytest.approx(300.0, rel=1e-6)


@pytest.mark.spec_plugins
@pytest.mark.parametrize("name", ["mujoco", "pybullet"])
def test_every_setting_of_an_engine_simulates_a_toss(name: str) -> None:
    tosses = cube.cases((1,)).of(lambda each: each.number < 12)
    for setting in MODULES[name].SETTINGS:
        outcome = tosses.outcome(MODULES[name], setting, [p.starts[0] for p in setting.parameters])
        assert np.isfinite(outcome.errors).all()
        assert len(outcome.errors) == len(tosses.motions)


def test_a_measured_toss_is_nearer_with_the_identified_friction_than_with_nothing_set() -> None:
    tosses = cube.cases((1,)).of(lambda each: each.number < 60)
    module: Any = MODULES["mujoco"]
    nothing, _, elliptic, *_ = module.SETTINGS
    assert tosses.outcome(module, nothing, ()).errors.mean() > 60.0
    assert tosses.outcome(module, elliptic, (0.18,)).errors.mean() < 25.0


def test_a_search_finds_the_friction_that_a_simulation_had() -> None:
    """The cube's own tosses, replaced by what an engine simulates at a friction of 0.3."""
    tosses = cube.cases((1,)).of(lambda each: each.number < 20)
    module: Any = MODULES["mujoco"]
    setting = next(each for each in module.SETTINGS if each.key == "friction alone, elliptic")
    same = tosses.as_simulated(tosses.simulated(module, setting, (0.3,)))
    errors = [same.outcome(module, setting, (mu,)).errors.mean() for mu in (0.25, 0.3, 0.35)]
    assert errors[1] == pytest.approx(0.0, abs=1e-6)
    assert min(errors[0], errors[2]) > 1.0


def test_the_ellipse_s_free_impulse_bounds_every_rigid_law() -> None:
    drops = ellipse.cases(ellipse.VALIDATION)
    nearest = ellipse.free_impulse(drops)
    assert nearest.mean() == pytest.approx(0.106, abs=0.005)
    assert (ellipse.errors(drops, ellipse.coulomb(drops, 0.546, 0.19)) >= nearest - 1e-6).all()


@pytest.mark.spec_plugins
def test_the_plug_in_is_as_near_to_the_ellipse_as_the_rigid_law() -> None:
    assert judged("ellipse", "mujoco", "plug-in constant e, elliptic", (1,)).errors.mean() < 0.3


@WHOLE
@pytest.mark.parametrize(
    ("setting", "error", "rotation", "within"),
    [
        ("friction alone, elliptic", 13.3, 14.8, 2.0),
        ("plug-in constant e, elliptic", 11.8, 13.2, 1.7),
    ],
)
def test_errors_of_identified_settings(
    setting: str, error: float, rotation: float, within: float
) -> None:
    outcome = judged("cube", "mujoco", setting, VALIDATION)
    assert outcome.rotations is not None
    assert outcome.errors.mean() == pytest.approx(error, abs=1.0)
    assert np.degrees(outcome.rotations.mean()) == pytest.approx(rotation, abs=within)


@WHOLE
def test_a_constant_e_and_friction_that_are_set_by_hand() -> None:
    cell = Cell("cube", "mujoco", "plug-in constant e, elliptic", (0.216, 0.18), VALIDATION)
    outcome = outcome_of(cell)
    assert outcome.rotations is not None
    assert outcome.errors.mean() == pytest.approx(11.8, abs=1.0)
    assert np.degrees(outcome.rotations.mean()) == pytest.approx(13.2, abs=1.7)


@WHOLE
def test_the_pyramidal_cone_costs_much() -> None:
    assert judged("cube", "mujoco", "friction alone, pyramidal", VALIDATION).errors.mean() > 20.0


@WHOLE
def test_the_plug_in_on_the_ellipse() -> None:
    outcome = judged("ellipse", "mujoco", "plug-in constant e, elliptic", ellipse.VALIDATION)
    assert outcome.errors.mean() == pytest.approx(0.275, abs=0.01)


@WHOLE
def test_a_search_from_another_start_finds_what_is_committed() -> None:
    cell = Cell("cube", "mujoco", "friction alone, elliptic", (0.3,), cube.TRAINING)
    least = np.exp(smooth_least(search(cell)))
    known = values_of(committed(), "cube", cell)
    assert known is not None
    assert float(least[0]) == pytest.approx(known[0], rel=0.05)
