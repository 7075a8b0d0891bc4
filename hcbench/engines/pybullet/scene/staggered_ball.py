"""The URDF of a ball of several spheres, each with its own contact_stiffness and contact_damping."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hcbench.system.errors import SceneError, SettingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.pybullet.scene.options import LinkOptions
    from hcbench.terms.scene import Scene

LINK = (
    '<link name="link{i}"><contact><lateral_friction value="{friction}"/><stiffness value="{stiffness!r}"/>'
    '<damping value="{damping!r}"/></contact><inertial><mass value="{mass!r}"/><inertia ixx="{inertia!r}"'
    ' iyy="{inertia!r}" izz="{inertia!r}" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry>'
    '<sphere radius="{radius!r}"/></geometry></collision></link>\n'
)
JOINT = (
    '<joint name="joint{i}" type="fixed"><parent link="link0"/><child link="link{i}"/></joint>\n'
)
# The same as lines of a script that knows `radius`, `mass`, `inertia` and `friction`.
WRITE = """with open("ball.urdf", "w") as file:
    file.write('<robot name="ball">')
    for i, (onset, stiffness, damping) in enumerate(links):
        own = (mass, inertia) if i == 0 else (0.0, 0.0)
        numbers = {"radius": radius - onset, "mass": own[0], "inertia": own[1], "friction": friction}
        file.write(LINK.format(i=i, stiffness=stiffness, damping=damping, **numbers))
        file.write(JOINT.format(i=i) if i else "")
    file.write("</robot>")"""


def ball_urdf(scene: Scene, links: Sequence[LinkOptions]) -> str:
    """URDF of a scene's ball with links.

    SettingError in a cup, SceneError for links larger than it.
    """
    radius = scene.relative_radius
    if scene.form != "plane":
        raise SettingError(
            "pybullet option 'links'", f"in the form {scene.form!r}", "the form 'plane'"
        )
    deepest = max(link.onset for link in links)
    if deepest >= radius:
        got = f"a ball of {radius:g} m, which the contact would enter by {deepest:.2g} m"
        raise SceneError(f"scene {scene.name!r}", got, "a larger ball, or a shorter step")
    text = ""
    for i, link in enumerate(links):
        mass = 0.0
        inertia = 0.0
        # The first link is the base, which has all the mass.
        if i == 0:
            mass = scene.mass
            inertia = scene.inertia
        numbers = {"radius": radius - link.onset, "mass": mass, "inertia": inertia, "friction": 0.0}
        text += LINK.format(i=i, stiffness=link.stiffness, damping=link.damping, **numbers)
        if i > 0:
            text += JOINT.format(i=i)
    return f'<robot name="ball">\n{text}</robot>\n'
