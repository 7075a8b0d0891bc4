"""The laws as a plug-in for PyBullet; their code is in `hcbench.engines.pybullet.plugin`."""

from hcbench.engines.pybullet.plugin import add, command, force, library, load, remove
from hcbench.laws.contact_law import Friction
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import TouchSpeedLaw
from hcbench.laws.restitution import ConstantRestitution, Restitution

__all__ = [
    "ConstantRestitution",
    "Friction",
    "HuntCrossley",
    "Restitution",
    "TouchSpeedLaw",
    "add",
    "command",
    "force",
    "library",
    "load",
    "remove",
]
