"""The law as a plug-in for PyBullet; its code is in `hcbench.engines.pybullet.plugin`."""

from hcbench.engines.pybullet.plugin.attach import AttachedLaw as Contact
from hcbench.engines.pybullet.plugin.attach import attach, cup
from hcbench.engines.pybullet.plugin.pairs import pairs_between
from hcbench.engines.pybullet.plugin.solve import ContactPoint as Touch
from hcbench.laws.contact_law import Friction
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import OwnSpeedLaw, TouchSpeedLaw
from hcbench.laws.restitution import ConstantRestitution, Restitution

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
