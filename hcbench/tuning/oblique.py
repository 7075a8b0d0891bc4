"""Oblique launches that a setting is judged by, and how far its friction is from Coulomb's law."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from hcbench.laws.coulomb import friction_impulse
from hcbench.terms.impact import Launch

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.recipes.target import Target
    from hcbench.terms.impact import Impact
    from hcbench.terms.scene import Scene

SPEEDS, PHASES = 4, (0.12, 0.37, 0.62, 0.87)
# (slip m/s, spin rad/s): slow to fast sliding, backspin and topspin, and all at once out of the plane.
MOTIONS = (
    ((0.1, 0.0), (0.0, 0.0, 0.0)),
    ((0.5, 0.0), (0.0, 0.0, 0.0)),
    ((2.0, 0.0), (0.0, 0.0, 0.0)),
    ((3.0, 0.0), (0.0, 0.0, 0.0)),
    ((0.0, 0.0), (0.0, 40.0, 0.0)),
    ((1.0, 0.0), (0.0, -40.0, 0.0)),
    ((0.7, -0.4), (25.0, 10.0, 30.0)),
)


def oblique_launches(target: Target) -> list[Launch]:
    """Launches over the target's band: each speed and phase with each of MOTIONS."""
    speeds = np.geomspace(target.speed_min, target.speed_max, SPEEDS).tolist()
    return [
        Launch(v, phase, slip=slip, spin=spin)
        for v, phase, (slip, spin) in itertools.product(speeds, PHASES, MOTIONS)
    ]


def friction_error(impacts: Sequence[Impact], scene: Scene) -> float:
    """Largest distance of friction's impulse from Coulomb's law over μ J_n, sliding's; NaN for none."""
    errors = []
    for impact in impacts:
        along = impact.tangential if impact.is_measured else None
        if along is None:
            continue
        sliding = scene.friction * along.normal_impulse  # the impulse of a contact that slides, N s
        if sliding > 0.0:
            by_law = friction_impulse(along.slip_in, along.normal_impulse, scene)
            errors.append(math.dist(along.impulse, by_law) / sliding)
    return max(errors, default=math.nan)
