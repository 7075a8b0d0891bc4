"""`randomize` draws contacts whose measured e and friction have the asked distribution."""

from __future__ import annotations

import dataclasses
import io
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import mujoco
import numpy as np
import pytest
from scipy import stats

import hcbench as hb
from hcbench.cli import run
from hcbench.cli.randomize import _table
from hcbench.measuring.request import make_request
from hcbench.sim import registry
from hcbench.sim.capabilities import TunesModels
from hcbench.sim.rest import UNKNOWN
from hcbench.system.errors import UserError
from hcbench.tuning.random_worlds import RandomWorlds, p_uniform
from hcbench.tuning.randomize import sliced

QUADRUPED = Path(__file__).parents[2] / "examples" / "quadruped.xml"
BALL = """<mujoco model="ball"><option timestep="0.002" {option}/><worldbody>
<geom name="floor" type="plane" size="5 5 .1" {geom}/><body name="ball" pos="0 0 .1"><freejoint/>
<geom name="ball" size=".05" mass=".2" {geom}/></body></worldbody></mujoco>"""
FINGER = """<mujoco><option timestep="0.002"/><worldbody>
<geom name="wall" type="box" size=".1 .1 .1" pos=".2 0 0"/><body><joint type="slide" axis="1 0 0"/>
<geom name="finger" size=".02" mass=".2"/></body></worldbody></mujoco>"""
POLE = """<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1"/>
<body pos="0 0 .5" euler="0 3 0"><freejoint/><geom name="pole" type="capsule" size=".02 .4"/></body>
</worldbody></mujoco>"""
BAND, RUBS = (0.3, 0.6), (0.5, 1.0)


def model(option: str = "", geom: str = "") -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(BALL.format(option=option, geom=geom))


@pytest.fixture(scope="module")
def drawn() -> RandomWorlds:
    return hb.randomize(
        model(), "ball,floor", restitution=BAND, friction=RUBS, worlds=200, speeds="0.5, 1 m/s"
    )


def test_measured_restitution_and_friction_are_uniform_over_their_bands(
    drawn: RandomWorlds,
) -> None:
    low, high = BAND
    assert stats.kstest(drawn.measured, stats.uniform(low, high - low).cdf).pvalue > 0.05
    assert np.abs(drawn.errors).max() < 0.02
    assert drawn.certificate.friction is not None
    friction = stats.uniform(RUBS[0], RUBS[1] - RUBS[0]).cdf
    assert stats.kstest(drawn.certificate.friction, friction).pvalue > 0.05
    assert np.abs(drawn.friction_errors).max() < 1e-6
    assert not drawn.failures


def test_no_world_gains_energy_or_creeps_more_than_the_model_as_it_is(drawn: RandomWorlds) -> None:
    assert drawn.certificate.highest.max() < 1.0
    assert drawn.certificate.energy_gained < 0.0
    assert not drawn.worse
    assert max(after.drift for after in drawn.after) < 1.2 * drawn.before.drift


def test_a_world_of_the_arrays_bounces_in_plain_steps_with_the_e_that_was_drawn(
    drawn: RandomWorlds,
) -> None:
    whole = mujoco.MjModel.from_xml_string(drawn.texts.written)
    for world in (3, 77):
        for name, values in drawn.parameters.items():
            getattr(whole, name)[:] = values[world]
        found = hb.measure(
            whole, "ball,floor", speeds="0.5, 1 m/s", phases=16, diagnose=False, rest=False
        )
        e = np.mean([point.restitution for point in found.curve])
        assert e == pytest.approx(drawn.restitution[world], abs=0.01)


def test_a_certificate_that_does_not_fit_is_a_failure(drawn: RandomWorlds) -> None:
    moved = drawn.certificate.restitution + 0.08
    other = dataclasses.replace(drawn.certificate, restitution=moved)
    (failure,) = dataclasses.replace(drawn, certificate=other).failures
    assert failure.startswith("measured e is not uniform from 0.3 to 0.6")
    lively = dataclasses.replace(drawn.certificate, highest=drawn.certificate.highest + 0.6)
    assert "gains energy" in dataclasses.replace(drawn, certificate=lively).failures[0]


def test_the_same_seed_gives_the_same_bytes_and_another_one_other_worlds(tmp_path: Path) -> None:
    spec = model(geom='condim="1"')

    def archive(seed: int) -> bytes:
        worlds = hb.randomize(
            spec, "ball,floor", restitution=BAND, worlds=20, seed=seed, speeds="1 m/s"
        )
        return worlds.save(tmp_path / "p.npz").read_bytes()

    first = archive(1)
    assert archive(1) == first
    assert archive(2) != first


def test_the_file_has_the_described_arrays(drawn: RandomWorlds) -> None:
    with np.load(io.BytesIO(drawn.archive())) as file:
        shapes = {name: file[name].shape for name in file.files}
        about = json.loads(str(file["about"]))
    assert shapes == {
        "pair_solref": (200, 1, 2),
        "pair_solimp": (200, 1, 5),
        "pair_friction": (200, 1, 5),
        "restitution": (200,),
        "friction": (200,),
        "certified": (40,),
        "speeds": (2,),
        "measured_restitution": (40, 2),
        "measured_friction": (40,),
        "about": (),
    }
    assert about["seed"] == 0
    assert about["lines"] == drawn.text


def test_an_e_out_of_reach_is_refused_with_a_reach_that_is_then_given() -> None:
    with pytest.raises(UserError, match=r"restitution: 0.01:0.6; expected .* the reach") as refused:
        hb.randomize(model(), "ball,floor", restitution=(0.01, 0.6), worlds=40, speeds="1 m/s")
    found = re.search(r"expected (0\.\d+) \.\.\. (0\.\d+),", str(refused.value))
    assert found is not None
    low, high = map(float, found.groups())
    assert 0.01 < low < 0.2
    assert high > 0.6
    worlds = hb.randomize(model(), "ball,floor", restitution=(low, high), worlds=40, speeds="1 m/s")
    assert not worlds.failures


@pytest.mark.parametrize("band", ["0.6:0.3", "0.1:0.2:0.3", "-0.1:0.5"])
def test_a_band_is_two_numbers_lowest_first(band: str) -> None:
    with pytest.raises(UserError, match="restitution"):
        hb.randomize(model(), "ball,floor", restitution=band)


def test_a_contact_without_friction_turns_the_body_in_one_step() -> None:
    smooth = model(geom='condim="1"')
    worlds = hb.randomize(smooth, "ball,floor", restitution="0.3:0.9", worlds=40, speeds="1 m/s")
    assert worlds.name == "one step"
    with pytest.raises(UserError, match="friction: a band; expected a pair with friction"):
        hb.randomize(smooth, "ball,floor", restitution="0.3:0.9", friction="0.5:1", worlds=40)


def test_feet_that_weigh_the_same_but_bounce_differently_have_the_e_that_is_drawn() -> None:
    feet = ["left_front_foot,floor", "left_hind_foot,floor"]
    apart = [
        hb.measure(QUADRUPED, foot, speeds="1 m/s", diagnose=False, rest=False).curve[0]
        for foot in feet
    ]
    assert apart[0].restitution - apart[1].restitution > 0.2
    worlds = hb.randomize(QUADRUPED, feet, restitution="0.3:0.4", worlds=40, speeds="1 m/s")
    fore, hind = worlds.facts
    assert hind.effective_mass == pytest.approx(fore.effective_mass, rel=0.02)
    assert np.abs(worlds.errors[0::2]).max() < 0.02
    assert np.abs(worlds.errors[1::2]).max() < 0.02
    assert not worlds.worse
    assert max(after.drift for after in worlds.after) < worlds.before.drift


def test_friction_is_set_but_not_measured_where_joints_keep_a_pair_from_sliding() -> None:
    finger = mujoco.MjSpec.from_string(FINGER)
    worlds = hb.randomize(
        finger, "finger,wall", restitution=BAND, friction=RUBS, worlds=40, speeds="1 m/s"
    )
    assert worlds.friction is not None
    assert worlds.parameters["pair_friction"][:, 0, 0] == pytest.approx(worlds.friction)
    assert not len(worlds.friction_errors)
    assert not worlds.failures
    assert "keep it from sliding: its μ is set as drawn, but not measured" in worlds.notes[-1]


def test_friction_that_stops_each_launch_is_said_and_is_no_other_distribution(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A stop before the leaving was put down to joints, or refused as "not uniform"."""
    monkeypatch.setattr("hcbench.tuning.randomize._KEPT_SLIP", 1.0)
    worlds = hb.randomize(
        model(), "ball,floor", restitution=BAND, friction=RUBS, worlds=40, speeds="1 m/s"
    )
    assert not len(worlds.friction_errors)
    assert not worlds.failures
    assert "friction stops it before it leaves" in worlds.notes[-1]


def test_a_robot_that_falls_over_by_itself_has_no_drift_to_compare() -> None:
    engine = registry.engine("mujoco")
    assert isinstance(engine, TunesModels)
    limp = engine.standing(mujoco.MjSpec.from_string(POLE), None, [make_request("pole,floor")])
    assert limp.falls
    assert np.isnan(limp.drift)
    ball = engine.standing(model(), None, [make_request("ball,floor")])
    assert not ball.falls
    assert np.isfinite(ball.drift)


@pytest.mark.parametrize("worlds", [20, 40, 81, 4096])
def test_numbers_and_those_of_the_certified_tenth_are_evenly_spread(worlds: int) -> None:
    shares, tenth = sliced(worlds, 2, np.random.default_rng(5))
    assert shares.shape == (worlds, 2)
    assert len(tenth) >= min(worlds, 40)
    for column in shares.T:
        for numbers in (column, column[tenth]):
            assert p_uniform(numbers, (0.0, 1.0)) > 0.99


def test_the_test_of_uniformity_is_that_of_scipy() -> None:
    values = np.random.default_rng(2).uniform(0.3, 0.63, 400)
    assert p_uniform(values, BAND) == pytest.approx(
        stats.kstest(values, stats.uniform(0.3, 0.3).cdf, method="asymp").pvalue, rel=1e-3
    )


def test_the_command_writes_both_files_and_the_model_takes_the_arrays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("ball.xml").write_text(BALL.format(option="", geom=""), encoding="utf-8")
    words = "randomize ball.xml --pair ball,floor --restitution 0.5 --worlds 50 --speeds 1"
    assert run([*words.split(), "--out", "p.npz", "--write-model", "w.xml"]) == 0
    assert "50 worlds" in capsys.readouterr().out
    with np.load("p.npz") as file:
        assert (
            file["pair_solref"].shape[1:] == mujoco.MjModel.from_xml_path("w.xml").pair_solref.shape
        )
    assert run([*words.split(), "--out", "p.npz"]) == 0
    assert run([*words.split(), "--out", "ball.xml"]) == 2


def test_the_worst_world_of_the_table_is_one_that_does_not_come_to_rest() -> None:
    still = dataclasses.replace(UNKNOWN, penetration=1e-4, vibration=1e-6)
    restless = dataclasses.replace(still, vibration=np.nan)
    # A NaN behind a number is what `max` passes over.
    drawn = SimpleNamespace(before=still, after=[still, restless])
    lines = _table(cast("RandomWorlds", drawn))
    assert [line.split()[-1] for line in lines] == ["world", "0.1", "rest"]
