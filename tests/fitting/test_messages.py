"""Bounces told one a line, by people in a chat or by a stopwatch, are read, or refused whole."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from measured_bounces import EXACT

from hcbench.cli import run
from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.heights import Heights
from hcbench.fitting.read import read_dataset, read_datasets
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

# Heights of the drop and of four bounces, m.
HEIGHTS = [1.0, 0.63, 0.4, 0.25, 0.17]
CHATS = [
    "[14:02] Tom: ok dropped the rubber ball from 1 m\n[14:02] Tom: first bounce came up to 63 cm\n"
    "[14:03] Ana: second 40 cm\n[14:03] Tom: third 25 cm\n[14:03] Ana: 4th 17 cm, then it rolled\n",
    "12.05.26, 14:02 - Tom: Ball aus 1 m fallen lassen\n"
    "12.05.26, 14:02 - Tom: nach dem 1. Aufprall 63,0 cm\n12.05.26, 14:03 - Ana: nach dem 2. 40 cm\n"
    "12.05.26, 14:03 - Tom: nach dem dritten 25 cm\n12.05.26, 14:04 - Ana: nach dem 4. 17 cm\n",
    "[5/12/26, 2:02:11 PM] +49 171: we\n[5/12/26, 2:02:31 PM] Jo: let go at 1 m\n"
    "[5/12/26, 2:03:11 PM] Jo: 1st bounce 63 cm\n[5/12/26, 2:03:31 PM] Li: 2nd 40\n"
    "[5/12/26, 2:03:51 PM] Jo: 3rd 25\n[5/12/26, 2:04:11 PM] Li: 4th 17\n",
    "14:02 Luc: bille lâchée de 1 m\n14:02 Luc: premier rebond 63,0 cm\n14:03 Zoé: deuxième 40 cm\n"
    "14:03 Luc: 3e 25 cm\n14:03 Zoé: quatrième 17 cm\n",
    "Tom, [12.05.26 14:02]\nsoltada desde 1 m\nEva, [12.05.26 14:02]\nprimer rebote 63 cm\n"
    "Tom, [12.05.26 14:03]\nsegundo 40 cm\nel tercero 25 cm\ncuarto 17 cm\n",
]
LAPS = [1.02, 0.76, 0.66, 0.57, 0.5, 0.43]


def _file(folder: Path, text: str) -> Path:
    path = folder / "note.txt"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("text", CHATS)
@pytest.mark.parametrize("kind", [None, "heights"])
def test_bounces_that_people_count_on_in_a_chat_are_read_all(
    tmp_path: Path, text: str, kind: str | None
) -> None:
    found = read_dataset(_file(tmp_path, text), EXACT, kind)
    assert isinstance(found, Heights)
    np.testing.assert_allclose(found.heights, HEIGHTS)


def test_a_ball_that_rolls_off_does_so_after_the_last_bounce_told(tmp_path: Path) -> None:
    told = ["first bounce 63 cm", "second 40 cm", "third 25 cm, then it rolled off", "4th 17 cm"]
    assert len(read_datasets(_file(tmp_path, "\n".join(told[:3])), EXACT)) == 1
    with pytest.raises(UserError, match="rolled off"):
        read_datasets(_file(tmp_path, "\n".join(told)), EXACT)


def test_laps_of_a_runner_are_no_flights(tmp_path: Path) -> None:
    laps = "Lap 1  01:02.31\nLap 2  01:01.20\nLap 3  00:58.90\nLap 4  00:09.10\n"
    with pytest.raises(UserError):
        read_datasets(_file(tmp_path, laps), EXACT)


def test_names_before_bounces_need_no_time(tmp_path: Path) -> None:
    text = "Tom: first bounce 63 cm\nAna: second 40 cm\nTom: third 25 cm\nAna: 4th 17 cm\n"
    found = read_dataset(_file(tmp_path, text), EXACT)
    assert isinstance(found, Heights)
    np.testing.assert_allclose(found.heights, HEIGHTS[1:])


@pytest.mark.parametrize(
    "text",
    [
        # No line has the second bounce.
        "[14:02] Tom: first bounce 63 cm\n[14:03] Ana: third 25 cm\n[14:03] Tom: 4th 17 cm\n",
        "[14:02] Tom: first bounce 63 cm\n[14:02] Ana: first bounce 55 cm\n"
        "[14:03] Tom: second 40 cm\n[14:03] Ana: second 33 cm\n",
        "[14:02] Tom: first bounce lost 37 cm\n[14:03] Ana: second 23 cm\n[14:03] Tom: third 15 cm\n",
        "[14:02] Tom: first plant 63 cm\n[14:03] Ana: second 40 cm\n[14:03] Tom: third 25 cm\n",
        "[14:02] Tom: first bounce 63 cm\n[14:03] Ana: blue second 40 cm\n[14:03] Tom: third 25 cm\n",
    ],
)
@pytest.mark.parametrize("kind", [None, "heights"])
def test_chats_that_do_not_tell_each_bounce_of_one_ball_are_refused(
    tmp_path: Path, text: str, kind: str | None
) -> None:
    with pytest.raises(UserError):
        read_datasets(_file(tmp_path, text), EXACT, kind)


@pytest.mark.parametrize("first", ["Aufprall eins ergab 67,1 cm", "der 1. Aufprall: ganze 67,1 cm"])
def test_a_bounce_told_another_way_than_those_below_it_is_not_left_out(
    tmp_path: Path, first: str
) -> None:
    text = f"{first}\nnach dem 2. 45,1 cm\nnach dem 3. 30,4 cm\nnach dem 4. 20,5 cm\n"
    with pytest.raises(UserError):
        read_datasets(_file(tmp_path, text), EXACT, "heights")


@pytest.mark.parametrize("text", ["Elle touche le sol à {}.", "La balle touche la table à {}"])
def test_decimal_commas_in_a_list_with_commas_are_decimals(tmp_path: Path, text: str) -> None:
    listed = "0,320 s, 0,863 s, 1,325 s, 1,716 s et 2,051 s"
    found = read_dataset(_file(tmp_path, text.format(listed)), EXACT)
    assert isinstance(found, TouchTimes)
    np.testing.assert_allclose(found.times, [0.32, 0.863, 1.325, 1.716, 2.051])


@pytest.mark.parametrize("step", [1, -1])
@pytest.mark.parametrize(
    ("head", "word", "sign"), [("Stopwatch\n", "Lap", "."), ("", "Runde", ",")]
)
def test_laps_of_a_stopwatch_are_flights(
    tmp_path: Path, step: int, head: str, word: str, sign: str
) -> None:
    lines = [f"{word} {n}  00:{lap:05.2f}".replace(".", sign) for n, lap in enumerate(LAPS, 1)]
    found = read_dataset(_file(tmp_path, head + "\n".join(lines[::step]) + "\n"), EXACT)
    assert isinstance(found, TouchTimes)
    np.testing.assert_allclose(np.diff(found.times), LAPS)


def test_two_times_in_sentences_are_too_few(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="2 heights or times in sentences, too few"):
        read_datasets(_file(tmp_path, "bounce at 0.45 s\nbounce at 1.21 s\n"), EXACT)


def test_times_of_two_balls_lead_to_no_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = (
        "0.8194 0.9546 1.2524 1.5801 1.5974 1.8444 2.0649 2.1109 2.2550 2.4223 2.5213 2.5720 2.8475"
    )
    path = _file(tmp_path, "time (s)\n" + f"{times} 3.1087 3.3169 3.4831\n".replace(" ", "\n"))
    run(["fit", str(path)])
    out = capsys.readouterr().out
    assert "e varies by" in out and "hcbench tune" not in out


def test_the_budget_of_a_constant_e_is_that_of_e(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heights = "\n".join(f"{0.64**k:.6f}" for k in range(1, 9))
    path = _file(tmp_path, f"height [m]\n{heights}\n")
    run(["fit", str(path), "--law", "constant"])
    out = capsys.readouterr().out
    assert "adds to e" in out and "α" not in out.split("where it comes from")[1].split("next")[0]
