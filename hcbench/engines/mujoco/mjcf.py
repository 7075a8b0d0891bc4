"""A scene's MJCF with a setting written into it: text in, text out, no engine.

Done on the text, as MuJoCo's own writer rounds to six digits. scenes/README.md says what a scene's MJCF must
have: a body `ball` with a free joint, geoms `ball` and `plate`, and in a cup the tendon `contact`.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

from hcbench.errors import SceneError, SettingError

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from hcbench.engines.mujoco.options import Options
    from hcbench.engines.mujoco.rows import ConstraintRow
    from hcbench.scene import Scene

_HIDDEN = "3"  # a group that MuJoCo's viewer does not draw: coincident copies would flicker


def model_path(scene: Scene) -> Path:
    """The scene's MJCF; SceneError where it has none."""
    try:
        return scene.models["mujoco"]["scene"]
    except KeyError:
        raise SceneError(
            f"scene {scene.name!r}",
            "no MuJoCo model",
            "its MJCF",
            'Add [models.mujoco] scene = "scene.xml" to its scene.toml',
        ) from None


def edited(scene: Scene, timestep: float, options: Options) -> ET.Element:
    """The complete MJCF of a scene under a setting. Raises SceneError and SettingError."""
    path = model_path(scene)
    root = _parse(path, path.parent, ())
    _anchor_files(root, path.parent)
    option = _section(root, "option")
    option.set("timestep", _text([timestep]))
    option.set("gravity", _text([0.0, 0.0, -scene.gravity]))
    if options.integrator is not None:
        option.set("integrator", options.integrator)
    _set_mass(root, scene, path)
    if options.rows:
        write = _write_pairs if scene.form == "plane" else _write_limits
        write(root, scene, options.rows, path)
    return root


def as_text(root: ET.Element) -> str:
    """MJCF as text."""
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def feel_acceleration(root: ET.Element) -> None:
    """Add, as the last sensor, one of the ball's acceleration without that of gravity, m/s^2."""
    ET.SubElement(
        ET.SubElement(root, "sensor"), "framelinacc", name="ball felt", objtype="xbody", objname="ball"
    )


def _text(numbers: Iterable[float]) -> str:
    # + 0.0: no "-0.0" where a user will read it.
    return " ".join(repr(float(number) + 0.0) for number in numbers)


def _parse(path: Path, folder: Path, above: tuple[Path, ...]) -> ET.Element:
    """The file's tree with its includes in place; they are relative to the main file's folder."""
    try:
        parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
        root = ET.parse(path, parser).getroot()
    except ET.ParseError as error:
        raise SceneError(str(path), f"not XML: {error}", "MJCF", "Mend that line") from None
    except (OSError, UnicodeDecodeError, LookupError) as error:
        raise SceneError(str(path), f"{error}", "a readable MJCF") from None
    for parent in list(root.iter()):
        for child in [c for c in parent if c.tag == "include"]:
            inner = (folder / child.get("file", "")).resolve()
            if inner in (*above, path.resolve()):
                raise SceneError(str(path), f"{inner} includes itself", "includes without a circle")
            at = list(parent).index(child)
            parent[at : at + 1] = list(_parse(inner, folder, (*above, path.resolve())))
    return root


def _anchor_files(root: ET.Element, folder: Path) -> None:
    """Let meshes and textures be found from anywhere: text has no folder of its own."""
    asset = list(root.iterfind("asset/*[@file]"))
    if not asset:
        return
    compiler = _section(root, "compiler")
    for key in ("assetdir", "meshdir", "texturedir"):
        if key == "assetdir" or compiler.get(key) is not None:
            compiler.set(key, str((folder / compiler.get(key, "")).resolve()))


def _section(root: ET.Element, tag: str) -> ET.Element:
    """The last such section, as later ones win; made where there is none."""
    found = root.findall(tag)
    return found[-1] if found else ET.SubElement(root, tag)


def _named(root: ET.Element, tag: str, name: str, path: Path) -> ET.Element:
    for element in root.iter(tag):
        if element.get("name") == name:
            return element
    raise SceneError(
        str(path), f"there is no <{tag} name={name!r}>", "one", "scenes/README.md says what a scene needs"
    )


def _set_mass(root: ET.Element, scene: Scene, path: Path) -> None:
    body = _named(root, "body", "ball", path)
    inertial = body.find("inertial")
    if inertial is None:
        geom = _named(body, "geom", "ball", path)
        geom.set("mass", _text([scene.mass]))
        return
    try:
        ratio = scene.mass / float(inertial.get("mass", "nan"))
        for key in ("diaginertia", "fullinertia"):
            # The same shape at another density; untouched, to the bit, at its own.
            if ratio != 1.0 and (own := inertial.get(key)) is not None:
                inertial.set(key, _text(float(number) * ratio for number in own.split()))
    except (ValueError, ZeroDivisionError):
        raise SceneError(
            str(path), f"the <inertial> of 'ball' has mass {inertial.get('mass')!r}", "a mass in kg above 0"
        ) from None
    inertial.set("mass", _text([scene.mass]))


def _write_pairs(root: ET.Element, scene: Scene, rows: tuple[ConstraintRow, ...], path: Path) -> None:
    """Each row a <pair>: the first of the ball's own geom, others of massless copies of it."""
    body = next(b for b in root.iter("body") if b.get("name") == "ball")
    ball = _named(body, "geom", "ball", path)
    holder = next(e for e in body.iter() if ball in list(e))
    _named(root, "geom", "plate", path)
    for section in root.findall("contact"):
        for pair in section.findall("pair"):
            if {pair.get("geom1"), pair.get("geom2")} == {"ball", "plate"}:
                section.remove(pair)
    contact = _section(root, "contact")
    for i, row in enumerate(rows):
        name = "ball" if i == 0 else f"ball.{i + 1}"
        if i > 0:
            double = copy.deepcopy(ball)
            double.attrib.pop("density", None)
            own = {"name": name, "mass": "0", "contype": "0", "conaffinity": "0", "group": _HIDDEN}
            double.attrib.update(own)
            holder.insert(list(holder).index(ball) + i, double)
        pair = ET.SubElement(contact, "pair", geom1=name, geom2="plate", condim="1")
        pair.set("solref", _text(row.solref))
        pair.set("solimp", _text(row.solimp))
        pair.set("margin", _text([-row.onset]))
        pair.set("gap", "0")
        if row.adhesion:
            pair.set("adhesion", _text([row.adhesion]))


def _write_limits(root: ET.Element, scene: Scene, rows: tuple[ConstraintRow, ...], path: Path) -> None:
    """Each row the limit of a tendon between the two centres, as the scene's own `contact` is."""
    own = _named(root, "spatial", "contact", path)
    holder = next(section for section in root.findall("tendon") if own in list(section))
    clearance = -scene.plate_radius - scene.ball_radius
    for i, row in enumerate(rows):
        if row.adhesion:
            raise SettingError(
                f"mujoco option 'rows[{i}].adhesion'",
                f"{row.adhesion!r} N in the form 'cup'",
                "0 N: a cup's contact is a tendon's limit, and MuJoCo lets limits only push",
                "Use the same pair in the form 'plane'",
            )
        tendon = own
        if i > 0:
            tendon = ET.SubElement(holder, "spatial", name=f"contact.{i + 1}", group=_HIDDEN)
            tendon.extend(copy.deepcopy(list(own)))
        tendon.set("limited", "true")
        tendon.set("range", _text([0.0, clearance + row.onset]))
        tendon.set("solreflimit", _text(row.solref))
        tendon.set("solimplimit", _text(row.solimp))
        tendon.set("margin", "0")
