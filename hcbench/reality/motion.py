"""Measured motions of one body: its poses over time, its start, and how far
a simulated motion is from it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from hcbench.reality.outcome import SettingErrors
from hcbench.sim.toss import GRAVITY, POSITION, QUATERNION, Body, ContactSetting, Toss, TossModule
from hcbench.terms.impact import Floats

# The flight before the first touch ends where the lowest point is this low, m.
NEAR = 3e-3
# Frames of a flight to which its start is fitted.
MOST_FLIGHT = 14
# Frames of that flight, at least.
LEAST_FLIGHT = 5
# Last frames, which show where the ground is.
REST = 5
# Time step of the engines, s.
TIMESTEP = 2e-3
# A score counts no position as worse than this, in widths of the body.
_WORST = 2.0
_ITERATIONS = 12


@dataclass(frozen=True, slots=True)
class Motion:
    """Poses at times: arrays of shape (n,) s, (n, 3) m with the plate at
    z = 0, (n, 4) as (w, x, y, z).

    number: which of its data set.
    flight: frames before the first touch.
    start: at the first time; its steps count frames, not an engine's.
    """

    number: int
    time: Floats
    position: Floats
    quaternion: Floats
    flight: int
    start: Toss

    def toss(self, timestep: float) -> Toss:
        """The start, with steps up to the last time."""
        return replace(
            self.start, steps=int(np.ceil((self.time[-1] - self.time[0]) / timestep)) + 1
        )


def rotation(quaternion: Floats) -> Rotation:
    """Rotation of quaternions (w, x, y, z), shape (4,) or (n, 4)."""
    return Rotation.from_quat(np.roll(quaternion, -1, axis=-1))


def quaternions(turn: Rotation) -> Floats:
    """(w, x, y, z) of rotations."""
    rolled: Floats = np.roll(turn.as_quat(), 1, axis=-1)
    return rolled


def lowest(body: Body, position: Floats, quaternion: Floats) -> Floats:
    """Height of a body's lowest point, m, shape (n,)."""
    up = rotation(quaternion).as_matrix()[..., 2, :] * np.array(body.half_sizes)
    reach = np.abs(up).sum(axis=-1) if body.shape == "box" else np.linalg.norm(up, axis=-1)
    height: Floats = position[..., 2] - reach
    return height


def motion(number: int, body: Body, time: Floats, position: Floats, quaternion: Floats) -> Motion:
    """A measured motion that ends at rest on the ground; its last frames show the height of the
    ground.

    time: s, shape (n,).
    position: of the centre, m, shape (n, 3), over any level.
    quaternion: w first, shape (n, 4).
    """
    up = np.abs(rotation(quaternion[-REST:]).as_matrix()[:, 2, :].mean(axis=0))
    stands_on = body.half_sizes[int(np.argmax(up))]
    position = position - np.array([0.0, 0.0, position[-REST:, 2].mean() - stands_on])
    is_low = lowest(body, position, quaternion) < NEAR
    flight = max(int(np.argmax(is_low)), 3) if is_low.any() else len(time)
    n = min(flight, MOST_FLIGHT)
    return Motion(
        number, time, position, quaternion, flight, _start(time[:n], position[:n], quaternion[:n])
    )


def _start(time: Floats, position: Floats, quaternion: Floats) -> Toss:
    """State at the first time, by least squares of free flight: m, m/s and rad/s.

    time: s, shape (n,).
    position: m, shape (n, 3).
    quaternion: w first, shape (n, 4).

    The spin is found by iteration, since turns do not add.
    """
    since = time - time[0]
    rows = np.stack([np.ones_like(since), since], axis=1)
    risen = position + np.outer(0.5 * GRAVITY * since**2, [0.0, 0.0, 1.0])
    place, velocity = np.linalg.lstsq(rows, risen, rcond=None)[0]
    turns = rotation(quaternion)
    first = turns[0]
    spin = (turns[-1] * turns[0].inv()).as_rotvec() / since[-1]
    for _ in range(_ITERATIONS):
        # Undoing the spin leaves the attitude at the start, and noise.
        left = (Rotation.from_rotvec(-np.outer(since, spin)) * turns * first.inv()).as_rotvec()
        turn, more = np.linalg.lstsq(rows, left, rcond=None)[0]
        first = Rotation.from_rotvec(turn) * first
        spin = spin + more
    return Toss(place, quaternions(first), velocity, spin, len(time))


def at_times(states: Floats, timestep: float, time: Floats) -> tuple[Floats, Floats]:
    """Positions (m) and quaternions at times, linear between the ends of steps.

    states: shape (steps, components).
    timestep: s.
    time: s from the first state on, shape (n,).
    """
    before = np.minimum((time / timestep).astype(int), len(states) - 2)
    share = (time / timestep - before)[:, None]
    first = states[before]
    second = states[before + 1]
    position = first[:, POSITION] * (1.0 - share) + second[:, POSITION] * share
    one = first[:, QUATERNION]
    other = second[:, QUATERNION]
    sign = np.sign((one * other).sum(axis=1, keepdims=True))
    turn = one * (1.0 - share) + other * share * sign
    return position, turn / np.linalg.norm(turn, axis=1, keepdims=True)


@dataclass(frozen=True, slots=True)
class Tosses:
    """Motions of one body."""

    body: Body
    motions: Sequence[Motion]

    def of(self, keep: Callable[[Motion], bool]) -> "Tosses":
        """The motions for which `keep` is true."""
        return replace(self, motions=[each for each in self.motions if keep(each)])

    def simulated(
        self,
        module: TossModule,
        setting: ContactSetting,
        values: Sequence[float],
        timestep: float = TIMESTEP,
    ) -> list[Floats]:
        """States of an engine's setting, from the measured starts."""
        starts = [each.toss(timestep) for each in self.motions]
        return module.simulate(self.body, setting, values, timestep, starts)

    def as_simulated(self, simulated: Sequence[Floats], timestep: float = TIMESTEP) -> "Tosses":
        """The motions with poses of states, at the same times."""
        motions = []
        for each, states in zip(self.motions, simulated, strict=True):
            place, turn = at_times(states, timestep, each.time - each.time[0])
            motions.append(replace(each, position=place, quaternion=turn))
        return replace(self, motions=motions)

    def outcome(
        self,
        module: TossModule,
        setting: ContactSetting,
        values: Sequence[float],
        timestep: float = TIMESTEP,
    ) -> SettingErrors:
        """Errors of an engine's setting: mean distances over a toss,
        in per cent of the body's width.
        """
        return self.judged(self.simulated(module, setting, values, timestep), timestep)

    def judged(self, simulated: Sequence[Floats], timestep: float = TIMESTEP) -> SettingErrors:
        """Errors of simulated states, each from its measured start.

        simulated: states of each toss, a row for each step.
        timestep: s.

        Distances are in per cent of the body's width, angles in rad.
        """
        width = 2.0 * float(np.mean(self.body.half_sizes))
        rows = [
            _away(measured, *at_times(states, timestep, measured.time - measured.time[0]))
            for measured, states in zip(self.motions, simulated, strict=True)
        ]
        distance, angle = np.array(rows).reshape(-1, 2).T
        corner = float(np.linalg.norm(self.body.half_sizes)) / width
        scores = np.minimum(distance / width, _WORST) + corner * np.minimum(angle, np.pi)
        return SettingErrors(100.0 * distance / width, scores, angle)


def _away(measured: Motion, position: Floats, quaternion: Floats) -> tuple[float, float]:
    """Mean distance (m) and angle (rad) over frames; far for what is not finite."""
    distance = np.linalg.norm(position - measured.position, axis=1)
    cosine = np.abs((quaternion * measured.quaternion).sum(axis=1))
    angle = 2.0 * np.arccos(np.clip(np.where(np.isfinite(cosine), cosine, 0.0), 0.0, 1.0))
    return float(np.where(np.isfinite(distance), distance, 1.0).mean()), float(angle.mean())


def interval(values: Floats, seed: int = 0, draws: int = 1000) -> tuple[float, float]:
    """95 % interval of a mean, by bootstrap over the values."""
    generator = np.random.default_rng(seed)
    means = values[generator.integers(0, len(values), (draws, len(values)))].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)
