"""A listener that knows when it does not know: knocks, talk, echoes, a second ball, a phone's gain."""

from __future__ import annotations

from dataclasses import replace

import noisy_rooms
import numpy as np
import pytest
from measured_bounces import EXACT

from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.fit import fit
from hcbench.fitting.listening import listen
from hcbench.fitting.recording import Recording, doubts_of


def heard(sound: np.ndarray) -> TouchTimes:
    recording = Recording("r", sound, noisy_rooms.RATE)
    trains = listen(recording, EXACT)
    best = trains[0]
    return TouchTimes("r", EXACT, best.times, best.numbers, best, recording, tuple(trains))


@pytest.mark.parametrize("floor", ["stone", "glass"])
@pytest.mark.parametrize("what", ["knock before", "several knocks", "reverberant"])
def test_a_disturbed_drop_is_heard_or_nothing_is_said(floor: str, what: str) -> None:
    rng = np.random.default_rng(3)
    one = noisy_rooms.drop(floor, "pink", 35.0, what, rng, alpha=0.2)
    found = fit([heard(one.sound)])
    if found.alpha is None:
        assert found.law is None and found.doubts
        return
    assert (
        found.alpha.low <= one.alpha <= found.alpha.high
        or abs(found.alpha.value / one.alpha - 1) < 0.05
    )


def test_a_knock_two_seconds_before_the_drop_is_no_touch() -> None:
    rng = np.random.default_rng(8)
    one = noisy_rooms.drop("tile", "pink", 35.0, None, rng, alpha=0.2)
    sound = one.sound.copy()
    at = int((one.touches[0] - 0.4) * noisy_rooms.RATE)
    if at > 0:
        knock = noisy_rooms.knock(rng)
        sound[at : at + len(knock)] += 0.9 * knock
    touches = heard(sound)
    assert np.abs(touches.times[:, None] - one.touches).min(axis=1).max() < 2e-3


def test_a_knock_that_could_nearly_be_the_first_touch_is_left_out() -> None:
    """A click before the drop, 4 % off where a touch of this ball would have been."""
    one = noisy_rooms.drop("glass", "pink", 35.0, None, np.random.default_rng(5), alpha=0.2)
    first, second, third = one.touches[:3]
    flight = 1.04 * (second - first) ** 2 / (third - second)
    padded = np.concatenate(
        [1e-4 * np.random.default_rng(1).standard_normal(noisy_rooms.RATE), one.sound]
    )
    at, begin = (
        int((1.0 + first - flight) * noisy_rooms.RATE),
        int((1.0 + first) * noisy_rooms.RATE),
    )
    padded[at : at + 900] += padded[begin : begin + 900]
    touches = heard(padded)
    assert np.abs(touches.times[:, None] - 1.0 - one.touches).min(axis=1).max() < 2e-3


def test_a_weak_train_names_no_law_and_touches_that_were_chosen_do() -> None:
    one = noisy_rooms.drop("glass", "pink", 40.0, None, np.random.default_rng(2), alpha=0.2)
    data = heard(one.sound)
    weak = replace(data, heard=(replace(data.heard[0], score=15.0),))
    found = fit([weak])
    assert found.law is None and found.alpha is not None and "chance of 94 %" in found.reservation
    assert fit([replace(weak, heard=())]).law is not None


def test_noise_alone_gives_no_number() -> None:
    noise = np.random.default_rng(4).standard_normal(3 * noisy_rooms.RATE) * 0.1
    try:
        data = heard(noise)
    except Exception as error:  # no three clicks in a row
        assert "train of bounces" in str(error)
        return
    assert doubts_of(data.heard, 1e-3)


def test_doubts_silence_a_law_and_touches_that_were_chosen_do_not() -> None:
    one = noisy_rooms.drop("glass", "pink", 40.0, None, np.random.default_rng(2), alpha=0.2)
    data = heard(one.sound)
    few = replace(data, times=data.times[:5], numbers=None, picks=data.picks)
    doubted = replace(few, heard=(replace(data.heard[0], times=data.times[:5], score=5.0),))
    assert fit([doubted]).alpha is None and "the 5 touches heard" in fit([doubted]).doubts[0]
    assert fit([replace(few, heard=())]).alpha is not None
