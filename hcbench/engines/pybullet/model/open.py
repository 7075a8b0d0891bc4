"""PyBullet worlds of users, from files or live, in the pose of a request, and the two in them that
meet.
"""

from __future__ import annotations

import math
import re
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench.engines.pybullet.backend import LASTING_SETTINGS, MASS, BulletClient
from hcbench.engines.pybullet.model.bodies import (
    FIXED,
    JOINT_NAME,
    JOINT_TYPE,
    LINK_NAME,
    PRISMATIC,
    REVOLUTE,
)
from hcbench.sim.model_under_test import Request
from hcbench.sim.packages import (
    Packages,
    is_utf8,
    read_xml,
    require_expanded,
    require_packages,
    suggest_names,
    with_absolute_files,
)
from hcbench.sim.touch import JointBeyondLimit, require_no_joint_beyond
from hcbench.system.errors import SceneError, UserError
from hcbench.system.files import is_file, why_no_file
from hcbench.system.text import sanitized
from hcbench.terms.bounds import require_bounds

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.terms.scene import Scene


# Model files read as text for what PyBullet overlooks: it takes "abc" for 0, and lets a heavy
# plate move.

# Checks of a URDF that Bullet makes only in print, or not at all: it loads a radius of "five" as
# 0, and crashes where a robot has two root links.

_JOINTS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical")
# Attributes of a shape: how many numbers each has.
_SIZES = {
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "box": {"size": 3},
}
# Links and joints that a message names.
_NAMED = 3


def check_urdf(path: Path, root: ET.Element) -> None:
    """Refuse a robot of a URDF whose links and joints make no tree, or whose shapes lack a size.

    Links without a name, or with the same name, and joints of an unknown type make no tree. A size
    is one or more numbers above 0, m.

    path: of the file, for errors.
    root: its <robot> element.
    Raises SceneError, and QuantityError for a size beyond its bounds.
    """
    _check_tree(path, root)
    for link in root.iterfind("link"):
        name = link.get("name")
        for shape in link.iterfind("collision/geometry/*"):
            slot = f"{path}: link {name!r}: {shape.tag}"
            for attribute, count in _SIZES.get(shape.tag, {}).items():
                _check_size(slot, attribute, shape.get(attribute), count)
            if shape.tag == "mesh" and (scale := shape.get("scale")) is not None:
                _check_scale(slot, scale)


def _check_tree(path: Path, root: ET.Element) -> None:
    """Refuse a URDF whose links are not one tree, each with a name of its own.

    path: of the file, for errors.
    root: its <robot> element.
    Raises SceneError for a link without a name or with another's, an unknown type of joint, a joint
    between links that are not there, a link with two parents, two root links, and a circle.
    """
    names = [link.get("name", "") for link in root.iterfind("link")]
    if "" in names:
        raise SceneError(
            f"{path}: link", f"number {names.index('') + 1} has no name", "a name for each link"
        )
    if repeated := [name for name, count in Counter(names).items() if count > 1]:
        raise SceneError(
            f"{path}: link", f"{_listed(repeated)} more than once", "a name for one link only"
        )
    known = set(names)
    # Link -> the link that carries it by a joint.
    parent_of: dict[str, str] = {}
    for joint in root.iterfind("joint"):
        slot = f"{path}: joint {joint.get('name', '')!r}"
        kind = joint.get("type", "")
        if kind not in _JOINTS:
            raise SceneError(slot, f"type {kind!r}", f"one of: {', '.join(_JOINTS)}")
        parent = _end(slot, joint, "parent", known)
        child = _end(slot, joint, "child", known)
        if child in parent_of:
            got = f"link {child!r} is the child of {parent_of[child]!r} and of {parent!r}"
            raise SceneError(slot, got, "one parent for each link")
        parent_of[child] = parent
    roots = [name for name in names if name not in parent_of]
    if len(roots) > 1:
        got = f"{len(roots)} root links: {_listed(roots)}"
        raise SceneError(f"{path}: robot", got, "one link that hangs on no joint")
    _check_circle(path, names, parent_of)


def _end(slot: str, joint: ET.Element, end: str, known: set[str]) -> str:
    """Name of the link at one end of a joint.

    slot: the joint, for the error.
    end: "parent" or "child".
    known: names of the robot's links.
    Raises SceneError for a link that is not among them.
    """
    element = joint.find(end)
    link = "" if element is None else element.get("link", "")
    if link not in known:
        raise SceneError(slot, f"{end} link {link!r} is not in the file", "a link of this robot")
    return link


def _check_circle(path: Path, names: list[str], parent_of: dict[str, str]) -> None:
    """Refuse links that carry each other in a circle, by SceneError.

    path: of the file, for the error.
    names: of all links.
    parent_of: link -> the link that carries it; a root link is not in it.
    """
    # Links from which the way to the root is known.
    reach_root: set[str] = set()
    for name in names:
        # The links from this one up, in order.
        way: dict[str, None] = {}
        while name in parent_of and name not in reach_root:
            if name in way:
                # Links before this one only lead into the circle.
                links = list(way)
                got = f"links in a circle: {_listed(links[links.index(name) :])}"
                raise SceneError(f"{path}: robot", got, "a tree of links")
            way[name] = None
            name = parent_of[name]  # noqa: PLW2901 - up the tree
        reach_root.update(way)


def _listed(names: list[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:_NAMED])
    if len(names) > _NAMED:
        shown += ", ..."
    return shown


def _numbers(text: str | None) -> list[float]:
    """The numbers of an attribute, with blanks between them; [] where a word is not a number."""
    try:
        return [float(word) for word in (text or "").split()]
    except ValueError:
        return []


def _check_size(slot: str, attribute: str, text: str | None, count: int) -> None:
    """Refuse a size of a shape that is not `count` numbers above 0, m.

    slot: the shape, for errors.
    attribute: name of the size.
    text: its value in the file; None where it is missing.
    Raises SceneError, and QuantityError for numbers outside the bounds of a length.
    """
    numbers = _numbers(text)
    if len(numbers) != count or not all(0.0 < number < math.inf for number in numbers):
        got = f"{attribute} is missing"
        if text is not None:
            got = f"{attribute} {text[:40]!r}"
        expected = "a number above 0, m"
        if count != 1:
            expected = f"{count} numbers above 0, m"
        raise SceneError(slot, got, expected)
    require_bounds(f"{slot}: {attribute}", numbers, "length", "m")


def _check_scale(slot: str, text: str) -> None:
    """Refuse a scale of a mesh that leaves it without a volume, by SceneError.

    slot: the mesh, for the error.
    text: 1 number, or 3; a negative one mirrors the mesh.
    """
    numbers = _numbers(text)
    if len(numbers) not in (1, 3) or not all(
        number and math.isfinite(number) for number in numbers
    ):
        raise SceneError(slot, f"scale {text[:40]!r}", "3 numbers other than 0")


_RADIUS_TOLERANCE = 1e-9  # m
# First tag of a file, by its suffix.
_ROOTS = {".urdf": "robot", ".sdf": "sdf"}


def check_ball(path: Path, scene: Scene) -> None:
    """Refuse a ball's URDF with a mass that is not above 0, or a sphere of another radius than the
    scene's.

    A file without a mass passes: the scene's mass is set when it is loaded.

    path: of the URDF.
    Raises SceneError, also for a file that cannot be read.
    """
    root = _parse(path)
    for element in root.findall("link/inertial/mass"):
        text = element.get("value")
        _check_number(
            path, "mass", text, "a mass in kg above 0", lambda mass: 0.0 < mass < math.inf
        )
    if scene.form == "plane":
        name = "1/(1/R1 + 1/R2)"
        radius = scene.relative_radius
    else:
        name = "R1"
        radius = scene.ball_radius
    expected = f"{radius:.12g} m, the {name} of scene.toml"
    for element in root.findall("link/collision/geometry/sphere"):
        text = element.get("radius")
        _check_number(
            path, "sphere radius", text, expected, lambda r: abs(r - radius) <= _RADIUS_TOLERANCE
        )


def check_plate(path: Path) -> None:
    """Refuse a plate's URDF without a mass of 0: Bullet would let the plate move.

    path: of the URDF.
    Raises SceneError, also for a file that cannot be read.
    """
    masses = _parse(path).findall("link/inertial/mass")
    expected = "0, which fixes it in Bullet"
    for element in masses:
        _check_number(path, "mass", element.get("value"), expected, lambda mass: mass == 0.0)
    if not masses:
        raise SceneError(f"{path}: mass", "missing, which Bullet reads as 1 kg", expected)


def check_user_model(path: Path) -> tuple[str, float] | None:
    """Refuse a file that PyBullet would read wrongly and only print about.

    Returns the tag and the e, 0 to 1, of a restitution that PyBullet would overlook, as it stands
    outside <link><contact>, where other simulators have theirs; None without one.

    path: URDF, SDF or MJCF.
    Raises SceneError for a file that is not there or not one of these, for entities, links that
    make no tree, numbers that are none, and meshes that are not there; QuantityError for a size
    outside the bounds.
    """
    if not path.is_file():
        raise SceneError("model", f"{path} {why_no_file(path)}", "a URDF, SDF or MJCF file")
    root = _parse(path)
    expected = _ROOTS.get(path.suffix.lower(), root.tag)
    if root.tag != expected:
        raise SceneError("model", f"{path} begins with <{root.tag[:40]}>", f"<{expected}>")
    text = read_xml(path)
    require_expanded(path, text)
    if "<!ENTITY" in text:
        got = f"{path} has entities (<!ENTITY), which Bullet does not expand"
        raise SceneError("model", got, "numbers and names in full")
    if root.tag == "robot":
        check_urdf(path, root)
    for mass in root.iter("mass"):
        text = mass.get("value") or mass.text or ""
        _check_number(path, "mass", text, "0 kg (fixed) or more", lambda mass: 0 <= mass < math.inf)
    for element in root.iterfind(".//link/contact/*[@value]"):
        # Bullet takes text for 0.
        _check_number(path, element.tag, element.get("value"), "a finite number", math.isfinite)
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        # Bullet itself looks for packages and absolute paths.
        is_beside = name and "://" not in name and not Path(name).is_absolute()
        # It looks for a mesh in the folder of the URDF, and in each one above.
        if is_beside and not any(is_file(folder / name) for folder in path.absolute().parents):
            raise SceneError(
                "model", f"{path}: mesh {name[:200]!r} is not there", "a file beside the URDF"
            )
    return _foreign_restitution(root)


def _foreign_restitution(root: ET.Element) -> tuple[str, float] | None:
    """Tag and e, 0 to 1, of the first restitution in a file that is outside <link><contact>, where
    PyBullet does not look; None without one.
    """
    read_by_bullet = {id(element) for element in root.iterfind(".//link/contact/restitution")}
    for element in root.iter():
        # The tag without its namespace.
        tag = str(element.tag).rpartition("}")[2]
        if "restitution" not in tag.lower() or id(element) in read_by_bullet:
            continue
        with suppress(ValueError):
            e = float(element.get("value") or element.text or "")
            if 0 <= e <= 1:
                return sanitized(tag), e
    return None


# Blanks before the declaration and zeros at the end: Bullet's parser reads over them.
_BLANKS = b" \t\r\n\0"
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def _parse(path: Path) -> ET.Element:
    """The root of an XML file. Raises SceneError for a file that cannot be read, or is not XML."""
    try:
        content = path.read_bytes()
        if not content.startswith(_UTF16):
            content = content.strip(_BLANKS)
        return ET.fromstring(content)
    except (ET.ParseError, OSError, ValueError, LookupError) as error:
        got = f"is not XML or cannot be read: {error}"
        raise SceneError(str(path), got, "a URDF, SDF or MJCF file") from None


def _check_number(
    path: Path, name: str, text: str | None, expected: str, is_good: Callable[[float], bool]
) -> None:
    """Raise SceneError for a value in a file that is missing, not a number, or not a good one.

    path, name: the file and the value's name, for the error.
    text: the value; None where it is missing.
    expected: a good value in words, for the error.
    is_good: called with the number, NaN for any other text; returns whether it passes.
    """
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not is_good(value):
        got = "missing" if text is None else repr(text[:40])
        raise SceneError(f"{path}: {name}", got, expected)


_STARTING_SETTINGS = {**LASTING_SETTINGS, "fixedTimeStep": 1.0 / 240.0}
# Any link that touches, as PyBullet's own calls have it.
ANY_LINK = -2


@dataclass(frozen=True, slots=True)
class LiveWorld:
    """PyBullet world that the user has set up and is running.

    client: physics client id.
    first, second: what shall meet, the moving body first, each a body id or a (body id, link
    index); None where the request's pair names them.
    """

    client: int
    first: int | tuple[int, int] | None = None
    second: int | tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class BodyPart:
    """One of the two that meet: a link (-1: the base) of a body, or ANY_LINK of it.

    file: name of the body's, "" where it came from none.
    """

    name: str
    body: int
    link: int
    file: str = ""

    @property
    def variable(self) -> int | str:
        """Variable for the body in a script that hcbench prints: the name of its file without the
        suffix, with a number if several bodies came from it; its id where that makes no name.
        """
        name = self.file or self.name
        stem, _, copy = name.partition(".")
        name = stem + "".join(f"_{number}" for number in re.findall(r" \((\d+)\)$", copy))
        if name.isidentifier():
            return name
        return self.body

    @property
    def in_text(self) -> str:
        """The part as `tune pybullet --pair` takes it: its variable, and the number of a link."""
        return str(self.variable) if self.link < 0 else f"{self.variable}:{self.link}"


@dataclass(frozen=True, slots=True)
class LoadedWorld:
    """A world to be measured.

    label: what a report calls it.
    disconnect: whether to end its client at the end.
    pair: the two that meet, as in a `LiveWorld`; () where names say.
    files: body id -> name of the file it came from; empty for a world of the user's.
    unread: body id -> (tag, e) of a restitution that its file has in a place where PyBullet does
    not look.
    owner: what the user made of the client, which may disconnect it when it goes.
    """

    bullet: BulletClient
    label: str
    disconnect: bool
    pair: tuple[int | tuple[int, int], ...] = ()
    files: dict[int, str] = field(default_factory=dict)
    unread: dict[int, tuple[str, float]] = field(default_factory=dict)
    owner: Any = None

    def name_of(self, body: int, link: int = -1) -> str:
        """Name of a link, as its file has it; of a base, the file's own name or the body's number."""
        if link < 0:
            return self.files.get(body, f"body:{body}")
        name = self.bullet.getJointInfo(body, link)[LINK_NAME]
        return sanitized(name.decode(errors="replace"))


def load_files(paths: Sequence[str], packages: Packages = ()) -> LoadedWorld:
    """A new world, in a client of its own, with the files loaded as PyBullet loads them by default.

    paths: URDF, SDF or MJCF files, one or more.
    packages: folders of the packages that URDFs name.
    Raises SceneError for a file that is not there or does not load, QuantityError for a size
    outside the bounds, EngineFailed where PyBullet has no room for a client. The client is then
    closed.
    """
    files = [Path(path) for path in paths]
    unread = [check_user_model(path) for path in files]
    with ExitStack() as failed:
        bullet = BulletClient.direct()
        failed.callback(bullet.disconnect)
        bullet.resetSimulation()
        bullet.setPhysicsEngineParameter(**_STARTING_SETTINGS)
        world = LoadedWorld(bullet, " + ".join(path.name for path in files), disconnect=True)
        for path, restitution in zip(files, unread, strict=True):
            for body in _load(bullet, path, packages):
                _require_readable(bullet, body, path)
                # Bodies so far from a file of this name.
                copies = sum(
                    Path(name).name.partition(" (")[0] == path.name for name in world.files.values()
                )
                world.files[body] = path.name
                if copies:
                    world.files[body] += f" ({copies + 1})"
                if restitution is not None:
                    world.unread[body] = restitution
        # Nothing failed: the client stays open.
        failed.pop_all()
    return world


def _load(bullet: BulletClient, path: Path, packages: Packages) -> list[int]:
    """Load a URDF, SDF or MJCF file, and return the ids of its bodies.

    Bullet loads a copy of a URDF with absolute paths to its files, in UTF-8, where packages were
    given or the URDF is in another encoding.

    packages: folders of the packages that a URDF names.
    Raises SceneError with the package that has no folder, or with Bullet's reason.
    """
    if path.suffix.lower() != ".urdf":
        return bullet.load_model(path)
    # Bodies bounce by their collision shapes. The meshes and textures for cameras are most of
    # what a robot takes to load, and of the memory that each fork copies.
    flags = bullet.module.URDF_IGNORE_VISUAL_SHAPES
    try:
        if not packages and is_utf8(path):
            return bullet.load_model(path, flags=flags)
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / path.name
            copy.write_text(with_absolute_files(path, packages), encoding="utf-8")
            return bullet.load_model(copy, flags=flags)
    except SceneError:
        require_packages(path, packages)
        raise


def _require_readable(bullet: BulletClient, body: int, path: Path) -> None:
    """Refuse a robot with more joints than PyBullet reports states of, by SceneError.

    body: its id.
    path: of its file, for the error.
    """
    if not (count := bullet.getNumJoints(body)):
        return
    try:
        bullet.getJointState(body, 0)
    except bullet.error:
        got = f"{path}: {count} joints, of which PyBullet reports no state"
        raise SceneError(
            "model", got, "fewer joints (PyBullet: 128)", "Merge fixed links"
        ) from None


def open_live(source: Any, disconnect: bool) -> LoadedWorld:
    """Take up the world of a running PyBullet client of the user's, as a `LoadedWorld`.

    source: a `LiveWorld`, a client id, or a BulletClient of pybullet_utils; None: client 0.
    disconnect: whether hcbench ends the client when it is done.
    Raises UserError for any other source, for a client that is not connected, and for a `LiveWorld`
    that has only one of `first` and `second`.
    """
    world = source
    if source is None or isinstance(source, int):
        world = LiveWorld(source or 0)
    elif hasattr(source, "_client"):
        world = LiveWorld(source._client)
    if not isinstance(world, LiveWorld):
        raise UserError("model", f"a {type(source).__name__}", "a path or a PyBullet World")
    if (world.first is None) != (world.second is None):
        got = f"first {world.first!r:.40}, second {world.second!r:.40}"
        raise UserError("model", f"a World with {got}", "both, or neither and a pair by name")
    number: Any = world.client
    if not isinstance(number, int):
        got = f"a client {number!r:.40} of a {type(source).__name__}"
        raise UserError("model", got, "the whole number of a PyBullet client")
    bullet = BulletClient(number)
    if not (0 <= number < 2**31 and bullet.isConnected()):
        raise UserError("model", f"PyBullet client {number} is not connected", "a live client")
    pair: tuple[int | tuple[int, int], ...] = ()
    if world.first is not None and world.second is not None:
        pair = (world.first, world.second)
    return LoadedWorld(bullet, "PyBullet world", disconnect, pair, owner=source)


# Joints of a PyBullet world: put where a request says, held against their limits, their motors
# off.

# Places in getJointInfo.
_LOWER = 8
_UPPER = 9
# Beyond a limit by more, rad or m, a pose is not one that the model can hold.
_TURNED = math.radians(5.0)
_MOVED = 1e-3
_Joint = tuple[int, int]


def joint_states(bullet: BulletClient) -> dict[_Joint, tuple[float, float]]:
    """Position and velocity of every hinge, rad and rad/s, and slide, m and m/s, of a world, by
    (body, joint).
    """
    states: dict[_Joint, tuple[float, float]] = {}
    for body in bullet.bodies():
        for joint in range(bullet.getNumJoints(body)):
            kind = bullet.getJointInfo(body, joint)[JOINT_TYPE]
            if kind in (REVOLUTE, PRISMATIC):
                position, velocity, *_ = bullet.getJointState(body, joint)
                states[body, joint] = position, velocity
    return states


def base_states(bullet: BulletClient, request: Request) -> list[tuple[int, Any, Any]]:
    """State of every body's base: its id, then its position, m, and quaternion x y z w, then its
    velocity, m/s, and spin, rad/s, as PyBullet returns these pairs.

    Empty where the request sets no pose: nothing then moves a base.
    """
    if not request.pose:
        return []
    states = []
    for body in bullet.bodies():
        pose = bullet.getBasePositionAndOrientation(body)
        velocities = bullet.getBaseVelocity(body)
        states.append((body, pose, velocities))
    return states


def set_pose(world: LoadedWorld, request: Request) -> None:
    """Set the positions that a request names, and switch motors off where it says so.

    A joint, by its name or as "file/name", takes one number, m or rad. A free base, by the name of
    its file or as "base", takes x y z, m, and a quaternion w x y z, if given.

    request: its `pose` and `actuators` count here.
    Raises UserError for a name that the world does not have, and for another count of numbers.
    """
    bullet = world.bullet
    joints = _named_joints(world)
    for name, values in request.pose:
        if name in joints:
            if len(values) != 1:
                raise UserError("qpos", f"{name}: {len(values)} numbers", "1: m or rad")
            bullet.resetJointState(*joints[name], values[0])
            continue
        base = _free_base(world, name)
        if base is None:
            raise UserError("qpos", f"no joint {name!r}", *suggest_names(name, joints))
        _put_base(bullet, base, values)
    if not request.actuators:
        for body in bullet.bodies():
            for joint in range(bullet.getNumJoints(body)):
                bullet.setJointMotorControl2(body, joint, bullet.module.VELOCITY_CONTROL, force=0)


def _free_base(world: LoadedWorld, name: str) -> int | None:
    """Id of the body whose free base a name means; None without one.

    name: of the body's file, without its suffix; "base" means the free body with most joints, and
    of several such the one with the heaviest base.
    """
    bullet = world.bullet
    masses = {body: bullet.getDynamicsInfo(body, -1)[MASS] for body in bullet.bodies()}
    free = [body for body, mass in masses.items() if mass > 0.0]
    for body in free:
        stem, _, _ = world.files.get(body, "").partition(".")
        if stem == name:
            return body
    if name != "base":
        return None
    # A robot is the body with most joints.
    return max(free, key=lambda body: (bullet.getNumJoints(body), masses[body]), default=None)


def _put_base(bullet: BulletClient, body: int, values: tuple[float, ...]) -> None:
    """Put a free base of a body, by its id: x y z, m, and a quaternion w x y z, if given.

    Raises UserError for another number of values than 3 or 7.
    """
    if len(values) not in (3, 7):
        raise UserError("qpos", f"base: {len(values)} numbers", "3 or 7: m, quaternion w x y z")
    # Quaternions are w x y z in hcbench, and x y z w in PyBullet.
    turned = bullet.getBasePositionAndOrientation(body)[1]
    if len(values) == 7:
        turned = (*values[4:], values[3])
    bullet.resetBasePositionAndOrientation(body, values[:3], turned)


def _named_joints(world: LoadedWorld) -> dict[str, _Joint]:
    """Each joint that can move, as (body, joint), by "name", "body:ID/name" and "file/name".

    A name that several joints have means the first body's.
    """
    joints: dict[str, _Joint] = {}
    # The first body comes last, and takes a name that several have.
    for body in reversed(world.bullet.bodies()):
        for joint in range(world.bullet.getNumJoints(body)):
            info = world.bullet.getJointInfo(body, joint)
            if info[JOINT_TYPE] == FIXED:
                continue
            name = sanitized(info[JOINT_NAME].decode(errors="replace"))
            joints[name] = (body, joint)
            joints[f"body:{body}/{name}"] = (body, joint)
            if body in world.files:
                joints[f"{world.files[body]}/{name}"] = (body, joint)
    return joints


def require_joints_within_limits(bullet: BulletClient, body: int) -> None:
    """Refuse a pose in which hinges of a body are more than 5 degrees outside their limits, or
    slides more than 1 mm, by UserError.
    """
    outside = []
    for joint in range(bullet.getNumJoints(body)):
        info = bullet.getJointInfo(body, joint)
        if info[JOINT_TYPE] not in (REVOLUTE, PRISMATIC) or info[_LOWER] > info[_UPPER]:
            continue
        low = float(info[_LOWER])
        high = float(info[_UPPER])
        # Such limits stand for a file that has none.
        if low == 0.0 and high <= 0.0:
            continue
        position = float(bullet.getJointState(body, joint)[0])
        nearest = min(max(position, low), high)
        turns = info[JOINT_TYPE] == REVOLUTE
        if abs(position - nearest) > (_TURNED if turns else _MOVED):
            name = sanitized(info[JOINT_NAME].decode(errors="replace"))
            outside.append(JointBeyondLimit(name, abs(position - nearest), turns, nearest))
    require_no_joint_beyond(outside, "")
