"""Worlds that the step functions of engines with a law in them are tried on."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

QUADRUPED = Path(__file__).parents[2] / "examples" / "quadruped.xml"
FEET = [f"{side}_{end}_foot" for side in ("left", "right") for end in ("front", "hind")]
WORLD = """<mujoco><option timestep="{timestep}" {option}/><worldbody>
<geom name="floor" type="plane" size="5 5 .1"/><body name="ball" pos="0 0 1"><freejoint/>
<geom name="ball" {shape} density="1000"/></body></worldbody></mujoco>"""
# Shape, and height of its centre where it touches, m.
SHAPES = {
    "sphere": ('size=".05"', 0.05),
    "box": ('type="box" size=".05 .04 .03"', 0.03),
    "capsule": ('size=".03 .05" type="capsule"', 0.08),
}
GRAVITY = 9.81
# Of no other test: m/s, and shares of a step before the touch.
SPEEDS = np.repeat([0.13, 0.41, 1.1, 2.3], 3)
PHASES = np.tile([0.12, 0.47, 0.83], 4)

# Bodies that other things than gravity and motors press, and the pairs that bounce.
PRESSED = {
    # A foot that carries 2 kg through a joint's limit.
    "limit": (
        """<body pos="0 0 .32"><joint type="slide" axis="0 0 1"/>
<geom type="box" size=".1 .1 .05" mass="2" contype="0" conaffinity="0"/><body pos="0 0 -.25">
<joint type="slide" axis="0 0 1" limited="true" range="-.05 .0001"/>
<geom name="foot" size=".05" mass=".3"/></body></body>""",
        [("foot", "floor")],
    ),
    # A ball on a box.
    "stack": (
        """<body pos="0 0 .05"><joint type="slide" axis="0 0 1"/>
<geom name="low" type="box" size=".05 .05 .05" mass="1"/></body>
<body pos="0 0 .2"><joint type="slide" axis="0 0 1"/><geom name="foot" size=".08" mass="1"/></body>""",
        [("low", "foot"), ("low", "floor")],
    ),
    # A spring that would bounce of itself.
    "undamped": (
        """<body pos="0 0 .06"><freejoint/>
<geom name="foot" size=".05" mass=".3" solref="-20000 0" priority="1"/></body>""",
        [("foot", "floor")],
    ),
}


def world(shape: str = "sphere", timestep: float = 1e-3, option: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        WORLD.format(timestep=timestep, option=option, shape=SHAPES[shape][0])
    )
