"""The text to paste has the numbers of the setting that was measured."""

from __future__ import annotations

import json
import sys
from typing import Any

import pytest

from hcbench.terms.setting import Setting
from hcbench.tuning.model import snippet


def text_of(engine: str, options: dict[str, Any], form: str = "plane") -> str:
    return snippet(Setting(engine, "x", 1e-3, options), form)


SPRING_ROW: dict[str, Any] = {
    "solref": [-1.1 / 3, 0.0],
    "solimp": [1e-4, 1e-4, 1.0, 0.5, 1.0],
    "onset": 1e-6,
    "adhesion": 0.0,
}


DAMPER_ROW: dict[str, Any] = {
    "solref": [0.0, -1926.9348713286079],
    "solimp": [0.1, 0.9, 1e-3, 0.5, 2.0],
}


def test_pasted_mujoco_text_compiles_to_the_same_numbers() -> None:
    mujoco = pytest.importorskip("mujoco")
    rows = [SPRING_ROW, DAMPER_ROW]
    text = text_of("mujoco", {"integrator": "implicitfast", "rows": rows})
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>{text}<worldbody><geom name="plate" type="plane" size="1 1 .1"/>
        <body name="ball" pos="0 0 1"><freejoint/><geom name="ball" size=".0508" mass="2"/>
        </body></worldbody></mujoco>"""
    )
    assert model.opt.timestep == 1e-3
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert model.body("ball").mass == 2.0
    assert model.pair_solref.tolist() == [row["solref"] for row in rows]
    assert model.pair_solimp.tolist() == [row["solimp"] for row in rows]
    assert model.pair_margin.tolist() == [-1e-6, 0.0]


def test_the_cup_takes_its_numbers_on_the_tendon() -> None:
    text = text_of("mujoco", {"rows": [DAMPER_ROW]}, form="cup")
    assert 'solreflimit="0 -1926.9348713286079" solimplimit="0.1 0.9 0.001 0.5 2"' in text
    assert "<pair" not in text


def test_pasted_pybullet_text_makes_every_call_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    options = {
        "world": {"contactSlop": 0.0, "contactBreakingThreshold": 0.02},
        "ball": {"restitution": 1 / 3},
        "plate": {"restitution": 1.0},
        "maximal_coordinates": True,
    }
    calls: list[tuple[Any, ...]] = []
    # What Bullet says of a body: its eleventh number is 1 with maximal coordinates.
    of_maximal = (*[0] * 10, 1)

    class Recorder:
        def __getattr__(self, name: str) -> Any:
            def call(*args: Any, **kwargs: Any) -> tuple[int, ...]:
                if name != "getDynamicsInfo":
                    calls.append((name, args, kwargs))
                return of_maximal

            return call

    monkeypatch.setitem(sys.modules, "pybullet", Recorder())
    exec(text_of("pybullet", options), {"ball": 7, "plate": 8})
    world = {
        "fixedTimeStep": 1e-3,
        "numSubSteps": 0,
        "contactSlop": 0.0,
        "contactBreakingThreshold": 0.02,
    }
    assert calls == [
        ("setPhysicsEngineParameter", (), world),
        ("changeDynamics", (7, -1), {"restitution": 1 / 3}),
        ("changeDynamics", (8, -1), {"restitution": 1.0}),
    ]


def test_nothing_to_paste_for_an_engine_as_it_comes() -> None:
    assert text_of("mujoco", {}) == ""


def test_options_of_an_unknown_engine_are_shown_as_they_are() -> None:
    assert json.loads(text_of("nobodys", {"time_step": 0.0, "dissipation": 1.5})) == {
        "time_step": 0.0,
        "dissipation": 1.5,
    }
