"""Table tennis balls that bounce on a table: positions at 150 Hz, and spins measured before the bounce.

Each side of a bounce is fitted with drag and the Magnus force, to third order in time about the touch. What
happens along the table is known badly, as the spin after is not measured: the error is of the normal speed.
"""

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from hcbench.reality.bounce import MeasuredBounces, bounced
from hcbench.reality.outcome import SettingErrors
from hcbench.sim.toss import GRAVITY, Body, ContactSetting, TossModule
from hcbench.system.errors import UserError
from hcbench.system.files import read_bytes
from hcbench.terms.impact import Floats

TITLE = "table tennis"
UNIT = "m/s"
TRAINING, VALIDATION = (0,), (1, 2)
PARTS = 3
# Of the rigid law that is nearest along the table
FIXED = {"friction": 0.266}
TIMESTEP = 2e-3
DURATION = 0.06  # s
RADIUS, MASS = 0.02, 0.0027  # m, kg
INERTIA = 2.0 / 3.0 * MASS * RADIUS**2  # of a shell
FILE = "data/trajectories/trajectories.zip"
SHA256 = "c2a5e0597117c5af59d0e56a95aa3e35f541ad255b3e2687d92dc3e0c5fb5474"
_AIR = 1.2  # kg/m³
_DRAG = 0.5 * _AIR * np.pi * RADIUS**2 * 0.45 / MASS  # 1/m
_LIFT = 0.5 * _AIR * np.pi * RADIUS**3 * 0.6 / MASS
_FRAMES = 22  # of a side of a bounce, at most
_LEAST = 6
# Share of the spin after the bounce, which was not measured: for the Magnus force alone
_SPIN_KEPT = 0.8


def body() -> Body:
    """The ball."""
    return Body("sphere", (RADIUS,) * 3, MASS, (INERTIA,) * 3)


def cases(parts: tuple[int, ...], folder: Path | None = None, variant: str = "") -> MeasuredBounces:
    """Bounces of parts of the data. UserError where the folder has not the archive."""
    if folder is None:
        raise UserError("--data", "not given", "the folder of cogsys-tuebingen/spindoe", "It has no licence")
    bounces = read(folder / FILE)
    return bounces.of(np.isin(np.arange(len(bounces)) % PARTS, parts))


def read(path: Path) -> MeasuredBounces:
    """All bounces that both sides are known of."""
    try:
        with zipfile.ZipFile(io.BytesIO(read_bytes(path))) as archive:
            (index,) = (name for name in archive.namelist() if name.endswith("index.csv"))
            root = index.removesuffix("index.csv")
            table = np.loadtxt(io.BytesIO(archive.read(index)), delimiter=",", skiprows=1, ndmin=2)
            rows = [_bounce(row, _track(archive, root, int(row[0]))) for row in table]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise UserError("--data", f"{path}: {error}", "trajectories.zip") from None
    good = np.array([row for row in rows if row is not None])
    speed, out = -good[:, 6], good[:, 9]
    good = good[(good[:, 10] < 0.04) & (out / speed > 0.3) & (out / speed < 1.2)]
    attitude = np.tile([1.0, 0.0, 0.0, 0.0], (len(good), 1))
    nothing = np.full((len(good), 3), np.nan)
    return MeasuredBounces(good[:, 0], attitude, good[:, 4:7], good[:, 1:4], good[:, 7:10], nothing)


def _track(archive: zipfile.ZipFile, root: str, number: int) -> Floats:
    name = f"{root}{number:03d}.csv"
    if name not in archive.namelist():
        return np.empty((0, 4))
    rows = np.genfromtxt(io.BytesIO(archive.read(name)), delimiter=";", ndmin=2)
    track: Floats = rows[np.isfinite(rows).all(axis=1)]
    return track


def _bounce(row: Floats, track: Floats) -> tuple[float, ...] | None:
    """(number, spin, velocity before and after, uncertainty of e) of a track's first bounce."""
    if len(track) < 20:
        return None
    time, place, height = track[:, 0], track[:, 1:], track[:, 3]
    lows = [
        i for i in range(5, len(height) - 5)
        if height[i] == height[max(0, i - 6) : i + 7].min() and height[i] < height.min() + 0.08
    ]  # fmt: skip
    if not lows:
        return None
    i = lows[0]
    first, last = max(0, i - _FRAMES), min(len(height), i + _FRAMES + 1)
    touch = _touch(time - time[i], height, slice(first, i), slice(i + 1, last))
    if touch is None:
        return None
    frame, when = np.arange(len(time)), time - time[i] - touch
    sides = ((when < -1e-3) & (frame >= first), (when > 1e-3) & (frame < last))
    if min(side.sum() for side in sides) < _LEAST:
        return None
    spins = (row[1:4], _SPIN_KEPT * row[1:4])
    arcs = [_arc(when[side], place[side], spin) for side, spin in zip(sides, spins, strict=True)]
    (before, error_in, miss_in), (later, error_out, miss_out) = arcs
    if max(miss_in, miss_out) > 6e-3 or before[2] > -0.3:
        return None
    uncertainty = np.hypot(error_out / before[2], later[2] * error_in / before[2] ** 2)
    return (*row[:4], *before, *later, float(uncertainty))


def _touch(time: Floats, height: Floats, before: slice, later: slice) -> float | None:
    """Time at which the parabolas of both sides meet, s; None if they do not near the lowest frame."""
    difference = np.poly1d(np.polyfit(time[before], height[before], 2))
    difference -= np.poly1d(np.polyfit(time[later], height[later], 2))
    near = []
    for root in difference.roots:
        is_real = abs(root.imag) < 1e-9
        if is_real and abs(root.real) < 0.012:  # s, of the lowest frame
            near.append(root.real)
    return min(near, key=abs, default=None)


def _arc(time: Floats, place: Floats, spin: Floats) -> tuple[Floats, float, float]:
    """Velocity at time 0, standard uncertainty of its height's rate, and rms of what the arc leaves, m."""

    def left(u: Floats) -> Floats:
        velocity, speed = u[3:], float(np.linalg.norm(u[3:]))
        force = -_DRAG * speed * velocity + _LIFT * np.cross(spin, velocity) - [0.0, 0.0, GRAVITY]
        change = speed * force + velocity * float(velocity @ force) / max(speed, 1e-9)
        jerk = -_DRAG * change + _LIFT * np.cross(spin, force)
        powers = np.stack([np.ones_like(time), time, time**2 / 2.0, time**3 / 6.0], axis=1)
        missed: Floats = (powers @ np.stack([u[:3], velocity, force, jerk]) - place).ravel()
        return missed

    start = np.polyfit(time, place, 2)
    fitted: Any = least_squares(left, np.r_[start[2], start[1]], loss="soft_l1", f_scale=3e-3)
    size = len(fitted.fun)
    mean = float(np.mean(fitted.fun**2))
    covariance = np.linalg.inv(fitted.jac.T @ fitted.jac) * mean * size / (size - 6)
    return fitted.x[3:], float(np.sqrt(covariance[5, 5])), float(np.sqrt(mean))


def outcome(
    module: TossModule, setting: ContactSetting, values: tuple[float, ...], bounces: MeasuredBounces
) -> SettingErrors:
    """Errors of the normal speed after, m/s."""
    later, _ = bounced(module, setting, values, body(), bounces, TIMESTEP, DURATION)
    return _judged(bounces, later)


def rigid(bounces: MeasuredBounces, e: float, friction: float) -> SettingErrors:
    """Errors of a rigid ball with a constant e and Coulomb's friction."""
    lever = np.cross(bounces.spin, [0.0, 0.0, -RADIUS])[:, :2]
    slip = bounces.velocity[:, :2] + lever
    speed = np.linalg.norm(slip, axis=1)
    push = (1.0 + e) * -bounces.velocity[:, 2]
    stick = speed / (1.0 + MASS * RADIUS**2 / INERTIA)
    later = bounces.velocity * [1.0, 1.0, -e]
    later[:, :2] -= slip * (np.minimum(friction * push, stick) / np.maximum(speed, 1e-9))[:, None]
    return _judged(bounces, later)


def _judged(bounces: MeasuredBounces, later: Floats) -> SettingErrors:
    away = np.abs(later - bounces.velocity_after)[:, 2]
    return SettingErrors(away, away)
