"""A contact law in MJCF: its plug-in in a scene, and as text to paste."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

from hcbench.engines.mujoco.plugin import config
from hcbench.engines.mujoco.scene.elements import as_text, named, quoted, remove_pairs, section
from hcbench.laws.contact_law import Friction, Law, is_force
from hcbench.terms.scene import Scene
from hcbench.terms.setting import PAIR, Pair

_PAIRS = {"cup": {"tendon": "contact"}, "plane": dict(zip(("geom1", "geom2"), PAIR, strict=True))}


def write_law(root: ET.Element, scene: Scene, law: Law, path: Path) -> None:
    """Add the law's plug-in to a scene's MJCF, for the two geoms or, in a cup, for the tendon; a
    force law turns MuJoCo's own contact, or the tendon's limit, off.

    path: of the model, for errors. Raises SceneError where the model lacks a part that the form
    has.
    """
    form = scene.form
    if is_force(law) and form == "cup":
        named(root, "spatial", "contact", path).set("limited", "false")
    elif is_force(law):
        plate = named(root, "geom", "plate", path)
        holder = next((body for body in root.iter("body") if plate in list(body)), None)
        other = "world" if holder is None else holder.get("name", "")
        remove_pairs(root)
        ET.SubElement(section(root, "contact"), "exclude", body1=other, body2="ball")
    root.append(extension(law, _PAIRS[form], scene.friction))
    named(root, "body", "ball", path).insert(0, ET.Element("plugin", instance="contact"))


def extension(law: Law, pair: Mapping[str, str], friction: float = 0.0) -> ET.Element:
    """Return the section that declares a law's plug-in.

    pair: the keys of its config that say of what.
    friction: μ that goes with a force law; a restitution law keeps MuJoCo's.
    """
    name, keys = config(law, Friction(friction, friction) if friction and is_force(law) else None)
    made = ET.Element("extension")
    instance = ET.SubElement(ET.SubElement(made, "plugin", plugin=name), "instance", name="contact")
    for key, value in (*pair.items(), *keys.items()):
        ET.SubElement(instance, "config", key=key, value=value)
    return made


def law_instances(law: Law, pairs: Sequence[Pair]) -> str:
    """One instance of a law for each pair of geoms, as MJCF."""
    made = [extension(law, dict(zip(("geom1", "geom2"), pair, strict=True))) for pair in pairs]
    for i, each in enumerate(made):
        named_one = each.find("plugin/instance")
        assert named_one is not None
        named_one.set("name", f"contact{i}")
    return "".join(as_text(each) for each in made)


def law_snippet(law: Law, form: str, pair: Pair = PAIR, friction: float = 0.0) -> str:
    """Return the MJCF of a law, to paste into a user's model.

    pair: its geoms, the first of which moves.
    friction: μ that goes with a force law.
    """
    config = _PAIRS[form] if form == "cup" else dict(zip(("geom1", "geom2"), pair, strict=True))
    lines = [
        "<!-- load the plug-in first: see `hcbench plugin mujoco` -->",
        as_text(extension(law, config, friction)).strip(),
    ]
    if is_force(law) and form == "cup":
        lines.insert(
            1,
            '<!-- limited="false" on the tendon "contact": the force takes the place of its limit -->',
        )
    elif is_force(law):
        lines.append(f'<contact><exclude body1="world" body2={quoted(pair[0])}/></contact>')
    return "\n".join(lines)
