"""Names of parts of a model and the parts they stand for; URDFs whose meshes are named by ROS packages, in
every engine that opens URDFs.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from hcbench.checking.text import checks_of
from hcbench.measuring.measure import Job, list_pairs, pairs
from hcbench.measuring.request import make_request
from hcbench.sim.packages import (
    find_part,
    folders_of,
    read_packages,
    suggest_names,
    with_absolute_files,
)
from hcbench.system.errors import UserError

PARTS = [("body", "ball", 1), ("geom", "ball", 0), ("geom", "plate", 2), ("geom", "geom:3", 3)]


@pytest.mark.parametrize(
    ("request_", "part"),
    [
        ("ball", ("body", 1)),
        ("geom:ball", ("geom", 0)),
        ("geom:2", ("geom", 2)),
        ("geom:3", ("geom", 3)),
        ("plate", ("geom", 2)),
    ],
)
def test_the_first_of_a_name_is_meant_unless_its_kind_is_given(
    request_: str, part: tuple[str, int]
) -> None:
    assert find_part(PARTS, request_) == part


@pytest.mark.parametrize("request_", ["bal", "body:plate", "body:7", ""])
def test_what_is_not_there_is_refused_with_the_names_that_are(request_: str) -> None:
    with pytest.raises(
        UserError, match=f"no body or geom '{request_}'.*one of: ball, plate, geom:3"
    ):
        find_part(PARTS, request_)


def test_the_nearest_name_is_suggested_and_a_long_list_is_cut() -> None:
    expected, nearest = suggest_names("prt20", [f"part{i}" for i in range(30)])
    assert nearest == "Did you mean 'part20'?"
    assert expected.endswith("part11, ...")
    assert suggest_names("x", ["", ""]) == ("one of: none has a name", "")


LINK = """<link name="{name}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 {z}"/><geometry><mesh filename="{file}"/></geometry></collision></link>"""
CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
FACES = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """ws/src/arms/urdf/arm.urdf names package://arms/... and
    package://tools/..., which is elsewhere.
    """
    cube = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "".join(
        f"f {face}\n" for face in FACES
    )
    for folder in ("ws/src/arms/meshes", "elsewhere/meshes"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "cube.obj").write_text(cube)
    links = LINK.format(name="base", z=0, file="package://arms/meshes/cube.obj")
    links += LINK.format(name="hand", z=4, file="package://tools/meshes/cube.obj")
    joint = '<joint name="j" type="revolute"><parent link="base"/><child link="hand"/><axis xyz="0 0 1"/>'
    joint += '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    (tmp_path / "ws/src/arms/urdf").mkdir()
    file = tmp_path / "ws/src/arms/urdf/arm.urdf"
    file.write_text(f'<robot name="arm">{links}{joint}</robot>')
    return file


def plane_in(folder: Path) -> Path:
    """A file with a plane to put a robot beside."""
    plane = folder / "plane.sdf"
    box = "<geometry><box><size>9 9 1</size></box></geometry>"
    link = f'<link name="plane"><collision name="plane">{box}</collision></link>'
    plane.write_text(f'<sdf version="1.6"><model name="p"><static>1</static>{link}</model></sdf>')
    return plane


def test_a_package_is_looked_for_above_the_file_unless_it_is_given(
    robot: Path, tmp_path: Path
) -> None:
    assert folders_of(robot, ()) == {"arms": tmp_path / "ws/src/arms"}
    given = read_packages(f"tools={tmp_path / 'elsewhere'}")
    assert folders_of(robot, given)["tools"] == tmp_path / "elsewhere"
    text = with_absolute_files(robot, given)
    assert "package://" not in text
    assert str(tmp_path / "elsewhere/meshes/cube.obj") in text
    assert "package://tools/" in with_absolute_files(robot, ())


@pytest.mark.parametrize("engine", ["mujoco", "pybullet", "drake"])
def test_an_engine_opens_what_the_packages_name(engine: str, robot: Path, tmp_path: Path) -> None:
    if engine == "drake":
        pytest.importorskip("pydrake")
    source = str(robot) if engine == "mujoco" else (str(robot), str(plane_in(tmp_path)))
    request = make_request(None, package={"tools": str(tmp_path / "elsewhere")})
    pairs = list_pairs(Job(source, engine, request, None, 0.02, diagnose=False))
    assert "hand" in str([(pair.bodies, pair.geoms) for pair in pairs])


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_a_folder_may_have_a_name_that_xml_escapes(
    engine: str, robot: Path, tmp_path: Path
) -> None:
    work = tmp_path / "R&D's"
    (tmp_path / "ws").rename(work)
    (work / "src/arms/meshes/cube.obj").rename(work / "src/arms/meshes/b & c.obj")
    file = work / "src/arms/urdf/arm.urdf"
    text = file.read_text().replace("tools", "arms").replace("cube.obj", "b &amp; c.obj")
    file.write_text(text)
    assert folders_of(file, ()) == {"arms": work / "src/arms"}
    root = ElementTree.fromstring(with_absolute_files(file, ()))
    names = [mesh.get("filename") for mesh in root.iter("mesh")]
    assert names == 2 * [str(work / "src/arms/meshes/b & c.obj")]
    source = str(file) if engine == "mujoco" else (str(file), str(plane_in(tmp_path)))
    pairs = list_pairs(Job(source, engine, make_request(None), None, 0.02, diagnose=False))
    assert "hand" in str([(pair.bodies, pair.geoms) for pair in pairs])


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    for text in (f"tools={tmp_path / 'nowhere'}", "tools", "=x"):
        with pytest.raises(UserError, match="NAME=DIR"):
            read_packages(text)


@pytest.mark.needs_engine("pybullet")
def test_a_urdf_alone_is_offered_a_floor(robot: Path) -> None:
    robot.write_text(robot.read_text().replace("tools", "arms"))
    with pytest.raises(UserError, match=r"such as a floor. Add a floor: .*plane.urdf"):
        list_pairs(Job(str(robot), "pybullet", make_request(None), None, 0.02, diagnose=False))


def test_a_file_of_checks_names_packages_from_its_own_folder(robot: Path, tmp_path: Path) -> None:
    """Packages are found from the file's folder as models are, not from
    the folder that `check` runs in.
    """
    checks = tmp_path / "checks.toml"
    entry = (
        f'model = "{robot.relative_to(tmp_path)}"\npackage = "tools=elsewhere"\nrestitution = 0.5\n'
    )
    checks.write_text(f"[[check]]\n{entry}")
    (check,) = checks_of(checks)
    assert check.request.packages == (("tools", str(tmp_path / "elsewhere")),)


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        (
            '<mesh filename="package://gone/hand.stl"/>',
            "files of package 'gone'.* package gone=FOLDER",
        ),
        ('<mesh filename="model://gone/hand.stl"/>', "files of package 'gone'"),
        ('<sphere radius="0.1"/>', "MuJoCo fixes its root link.*engine pybullet"),
        ("<xacro:ball/>", "written in xacro"),
    ],
)
def test_a_urdf_that_mujoco_cannot_let_collide_says_what_to_do(
    tmp_path: Path, shape: str, words: str
) -> None:
    ball = tmp_path / "ball.urdf"
    ball.write_text(f"""<robot name="r" xmlns:xacro="x"><link name="ball"><collision><geometry>{shape}
      </geometry></collision></link></robot>""")
    with pytest.raises(UserError, match=words):
        pairs(ball, engine="mujoco")
