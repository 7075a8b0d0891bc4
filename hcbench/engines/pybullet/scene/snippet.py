"""A PyBullet setting as its user writes it: calls to paste, and a script that runs by itself."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from hcbench.engines.pybullet import plugin
from hcbench.laws.contact_law import law_of
from hcbench.system.errors import SceneError, SettingError
from hcbench.system.text import arguments, shortest
from hcbench.terms.setting import PAIR, Pair

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hcbench.engines.pybullet.scene.options import LinkOptions
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# The URDF of a ball of several spheres, each with its own contact_stiffness and contact_damping.

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


def snippet(setting: Setting, form: str = "plane", pair: Pair = PAIR) -> str:
    """Return the lines to paste into a script in which `pair` are the two
    bodies; see `Engine.snippet`.
    """
    if not {"world", "ball", "plate", "law", "links"} & set(setting.options):
        return setting.options_text
    head = ["import pybullet"]
    if setting.options.get("links"):
        head += [_OWN_BALL.format(*pair)]
    if setting.options.get("maximal_coordinates"):
        head += [_MAXIMAL.format(*pair)]
    if "law" in setting.options:
        head.insert(1, "from hcbench.contact import pybullet as contact\n")
    text = "\n".join([*head, _calls(setting, pair, {}, "str(contact.library())")])
    return f"{text}\n{_CUP}" if form == "cup" and "law" in setting.options else text


def script(scene: Scene, setting: Setting) -> str:
    """A Python script that drops the ball on a plane at several speeds, and prints e.

    Raises SettingError for a cup, and for a setting that is none of
    Bullet's own contact or a plug-in.
    """
    if scene.form != "plane" or not {"world", "ball", "law"} & set(setting.options):
        given = f"pybullet {setting.name!r} in the form {scene.form!r}"
        expected = "a setting of Bullet's own contact or a plug-in, in the form 'plane'"
        raise SettingError("write-scene", given, expected)
    radius = shortest(scene.relative_radius)
    mass = shortest(scene.mass)
    maximal = ", useMaximalCoordinates=True" if setting.options.get("maximal_coordinates") else ""
    sphere = f"pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius={radius})"
    plane = "pybullet.createCollisionShape(pybullet.GEOM_PLANE)"
    made = {
        "ball": f"createMultiBody({mass}, {sphere}, basePosition=[0, 0, {radius}]{maximal})",
        "plate": f"createMultiBody(0, {plane}{maximal})",
    }
    has_law = "law" in setting.options
    library = repr(str(plugin.library())) if has_law else ""
    setup = _calls(setting, PAIR, made, library)
    if setting.options.get("links"):
        inertia = shortest(scene.inertia)
        friction = shortest(scene.friction)
        of_ball = f"radius, mass, inertia = {radius}, {mass}, {inertia}"
        setup = f"{of_ball}\nfriction = {friction}\n{setup}"
    if has_law:
        setup = f"{_LIBRARY}\n{setup}"
    return _SCRIPT.format(setup=setup, step=shortest(setting.timestep), radius=radius)


def _calls(setting: Setting, pair: Pair, made: Mapping[str, str], path: str) -> str:
    """The calls, in the order that works.

    pair: the variables of the two bodies.

    made: the calls that make them, by ball and plate; none of those that exist already.
    path: of the plug-in, as an expression.
    """
    options = setting.options
    names = dict(zip(PAIR, pair, strict=True))
    world = {"fixedTimeStep": setting.timestep, **options.get("world", {})}
    before: list[str] = []
    made = dict(made)
    calls = {}
    for body, name in names.items():
        if options.get(body):
            given = arguments(options[body])
            calls[body] = f"pybullet.changeDynamics({name}, -1, {given})"
    links = options.get("links")
    if links:
        rows = ""
        for link in links:
            rows += f"    ({link['onset']!r}, {link['stiffness']!r}, {link['damping']!r}),\n"
        write = WRITE.replace('"ball.urdf"', f'"{pair[0]}.urdf"')
        before = [
            f"LINK = {LINK!r}",
            f"JOINT = {JOINT!r}",
            f"links = [  # start, k, c\n{rows}]",
            write,
        ]
        made["ball"] = f'loadURDF("{pair[0]}.urdf", flags=pybullet.URDF_USE_INERTIA_FROM_FILE)'
        each = calls["ball"].replace("-1", "link")
        calls["ball"] = f"for link in range(-1, {len(links) - 1}):\n    {each}"
    lines = [f"pybullet.setPhysicsEngineParameter({arguments(world)})", *before]
    for body, call in made.items():
        lines.append(f"{names[body]} = pybullet.{call}")
    lines += calls.values()
    if "law" in options:
        law = json.dumps(plugin.command(law_of(options["law"])))
        lines.append(f"plugin = pybullet.loadPlugin({path})")
        lines.append(
            f"pybullet.executePluginCommand(plugin, {law}, [{pair[0]}, -1, {pair[1]}, -1])"
        )
    return "\n".join(lines)


_OWN_BALL = "# radius, mass, inertia and friction: of {0}; friction 0 for none"
_MAXIMAL = "# {0} and {1} were loaded with useMaximalCoordinates=True"
_CUP = "# with cup=RADIUS,X,Y,Z as well: the cup's, and its centre in the frame of the plate"

_LIBRARY = """# loadPlugin gets the library that hcbench compiled on this machine. Elsewhere, run
# `hcbench plugin pybullet` and write the path that it prints in its place."""

_SCRIPT = '''"""A ball dropped on a plane in PyBullet: prints restitution against impact speed (m/s)."""

import pybullet

pybullet.connect(pybullet.DIRECT)
{setup}

for speed in (0.05, 0.1, 0.2, 0.3, 0.4, 0.5):
    start = [0, 0, {radius} + 2.5 * {step} * speed]
    pybullet.resetBasePositionAndOrientation(ball, start, [0, 0, 0, 1])
    pybullet.resetBaseVelocity(ball, [0, 0, -speed], [0, 0, 0])
    touched = False
    for _ in range(100000):
        pybullet.stepSimulation()
        up = pybullet.getBaseVelocity(ball)[0][2]
        touched = touched or up > -0.999 * speed
        height = pybullet.getBasePositionAndOrientation(ball)[0][2]
        if touched and up > 0 and height > {radius} + 2 * {step} * up:
            break
    print(speed, up / speed)
'''
