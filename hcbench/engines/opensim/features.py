"""What OpenSim's contact is, for the table of features."""

from hcbench.sim.features import Feature, Features

_SOURCE = "Simbody, HuntCrossleyForce.cpp"
FEATURES = Features(
    law=Feature("Hunt-Crossley with Hertz, as the paper: F = k x^1.5 (1 + 1.5 c x'), c = α", _SOURCE),
    exponent=Feature("1.5", _SOURCE),
    threshold=Feature("none", "measured down to 10 µm/s"),
    licence=Feature("Apache-2.0", "its wheel"),
)
