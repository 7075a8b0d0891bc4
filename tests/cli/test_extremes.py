"""Absurd numbers in every place: exit 2 in one short line with the cause, and no warning."""

from __future__ import annotations

import math
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hcbench.cli import run
from hcbench.engines.reference import successive_bounces
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley, KelvinVoigt
from hcbench.paper.vibroimpact.simulate import simulate
from hcbench.paper.vibroimpact.system import VibroImpact
from hcbench.system import errors
from hcbench.system.compiler import compiler
from hcbench.system.errors import HcbenchError, UserError
from hcbench.system.files import parse_json, write_text
from hcbench.terms.impact import Impact, Launch, Status

GOOD = Path(__file__).parents[2] / "examples" / "good.xml"
MODEL = [str(GOOD), "--pair", "ball,plate"]
DEEP = 100_000  # brackets
STUDY = """scene = "steel-plane"
alphas = 0.3
speeds = "0.1, 0.2"
[[run]]
engine = "reference"
recipe = "hunt-crossley"
timesteps = 1e-5
"""


def refused(capsys: pytest.CaptureFixture[str], arguments: list[str], cause: str) -> None:
    """The command ends with exit 2 and the cause in its last line."""
    assert run(arguments) == 2
    caught = capsys.readouterr()
    message = (caught.out + caught.err).splitlines()[-1]
    assert cause in message
    assert "unexpected" not in message
    assert len(message) <= 300 + len("hcbench: ")


@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        (["measure", *MODEL, "--key", "²"], "expected one of: qpos0"),
        (["measure", *MODEL, "--timestep", "1e300"], "1e-09 ... 1 s"),
        (["measure", *MODEL, "--timestep", "1e-320"], "1e-09 ... 1 s"),
        (["measure", *MODEL, "--gravity", "1e300"], "0 ... 1000 m/s^2"),
        (["check", *MODEL, "--restitution", "0.9", "--speeds", "1e300"], "1e-06 ... 10000 m/s"),
        (["check", *MODEL, "--restitution", "0.9", "--limit", "1e10"], "0 ... 1e+06 s"),
        (
            ["check", "nope.xml", "--pair", "a,b", "--write-baseline", "b.json"],
            "nope.xml is not there",
        ),
        (["tune", "mujoco", "--alpha", "0.3", "--timestep", "1e300"], "1e-09 ... 1 s"),
        (["tune", "mujoco", "--alpha", "0.3", "--timestep", "1e-320"], "1e-09 ... 1 s"),
        (["tune", "mujoco", "--alpha", "1e20", "--timestep", "1e-3"], "0 ... 10000 s/m"),
        (["convert", "--alpha", "1e300", "--speed", "1"], "0 ... 10000 s/m"),
        (
            ["law", "--alpha", "1", "--speeds", "1", "--stiffness", "1e300", "--mass", "1e-300"],
            "1e-12 ... 1e+09 kg",
        ),
    ],
    ids=lambda value: " ".join(value[2:]) if isinstance(value, list) else None,
)
def test_what_leaves_the_range_of_a_float_is_refused_by_name(
    capsys: pytest.CaptureFixture[str], arguments: list[str], cause: str
) -> None:
    refused(capsys, arguments, cause)


def test_a_step_in_a_model_file_is_held_to_the_same_range(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty.xml").write_text("<mujoco/>")
    refused(capsys, ["measure", str(tmp_path / "empty.xml"), "--pair", "a,b"], "no body 'a'")
    text = '<mujoco><option timestep="1e300"/><worldbody/></mujoco>'
    (tmp_path / "coarse.xml").write_text(text)
    refused(
        capsys,
        ["measure", str(tmp_path / "coarse.xml"), "--pair", "a,b"],
        "timestep: 1e+300 s; expected 1e-09 ... 1 s",
    )


@pytest.mark.parametrize(
    "content", ["[]", "null", "7", "[" * DEEP, '{"schema": 3, "kind": "hcbench sweep"}']
)
def test_a_damaged_description_is_no_sweep(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str
) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    folder = tmp_path / "sweep"
    folder.mkdir()
    (folder / "_sweep.json").write_text(content)
    refused(capsys, ["report", str(folder), "--out", str(tmp_path / "out")], "_sweep.json")
    refused(
        capsys,
        ["sweep", str(tmp_path / "study.toml"), "--out", str(folder), "--resume"],
        "_sweep.json",
    )


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        ("[]", "expected schema 4"),
        ("null", "expected schema 4"),
        ("[" * DEEP, "nested too deeply"),
        (
            '{"schema": 2}',
            "schema 2, whose e has an earlier definition: speeds at a step's start or end",
        ),
        ('{"schema": 4}', "study: missing"),
        ('{"schema": 4, "study": []}', "study: []"),
    ],
)
def test_damaged_results_are_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, cause: str
) -> None:
    for name in ("restitution", "loops", "scores", "trains", "rests"):
        (tmp_path / f"{name}.csv").write_text("x\n1\n")
    (tmp_path / "summary.json").write_text(content)
    refused(capsys, ["check", str(tmp_path)], cause)


@pytest.mark.parametrize("text", ["a = " + "[" * DEEP, "[tool.hcbench]\nmodel = " + "[" * DEEP])
def test_a_toml_file_nested_without_end_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    (tmp_path / "deep.toml").write_text(text)
    refused(capsys, ["report", str(tmp_path / "deep.toml")], "is not TOML")
    refused(capsys, ["check", str(tmp_path / "deep.toml")], "is not TOML")


@pytest.mark.parametrize("text", ["[" * DEEP + "]" * DEEP, '{"a":' * DEEP + "1" + "}" * DEEP])
def test_a_baseline_nested_without_end_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    (tmp_path / "deep.json").write_text(text)
    refused(capsys, ["check", *MODEL, "--baseline", str(tmp_path / "deep.json")], "is not JSON")
    with pytest.raises(ValueError, match="deep"):
        parse_json(text)


def test_a_compiler_that_the_shell_could_not_read_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "'")
    with pytest.raises(UserError, match=r"^\$CC: .*No closing quotation"):
        compiler()


@pytest.mark.parametrize("option", ["--no-such\x1b[31m\n-option", "--" + "x" * 5000])
def test_an_error_of_the_command_line_is_one_short_line_too(
    capsys: pytest.CaptureFixture[str], option: str
) -> None:
    refused(capsys, ["law", option], "No such option")
    assert run(["law", option]) == 2
    assert "\x1b" not in capsys.readouterr().err


@given(st.lists(st.text(max_size=2000), min_size=4, max_size=4))
def test_a_message_is_one_line_of_300_characters_that_print(parts: list[str]) -> None:
    message = str(HcbenchError(*parts))
    assert len(message) <= errors.LONGEST
    assert all(character.isprintable() for character in message)


def test_a_long_cause_leaves_the_advice_whole() -> None:
    error = UserError("model", "x" * 5000, "a model", "Write a shorter one")
    assert str(error).startswith("model: xxx")
    assert str(error).endswith("...; expected a model. Write a shorter one")


@pytest.mark.parametrize("value", [1e300, 1e-300, -1.0, math.nan, math.inf])
def test_a_law_is_of_numbers_whose_squares_are_numbers(value: float) -> None:
    with pytest.raises(UserError, match="stiffness"):
        HuntCrossley(value, 0.3)
    with pytest.raises(UserError, match="stiffness"):
        KelvinVoigt(value, 0.0)
    if not 0 < value < 1:
        with pytest.raises(UserError, match="alpha"):
            HuntCrossley(1.0, value)


def test_the_ends_of_the_range_are_computed_without_a_warning() -> None:
    ends = ["1e-30", "1e30"]
    for alpha, speed, mass, stiffness in np.array(np.meshgrid(*[ends] * 4)).reshape(4, -1).T:
        options = ["--speeds", speed, "--mass", mass, "--stiffness", stiffness]
        assert run(["law", "--alpha", alpha, *options]) in (0, 2)
        assert run(["convert", "--alpha", alpha, "--speed", speed, "--timestep", mass]) in (0, 2)


@pytest.mark.parametrize("stiffness", [1e27, 1e30])
def test_a_contact_too_shallow_for_a_positions_digits_is_refused(stiffness: float) -> None:
    """Once the steps to such a touch had no end."""
    law = HuntCrossley(stiffness, 0.3)
    with pytest.raises(UserError, match="depth of contact"):
        simulate(VibroImpact(0.45, 1e-3, law, law), 0.0, 1.0, until=0.01)


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_a_step_of_which_a_contact_has_millions_is_refused(
    capsys: pytest.CaptureFixture[str], engine: str
) -> None:
    refused(
        capsys,
        ["tune", engine, "--alpha", "0.3", "--timestep", "1e-12", "--beyond-bounds"],
        "Use 1.7e-10 s or more",
    )


@pytest.mark.parametrize("alpha", [0.0, 1e-3, 0.3])
def test_thousands_of_bounces_that_lose_next_to_nothing_are_few_impacts(alpha: float) -> None:
    """37 s, once: each was integrated. Speeds fall as bounces by the closed
    e have it, by 8 % for α = 0.3.
    """
    law, gravity, computed = HuntCrossley(3.4e10, alpha), 9.81, []

    def impact_at(speed: float) -> Impact:
        computed.append(speed)
        out = float(closed_form.restitution(alpha, speed)) * speed
        loop = closed_form.loop(law, 0.45, speed, 9)
        return Impact(Launch(speed), Status.PARTED, speed_in=speed, speed_out=out, loop=loop)

    times = np.linspace(0.0, 2.0, 20_001)
    path = successive_bounces(impact_at, gravity, 1e-9, 0.0, times)
    exact = [(2 * gravity * 1e-9) ** 0.5]
    elapsed = exact[0] / gravity
    while elapsed < 2.0:
        exact.append(float(closed_form.restitution(alpha, exact[-1])) * exact[-1])
        elapsed += 2 * exact[-1] / gravity + float(closed_form.duration(law, 0.45, exact[-2]))
    assert len(exact) > 1000
    assert len(computed) < len(exact) / 10
    last = path.rate[-1000:]
    assert np.abs(last).max() == pytest.approx(exact[-1], rel=0.02)


def test_what_killed_processes_left_goes_and_what_others_write_stays(tmp_path: Path) -> None:
    left, fresh = tmp_path / ".hcbench-1-2.new", tmp_path / ".hcbench-3-4.new"
    for file in (left, fresh):
        file.write_text("half")
    os.utime(left, (1.0, 1.0))
    write_text(tmp_path / "out.txt", "whole")
    assert sorted(path.name for path in tmp_path.iterdir()) == [fresh.name, "out.txt"]


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no device without an end")
def test_a_table_linked_to_a_device_is_not_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "summary.json").write_text('{"schema": 3}')
    for name in ("restitution", "loops", "scores", "trains"):
        (tmp_path / f"{name}.csv").symlink_to("/dev/zero")
    refused(capsys, ["check", str(tmp_path)], "not a regular file")


def test_a_pose_that_unpacks_without_end_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    state = tmp_path / "pose.npz"
    with zipfile.ZipFile(state, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("qpos.npy", bytes(65 << 20))
    refused(
        capsys,
        ["measure", "scenes/steel-plane/scene.xml", "--state", str(state)],
        "more than 64 MiB",
    )


@pytest.mark.parametrize("content", [b"", b"PK", b"PK\x03\x04" + bytes(40), bytes(100)])
def test_a_pose_that_is_damaged_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes
) -> None:
    state = tmp_path / "pose.npz"
    state.write_bytes(content)
    refused(
        capsys,
        ["measure", "scenes/steel-plane/scene.xml", "--state", str(state)],
        "a .npz or JSON file",
    )
