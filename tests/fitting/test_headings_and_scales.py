"""Headings over several columns, units with a power of ten or on a parent, rates in words, documents."""

from __future__ import annotations

import io
import json
import zipfile
from typing import TYPE_CHECKING

import numpy as np
import pytest

from hcbench.fitting.column_names import split_header
from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.heights import Heights, SpeedPairs
from hcbench.fitting.read import read_datasets
from hcbench.fitting.setup import MeasurementSetup
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

    from hcbench.fitting.datasets import Dataset

TRIALS = ((61.0, 60.2, 61.1), (39.1, 38.2, 39.0), (25.5, 25.0, 25.6), (17.0, 16.5, 17.2))
ROWS = "".join(f"{i},{','.join(map(str, row))}\n" for i, row in enumerate(TRIALS, 1))
ONSETS = (35089, 44263, 51140, 56651, 61273, 65232, 68702)


def read(path: Path, content: str | bytes) -> list[Dataset]:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_datasets(path, MeasurementSetup())


@pytest.mark.parametrize(
    "header",
    [
        *("h / 10^-2 m", "h [10⁻² m]", "h / (10^-2 m)", "h/1e-2 m", "h (E-2 m)", "h (x0.01 m)"),
        *("h / 10 mm", "h in 0.01 m", "h (1/100 m)", "h [cm]"),
    ],
)
def test_a_power_of_ten_times_a_unit_is_a_unit(header: str) -> None:
    assert split_header(header) == ("h", "cm")


@pytest.mark.parametrize(
    "header", ["h (10 mm)", "h_10 mm", "h·10^2 [m]", "h (m x 10^-2)", "h/10 (m)"]
)
def test_a_number_that_may_be_a_condition_or_a_computation_is_no_unit(header: str) -> None:
    assert split_header(header) != ("h", "cm")


@pytest.mark.parametrize(
    "header",
    [
        "bounce,Height (cm),,\n,Trial 1,Trial 2,Trial 3",
        ",Höhe in cm,,\nSprung,Versuch 1,Versuch 2,Versuch 3",
        ",Rebound height (cm),,\nBounce,Trial 1,Trial 2,Trial 3",
        "Rebound height (cm),,,\nBounce,Trial 1,Trial 2,Trial 3",
        "Height (cm)\nBounce,Trial 1,Trial 2,Trial 3",
        # As the refusal of "Trial 1" advises.
        'Bounce,"rebound height, trial 1 [cm]","rebound height, trial 2 [cm]",'
        '"rebound height, trial 3 [cm]"',
    ],
)
def test_a_heading_over_trials_names_them_all(tmp_path: Path, header: str) -> None:
    found = read(tmp_path / "h.csv", f"{header}\n{ROWS}")
    for data, heights in zip(found, np.transpose(TRIALS), strict=True):
        assert isinstance(data, Heights)
        np.testing.assert_allclose(data.heights, 0.01 * heights)


def test_trials_of_rebounds_from_one_height_are_pairs_and_their_mean_is_none(
    tmp_path: Path,
) -> None:
    header = "Drop height (cm),Rebound height (cm),,,\n,Trial 1,Trial 2,Trial 3,Mean\n"
    rows = "100,61.0,60.2,61.1,60.8\n80,50.1,50.2,49.0,49.8\n60,38.5,39.0,39.6,39.0\n"
    (data,) = read(tmp_path / "h.csv", header + rows)
    assert isinstance(data, SpeedPairs) and len(data.speed) == 9


@pytest.mark.parametrize("names", ["height (cm),Run 1,Run 2", "v trial 1 (m/s),v trial 2 (m/s)"])
def test_runs_beside_what_may_be_the_drop_are_refused(tmp_path: Path, names: str) -> None:
    rows = "".join(f"{h},{0.61 * h},{0.6 * h}\n" for h in (100, 80, 60, 40))
    with pytest.raises(UserError, match=r"a column 'run 1'.*rebound height, trial 1|speed"):
        read(tmp_path / "h.csv", f"{names}\n{rows}")


@pytest.mark.parametrize(
    "text",
    [
        '<runs unit="cm/s"><run><vor>310</vor><nach>250</nach></run>\n'
        "<run><vor>250</vor><nach>205</nach></run>\n<run><vor>205</vor><nach>170</nach></run></runs>",
        "units: cm/s\nimpacts:\n  - before: 310\n    after: 250\n  - before: 250\n    after: 205\n"
        "  - before: 205\n    after: 170\n",
    ],
)
def test_a_unit_above_speeds_makes_them_so(tmp_path: Path, text: str) -> None:
    (data,) = read(tmp_path / "v.txt", text)
    assert isinstance(data, SpeedPairs)
    np.testing.assert_allclose(data.speed, [3.1, 2.5, 2.05])


def test_the_number_of_a_bounce_may_be_in_its_tag(tmp_path: Path) -> None:
    tags = "".join(f'<h n="{i}">{row[0]}</h>' for i, row in enumerate(TRIALS, 1))
    (data,) = read(tmp_path / "h.xml", f'<data><heights unit="cm">{tags}</heights></data>')
    assert isinstance(data, Heights)
    np.testing.assert_allclose(data.heights, [0.61, 0.391, 0.255, 0.17])


@pytest.mark.parametrize(
    "text",
    [
        f"Recorded at 48 kHz.\nsample index of impacts: {', '.join(map(str, ONSETS))}\n",
        "impact,sample @ 48 kHz\n" + "".join(f"{i},{n}\n" for i, n in enumerate(ONSETS)),
        json.dumps({"sample_rate_hz": 48000, "onset_samples": ONSETS}),
        json.dumps({"nbformat": 4, "metadata": {}, "cells": [
            {"cell_type": "markdown", "source": ["Recorded at **48 kHz**"]},
            {"cell_type": "code", "source": "print(onsets)  # sample index of each impact",
             "outputs": [{"text": [str(list(ONSETS)).replace(",", "") + "\n"]}]}]}),
    ],
    ids=["text", "header", "JSON", "notebook"],
)  # fmt: skip
def test_samples_are_times_by_their_rate(tmp_path: Path, text: str) -> None:
    (data,) = read(tmp_path / "onsets.txt", text)
    assert isinstance(data, TouchTimes)
    np.testing.assert_allclose(np.diff(data.times), np.diff(ONSETS) / 48e3)


def test_a_table_in_a_document_of_word_is_read(tmp_path: Path) -> None:
    def cells(*texts: object) -> str:
        return "".join(f"<w:tc><w:p><w:t>{text}</w:t></w:p></w:tc>" for text in texts)

    rows = [("Bounce", "Height (cm)"), *((i, row[0]) for i, row in enumerate(TRIALS, 1))]
    table = "".join(f"<w:tr>{cells(*row)}</w:tr>" for row in rows)
    kept = io.BytesIO()
    with zipfile.ZipFile(kept, "w") as archive:
        before = "<w:p><w:t>Gravity: 1.62 m/s²</w:t></w:p>"
        archive.writestr("word/document.xml", f"<w:body>{before}<w:tbl>{table}</w:tbl></w:body>")
    with pytest.raises(UserError, match=r"1\.62 m/s\^2"):
        read(tmp_path / "report.docx", kept.getvalue())
    with zipfile.ZipFile(kept, "w") as archive:
        archive.writestr("word/document.xml", f"<w:body><w:tbl>{table}</w:tbl></w:body>")
    (data,) = read(tmp_path / "report.docx", kept.getvalue())
    assert isinstance(data, Heights) and len(data.heights) == 4


@pytest.mark.parametrize("title", ["Rebound heights (cm)", "Höhe nach jedem Sprung in cm:"])
@pytest.mark.parametrize("sign", [")", ":", "."])
def test_a_title_over_a_numbered_list_names_it(tmp_path: Path, title: str, sign: str) -> None:
    rows = "".join(f" {i}{sign} {row[0]}\n" for i, row in enumerate(TRIALS, 1))
    (data,) = read(tmp_path / "h.txt", f"{title}\n{rows}")
    assert isinstance(data, Heights)
    np.testing.assert_allclose(data.heights, [0.61, 0.391, 0.255, 0.17])


def test_pixels_are_no_lengths(tmp_path: Path) -> None:
    rows = "".join(f"{i},{500 - 3 * i}\n" for i in range(20))
    with pytest.raises(UserError, match="412 px = 1 m"):
        read(tmp_path / "film.csv", f"# fps: 240\nframe,y_px\n{rows}")


def test_trials_side_by_side_share_the_numbers_of_their_bounces(tmp_path: Path) -> None:
    aloft = [0.61, 0.5, 0.42, 0.36]
    rows = "".join(f"{i},{t},,{t + 0.001}\n" for i, t in enumerate(aloft, 1))
    found = read(tmp_path / "t.csv", f"n,flight time (s),,flight time (s)\n{rows}")
    assert len(found) == 2


def test_a_list_in_a_line_and_a_chat_with_the_day_last_are_read(tmp_path: Path) -> None:
    listed = " ; ".join(f"{row[0]:.1f}".replace(".", ",") for row in TRIALS)
    chat = "".join(
        f"[14:{10 + i}, 03/05/2024] Bia: bounce {i}: {row[0]} cm\n"
        for i, row in enumerate(TRIALS, 1)
    )
    for text in (f"TP n°3\nHauteurs successives des rebonds (cm) : {listed}\n", chat):
        (data,) = read(tmp_path / "h.txt", text)
        assert isinstance(data, Heights)
        np.testing.assert_allclose(data.heights, [0.61, 0.391, 0.255, 0.17])
