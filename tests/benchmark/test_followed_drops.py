"""Bounces read off a followed drop: when each contact begins and ends,
and how high the body goes then.
"""

from __future__ import annotations

import numpy as np
import pytest

from hcbench.benchmark.bounce_sequence import Bounce, bounces, rest
from hcbench.terms.impact import Trajectory

G, STEP = 10.0, 0.01  # m/s², s


def flights(*speeds: float) -> tuple[Trajectory, list[Bounce]]:
    """A body that leaves the plate at these speeds, m/s, touching it for
    one step before each; exact arcs.

    No flight lasts whole steps, so no sample is at the top.
    """
    time, height, rate, acts, expected = [0.0], [0.0], [-3.0], [True], []
    for speed in speeds:
        aloft = np.arange(STEP, 2.0 * speed / G, STEP)
        time += [*(time[-1] + aloft), time[-1] + aloft[-1] + STEP]
        height += [*(speed * aloft - 0.5 * G * aloft**2), 0.0]
        rate += [*(G * aloft - speed), speed]
        acts += [False] * len(aloft) + [True]
        begins = time[-1] - STEP * (len(aloft) + 1)
        expected.append(Bounce(begins, begins + STEP, speed**2 / (2.0 * G)))
    columns = np.array(time), -np.array(height), np.array(rate), np.array(acts, dtype=float)
    return Trajectory(*columns), expected


def test_a_body_rises_to_the_top_of_its_arc_between_two_samples() -> None:
    """v²/2g, where the highest sample of an arc is lower: by 0.5 g of the
    square of its distance in time.
    """
    path, expected = flights(1.037, 0.741, 0.523, 0.3)
    found = bounces(path, 3)
    assert [bounce.height for bounce in found] == pytest.approx(
        [b.height for b in expected[:3]], rel=1e-9
    )
    assert [bounce.touch for bounce in found] == pytest.approx([b.touch for b in expected[:3]])
    assert [bounce.parting for bounce in found] == pytest.approx([b.parting for b in expected[:3]])
    assert max(-path.penetration) < expected[0].height * (1.0 - 1e-5)


def test_a_body_at_rest_is_read_in_the_last_second() -> None:
    time = np.arange(301.0) * STEP
    depth = np.where(time < 1.995, 0.4, 1e-4 + 2e-5 * np.sin(40.0 * time))
    path = Trajectory(time, depth, np.zeros_like(time), np.ones_like(time))
    assert rest(path).depth == pytest.approx(1e-4, rel=0.02)
    assert rest(path).motion == pytest.approx(4e-5, rel=0.01)
