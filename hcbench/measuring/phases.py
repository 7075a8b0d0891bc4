"""At which phases of a time step a pair is launched: as many as it takes to find how far e scatters."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from hcbench.sim import simulate
from hcbench.sim.model_under_test import ModelUnderTest, Request
from hcbench.terms.impact import Impact, Launch
from hcbench.terms.resolution import STEPS_BY_CHANCE, STEPS_WITHOUT_CHANCE

_NARROWEST = 1 / 256  # of a step: two phases nearer than this are not told apart
_SAME_E = 2e-3  # neighbours nearer than this have nothing between them
_SAME_SHARE = 0.2  # of the scatter found so far: the same
_PHASES_MAX = 32  # a speed


def impacts_of(model: ModelUnderTest, request: Request) -> list[Impact]:
    """One for each launch of the request, in order; without given phases, the phases that matter.

    A long contact is launched at one phase, others at those of the request. Where few steps decide, the gap
    between two neighbours that differ is halved until the scatter of e is found.
    """
    if not request.adapt_phases:
        return simulate.impacts_in(model, request.launches())
    sent = itertools.product(request.speeds, request.angle)
    wanted = [replace(request, speeds=(v,), angle=(a,)).launches() for v, a in sent]
    # All speeds together in each round, for engines that take as long for many as for one.
    groups = [[impact] for impact in simulate.impacts_in(model, [launches[0] for launches in wanted])]
    short = [i for i, (impact,) in enumerate(groups) if impact.samples < STEPS_WITHOUT_CHANCE]
    new = {i: wanted[i][1:] for i in short}
    while new:
        impacts = iter(simulate.impacts_in(model, list(itertools.chain.from_iterable(new.values()))))
        for i, launches in new.items():
            groups[i] = sorted(
                [*groups[i], *itertools.islice(impacts, len(launches))],
                key=lambda impact: impact.launch.phase,
            )
        new = {i: launches for i in new if (launches := _between(groups[i]))}
    return list(itertools.chain.from_iterable(groups))


def _between(impacts: Sequence[Impact]) -> list[Launch]:
    """Launches at phases half-way between neighbours whose e differ, the most different first; none once all
    is known, or where many steps decide. impacts: in the order of their phases.

    The step after the last phase is that of the first again.
    """
    room = _PHASES_MAX - len(impacts)
    if room <= 0 or min(impact.samples for impact in impacts) > STEPS_BY_CHANCE:
        return []
    e = np.array([impact.restitution for impact in impacts])
    scatter = float(np.nanmax(e) - np.nanmin(e)) if np.isfinite(e).any() else 0.0
    phases = [impact.launch.phase for impact in impacts]
    gaps = []
    for (a, one), (b, two) in pairwise([*zip(phases, e, strict=True), (phases[0] + 1.0, e[0])]):
        step = abs(one - two)
        if step > max(_SAME_E, _SAME_SHARE * scatter) and b - a > _NARROWEST:
            gaps.append((step, (a + b) / 2 % 1.0))
    phases = [phase for _, phase in sorted(gaps, key=lambda gap: (-gap[0], gap[1]))]
    return [replace(impacts[0].launch, phase=phase) for phase in phases[:room]]
