"""The command: what it prints, and the exit code."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from checks import BROKEN, CRASH, GOOD, SPEEDS, ask, one

from hcbench.checking import CheckSpec, Outputs, check
from hcbench.checking.text import as_junit, as_markdown, as_text
from hcbench.cli import run
from hcbench.system.errors import UserError


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
