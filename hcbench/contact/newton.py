"""The law as a step of Newton's SolverMuJoCo; its code is in `hcbench.engines.newton.contact`."""

from hcbench.engines.newton.contact import restitution
from hcbench.laws.restitution import ConstantRestitution, Restitution

__all__ = ["ConstantRestitution", "Restitution", "restitution"]
