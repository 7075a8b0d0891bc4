"""Fields of files and options: what they read, and the one line for a mistake."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import Field

from hcbench.system.errors import SceneError, SettingError, StudyError, UserError
from hcbench.system.files import parse_json
from hcbench.terms.fields import (
    Alpha,
    FileTable,
    Finite,
    Mass,
    OptionTable,
    Speeds,
    Steps,
    Text,
    read_numbers,
    read_toml,
    validate,
)


class Row(OptionTable):
    """A part of a file that comes several times."""

    solref: Finite


class File(FileTable):
    """A file."""

    speeds: Speeds
    mass: Mass = 1.0
    alpha: Alpha | None = None
    title: Text = Field("", description="text")
    rows: tuple[Row, ...] = Field((), description="a list of rows")
    models: dict[str, dict[str, str]] = Field(default={}, description="tables of file names")
    steps: Steps = (1e-3,)


def test_quantities_are_read_in_si_and_repeats_once() -> None:
    file = validate(
        File, {"speeds": "1, 2, 1 m/s", "mass": "1 lb", "alpha": 0, "steps": [1e-3]}, StudyError
    )
    assert file.speeds == (1.0, 2.0)
    assert file.mass == pytest.approx(0.45359237)
    assert (file.alpha, file.steps, file.rows) == (0.0, (1e-3,), ())


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({}, "x.toml: speeds: missing; expected numbers in m/s, or text like '16 in/s'"),
        ({"speeds": "0 in/s"}, "speeds: 0 m/s; expected a value above 0"),
        ({"speeds": 1, "alpha": -1}, "alpha: -1 s/m; expected 0 s/m or more"),
        (
            {"speeds": 1, "alpha": "1 kg"},
            "alpha: '1 kg': 'kg' does not fit; expected a unit that converts to",
        ),
        ({"speeds": 1, "mass": True}, "mass: True; expected a number or text like '1 lb'"),
        ({"speeds": 1, "title": ["x"]}, "title: ['x']; expected text"),
        ({"speeds": 1, "speed": 2}, "speed: unknown key; expected one of: speeds, mass, alpha"),
        ({"speeds": 1, "a\nb": 2}, "x.toml: a?b: unknown key"),
        ({"speeds": 1, "rows": 3}, "rows: 3; expected a list of rows"),
        ({"speeds": 1, "rows": [{"solref": 1}, 3]}, "rows[1]: 3; expected a table of solref"),
        (
            {"speeds": 1, "rows": [{"solref": float("nan")}]},
            "rows[0].solref: nan; expected a finite number",
        ),
        (
            {"speeds": 1, "rows": [{"margin": 1, "solref": 1}]},
            "rows[0].margin: unknown; expected one of: sol",
        ),
        (
            {"speeds": 1, "models": {"an-engine": {"ball": 3}}},
            "models.an-engine.ball: 3; expected tables of",
        ),
    ],
)
def test_a_mistake_is_one_line_with_the_slot(content: dict[str, Any], said: str) -> None:
    with pytest.raises(StudyError) as caught:
        validate(File, content, StudyError, "x.toml: {}")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_numbers_are_read_by_name() -> None:
    assert read_numbers({"k": 2, "c": 0.5}, ["k"], ["c", "n"], SettingError, "{}") == {
        "k": 2.0,
        "c": 0.5,
    }
    for options, said in (
        ({}, "option 'k': missing"),
        ({"k": "2"}, "'2'; expected a finite number"),
    ):
        with pytest.raises(SettingError, match=said):
            read_numbers(options, ["k"], [], SettingError, "option '{}'")


def test_a_file_that_is_no_toml_is_refused_as_such(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    with pytest.raises(SceneError, match=r"scene\.toml does not exist; expected a scene"):
        read_toml(file, SceneError, "scene", "a scene")
    file.write_bytes(b"\xff")
    with pytest.raises(SceneError, match="expected a readable TOML file"):
        read_toml(file, SceneError, "scene")
    file.write_text("a == 1")
    with pytest.raises(SceneError, match="is not TOML"):
        read_toml(file, SceneError, "scene")


def test_the_mark_that_editors_in_windows_write_is_no_part_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "marked.toml"
    path.write_bytes("\ufeffmass = 1\n".encode())
    assert read_toml(path, UserError, "study") == {"mass": 1}
    assert parse_json("\ufeff[1]") == [1]
