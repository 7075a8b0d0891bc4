"""The law as a plug-in for PyBullet; its code is in `hcbench.engines.pybullet.plugin`."""

from hcbench.engines.pybullet.plugin.attach import (
    ConstantRestitution,
    Contact,
    Friction,
    HuntCrossley,
    OwnSpeedLaw,
    Restitution,
    Touch,
    attach,
    cup,
    pairs_between,
)

__all__ = [
    "ConstantRestitution",
    "Contact",
    "Friction",
    "HuntCrossley",
    "OwnSpeedLaw",
    "Restitution",
    "Touch",
    "attach",
    "cup",
    "pairs_between",
]
