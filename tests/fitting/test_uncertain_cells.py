"""Numbers with an uncertainty, in every way that people write the two, have their meaning or none."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest
from measured_bounces import EXACT

from hcbench.fitting.cells import NumberStyle
from hcbench.fitting.heights import Heights
from hcbench.fitting.read import read_dataset
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

SIGNS = ("±", "+-", "+/-", "\\pm", " ± ", " +/- ")
# (text, value) of numbers in the style with points; in the other, points and commas change places.
VALUES = [("81", 81.0), ("0.81", 0.81), ("1,960", 1960.0), ("1,960.5", 1960.5), ("81e-2", 0.81)]
BY = [("2", 2.0), ("0.02", 0.02), ("2e-3", 0.002)]
# (unit of the value, unit of the uncertainty, the second in the first).
UNITS = [
    ("", "", 1.0),
    ("cm", "", 1.0),
    ("cm", "cm", 1.0),
    ("cm", "mm", 0.1),
    ("mm", "m", 1000.0),
    ("ms", "s", 1000.0),
    ("m/s", "cm/s", 0.01),
    ("%", "%", 1.0),
]
STYLES = (".", ",")


def in_style(text: str, decimal: str) -> str:
    return text if decimal == "." else text.translate(str.maketrans(".,", ",."))


def is_read_as(text: str, decimal: str, value: float, by: float, unit: str) -> bool:
    cell = NumberStyle(decimal).read(in_style(text, decimal))
    numbers = (cell.value, cell.uncertainty) if cell else (np.nan, np.nan)
    return np.allclose(numbers, (value, by), rtol=1e-9) and cell is not None and cell.unit == unit


@pytest.mark.parametrize("decimal", STYLES)
def test_an_uncertainty_is_in_the_unit_that_it_is_written_in(decimal: str) -> None:
    written = itertools.product(VALUES, SIGNS, BY, UNITS)
    wrong = []
    for (number, value), sign, (number_of_by, by), (unit, unit_of_by, ratio) in written:
        text = f"{number} {unit}".strip() + sign + f"{number_of_by} {unit_of_by}".strip()
        if not is_read_as(text, decimal, value, by * ratio, unit):
            wrong.append(text)
    assert wrong == []


@pytest.mark.parametrize("decimal", STYLES)
def test_one_unit_or_power_behind_a_pair_holds_for_both(decimal: str) -> None:
    wrong = []
    for (number, value), sign, (number_of_by, by) in itertools.product(VALUES, SIGNS, BY):
        pair = f"{number}{sign}{number_of_by}"
        forms = (f"{pair} cm", f"({pair}) cm", f"({pair} cm)")
        wrong += [text for text in forms if not is_read_as(text, decimal, value, by, "cm")]
        for power in ("e-3", " x 10^-3", "·10^{-3}"):
            text = f"({pair}){power} m"
            # A number has one power.
            has_power = "e" in pair
            if not has_power and not is_read_as(text, decimal, 1e-3 * value, 1e-3 * by, "m"):
                wrong.append(text)
            if has_power and NumberStyle(decimal).read(in_style(text, decimal)) is not None:
                wrong.append(text)
    assert wrong == []


@pytest.mark.parametrize("decimal", STYLES)
@pytest.mark.parametrize(
    ("text", "value", "by", "unit"),
    [
        ("0.960(5)", 0.96, 0.005, ""),
        ("0.960(12) m", 0.96, 0.012, "m"),
        ("1,960(5)", 1960.0, 5.0, ""),
        ("1,960.5(5)", 1960.5, 0.5, ""),
        ("-0.960(5)", -0.96, 0.005, ""),
        ("9.60(0.05) cm", 9.6, 0.05, "cm"),
        ("81(2)", 81.0, 2.0, ""),
        ("1.23(4)e-3", 1.23e-3, 4e-5, ""),
        ("1.23(4) x 10^-3 m", 1.23e-3, 4e-5, "m"),
        ("81 cm ± 2 %", 81.0, 1.62, "cm"),
        ("-0.5 m ± 2 %", -0.5, 0.01, "m"),
        ("85 ± 2 %", 85.0, 2.0, "%"),
    ],
)
def test_digits_in_brackets_and_per_cent_are_uncertainties(
    decimal: str, text: str, value: float, by: float, unit: str
) -> None:
    assert is_read_as(text, decimal, value, by, unit)


@pytest.mark.parametrize("decimal", STYLES)
@pytest.mark.parametrize(
    "text",
    [
        *("0,960(5)", "1,23(4)", "1.23(0,04)", "1.234(5,6)", "0,81 ± 0.02", "0.81 ± 0,02"),
        *("0.2 ± 0.01 foo", "0.960(5) foo", "0.2 m ± 3 s", "5 % ± 1 cm", "81 ± -2", "1,5 m 20 cm"),
        # Per cent of the number, or of 1.
        *("0.81 ± 2 %", "0.5 ± 0.2%"),
        # Uneven, several, or of another confidence: one number does not hold them.
        *("0.20 +0.02/-0.01", "20 +2/-1", "20 -1/+2", "0.20^{+0.02}_{-0.01}", "0.20 (+2/-1)"),
        *("0.20 ± 0.01 ± 0.02", "0.5(1)(2)", "81 ± 2 (k=2)", "81 cm ± 2 cm (95%)", "1.23e-3(4)"),
    ],
)
def test_what_has_no_plain_meaning_is_no_number(decimal: str, text: str) -> None:
    assert NumberStyle(decimal).read(in_style(text, decimal)) is None


def test_a_table_has_each_uncertainty_in_its_unit(tmp_path: Path) -> None:
    path = tmp_path / "heights.csv"
    numbers = (100, 81, 66, 53, 43)
    in_mm = "height\n" + "".join(f"{number} cm ± 2 mm\n" for number in numbers)
    in_cm = in_mm.replace("2 mm", "0.2 cm")
    path.write_text(in_mm, encoding="utf-8")
    found = read_dataset(path, EXACT)
    path.write_text(in_cm, encoding="utf-8")
    assert repr(found) == repr(read_dataset(path, EXACT))


@pytest.mark.parametrize("form", ["{} ± 2 mm", "{}+-2 mm", "{} ± 2 %"])
def test_a_unit_behind_the_uncertainty_alone_is_that_of_the_header(
    tmp_path: Path, form: str
) -> None:
    path = tmp_path / "heights.csv"
    rows = "\n".join(form.format(number) for number in (100, 81, 66, 53, 43))
    path.write_text(f"height [cm]\n{rows}\n", encoding="utf-8")
    with pytest.raises(UserError, match="under 'height'"):
        read_dataset(path, EXACT)
    path.write_text(f"height [cm]\n{rows}\n".replace("2 mm", "2 cm"), encoding="utf-8")
    if "%" not in form:
        found = read_dataset(path, EXACT)
        assert isinstance(found, Heights)
        assert found.uncertainty == pytest.approx(0.02)


@pytest.mark.parametrize(
    "end", ["53 ± 1 cm.", "53 cm (± 1 cm).", "53 cm +/- 1 cm.", "53 \\pm 1 cm.", "53 +- 1 cm."]
)
def test_an_uncertainty_in_a_sentence_is_no_height(tmp_path: Path, end: str) -> None:
    path = tmp_path / "note.txt"
    path.write_text(f"I dropped it from 1 m. It came back to 81, 66 and {end}", encoding="utf-8")
    try:
        found = read_dataset(path, EXACT)
    except UserError:
        return
    assert isinstance(found, Heights)
    np.testing.assert_allclose(found.heights, [1.0, 0.81, 0.66, 0.53])
