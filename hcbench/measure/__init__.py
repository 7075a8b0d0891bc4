"""Measures how a pair of bodies in the user's own model bounces, as the model has it."""

import sys
from types import ModuleType

from hcbench.measure.measure import measure
from hcbench.measure.measurement import Cause, Measurement, Wanted
from hcbench.sim.model_under_test import Request

__all__ = ["Cause", "Measurement", "Request", "Wanted", "measure"]


class _CallablePackage(ModuleType):
    """`hcbench.measure(...)` is `hcbench.measure.measure(...)`: the package has the verb's name."""

    __call__ = staticmethod(measure)


sys.modules[__name__].__class__ = _CallablePackage
