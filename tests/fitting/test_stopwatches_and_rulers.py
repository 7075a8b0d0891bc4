"""Laps of stopwatches, time codes of films, and rulers in inches."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from measured_bounces import EXACT

from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.heights import Heights, SpeedPairs
from hcbench.fitting.read import read_dataset
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

TOTALS = [0.81, 1.47, 2.01, 2.45, 2.81]
LAPS = np.diff([0.0, *TOTALS])
INCHES = ["43 3/4", "35 1/2", "28 3/4", "23 1/4", "19"]


def laps(header: str, form: str) -> str:
    rows = zip(range(1, 6), LAPS, TOTALS, strict=True)
    return "\n".join([header, *(form.format(n, lap, total) for n, lap, total in rows)])


@pytest.mark.parametrize(
    "text",
    [
        laps("Lap,Lap time,Total", "{},00:{:05.2f},00:{:05.2f}"),
        laps("Lap;Split;Total", "{};{:.2f};{:.2f}"),
        laps("Runde,Rundenzeit,Gesamt", "{},00:{:05.2f},00:{:05.2f}"),
        laps("Vuelta,Tiempo de vuelta,Total", "{},00:{:05.2f},00:{:05.2f}"),
        "Contact\tTime code\n"
        + "".join(f"{n}\t0:00:0{int(x)}:{100 * x % 100:02.0f}\n" for n, x in enumerate(TOTALS, 1)),
    ],
    ids=["English", "split", "German", "Spanish", "Kinovea"],
)
def test_the_totals_of_laps_are_times_of_touches(tmp_path: Path, text: str) -> None:
    path = tmp_path / "laps.csv"
    path.write_text(text)
    found = read_dataset(path, EXACT)
    assert isinstance(found, TouchTimes)
    np.testing.assert_allclose(np.diff(found.times), LAPS[1:], atol=1e-9)


def test_laps_of_a_runner_are_no_bounces(tmp_path: Path) -> None:
    path = tmp_path / "laps.csv"
    path.write_text(
        "Lap,Lap time,Total\n1,01:02.31,01:02.31\n2,01:01.20,02:03.51\n"
        "3,01:00.90,03:04.41\n4,01:00.10,04:04.51\n5,00:59.80,05:04.31\n"
    )
    with pytest.raises(UserError):
        read_dataset(path, EXACT)


@pytest.mark.parametrize(
    ("header", "form", "kind"),
    [
        ("height (in)", "{1}", None),
        ("bounce   height_in", "{0}   {1}", None),
        ("n height(in)", "{0} {1}", None),
        ("", "bounce {0}: {1} in", None),
        ("bounce\trise (in)", "{0}\t{1}", "heights"),
        ("inches", "{1}", "heights"),
        ("", "{1} in", "heights"),
    ],
)
def test_a_fraction_of_an_inch_belongs_to_its_number(
    tmp_path: Path, header: str, form: str, kind: str | None
) -> None:
    path = tmp_path / "ruler.txt"
    rows = [form.format(n, inches) for n, inches in enumerate(INCHES, 1)]
    path.write_text("\n".join(filter(None, [header, *rows])) + "\n")
    found = read_dataset(path, EXACT, kind)
    assert isinstance(found, Heights)
    np.testing.assert_allclose(found.heights / 0.0254, [43.75, 35.5, 28.75, 23.25, 19.0])


def test_the_x_of_a_ball_is_no_penetration_without_a_force(tmp_path: Path) -> None:
    path = tmp_path / "film.csv"
    path.write_text("Bounce,Ball X (cm)\n1,110.1\n2,92.2\n3,71\n4,60\n")
    with pytest.raises(UserError, match="heights if 'ball x'"):
        read_dataset(path, EXACT)
    assert isinstance(read_dataset(path, EXACT, "heights"), Heights)


@pytest.mark.parametrize("name", ["energy ratio (%)", "rebound height (% of the drop)"])
def test_a_drop_height_with_the_share_that_comes_back_is_a_pair(tmp_path: Path, name: str) -> None:
    path = tmp_path / "pairs.csv"
    path.write_text(f"drop height (cm),{name}\n20,81\n40,64\n60,49\n80,36\n")
    found = read_dataset(path, EXACT)
    assert isinstance(found, SpeedPairs)
    np.testing.assert_allclose(found.restitution, [0.9, 0.8, 0.7, 0.6])
