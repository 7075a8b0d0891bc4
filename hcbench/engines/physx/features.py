"""What PhysX's contact is, for the table of features."""

from hcbench.sim.features import Feature, Features

_SOURCE = "PhysX SDK 5 documentation, Rigid Body Collision: Restitution"
FEATURES = Features(
    law=Feature("an impulse by Newton's e in one step; a negative e is a spring, F = k x", _SOURCE),
    exponent=Feature("none: rigid", _SOURCE),
    threshold=Feature(
        "bounce_threshold, 2 m/s in SAPIEN; set before the system is made, 0 is taken", "measured to 0.5 %"
    ),
    licence=Feature("MIT (SAPIEN), BSD-3-Clause (PhysX)", "its wheel"),
)
