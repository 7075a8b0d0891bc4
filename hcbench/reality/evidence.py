"""Evidence in the data besides scores, and lower bounds on the error of any setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hcbench.reality import ball, ellipse
from hcbench.reality.data_sets import Cell
from hcbench.reality.impacts import POSITION_NOISE, ROTATION_NOISE, ImpactRead
from hcbench.reality.motion import (
    MOST_FLIGHT,
    Motion,
    SettingErrors,
    Tosses,
    least,
    quaternions,
    rotation,
)
from hcbench.sim.toss import Toss
from hcbench.terms.impact import Floats

# Evidence in the data besides scores: e over speed by each set's own reading, effects of
# corrections.

# Noise of the ellipse's speeds before an impact, m/s: the residuals of a free impulse imply it.
ELLIPSE_NOISE = 0.09
# Words for what was read: the cube's tosses, and their twins, before the name of the twins' law.
MEASURED = "cube, measured"
SYNTHETIC = "cube, synthetic: "
# Names of the two laws that twins have.
CONSTANT_E = "constant e"
ALPHA = "alpha"


@dataclass(frozen=True, slots=True)
class Slope:
    """Change of e per m/s of impact speed, with its 95 % interval; and median e of n impacts.

    of: what was read, in words.
    constant: the slope that the same reading returns of a constant e, in words.
    """

    of: str
    n: int
    e: float
    slope: float
    low: float
    high: float
    constant: str


@dataclass(frozen=True, slots=True)
class Switch:
    """Errors on a set with some of its corrections.

    on: names of those that are made, SIGN and LATE.
    errors: in words, by the description of a law.
    """

    on: tuple[str, ...]
    errors: Mapping[str, str]


def good(impacts: Sequence[ImpactRead]) -> list[ImpactRead]:
    """Impacts that end a first flight at one vertex, with a known e."""
    return [impact for impact in impacts if impact.good and impact.order == 0]


def speeds_and_e(impacts: Sequence[ImpactRead]) -> tuple[Floats, Floats]:
    """Impact speeds, m/s, and e of the good impacts."""
    kept = good(impacts)
    speeds = np.array([impact.speed_in for impact in kept])
    return speeds, np.array([impact.e for impact in kept])


def slope_of(name: str, speed: Floats, e: Floats, constant: str) -> Slope:
    """Slope of e over impact speed, s/m, by least squares, with a 95 % interval by bootstrap over
    the impacts. The same numbers give the same interval.

    name: what was read, in words.
    speed, e: m/s and 1, shape (n,).
    constant: the slope that the same reading gives for a constant e, in words.
    """
    generator = np.random.default_rng(0)
    slopes = []
    for _ in range(500):
        drawn = generator.integers(0, len(e), len(e))
        slopes.append(np.polyfit(speed[drawn], e[drawn], 1)[0])
    low, high = np.percentile(slopes, [2.5, 97.5])
    slope = float(np.polyfit(speed, e, 1)[0])
    return Slope(
        of=name,
        n=len(e),
        e=float(np.median(e)),
        slope=slope,
        low=float(low),
        high=float(high),
        constant=constant,
    )


def cube_slopes(
    impacts: Sequence[ImpactRead], twins: Mapping[str, Sequence[ImpactRead]]
) -> list[Slope]:
    """Slopes of e of the cube's tosses, first, and of their twins.

    impacts: read from the tosses.
    twins: read from simulated tosses, by the name of their law; that of CONSTANT_E tells what the
    reading makes of a constant e.
    """
    of_twins = {}
    for law, each in twins.items():
        of_twins[law] = slope_of(f"{SYNTHETIC}{law}", *speeds_and_e(each), "")
    words = "not simulated"
    constant = of_twins.get(CONSTANT_E)
    if constant is not None:
        words = f"{constant.slope:.3f} ({constant.low:.3f} to {constant.high:.3f})"
    return [slope_of(MEASURED, *speeds_and_e(impacts), words), *of_twins.values()]


def ellipse_slope(impacts: ellipse.EllipseImpacts) -> Slope:
    """Slope of e over the normal speed before, s/m, of the ellipse's drops, with its interval.
    Noise in that speed makes a slope of its own, which `constant` of the result names.

    impacts: n planar ones, velocities (x, z, spin) before and after, (n, 3), m/s and rad/s.
    """
    # A row of the contact's Jacobian, `normal`, times a velocity is the contact point's speed, m/s.
    speed = -np.einsum("ij,ij->i", impacts.normal, impacts.before)
    out = np.einsum("ij,ij->i", impacts.normal, impacts.after)
    e = out / speed
    # Noise of variance s² in the speed, the denominator of e, makes about -e/v s²/var(v) of slope.
    alone = -float(np.median(e)) / float(speed.mean()) * ELLIPSE_NOISE**2 / float(speed.var())
    return slope_of(
        "ellipse", speed, e, f"{alone:.3f}, by noise of {ELLIPSE_NOISE} m/s in the speed before"
    )


def ball_slope(bounces: Any) -> Slope:
    """Slope of e of the ball's bounces."""
    speed = -bounces.velocity[:, 2]
    return slope_of("ball", speed, bounces.velocity_after[:, 2] / speed, "0")


# Two corrections of the published data.
SIGN = "sign of the tangential lever"
LATE = "12 ms of gravity in the speed after"


def ellipse_switches(training: Any, judged: Any) -> list[Switch]:
    """Mean errors, m/s, of the rigid law, fitted again, and of the best impulse of each drop, with
    and without two corrections of the data: the sign of a lever (SIGN), and 12 ms of gravity in the
    speeds after (LATE).

    training: `EllipseImpacts` that the law is fitted to.
    judged: those of which errors are given. Both have the sign corrected, as `ellipse.cases` gives
    them.
    """

    def with_corrections(drops: Any, on: tuple[str, ...]) -> Any:
        if SIGN not in on:
            drops = drops.as_published()
        if LATE in on:
            drops = drops.as_original()
        return drops

    switches = []
    for on in ((SIGN,), (), (SIGN, LATE), (LATE,)):
        drops = with_corrections(judged, on)
        e, friction = ellipse.fit_coulomb(with_corrections(training, on))
        law = ellipse.errors(drops, ellipse.coulomb(drops, e, friction)).mean()
        nearest = ellipse.free_impulse(drops).mean()
        errors = {
            f"rigid law with e and friction fitted, here {e:.3f} and {friction:.3f}": f"{law:.3f} m/s",
            "best impulse of each drop that adds no energy": f"{nearest:.3f} m/s",
        }
        switches.append(Switch(on, errors))
    return switches


# Lower bounds on the error of any setting: noise of the data, and laws with more freedom than
# engines.

# The grid of each toss' own e and friction, and which tosses it is run on.
RESTITUTIONS = (0.0, 0.1, 0.2, 0.3, 0.4)
FRICTIONS = (0.1, 0.13, 0.15, 0.16, 0.17, 0.18, 0.19, 0.2, 0.21, 0.23, 0.26)
EVERY = 3
# Names of the rows that are floors, and of the rigid law.
BEST_OF_EACH = "floor: best e and friction of each toss"
NOISE = "floor: noise of the measured start"
FREE_IMPULSE = "floor: free impulse"
RIGID = "rigid law"


def of_friction(cell: Cell) -> SettingErrors:
    """Errors of every third toss, each with that e of RESTITUTIONS whose score is least, at the
    friction of the cell. To be run in a worker process of the cell's engine.

    cell: its setting's first parameter is e; its values are all others.
    """
    tosses = replace(cell.cases, motions=cell.cases.motions[::EVERY])
    return best(
        [tosses.outcome(cell.module, cell.contact, (e, *cell.values)) for e in RESTITUTIONS]
    )


def best(outcomes: list[SettingErrors]) -> SettingErrors:
    """For each toss, the errors of that outcome whose score is least.

    outcomes: errors of the same tosses, with rotations, one for each e that was tried, or for
    each friction.
    """
    pick = np.argmin([outcome.scores for outcome in outcomes], axis=0)

    def chosen(name: str) -> Floats:
        values: Floats = np.choose(pick, [getattr(outcome, name) for outcome in outcomes])
        return values

    return SettingErrors(chosen("errors"), chosen("scores"), chosen("rotations"))


def of_noise(cell: Cell) -> SettingErrors:
    """Errors of a setting against itself, from starts as uncertain as the measured ones: mean
    distances in per cent of the body's width. No setting can be told to be nearer to the data. To
    be run in a worker process of the cell's engine.
    """
    tosses: Tosses = cell.cases
    exact = tosses.simulated(cell.module, cell.contact, cell.values)
    noise = np.random.default_rng(0)
    shaken = replace(tosses, motions=[_shaken(toss, noise) for toss in tosses.motions])
    return tosses.as_simulated(exact).judged(
        shaken.simulated(cell.module, cell.contact, cell.values)
    )


def _shaken(motion: Motion, noise: np.random.Generator) -> Motion:
    """The motion with another start: the measured one plus the noise that a fit of its flight
    leaves.

    noise: draws it, twelve numbers.
    """
    n = min(motion.flight, MOST_FLIGHT)
    lasts = float(motion.time[n - 1] - motion.time[0])
    start = motion.start
    # Standard errors, over the noise of a point, of a line's value at its end, 2/√n, and of its
    # slope, √12/(T √n), of n points evenly over the time T.
    at_end = 2.0 / np.sqrt(n)
    slope = 3.5 / (lasts * np.sqrt(n))
    place = start.position + noise.normal(0.0, POSITION_NOISE * at_end, 3)
    velocity = start.velocity + noise.normal(0.0, POSITION_NOISE * slope, 3)
    spin = start.spin + noise.normal(0.0, ROTATION_NOISE * slope, 3)
    turn = Rotation.from_rotvec(noise.normal(0.0, ROTATION_NOISE * at_end, 3)) * rotation(
        start.quaternion
    )
    return replace(motion, start=Toss(place, quaternions(turn), velocity, spin, start.steps))


def of_ellipse(training: Any, judged: Any) -> dict[str, SettingErrors]:
    """Floors of the ellipse, by name: errors of the velocities after, m/s, of the nearest rigid
    law, of one e and friction for all, and of the nearest impulse of each drop.

    training: `EllipseImpacts` that the law is fitted to.
    judged: those of which errors are given.
    """
    e, friction = ellipse.fit_coulomb(training)
    law = ellipse.errors(judged, ellipse.coulomb(judged, e, friction))
    nearest = ellipse.free_impulse(judged)
    return {RIGID: SettingErrors(law, law), FREE_IMPULSE: SettingErrors(nearest, nearest)}


def of_ball(training: Any, judged: Any) -> dict[str, SettingErrors]:
    """Floor of the ball, by name: errors of the normal speed after, m/s, of the nearest rigid law,
    of one e for all bounces.

    training: `MeasuredBounces` that e is fitted to.
    judged: those of which errors are given.
    """
    friction = ball.FIXED["friction"]

    def mean(u: Floats) -> float:
        return float(ball.rigid(training, float(u[0]), friction).scores.mean())

    (e,), _ = least(mean, np.array([0.9]), 0.05)
    return {RIGID: ball.rigid(judged, float(e), friction)}
