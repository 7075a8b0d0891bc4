"""What DART's contact is, for the table of features."""

from hcbench.sim.features import Feature, Features

FEATURES = Features(
    law=Feature("Newton's e in one step: e of both shapes multiplied", "measured, to 1e-14"),
    exponent=Feature("none: rigid", "one step whatever the step"),
    threshold=Feature("e v of 0.1 units of length a second; nothing faster than 100", "measured, to 1e-13"),
    licence=Feature("BSD-2-Clause", "its wheel"),
)
