"""Units: what a user types becomes the SI number it means, or one clear line. Numbers that no bouncing body
has are refused with their slot, their value and the bound.
"""

from __future__ import annotations

import itertools
import json
import math
import re
from pathlib import Path

import numpy as np
import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hcbench import cli
from hcbench.benchmark.study import study_from
from hcbench.measuring.measure import measure
from hcbench.system.errors import HcbenchError, QuantityError, StudyError, UserError
from hcbench.system.text import time_step
from hcbench.terms import units
from hcbench.terms.bounds import BOUNDS, beyond_bounds, require_bounds


@pytest.mark.parametrize(
    ("text", "quantity", "si"),
    [
        ("0.008 s/in", "alpha", 0.008 / 0.0254),
        ("16 in/s", "speed", 16 * 0.0254),
        ("1 lb", "mass", 0.45359237),
        ("3.1e7 lbf/in^1.5", "stiffness", 3.1e7 * 4.4482216152605 / 0.0254**1.5),
        ("1 ms", "timestep", 1e-3),
        ("9.81", "acceleration", 9.81),
        (0.25, "speed", 0.25),
        ("62000 psi", "pressure", 62000 * 4.4482216152605 / 0.0254**2),
    ],
)
def test_text_becomes_the_si_number_it_means(text: object, quantity: str, si: float) -> None:
    assert units.parse(text, quantity) == pytest.approx(si, rel=1e-15)


@pytest.mark.parametrize(
    ("si", "unit", "factor"),
    [(si, unit, f) for si, few in units._USUAL.items() for unit, f in few.items()],
)
def test_units_that_are_read_without_pint_are_those_of_pint(
    si: str, unit: str, factor: float
) -> None:
    assert factor == pytest.approx(units._factor(unit, si), rel=1e-15)


def test_units_that_are_refused_without_pint_are_those_that_pint_refuses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refused = []
    for si, other in itertools.permutations(units._APART, 2):
        for unit in units._USUAL[other]:
            with pytest.raises(TypeError):
                units._factor(unit, si)
            refused.append((unit, si))
    monkeypatch.setattr(units, "_APART", ())
    for unit, si in refused:
        with pytest.raises(pint.DimensionalityError):
            units._factor.__wrapped__(unit, si)


def test_a_stiffness_has_the_unit_of_its_exponent() -> None:
    assert units.parse("1 lbf/in", "stiffness", exponent=1.0) == pytest.approx(
        4.4482216152605 / 0.0254
    )
    with pytest.raises(QuantityError, match=r"N/m\^2"):
        units.parse("1 lbf/in", "stiffness", exponent=2.0)


def test_a_range_without_a_count_has_twenty_even_values() -> None:
    assert units.parse_values("1:20 in/s", "speed") == pytest.approx(np.arange(1, 21) * 0.0254)


def test_lists_and_ranges_mix_and_keep_their_order() -> None:
    found = units.parse_values("5 m/s, 1:2:3 m/s, 10 in/s", "speed")
    assert found == pytest.approx([5, 1, 1.5, 2, 0.254])
    assert units.parse_values(["1 in/s", 2], "speed") == pytest.approx([0.0254, 2])


@pytest.mark.parametrize(
    "text",
    [
        "",
        ",",
        "x",
        "1 furlongz",
        "1 kg",
        "nan",
        "inf",
        "1 2",
        "1:2:3:4 m/s",
        "1:x m/s",
        "1:2:1 m/s",
        "1:2:1e9 m/s",
        "1:2:2.5",
        "1 in/s, 2",
        "1, 2 in/s, 3 m/s",
        "1 m/s # of the sensor",
        "1 m/s 3",
        "1 m/s;2 m/s",
        "1 m/s/rad",
        True,
    ],
)
def test_what_is_no_speed_is_refused_with_the_slot_and_an_example(text: object) -> None:
    with pytest.raises(QuantityError) as caught:
        units.parse_values(text, "speed", "--speed")
    message = str(caught.value)
    assert message.startswith("--speed: ")
    assert "expected" in message
    assert "\n" not in message


@given(st.floats(1e-6, 1e5))
def test_inches_are_exactly_25_4_mm(value: float) -> None:
    assert units.parse(f"{value!r} in", "length") == pytest.approx(value * 0.0254, rel=4e-16)


@given(st.text(max_size=12))
def test_any_text_is_a_finite_number_or_a_quantity_error(text: str) -> None:
    try:
        found = units.parse_values(text, "alpha")
    except QuantityError:
        return
    assert all(math.isfinite(v) for v in found)


@pytest.mark.parametrize(
    ("text", "quantity", "meant"),
    [
        ("0,3 s/m", "alpha", "'0.3 s/m'"),
        ("--0.3", "alpha", "'-0.3'"),
        ("−0.3", "acceleration", "'-0.3'"),
        ("1 rpm", "frequency", "1/60 Hz"),
        ("6.28 rad/s", "frequency", "1/(2π) Hz"),
        ("360 deg/s", "frequency", "1/(2π) Hz"),
    ],
)
def test_a_near_miss_is_refused_with_what_was_meant(text: str, quantity: str, meant: str) -> None:
    with pytest.raises(QuantityError, match="expected") as caught:
        units.parse(text, quantity)
    assert meant in str(caught.value)


@pytest.mark.parametrize(
    "text", ["1,5", "0,3 m/s", "1,5:2,5:3 m/s", "1,5, 2", "1,250,000 m/s", "1,050 m/s", "1,234.5"]
)
def test_a_comma_that_may_be_a_decimal_point_makes_no_list(text: str) -> None:
    with pytest.raises(QuantityError, match="comma between digits"):
        units.parse_values(text, "speed")


@given(st.lists(st.floats(1e-3, 1e3), min_size=1, max_size=5), st.sampled_from([",", ", ", " , "]))
def test_a_unit_at_the_end_holds_for_the_whole_list_as_at_each_value(
    values: list[float], comma: str
) -> None:
    texts = [repr(value) for value in values]
    found = units.parse_values(f"{comma.join(texts)} in/s", "speed")
    assert found == pytest.approx(
        units.parse_values(comma.join(f"{t} in/s" for t in texts), "speed")
    )
    assert found == pytest.approx(np.array(values) * 0.0254)
    if len(texts) > 1:
        with pytest.raises(QuantityError, match="some values"):
            units.parse_values(f"{texts[0]} in/s{comma}{comma.join(texts[1:])}", "speed")


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
        ({"contact": 'friction="11 0 0"'}, "friction: 11 of geoms plate and ball"),
    ],
)
def test_a_model_is_held_to_what_bodies_are(changes: dict[str, object], says: str) -> None:
    with pytest.raises(UserError, match=says):
        measure(MODEL.format(**PLAIN | changes), "ball,plate", speeds=0.3, phases=1)


def test_the_friction_of_a_pair_counts_where_it_has_one() -> None:
    text = MODEL.format(**PLAIN | {"contact": 'friction="11 0 0" solref="-1000 -1"'})
    pair = '<contact><pair geom1="plate" geom2="ball" friction="{}" solref="-1000 -1"/></contact>'
    modest = text.replace("</mujoco>", pair.format("0.5 0.5") + "</mujoco>")
    assert measure(modest, "ball,plate", speeds=0.3, phases=1, diagnose=False).impacts
    rough = MODEL.format(**PLAIN).replace("</mujoco>", pair.format("12 12") + "</mujoco>")
    with pytest.raises(UserError, match="friction: 12 of geoms"):
        measure(rough, "ball,plate", speeds=0.3, phases=1)


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
        (["law", "--alpha=0.3 +- 10 %", "--speeds=1"], "'0.3 +- 10 %' has an uncertainty"),
        (["law", "--alpha=30 %", "--speeds=1"], "--alpha: '30 %' is in per cent"),
        (
            ["law", "--alpha=0.3", "--speeds=1 mm/s:1 m/s"],
            "'1 mm/s:1 m/s' has a unit within a range; expected one unit, at its end",
        ),
        (
            ["tune", "mujoco", "--alpha=0.3 +- 10 %", "--timestep=1e-3"],
            "'0.3 +- 10 %' has its uncertainty in per cent",
        ),
        (
            ["measure", "m.xml", "--angle=90 deg"],
            "--angle: '90 deg'; expected below 90 deg (1.5708 rad)",
        ),
        (["measure", "m.xml", "--gravity=1,2"], "--gravity: '1,2'; expected one number along -z"),
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
