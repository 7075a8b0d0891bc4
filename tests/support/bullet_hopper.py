"""A robot of a trunk on a foot, and a floor whose top is half a metre up, as URDF; and lines of a
setting, run in a test's own client.
"""

from typing import Any

INERTIA = '<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/>'
ROBOT = (
    '<robot name="hopper"><link name="trunk"><inertial><mass value="2"/>'
    + INERTIA.format(i=0.01)
    + '</inertial><collision><geometry><box size=".2 .2 .1"/></geometry></collision></link>'
    '<link name="foot"><inertial><mass value=".5"/>'
    + INERTIA.format(i=0.001)
    + '</inertial><collision><geometry><box size=".2 .2 .04"/></geometry></collision></link>'
    '<joint name="leg" type="prismatic"><parent link="trunk"/><child link="foot"/>'
    '<origin xyz="0 0 -.2"/><axis xyz="0 0 1"/><limit lower="-.1" upper=".1" effort="400" velocity="9"/>'
    "</joint></robot>"
)
FLOOR = (
    '<robot name="floor"><link name="base"><inertial><mass value="0"/>'
    + INERTIA.format(i=0)
    + '</inertial><collision><geometry><box size="9 9 1"/></geometry></collision></link></robot>'
)


def run_in_client(lines: str, client: Any, **bodies: int) -> None:
    """Run lines of a setting that act on the module `p` in a client of a test's own.

    bodies: numbers of the bodies, by the names that the lines have for them.
    """
    exec(lines.replace("import pybullet as p\n", ""), {"p": client, **bodies})
