"""Pushes of a bouncing ball on a plate: how many there are, and the ball that they weigh.

Between two flights, a ball's push has the impulse m g (T + T')/2 (T, T': times from the middle of the
push before and to that of the next one): what gravity gives in that time. One mass, from all pushes,
says that they are one ball's, and that nothing else pushed it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.listening import LONGEST_CONTACT
from hcbench.fitting.pulses import pulses_of
from hcbench.fitting.recording import Recording
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from hcbench.fitting.datasets import TouchTimes
    from hcbench.fitting.recording import Picks
    from hcbench.fitting.signals import Signal
    from hcbench.terms.impact import Floats

# Samples a second that a signal is brought down to: clicks last longer.
_MOST_RATE = 48_000.0
# Another push has this share of the largest one's force.
_ANOTHER = 0.3
# Impulses that differ from those of one mass by less than this share of the largest are one ball's,
# beyond question; those that differ by more are not.
_ONE_BALL = 0.06
_NO_BALL = 0.25
# Pulses between the touches that may be something else, as a share of these.
_LEFT_OUT = 0.25
# Pulses before and after the train, as a share of its touches, with which no ball is beyond question.
_BESIDE = 0.25
# Share by which the mass of the pushes may differ from the given one.
_OF_MASS = 0.15
# Values at one end of the range with which a signal is clipped, at least.
_CLIPPED = 3


def recording_of(signal: Signal, begin: float = 0.0, end: float | None = None) -> Recording:
    """A signal, or a part of it, as a recording of at most 48 000 samples a second.

    begin, end: s, from its first sample.
    Raises UserError for a part without samples.
    """
    first = round(begin * signal.rate)
    last = len(signal.values)
    if end is not None:
        last = min(last, round(end * signal.rate))
    if last - first < 3:
        raise UserError("--from", f"{begin:g} s: no samples from there", "a part of the signal")
    values = signal.values[first:last]
    steps = np.diff(np.unique(values))
    step = float(steps.min()) if len(steps) else 0.0
    rate = signal.rate
    if rate > _MOST_RATE:
        from scipy.signal import resample_poly

        fewer = math.ceil(rate / _MOST_RATE)
        values = resample_poly(values - np.median(values), 1, fewer)
        rate /= fewer
    start = signal.begin + first / signal.rate
    return Recording(signal.name, np.asarray(values), rate, step, start, signal.what)


def is_single_push(signal: Signal) -> bool:
    """Say whether a signal is a force with one push alone, or none that stands out."""
    if not signal.is_force:
        return False
    recording = recording_of(signal)
    most = 0
    for band in pulses_of(recording):
        top = np.abs(band.sound[band.places])
        most = max(most, int((top > _ANOTHER * top.max()).sum()))
    return most < 2


def require_one_ball(data: TouchTimes) -> None:
    """Raise UserError for touches of a signal that are too long for a ball's, and for too many other
    pulses as large, unless the user chose the train.
    """
    picks = data.picks
    if picks is None:
        return
    contact = picks.contact_time
    if contact is not None and contact.value > LONGEST_CONTACT:
        got = f"pushes of {contact.value:.2g} s and more"
        expected = f"those of a ball, up to {LONGEST_CONTACT:g} s"
        raise UserError(data.name, got, expected, "Steps and hops push for longer")
    count = len(picks.times)
    are_many = picks.left_out > _LEFT_OUT * count or picks.left_out + picks.beside > count
    if data.heard and are_many:
        got = (
            f"{picks.left_out + picks.beside} more pulses as large beside {count} touches of a ball"
        )
        advice = "Choose a train with --touches A, or a part with --from and --to"
        raise UserError(data.name, got, "those of one ball alone", advice)


def weighed_ball(data: TouchTimes, signal: Signal) -> tuple[TouchTimes, str]:
    """Touches of a signal, without question where the pushes are those of one ball; and a sentence of
    its mass, "" where the signal has another unit.

    Raises UserError for forces that no ball exerts as it bounces, and for another mass than the given.
    """
    picks = data.picks
    if picks is None or picks.sizes is None or _is_clipped(signal.values):
        return data, ""
    impulses, between = _pushes(picks)
    if not len(impulses):
        return data, ""
    # Weight times time: late pushes are small, and count little.
    momentum = data.setup.gravity.value * between
    mass = float(momentum @ impulses / (momentum @ momentum))
    differ = float(np.abs(impulses - mass * momentum).max() / impulses.max())
    if len(impulses) > 1 and differ < _ONE_BALL and picks.beside <= _BESIDE * len(picks.times):
        data = replace(data, heard=())
    if not signal.is_force:
        return data, ""
    if differ > _NO_BALL:
        masses = impulses / momentum
        got = f"pushes whose impulses mean masses of {masses.min():.3g} ... {masses.max():.3g} kg"
        expected = "those of one ball that nothing else pushes"
        advice = "Choose touches with --touches 1:4, or record one ball alone"
        raise UserError(data.name, got, expected, advice)
    given = data.setup.mass
    if given is not None and abs(mass / given.value - 1.0) > _OF_MASS:
        got = f"{given.value:.4g} kg, and pushes of a ball of {mass:.4g} kg"
        raise UserError("mass", got, "one mass", "Look at the unit of the force")
    return data, f"the pushes are those of a ball of {mass:.3g} kg"


def _pushes(picks: Picks) -> tuple[Floats, Floats]:
    """Sizes of the touches between two others that were found, (k,): the push's area over time, N s where the
    signal is in N, and half the time from the touch before to the one after, s.
    """
    assert picks.sizes is not None
    is_between = (np.diff(picks.numbers)[:-1] == 1) & (np.diff(picks.numbers)[1:] == 1)
    between = 0.5 * (picks.times[2:] - picks.times[:-2])
    return picks.sizes[1:-1][is_between], between[is_between]


def _is_clipped(values: Floats) -> bool:
    """Say whether several values in a row, of (n,), lie at the end of the range that pulses reach."""
    middle = float(np.median(values))
    ends = (float(values.min()), float(values.max()))
    end = max(ends, key=lambda one: abs(one - middle))
    at_end = np.flatnonzero(values == end)
    return len(at_end) >= _CLIPPED and bool((np.diff(at_end) == 1).any())
