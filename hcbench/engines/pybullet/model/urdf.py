"""Checks of a URDF that Bullet makes only in print, or not at all: it loads a radius of "five" as
0, and crashes where a robot has two root links.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

from hcbench.system.errors import SceneError
from hcbench.terms.units import require_bounds

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET
    from pathlib import Path

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
    """Refuse links and joints that make no tree, and shapes without a size.

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
    """Refuse links that are not a tree, each with a name."""
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
    parent_of: dict[str, str] = {}
    for joint in root.iterfind("joint"):
        slot = f"{path}: joint {joint.get('name', '')!r}"
        kind = joint.get("type", "")
        if kind not in _JOINTS:
            raise SceneError(slot, f"type {kind!r}", f"one of: {', '.join(_JOINTS)}")
        parent, child = (_end(slot, joint, end, known) for end in ("parent", "child"))
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
    """The link at one end of a joint. Raises SceneError for one that the robot does not have."""
    element = joint.find(end)
    link = "" if element is None else element.get("link", "")
    if link not in known:
        raise SceneError(slot, f"{end} link {link!r} is not in the file", "a link of this robot")
    return link


def _check_circle(path: Path, names: list[str], parent_of: dict[str, str]) -> None:
    """Refuse links that carry each other in a circle."""
    # Links from which the way to the root is known.
    reach_root: set[str] = set()
    for name in names:
        way: dict[str, None] = {}
        while name in parent_of and name not in reach_root:
            if name in way:
                got = f"links in a circle: {_listed(list(way))}"
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
    """The numbers of an attribute; [] where one is none."""
    try:
        return [float(word) for word in (text or "").split()]
    except ValueError:
        return []


def _check_size(slot: str, attribute: str, text: str | None, count: int) -> None:
    """Refuse a size that is not so many numbers above 0."""
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
    """Refuse a scale of a mesh that leaves it without a volume; a negative one mirrors it."""
    numbers = _numbers(text)
    if len(numbers) not in (1, 3) or not all(
        number and math.isfinite(number) for number in numbers
    ):
        raise SceneError(slot, f"scale {text[:40]!r}", "3 numbers other than 0")
