"""Energy in random scenes under MuJoCo's plug-ins: 200 of a design here, 2000 under `make test-plugins`.

The long run writes its table into docs/reference/plugins.md; the short one holds what the page says.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np
import pytest
from covering import fewest
from random_scenes import FACTORS, allowed, classes, design, energy, make, simulate, starts_compressed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hcbench.terms.impact import Floats

    Flags = NDArray[np.bool_]

pytestmark = pytest.mark.filterwarnings("ignore::hcbench.contact.mujoco.ContactAccuracyWarning")

LONG = "HCBENCH_PLUGINS" in os.environ  # make test-plugins
COUNT, SECONDS = (2000, 0.6) if LONG else (200, 0.3)
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
    gains, deeper = np.full(COUNT, np.nan), np.full(COUNT, np.nan)
    named, diverged = np.zeros(COUNT, dtype=bool), np.zeros(COUNT, dtype=bool)
    for i, row in enumerate(rows):
        made = make(row, i)
        if starts_compressed(made):
            continue
        seen = simulate(made, SECONDS)
        gains[i], named[i] = seen.gain, seen.named
        if LONG or not np.isfinite(seen.gain):
            native = simulate(made, SECONDS, native=True)
            deeper[i] = max(0.0, seen.depth - native.depth)
            diverged[i] = np.isfinite(native.depth) and not np.isfinite(seen.gain)
    if LONG:
        _write(gains, deeper, named, diverged)
    assert not (diverged & ~named).any()
    said = on_the_page()
    for name, chosen in classes(rows).items():
        quiet = [i for i in chosen if not named[i]]
        assert np.nanmax(gains[quiet], initial=0.0) <= float(said[name][4]) / 100, name
    assert np.nanmax(gains, initial=0.0) <= float(said["all"][7]) / 100
    assert diverged.sum() <= int(said["all"][8])


def _write(gains: Floats, deeper: Floats, named: Flags, diverged: Flags) -> None:
    lines = [
        "| class | scenes | median, % | 90 %, % | 99 %, % | largest, % | deeper, mm |"
        " named | largest of these, % | NaN |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, chosen in classes(design(len(gains))).items():
        seen = np.isfinite(gains) & np.isin(np.arange(len(gains)), chosen)
        quiet, loud = gains[seen & ~named], gains[seen & named]
        cells = [percent(x) for x in np.quantile(quiet, [0.5, 0.9, 0.99, 1.0])]
        depth = np.quantile(deeper[seen & ~named], 0.99) * 1e3
        worst = percent(np.max(loud, initial=0.0)) if len(loud) else ""
        lost = diverged[chosen].sum()
        row = [name, len(quiet), *cells, f"{depth:.1f}", named[chosen].sum(), worst, lost]
        lines.append(f"| {' | '.join(map(str, row))} |")
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    table = "".join(f"{line}\n" for line in lines)
    PAGE.write_text(f"{head}{BEGIN}{table}{END}{rest.partition(END)[2]}", encoding="utf-8")


@pytest.mark.parametrize("seed", [169, 624, 819, 1386, 1403, 1802, 1993])
def test_bodies_that_an_impact_would_let_turn_too_far_are_named_and_do_not_diverge(seed: int) -> None:
    """Coarse steps and e near 1: MuJoCo's own step gains energy without end once such a chain spins."""
    made = make(design(2000)[seed], seed)
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        data = mujoco.MjData(made.model)
        data.qvel[:], data.ctrl[:] = made.start, 0.3
        first = energy(made.native, data)
        for _ in range(round(SECONDS / made.model.opt.timestep)):
            mujoco.mj_step(made.model, data)
    finally:
        mujoco.set_mju_user_warning(None)
    assert not any("unstable" in words for words in warned)
    assert sum("MuJoCo's own contact, as after the impact it would turn" in words for words in warned) == 1
    alone = mujoco.MjData(made.native)
    alone.qpos[:], alone.qvel[:], alone.ctrl[:] = data.qpos, data.qvel, 0.3
    assert energy(made.native, alone) < 1.2 * first


def test_the_page_has_a_row_for_each_class() -> None:
    assert list(on_the_page()) == list(classes([]))
