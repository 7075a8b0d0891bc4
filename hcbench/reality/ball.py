"""Table tennis balls that bounce on a table: positions at 150 Hz, and
spins measured before the bounce.

Each side of a bounce is fitted with drag and the Magnus force, to third order in time about
the touch. What happens along the table is known badly, as the spin after is not measured:
the error is of the normal speed.
"""

import io
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from hcbench.reality.motion import MeasuredBounces, SettingErrors, bounced
from hcbench.sim.toss import GRAVITY, Body, ContactSetting, TossModule
from hcbench.system.errors import UserError
from hcbench.system.files import read_bytes
from hcbench.terms.impact import Floats

TITLE = "table tennis"
UNIT = "m/s"
TRAINING = (0,)
VALIDATION = (1, 2)
PARTS = 3
# Friction of the rigid law that is nearest along the table.
FIXED = {"friction": 0.266}
TIMESTEP = 2e-3
DURATION = 0.06  # s
RADIUS = 0.02  # m
MASS = 0.0027  # kg
# A thin shell.
INERTIA = 2.0 / 3.0 * MASS * RADIUS**2
FILE = "data/trajectories/trajectories.zip"
SHA256 = "c2a5e0597117c5af59d0e56a95aa3e35f541ad255b3e2687d92dc3e0c5fb5474"
# Density of air, kg/m³.
_AIR = 1.2
# 1/m: times the speed squared it is a deceleration. 0.45 is the drag coefficient.
_DRAG = 0.5 * _AIR * np.pi * RADIUS**2 * 0.45 / MASS
# The Magnus force over mass, spin and speed: 0.6 is the lift coefficient.
_LIFT = 0.5 * _AIR * np.pi * RADIUS**3 * 0.6 / MASS
# Frames of either side of a bounce, at most.
_FRAMES = 22
# Frames of either side, at least.
_LEAST = 6
# Share of the spin after the bounce, which was not measured: for the Magnus force alone.
_SPIN_KEPT = 0.8


def body() -> Body:
    """The ball."""
    return Body("sphere", (RADIUS,) * 3, MASS, (INERTIA,) * 3)


def cases(parts: tuple[int, ...], folder: Path | None = None, variant: str = "") -> MeasuredBounces:
    """Bounces whose place in the data, modulo PARTS, is one of `parts`; variant changes nothing.

    folder: of the original repository, since the data are not shipped.
    Raises UserError for None, and for a folder without the archive.
    """
    if folder is None:
        raise UserError(
            "--data", "not given", "the folder of cogsys-tuebingen/spindoe", "It has no licence"
        )
    bounces = read(folder / FILE)
    return bounces.of(np.isin(np.arange(len(bounces)) % PARTS, parts))


def read(path: Path) -> MeasuredBounces:
    """Read the bounces whose both sides are known, from the published archive.

    Speeds are in m/s and spins in rad/s. Kept are bounces with 0.3 < e < 1.2 and an uncertainty of
    e below 0.04.
    Raises UserError for an archive that cannot be read, and for one without any bounce that is
    clear.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(read_bytes(path))) as archive:
            (index,) = (name for name in archive.namelist() if name.endswith("index.csv"))
            root = index.removesuffix("index.csv")
            table = np.loadtxt(io.BytesIO(archive.read(index)), delimiter=",", skiprows=1, ndmin=2)
            bounces = []
            for number, *spin in table[:, :4]:
                track = _track(archive, root, int(number))
                bounce = _bounce(number, np.array(spin), track)
                if bounce is not None:
                    bounces.append(bounce)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise UserError("--data", f"{path}: {error}", "trajectories.zip") from None
    if not bounces:
        raise UserError("--data", f"{path}: no track with a clear bounce", "trajectories.zip")
    # A row each: number, spin, velocity before and after, u of e.
    numbers, spin_before, before, after, u_e = map(np.array, zip(*bounces, strict=True))
    e = -after[:, 2] / before[:, 2]
    good = (u_e < 0.04) & (e > 0.3) & (e < 1.2)
    count = int(good.sum())
    attitude = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    unknown = np.full((count, 3), np.nan)
    return MeasuredBounces(
        numbers=numbers[good],
        attitude=attitude,
        velocity=before[good],
        spin=spin_before[good],
        velocity_after=after[good],
        spin_after=unknown,
    )


def _track(archive: zipfile.ZipFile, root: str, number: int) -> Floats:
    """The finite rows of a track, shape (n, 4): time, s, and place, m; none where the archive lacks
    it.

    root: folder of the tracks in the archive, with a slash at the end.
    number: of the track, which names its file. Raises what a damaged archive leads to.
    """
    name = f"{root}{number:03d}.csv"
    if name not in archive.namelist():
        return np.empty((0, 4))
    rows = np.genfromtxt(io.BytesIO(archive.read(name)), delimiter=";", ndmin=2)
    track: Floats = rows[np.isfinite(rows).all(axis=1)]
    return track


class _Bounce(NamedTuple):
    """Bounce of a track: its number, spin before, rad/s, velocities
    before and after, m/s, each (3,).

    u_e: standard uncertainty of e.
    """

    number: float
    spin: Floats
    before: Floats
    after: Floats
    u_e: float


def _bounce(number: float, spin: Floats, track: Floats) -> _Bounce | None:
    """The first bounce of a track, shape (n, 4) of time, s, and position,
    m; None where it is not clear.

    number: of the track.
    spin: before the bounce, rad/s, shape (3,). Not clear: too few frames on a side, no touch near
    the lowest frame, more than 6 mm off the fitted arcs, or slower than 0.3 m/s.
    """
    # So short a track has too few frames on one side of its lowest one.
    if len(track) < 20:
        return None
    time = track[:, 0]
    place = track[:, 1:]
    lowest = _lowest_frame(place[:, 2])
    if lowest is None:
        return None
    first = max(0, lowest - _FRAMES)
    last = min(len(time), lowest + _FRAMES + 1)
    since_lowest = time - time[lowest]
    touch = _touch(since_lowest, place[:, 2], slice(first, lowest), slice(lowest + 1, last))
    if touch is None:
        return None
    frame = np.arange(len(time))
    since_touch = since_lowest - touch
    # Frames within 1 ms of the touch may be of either side.
    falling = (since_touch < -1e-3) & (frame >= first)
    rising = (since_touch > 1e-3) & (frame < last)
    if min(falling.sum(), rising.sum()) < _LEAST:
        return None
    before, error_in, miss_in = _arc(since_touch[falling], place[falling], spin)
    after, error_out, miss_out = _arc(since_touch[rising], place[rising], _SPIN_KEPT * spin)
    # Limits of what the arcs leave, m, and of the speed down, m/s: z points up.
    if max(miss_in, miss_out) > 6e-3 or before[2] > -0.3:
        return None
    # e = -after/before, by the two independent uncertainties of the speeds.
    u_e = np.hypot(error_out / before[2], after[2] * error_in / before[2] ** 2)
    return _Bounce(number, spin, before, after, float(u_e))


def _lowest_frame(height: Floats) -> int | None:
    """The first frame, five or more from either end, that is lowest within six frames
    and less than 8 cm above the lowest of all; None for none.

    height: m, shape (n,).
    """
    for i in range(5, len(height) - 5):
        nearby = height[max(0, i - 6) : i + 7]
        if height[i] == nearby.min() and height[i] < height.min() + 0.08:
            return i
    return None


def _touch(time: Floats, height: Floats, before: slice, later: slice) -> float | None:
    """Time at which the parabolas of both sides meet, s; None if they do not near the lowest frame.

    time: s, from the lowest frame on.
    height: m. Both have the shape (n,); `before` and `later` are the frames of either side.
    """
    difference = np.poly1d(np.polyfit(time[before], height[before], 2))
    difference -= np.poly1d(np.polyfit(time[later], height[later], 2))
    near = []
    for root in difference.roots:
        is_real = abs(root.imag) < 1e-9
        # Within 12 ms of the lowest frame.
        if is_real and abs(root.real) < 0.012:
            near.append(root.real)
    return min(near, key=abs, default=None)


def _arc(time: Floats, place: Floats, spin: Floats) -> tuple[Floats, float, float]:
    """Velocity at time 0, m/s, shape (3,), standard uncertainty of its z, m/s, and
    root mean square of what the arc leaves, m.

    The arc is a flight with drag and lift, fitted by least squares that count outliers less.

    time: s, shape (n,).
    place: m, shape (n, 3).
    spin: rad/s, shape (3,).
    """
    # Columns of the Taylor series about time 0, to third order.
    powers = np.stack([np.ones_like(time), time, time**2 / 2.0, time**3 / 6.0], axis=1)

    def left(u: Floats) -> Floats:
        """Distances of the arc from the measured places, m, shape (3 n,).

        u: place (m) and velocity (m/s) at time 0, shape (6,). Drag and lift give the next two
        derivatives.
        """
        start = u[:3]
        velocity = u[3:]
        speed = float(np.linalg.norm(velocity))
        # Per mass: the acceleration, m/s².
        force = -_DRAG * speed * velocity + _LIFT * np.cross(spin, velocity) - [0.0, 0.0, GRAVITY]
        # Derivative of speed times velocity over time.
        change = speed * force + velocity * float(velocity @ force) / max(speed, 1e-9)
        jerk = -_DRAG * change + _LIFT * np.cross(spin, force)
        missed: Floats = (powers @ np.stack([start, velocity, force, jerk]) - place).ravel()
        return missed

    _bend, slope, at_touch = np.polyfit(time, place, 2)
    fitted: Any = least_squares(left, np.r_[at_touch, slope], loss="soft_l1", f_scale=3e-3)
    size = len(fitted.fun)
    mean = float(np.mean(fitted.fun**2))
    # Six unknowns are fitted: place and velocity.
    covariance = np.linalg.inv(fitted.jac.T @ fitted.jac) * mean * size / (size - 6)
    return fitted.x[3:], float(np.sqrt(covariance[5, 5])), float(np.sqrt(mean))


def outcome(
    module: TossModule, setting: ContactSetting, values: tuple[float, ...], bounces: MeasuredBounces
) -> SettingErrors:
    """Absolute errors of the normal speed after each bounce, m/s, of an engine's setting; a ball
    that does not leave has a speed of 0.

    module: `toss` of the engine.
    values: of the setting's parameters.
    bounces: measured ones.
    Raises what the engine raises.
    """
    later, _ = bounced(module, setting, values, body(), bounces, TIMESTEP, DURATION)
    return _judged(bounces, later)


def rigid(bounces: MeasuredBounces, e: float, friction: float) -> SettingErrors:
    """Absolute errors of the normal speed after, m/s, (n,), of a rigid ball with a constant e and
    Coulomb's friction.

    bounces: n velocities, m/s, and spins, rad/s, at the touch, z up.
    friction: μ, which changes the speeds along the table alone.
    """
    # Velocity of the contact's point by the spin, m/s.
    lever = np.cross(bounces.spin, [0.0, 0.0, -RADIUS])[:, :2]
    slip = bounces.velocity[:, :2] + lever
    speed = np.linalg.norm(slip, axis=1)
    # Normal impulse over the mass, m/s.
    push = (1.0 + e) * -bounces.velocity[:, 2]
    # Change of the speed along the table that stops the slip; friction cannot exceed it.
    stick = speed / (1.0 + MASS * RADIUS**2 / INERTIA)
    later = bounces.velocity * [1.0, 1.0, -e]
    later[:, :2] -= slip * (np.minimum(friction * push, stick) / np.maximum(speed, 1e-9))[:, None]
    return _judged(bounces, later)


def _judged(bounces: MeasuredBounces, later: Floats) -> SettingErrors:
    away = np.abs(later - bounces.velocity_after)[:, 2]
    return SettingErrors(away, away)
