"""Impacts in, scores out: pure functions, no engine, no files.

Two truths are kept apart by name everywhere: `law`, the restitution that eq. (16) delivers, and
`linear`, e = 1 - α v_i of eq. (2). They part ways as α v_i grows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hcbench.laws.force import HuntCrossley
from hcbench.laws.require import positive, require
from hcbench.scoring import tally
from hcbench.scoring.loops import LoopScore, loop_area, score_loop
from hcbench.scoring.tally import (
    CLAIMS,
    SCORE_FIELDS,
    Measured,
    Score,
    Tally,
    best_constant,
    fit_alpha,
)
from hcbench.terms.arguments import checked
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
    """
    require("impacts", list(impacts), bool(impacts), "one or more")
    positive("mass", mass, "kg")
    total = Tally(law, mass)
    loops = (score_loop(impact, law, mass) for impact in impacts)
    total.add(_columns(impacts))
    total.add_loops(loop for loop in loops if loop is not None)
    return total.score()


def phase_spread(impacts: Sequence[Impact]) -> float:
    """The largest difference in e between launches that differ in phase
    only; NaN with nothing to compare.
    """
    columns = _columns(impacts)
    return tally.phase_spread(columns.launch, columns.e)


def _columns(impacts: Sequence[Impact]) -> Measured:
    """Impacts as columns of shape (n,): speeds in m/s, energies lost over the kinetic energy
    before.

    Launches that differ in phase alone share a number.
    """
    numbers: dict[Launch, int] = {}
    launch = []
    for impact in impacts:
        at_any_phase = impact.launch.at_any_phase
        launch.append(numbers.setdefault(at_any_phase, len(numbers)))
    return Measured(
        speed=np.array([i.launch.speed for i in impacts]),
        launch=np.array(launch),
        parted=np.array([i.status is Status.PARTED for i in impacts]),
        rested=np.array([i.status is Status.RESTED for i in impacts]),
        speed_in=np.array([i.speed_in for i in impacts]),
        e=np.array([i.restitution for i in impacts]),
        energy_lost=np.array([i.energy_lost for i in impacts]),
        samples=np.array([i.samples for i in impacts], dtype=np.int64),
        gained=any("energy" in i.reason for i in impacts),
    )
