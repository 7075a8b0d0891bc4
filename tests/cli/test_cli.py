"""The command line: the paper's numbers, exit codes, and one clear line for every mistake."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from hcbench.benchmark.plan import versions_here
from hcbench.cli import COMMANDS, run
from hcbench.sim.backend import installed_version

pytestmark = pytest.mark.usefixtures("tuned_once")

# The case of section 3.1, k = 3.1e7 lbf/in^1.5, m = 1 lb: α s/in, v in/s, e, x_m in, F_max lbf. e
# from the closed form in 50 digits; depth and force are the true extremes of the loop, which the
# steps of an ODE miss by up to 0.1 and 0.3 %.
PAPER_CASE = [
    (0.008, 4, "0.9689892665", "3.0461e-04", "164.96"),
    (0.008, 8, "0.9398278563", "5.2399e-04", "373.16"),
    (0.008, 12, "0.9123415268", "7.1637e-04", "599.03"),
    (0.008, 16, "0.8863786022", "8.9167e-04", "836.52"),
    (0.016, 16, "0.7953302929", "8.5545e-04", "812.16"),
]
INCH, LBF, PSI = 0.0254, 4.4482216152605, 6894.757293168361


@pytest.mark.parametrize(("alpha", "speed", "e", "depth", "force"), PAPER_CASE)
def test_reference_prints_the_papers_case_to_all_digits(
    capsys: pytest.CaptureFixture[str], alpha: float, speed: float, e: str, depth: str, force: str
) -> None:
    assert run(["law", "--alpha", f"{alpha} s/in", "--speeds", f"{speed} in/s", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert f"{row['restitution']:.10f}" == e
    assert f"{row['penetration_max_m'] / INCH:.4e}" == depth
    assert f"{row['force_max_n'] / LBF:.2f}" == force
    assert row["restitution_linear"] == pytest.approx(1 - alpha * speed)
    # 0.31 of Hertz's largest pressure, (6 F E*^2 / (pi^3 R^2))^(1/3), with E* =
    # 3 k / (4 sqrt(R)), R = 2 in.
    modulus = 0.75 * 3.1e7 / math.sqrt(2.0)
    pressure = (6 * row["force_max_n"] / LBF * modulus**2 / (math.pi**3 * 4.0)) ** (1 / 3)
    assert row["shear_stress_max_pa"] == pytest.approx(0.31 * pressure * PSI, rel=1e-12)


def test_the_papers_stress_limit_is_passed_by_about_15_percent_at_16_in_per_s(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["law", "--alpha", "0.008 s/in", "--speeds", "16 in/s", "--json"]) == 0
    caught = capsys.readouterr()
    (row,) = json.loads(caught.out)
    assert 1.10 < row["shear_stress_max_pa"] / (62_000 * PSI) < 1.15
    assert any("62 000" in warning for warning in row["warnings"])


def test_reference_takes_ranges_and_warns_where_the_paper_ends(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["law", "--alpha", "0.002, 0.008 s/in", "--speeds", "1:24:12 in/s", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) == 24
    assert not rows[0]["warnings"]
    assert any("speed" in warning for warning in rows[-1]["warnings"])


def test_warnings_that_differ_in_their_numbers_are_printed_once(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert (
        run(["law", "--alpha", "0.3", "--speeds", "0.1, 0.635, 1 m/s", "--stiffness", "1e6"]) == 0
    )
    warnings = capsys.readouterr().err.splitlines()
    kinds = [(line.split()[1], line.endswith("(and 1 more)")) for line in warnings]
    assert kinds == [("speed", True), ("α", True)]


def test_every_commands_summary_fits_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    lines = capsys.readouterr().out.partition("Commands:\n")[2].partition("\n\n")[0].splitlines()
    assert len(lines) == sum(not command.hidden for command in COMMANDS)
    assert all(
        len(line) <= 80 and line.endswith(".") and not line.endswith("...") for line in lines
    )


def test_reference_prints_a_table_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["law", "--alpha", "0.315", "--speeds", "0.1:0.4:4"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 6
    assert "e of the law" in lines[0] and "of a steel ball" in lines[5]


def test_engines_lists_every_engine_with_its_settings(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["engines", "--json"]) == 0
    found = {item["name"]: item for item in json.loads(capsys.readouterr().out)}
    assert {"reference", "mujoco", "pybullet", "recorded"} <= set(found)
    assert {"stock", "spring-damper", "impulse"} <= set(found["mujoco"]["settings"])
    assert {"stock", "spring-damper", "restitution"} <= set(found["pybullet"]["settings"])


STUDY = 'scene = "steel-plane"\nalphas = 0.3\nspeeds = 0.2\n[[run]]\nengine = "reference"\n'
RUN = 'recipe = "hunt-crossley"\ntimesteps = 1e-6\n'


@pytest.mark.parametrize(
    ("arguments", "study", "says"),
    [
        (["law", "--alpha", "1 furlong", "--speeds", "1"], "", "--alpha"),
        (["law", "--alpha=-0.1", "--speeds", "1"], "", "alpha"),
        (["law", "--alpha", "0.1", "--speeds", "0"], "", "--speeds"),
        (["law", "--alpha", "0.1", "--speeds=-1 in/s"], "", "--speeds"),
        (["law", "--alpha", "0.1", "--speeds", "1", "--mass", "0"], "", "--mass"),
        (["law", "--alpha", "0.1", "--speeds", "1", "--exponent", "0.5"], "", "exponent"),
        (["law", "--alpha", "0.1"], "", "--speeds"),
        (["rebound"], "", "rebound"),
        (["report", "no-such-study"], "", "no-such-study"),
        (["report", "STUDY"], "not toml at all", "TOML"),
        (["report", "STUDY"], STUDY + RUN + "typo = 1\n", "typo"),
        (["report", "STUDY"], "speed = 1\n" + STUDY + RUN, "speed"),
        (["report", "STUDY"], STUDY + 'recipe = "hunt-crossley"\ntimesteps = 0\n', "timesteps"),
        (["report", "STUDY"], STUDY + 'recipe = "hunt-crossley"\ntimesteps = -1e-3\n', "timesteps"),
        (["report", "STUDY"], STUDY + 'recipe = "no-such"\ntimesteps = 1e-3\n', "no-such"),
        (
            ["report", "STUDY"],
            "schema = true\n" + STUDY + RUN,
            "schema: True; expected the number 1",
        ),
        (["report", "STUDY"], "schema = 1.0\n" + STUDY + RUN, "schema: 1.0; expected the number 1"),
        (["report", "STUDY"], 'schema = "1"\n' + STUDY + RUN, "schema: '1'; expected the number 1"),
        (
            ["report", "STUDY"],
            'title = ["a", "b"]\n' + STUDY + RUN,
            "title: ['a', 'b']; expected text",
        ),
        (["report", "STUDY"], 'title = ""\n' + STUDY + RUN, "title: ''; expected text"),
        (
            ["report", "STUDY"],
            STUDY + 'recipe = ["stock"]\ntimesteps = 1\n',
            "run 1: recipe: ['stock']",
        ),
        (
            ["report", "STUDY"],
            STUDY.replace('"reference"', "3") + RUN,
            "run 1: engine: 3; expected an engine's",
        ),
        (["report", "STUDY"], STUDY.replace("0.3", "-0.3") + RUN, "alphas"),
        (["report", "STUDY"], STUDY.replace("0.2", "0") + RUN, "speeds"),
        (["report", "STUDY"], STUDY.replace("steel-plane", "nowhere") + RUN, "nowhere"),
        (["report", "STUDY"], STUDY.replace("reference", "odin") + RUN, "odin"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], study: str, says: str
) -> None:
    (tmp_path / "study.toml").write_text(study, encoding="utf-8")
    given = [str(tmp_path / "study.toml") if a == "STUDY" else a for a in arguments]
    if given[0] == "report":
        given += ["--out", str(tmp_path / "out"), "--jobs", "1"]
    assert run(given) == 2
    caught = capsys.readouterr()
    assert caught.out == ""
    assert len(caught.err.splitlines()) == 1
    assert says in caught.err
    assert "Traceback" not in caught.err
    assert not (tmp_path / "out").exists()


def test_a_missing_engine_names_its_install_command_and_exits_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from importlib import metadata

    installed = metadata.version

    def absent(name: str) -> str:
        if not name.startswith("mujoco"):
            return installed(name)
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", absent)
    installed_version.cache_clear()
    versions_here.cache_clear()
    study = STUDY.replace("reference", "mujoco") + 'recipe = "impulse"\ntimesteps = 1e-3\n'
    (tmp_path / "study.toml").write_text(study, encoding="utf-8")
    assert run(["report", str(tmp_path), "--out", str(tmp_path / "out")]) == 3
    error = capsys.readouterr().err
    assert "hcbench engines add mujoco, or: pip install mujoco" in error
    assert not (tmp_path / "out").exists()
    versions_here.cache_clear()


def test_a_folder_below_a_file_is_the_users_mistake_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "study.toml").write_text(STUDY + RUN, encoding="utf-8")
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    assert run(["report", str(tmp_path), "--out", str(tmp_path / "file" / "out")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "study.toml"]


def test_convert_says_one_contact_in_every_librarys_words(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["convert", "--alpha", "0.008 s/in", "--speed", "8 in/s", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    found = {row["parameter"]: row["value"][0] for row in rows}
    assert found["hunt_crossley_dissipation"] == pytest.approx(1.5 * 0.008 / INCH)
    assert found["dissipation"] == pytest.approx(0.008 / INCH)
    assert found["restitution"] == pytest.approx(0.9398278563, abs=1e-10)


@pytest.mark.parametrize(
    "arguments", [[], ["--solref", "1"], ["--alpha", "1", "--drake", "1"], ["--restitution", "2"]]
)
def test_what_cannot_be_converted_is_one_line_and_exit_2(
    capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert run(["convert", *arguments]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


MODEL = """<mujoco><option timestep="0.001"/><worldbody><geom name="plate" type="plane" size="1 1 .1"/>
<body name="ball" pos="0 0 1"><freejoint/><geom name="ball" type="sphere" size=".05" SOLREF/></body>
</worldbody></mujoco>"""


def test_the_scene_that_tune_writes_passes_its_own_check_under_gravity(tmp_path: Path) -> None:
    scene, law = str(tmp_path / "tuned.xml"), ["--alpha", "0.301 s/m"]
    band = ["--timestep", "1e-3", "--speeds", "0.2:1.4 m/s", "--plugin", "--write-scene", scene]
    assert run(["tune", "mujoco", *law, *band]) == 0
    assert run(["check", scene, "--pair", "ball,plate", *law, "--speeds", "0.3, 1 m/s"]) == 0


def test_measure_and_check_a_model_of_ones_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = tmp_path / "good.xml", tmp_path / "bad.xml"
    good.write_text(MODEL.replace("SOLREF", 'solref="-1000 0"'), encoding="utf-8")
    bad.write_text(MODEL.replace("SOLREF", ""), encoding="utf-8")
    assert run(["measure", str(good), "--pair", "ball,plate", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)
    gate = ["--pair", "ball,plate", "--restitution", "1", "--max-error", "0.05", "--gravity", "0"]
    assert run(["check", str(good), *gate]) == 0
    assert run(["check", str(bad), *gate]) == 1
    assert "solref" in capsys.readouterr().out
    assert run(["check", str(tmp_path / "none.xml"), *gate]) == 2


def test_part_0_of_another_study_than_reality_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["report", "steel-1lb", "--part", "0"]) == 2
    assert "--part: given without what it belongs to" in capsys.readouterr().err
