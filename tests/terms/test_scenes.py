"""Scenes: the TOML, MJCF and URDF of each say the same, and a mistake in one is reported in a line."""

from __future__ import annotations

import dataclasses
import math
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hcbench.engines.mujoco.engine import MujocoEngine
from hcbench.engines.pybullet.engine import PybulletEngine
from hcbench.laws.hertz import spheres
from hcbench.sim.engine import Engine
from hcbench.system.errors import SceneError
from hcbench.terms.impact import Launch
from hcbench.terms.scene import Scene, load_scene, read_scene, scene_names
from hcbench.terms.setting import Setting

INCH, POUND = 0.0254, 0.45359237
STOCK = Setting("mujoco", "stock", 2e-3)


@pytest.fixture(params=scene_names())
def scene(request: pytest.FixtureRequest) -> Scene:
    return load_scene(request.param)


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A copy of steel-plane to break."""
    folder = tmp_path / "mine"
    shutil.copytree(load_scene("steel-plane").models["mujoco"]["scene"].parent, folder)
    return folder


def edit(folder: Path, old: str, new: str, file: str = "scene.toml") -> Path:
    path = folder / file
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    return folder


def touch_radius(scene: Scene) -> float:
    """The sphere that the engines drop, m."""
    return scene.ball_radius if scene.form == "cup" else scene.relative_radius


# --- the case of section 3.1 ---


@pytest.mark.parametrize("name", ["steel-cup", "steel-plane"])
def test_the_built_in_scenes_are_the_case_of_section_3_1(name: str) -> None:
    scene = load_scene(name)
    assert (scene.ball_radius, scene.plate_radius) == (1 * INCH, -2 * INCH)
    assert scene.relative_radius == pytest.approx(2 * INCH, rel=1e-15)
    assert (scene.mass, scene.exponent, scene.gravity) == (POUND, 1.5, 0.0)
    pound_force = POUND * 9.80665
    assert scene.stiffness == pytest.approx(3.1e7 * pound_force / INCH**1.5, rel=1e-15)


def test_the_steel_gives_the_papers_hertz_constant(scene: Scene) -> None:
    K1 = spheres(
        scene.ball_radius, scene.plate_radius, scene.ball_material, scene.plate_material
    ).K1
    psi = POUND * 9.80665 / INCH**2
    assert K1 / psi == pytest.approx(2.198e7, rel=5e-4)
    # The paper rounds K3 = K1 sqrt(R) to two digits.
    assert K1 * math.sqrt(scene.relative_radius) == pytest.approx(scene.stiffness, rel=5e-3)


# --- TOML = MJCF ---


def test_the_mjcf_loads_in_plain_mujoco_and_says_what_the_toml_says(scene: Scene) -> None:
    code = (
        "import sys, mujoco; m = mujoco.MjModel.from_xml_path(sys.argv[1]);"
        "print(m.body('ball').mass[0], m.geom('ball').size[0])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(scene.models["mujoco"]["scene"])],
        capture_output=True,
        text=True,
        check=True,
    )
    mass, radius = map(float, done.stdout.split())
    assert mass == scene.mass
    assert radius == pytest.approx(touch_radius(scene), rel=1e-15)
    assert done.stderr == ""


def test_the_mjcf_has_the_balls_own_inertia_and_no_friction(scene: Scene) -> None:
    model = mujoco.MjModel.from_xml_path(str(scene.models["mujoco"]["scene"]))
    inertia = 0.4 * scene.mass * scene.ball_radius**2
    assert model.body("ball").inertia == pytest.approx(3 * [inertia], rel=1e-13)
    if scene.form == "plane":
        assert model.geom("ball").condim == model.geom("plate").condim == 1


@pytest.mark.parametrize("depth", [1e-6, 2.4e-5])
def test_mujoco_sees_the_penetration_right_on_the_axis(scene: Scene, depth: float) -> None:
    assert seen_by_mujoco(scene, [0, 0, -depth]) == pytest.approx(depth, abs=1e-16)


@pytest.mark.parametrize("angle", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("azimuth", [0.0, 0.7, 2.0])
def test_mujoco_sees_the_penetration_right_off_the_axis_of_the_cup(
    angle: float, azimuth: float
) -> None:
    scene, depth = load_scene("steel-cup"), 1e-5
    reach = abs(scene.plate_radius) - scene.ball_radius + depth
    sideways = reach * math.sin(angle)
    shift = [
        sideways * math.cos(azimuth),
        sideways * math.sin(azimuth),
        reach * (1 - math.cos(angle)) - depth,
    ]
    assert seen_by_mujoco(scene, shift) == pytest.approx(depth, abs=1e-16)


def seen_by_mujoco(scene: Scene, shift: list[float]) -> float:
    """Depth of the ball by the engine itself, moved by `shift` (m) from qpos0."""
    model = mujoco.MjModel.from_xml_path(str(scene.models["mujoco"]["scene"]))
    data = mujoco.MjData(model)
    data.qpos[:3] += shift
    mujoco.mj_forward(model, data)
    assert data.nefc == 1, "one contact, frictionless"
    return -float(data.efc_pos[0])


# --- TOML = URDF ---


def test_the_urdf_says_what_the_toml_says(scene: Scene) -> None:
    files = scene.models["pybullet"]
    ball, plate = (ET.parse(files[role]).getroot() for role in ("ball", "plate"))
    for shape in ("visual", "collision"):
        sphere = ball.find(f"link/{shape}/geometry/sphere")
        assert sphere is not None
        assert float(sphere.attrib["radius"]) == pytest.approx(touch_radius(scene), rel=1e-15)
        origin = ball.find(f"link/{shape}/origin")
        assert origin is None or float(origin.attrib.get("xyz", "0 0 0").split()[2]) == 0.0
    mass, inertia = ball.find("link/inertial/mass"), ball.find("link/inertial/inertia")
    assert mass is not None
    assert inertia is not None
    assert float(mass.attrib["value"]) == scene.mass
    own = 0.4 * scene.mass * scene.ball_radius**2
    for axis, value in {
        "ixx": own,
        "iyy": own,
        "izz": own,
        "ixy": 0.0,
        "ixz": 0.0,
        "iyz": 0.0,
    }.items():
        assert float(inertia.attrib[axis]) == pytest.approx(value, rel=1e-13)
    fixed = plate.find("link/inertial/mass")
    assert fixed is not None
    assert float(fixed.attrib["value"]) == 0.0
    for friction in (*ball.iter("lateral_friction"), *plate.iter("lateral_friction")):
        assert float(friction.attrib["value"]) == 0.0
    for element in (*ball.iter(), *plate.iter()):
        if "filename" in element.attrib:
            assert (files["plate"].parent / element.attrib["filename"]).is_file()


def test_the_drawn_bowl_is_the_scenes_own() -> None:
    scene = load_scene("steel-cup")
    R2 = abs(scene.plate_radius)
    lines = (
        (scene.models["pybullet"]["plate"].parent / "cup.obj")
        .read_text(encoding="ascii")
        .splitlines()
    )
    points = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=float)
    off = np.abs(np.linalg.norm(points - [0, 0, R2], axis=1) - R2)
    assert (off < 1e-7).sum() > 500, "the bowl's vertices lie on the sphere of radius R2"
    assert (points[off < 1e-7, 2] < R2).all()


# --- finding scenes ---


def test_a_scene_is_found_by_name_folder_and_file(copied: Path) -> None:
    assert load_scene(copied).name == load_scene(str(copied / "scene.toml")).name == "mine"
    assert load_scene("mine", copied.parent) == load_scene(copied)
    assert load_scene("steel-plane").name == "steel-plane"


def test_an_unknown_scene_is_answered_with_those_there_are() -> None:
    with pytest.raises(SceneError, match=r"'stel-cup' was not found.*steel-cup, steel-plane"):
        load_scene("stel-cup")


def test_a_new_scene_is_a_folder_and_no_code(copied: Path) -> None:
    """A half-inch ball of bronze on a flat plate: numbers changed, nothing else."""
    for old, new in {
        "radius = 0.0254": 'radius = "0.5 in"',
        "mass = 0.45359237": 'mass = "80 g"',
        "radius = -0.0508": "radius = inf",
        "stiffness = 34064148317.371407": 'stiffness = "8e6 lbf/in^1.5"',
    }.items():
        edit(copied, old, new)
    mjcf = {
        'pos="0 0 0.0508"': 'pos="0 0 0.0127"',
        'size="0.0508"': 'size="0.0127"',
        "0.45359237": "0.08",
    }
    for old, new in mjcf.items():
        edit(copied, old, new, "scene.xml")
    scene = load_scene(copied)
    assert scene.relative_radius == pytest.approx(0.0127)
    (impact,) = MujocoEngine().run(scene, STOCK, [Launch(0.2)])
    assert impact.status == "parted"


# --- mistakes: one line with file, slot, what came, what was expected ---


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("schema = 1", "schema = 2", "schema: 2; expected 1"),
        ("schema = 1\n", "", "schema: missing; expected 1"),
        ("schema = 1", "schema = true", "schema: True; expected 1"),
        ("schema = 1", "schema = 1.0", "schema: 1.0; expected 1"),
        ("title = ", "title = []\n# ", "title: []; expected text"),
        ("[ball]", "[ball]\ncolour = 3", "ball.colour: unknown key; expected one of: radius, "),
        ("[ball]", "[bal]", "bal: unknown key; expected one of: ball, "),
        ("gravity = 0.0", "gravty = 0.0", "gravty: unknown key; expected one of: gravity, schema"),
        ("gravity = 0.0", "gravity = -9.8", "gravity: -9.8 m/s^2; expected 0 m/s^2 or more"),
        ('form = "plane"', 'form = "bowl"', "form: 'bowl'; expected 'cup' or 'plane'"),
        ("mass = 0.45359237", "mass = 0", "ball.mass: 0.0 kg; expected above 0 kg"),
        ("mass = 0.45359237", "mass = nan", "ball.mass: nan is not finite"),
        ("mass = 0.45359237", 'mass = "1 in"', "ball.mass: '1 in': 'in' does not fit"),
        ("mass = 0.45359237", "mass = [1]", "ball.mass: [1]; expected a number or text"),
        ("radius = 0.0254", "radius = -0.0254", "ball.radius: -0.0254 m; expected above 0 m"),
        (
            "radius = -0.0508",
            "radius = -0.0254",
            "plate.radius: -0.0254 m under a ball of 0.0254 m",
        ),
        (
            "poisson_ratio = 0.3",
            "poisson_ratio = 0.5",
            "ball.poisson_ratio: 0.5; expected within -1 ... 0.5",
        ),
        ("exponent = 1.5", "exponent = 0.5", "law.exponent: 0.5; expected 1 ... 5"),
        ("[law]", "[law]\nk = 1", "law.k: unknown key; expected one of: stiffness, exponent"),
        (
            'scene = "scene.xml"',
            'scene = "gone.xml"',
            "models.mujoco.scene: 'gone.xml' is not there",
        ),
        ('scene = "scene.xml"', "scene = 3", "models.mujoco.scene: 3"),
        ("schema = 1", "schema == 1", "not TOML"),
    ],
)
def test_a_mistake_in_the_toml_is_one_clear_line(
    copied: Path, old: str, new: str, said: str
) -> None:
    with pytest.raises(SceneError) as caught:
        read_scene(edit(copied, old, new))
    message = str(caught.value)
    assert said in message
    assert str(copied / "scene.toml") in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("</worldbody>", "</world>", "not XML"),
        ('<body name="ball"', '<body name="bal"', "there is no <body name='ball'>"),
        (
            '<freejoint name="ball"/>',
            '<joint type="ball"/>' + 3 * "<joint type='slide'/>",
            "move freely",
        ),
        ('<geom name="ball"', '<geom name="b"', "no geom 'ball'"),
        ('<geom name="plate"', '<geom name="p"', "no fixed geom 'plate'"),
        ('<geom name="plate" type="plane"', '<geom name="plate" type="plain"', "MuJoCo loads"),
        (
            'size="0.0508"',
            'size="0.0507"',
            "geom 'ball' size: 0.0507 m; expected 0.0508 m, the 1/(1/R1 + 1/R2)",
        ),
        (
            'type="sphere" size="0.0508"',
            'type="box" size=".1 .1 .0508"',
            "not a sphere; expected a sphere of",
        ),
        ('pos="0 0 0.0508"', 'pos="0 0 0.0509"', "overlap by -9.0"),
        ('pos="0 0 0.0508"', 'pos="0 0 0.051"', "overlap by"),
        ('<inertial pos="0 0 0"', '<inertial pos="0 0 0.01"', "off its body's origin"),
        ('mass="0.45359237"', 'mass="heavy"', "mass 'heavy'"),
        # What is not contact but changes the ball's momentum would be
        # taken for it: e = 0, "rested".
        ("<worldbody>", '<option density="1.2"/><worldbody>', "only gravity to act on it"),
        (
            '<freejoint name="ball"/>',
            '<joint type="free" damping="1"/>',
            "only gravity to act on it",
        ),
        (
            '<freejoint name="ball"/>',
            '<joint type="free" armature="1"/>',
            "only gravity to act on it",
        ),
        (
            '<freejoint name="ball"/>',
            '<freejoint/><body pos=".1 0 0"><geom size=".01" mass=".1"/></body>',
            "only gravity to act on it",
        ),
    ],
)
def test_a_mistake_in_the_mjcf_is_one_clear_line(
    copied: Path, old: str, new: str, said: str
) -> None:
    scene = read_scene(edit(copied, old, new, "scene.xml"))
    with pytest.raises(SceneError) as caught:
        MujocoEngine().run(scene, STOCK, [Launch(0.2)])
    message = str(caught.value)
    assert said in message
    assert str(copied / "scene.xml") in caught.value.slot  # the message may cut a long path
    assert "\n" not in message


@pytest.mark.needs_engine("pybullet")
def test_a_smaller_ball_that_touches_is_not_taken_for_the_scenes_own(copied: Path) -> None:
    """Ball and place moved together: nothing overlaps wrongly, yet it is another ball."""
    for old, new in (('pos="0 0 0.0508"', 'pos="0 0 0.03"'), ('size="0.0508"', 'size="0.03"')):
        edit(copied, old, new, "scene.xml")
    edit(copied, 'sphere radius="0.0508"', 'sphere radius="0.03"', "ball.urdf")
    said = r"size: 0\.03 m; expected 0\.0508 m, the 1/\(1/R1 \+ 1/R2\) of scene\.toml"
    with pytest.raises(SceneError, match=said):
        MujocoEngine().run(read_scene(copied), STOCK, [Launch(0.2)])
    with pytest.raises(SceneError, match=r"ball\.urdf: sphere radius: '0\.03'; expected 0\.0508 m"):
        PybulletEngine().run(read_scene(copied), Setting("pybullet", "stock", 1e-3), [Launch(0.2)])


@pytest.mark.parametrize("form", ["cup", "plane"])
@pytest.mark.parametrize("engine", [MujocoEngine(), PybulletEngine()], ids=["mujoco", "pybullet"])
def test_a_radius_changed_in_the_toml_alone_is_seen_by_both_engines(
    engine: Engine, form: str
) -> None:
    scene = load_scene(f"steel-{form}")
    R1, R2 = scene.ball_radius, scene.plate_radius
    # Both together, so that a cup leaves the ball as much room as before.
    other = dataclasses.replace(scene, ball_radius=R1 + 1e-6, plate_radius=R2 - 1e-6)
    what = r"R1 of scene\.toml" if form == "cup" else r"1/\(1/R1 \+ 1/R2\) of scene\.toml"
    with pytest.raises(SceneError, match=what):
        engine.run(other, Setting(engine.name, "stock", 1e-3), [Launch(0.2)])


@pytest.mark.needs_engine("pybullet")
@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        (
            "ball",
            'mass value="0.45359237"',
            'mass value="0"',
            "mass: '0'; expected a mass in kg above 0",
        ),
        (
            "ball",
            'mass value="0.45359237"',
            'mass value="abc"',
            "mass: 'abc'; expected a mass in kg above 0",
        ),
        (
            "ball",
            'mass value="0.45359237"',
            'mass value="-1"',
            "mass: '-1'; expected a mass in kg above 0",
        ),
        (
            "ball",
            'mass value="0.45359237"',
            'mass value="inf"',
            "mass: 'inf'; expected a mass in kg above 0",
        ),
        ("ball", 'mass value="0.45359237"', "mass", "mass: missing; expected a mass in kg above 0"),
        ("ball", "</robot>", "", "cannot be read: no element found"),
        (
            "ball",
            "<collision>",
            '<collision><origin xyz="0 0 1e-4"/>',
            "overlap by none where the scene says",
        ),
        (
            "plate",
            'mass value="0"',
            'mass value="1e-3"',
            "mass: '1e-3'; expected 0, which fixes it in Bullet",
        ),
        (
            "plate",
            'mass value="0"',
            'mass value="none"',
            "mass: 'none'; expected 0, which fixes it in Bullet",
        ),
        ("plate", '<mass value="0"/>', "", "mass: missing, which Bullet reads as 1 kg; expected 0"),
    ],
)
def test_a_mistake_in_the_urdf_is_one_clear_line(
    copied: Path, file: str, old: str, new: str, said: str
) -> None:
    edit(copied, old, new, f"{file}.urdf")
    with pytest.raises(SceneError) as caught:
        PybulletEngine().run(read_scene(copied), Setting("pybullet", "stock", 1e-3), [Launch(0.2)])
    message = str(caught.value)
    assert said in message
    assert f"{file}.urdf" in message or "URDFs of ball and plate" in message
    assert "\n" not in message
    assert caught.value.exit_code == 2


def test_a_cup_without_its_tendon_and_one_of_another_size_are_refused(tmp_path: Path) -> None:
    own = load_scene("steel-cup").models["mujoco"]["scene"].parent
    for old, new, said in (
        ('<spatial name="contact"', '<spatial name="other"', "no limited tendon 'contact'"),
        ('range="0 0.0254"', 'range="0 0.0253"', "overlap by"),
    ):
        folder = tmp_path / new[-7:-1].strip(' "')
        shutil.copytree(own, folder)
        with pytest.raises(SceneError, match=said):
            MujocoEngine().run(
                read_scene(edit(folder, old, new, "scene.xml")), STOCK, [Launch(0.2)]
            )


def test_a_scene_without_a_mujoco_model_is_refused() -> None:
    bare = dataclasses.replace(load_scene("steel-plane"), models={})
    with pytest.raises(SceneError, match="no MuJoCo model"):
        MujocoEngine().run(bare, STOCK, [Launch(0.2)])


def test_unreadable_files_are_refused(copied: Path) -> None:
    (copied / "scene.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SceneError, match="readable TOML"):
        read_scene(copied)


def test_includes_and_asset_folders_work_from_anywhere(
    copied: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (copied / "meshes").mkdir()
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    (copied / "meshes" / "mark.obj").write_text(corners, encoding="ascii")
    (copied / "more.xml").write_text(
        '<mujoco><compiler meshdir="meshes"/><asset><mesh name="mark" file="mark.obj"/></asset></mujoco>',
        encoding="utf-8",
    )
    mark = '<geom type="mesh" mesh="mark" pos="1 1 1" contype="0" conaffinity="0"/></worldbody>'
    edit(copied, "</worldbody>", mark, "scene.xml")
    edit(copied, "<worldbody>", '<include file="more.xml"/><worldbody>', "scene.xml")
    monkeypatch.chdir(tmp_path)
    (impact,) = MujocoEngine().run(load_scene("mine", tmp_path), STOCK, [Launch(0.2)])
    assert impact.status == "parted"
    (copied / "more.xml").write_text(
        '<mujoco><include file="more.xml"/></mujoco>', encoding="utf-8"
    )
    with pytest.raises(SceneError, match="includes itself"):
        MujocoEngine().run(load_scene(copied), STOCK, [Launch(0.2)])


@pytest.mark.parametrize("name", ["a" * 5000, "a\0b"])
def test_a_name_that_no_folder_can_have_is_refused(name: str) -> None:
    with pytest.raises(SceneError, match="was not found"):
        load_scene(name)


def test_a_model_whose_name_no_file_can_have_is_refused(copied: Path) -> None:
    text = (copied / "scene.toml").read_text(encoding="utf-8")
    (copied / "scene.toml").write_text(
        text.replace("ball.urdf", "b" * 5000 + ".urdf"), encoding="utf-8"
    )
    with pytest.raises(SceneError, match="is not there"):
        load_scene(copied)
