"""What Exudyn's contact is, for the table of features."""

from hcbench.sim.features import Feature, Features

_DOCS = "Exudyn documentation, ObjectContactSphereSphere"
FEATURES = Features(
    law=Feature("F = k x^n (1 + 1.5 (1 - e)/max(v_in, V) v): eq. (16) with V above all speeds", _DOCS),
    exponent=Feature("any", _DOCS),
    threshold=Feature("none", "measured down to 0.1 mm/s"),
    licence=Feature("its own text with the clauses of BSD-3-Clause", "its wheel"),
)
