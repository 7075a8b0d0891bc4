"""Model files read as text for what PyBullet overlooks: it takes "abc" for
0, and lets a heavy plate move.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from hcbench.engines.pybullet.model.urdf import check_urdf
from hcbench.sim.packages import read_xml, require_expanded
from hcbench.system.errors import SceneError
from hcbench.system.files import is_file, why_no_file
from hcbench.system.text import sanitized

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.terms.scene import Scene

_RADIUS_TOLERANCE = 1e-9  # m
# First tag of a file, by its suffix.
_ROOTS = {".urdf": "robot", ".sdf": "sdf"}


def check_ball(path: Path, scene: Scene) -> None:
    """SceneError where the ball has a mass that is not above 0, or is a sphere of another radius
    than the scene's. Without a mass it passes: the scene's is set.
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
    """SceneError where the plate has a mass: Bullet would let it move."""
    masses = _parse(path).findall("link/inertial/mass")
    expected = "0, which fixes it in Bullet"
    for element in masses:
        _check_number(path, "mass", element.get("value"), expected, lambda mass: mass == 0.0)
    if not masses:
        raise SceneError(f"{path}: mass", "missing, which Bullet reads as 1 kg", expected)


def check_user_model(path: Path) -> tuple[str, float] | None:
    """Refuse what PyBullet would only print about. Returns a restitution that it would overlook:
    the first (tag, e) outside <link><contact>, where other simulators have theirs.

    Raises SceneError for a file that is not there or not a URDF, SDF or MJCF, or that Bullet would
    read wrongly.
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
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        # Bullet itself looks for packages and absolute paths.
        is_beside = name and "://" not in name and not Path(name).is_absolute()
        if is_beside and not is_file(path.parent / name):
            raise SceneError(
                "model", f"{path}: mesh {name[:200]!r} is not there", "a file beside the URDF"
            )
    return _foreign_restitution(root)


def _foreign_restitution(root: ET.Element) -> tuple[str, float] | None:
    """(tag, e) of the first restitution from 0 to 1 outside <link><contact>; None without one."""
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


def _parse(path: Path) -> ET.Element:
    """The root of an XML file. Raises SceneError for a file that cannot be read, or is not XML."""
    try:
        return ET.parse(path).getroot()
    except (ET.ParseError, OSError, ValueError, LookupError) as error:
        got = f"is not XML or cannot be read: {error}"
        raise SceneError(str(path), got, "a URDF, SDF or MJCF file") from None


def _check_number(
    path: Path, name: str, text: str | None, expected: str, is_good: Callable[[float], bool]
) -> None:
    """Raise SceneError for a text that is not a number, or not one that is good.

    path, name: where it is.
    """
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not is_good(value):
        got = "missing" if text is None else repr(text[:40])
        raise SceneError(f"{path}: {name}", got, expected)
