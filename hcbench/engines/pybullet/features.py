"""What PyBullet's contact is, for the table of features."""

from hcbench.sim.features import Feature, Features

_SOURCE = "Bullet 3, btMultiBodyConstraintSolver.cpp, setupMultiBodyContactConstraint"
FEATURES = Features(
    law=Feature(
        "Newton's e in one step; or F = k x + c v, implicit, by contactStiffness and contactDamping", _SOURCE
    ),
    exponent=Feature("1", _SOURCE),
    threshold=Feature("0.2 m/s unless restitutionVelocityThreshold is set", _SOURCE),
    licence=Feature("zlib", "its wheel"),
)
