"""What Rapier's contact is, for the table of features."""

from hcbench.sim.features import Feature, Features

FEATURES = Features(
    law=Feature("Newton's e in one step: average of both colliders", "measured, to 3e-7"),
    exponent=Feature("none: rigid", "one step whatever the step"),
    threshold=Feature(
        "none; under gravity what rebounds below 1.3 g h stays", "measured; without gravity down to 0.1 mm/s"
    ),
    licence=Feature("Apache-2.0", "its wheel"),
)
