"""Energy in random scenes under MuJoCo's plug-ins: 60 of a design here, 2000 under `make test-plugins`.

The long run writes its table into docs/reference/plugins.md; the short one holds what the page says.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from covering import fewest
from random_scenes import FACTORS, allowed, classes, design, make, simulate, starts_compressed

if TYPE_CHECKING:
    from hcbench.impact import Floats

pytestmark = pytest.mark.filterwarnings("ignore::hcbench.contact.mujoco.ContactAccuracyWarning")

LONG = "HCBENCH_PLUGINS" in os.environ  # make test-plugins
COUNT, SECONDS = (2000, 0.6) if LONG else (60, 0.3)
PAGE = Path(__file__).parents[3] / "docs" / "reference" / "plugins.md"
BEGIN, END = "<!-- begin random -->\n", "<!-- end random -->"


def on_the_page() -> dict[str, list[str]]:
    """The page's cells by class."""
    table = PAGE.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0]
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.strip().splitlines()[2:]]
    return {cells[0]: cells[1:] for cells in lines}


def percent(share: float) -> str:
    """A share in per cent, rounded up to two digits, from 0.001 % on."""
    digit = 10.0 ** (np.floor(np.log10(max(share, 1e-5))) - 1)
    return f"{100 * np.ceil(max(share, 1e-5) / digit - 1e-9) * digit:.2g}"


def test_each_pair_of_levels_comes_at_least_20_times() -> None:
    assert fewest(design(2000), FACTORS, allowed) >= 20


def test_contact_gains_no_more_than_the_page_says_of_each_class() -> None:
    rows = design(COUNT)
    gains, deeper, diverged = np.full(COUNT, np.nan), np.full(COUNT, np.nan), []
    for i, row in enumerate(rows):
        made = make(row, i)
        if starts_compressed(made):
            continue
        seen = simulate(made, SECONDS)
        gains[i] = seen.gain
        if LONG or not np.isfinite(seen.gain):
            native = simulate(made, SECONDS, native=True)
            deeper[i] = max(0.0, seen.depth - native.depth)
            if np.isfinite(native.depth) and not np.isfinite(seen.gain):
                diverged.append(i)
    if LONG:
        _write(gains, deeper, diverged)
    said = on_the_page()
    for name, chosen in classes(rows).items():
        largest = float(said[name][4]) / 100
        assert np.nanmax(gains[chosen], initial=0.0) <= largest, name
    assert len(diverged) <= int(said["all"][6])


def _write(gains: Floats, deeper: Floats, diverged: list[int]) -> None:
    lines = [
        "| class | scenes | median, % | 90 %, % | 99 %, % | largest, % | deeper, mm | NaN |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, chosen in classes(design(len(gains))).items():
        found = gains[chosen]
        found = found[np.isfinite(found)]
        cells = [percent(x) for x in np.quantile(found, [0.5, 0.9, 0.99, 1.0])]
        depth = np.nanquantile(deeper[chosen], 0.99) * 1e3
        lost = len(set(chosen) & set(diverged))
        lines.append(f"| {name} | {len(found)} | {' | '.join(cells)} | {depth:.1f} | {lost} |")
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    table = "".join(f"{line}\n" for line in lines)
    PAGE.write_text(f"{head}{BEGIN}{table}{END}{rest.partition(END)[2]}", encoding="utf-8")


def test_the_page_has_a_row_for_each_class() -> None:
    assert list(on_the_page()) == list(classes([]))
