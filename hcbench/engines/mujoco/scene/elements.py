"""Elements of an MJCF tree: found by name, made where they are missing, written as text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from hcbench.system.errors import SceneError

_ESCAPES = {"&": "amp", "<": "lt", ">": "gt", '"': "quot", "\n": "#10", "\r": "#13", "\t": "#9"}
_ESCAPED = str.maketrans({character: f"&{name};" for character, name in _ESCAPES.items()})


def quoted(text: str) -> str:
    """The value of an attribute, in quotes, its unprintable characters by their numbers.

    xml.sax.saxutils would import all that can open an address.
    """
    escaped = text.translate(_ESCAPED)
    return '"' + "".join(c if c.isprintable() else f"&#{ord(c)};" for c in escaped) + '"'


def remove_pairs(root: ET.Element) -> None:
    """Take away the <pair>s of ball and plate."""
    for contact in root.findall("contact"):
        for pair in contact.findall("pair"):
            if {pair.get("geom1"), pair.get("geom2")} == {"ball", "plate"}:
                contact.remove(pair)


def as_text(root: ET.Element) -> str:
    """MJCF as text."""
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def section(root: ET.Element, tag: str) -> ET.Element:
    """The last such section, as later ones win; made where there is none."""
    sections = root.findall(tag)
    return sections[-1] if sections else ET.SubElement(root, tag)


def named(root: ET.Element, tag: str, name: str, path: Path) -> ET.Element:
    """The first element below `root` of that tag and name.

    path: of the model, for errors.
    Raises SceneError where there is none.
    """
    for element in root.iter(tag):
        if element.get("name") == name:
            return element
    raise SceneError(
        str(path),
        f"there is no <{tag} name={name!r}>",
        "one",
        "scenes/README.md says what a scene needs",
    )
