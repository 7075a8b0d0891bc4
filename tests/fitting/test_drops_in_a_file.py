"""Several drops in one file: each is read, whatever parts them, or none, where they may be of two balls."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from measured_bounces import EXACT

from hcbench.fitting.heights import Heights
from hcbench.fitting.read import read_datasets
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

DROPS = ([81.0, 66.1, 53.4, 43.2, 35.3], [80.2, 65.0, 52.9, 42.8], [79.9, 64.8, 52.1, 42.5, 34.2])


def records(heights: Iterable[float]) -> list[dict[str, float]]:
    return [{"bounce": i, "height_cm": height} for i, height in enumerate(heights, 1)]


def lines(heights: Iterable[float], before: str = "") -> str:
    return "".join(f"{before}{i},{height}\n" for i, height in enumerate(heights, 1))


IN_JSON = {
    "columns of each run": {"unit": "cm", "runs": [{"heights": one} for one in DROPS]},
    "records of each trial": {
        "by": "Ana",
        "trials": [{"trial": k, "bounces": records(one)} for k, one in enumerate(DROPS)],
    },
    "records under names of drops": {f"drop{k}": records(one) for k, one in enumerate(DROPS)},
    "columns under names of drops": {f"drop{k}": {"heights_cm": x} for k, x in enumerate(DROPS)},
    "drops under the quantity": {"heights_cm": {f"drop {k}": one for k, one in enumerate(DROPS)}},
    "lists of lists": {"heights_cm": DROPS},
    "a list of drops": [{"drop": k, "heights_cm": one} for k, one in enumerate(DROPS)],
    "values of a quantity": {
        "quantity": "rebound height",
        "unit": "cm",
        "drops": [{"values": one} for one in DROPS],
    },
    "a column of drops": [{"drop": k, **row} for k, one in enumerate(DROPS) for row in records(one)],
}  # fmt: skip
IN_TEXT = {
    "lists under a heading": "# rebound heights in cm\n"
    + "".join(f"drop{k} = {one}\n" for k, one in enumerate(DROPS)),
    "one name again": "".join(f"heights_cm = {one}\nplot(heights_cm)\n" for one in DROPS),
    "YAML": "runs:\n" + "".join(
        f"- id: {k}\n  heights_cm:\n" + "".join(f"    - {height}\n" for height in one)
        for k, one in enumerate(DROPS)
    ),
    "bounces counted anew": "bounce,height (cm)\n" + "".join(map(lines, DROPS)),
    "nothing between": "height (cm)\n" + "".join(f"{height}\n" for one in DROPS for height in one),
    "a merged cell": "drop,bounce,height (cm)\n" + "".join(
        f"{k},{lines(one, ',')[1:]}" for k, one in enumerate(DROPS)
    ),
    "words that count": "attempt,bounce,height (cm)\n" + "".join(
        lines(one, f"{nth},") for nth, one in zip(("first", "second", "third"), DROPS, strict=True)
    ),
    "a column of rebounds": "drop,rebound height [cm]\n" + "".join(
        f"{k},{height}\n" for k, one in enumerate(DROPS) for height in one
    ),
}  # fmt: skip


def heights_in(path: Path) -> list[np.ndarray]:
    found = read_datasets(path, EXACT)
    assert all(isinstance(one, Heights) for one in found)
    return [one.heights for one in found if isinstance(one, Heights)]


def are_all_read(found: list[np.ndarray]) -> None:
    assert len(found) == len(DROPS)
    for heights, given in zip(found, DROPS, strict=True):
        np.testing.assert_allclose(heights, 0.01 * np.array(given))


@pytest.mark.parametrize("content", IN_JSON.values(), ids=IN_JSON)
def test_all_drops_of_a_json_are_read(tmp_path: Path, content: Any) -> None:
    path = tmp_path / "drops.json"
    path.write_text(json.dumps(content))
    are_all_read(heights_in(path))


@pytest.mark.parametrize("text", IN_TEXT.values(), ids=IN_TEXT)
def test_all_drops_of_a_text_are_read(tmp_path: Path, text: str) -> None:
    path = tmp_path / "drops.txt"
    path.write_text(text)
    are_all_read(heights_in(path))


@pytest.mark.parametrize(
    "text",
    [
        json.dumps({"steel": {"heights_cm": DROPS[0]}, "rubber": {"heights_cm": DROPS[1]}}),
        f"# rebound heights in cm\nsteel = {DROPS[0]}\nrubber = {DROPS[1]}\n",
    ],
    ids=["JSON", "lists"],
)
def test_two_balls_are_no_drops_of_one(tmp_path: Path, text: str) -> None:
    path = tmp_path / "balls.json"
    path.write_text(text)
    with pytest.raises(UserError):
        read_datasets(path, EXACT)


def test_a_drop_that_cannot_be_read_refuses_the_file_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "drops.json"
    path.write_text(
        json.dumps({"runs": [{"heights_cm": one} for one in (*DROPS, [10, 20, 30, 40])]})
    )
    with pytest.raises(UserError, match=r"drops\.json, runs 4"):
        read_datasets(path, EXACT)
