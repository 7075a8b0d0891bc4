"""What a scene's URDFs say, read as text: Bullet takes "abc" for 0, and lets a plate with a mass move."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

from hcbench.errors import SceneError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from hcbench.scene import Scene

_RADIUS_TOLERANCE = 1e-9  # m


def check_ball(path: Path, scene: Scene) -> None:
    """SceneError where the ball has no mass, or is a sphere of another radius than the scene's."""
    root = _parsed(path)
    for element in root.findall("link/inertial/mass"):
        _number(path, "mass", element, "value", "a mass in kg above 0", lambda mass: 0.0 < mass < math.inf)
    radius = scene.relative_radius if scene.form == "plane" else scene.ball_radius
    what = "1/(1/R1 + 1/R2)" if scene.form == "plane" else "R1"
    for element in root.findall("link/collision/geometry/sphere"):
        _number(
            path,
            "sphere radius",
            element,
            "radius",
            f"{radius:.12g} m, the {what} of scene.toml",
            lambda own: abs(own - radius) <= _RADIUS_TOLERANCE,
        )


def check_plate(path: Path) -> None:
    """SceneError where the plate has a mass: Bullet would let it move."""
    links = _parsed(path).findall("link")
    expected = "0, which fixes it in Bullet"
    for element in (mass for link in links for mass in link.findall("inertial/mass")):
        _number(path, "mass", element, "value", expected, lambda mass: mass == 0.0)
    if not any(link.findall("inertial/mass") for link in links):
        raise SceneError(f"{path}: mass", "missing, which Bullet reads as 1 kg", expected)


def _parsed(path: Path) -> ET.Element:
    try:
        return ET.parse(path).getroot()
    except (ET.ParseError, OSError, UnicodeDecodeError, LookupError) as error:
        raise SceneError(str(path), f"cannot be read: {error}", "a URDF that PyBullet loads") from None


def _number(
    path: Path, slot: str, element: ET.Element, name: str, expected: str, good: Callable[[float], bool]
) -> None:
    text = element.get(name)
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not good(value):
        raise SceneError(f"{path}: {slot}", "missing" if text is None else repr(text), expected)
