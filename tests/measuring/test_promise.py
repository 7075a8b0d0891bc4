"""`measure` knows what `tune` wrote: what was promised, what it
measures, and a pair that is missing.
"""

from __future__ import annotations

from pathlib import Path

import pytest

import hcbench
from hcbench.cli import run
from hcbench.laws.restitution import ConstantRestitution, MeasuredRestitution, Restitution
from hcbench.sim.promise import Promise

MODEL = """<mujoco><option timestep="0.002" cone="elliptic" impratio="1e6"/><worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="b" pos="0 0 .06"><freejoint/><geom name="foot" type="sphere" size=".06" mass=".3"/></body>
</worldbody><contact>{}</contact><custom><text name="hcbench:foot:floor" data="spring-and-damper by hcbench:
 2 pairs; alpha 0.3 s/m; error 0.022; speeds 0.1 2 m/s"/></custom></mujoco>""".replace("\n 2", " 2")
SPRING = """<pair geom1="foot" geom2="floor" solref="-47815.1 -3.25003" solimp="0.0001 0.0001 1 0.5 1"
 condim="3" friction="1 1 0.005 0.0001 0.0001" solreffriction="0 -0.05014284285"/>"""
DAMPER = """<pair geom1="floor" geom2="foot" condim="1" solref="0 -100.19" adhesion="1e6"
 solimp="0.0001 0.261561 0.0139437 0.0652291 4"/>"""


@pytest.mark.adhesion
def test_what_tune_wrote_is_no_cause_and_its_promise_is_compared(tmp_path: Path) -> None:
    file = tmp_path / "tuned.xml"
    file.write_text(MODEL.format(SPRING + DAMPER))
    measured = hcbench.measure(file, "foot,floor", speeds="0.15:1.5:4 m/s")
    assert measured.causes == ()
    note = measured.facts.notes[0]
    assert note.startswith(
        "Two pairs by hcbench for α = 0.3 s/m by the law: promised 0.022, measured 0.0"
    )
    assert measured.facts.asked[0] == pytest.approx(float(Restitution(0.3).at(0.15)))


def test_a_missing_second_pair_is_named(tmp_path: Path) -> None:
    file = tmp_path / "half.xml"
    file.write_text(MODEL.format(SPRING))
    measured = hcbench.measure(file, "foot,floor", speeds="0.15:1.5:4 m/s")
    assert [cause.code for cause in measured.causes] == ["missing-pair"]
    assert measured.causes[0].title.startswith("1 of the 2 pairs")


@pytest.mark.parametrize(
    "curve", [Restitution(0.315), Restitution(0.2, "linear"), ConstantRestitution(0.7)]
)
def test_a_promise_reads_back_from_its_text(curve: Restitution | ConstantRestitution) -> None:
    promise = Promise("compliant-pairs", 2, curve, 0.0284, (0.1, 3.0), gravity=9.81, friction=0.5)
    assert Promise.read(promise.text) == promise
    assert Promise.read("something of the user's own") is None
    assert (
        Promise("x", 1, MeasuredRestitution(((0.1, 0.9), (1.0, 0.8))), 0.1, (0.1, 1.0)).text == ""
    )


@pytest.mark.parametrize(
    ("was", "edited"), [("restitution 0.7", "restitution 2"), ("error 0.0284", "error 0.0284.1")]
)
def test_a_promise_that_was_edited_into_nonsense_is_not_one(was: str, edited: str) -> None:
    text = Promise("pairs", 2, ConstantRestitution(0.7), 0.0284, (0.1, 3.0)).text
    assert Promise.read(text) is not None
    assert Promise.read(text.replace(was, edited)) is None


def test_a_promise_keeps_its_gravity_and_friction() -> None:
    curve = Restitution(0.3)
    promise = Promise("compliant", 1, curve, 0.05, (0.1, 2.0), (("cone", "elliptic"),), 9.81, 0.5)
    assert Promise.read(promise.text) == promise


PLAIN = """<mujoco><option timestep="0.002" gravity="0 0 {gravity}"/><worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body pos="0 0 .06"><freejoint/><geom name="foot" type="sphere" size=".06" mass=".3"/></body>
</worldbody>{more}</mujoco>"""
PAIR = """<contact><pair geom1="foot" geom2="floor" solref="-47815.1 -3.25003" condim="3"
 friction="{friction} 1" solimp="0.0001 0.0001 1 0.5 1" margin="{margin}"/></contact>
<custom><text name="hcbench:foot:floor" data="compliant by hcbench: 1 pair; restitution 0.9; error 0.1; speeds
 0.1 2 m/s; gravity 9.81 m/s2; friction 1"/></custom>""".replace("\n 0.1", " 0.1")


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({}, ""),
        ({"gravity": -1.62}, "promised-gravity"),
        ({"margin": 0.001}, "promised-margin"),
        ({"friction": 0.5}, "promised-friction"),
    ],
)
def test_a_change_since_tune_wrote_the_pair_is_named(changed: dict[str, float], code: str) -> None:
    now = {"gravity": -9.81, "margin": 0, "friction": 1} | changed
    text = PLAIN.format(gravity=now["gravity"], more=PAIR.format(**now))
    measured = hcbench.measure(text, "foot,floor", speeds="0.5:1:2 m/s", phases=2, rest=False)
    assert [cause.code for cause in measured.causes if cause.code.startswith("promised")] == (
        [code] if code else []
    )


def test_geoms_of_another_friction_than_the_pair_that_hcbench_wrote_are_noted() -> None:
    pair = PAIR.format(friction=1, margin=0)
    text = PLAIN.format(gravity=-9.81, more=pair).replace("<geom ", '<geom friction="0.6" ')
    measured = hcbench.measure(text, "foot,floor", speeds="0.5:1:2 m/s", phases=2, rest=False)
    assert any("friction 1, its geoms alone 0.6" in note for note in measured.facts.notes)


def test_check_and_land_name_what_broke_a_promise_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "moon.xml"
    file.write_text(PLAIN.format(gravity=-1.62, more=PAIR.format(friction=1, margin=0)))
    asked = ["--pair", "foot,floor", "--restitution", "0.9", "--speeds", "0.5:1:2 m/s"]
    assert run(["check", str(file), *asked, "--max-error", "0.0001"]) == 1
    assert "promised-gravity" in capsys.readouterr().out
    landings = hcbench.land(file, heights="0.05 m")
    assert any("promised-gravity" in note for note in landings.notes)
