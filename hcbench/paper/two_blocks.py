"""The scene `two-blocks`: its files, with another gap, mass and step, and with contact tuned to the law.

A sphere between two planes that face each other, free, without gravity; the drive is a motor in MuJoCo and
an external force in PyBullet.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING, Any

from hcbench.engines.mujoco.recipes.staggered import Staggered
from hcbench.engines.pybullet.recipes.restitution import PYBULLET as RESTITUTION
from hcbench.engines.pybullet.recipes.spring_damper import PYBULLET as SPRING_DAMPER
from hcbench.laws.force import HuntCrossley
from hcbench.scene import load_scene
from hcbench.tune.target import Target

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from hcbench.paper.vibroimpact.system import VibroImpact

NAME = "two-blocks"
RADIUS = 0.0508  # m, of the sphere: the relative radius of section 3.1; no force depends on it
SIDES = {"left": -1.0, "right": 1.0}  # the geoms, bodies and files of the blocks; where they are along x
# Both blocks press a squeezed body at once, and all rows share in the highest impedance: 0.05 of four tried
# leaves the summed loop the nearest.
IMPEDANCE = 0.05


def folder() -> Path:
    """Where the files are, beside the built-in scenes."""
    return load_scene("steel-plane").models["mujoco"]["scene"].parent.parent / NAME


def place(system: VibroImpact, side: str) -> float:
    """x of a block's plane, m."""
    return SIDES[side] * (RADIUS + system.gap / 2.0)


def mjcf(system: VibroImpact, timestep: float, native_at: float | None = None) -> str:
    """The scene's MJCF for a system and a step (s), with contact as in the file.

    native_at: with contact tuned to the system's law about that speed (m/s), by `staggered` pairs of the
    ball with each block. The scene's `tuned.xml` is such a text. Raises EngineMissing where the MuJoCo that
    is installed cannot have them.
    """
    root = ET.fromstring((folder() / "scene.xml").read_text(encoding="utf-8"))
    _one(root, "option").set("timestep", repr(timestep))
    inertial = _one(root, "inertial")
    inertia = [
        float(i) * system.mass / float(inertial.attrib["mass"])
        for i in inertial.attrib["diaginertia"].split()
    ]
    inertial.set("mass", repr(system.mass))
    inertial.set("diaginertia", _text(inertia))
    for geom in root.iter("geom"):
        if (side := geom.get("name", "")) in SIDES:
            geom.set("pos", _text([place(system, side), 0.0, 0.0]))
    if native_at is not None:
        setting = Staggered(impedance=IMPEDANCE)(_target(system, timestep, native_at))
        _one(root, "option").set("integrator", setting.options["integrator"])
        _write_pairs(root, setting.options["rows"])
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def bullet_options(system: VibroImpact, timestep: float, native_at: float) -> Mapping[str, Any]:
    """PyBullet's own contact tuned to the law at a speed (m/s), as a setting's options.

    A restitution where the body flies; between blocks that squeeze it, where no impact is, a spring and
    damper.
    """
    recipe = RESTITUTION if system.gap > 0.0 else SPRING_DAMPER
    law = Target(_law(system), system.mass, timestep, native_at, native_at)
    return recipe(law).options


def _target(system: VibroImpact, timestep: float, speed: float) -> Target:
    return Target(_law(system), system.mass, timestep, speed / 20.0, 1.5 * speed)


def _law(system: VibroImpact) -> HuntCrossley:
    assert isinstance(system.right, HuntCrossley)
    return system.right


def _write_pairs(root: ET.Element, rows: list[dict[str, Any]]) -> None:
    """Each row a <pair> with either block: the first of the ball's own geom, others of massless copies."""
    body = _one(root, "body")
    ball = _one(body, "geom")
    contact = ET.SubElement(root, "contact")
    for i, row in enumerate(rows):
        name = f"ball.{i + 1}" if i else "ball"
        if i:
            double = copy.deepcopy(ball)
            double.attrib.update(name=name, mass="0", contype="0", conaffinity="0", group="3")
            body.append(double)
        words = {
            "solref": _text(row["solref"]),
            "solimp": _text(row["solimp"]),
            "margin": _text([-row["onset"]]),
        }
        if row["adhesion"]:
            words["adhesion"] = _text([row["adhesion"]])
        for side in SIDES:
            ET.SubElement(contact, "pair", geom1=name, geom2=side, condim="1").attrib.update(words)


def _one(root: ET.Element, tag: str) -> ET.Element:
    found = next(root.iter(tag), None)
    assert found is not None
    return found


def _text(numbers: list[float]) -> str:
    return " ".join(f"{float(x) + 0.0!r}" for x in numbers)
