"""Two balls of which one bears the name in a law's config, so that
another model may have it elsewhere.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np


def two_balls(names: tuple[str, str]) -> Any:
    """Two balls over a floor; the one of the name "bouncer" has e = 0.9
    there, the other MuJoCo's contact.
    """
    balls = "".join(
        f'<body name="{name}" pos="{place} 0 .0501"><freejoint/>'
        f'<geom name="{name}" size=".05" mass="1"/></body>'
        for place, name in enumerate(names)
    )
    keys = {"geom1": "bouncer", "geom2": "floor", "restitution": "0.9"}
    config = "".join(f'<config key="{key}" value="{value}"/>' for key, value in keys.items())
    return mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.002"/><extension><plugin plugin="hcbench.restitution">'
        f'<instance name="law">{config}</instance></plugin></extension>'
        f'<worldbody><geom name="floor" type="plane" size="1 1 1"/>{balls}</worldbody></mujoco>'
    )


def at_the_floor(model: Any, data: Any) -> None:
    """Both balls just above the floor, down at 1 m/s."""
    mujoco.mj_resetData(model, data)
    data.qvel[[2, 8]] = -1.0


def parting_speeds(velocities: Any) -> Any:
    """Largest speed upwards of each ball, m/s, from velocities of shape (steps, 12)."""
    return np.max(velocities[:, [2, 8]], axis=0)
