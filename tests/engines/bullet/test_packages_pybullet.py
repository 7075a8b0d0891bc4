"""URDFs whose meshes are named by package://, as ROS packages have them."""

from pathlib import Path

import pytest

from hcbench.measuring import measure

pytest.importorskip("pybullet")

INERTIA = '<inertia ixx="{0}" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"/>'
LINK = """<robot name="{name}"><link name="{name}"><inertial><mass value="{mass}"/>{inertia}</inertial>
<collision><geometry>{shape}</geometry></collision></link></robot>"""
MESH = '<mesh filename="package://data/robots/arm/meshes/box.obj"/>'
CORNERS = [(x, y, z) for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (-0.05, 0.05)]
FACES = ["1 2 4", "1 4 3", "5 7 8", "5 8 6", "1 5 6", "1 6 2", "3 4 8", "3 8 7", "1 3 7", "1 7 5"]


def test_a_mesh_in_a_package_high_above_the_urdf_is_found_as_loadurdf_finds_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = tmp_path / "data" / "robots" / "arm"
    for folder in ("urdf", "meshes"):
        (arm / folder).mkdir(parents=True)
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [
        f"f {face}" for face in (*FACES, "2 6 8", "2 8 4")
    ]
    (arm / "meshes" / "box.obj").write_text("\n".join(lines))
    box, plane = arm / "urdf" / "box.urdf", arm / "urdf" / "plane.urdf"
    box.write_text(LINK.format(name="box", mass=1, inertia=INERTIA.format(0.01), shape=MESH))
    shape = '<plane normal="0 0 1"/>'
    plane.write_text(LINK.format(name="plane", mass=0, inertia=INERTIA.format(0), shape=shape))
    monkeypatch.chdir(tmp_path)
    files = box.relative_to(tmp_path), plane.relative_to(tmp_path)
    found = measure(files, engine="pybullet", speeds=[1.0], phases=1, diagnose=False)
    assert found.facts.normal == pytest.approx((0, 0, -1), abs=1e-6)
