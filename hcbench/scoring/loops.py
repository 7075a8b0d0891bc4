"""Comparison of an impact's force loop with the law's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.terms.impact import Floats, Impact, Loop, Status
from hcbench.terms.resolution import STEPS_TO_COMPARE

_REFERENCE_POINTS = 2001


@dataclass(frozen=True, slots=True)
class LoopScore:
    """One loop against the law's loop at the same impact speed; ratios are engine / law.

    rms: distance in force at equal penetration and branch, root mean square over the loop's path in x, over
        the law's largest force. touch_force, parting_force: the force at x = 0 that the first and last two
        samples point to, over the largest. tension_share: the share of the impulse that pulls.
    """

    rms: float
    area_ratio: float
    force_ratio: float
    penetration_ratio: float
    duration_ratio: float
    touch_force: float
    parting_force: float
    tension_share: float
    samples: int


# All settings are launched at the same few speeds.
@lru_cache(maxsize=64)
def _law_loop(law: HuntCrossley, mass: float, speed: float) -> Loop:
    return closed_form.loop(law, mass, speed, _REFERENCE_POINTS)


def score_loop(impact: Impact, law: HuntCrossley, mass: float) -> LoopScore | None:
    """Compare one impact's loop with the law's at the same speed; None unless it parted with a
    resolved loop.
    """
    loop = impact.loop
    if loop is None or impact.status is not Status.PARTED or impact.samples < STEPS_TO_COMPARE:
        return None
    speed = impact.speed_in
    truth = _law_loop(law, mass, speed)
    law_force_max = float(closed_form.force_max(law, mass, speed))
    force = loop.force
    largest = float(force.max())
    impulse = np.abs(force).sum()
    area_ratio = math.nan
    # A law without damping encloses no area.
    if law.alpha > 0:
        area_ratio = loop_area(loop) / float(closed_form.energy_loss(law, mass, speed))
    return LoopScore(
        rms=_force_distance(loop, truth) / law_force_max,
        area_ratio=area_ratio,
        force_ratio=largest / law_force_max,
        penetration_ratio=impact.penetration_max
        / float(closed_form.penetration_max(law, mass, speed)),
        duration_ratio=impact.duration / float(closed_form.duration(law, mass, speed)),
        touch_force=abs(_at_surface(loop.penetration[:2], force[:2])) / largest,
        parting_force=abs(_at_surface(loop.penetration[-2:], force[-2:])) / largest,
        tension_share=float(-force[force < 0].sum() / impulse),
        samples=impact.samples,
    )


def _at_surface(x: Floats, f: Floats) -> float:
    """Force at which the line through two samples meets x = 0, N.

    x: m, f: N, shape (2,).
    """
    if x[1] == x[0]:
        return float(f[0])
    return float(f[0] - x[0] * (f[1] - f[0]) / (x[1] - x[0]))


def loop_area(loop: Loop) -> float:
    """∮ F dx, J: from the surface, by trapezoids, to where the force has gone.

    Before the first sample the force is what the first two point to at x = 0;
    after the last it ends in a step.
    """
    x = loop.penetration
    f = loop.force
    if len(x) < 2:
        return math.nan
    at_touch = float(np.clip(_at_surface(x[:2], f[:2]), 0.0, max(f[0], 0.0)))
    gone = max(0.0, float(x[-1] + loop.rate[-1] * (loop.time[-1] - loop.time[-2])))
    before = (at_touch + float(f[0])) / 2 * float(x[0])
    inside = float(np.sum((f[1:] + f[:-1]) / 2 * np.diff(x)))
    after = float(f[-1]) / 2 * (gone - float(x[-1]))
    return before + inside + after


def _force_distance(loop: Loop, truth: Loop) -> float:
    """Root mean square of F - F_law at equal penetration on the same branch,
    N, weighted by path length in x.

    Past the law's own largest penetration its two branches end in one point, whose force stands in.
    """
    x = loop.penetration
    top = int(x.argmax())
    law_x = truth.penetration
    law_top = int(law_x.argmax())
    going_in = np.interp(x, law_x[: law_top + 1], truth.force[: law_top + 1])
    # Reversed, as `interp` takes x that rise.
    coming_out = np.interp(x, law_x[law_top:][::-1], truth.force[law_top:][::-1])
    wrong = loop.force - np.where(np.arange(len(x)) <= top, going_in, coming_out)
    weight = np.abs(np.gradient(x))
    return math.sqrt(float(np.sum(wrong**2 * weight) / np.sum(weight)))
