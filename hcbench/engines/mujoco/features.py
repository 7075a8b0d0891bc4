"""What MuJoCo's contact is, for the table of features."""

from hcbench.sim.features import Feature, Features

_DOCS = "MuJoCo documentation, Computation: Soft contact model"
FEATURES = Features(
    law=Feature("F = m d (k x + b v), clipped at 0; k, b by solref, d(x) by solimp", _DOCS),
    exponent=Feature("1; d(x) or several pairs give others", _DOCS),
    threshold=Feature("none", "measured down to 1 mm/s"),
    licence=Feature("Apache-2.0", "its wheel"),
)
