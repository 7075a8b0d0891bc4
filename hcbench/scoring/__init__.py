"""Impacts in, scores out: pure functions, no engine, no files.

Two truths are kept apart by name everywhere: `law`, the restitution that eq. (16) delivers, and
`linear`, e = 1 - α v_i of eq. (2). They part ways as α v_i grows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hcbench.laws.force import HuntCrossley
from hcbench.scoring import tally
from hcbench.scoring.tally import (
    CLAIMS,
    SCORE_FIELDS,
    LoopScore,
    Measured,
    Score,
    Tally,
    best_constant,
    fit_alpha,
    loop_area,
    score_loop,
)
from hcbench.terms.arguments import checked
from hcbench.terms.bounds import positive, require
from hcbench.terms.impact import Impact, Launch, Status

__all__ = [
    "CLAIMS",
    "SCORE_FIELDS",
    "LoopScore",
    "Measured",
    "Score",
    "Tally",
    "best_constant",
    "fit_alpha",
    "loop_area",
    "phase_spread",
    "score",
    "score_loop",
]


@checked
def score(impacts: Sequence[Impact], law: HuntCrossley, mass: float) -> Score:
    """Everything there is to say about one setting at one step against one law.

    impacts: one or more, over speeds and phases; a launch is one (speed, phase).
    mass: effective mass, kg.

    Raises UserError for no impacts, and for a mass that is not above 0.
    """
    require("impacts", list(impacts), bool(impacts), "one or more")
    positive("mass", mass, "kg")
    total = Tally(law, mass)
    total.add(_columns(impacts))
    loops = []
    for impact in impacts:
        loop = score_loop(impact, law, mass)
        if loop is not None:
            loops.append(loop)
    total.add_loops(loops)
    return total.score()


def phase_spread(impacts: Sequence[Impact]) -> float:
    """The largest difference in e between launches that differ in phase
    only; NaN with nothing to compare.

    impacts: measured ones: an impact without an e has NaN, which is the difference then.
    """
    columns = _columns(impacts)
    return tally.phase_spread(columns.launch, columns.e)


def _columns(impacts: Sequence[Impact]) -> Measured:
    """Impacts as columns of shape (n,): speeds in m/s, energies lost over the kinetic energy
    before.

    Launches that differ in phase alone share a number. What an impact does not have is NaN.
    """
    count = len(impacts)
    launch = np.zeros(count, dtype=np.int64)
    samples = np.zeros(count, dtype=np.int64)
    parted = np.zeros(count, dtype=bool)
    rested = np.zeros(count, dtype=bool)
    numbers = np.zeros((4, count))
    number_of: dict[Launch, int] = {}
    for i, impact in enumerate(impacts):
        launch[i] = number_of.setdefault(impact.launch.at_any_phase, len(number_of))
        samples[i] = impact.samples
        parted[i] = impact.status is Status.PARTED
        rested[i] = impact.status is Status.RESTED
        numbers[:, i] = (
            impact.launch.speed,
            impact.speed_in,
            impact.restitution,
            impact.energy_lost,
        )
    speed, speed_in, e, energy_lost = numbers
    return Measured(
        speed=speed,
        launch=launch,
        parted=parted,
        rested=rested,
        speed_in=speed_in,
        e=e,
        energy_lost=energy_lost,
        samples=samples,
        gained=any("energy" in impact.reason for impact in impacts),
    )
