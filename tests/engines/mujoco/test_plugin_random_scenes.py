"""Energy in random scenes under MuJoCo's plug-ins: 100 of a design here,
2000 under `make test-plugins`.

The long run writes its table into docs/reference/plugins.md; the
short one holds what the page says.
"""

from __future__ import annotations

import os
import re

import mujoco
import numpy as np
import pytest
from covering import fewest
from gain_tables import Gains, on_the_page
from random_scenes import (
    DEEPER,
    FACTORS,
    allowed,
    classes,
    deeper,
    design,
    energy,
    make,
    simulate,
    starts_compressed,
)

pytestmark = pytest.mark.filterwarnings("ignore::hcbench.contact.mujoco.ContactAccuracyWarning")

LONG = "HCBENCH_PLUGINS" in os.environ  # make test-plugins
COUNT, SECONDS = (2000, 0.6) if LONG else (100, 0.25)
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
            found.deeper[i] = deeper(made, seen, native)
            assert seen.named or seen.names_depth or not found.deeper[i] > DEEPER, i
            found.diverged[i] = np.isfinite(native.depth) and not np.isfinite(seen.gain)
    if LONG:
        found.write(TABLE, classes(rows))
    found.require_no_more_than(TABLE, classes(rows))


@pytest.mark.parametrize("seed", [238, 1055])
def test_what_bounces_comes_faster_and_goes_no_deeper_than_on_native_contact_at_that_speed(
    seed: int,
) -> None:
    """With e = 1 a body is thrown down by another that it meets on its way up; native contact lets
    neither bounce.
    """
    made = make(design(2000)[seed], seed)
    seen, native = simulate(made, 0.3), simulate(made, 0.3, native=True)
    assert seen.depth > native.depth + DEEPER
    assert deeper(made, seen, native) < 1e-6


@pytest.mark.parametrize(("seed", "depth"), [(186, 171), (367, 74), (1191, 76)])
def test_a_body_that_starts_inside_another_is_named(seed: int, depth: int) -> None:
    made = make(design(2000)[seed], seed)
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        data = mujoco.MjData(made.model)
        data.qvel[:] = made.start
        for _ in range(2):
            mujoco.mj_step(made.model, data)
    finally:
        mujoco.set_mju_user_warning(None)
    (said,) = (one for one in warned if "inside" in one)
    seen = re.search(r'body "b0" starts ([\d.]+) mm inside body "world"', said)
    assert seen
    assert float(seen[1]) == pytest.approx(depth, abs=1)


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
