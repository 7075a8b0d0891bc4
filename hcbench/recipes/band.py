"""The band of impact speeds that every command takes where none is given."""

from __future__ import annotations

import math

from hcbench.terms.units import INCH

# m/s: what Hunt and Crossley's law was fitted over
PAPER = (1.0 * INCH, 20.0 * INCH)
# g h: slower impacts end within the step that finds them, and the body stays down
SLOWEST = 1.6


def default_band(timestep: float, gravity: float) -> tuple[float, float]:
    """Default band of speeds, m/s: the paper's 1 to 20 in/s, cut below the slowest speed at which a
    body can bounce at a step (s) under gravity (m/s²).
    """
    low = max(PAPER[0], _above(SLOWEST * gravity * timestep))
    return low, max(PAPER[1], 4.0 * low)


def _above(speed: float) -> float:
    """The next speed above, in three digits; 0 for 0."""
    if not speed > 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(speed)) - 2)
    return float(f"{unit * (math.floor(speed / unit + 1e-9) + 1):.3g}")


def why_cut(low: float, timestep: float, gravity: float) -> str:
    """Explain why a band begins at `low` m/s; "" if that is the user's or the paper's own speed."""
    if low <= PAPER[0] or low != default_band(timestep, gravity)[0]:
        return ""
    step = f"{1e3 * timestep:.3g} ms"
    return f"The band begins above 1 in/s: below {low:.2g} m/s a {step} step cannot bounce."
