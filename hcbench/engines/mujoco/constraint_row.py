"""MuJoCo's contact rows as one equation: what ball and plate feel along their normal, to round-off.

A row is one constraint between the two bodies: a contact pair, or a tendon's limit. Per unit effective mass,
of impedance d(r) at its own depth r = x - onset, it wants the acceleration

    a_ref = S d(r)/dw² r + D/dw v        (apart > 0; x penetration, v its rate; solref "-S -D")

and weighs w = d/(1 - d). Together they give a = Σ w_i a_ref,i / (1 + Σ w_i) over the rows that act: a row
acts from its onset on and, unless it has adhesion, only while it pushes, a_ref,i > a. Formulas from MuJoCo's
documentation, chapters Modeling (solver parameters) and Computation (constraint model).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.impact import Floats

# MuJoCo clamps impedances to this range.
SOFTEST, STIFFEST = 1e-4, 0.9999
# A power law over the whole width: MuJoCo's spline is (r/width)^power up to the midpoint.
POWER_LAW = 0.9999


@dataclass(frozen=True, slots=True)
class Row:
    """One row. stiffness S, 1/s², and damping D, 1/s, of solref; solimp: (d0, dw, width m, midpoint, power);
    onset: penetration from which it acts, m; adhesion: largest pull, N.
    """

    stiffness: float
    damping: float
    solimp: tuple[float, float, float, float, float]
    onset: float = 0.0
    adhesion: float = 0.0

    def option(self) -> dict[str, Any]:
        """As a MuJoCo setting writes it."""
        return {
            "solref": [-float(self.stiffness), -float(self.damping)],
            "solimp": [float(number) for number in self.solimp],
            "onset": float(self.onset),
            "adhesion": float(self.adhesion),
        }


def impedance(solimp: Sequence[float], depth: Floats) -> Floats:
    """d at a depth below the onset (m), same shape."""
    d0, dw, width, midpoint, power = solimp
    u = np.clip(depth / width, 0.0, 1.0)
    if power == 1.0:
        y = u
    else:
        rising = u**power / midpoint ** (power - 1.0)
        y = np.where(u <= midpoint, rising, 1.0 - (1.0 - u) ** power / (1.0 - midpoint) ** (power - 1.0))
    return np.asarray(d0 + (dw - d0) * y)


def weight(solimp: Sequence[float], depth: Floats) -> Floats:
    """d/(1 - d) at a depth below the onset (m), 0 above it; same shape."""
    d = impedance(solimp, depth)
    return np.where(depth > 0.0, d / (1.0 - d), 0.0)


def acceleration(rows: Sequence[Row], x: Floats, v: Floats) -> Floats:
    """Acceleration apart, m/s², at penetrations (m) and rates (m/s) of the same shape."""
    wants, weights = [], []
    for row in rows:
        depth, dw = x - row.onset, row.solimp[1]
        stiffness = row.stiffness * impedance(row.solimp, depth) / dw**2
        wants.append(stiffness * depth + row.damping / dw * v)
        weights.append(weight(row.solimp, depth))
    want, w = np.stack(wants), np.stack(weights)
    pushes_only = np.array([row.adhesion == 0.0 for row in rows]).reshape(-1, *[1] * np.ndim(x))
    while True:
        a = (w * want).sum(axis=0) / (1.0 + w.sum(axis=0))
        # Letting go of a row that pulls raises a: a row once let go never comes back.
        pulls = pushes_only & (want < a) & (w > 0.0)
        if not pulls.any():
            return np.asarray(a)
        w = np.where(pulls, 0.0, w)


def restitution(rows: Sequence[Row], timestep: float, speeds: Floats, phases: int, duration: float) -> Floats:
    """e under MuJoCo's Euler step, v+ = v - h a, x+ = x + h v+; shape (speeds, phases), NaN if still closed.

    speeds: m/s, shape (n,). phases: where in a step the touch falls, so many, evenly. duration: s.
    """
    phase = (np.arange(phases) + 0.5) / phases
    v_i, before = (grid.copy() for grid in np.meshgrid(speeds, phase, indexing="ij"))
    x, v = -before * timestep * v_i, v_i.copy()
    for _ in range(int(duration / timestep) + 2):
        v = v - timestep * acceleration(rows, x, v)
        x = x + timestep * v
    return np.where((x <= 0.0) & (v < 0.0), -v / v_i, np.nan)
