"""Measures how a pair of bodies in the user's own model bounces, as the model has it."""

from hcbench.measuring.measure import measure
from hcbench.measuring.measurement import Cause, Measurement, Wanted
from hcbench.sim.model_under_test import Request

__all__ = ["Cause", "Measurement", "Request", "Wanted", "measure"]
