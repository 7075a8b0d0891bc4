"""Where a live PyBullet world to be measured is described: `World`, from `hcbench.engines.pybullet`."""

from hcbench.engines.pybullet.user_model import LiveWorld as World

__all__ = ["World"]
