"""Options of a PyBullet setting, checked strictly, and the calls and scripts that set them."""

from __future__ import annotations

import json
import keyword
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, PlainValidator, StrictBool, ValidationInfo, field_validator

from hcbench.engines.pybullet import plugin
from hcbench.laws.contact_law import Law, law_of
from hcbench.system.errors import SceneError, SettingError
from hcbench.system.text import arguments, shortest
from hcbench.terms.fields import Finite, OptionTable, mistake, validate
from hcbench.terms.setting import PAIR, Pair

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# Options of a PyBullet setting, checked strictly.
#
# PyBullet ignores negative numbers in silence. So what it would drop is refused here, by name, and
# what it would refuse is refused before anything runs.

# Keywords of setPhysicsEngineParameter and of changeDynamics, by the type that PyBullet asks for.
_WORLD: dict[str, type] = {
    "allowedCcdPenetration": float,
    "collisionFilterMode": int,
    "constraintSolverType": int,
    "contactBreakingThreshold": float,
    "contactERP": float,
    "contactSlop": float,
    "deterministicOverlappingPairs": int,
    "enableConeFriction": int,
    "enableSAT": int,
    "erp": float,
    "frictionERP": float,
    "globalCFM": float,
    "minimumSolverIslandSize": int,
    "numNonContactInnerIterations": int,
    "numSolverIterations": int,
    "restitutionVelocityThreshold": float,
    "solverResidualThreshold": float,
    "splitImpulsePenetrationThreshold": float,
    "useSplitImpulse": int,
    "warmStartingFactor": float,
}
_BODY: dict[str, type] = {
    "activationState": int,
    "angularDamping": float,
    "ccdSweptSphereRadius": float,
    "collisionMargin": float,
    "contactDamping": float,
    "contactProcessingThreshold": float,
    "contactStiffness": float,
    "frictionAnchor": int,
    "lateralFriction": float,
    "linearDamping": float,
    "restitution": float,
    "rollingFriction": float,
    "spinningFriction": float,
}
_ELSEWHERE = {
    "fixedTimeStep": "The setting's own timestep says it",
    "numSubSteps": "Forces of substeps are not reported; use a smaller timestep",
    "mass": "The scene says it",
}


class LinkOptions(OptionTable):
    """A sphere of the ball, `onset` m smaller, with contactStiffness
    (N/m) and contactDamping (N s/m).
    """

    onset: Finite
    stiffness: Finite
    damping: Finite

    @field_validator("onset", "stiffness")
    @classmethod
    def _in_range(cls, value: float, info: ValidationInfo) -> float:
        """Refuse an onset below 0 m, and a stiffness that is not above 0 N/m."""
        if value < 0 or (value == 0 and info.field_name == "stiffness"):
            expected = "above 0 N/m"
            if info.field_name == "onset":
                expected = "0 m or more"
            raise mistake(expected, f"{value!r}")
        return value


class PybulletOptions(OptionTable):
    """A setting's options, checked. All empty: the models as loaded, in a world as Bullet makes it.

    links: in place of the one sphere of the ball.
    """

    world: dict[str, Any] = Field({}, description="a table of setPhysicsEngineParameter's keywords")
    ball: dict[str, Any] = Field({}, description="a table of changeDynamics's keywords")
    plate: dict[str, Any] = Field({}, description="a table of changeDynamics's keywords")
    links: tuple[LinkOptions, ...] = Field((), description="a list of the ball's links")
    maximal_coordinates: StrictBool = Field(False, description="true or false")
    law: Annotated[Law, PlainValidator(law_of)] | None = None


def read_options(options: Mapping[str, Any]) -> PybulletOptions:
    """Read and check the options of a PyBullet setting.

    Raises SettingError for an option or keyword that PyBullet does not have or would ignore, and
    for links beside another contact.
    """
    checked = validate(PybulletOptions, options, SettingError, "pybullet option '{}'")
    # Links are the contact: they go with no other.
    has_other_contact = (
        checked.law is not None or checked.maximal_coordinates or "restitution" in checked.ball
    )
    if checked.links and has_other_contact:
        got = "given with a law, a restitution or maximal coordinates"
        raise SettingError("pybullet option 'links'", got, "links alone: they are the contact")
    _check(checked.world, "world", _WORLD, "setPhysicsEngineParameter")
    _check(checked.ball, "ball", _BODY, "changeDynamics")
    _check(checked.plate, "plate", _BODY, "changeDynamics")
    return checked


def _check(keywords: Mapping[str, Any], part: str, types: Mapping[str, type], call: str) -> None:
    """Raise SettingError for the first keyword that a function of PyBullet does not take, or would
    ignore, and for contactStiffness or contactDamping without the other.

    keywords: of a setting's table.
    part: name of the table, "world", "ball" or "plate".
    types: keywords that the function takes, with the type of each.
    call: name of the function.
    """
    for key, value in keywords.items():
        slot = f"pybullet option '{part}.{key}'"
        if key in _ELSEWHERE:
            raise SettingError(slot, "not to be set here", "", _ELSEWHERE[key])
        if key not in types:
            raise SettingError(slot, "unknown", f"one of {call}'s: {', '.join(types)}")
        # True and False stand for 1 and 0.
        if isinstance(value, bool) and types[key] is int:
            continue
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise SettingError(slot, repr(value), "a number")
        if types[key] is int and not (isinstance(value, int) and value < 2**31):
            raise SettingError(slot, repr(value), f"a whole number below {2**31}")
        if not (math.isfinite(value) and value >= 0):
            advice = "Bullet ignores others silently"
            raise SettingError(slot, repr(value), "a finite number of 0 or more", advice)
    of_spring = {"contactStiffness", "contactDamping"} & keywords.keys()
    if len(of_spring) == 1:
        got = f"{of_spring.pop()} alone"
        raise SettingError(f"pybullet option {part!r}", got, "contactStiffness and contactDamping")


# A PyBullet setting as its user writes it: calls to paste, and a script that runs by itself.

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
    """Text of a URDF of a scene's ball with links, one sphere each; the first is the base, with all
    the mass.

    Raises SettingError for a scene with a cup, SceneError for links that start as deep as the
    ball's radius or deeper.
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
        # kg and kg m².
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


# Suffixes of files that PyBullet loads bodies from.
_FILES = (".urdf", ".sdf", ".xml")
# A link of a body by its number, as in "robot:11"; "body:1" is body 1 of a world.
_LINK = re.compile(r"(?P<body>.+):(?P<link>-1|\d+)")


def part_in_script(name: str) -> tuple[str, int]:
    """Variable of the body, and number of the link, that a name means in a script of the user's.

    name: a variable, a body's number, or the path of the body's file, which makes a variable of its
    stem; each may go on with ":" and a link's number.
    The base is link -1.
    """
    link = -1
    found = _LINK.fullmatch(name)
    if found is not None and found["body"] == "body":
        name = found["link"]
    elif found is not None:
        name = found["body"]
        link = int(found["link"])
    if name.isdigit():
        return name, link
    if Path(name).suffix.lower() in _FILES:
        name = Path(name).stem
    variable = re.sub(r"\W", "_", name)
    if not variable.isidentifier() or keyword.iskeyword(variable):
        variable = f"body_{variable}"
    return variable, link


def snippet(setting: Setting, form: str = "plane", pair: Pair = PAIR) -> str:
    """Return the lines to paste into a script with a PyBullet world, after its other settings; for a
    setting that sets none of Bullet's, its options as text.

    form: "plane" or "cup".
    pair: of ball and plate, as `part_in_script` takes them.
    """
    if not {"world", "ball", "plate", "law", "links"} & set(setting.options):
        return setting.options_text
    (ball, _), (plate, _) = map(part_in_script, pair)
    head = ["import pybullet", LAST]
    if not all(map(str.isidentifier, pair)):
        head.append(_BODIES.format(ball, plate, *pair))
    if setting.options.get("links"):
        head += [_OWN_BALL.format(ball)]
    if setting.options.get("maximal_coordinates"):
        head += [_MAXIMAL.format(ball, plate)]
    if "law" in setting.options:
        head.insert(1, "from hcbench.contact import pybullet as contact\n")
    text = "\n".join([*head, _calls(setting, pair, {}, "str(contact.library())")])
    return f"{text}\n{_CUP}" if form == "cup" and "law" in setting.options else text


def script(scene: Scene, setting: Setting) -> str:
    """A Python script that drops the ball on a plane at several speeds, and prints e.

    Raises SettingError for a cup, and for a setting that is neither
    Bullet's own contact nor a plug-in; CannotRun where the plug-in cannot be compiled.
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
    """Lines of Python with the calls of a setting, in an order that works: the world's, what makes
    ball and plate, what changes them, and the law's.

    pair: of ball and plate, as `part_in_script` takes them.
    made: "ball" and "plate" -> the call that makes each; {} where both exist already.
    path: of the plug-in, as a Python expression; unused without a law.
    """
    options = setting.options
    parts = dict(zip(PAIR, map(part_in_script, pair), strict=True))
    # Substeps of the user's would be shorter steps than those of the setting.
    world = {"fixedTimeStep": setting.timestep, "numSubSteps": 0, **options.get("world", {})}
    # Lines before the bodies are made; then by body the call that changes it.
    before: list[str] = []
    made = dict(made)
    calls = {}
    for body, (name, link) in parts.items():
        if options.get(body):
            given = arguments(options[body])
            calls[body] = f"pybullet.changeDynamics({name}, {link}, {given})"
    links = options.get("links")
    # A ball of several links is loaded from a URDF that the lines write, and each link is changed.
    if links:
        rows = ""
        for link in links:
            rows += f"    ({link['onset']!r}, {link['stiffness']!r}, {link['damping']!r}),\n"
        ball, _ = parts["ball"]
        write = WRITE.replace('"ball.urdf"', f'"{ball}.urdf"')
        before = [
            f"LINK = {LINK!r}",
            f"JOINT = {JOINT!r}",
            f"links = [  # start, k, c\n{rows}]",
            write,
        ]
        made["ball"] = f'loadURDF("{ball}.urdf", flags=pybullet.URDF_USE_INERTIA_FROM_FILE)'
        # The base is Bullet's link -1.
        of_link = calls["ball"].replace("-1", "link")
        calls["ball"] = f"for link in range(-1, {len(links) - 1}):\n    {of_link}"
    lines = [f"pybullet.setPhysicsEngineParameter({arguments(world)})", *before]
    for body, call in made.items():
        name, _ = parts[body]
        lines.append(f"{name} = pybullet.{call}")
    lines += calls.values()
    if "law" in options:
        law = json.dumps(plugin.command(law_of(options["law"])))
        lines.append(f"plugin = pybullet.loadPlugin({path})")
        numbers = ", ".join(f"{name}, {link}" for name, link in parts.values())
        lines.append(f"pybullet.executePluginCommand(plugin, {law}, [{numbers}])")
    return "\n".join(lines)


LAST = "# paste it after all other settings of the world and of these bodies: the last one counts"
_BODIES = "# {0}, {1}: the numbers of the bodies of {2} and {3}, as loadURDF returns them"
_OWN_BALL = "# radius, mass, inertia and friction: of {0}; friction 0 for none"
_MAXIMAL = """for body in ({0}, {1}):
    if pybullet.getDynamicsInfo(body, -1)[10] != 1:
        raise ValueError("load both with useMaximalCoordinates=True: without it e is another")"""
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
