"""What Newton's contact is, for the table of features."""

from hcbench.sim.features import Feature, Features

FEATURES = Features(
    law=Feature("XPBD: an e in one step; SemiImplicit: ke x + kd v in, ke x out; MuJoCo's", "measured"),
    exponent=Feature("XPBD none: rigid; SemiImplicit 1; MuJoCo's solver as MuJoCo", "measured"),
    threshold=Feature("2 g h by XPBD under gravity", "measured"),
    licence=Feature("Apache-2.0", "its wheel"),
)
