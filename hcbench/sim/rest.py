"""How a body rests on another, off any engine's steps: penetration, drift, vibration, noise of the force."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hcbench.impact import Floats

# A body rests that sinks slower (m/s), lies less deep (of R, or so many m a second of the step), and
# vibrates less (m/s) or less than before.
_SINKING_MAX, _DEPTH_MAX, _DEPTH_STEP, _VIBRATION_MAX, _DECAY_MAX = 1e-5, 1e-3, 0.2, 1e-4, 0.95


@dataclass(frozen=True, slots=True)
class Rest:
    """A body at rest, over the last quarter of the time simulated.

    penetration: the greatest, m. sinking: m/s, > 0 into the plate. drift: along the plate, m/s; NaN where
    that was not measured. vibration: rms rate about the sinking, m/s. decay: vibration over that of the
    quarter before. force_noise: standard deviation of the contact force over its mean; NaN without force.
    """

    penetration: float
    sinking: float
    vibration: float
    decay: float
    force_noise: float = math.nan
    drift: float = math.nan

    def failures(self, radius: float, timestep: float) -> list[str]:
        """What keeps a body of this radius (m) from resting as it should at a step (s); none where it rests.

        It rests when it sinks slower than 1e-5 m/s, is less than 1e-3 R or 0.2 mm a ms of step deep, and its
        vibration is below 1e-4 m/s or dying away.
        """
        if math.isnan(self.penetration):
            return ["it diverges"]
        failures = []
        if not abs(self.sinking) < _SINKING_MAX:
            verb = "sinks" if self.sinking > 0 else "rises"
            failures.append(f"it still {verb} at {abs(self.sinking):.1e} m/s when the test ends")
        if not self.penetration < max(_DEPTH_MAX * radius, _DEPTH_STEP * timestep):
            share = 100 * self.penetration / radius
            failures.append(f"it rests {self.penetration:.1e} m deep, {share:.2g} % of the radius")
        if not (self.vibration < _VIBRATION_MAX or self.decay < _DECAY_MAX):
            failures.append(f"it keeps on moving at {self.vibration:.1e} m/s (rms)")
        return failures


DIVERGED = Rest(math.nan, math.nan, math.nan, math.nan)


def rest_of(
    time: Floats,
    penetration: Floats,
    rate: Floats,
    force: Floats | None = None,
    along: Floats | None = None,
) -> Rest:
    """How a body lies at the end of its path: time (s), penetration (m), rate (m/s), force (N), shape (n,).

    along: its position along the plate, m, shape (n, k).
    """
    if not (np.isfinite(penetration).all() and np.isfinite(rate).all()):
        return DIVERGED
    quarter = len(time) // 4
    before, last = slice(2 * quarter, 3 * quarter), slice(3 * quarter, None)
    sinking = float(np.polyfit(time[last], penetration[last], 1)[0])
    vibration, earlier = (float(np.sqrt(np.mean((rate[part] - sinking) ** 2))) for part in (last, before))
    noise = drift = math.nan
    if force is not None and (mean := float(force[last].mean())) > 0.0:
        noise = float(force[last].std()) / mean
    if along is not None:
        drift = float(np.linalg.norm(np.polyfit(time[last], along[last], 1)[0]))
    decay = vibration / earlier if earlier > 0 else 0.0
    return Rest(float(penetration[last].max()), sinking, vibration, decay, noise, drift)
