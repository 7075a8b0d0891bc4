"""A check holds a model, or a study setting by setting, to what is wanted: the e that it judges, its verdict,
what the command prints and its exit code. A model that ends its process costs its own check alone.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from checks import BROKEN, CRASH, GOOD, SPEEDS, ask, one

import hcbench as hb
from hcbench.checking import CheckSpec, Outputs, Verdict, check, plan, run_check
from hcbench.checking.judge import judge
from hcbench.checking.outcome import Report
from hcbench.checking.spec import Check
from hcbench.checking.text import as_junit, as_markdown, as_text
from hcbench.cli import run
from hcbench.laws.restitution import Reading
from hcbench.measuring import Wanted
from hcbench.measuring.measurement import Measurement
from hcbench.sim.model_under_test import Request
from hcbench.system.errors import UserError
from hcbench.terms.impact import Impact, Launch, Status


def test_a_good_model_passes_and_a_broken_one_fails_with_its_cause() -> None:
    report = check(ask(restitution=0.9))
    assert report.exit_code == 0
    # The touch is seen up to one step late and that much deeper: of a body under gravity
    # this scatters e by (1/e - e) g h / v, 0.0040 here, 3/4 of it below 0.9. Four phases
    # saw no more than 0.0028 of that.
    row = one(report).rows[0]
    scatter = (1 / 0.9 - 0.9) * 9.81 * 2e-4 / row.speed_in
    assert row.highest - row.lowest == pytest.approx(scatter, rel=0.03)
    assert one(report).worst.worst_phase == pytest.approx(-0.765 * scatter, rel=0.03)
    report = check(ask(BROKEN, restitution=0.9))
    assert report.exit_code == 1
    assert one(report).worst.worst_phase < -0.05
    assert "solimp-mixing" in as_text(report)
    assert 'solimp="0.9999 0.9999' in as_text(report)


def test_the_limit_is_the_limit() -> None:
    off = abs(one(check(ask(BROKEN, restitution=0.9))).worst.worst_phase)
    assert check(ask(BROKEN, restitution=0.9, max_error=off * 1.001)).exit_code == 0
    assert check(ask(BROKEN, restitution=0.9, max_error=off * 0.999)).exit_code == 1


@pytest.mark.parametrize("reading", ["law", "linear"])
def test_the_law_and_its_linear_reading_are_distinguished(reading: Reading) -> None:
    outcome = one(check(ask(alpha="0.016 s/in", target=reading, speeds="0.5 m/s", max_error=1)))
    wanted = Wanted(alpha=0.016 / 0.0254, reading=reading)
    (row,) = outcome.rows
    assert row.target == pytest.approx(float(wanted.at(row.speed_in)), abs=1e-3)
    assert ("by the law" in outcome.against) == (reading == "law")


def test_measured_pairs_in_the_units_of_their_header(tmp_path: Path) -> None:
    csv = tmp_path / "pairs.csv"
    csv.write_text("# a rig\nspeed [in/s],restitution\n20,0.90\n4,0.91\n")
    outcome = one(check(CheckSpec(model=GOOD, pair="ball,plate", points=csv)))
    assert [row.speed for row in outcome.rows] == pytest.approx([4 * 0.0254, 20 * 0.0254])
    assert outcome.verdict is Verdict.PASSED
    assert outcome.rows[0].error == pytest.approx(-0.01, abs=3e-3)
    tight = check(CheckSpec(model=GOOD, pair="ball,plate", points=csv, max_error=0.005))
    assert tight.exit_code == 1


@pytest.fixture(scope="module")
def measured() -> Measurement:
    return hb.measure(GOOD, "ball,plate", speeds="2 m/s", phases=1, diagnose=False, rest=False)


def check_of(target: float, max_error: float) -> Check:
    wanted = hb.Wanted(restitution=target)
    return Check("ball", GOOD, Request(), wanted, None, max_error, None, None)


def test_the_printed_e_weighs_each_phase_by_its_share_of_the_step(measured: Measurement) -> None:
    """0.4 stands for the phases from 0 to 0.25, halfway to its
    neighbours, and 0.8 for the rest: 0.7.
    """
    phases = {0.0625: 0.4, 0.1875: 0.4, 0.3125: 0.8, 0.5: 0.8, 0.9375: 0.8}
    impacts = tuple(
        Impact(Launch(2.0, phase), Status.PARTED, speed_in=2.0, speed_out=2.0 * e, samples=9)
        for phase, e in phases.items()
    )
    outcome = judge(check_of(0.75, 0.5), replace(measured, impacts=impacts))
    (row,) = outcome.rows
    assert row.restitution == pytest.approx(0.7)
    assert row.error == pytest.approx(-0.05)
    (printed,) = [line for line in as_text(Report((outcome,))).splitlines() if line.startswith(" ")]
    assert [float(number) for number in printed.split()][2] == pytest.approx(0.7)


def test_markdown_has_a_row_a_check() -> None:
    text = as_markdown(check(ask(restitution=0.9)))
    assert text.count("\n| ✅ |") == 1


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ([GOOD, "--pair", "ball,plate", "--restitution", "0.9"], 0),
        ([BROKEN, "--pair", "ball,plate", "--restitution", "0.9"], 1),
        ([GOOD, "--pair", "ball,plat", "--restitution", "0.9"], 2),
        (["gone.xml", "--pair", "ball,plate", "--restitution", "0.9"], 2),
        ([GOOD, "--pair", "ball,plate", "--restitution", "much"], 2),
        ([GOOD, "--pair", "ball,plate", "--restitution", "0.9", "--junit", "no/where.xml"], 2),
    ],
)
def test_the_exit_code_says_how_it_ended(
    arguments: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["check", "--speeds", SPEEDS, *arguments]) == code
    printed = capsys.readouterr()
    assert "Traceback" not in printed.out + printed.err
    assert printed.err.count("\n") <= 1


def test_writing_a_baseline_judges_nothing_and_says_where_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "base.json"
    arguments = ["check", GOOD, "--pair", "ball,plate", "--speeds", SPEEDS]
    assert run([*arguments, "--write-baseline", str(file)]) == 0
    printed = capsys.readouterr().out
    assert "MEASURED good.xml: at 2 speeds, and held against nothing: no verdict" in printed
    assert f"written: {file}" in printed
    assert "PASSED" not in printed
    assert "limit" not in printed
    report = check(ask(), measure_only=True)
    assert report.exit_code == 0
    assert 'failures="0" errors="0"' in as_junit(report)
    assert "| 📏 |" in as_markdown(report)


def test_a_check_that_could_never_fail_is_a_mistake() -> None:
    with pytest.raises(UserError, match=r"no target; expected .*--measure-only"):
        check(ask())


def test_no_error_is_a_negative_zero() -> None:
    e = one(check(ask(phases=1), measure_only=True)).rows[0].restitution
    report = check(ask(phases=1, restitution=e + 1e-9))
    assert -1e-5 < one(report).rows[0].error < 0
    assert "-0.0000" not in as_text(report)
    assert "+0.0000" in as_text(report)


def test_a_crash_exits_with_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "setup.py").write_text(CRASH)
    assert run(["check", "--python", f"{tmp_path}/setup.py:build", "--restitution", "0.9"]) == 3
    assert "SIGSEGV" in capsys.readouterr().out


def test_json_on_the_command_line_is_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["measure", GOOD, "--pair", "ball,plate", "--speeds", SPEEDS, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kind"] == "hcbench measurement"
    assert run(["check", BROKEN, "--pair", "ball,plate", "--restitution", "0.9", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["exit_code"] == 1


def test_a_study_has_no_baseline_to_write(tmp_path: Path) -> None:
    """Once the command ran the study, and then said that nothing was measured."""
    (tmp_path / "study.toml").write_text('scene = "steel-plane"\n')
    with pytest.raises(UserError, match=r"write-baseline: given with .*study.toml, a study"):
        check(CheckSpec(model=str(tmp_path / "study.toml")), Outputs(baseline=tmp_path / "b.json"))


STUDY = """schema = 1
scene = "steel-plane"
alphas = "0.008 s/in"
speeds = "8, 16 in/s"
phases = 2
[[run]]
engine = "reference"
recipe = "hunt-crossley"
timesteps = "1e-5 s"
[[run]]
engine = "reference"
recipe = "kelvin-voigt"
timesteps = "1e-5 s"
"""


def test_a_study_is_checked_setting_by_setting(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    report = check(CheckSpec(model=str(tmp_path / "study.toml"), max_error=1e-6))
    law, voigt = report.outcomes
    assert law.verdict is Verdict.PASSED
    assert voigt.verdict is Verdict.FAILED
    with pytest.raises(UserError, match="differs from the study"):
        check(CheckSpec(model=str(tmp_path / "study.toml"), restitution=0.9))


@pytest.mark.parametrize(
    ("option", "value"),
    [
        *(
            ("limit", "-5"),
            ("limit", "5"),
            ("speeds", "0.1"),
            ("phases", "2"),
            ("timestep", "1e-3"),
        ),
        *(
            ("gravity", "0"),
            ("height", "1"),
            ("engine", "mujoco"),
            ("max-error", "7"),
            ("max-error", "-1"),
        ),
    ],
)
def test_a_study_refuses_what_it_would_ignore(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, value: str
) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    assert run(["check", str(tmp_path / "study.toml"), f"--{option}", value]) == 2
    assert capsys.readouterr().err.startswith(f"hcbench: --{option}: ")


HANG = "def build():\n    while True: pass\n"


HUNGRY = "def build():\n    return bytearray(1 << 45)\n"


LEAVES = "import sys\n\ndef build():\n    sys.exit(0)\n"


RAISES = "def build():\n    raise RuntimeError('first\\nsecond')\n"


NOTHING = "def build():\n    pass\n"


@pytest.mark.parametrize(
    ("code", "exit_code", "words"),
    [
        (CRASH, 3, "SIGSEGV"),
        (HANG, 3, "no answer within"),
        (HUNGRY, 3, "memory"),
        (LEAVES, 2, "SystemExit"),
        (RAISES, 2, "RuntimeError: first"),
        (NOTHING, 2, "returned None"),
    ],
)
def test_a_model_that_takes_its_process_down_is_reported_and_the_rest_runs(
    tmp_path: Path, code: str, exit_code: int, words: str
) -> None:
    (tmp_path / "setup.py").write_text(code)
    (tmp_path / "pyproject.toml").write_text(
        f"""[tool.hcbench]
speeds = "0.5 m/s"
[[tool.hcbench.check]]
model = "setup.py:build"
limit = "{1 if code == HANG else 60} s"
restitution = 0.9
[[tool.hcbench.check]]
model = {GOOD!r}
pair = "ball,plate"
restitution = 0.9
"""
    )
    report = check(CheckSpec(model=str(tmp_path / "pyproject.toml")))
    bad, good = report.outcomes
    assert bad.exit_code == report.exit_code == exit_code
    assert words in bad.message
    assert "\n" not in bad.message
    assert good.verdict is Verdict.PASSED


def test_a_mujoco_model_that_asks_for_all_memory_could_not_run(tmp_path: Path) -> None:
    file = tmp_path / "hungry.xml"
    file.write_text(Path(GOOD).read_text().replace("<default>", '<size memory="900G"/><default>'))
    outcome = run_check(plan(ask(str(file), restitution=0.9)))
    assert outcome.exit_code == 3, outcome.message
