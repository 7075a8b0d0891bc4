"""The law as a plug-in for MuJoCo; its code is in `hcbench.engines.mujoco.plugin`."""

from hcbench.engines.mujoco.plugin.attach import (
    ConstantRestitution,
    Contact,
    ContactAccuracyWarning,
    Friction,
    HuntCrossley,
    PythonContactWarning,
    Restitution,
    Touch,
    TouchSpeedLaw,
    attach,
    hertz_stiffness,
    pairs_between,
    pairs_of,
)
from hcbench.laws.published import OwnSpeedLaw

__all__ = [
    "ConstantRestitution",
    "Contact",
    "ContactAccuracyWarning",
    "Friction",
    "HuntCrossley",
    "OwnSpeedLaw",
    "PythonContactWarning",
    "Restitution",
    "Touch",
    "TouchSpeedLaw",
    "attach",
    "hertz_stiffness",
    "pairs_between",
    "pairs_of",
]
