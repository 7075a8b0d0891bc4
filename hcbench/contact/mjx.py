"""The law as a step function of MJX; its code is in `hcbench.engines.mjx.contact`."""

from hcbench.engines.mjx.contact import restitution
from hcbench.laws.restitution import ConstantRestitution, Restitution

__all__ = ["ConstantRestitution", "Restitution", "restitution"]
