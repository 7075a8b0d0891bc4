"""The scene `two-blocks` in MuJoCo, by the plug-in or by `staggered` pairs: see `hcbench.sim.two_blocks`."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, require_feature
from hcbench.engines.mujoco.mjcf import as_text
from hcbench.engines.mujoco.recipes.staggered import Staggered
from hcbench.sim.two_blocks import SIDES, folder
from hcbench.tune.target import Target

if TYPE_CHECKING:
    from collections.abc import Iterable

    from hcbench.impact import Floats
    from hcbench.sim.two_blocks import TwoBlocks

REMARK = "MuJoCo's staggered pairs lie on it too."
# Both blocks press a squeezed body at once, and all rows share in the highest impedance: 0.05 of four tried
# leaves the summed loop the nearest.
IMPEDANCE = 0.05


def own_contact(squeezed: bool) -> str:
    """Staggered pairs, squeezed or not."""
    return "staggered"


def simulate(blocks: TwoBlocks, position: float, velocity: float, forces: Floats) -> tuple[Floats, Floats]:
    """Positions and velocities at the ends of steps."""
    from hcbench.engines.mujoco.plugin.attach import attach

    mujoco = backend()
    if blocks.tuned_at is not None:
        require_feature(mujoco, "adhesion")
    model = mujoco.MjModel.from_xml_string(mjcf(blocks))
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = position, velocity
    states = [(position, velocity)]
    plugged = blocks.tuned_at is None
    with attach(model, [("ball", side) for side in SIDES], blocks.law) if plugged else nullcontext():
        for force in forces:
            data.ctrl[0] = force
            mujoco.mj_step(model, data)
            states.append((float(data.qpos[0]), float(data.qvel[0])))
    q, v = np.array(states).T
    return q, v


def mjcf(blocks: TwoBlocks) -> str:
    """The scene's MJCF: with contact as in the file, or with pairs tuned to the law about a speed.

    The scene's `tuned.xml` is such a text.
    """
    root = ET.fromstring((folder() / "scene.xml").read_text(encoding="utf-8"))
    _first(root, "option").set("timestep", repr(blocks.timestep))
    inertial = _first(root, "inertial")
    ratio = blocks.mass / float(inertial.attrib["mass"])
    inertial.set("mass", repr(blocks.mass))
    inertial.set("diaginertia", _text(float(i) * ratio for i in inertial.attrib["diaginertia"].split()))
    for geom in root.iter("geom"):
        if (side := geom.get("name", "")) in SIDES:
            geom.set("pos", _text([blocks.plane(side), 0.0, 0.0]))
    if blocks.tuned_at is not None:
        speed = blocks.tuned_at
        target = Target(blocks.law, blocks.mass, blocks.timestep, speed / 20.0, 1.5 * speed)
        options = Staggered(impedance=IMPEDANCE)(target).options
        _first(root, "option").set("integrator", options["integrator"])
        _write_pairs(root, options["rows"])
    return as_text(root)


def _write_pairs(root: ET.Element, rows: list[dict[str, Any]]) -> None:
    """Each row a <pair> with either block: the first of the ball's own geom, others of massless copies."""
    body = _first(root, "body")
    ball = _first(body, "geom")
    contact = ET.SubElement(root, "contact")
    for i, row in enumerate(rows):
        name = f"ball.{i + 1}" if i else "ball"
        if i:
            massless = copy.deepcopy(ball)
            massless.attrib.update(name=name, mass="0", contype="0", conaffinity="0", group="3")
            body.append(massless)
        values = {"solref": row["solref"], "solimp": row["solimp"], "margin": [-row["onset"]]}
        if row["adhesion"]:
            values["adhesion"] = [row["adhesion"]]
        texts = {key: _text(numbers) for key, numbers in values.items()}
        for side in SIDES:
            ET.SubElement(contact, "pair", geom1=name, geom2=side, condim="1").attrib.update(texts)


def _first(root: ET.Element, tag: str) -> ET.Element:
    return next(root.iter(tag))


def _text(numbers: Iterable[float]) -> str:
    return " ".join(f"{float(x) + 0.0!r}" for x in numbers)
