"""JSON and TOML that Python's readers take, or fail on, without a word."""

from pathlib import Path
from typing import Any

import pytest

from hcbench.checking import CheckSpec, check
from hcbench.checking.text import find_table
from hcbench.cli import run
from hcbench.measuring.request import read_state
from hcbench.system.errors import UserError
from hcbench.system.files import parse_json, read_text
from hcbench.terms import fields


@pytest.mark.parametrize(
    "text", ['{"a": 1, "a": 1}', '[{"b": {"a": 1, "c": 2, "a": 3}}]', '{"a": {}, "\\u0061": 1}']
)
def test_a_key_twice_is_refused_at_any_depth(text: str) -> None:
    with pytest.raises(ValueError, match="'a' is there twice"):
        parse_json(text)


def test_a_state_with_a_joint_twice_names_it(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    path.write_text('{"hip": 0.3, "hip": 0.4}')
    with pytest.raises(UserError, match="'hip' is there twice"):
        read_state(path)


@pytest.mark.parametrize("value", ["5", "'x'", "true", "[1]", "1979-05-27", "0.5", "9" * 5000])
def test_a_table_that_is_something_else_is_refused(value: str, tmp_path: Path) -> None:
    path = tmp_path / "pyproject.toml"
    path.write_text(f"[tool]\nhcbench = {value}\n")
    with pytest.raises(UserError, match=r"pyproject\.toml"):
        find_table(path)


def test_a_toml_file_that_is_neither_checks_nor_a_study_says_what_it_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "other.toml"
    path.write_text('[project]\nname = "mine"\n')
    assert run(["check", str(path)]) == 2
    assert "has no [tool.hcbench]" in capsys.readouterr().err


def test_a_toml_file_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second reading could see another file."""
    path = tmp_path / "checks.toml"
    path.write_text('[[check]]\nmodel = "ball.xml"\nno-such-key = 1\n')
    opened: list[Path] = []

    def read(file: Path, **limits: Any) -> str:
        opened.append(file)
        return read_text(file, **limits)

    monkeypatch.setattr(fields, "read_text", read)
    with pytest.raises(UserError, match="no-such-key"):
        check(CheckSpec(model=str(path)))
    assert opened == [path]


@pytest.mark.parametrize("value", ["true", "1979-05-27", "nan", "[[1]]"])
@pytest.mark.parametrize("key", ["points", "baseline", "trajectory", "package"])
def test_a_value_of_another_type_is_refused_in_the_words_of_its_key(
    key: str, value: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "pyproject.toml"
    path.write_text(f"[[tool.hcbench.check]]\nmodel = 'ball.xml'\n{key} = {value}\n")
    run(["check", str(path)])
    printed = "".join(capsys.readouterr())
    assert key in printed
    assert "Input" not in printed
    assert "unexpected" not in printed


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[tool.hcbench]\ncheck = []", r"check: \[\]; expected \[\[tool.hcbench.check\]\] entries"),
        ("[tool.hcbench]", r"check: missing; expected \[\[tool.hcbench.check\]\] entries"),
        ("[[tool.hcbench.checks]]\nmodel = 'a'", "checks: unknown key; expected one of: check, "),
        (
            "[[tool.hcbench.check]]\nmodel = 'a'\nmax-error = inf",
            r"checks: .*pyproject\.toml: \[tool\.hcbench\] check\[0\]: max-error: inf",
        ),
        ("a = " + "[" * 5000, "is not TOML that can be read: brackets .* Mend its brackets$"),
    ],
)
def test_a_mistake_in_a_list_of_checks_is_named_in_its_words(
    text: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "pyproject.toml"
    path.write_text(text)
    with pytest.raises(UserError, match=message):
        check(CheckSpec(model=str(path)))
