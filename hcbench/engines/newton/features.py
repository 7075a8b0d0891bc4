"""What Newton's contact is, for the table of features."""

from hcbench.sim.features import Feature, Features

FEATURES = Features(
    law=Feature("XPBD: Newton's e in one step; SemiImplicit: F = ke x + kd v in, ke x out", "measured"),
    exponent=Feature("XPBD none: rigid; SemiImplicit 1", "measured"),
    threshold=Feature("2 g h by XPBD under gravity", "measured"),
    licence=Feature("Apache-2.0", "its wheel"),
)
