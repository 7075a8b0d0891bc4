"""Impacts read from poses: one least-squares fit an impact, of two
flights and the impulse between them.

Two flights at most MOST_GAP frames apart are one impact at the vertex that is lowest between.
Unknown are the pose when the flight before brings the vertex to the plate, the velocities before,
the impulse there, and the jump of the pose while the contact lasts, which is about 13 ms. e is the
speed at which the flight after carries the vertex up through the plate over that at which the
flight before brought it down.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from hcbench.reality.motion import Motion, rotation, without_fall
from hcbench.sim.toss import GRAVITY, Body
from hcbench.terms.impact import Floats

# A frame whose lowest vertex is higher than this, m, is in flight.
TOUCH = 1.5e-3
# Frames between two flights of one impact, at most.
MOST_GAP = 5
# Frames of the flight before an impact, at least.
LEAST_BEFORE = 4
# Frames of the flight after an impact, at least.
LEAST_AFTER = 2
# Frames that are fitted, at most: before and after.
MOST_BEFORE = 12
MOST_AFTER = 10
# Standard deviation of a measured position, m.
POSITION_NOISE = 8e-5
# Standard deviation of a measured attitude, rad.
ROTATION_NOISE = 4e-4
# Prior of the shift while the contact lasts: standard deviation, m.
_JUMP = 8e-3
# Prior of the turn while the contact lasts: standard deviation, rad.
_TURN = 0.06
# Rounds of least squares, at most.
_ROUNDS = 30
# The next vertex of a good impact is higher than this, m: the impact is at one vertex alone.
_ALONE = 5e-3
# The e of a good impact has a smaller standard uncertainty.
_SURE = 0.05
# Frames after a good impact, at least.
_LONG = 3
# The unknowns: place, turn, velocity, spin, impulse, jump, jump's turn, three of each.
_PLACE, _TURNED, _VELOCITY, _SPIN, _IMPULSE, _JUMPED, _JUMP_TURN = (
    slice(i, i + 3) for i in range(0, 21, 3)
)
# Size of a step of each unknown.
_SCALES = np.repeat([1e-4, 1e-3, 0.01, 0.05, 5e-3, 1e-3, 5e-3], 3)


@dataclass(frozen=True, slots=True)
class ImpactRead:
    """An impact of a motion at one vertex.

    number: the motion's.
    order: place among the motion's pairs of flights, 0 for the one that ends its first flight.
    time: s, from the motion's start.
    speed_in, speed_out: of the vertex, at the plate, m/s; e their ratio; u_e its standard
    uncertainty, without what differs from impact to impact.
    friction: tangential over normal impulse, against the slip; u_friction its standard uncertainty.
    slip: of the vertex along the plate, before, m/s.
    duration: s, between the two crossings of the plate.
    second: height of the next vertex over the one that touches, m.
    frames_after: number of frames of the flight after that were fitted.
    chi_square: of the fit, over its degrees of freedom.
    energy_lost: share of the kinetic energy.
    """

    number: int
    order: int
    time: float
    speed_in: float
    speed_out: float
    e: float
    u_e: float
    friction: float
    u_friction: float
    slip: float
    duration: float
    second: float
    frames_after: int
    chi_square: float
    energy_lost: float

    @property
    def good(self) -> bool:
        """True if e is known and one vertex alone was struck."""
        return self.frames_after >= _LONG and self.u_e < _SURE and self.second > _ALONE


COLUMNS = tuple(field.name for field in fields(ImpactRead))


def read_impacts(body: Body, motions: Iterable[Motion]) -> list[ImpactRead]:
    """All impacts of a box that two flights bracket."""
    impacts: list[ImpactRead] = []
    for motion in motions:
        impacts.extend(_of_motion(body, motion))
    return impacts


def vertices(body: Body) -> Floats:
    """Corners of a box in its own frame, m, shape (8, 3)."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij")).reshape(3, 8).T
    corners: Floats = signs * np.array(body.half_sizes)
    return corners


def _flights(height: Floats) -> list[tuple[int, int]]:
    """First and last frames of each flight."""
    up = np.concatenate([[False], height > TOUCH, [False]]).astype(int)
    change = np.diff(up)
    return list(zip(np.flatnonzero(change == 1), np.flatnonzero(change == -1) - 1, strict=True))


def _of_motion(body: Body, motion: Motion) -> Iterator[ImpactRead]:
    """Impacts of a box's motion, each at the vertex that is lowest just after the flight before.

    Left out are pairs of flights of which one is too short, that are too far apart or without a
    frame between them, and impacts that no unknowns fit.
    """
    corners = vertices(body)
    up = rotation(motion.quaternion).as_matrix()[:, 2, :]
    # Heights of the vertices, m: shape (frames, 8).
    heights = motion.position[:, 2:] + up @ corners.T
    lowest = heights.min(axis=1)
    for order, (before, after) in enumerate(pairwise(_flights(lowest))):
        start, end = before
        again, last = after
        is_short = end - start + 1 < LEAST_BEFORE or last - again + 1 < LEAST_AFTER
        if is_short or again - end > MOST_GAP or again == end + 1:
            continue
        # Of the three frames after the flight, the one in which a vertex is lowest.
        touch = end + 1 + int(np.argmin(lowest[end + 1 : min(end + 4, again + 1)]))
        vertex = int(np.argmin(heights[touch]))
        first = max(start, end - MOST_BEFORE + 1)
        until = min(last, again + MOST_AFTER - 1)
        frames = np.r_[first : end + 1, again : until + 1]
        fit = _ImpactFit(body, corners, vertex, motion, frames, before=end + 1 - first)
        impact = fit.impact(motion.number, order)
        if impact is not None:
            yield impact


class _ImpactFit:
    """The fit of one impact to the frames of the flights before and after it.

    Unknowns are 21 numbers, three each of _PLACE (of the centre at the touch, m), _TURNED (of the
    attitude then from `base`, rad), _VELOCITY (m/s) and _SPIN (rad/s) before, _IMPULSE (N s), and
    _JUMPED (m) and _JUMP_TURN (rad), by which the pose jumps while the contact lasts.

    time, place, turns: of the frames, s, m and attitudes; the first `before` of them are of the
    flight before the impact. began: time of the motion's first frame, s.
    touch: time of the touch, s; since: times from then on; later: mask of the frames after it.
    """

    def __init__(
        self, body: Body, corners: Floats, vertex: int, motion: Motion, frames: Floats, before: int
    ) -> None:
        """Take the frames of both flights, and estimate the touch, from which the fit starts.

        motion: measured poses, with the plate at z = 0.
        corners: vertices in the body's frame, m, shape (8, 3).
        vertex: number of the one that touches.
        frames: numbers of the frames of both flights, shape (n,).
        before: how many of them are of the first flight.
        """
        self.body = body
        self.corners = corners
        self.vertex = vertex
        self.time = motion.time[frames]
        self.place = motion.position[frames]
        self.turns = rotation(motion.quaternion[frames])
        self.before = before
        self.began = motion.time[0]
        self.touch, self.start, self.base = self._touch()
        self.since = self.time - self.touch
        self.later = self.since > 0.0

    def _arc(self, touch: float) -> tuple[Floats, Floats, Rotation, Floats]:
        """Place (m) and velocity (m/s), shape (3,), attitude and spin (rad/s, (3,)) at a time, by
        the flight before the impact.

        touch: time, s, in the time of the motion. Straight lines are fitted to the place in free
        fall and to the turn.
        """
        since = self.time[: self.before] - touch
        rows = np.stack([np.ones_like(since), since], axis=1)
        risen = without_fall(self.place[: self.before], since)
        place, velocity = np.linalg.lstsq(rows, risen, rcond=None)[0]
        last = self.turns[self.before - 1]
        turned = (self.turns[: self.before] * last.inv()).as_rotvec()
        turn, spin = np.linalg.lstsq(rows, turned, rcond=None)[0]
        return place, velocity, Rotation.from_rotvec(turn) * last, spin

    def _touch(self) -> tuple[float, Floats, Rotation]:
        """Estimate the time of the touch, s, the unknowns to start from, shape (21,), and the
        attitude then.

        The touch is where the flight before brings the vertex to the plate, by Newton's method. The
        impulse to start from gives the velocity that leads through the frames after it.
        """
        last = self.time[self.before - 1]
        first = self.time[self.before]
        # From half-way between the frames. A step of Newton's method is kept to 4 ms, more than half
        # of the 6.8 ms between the cube's.
        touch = 0.5 * (last + first)
        for _ in range(6):
            place, velocity, base, spin = self._arc(touch)
            arm = base.apply(self.corners[self.vertex])
            # Speed of the vertex upwards, m/s: one that hardly falls has no time of touch.
            rate = velocity[2] + np.cross(spin, arm)[2]
            if rate >= -0.02:
                break
            touch += float(np.clip(-(place[2] + arm[2]) / rate, -4e-3, 4e-3))
        touch = float(np.clip(touch, last + 1e-4, first - 1e-4))
        place, velocity, base, spin = self._arc(touch)
        since = self.time[self.before :] - touch
        moved = without_fall(self.place[self.before :], since) - place
        # The velocity whose straight line from the touch is nearest to the frames after it.
        leaving = (moved * since[:, None]).sum(axis=0) / (since**2).sum()
        start = np.zeros(len(_SCALES))
        start[_PLACE] = place
        start[_VELOCITY] = velocity
        start[_SPIN] = spin
        start[_IMPULSE] = self.body.mass * (leaving - velocity)
        return touch, start, base

    def _after(self, u: Floats) -> tuple[Rotation, Floats, Floats, Floats]:
        """Attitude at the touch, the vertex' arm from the centre then, m, and velocity (m/s) and
        spin (rad/s) after the impulse, in the world's frame, shape (b, 3) each.

        u: unknowns of the fit, pose and velocities at the touch, impulse and jump, shape (b, 21).
        """
        turn = Rotation.from_rotvec(u[:, _TURNED]) * self.base
        arm = turn.apply(self.corners[self.vertex])
        velocity = u[:, _VELOCITY] + u[:, _IMPULSE] / self.body.mass
        # Angular impulse in the body's frame, where the inertia is diagonal.
        twist = turn.inv().apply(np.cross(arm, u[:, _IMPULSE]))
        spin = u[:, _SPIN] + turn.apply(twist / np.array(self.body.inertia))
        return turn, arm, velocity, spin

    def left(self, u: Floats) -> Floats:
        """Residuals of unknowns of shape (b, 21), in standard deviations, shape (b, 6 n + 6): of
        each of n frames the place, then of each the attitude, then the priors of the jump and its
        turn.
        """
        sets = len(u)
        frames = len(self.time)
        turn, _, velocity, spin = self._after(u)
        # Times from the touch, s, and a mask of the frames after it: (1, frames, 1) each.
        since = self.since[None, :, None]
        later = self.later[None, :, None]
        # Free flight from the touch, backwards or forwards; the jump is of the frames after it.
        speeds = np.where(later, velocity[:, None], u[:, None, _VELOCITY])
        place = u[:, None, _PLACE] + np.where(later, u[:, None, _JUMPED], 0.0) + speeds * since
        place[..., 2] -= 0.5 * GRAVITY * self.since**2
        spins = np.where(later, spin[:, None], u[:, None, _SPIN]) * since
        jumps = np.where(later, u[:, None, _JUMP_TURN], 0.0) * np.ones_like(since)
        # SciPy's rotations have one dimension: set after set, of each all frames.
        of_set = np.repeat(np.arange(sets), frames)
        of_frame = np.tile(np.arange(frames), sets)
        attitude = (
            Rotation.from_rotvec(spins.reshape(-1, 3))
            * Rotation.from_rotvec(jumps.reshape(-1, 3))
            * turn[of_set]
        )
        away = (attitude.inv() * self.turns[of_frame]).as_rotvec()
        parts = (
            (place - self.place) / POSITION_NOISE, away.reshape(sets, frames, 3) / ROTATION_NOISE,
            u[:, None, _JUMPED] / _JUMP, u[:, None, _JUMP_TURN] / _TURN,
        )  # fmt: skip
        return np.concatenate([part.reshape(sets, -1) for part in parts], axis=1)

    def derived(self, u: Floats) -> Floats:
        """Speed in and out, m/s, friction, slip, m/s, duration, s, and share of the energy that is
        lost, of unknowns, shape (b, 21): shape (b, 6), see `ImpactRead`.
        """
        turn, arm, velocity, spin = self._after(u)
        # Velocity of the vertex at the touch, m/s, z up.
        arriving = u[:, _VELOCITY] + np.cross(u[:, _SPIN], arm)
        duration, leaving = self._up(u, turn, velocity, spin)
        slip = np.linalg.norm(arriving[:, :2], axis=1)
        # Impulse against the slip, N s.
        work = np.einsum("bi,bi->b", u[:, _IMPULSE][:, :2], arriving[:, :2])
        along = -work / np.maximum(slip, 1e-9)
        energy = self._energy(turn, u[:, _VELOCITY], u[:, _SPIN])
        lost = 1.0 - self._energy(turn, velocity, spin) / energy
        friction = along / u[:, _IMPULSE][:, 2]
        return np.stack([-arriving[:, 2], leaving, friction, slip, duration, lost], axis=1)

    def _energy(self, turn: Rotation, velocity: Floats, spin: Floats) -> Floats:
        """Twice the kinetic energy, J, shape (b,).

        turn: attitudes, since the inertia is known in the body's frame. velocity (m/s), spin: in
        the world's frame, shape (b, 3).
        """
        own = turn.inv().apply(spin)
        energy: Floats = self.body.mass * (velocity**2).sum(axis=1) + own**2 @ np.array(
            self.body.inertia
        )
        return energy

    def _up(
        self, u: Floats, turn: Rotation, velocity: Floats, spin: Floats
    ) -> tuple[Floats, Floats]:
        """Time, s after the touch, and speed, m/s, at which the flight after the impact carries the
        vertex up through the plate, shape (b,) each.

        u: unknowns, shape (b, 21).
        turn: attitude at the touch. velocity (m/s), spin (rad/s): after the impulse, shape (b, 3).
        Twelve steps by Newton from 7 ms on, without a test of convergence.
        """
        after = Rotation.from_rotvec(u[:, _JUMP_TURN]) * turn
        corner = after.apply(self.corners[self.vertex])
        height = u[:, _PLACE][:, 2] + u[:, _JUMPED][:, 2]
        # About half of the 13 ms that a contact lasts.
        time = np.full(len(u), 7e-3)
        for _ in range(12):
            arm = Rotation.from_rotvec(spin * time[:, None]).apply(corner)
            at = height + velocity[:, 2] * time - 0.5 * GRAVITY * time**2 + arm[:, 2]
            rate = velocity[:, 2] - GRAVITY * time + np.cross(spin, arm)[:, 2]
            newton = np.clip(time - at / np.maximum(rate, 0.01), -4e-3, 0.03)
            # A Newton step means nothing if the vertex hardly rises.
            time = np.where(rate < 0.01, time, newton)
        return time, rate

    def impact(self, number: int, order: int) -> ImpactRead | None:
        """Fit the impact and derive its numbers with their standard uncertainties; None where no
        unknowns fit.

        Speeds are in m/s, times in s, heights in m.

        number: of the motion.
        order: place among the impacts of the motion.
        """
        fitted = _least_squares(self.left, self.start)
        if fitted is None:
            return None
        best, curvature, square = fitted
        # 6 n + 6 residuals, of the frames and the priors, less 21 unknowns.
        chi_square = square / (6 * len(self.time) - 15)
        # Noise that is smaller than expected makes nothing surer: u is never scaled down.
        covariance = np.linalg.pinv(curvature) * max(chi_square, 1.0)
        step = 1e-2 * _SCALES
        # A row for the best unknowns, then one for a step of each.
        derived = self.derived(np.vstack([best, best + np.diag(step)]))
        speed_in, speed_out, friction, slip, duration, lost = derived[0].tolist()
        # Changes of e and friction with each unknown, by differences.
        e_at = derived[:, 1] / derived[:, 0]
        friction_at = derived[:, 2]
        e_changes = e_at[1:] - e_at[0]
        friction_changes = friction_at[1:] - friction_at[0]
        slopes = np.stack([e_changes, friction_changes]) / step
        variances = np.einsum("ij,jk,ik->i", slopes, covariance, slopes)
        u_e, u_friction = np.sqrt(np.maximum(variances, 0.0)).tolist()
        # Of all corners over the centre, m, at the touch; the lowest is the one that touches.
        attitude = Rotation.from_rotvec(best[_TURNED]) * self.base
        heights = np.sort(attitude.apply(self.corners)[:, 2])
        return ImpactRead(
            number=number,
            order=order,
            time=self.touch - self.began,
            speed_in=speed_in,
            speed_out=speed_out,
            e=speed_out / speed_in,
            u_e=u_e,
            friction=friction,
            u_friction=u_friction,
            slip=slip,
            duration=duration,
            second=float(heights[1] - heights[0]),
            frames_after=len(self.time) - self.before,
            chi_square=chi_square,
            energy_lost=lost,
        )


def _least_squares(
    left: Callable[[Floats], Floats], start: Floats
) -> tuple[Floats, Floats, float] | None:
    """Unknowns that make the squares least, the matrix of normal equations
    there, and the sum of squares.

    By Gauss and Newton, with differences for slopes, all in one call; None where the unknowns do
    not stay finite.

    left: residuals, shape (b, n), of unknowns, shape (b, 21).
    start: shape (21,).
    """
    best = start
    step = 1e-3 * _SCALES
    for _ in range(_ROUNDS):
        # Residuals of the best unknowns, and with a step of each.
        here, *moved = left(np.vstack([best, best + np.diag(step)]))
        slopes = (np.array(moved) - here) / step[:, None]
        curvature = slopes @ slopes.T
        shift = -np.linalg.lstsq(curvature, slopes @ here, rcond=None)[0]
        # Shares of the shift that are tried: all of it may overshoot.
        shares = np.array([1.0, 0.5, 0.25, 0.05])
        squares = (left(best + shares[:, None] * shift) ** 2).sum(axis=1)
        pick = int(np.argmin(squares))
        gained = float((here**2).sum() - squares[pick])
        if gained <= 0.0:
            return best, curvature, float((here**2).sum())
        best = best + shares[pick] * shift
        if gained < 1e-6 * squares[pick]:
            break
    if not np.isfinite(best).all():
        return None
    return best, curvature, float(squares[pick])
