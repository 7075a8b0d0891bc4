"""Energy in random scenes under MuJoCo's plug-ins: 60 of a design here,
2000 under `make test-plugins`.

The long run writes its table into docs/reference/plugins.md; the
short one holds what the page says.
"""

from __future__ import annotations

import os

import mujoco
import numpy as np
import pytest
from covering import fewest
from gain_tables import Gains, on_the_page
from random_scenes import (
    FACTORS,
    allowed,
    classes,
    design,
    energy,
    make,
    simulate,
    starts_compressed,
)

pytestmark = pytest.mark.filterwarnings("ignore::hcbench.contact.mujoco.ContactAccuracyWarning")

LONG = "HCBENCH_PLUGINS" in os.environ  # make test-plugins
COUNT, SECONDS = (2000, 0.6) if LONG else (60, 0.3)
TABLE = "random"


def test_each_pair_of_levels_comes_at_least_20_times() -> None:
    assert fewest(design(2000), FACTORS, allowed) >= 20


def test_contact_gains_no_more_than_the_page_says_of_each_class() -> None:
    rows = design(COUNT)
    found = Gains.empty(COUNT)
    for i, row in enumerate(rows):
        made = make(row, i)
        if starts_compressed(made):
            continue
        seen = simulate(made, SECONDS)
        found.gain[i], found.named[i] = seen.gain, seen.named
        if LONG or not np.isfinite(seen.gain):
            native = simulate(made, SECONDS, native=True)
            found.deeper[i] = max(0.0, seen.depth - native.depth)
            found.diverged[i] = np.isfinite(native.depth) and not np.isfinite(seen.gain)
    if LONG:
        found.write(TABLE, classes(rows))
    found.require_no_more_than(TABLE, classes(rows))


@pytest.mark.parametrize("seed", [169, 624, 819, 1386, 1403, 1802, 1993])
def test_bodies_that_an_impact_would_let_turn_too_far_are_named_and_do_not_diverge(
    seed: int,
) -> None:
    """Coarse steps and e near 1: MuJoCo's own step gains energy
    without end once such a chain spins.
    """
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
    assert (
        sum("MuJoCo's own contact, as after the impact it would turn" in words for words in warned)
        == 1
    )
    alone = mujoco.MjData(made.native)
    alone.qpos[:], alone.qvel[:], alone.ctrl[:] = data.qpos, data.qvel, 0.3
    assert energy(made.native, alone) < 1.2 * first


def test_the_page_has_a_row_for_each_class() -> None:
    assert list(on_the_page(TABLE)) == list(classes([]))
