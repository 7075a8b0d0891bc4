"""Types of the verbs in a user's editor: mypy checks each line, and nothing runs them.

A `type: ignore` marks a mistake that an editor underlines; mypy refuses one that marks none.
"""

from __future__ import annotations

from pathlib import Path
from typing import assert_type

import numpy as np

import hcbench as hb
from hcbench.checking.outcome import Report
from hcbench.fitting.force import ForceFit
from hcbench.fitting.result import FitResult
from hcbench.laws.conventions import Conversion
from hcbench.measuring.measure import CandidatePairs
from hcbench.reporting.ask import StudyReport
from hcbench.sim.engine import Engine
from hcbench.sim.touch import TrajectoryTouchdowns
from hcbench.tuning.answer import Choice
from hcbench.tuning.tuned_model import TunedModel


def results() -> None:
    """Each verb has one type of result."""
    assert_type(hb.law("0.3 s/m"), hb.ImpactLaw)
    assert_type(hb.convert(drake=0.45, speed="0.5 m/s"), Conversion)
    assert_type(hb.fit("drop.wav", Path("b.wav"), height="30 +- 0.1 cm"), FitResult)
    assert_type(hb.fit_force("pulse.csv", mass="0.45 kg", speed="0.5 m/s"), ForceFit)
    assert_type(hb.pairs("my.xml"), CandidatePairs)
    assert_type(hb.measure("my.xml", "ball,plate", speeds="0.1:1:5 m/s", phases=8), hb.Measurement)
    assert_type(
        hb.measure_trajectory("robot.xml", {"qpos": np.zeros((2, 7))}), TrajectoryTouchdowns
    )
    assert_type(hb.land("robot.xml", "5, 10 cm", tilt="5 deg", controller="pd:100,1"), hb.Landings)
    assert_type(hb.check("my.xml", ("ball", "plate"), restitution=0.9, speeds=[0.1, 1.0]), Report)
    assert_type(hb.tune("mujoco", alpha="0.3 s/m", timestep="2 ms", kind="exact"), hb.Answer)
    assert_type(
        hb.tune_model("my.xml", ["a,floor", "b,floor"], alpha=0.3, write_model="t.xml"), TunedModel
    )
    assert_type(
        hb.randomize("my.xml", "foot,floor", restitution="0.3:0.6", friction=(0.5, 1.0)),
        hb.RandomWorlds,
    )
    assert_type(hb.report("study.toml", out="report", quick=True), StudyReport)
    assert_type(hb.load_scene("steel-plane"), hb.Scene)
    assert_type(hb.engine("mujoco"), Engine)


def fields() -> None:
    """A result's fields have types of their own."""
    measurement = hb.measure("my.xml", "ball,plate")
    assert_type([point.restitution for point in measurement.curve], list[float])
    answer = hb.tune("mujoco", alpha=0.3, timestep=2e-3)
    assert_type(answer.best, Choice)
    assert_type(answer.text, str)
    assert_type(hb.tune_model("my.xml", "ball,plate", alpha=0.3).max_error, float)
    assert_type(hb.check("my.xml", measure_only=True).exit_code, int)
    assert_type(hb.fit_force("pulse.csv").stiffness, float)


def mistakes() -> None:
    """Names that are misspelt or another verb's, and values of another type."""
    hb.tune("mujoco", alhpa="0.3 s/m")  # type: ignore[call-arg]
    hb.tune("mujoco", write_model="tuned.xml")  # type: ignore[call-arg]
    hb.tune("mujoco", kind="plugin")  # type: ignore[arg-type]
    hb.tune_model("my.xml", "ball,plate", recipe="impulse")  # type: ignore[call-arg]
    hb.measure("my.xml", "ball,plate", speed="1 m/s")  # type: ignore[call-arg]
    hb.measure("my.xml", "ball,plate", phases=0.5)  # type: ignore[arg-type]
    hb.check("my.xml", "ball,plate", maxerror=0.01)  # type: ignore[call-arg]
    hb.convert(alpha="0.3 s/m", target="square")  # type: ignore[arg-type]
    hb.land("robot.xml", tilts=5)  # type: ignore[call-arg]
    hb.pairs("my.xml", pose="home")  # type: ignore[call-arg]
    hb.fit("drop.wav", law="hertz")  # type: ignore[arg-type]
