"""What Drake's contact is, for the table of features."""

from hcbench.sim.features import Feature, Features

_DOCS = "Drake documentation, Modeling Compliant Contact"
FEATURES = Features(
    law=Feature("F = k x (1 + d v), clipped at 0, d = 1.5 α; a discrete plant by implicit Euler", _DOCS),
    exponent=Feature("1 (point contact); about 2 (hydroelastic)", _DOCS),
    threshold=Feature("none", "measured down to 10 µm/s"),
    licence=Feature("BSD-3-Clause", "its wheel"),
)
