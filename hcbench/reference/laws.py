"""Earlier name of `hcbench.laws.force`: `from hcbench.reference.laws import HuntCrossley` keeps working."""

from hcbench.laws.force import ForceLaw, HuntCrossley, KelvinVoigt

__all__ = ["ForceLaw", "HuntCrossley", "KelvinVoigt"]
