"""PhysX without what is named as the cause of a failed case: an adapter of the cases.

The Python of PhysX runs it; the order of ENGINES is that of `CURED` in tests/cases/test_reasons.py.
"""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import sapien  # type: ignore[import-not-found]

ADAPTER = Path(__file__).parents[2] / "hcbench" / "engines" / "physx" / "cases.py"
Best: Any = runpy.run_path(str(ADAPTER))["PhysxBodies"]


class ByPgs(Best):  # type: ignore[misc]
    """PhysX's older solver, whose friction stops at the end of the slip."""

    def configure(self, gravity: list[float]) -> None:
        own = {"bounce_threshold": 0.0, "enable_tgs": False}
        sapien.physx.set_scene_config(gravity=np.array(gravity), **own)


ENGINES = [ByPgs]
