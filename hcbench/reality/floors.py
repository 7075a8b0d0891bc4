"""Lower bounds on the error of any setting: noise of the data, and laws with more freedom than
engines.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hcbench.reality import ball, ellipse
from hcbench.reality.cells import Cell
from hcbench.reality.impacts import POSITION_NOISE, ROTATION_NOISE
from hcbench.reality.motion import MOST_FLIGHT, Motion, Tosses, quaternions, rotation
from hcbench.reality.outcome import SettingErrors
from hcbench.reality.search import least
from hcbench.sim.toss import Toss
from hcbench.terms.impact import Floats

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
    """Best e of each toss at the friction of the cell, of every third toss; in a worker process."""
    tosses = replace(cell.cases, motions=cell.cases.motions[::EVERY])
    return best(
        [tosses.outcome(cell.module, cell.contact, (e, *cell.values)) for e in RESTITUTIONS]
    )


def best(outcomes: list[SettingErrors]) -> SettingErrors:
    """For each toss, the errors of the outcome with the best score.

    outcomes: errors of all tosses, one for each point of the floor's grid.
    """
    pick = np.argmin([each.scores for each in outcomes], axis=0)

    def chosen(name: str) -> Floats:
        values: Floats = np.choose(pick, [getattr(each, name) for each in outcomes])
        return values

    return SettingErrors(chosen("errors"), chosen("scores"), chosen("rotations"))


def of_noise(cell: Cell) -> SettingErrors:
    """A setting against itself, from starts as uncertain as the measured ones; in a worker process."""
    tosses: Tosses = cell.cases
    exact = tosses.simulated(cell.module, cell.contact, cell.values)
    noise = np.random.default_rng(0)
    shaken = replace(tosses, motions=[_shaken(each, noise) for each in tosses.motions])
    return tosses.as_simulated(exact).judged(
        shaken.simulated(cell.module, cell.contact, cell.values)
    )


def _shaken(motion: Motion, noise: np.random.Generator) -> Motion:
    """The motion with another start: the measured one plus the noise that a fit of its flight
    leaves.
    """
    n = min(motion.flight, MOST_FLIGHT)
    lasts = float(motion.time[n - 1] - motion.time[0])
    start = motion.start
    # Standard errors of a line's value at its end and of its slope, of n points.
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
    """The nearest rigid law, of one e and friction for all, and the nearest impulse of each drop."""
    e, friction = ellipse.fit_coulomb(training)
    law = ellipse.errors(judged, ellipse.coulomb(judged, e, friction))
    nearest = ellipse.free_impulse(judged)
    return {RIGID: SettingErrors(law, law), FREE_IMPULSE: SettingErrors(nearest, nearest)}


def of_ball(training: Any, judged: Any) -> dict[str, SettingErrors]:
    """The nearest rigid law, of one e for all bounces."""
    friction = ball.FIXED["friction"]

    def mean(u: Floats) -> float:
        return float(ball.rigid(training, float(u[0]), friction).scores.mean())

    (e,), _ = least(mean, np.array([0.9]), 0.05)
    return {RIGID: ball.rigid(judged, float(e), friction)}
