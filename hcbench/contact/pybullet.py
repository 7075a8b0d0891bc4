"""The law as a plug-in for PyBullet; its code is in `hcbench.engines.pybullet.plugin`."""

from hcbench.engines.pybullet.plugin.attach import (
    ConstantRestitution,
    Contact,
    Friction,
    HuntCrossley,
    Restitution,
    Touch,
    TouchSpeedLaw,
    attach,
    cup,
    pairs_between,
)
from hcbench.laws.published import OwnSpeedLaw

__all__ = [
    "ConstantRestitution",
    "Contact",
    "Friction",
    "HuntCrossley",
    "OwnSpeedLaw",
    "Restitution",
    "Touch",
    "TouchSpeedLaw",
    "attach",
    "cup",
    "pairs_between",
]
