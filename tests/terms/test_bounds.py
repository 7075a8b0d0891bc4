"""Numbers that no bouncing body has are refused with their slot, their value and the bound."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from hcbench import cli
from hcbench.benchmark.study import study_from
from hcbench.measuring.measure import measure
from hcbench.system.errors import HcbenchError, QuantityError, StudyError, UserError
from hcbench.system.text import time_step
from hcbench.terms import units
from hcbench.terms.bounds import BOUNDS, beyond_bounds, require_bounds

GOOD = (Path(__file__).parents[2] / "examples" / "good.xml").read_text(encoding="utf-8")
MODEL = """<mujoco><option timestep="{timestep}" gravity="0 0 {gravity}"/><worldbody>
<geom name="plate" type="plane" size="1 1 1" {contact}/>
<body name="ball" pos="0 0 1"><{joint}/><geom name="ball" size="{size}" mass="{mass}" {contact}/></body>
</worldbody></mujoco>"""
PLAIN = {
    "timestep": 1e-3, "gravity": -9.81, "size": 0.1, "mass": 1, "joint": "freejoint",
    "contact": 'solref="-1000 -1"',
}  # fmt: skip


@pytest.mark.parametrize("quantity", sorted(set(BOUNDS) & set(units.QUANTITIES)))
def test_a_quantity_beyond_its_bounds_names_slot_value_and_bound(quantity: str) -> None:
    largest = BOUNDS[quantity][1]
    assert units.parse(largest, quantity, least=0.0) == largest
    if largest < 1e29:
        with pytest.raises(
            QuantityError, match=rf"^--slot: \S+.*expected .*{re.escape(f'{largest:g}')}"
        ):
            units.parse(largest * 1.01, quantity, "--slot")
        with beyond_bounds():
            assert units.parse(largest * 1.01, quantity) == largest * 1.01


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"mass": 1e300}, "mass"),
        ({"size": 1e6}, "size"),
        ({"timestep": 2}, "timestep: 2 s; expected 1e-09 ... 1 s"),
        ({"gravity": -1e9}, "gravity: -1e\\+09 m/s\\^2; expected 0 ... 1000"),
        ({"contact": 'solref="-100000 5"'}, "solref: -100000 5 of .*, which MuJoCo replaces"),
        ({"contact": 'solref="0.02 -1"'}, "solref: 0.02 -1"),
        ({"contact": 'friction="-1 0 0"'}, "friction -1 of geom plate"),
        ({"contact": 'friction="11 0 0"'}, "friction: 11 of geom"),
    ],
)
def test_a_model_is_held_to_what_bodies_are(changes: dict[str, object], says: str) -> None:
    with pytest.raises(UserError, match=says):
        measure(MODEL.format(**PLAIN | changes), "ball,plate", speeds=0.3, phases=1)


def test_what_is_meant_is_admitted() -> None:
    with beyond_bounds():
        text = MODEL.format(**PLAIN | {"contact": 'friction="11 0 0" solref="-1000 -1"'})
        assert measure(text, "ball,plate", speeds=0.3, phases=1, diagnose=False).impacts


@pytest.mark.parametrize(
    ("state", "says"),
    [
        ({"qpos": [0, 0, 1e300, 1, 0, 0, 0]}, "qpos: .*1e\\+300 m; expected 0 ... 10000 m"),
        ({"qpos": [0, 0, 1, 0, 0, 0, 0]}, "the quaternion of .* is 0"),
    ],
)
def test_a_state_is_held_to_what_poses_are(
    tmp_path: Path, state: dict[str, object], says: str
) -> None:
    (tmp_path / "state.json").write_text(json.dumps(state), encoding="utf-8")
    with pytest.raises(UserError, match=says):
        measure(MODEL.format(**PLAIN), "ball,plate", state=tmp_path / "state.json", speeds=0.3)


def test_complex_numbers_are_no_pose(tmp_path: Path) -> None:
    np.savez(tmp_path / "state.npz", qpos=np.array([0, 0, 1, 1j, 0, 0, 0]))
    with pytest.raises(UserError, match="expected numbers"):
        measure(MODEL.format(**PLAIN), "ball,plate", state=tmp_path / "state.npz", speeds=0.3)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            ["law", "--alpha=0.1", "--speeds=1e30"],
            "--speeds: 1e+30 m/s; expected 1e-06 ... 10000 m/s",
        ),
        (["law", "--alpha=0.31 --s/m", "--speeds=1"], "--alpha: '0.31 --s/m': not a unit"),
        (
            ["tune", "mujoco", "--alpha=1e-12", "--speeds=1e9:1e10", "--timestep=1e-3"],
            "--speeds: 1e+09 m/s",
        ),
        (["tune", "mujoco", "--alpha=0.3", "--timestep=1e-3", "--corners=1000000"], "1000000"),
        (["fit", "ticks.csv"], "below 0.999, as of a ball"),
        (["fit", "years.csv"], "expected 0 ... 1e+06 s"),
        (["fit", "drop.csv", "drop.csv"], "same content"),
        (["fit", "drop.csv", "copy.csv"], "same content"),
        (["fit", "drop.csv", "--height=30 m"], "--height: 30 m, and a first flight of 0.443 s"),
        (["fit", "drop.csv", "--gravity=1e9"], "--gravity: 1e+09 m/s^2; expected 0 ... 1000"),
    ],
)
def test_nonsense_is_exit_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    arguments: list[str], says: str,
) -> None:  # fmt: skip
    drop = "time [s]\n0\n0.443\n0.842\n1.201\n1.524\n1.815\n"
    files = {"drop": drop, "copy": drop, "ticks": "time [s]\n0\n0.5\n1\n1.5\n2.0\n"}
    files["years"] = "time [year]\n0\n0.443\n0.842\n1.201\n1.524\n"
    for name, text in files.items():
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert cli.run(arguments) == 2
    assert says in capsys.readouterr().err


def test_beyond_bounds_ends_with_its_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["law", "--alpha=1e-9", "--speeds=2e4", "--beyond-bounds"]) == 0
    assert cli.run(["law", "--alpha=1e-9", "--speeds=2e4"]) == 2


def test_a_drop_without_end_is_refused() -> None:
    run = {"engine": "reference", "recipe": "hunt-crossley", "timesteps": 1e-6}
    study = {"scene": "steel-plane", "alphas": 0.3, "speeds": 0.2, "train_step": 1e-9, "run": [run]}
    with pytest.raises(StudyError, match="train_height"):
        study_from({**study, "train_height": "9 km"})
    with pytest.raises(StudyError, match="train_height"):
        study_from({**study, "train_height": 1e15})


@pytest.mark.parametrize(
    ("text", "step"),
    [("1/240 s", 1 / 240), ("1/240", 1 / 240), ("2/480 s", 1 / 240), ("1 ms", 1e-3)],
)
def test_a_step_is_written_as_a_fraction(text: str, step: float) -> None:
    assert units.parse(text, "timestep") == step
    assert time_step(1 / 240) == "1/240"
    assert time_step(1e-3) == "0.001"
    with pytest.raises(HcbenchError):
        units.parse("1/0 s", "timestep")


def test_a_number_just_beyond_its_bound_is_shown_in_full() -> None:
    with pytest.raises(QuantityError, match=r"mass: 1000000000.5 kg; expected 1e-12 ... 1e\+09 kg"):
        require_bounds("mass", [1e9 + 0.5], "mass", "kg")
