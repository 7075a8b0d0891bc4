"""Energy in random scenes under PyBullet's plug-in: 30 of a design here,
2000 under `make test-plugins`.

The long run writes its table into docs/reference/plugins.md; the
short one holds what the page says.
"""

from __future__ import annotations

import os
import re

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="no PyBullet for this Python")

from bullet_random import FACTORS, World, allowed, classes, design, simulate
from covering import fewest
from gain_tables import Gains, on_the_page

from hcbench.contact import pybullet as contact

LONG = "HCBENCH_PLUGINS" in os.environ  # make test-plugins
COUNT, SECONDS = 2000 if LONG else 30, 0.6
TABLE = "random in PyBullet"
NAMED = (  # what the plug-in says of a body, and to do
    r"body \d+ turns by [\d.e+]+ rad in a step of [\d.e-]+ s, too far for Bullet's joints and"
    r" constraints: take [\d.e-]+ s",
    r"body \d+ turns by [\d.e+]+ rad/s, and Bullet cuts the rates of joints at 100 rad/s: set a larger"
    r" maxJointVelocity by changeDynamics",
    r"a motor of body \d+ changes e of an impact by -?[\d.]+ within the step: take a smaller force, or a"
    r" shorter step",
    r"bodies \d+ and \d+ meet [\d.e+]+ mm deep, as Bullet sees their shapes only once they overlap: take a"
    r" step of [\d.e-]+ s",
    r"bodies \d+ and \d+ sink into each other, now by [\d.e+]+ mm, as Bullet's solver stops after \d+"
    r" iterations: set numSolverIterations=200, more numSubSteps, or a shorter step",
)


def test_each_pair_of_levels_comes_at_least_20_times() -> None:
    assert fewest(design(2000), FACTORS, allowed) >= 20


def test_contact_gains_no_more_than_the_page_says_of_each_class() -> None:
    rows = design(COUNT)
    found = Gains.empty(COUNT)
    said: set[str] = set()
    for i, row in enumerate(rows):
        seen = simulate(row, i, SECONDS)
        if seen is None:
            continue
        found.gain[i], found.named[i] = seen.gain, bool(seen.named)
        said |= {seen.named} - {""}
        if LONG or not np.isfinite(seen.gain):
            native = simulate(row, i, SECONDS, native=True)
            assert native is not None
            found.deeper[i] = max(0.0, seen.depth - native.depth)
            found.diverged[i] = np.isfinite(native.depth) and not np.isfinite(seen.gain)
    if LONG:
        found.write(TABLE, classes(rows))
    found.require_no_more_than(TABLE, classes(rows))
    for words in said:
        assert re.fullmatch(rf"restitution, law \d+: ({'|'.join(NAMED)})", words)


def test_the_page_has_a_row_for_each_class() -> None:
    assert list(on_the_page(TABLE)) == list(classes([]))


@pytest.mark.parametrize("seed", [1607, 1628])
def test_a_body_that_lands_deeper_than_the_one_that_it_is_held_to_is_named(seed: int) -> None:
    """On native contact that one stays down, and the pair turns slower."""
    seen = simulate(design(2000)[seed], seed, SECONDS)
    assert seen is not None
    assert re.search(r"bodies 0 and 2 meet [\d.]+ mm deep", seen.named)


def test_slides_that_touch_across_their_axes_do_not_push_each_other() -> None:
    """A scene in which their normal meets the axes at a right angle, but for rounding."""
    world = World(design(2000)[1404], 1404, "plug-in")
    assert (world.row["joint"], world.row["law"]) == ("slide", "force")
    forces = []
    for _ in range(200):
        world.step()
        forces += [contact.force(law, client=world.client) for law in range(3)]
    world.close()
    assert 0 < max(forces) < 1000
