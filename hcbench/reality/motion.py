"""Measured motions and bounces of one body, and how far simulated ones are from them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy.spatial.transform import Rotation

from hcbench.sim.toss import (
    GRAVITY,
    POSITION,
    QUATERNION,
    SPIN,
    VELOCITY,
    Body,
    ContactSetting,
    Toss,
    TossModule,
)
from hcbench.terms.impact import Floats

# Errors of a setting on a data set: one for each of its motions or bounces.


@dataclass(frozen=True, slots=True)
class SettingErrors:
    """Errors of n tosses or bounces, shape (n,), in the unit of the data set.

    rotations: mean angles between the attitudes, rad, of tosses; None for bounces.
    scores: by which one setting is preferred to another: errors and rotations in one number.
    """

    errors: Floats
    scores: Floats
    rotations: Floats | None = None


# The search that all identifications here use.


def least(
    function: Callable[[Floats], float], start: Floats, step: float, evaluations: int | None = None
) -> tuple[Floats, float]:
    """Minimize a function of some unknowns by Nelder and Mead; return the minimum's place and
    value.

    start: shape (n,).
    step: by which the first simplex differs from the start, in each unknown.
    evaluations: of the function, at most; None for SciPy's 200 n.
    """
    simplex = np.vstack([start, start + step * np.eye(len(start))])
    options: Any = {"initial_simplex": simplex, "maxfev": evaluations}
    best: Any = optimize.minimize(function, start, method="Nelder-Mead", options=options)
    return best.x, float(best.fun)


# Measured motions of one body: its poses over time, its start, and how far a simulated motion is
# from it.

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

    number: which of its data set.
    body: that moves.
    time: s, shape (n,).
    position: of the centre, m, shape (n, 3), over any level.
    quaternion: w first, shape (n, 4).
    The result has the plate at z = 0, the flight before the first touch, and the state at its
    start.
    """
    # z of the body's axes: the body lies on the face whose axis is most upright.
    up = np.abs(rotation(quaternion[-REST:]).as_matrix()[:, 2, :].mean(axis=0))
    stands_on = body.half_sizes[int(np.argmax(up))]
    position = position - np.array([0.0, 0.0, position[-REST:, 2].mean() - stands_on])
    is_low = lowest(body, position, quaternion) < NEAR
    # The start is fitted to three frames at least.
    flight = max(int(np.argmax(is_low)), 3) if is_low.any() else len(time)
    n = min(flight, MOST_FLIGHT)
    return Motion(
        number=number,
        time=time,
        position=position,
        quaternion=quaternion,
        flight=flight,
        start=_start(time[:n], position[:n], quaternion[:n]),
    )


def without_fall(position: Floats, since: Floats) -> Floats:
    """Positions, m, shape (n, 3), less the way of gravity in times since some moment, s, shape
    (n,): in free flight they lie on a straight line over time.
    """
    risen: Floats = position + np.outer(0.5 * GRAVITY * since**2, [0.0, 0.0, 1.0])
    return risen


def _start(time: Floats, position: Floats, quaternion: Floats) -> Toss:
    """State at the first time, by least squares of free flight: m, m/s and rad/s.

    time: s, shape (n,).
    position: m, shape (n, 3).
    quaternion: w first, shape (n, 4).

    The spin is found by iteration, since turns do not add.
    """
    since = time - time[0]
    rows = np.stack([np.ones_like(since), since], axis=1)
    place, velocity = np.linalg.lstsq(rows, without_fall(position, since), rcond=None)[0]
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
    """Positions (m), shape (n, 3), and quaternions, shape (n, 4), at times, linear between the ends
    of steps; beyond the last state they go on as in the last step.

    states: shape (steps, components), in columns POSITION and QUATERNION.
    timestep: s.
    time: s from the first state on, shape (n,).
    """
    # Numbers of the states before each time, and how far it is from there to the next.
    before = np.minimum((time / timestep).astype(int), len(states) - 2)
    share = (time / timestep - before)[:, None]
    first = states[before]
    second = states[before + 1]
    position = first[:, POSITION] * (1.0 - share) + second[:, POSITION] * share
    one = first[:, QUATERNION]
    other = second[:, QUATERNION]
    # q and -q are one attitude: the nearer one of the two is gone to.
    sign = np.sign((one * other).sum(axis=1, keepdims=True))
    turn = one * (1.0 - share) + other * share * sign
    return position, turn / np.linalg.norm(turn, axis=1, keepdims=True)


@dataclass(frozen=True, slots=True)
class Tosses:
    """Motions of one body that was tossed, each until it rests."""

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
        """States of an engine's setting, from the measured starts: of each toss a row for each
        step, shape (steps, components), in the columns POSITION, QUATERNION, VELOCITY and SPIN; SI.

        module: `toss` of the engine, which runs in this process.
        values: of the setting's parameters.
        timestep: s. Raises what the engine raises.
        """
        starts = [toss.toss(timestep) for toss in self.motions]
        return module.simulate(self.body, setting, values, timestep, starts)

    def as_simulated(self, simulated: Sequence[Floats], timestep: float = TIMESTEP) -> "Tosses":
        """The motions with poses of states, at the same times.

        simulated: of each motion, states at the start and after each step, shape (steps + 1,
        components), as `at_times` reads them.
        timestep: s.
        """
        motions = []
        for toss, states in zip(self.motions, simulated, strict=True):
            place, turn = at_times(states, timestep, toss.time - toss.time[0])
            motions.append(replace(toss, position=place, quaternion=turn))
        return replace(self, motions=motions)

    def outcome(
        self,
        module: TossModule,
        setting: ContactSetting,
        values: Sequence[float],
        timestep: float = TIMESTEP,
    ) -> SettingErrors:
        """Errors of an engine's setting: mean distances over a toss, in per cent of the body's
        width, and angles, rad; see `judged`.

        module: `toss` of the engine, which runs in this process.
        values: of the setting's parameters.
        timestep: s. Raises what the engine raises.
        """
        return self.judged(self.simulated(module, setting, values, timestep), timestep)

    def judged(self, simulated: Sequence[Floats], timestep: float = TIMESTEP) -> SettingErrors:
        """Errors of simulated states, each from its measured start.

        simulated: states of each toss, shape (steps + 1, components), as `at_times` reads them.
        timestep: s.

        Distances are in per cent of the body's width, angles in rad. A score adds the
        distance of the centres, _WORST at most, and a corner's way by the angle, in widths.
        """
        width = 2.0 * float(np.mean(self.body.half_sizes))
        # Of each toss the mean distance, m, and angle, rad.
        rows = []
        for measured, states in zip(self.motions, simulated, strict=True):
            place, turn = at_times(states, timestep, measured.time - measured.time[0])
            rows.append(_away(measured, place, turn))
        distance, angle = np.array(rows).reshape(-1, 2).T
        # Distance of a corner from the centre, in widths.
        corner = float(np.linalg.norm(self.body.half_sizes)) / width
        scores = np.minimum(distance / width, _WORST) + corner * np.minimum(angle, np.pi)
        return SettingErrors(100.0 * distance / width, scores, angle)


def _away(measured: Motion, position: Floats, quaternion: Floats) -> tuple[float, float]:
    """Mean distance (m) and angle (rad) over frames. What is not finite counts as 1 m and half a
    turn away.

    position: m, shape (n, 3); quaternion: shape (n, 4), at the times of the measured ones.
    """
    distance = np.linalg.norm(position - measured.position, axis=1)
    cosine = np.abs((quaternion * measured.quaternion).sum(axis=1))
    angle = 2.0 * np.arccos(np.clip(np.where(np.isfinite(cosine), cosine, 0.0), 0.0, 1.0))
    return float(np.where(np.isfinite(distance), distance, 1.0).mean()), float(angle.mean())


def interval(values: Floats, seed: int = 0, draws: int = 1000) -> tuple[float, float]:
    """95 % interval of a mean, low and high, by bootstrap over the values, shape (n,).

    seed: of the draws: the same gives the same interval.
    """
    generator = np.random.default_rng(seed)
    means = values[generator.integers(0, len(values), (draws, len(values)))].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


# Single bounces: a body is launched so that it meets the plate as measured, and its motion after
# is read.

# Steps of flight before the touch; the phase adds up to one more.
_BACK = 1.5


@dataclass(frozen=True, slots=True)
class MeasuredBounces:
    """Bounces of one body, as they were measured; what was not measured after is NaN.

    numbers: which of the data set, shape (n,).
    attitude: quaternions w first at the touch, (n, 4).
    velocity, spin: before the touch, m/s and rad/s, (n, 3); velocity_after, spin_after: after it.
    """

    numbers: Floats
    attitude: Floats
    velocity: Floats
    spin: Floats
    velocity_after: Floats
    spin_after: Floats

    def __len__(self) -> int:
        return len(self.numbers)

    def of(self, keep: NDArray[np.bool_]) -> "MeasuredBounces":
        """The bounces that a mask keeps."""
        return MeasuredBounces(
            numbers=self.numbers[keep],
            attitude=self.attitude[keep],
            velocity=self.velocity[keep],
            spin=self.spin[keep],
            velocity_after=self.velocity_after[keep],
            spin_after=self.spin_after[keep],
        )


def bounced(
    module: TossModule,
    setting: ContactSetting,
    values: Sequence[float],
    body: Body,
    bounces: MeasuredBounces,
    timestep: float,
    duration: float,
) -> tuple[Floats, Floats]:
    """Velocities (m/s) and spins (rad/s) with which an engine's bodies leave the plate, shape (n,
    3) each.

    One that has not left at the end has the velocity along the plate of the last step, and none
    upwards.
    module: `toss` of the engine, which runs in this process.
    values: of the setting's parameters.
    bounces: the states at the touch to start from.
    timestep, duration: s.
    Raises what the engine raises.
    """
    tosses = _launches(body, bounces, timestep, duration)
    return _after(body, module.simulate(body, setting, values, timestep, tosses), timestep)


def _launches(body: Body, bounces: MeasuredBounces, timestep: float, duration: float) -> list[Toss]:
    """Tosses that begin a step or two before the touch, each in another phase of the step.

    bounces: states at the touch, which are followed back through free flight.
    timestep, duration: s. The same bounces have the same phases.
    """
    phases = np.random.default_rng(0).random(len(bounces))
    tosses = []
    for i, phase in enumerate(phases):
        back = (_BACK + phase) * timestep
        turn = Rotation.from_rotvec(-back * bounces.spin[i]) * rotation(bounces.attitude[i])
        height = -float(lowest(body, np.zeros(3), bounces.attitude[i]))
        velocity = bounces.velocity[i] + [0.0, 0.0, GRAVITY * back]
        place = np.array([0.0, 0.0, height - 0.5 * GRAVITY * back**2]) - back * bounces.velocity[i]
        steps = int(duration / timestep)
        tosses.append(Toss(place, quaternions(turn), velocity, bounces.spin[i], steps))
    return tosses


def _after(body: Body, simulated: Sequence[Floats], timestep: float) -> tuple[Floats, Floats]:
    """Velocities and spins where bodies leave the plate, shape (n, 3) each.

    One that has not left at the end has the velocity along the plate of
    the last step, and none upwards. Units are m/s and rad/s.

    simulated: states of each body, shape (steps, components).
    timestep: s.
    """
    velocities = []
    spins = []
    for states in simulated:
        height = lowest(body, states[:, POSITION], states[:, QUATERNION])
        clear = (height > 0.0) & (states[:, VELOCITY][:, 2] > 0.0)
        clear[0] = False
        if clear.any():
            # The first step at whose end it is clear, and the way up in it, m.
            k = int(np.argmax(clear))
            rise = height[k] - height[k - 1]
            # How much of a step ago it was at the plate: gravity has slowed it since.
            share = 0.0
            if rise > 0.0:
                share = float(np.clip(height[k] / rise, 0.0, 1.0))
            velocities.append(states[k, VELOCITY] + [0.0, 0.0, GRAVITY * (timestep * share)])
        else:
            k = len(states) - 1
            velocities.append(states[k, VELOCITY] * [1.0, 1.0, 0.0])
        spins.append(states[k, SPIN])
    return np.array(velocities), np.array(spins)
