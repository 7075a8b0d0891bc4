"""The output of `--json` has the fields that the documentation lists, and no other."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from hcbench.cli import run

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs"))

import output_schema  # type: ignore[import-not-found]  # noqa: E402

pytestmark = pytest.mark.usefixtures("tuned_once")

BALL = ("examples/good.xml", "--pair", "ball,plate")
COMMANDS = (
    ("measure", *BALL, "--speeds", "0.5, 1 m/s", "--angle", "0, 45 deg", "--alpha", "0.3"),
    ("measure", *BALL, "--speeds", "0.5, 1 m/s", "--contact"),
    (
        "check",
        "examples/broken.xml",
        "--pair",
        "ball,plate",
        "--speeds",
        "1 m/s",
        "--restitution",
        "0.9",
    ),
    (
        "tune",
        "mujoco",
        "--recipe",
        "impulse",
        "--restitution",
        "0.8",
        "--timestep",
        "2 ms",
        "--gravity",
        "0",
        "--friction",
        "0",
    ),
    ("tune MODEL", *BALL, "--restitution", "0.5", "--max-error", "1"),
    ("randomize", *BALL, "--restitution", "0.9", "--worlds", "1", "--speeds", "1 m/s"),
    ("fit", "examples/recording/drop.wav"),
    ("measure MODEL", "examples/quadruped.xml"),
    ("land", "examples/good.xml", "--heights", "2 cm"),
    ("engines",),
    ("convert", "--alpha", "0.3", "--speed", "1 m/s", "--timestep", "1 ms"),
    ("materials",),
    ("materials", "steel on steel"),
    ("law", "--alpha", "0.3", "--speeds", "0.1, 1 m/s"),
)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: " ".join(c[:3]))
def test_an_output_has_the_fields_of_the_schema(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    name, *options = command
    assert run([name.split()[0], *options, "--json"]) in (0, 1)
    TypeAdapter(output_schema.OUTPUTS[name]).validate_json(capsys.readouterr().out)


def test_an_unknown_field_is_not_in_the_schema() -> None:
    row = {"system": "a", "parameter": "b", "value": [1.0], "unit": "", "note": ""}
    known = {
        "restitution": 0.9,
        "restitution_linear": 0.9,
        "rows": [row],
        "missing": [],
        "caveats": [],
    }
    whole = {"alpha_s_per_m": 0.3, "speed_m_per_s": None, **known}
    convert = TypeAdapter(output_schema.OUTPUTS["convert"])
    assert convert.validate_python(whole) == whole
    with pytest.raises(ValueError, match="surprise"):
        convert.validate_python({**whole, "surprise": 1})


@pytest.mark.parametrize(
    ("page", "tables"),
    [
        (output_schema.PAGE, output_schema.fields),
        (output_schema.CSV_PAGE, output_schema.csv_columns),
    ],
    ids=["JSON", "CSV"],
)
def test_a_page_has_the_tables_that_are_written_from_the_types(
    page: Path, tables: Callable[[], str]
) -> None:
    text = page.read_text(encoding="utf-8")
    assert text.split(output_schema.BEGIN)[1].split(output_schema.END)[0] == tables()


def test_a_speed_has_one_spelling() -> None:
    about = output_schema.schema()["$defs"].values()
    names = {name for each in about for name in each.get("properties", {})}
    assert "speeds_m_per_s" in names
    assert not [name for name in names if name.endswith(("_m_s", "_mps"))]


def test_the_schema_is_written_from_the_types() -> None:
    assert json.loads(output_schema.SCHEMA.read_text(encoding="utf-8")) == output_schema.schema()
    about = output_schema.schema()["$defs"].items()
    named = {(record, name) for record, each in about for name in each.get("properties", {})}
    used = {f"{record}.{name}" for record, name in named} | {name for _, name in named}
    # In the schema, the record of a whole output has the name of its command.
    for output in output_schema.OUTPUTS.values():
        for name in getattr(output, "__annotations__", ()):
            used.add(f"{output.__name__}.{name}")
    assert set(output_schema.MEANING) <= used
