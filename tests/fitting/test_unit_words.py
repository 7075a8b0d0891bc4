"""Words for units and quantities in the languages of the world."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from hcbench.fitting.column_names import plain_unit, role_of, split_header

babel = pytest.importorskip("babel")

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs"))

import unit_words  # type: ignore[import-not-found]  # noqa: E402


def test_the_file_has_the_words_of_cldr() -> None:
    text = unit_words.PATH.read_text("utf-8")
    if f"Babel {babel.__version__};" not in text:
        pytest.skip(
            "another Babel wrote the file: it has other words, in another form from 2.19 on"
        )
    assert text == unit_words.text()


@pytest.mark.parametrize(
    ("word", "unit"),
    [("सेमी", "cm"), ("ثانية", "s"), ("ซม.", "cm"), ("giây", "s"), ("წამი", "s"), ("мс", "ms")],
)
def test_units_have_words_in_many_languages(word: str, unit: str) -> None:
    assert plain_unit(word) == unit


@pytest.mark.parametrize("word", ["stop", "saat", "d", "δ", "cole", "time"])
def test_words_that_mean_other_things_too_are_no_units(word: str) -> None:
    assert plain_unit(word) == word


@pytest.mark.parametrize(
    ("header", "role"),
    [
        ("ارتفاع السقوط (سم)", "height_in"),
        ("זמן פגיעה (שניות)", "time"),
        ("زمان برخورد (ثانیه)", "time"),
        ("गिरने की ऊँचाई (सेमी)", "height_in"),
        ("ความเร็วก่อนชน (m/s)", "speed_in"),
        ("vận tốc sau va chạm (m/s)", "speed_out"),
        ("სიმაღლე (სმ)", "height"),
        ("Vreme leta (s)", "interval"),
        ("Altura de retorno (cm)", "height_out"),
        ("Zeit zwischen Aufprallen (s)", "interval"),
        ("tiempo entre botes (s)", "interval"),
        ("duration (s)", "interval"),
        ("kõrgus (cm)", "height"),
        ("bounce duration (ms)", "interval"),
        ("duration of touch (ms)", ""),
        ("bat speed (m/s)", ""),
        ("stop [s]", ""),
    ],
)
def test_names_of_columns_are_known_in_many_languages(header: str, role: str) -> None:
    assert role_of(*split_header(header)) == role
