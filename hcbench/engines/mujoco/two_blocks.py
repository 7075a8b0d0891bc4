"""The scene `two-blocks` in MuJoCo, by the plug-in or by `staggered`
pairs: see `hcbench.sim.two_blocks`.
"""

import xml.etree.ElementTree as ET

import numpy as np

from hcbench.engines.mujoco.backend import backend, require_feature
from hcbench.engines.mujoco.plugin import extension, load
from hcbench.engines.mujoco.recipes.staggered import staggered_rows
from hcbench.engines.mujoco.scene.elements import as_text
from hcbench.engines.mujoco.scene.mjcf import add_pairs, numbers_text, set_mass
from hcbench.recipes.target import Target
from hcbench.sim.two_blocks import SIDES, TwoBlocks, folder
from hcbench.terms.impact import Floats

NOTE = "MuJoCo's staggered pairs lie on it too."
# Both blocks press a squeezed body at once, and all rows share in the highest impedance: 0.05 of
# four tried leaves the summed loop the nearest.
IMPEDANCE = 0.05


def own_contact(squeezed: bool) -> str:
    """Staggered pairs, squeezed or not."""
    return "staggered"


def simulate(
    blocks: TwoBlocks, position: float, velocity: float, forces: Floats
) -> tuple[Floats, Floats]:
    """Simulate the ball between two planes: its positions, m, and velocities, m/s, along x before the
    first step and after each, (n + 1,) each.

    position, velocity: at the start, m and m/s.
    forces: on the ball along x in each step, N, (n,).

    Raises EngineMissing for a MuJoCo without adhesion, which the tuned pairs need.
    """
    mujoco = backend()
    if blocks.tuned_at is not None:
        require_feature(mujoco, "adhesion")
    root = ET.fromstring(mjcf(blocks))
    # Without tuned pairs the law acts as a plug-in, in place of MuJoCo's own contact.
    if blocks.tuned_at is None:
        load()
        pair = {"body1": "world", "body2": "ball"}
        root.append(extension(blocks.law, pair))
        ET.SubElement(ET.SubElement(root, "contact"), "exclude", pair)
    model = mujoco.MjModel.from_xml_string(as_text(root))
    data = mujoco.MjData(model)
    # The ball is on one slide, along x, with one motor.
    data.qpos[0] = position
    data.qvel[0] = velocity
    states = [(position, velocity)]
    for force in forces:
        data.ctrl[0] = force
        mujoco.mj_step(model, data)
        states.append((float(data.qpos[0]), float(data.qvel[0])))
    q, v = np.array(states).T
    return q, v


def mjcf(blocks: TwoBlocks) -> str:
    """The MJCF of the scene `two-blocks`, as text: with the contact that its file has, or, for
    `blocks.tuned_at`, with <pair>s that follow the law around this speed.

    The scene's `tuned.xml` is such a text.
    """
    path = folder() / "scene.xml"
    root = ET.fromstring(path.read_text(encoding="utf-8"))
    _first(root, "option").set("timestep", repr(blocks.timestep))
    set_mass(_first(root, "body"), blocks.mass, path)
    for geom in root.iter("geom"):
        if (side := geom.get("name", "")) in SIDES:
            geom.set("pos", numbers_text([blocks.plane(side), 0.0, 0.0]))
    if blocks.tuned_at is not None:
        speed = blocks.tuned_at
        # A band of speeds, m/s, down to a twentieth, as impacts lose speed.
        target = Target(blocks.law, blocks.mass, blocks.timestep, speed / 20.0, 1.5 * speed)
        _first(root, "option").set("integrator", "Euler")
        ball = _first(_first(root, "body"), "geom")
        add_pairs(root, ball, SIDES, staggered_rows(target, impedance=IMPEDANCE))
    return as_text(root)


def _first(root: ET.Element, tag: str) -> ET.Element:
    return next(root.iter(tag))
