"""Measures a pair of the user's own model, in MuJoCo or PyBullet, as the model has it."""

from __future__ import annotations

from hcbench.measure.measure import measure
from hcbench.measure.model import Cause, Measurement, Request, Wanted

__all__ = ["Cause", "Measurement", "Request", "Wanted", "measure"]
