"""The files of scenes/two-blocks load in the plain engines and say what
the paper's page computes with.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from hcbench.engines.mujoco.backend import require_feature
from hcbench.engines.mujoco.recipes.staggered import staggered, staggered_rows
from hcbench.engines.mujoco.two_blocks import mjcf
from hcbench.laws import closed_form
from hcbench.paper import constants
from hcbench.paper.vibroimpact_figures import (
    FULL,
    LAW,
    LOOSE,
    STAND_IN_SPEED,
    START,
    simulate_in_engine,
)
from hcbench.recipes.target import Target
from hcbench.sim import two_blocks
from hcbench.sim.two_blocks import TwoBlocks
from hcbench.system.errors import EngineMissing, SettingError
from hcbench.terms.scene import scene_names

FOLDER = two_blocks.folder()


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def test_it_is_no_scene_of_a_ball_on_a_plate() -> None:
    assert two_blocks.NAME not in scene_names()


def test_the_mjcf_says_the_case_and_the_gap_of_the_page() -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(FOLDER / "scene.xml"))
    assert model.body("ball").mass[0] == constants.MASS
    assert model.opt.gravity.tolist() == [0.0, 0.0, 0.0]
    gap = model.geom("right").pos[0] - model.geom("left").pos[0] - 2 * model.geom("ball").size[0]
    assert gap == pytest.approx(LOOSE.gap, rel=1e-12)
    data = mujoco.MjData(model)
    data.ctrl[0] = 150.0
    mujoco.mj_step(model, data)
    assert data.qvel[0] / model.opt.timestep * constants.MASS == pytest.approx(150.0, rel=1e-12)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    assert data.qvel[0] == START


@pytest.mark.needs_engine("pybullet")
def test_the_urdfs_put_a_plane_on_either_side() -> None:
    """The test runs in a process of its own: PyBullet keeps settings in globals."""
    code = (
        "import pybullet as p, sys; p.connect(p.DIRECT); f = sys.argv[1];"
        "a = [p.loadURDF(f + '/' + n + '.urdf', [x, 0, 0], flags=p.URDF_USE_INERTIA_FROM_FILE)"
        " for n, x in (('left', -0.05155), ('ball', 0.0), ('right', 0.05155))];"
        "print(p.getDynamicsInfo(a[1], -1)[0],"
        " *(p.getClosestPoints(a[1], b, 1.0)[0][8] for b in (a[0], a[2])))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(FOLDER)], capture_output=True, text=True, check=True
    )
    mass, left, right = map(float, done.stdout.split("\n")[-2].split())
    assert mass == constants.MASS
    assert left == pytest.approx(7.5e-4, abs=1e-12)
    assert right == pytest.approx(7.5e-4, abs=1e-12)


def test_the_tuned_file_is_what_the_recipe_writes() -> None:
    """`python scenes/make_two_blocks.py` writes it again."""
    written = ET.parse(FOLDER / "tuned.xml").getroot()
    blocks = TwoBlocks(
        LOOSE.mass,
        LOOSE.gap,
        LAW,
        FULL.timestep,
        STAND_IN_SPEED,
    )
    made = ET.fromstring(mjcf(blocks))
    pairs = list(zip(written.iter(), made.iter(), strict=True))
    assert sum(element.tag == "pair" for element, _ in pairs) > 20
    for one, other in pairs:
        assert (one.tag, one.attrib.keys()) == (other.tag, other.attrib.keys())
        for key, value in one.attrib.items():
            if key in (
                "solref",
                "solimp",
                "margin",
                "adhesion",
                "pos",
                "timestep",
                "mass",
                "diaginertia",
            ):
                np.testing.assert_allclose(_numbers(value), _numbers(other.attrib[key]), rtol=1e-5)
            else:
                assert value == other.attrib[key]


@pytest.mark.adhesion
def test_the_tuned_file_runs_in_plain_mujoco_and_loses_what_the_law_loses() -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(FOLDER / "tuned.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    speeds: list[float] = []
    while len(speeds) < 3:
        mujoco.mj_step(model, data)
        if abs(data.qpos[0]) < 5e-4 and (not speeds or data.qvel[0] * speeds[-1] < 0.0):
            speeds.append(float(data.qvel[0]))
    for before, after in itertools.pairwise(speeds):
        e = float(closed_form.restitution(LAW.alpha, abs(before)))
        assert -after / before == pytest.approx(e, abs=1e-3)


def test_the_mass_and_the_gap_are_the_systems() -> None:
    root = ET.fromstring(mjcf(TwoBlocks(2.0, -1e-5, LAW, 1e-6)))
    places = {g.get("name"): _numbers(g.get("pos", "0"))[0] for g in root.iter("geom")}
    assert places["right"] - places["left"] - 2 * two_blocks.RADIUS == pytest.approx(
        -1e-5, rel=1e-9
    )
    inertial = next(root.iter("inertial"))
    assert float(inertial.attrib["mass"]) == 2.0
    own = _numbers(inertial.attrib["diaginertia"])[0]
    assert own / 1.1705586137168e-4 == pytest.approx(2.0 / constants.MASS, rel=1e-12)


def test_a_lower_impedance_asked_of_staggered_is_the_highest_there_is() -> None:
    target = Target(LAW, constants.MASS, 1e-6, 0.02, 0.6)
    for impedance in (0.05, 0.5):
        rows = staggered_rows(target, impedance=impedance)
        assert max(row.solimp[1] for row in rows) == impedance
    for wrong in (0.0, 1e-4, 0.9, float("nan")):
        with pytest.raises(SettingError, match="impedance"):
            staggered(target, impedance=wrong)


def test_a_mujoco_without_adhesion_is_named() -> None:
    class Old:
        __version__ = "3.3.0"
        MjModel = object

    with pytest.raises(EngineMissing, match=r"3\.3\.0.*no adhesion.*3\.11"):
        require_feature(Old, "adhesion")
    with pytest.raises(EngineMissing, match=r"3\.3\.0.*no mj_copyData.*3\.5"):
        require_feature(Old, "mj_copyData")


def test_the_engine_reads_the_scenes_own_files() -> None:
    pytest.importorskip("mujoco")
    found = simulate_in_engine("mujoco", LOOSE, 0.0, 0.1, 1e-3, timestep=1e-5)
    assert found.position[-1] == pytest.approx(0.1 * found.time[-1], rel=1e-9)
    late = found.since(5e-4)
    assert late.time[0] >= 5e-4
    assert late.time[-1] == found.time[-1]
