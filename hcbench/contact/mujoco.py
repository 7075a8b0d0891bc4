"""The laws as plug-ins for MuJoCo; their code is in `hcbench.engines.mujoco.plugin`."""

from hcbench.engines.mujoco.plugin import (
    ContactAccuracyWarning,
    add_to_spec,
    attach,
    config,
    hertz_stiffness,
    install,
    library,
    load,
)
from hcbench.laws.contact_law import Friction
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import TouchSpeedLaw
from hcbench.laws.restitution import ConstantRestitution, Restitution

__all__ = [
    "ConstantRestitution",
    "ContactAccuracyWarning",
    "Friction",
    "HuntCrossley",
    "Restitution",
    "TouchSpeedLaw",
    "add_to_spec",
    "attach",
    "config",
    "hertz_stiffness",
    "install",
    "library",
    "load",
]
