"""Sentences that tell heights or times one after the other are read; what may be two balls' is refused."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from measured_bounces import EXACT

from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.heights import Heights
from hcbench.fitting.read import read_dataset, read_datasets
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

# Heights in m, that of the drop first.
HEIGHTS = [1.0, 0.81, 0.66, 0.53, 0.43]
TELLS_HEIGHTS = [
    "I dropped the ball from 1 m. It came back to 81 cm, then 66, then 53 and finally 43 cm.",
    "dropped from 1 m, it came back to 81 cm, then 66, then 53, then 43",
    "Solté la pelota desde 100 cm y subió hasta 81 cm, luego 66 cm, después 53 y por último 43 cm.",
    "La dejé caer desde 1,0 m; rebotó a 0,81 m, después a 0,66 m, luego a 0,53 m y 0,43 m.",
    "We let it go at 1.00 m; after the first bounce it rose to 0.81 m, after the second to 0.66 m, "
    "after the third to 0.53 m and after the fourth to 0.43 m.",
    "Der Ball fiel aus 1 m und sprang auf 81 cm, dann 66 cm, dann 53 cm und zuletzt 43 cm.",
    "On a lâché la bille de 1 m; elle remonte à 81 cm, puis 66 cm, puis 53 cm, puis 43 cm.",
]


@pytest.mark.parametrize("text", TELLS_HEIGHTS)
def test_heights_in_sentences_are_read_with_that_of_the_drop(tmp_path: Path, text: str) -> None:
    path = tmp_path / "note.txt"
    path.write_text(text, encoding="utf-8")
    found = read_dataset(path, EXACT)
    assert isinstance(found, Heights)
    np.testing.assert_allclose(found.heights, HEIGHTS)


def test_heights_of_a_sentence_without_a_drop_are_those_of_bounces(tmp_path: Path) -> None:
    path = tmp_path / "note.txt"
    path.write_text("It rose to 62.2 cm, then to 42.2 cm, 30.6 cm, 23.5 cm and 18.4 cm.\n")
    found = read_dataset(path, EXACT)
    assert isinstance(found, Heights)
    np.testing.assert_allclose(found.heights, [0.622, 0.422, 0.306, 0.235, 0.184])


def test_a_second_drop_in_sentences_is_another_drop(tmp_path: Path) -> None:
    path = tmp_path / "note.txt"
    path.write_text(
        "First drop from 1 m: it rose to 81 cm, 66 cm and 53 cm. "
        "Second drop from 1 m: it rose to 80 cm, 65 cm and 52 cm.\n"
    )
    first, second = read_datasets(path, EXACT)
    assert isinstance(first, Heights) and isinstance(second, Heights)
    np.testing.assert_allclose(first.heights, HEIGHTS[:4])
    np.testing.assert_allclose(second.heights, [1.0, 0.8, 0.65, 0.52])


@pytest.mark.parametrize(
    ("text", "flights"),
    [
        ("The ball hit the plate at 0.5, 1.31, 1.97, 2.51 and 2.95 s.", [0.81, 0.66, 0.54, 0.44]),
        ("The flights lasted 0.81 s, 0.66 s, 0.54 s and 0.44 s.", [0.81, 0.66, 0.54, 0.44]),
    ],
)
def test_times_in_sentences_are_read(tmp_path: Path, text: str, flights: list[float]) -> None:
    path = tmp_path / "note.txt"
    path.write_text(text)
    found = read_dataset(path, EXACT)
    assert isinstance(found, TouchTimes)
    np.testing.assert_allclose(np.diff(found.times), flights)


@pytest.mark.parametrize(
    "text",
    [
        "The red ball came back to 62 cm, the blue ball to 55 cm, then red 40 cm and blue 35 cm.",
        "The red ball rose to 62 cm, 40 cm, 26 cm; the blue one to 55 cm, 35 cm, 22 cm.",
        "The ball bounced down the stairs: it rose to 62 cm, then 40 cm, then 26 cm, then 17 cm.",
        "My plants were 62 cm, 40 cm, 26 cm high.",
        "It lost 20 cm, then 15 cm, then 10 cm with each bounce.",
        "I ran laps in 62 s, 60 s, 58 s and 57 s.",
        "It rose to 81 cm, then 66.",
        "It bounced to 81 cm, then up to 90 cm, then 66 cm and 53 cm.",
    ],
)
def test_sentences_that_tell_something_else_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "note.txt"
    path.write_text(text)
    with pytest.raises(UserError):
        read_datasets(path, EXACT)
