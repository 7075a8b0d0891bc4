"""The law as a step function of MuJoCo Warp; its code is in `hcbench.engines.mujoco_warp.contact`."""

from hcbench.engines.mujoco_warp.contact import restitution
from hcbench.laws.restitution import ConstantRestitution, Restitution

__all__ = ["ConstantRestitution", "Restitution", "restitution"]
