"""PyBullet worlds of a user's own, measured: held against loops over
stepSimulation written by hand.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from free_flight import speed_at_plane

from hcbench.measuring import measure
from hcbench.measuring.measure import pairs
from hcbench.system.errors import SceneError, UserError
from hcbench.terms.impact import Status
from hcbench.workers import call

pytest.importorskip("pybullet")

H = 1.0 / 240.0
RADIUS = 0.05


def urdf(name: str, shape: str, mass: float, extra: str = "", joints: str = "") -> str:
    inertia = 0.4 * mass * RADIUS**2
    return f"""<?xml version="1.0"?><robot name="{name}"><link name="{name}_link">{extra}
      <inertial><mass value="{mass}"/>
        <inertia ixx="{inertia}" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia}"/></inertial>
      <collision><geometry>{shape}</geometry></collision></link>{joints}</robot>"""


def restitution(e: float) -> str:
    return f'<contact><restitution value="{e}"/></contact>'


def chain(kind: str, *joints: tuple[str, str]) -> str:
    """A robot of joints, each between a parent and a child."""
    names = dict.fromkeys(name for ends in joints for name in ends)
    links = "".join(f'<link name="{name}"/>' for name in names)
    between = "".join(
        f'<joint name="{number}" type="{kind}"><parent link="{parent}"/><child link="{child}"/></joint>'
        for number, (parent, child) in enumerate(joints)
    )
    return f'<robot name="r">{links}{between}</robot>'


SPHERE = f'<sphere radius="{RADIUS}"/>'
PLANE = '<plane normal="0 0 1"/>'


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    ball, plate = tmp_path / "ball.urdf", tmp_path / "plate.urdf"
    ball.write_text(urdf("ball", SPHERE, 0.7, restitution(0.8)))
    plate.write_text(urdf("plate", PLANE, 0, restitution(1)))
    return ball, plate


SETUP = """
import pybullet as p
from hcbench.engines.pybullet.model.open import LiveWorld as World

def build():
    c = p.connect(p.DIRECT)
    p.setPhysicsEngineParameter(contactBreakingThreshold=0.02, numSubSteps=0, physicsClientId=c)
    p.setTimeStep({h}, physicsClientId=c)
    {world}
    plate = p.loadURDF({plate!r}, physicsClientId=c)
    ball = p.loadURDF({ball!r}, [0, 0, 1], physicsClientId=c)
    {body}
    return World(c, ball, plate)
"""
RIGHT_WORLD = (
    "p.setPhysicsEngineParameter(restitutionVelocityThreshold=0, contactSlop=0, physicsClientId=c);"
    "p.setPhysicsEngineParameter(contactERP=0, erp=0, physicsClientId=c)"
)
RIGHT_BALL = (
    "p.changeDynamics(ball, -1, linearDamping=0, angularDamping=0, physicsClientId=c);"
    "p.changeDynamics(ball, -1, contactProcessingThreshold=0, physicsClientId=c)"
)


def setup(files: tuple[Path, Path], world: str = "", body: str = "", h: float = H) -> str:
    path = files[0].parent / "setup.py"
    path.write_text(
        SETUP.format(
            h=h, world=world or "pass", body=body or "pass", ball=str(files[0]), plate=str(files[1])
        )
    )
    return f"{path}:build"


def bounce_by_hand(
    ball: str, plate: str, h: float, gravity: float, speed: float, phase: float
) -> tuple[float, float]:
    """(speed in, speed out): the loop that a user writes. Runs in the
    worker, as PyBullet's globals leak.
    """
    import pybullet as p

    c = p.connect(p.DIRECT)
    p.setPhysicsEngineParameter(
        contactBreakingThreshold=0.02, numSubSteps=0, fixedTimeStep=h, physicsClientId=c
    )
    p.setGravity(0, 0, -gravity, physicsClientId=c)
    p.loadURDF(plate, physicsClientId=c)
    body = p.loadURDF(ball, [0, 0, RADIUS + (2 + phase) * h * speed], physicsClientId=c)
    p.resetBaseVelocity(body, [0, 0, -speed], [0, 0, 0], physicsClientId=c)
    into, hit = speed, False
    for _ in range(2_000):
        height = p.getBasePositionAndOrientation(body, physicsClientId=c)[0][2] - RADIUS
        before = p.getBaseVelocity(body, physicsClientId=c)[0][2]
        p.stepSimulation(physicsClientId=c)
        acting = any(point[9] > 0 for point in p.getContactPoints(body, 0, physicsClientId=c))
        if acting and not hit:
            into, hit = speed_at_plane(height, before, gravity, h), True
        if hit and not acting and before > 0:
            p.disconnect(c)
            return into, speed_at_plane(height, before, gravity, h)
    p.disconnect(c)
    return into, 0.0


@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize("speed", [0.3, 1.0])
@pytest.mark.parametrize("phase", [0.125, 0.7])
def test_e_as_loaded_is_that_of_a_loop_written_by_hand(
    files: tuple[Path, Path], gravity: float, speed: float, phase: float
) -> None:
    into, out = call(
        bounce_by_hand, str(files[0]), str(files[1]), H, gravity, speed, phase, limit=30
    )
    found = measure(files, speeds=[speed], phases=[phase], gravity=gravity, diagnose=False)
    (impact,) = found.impacts
    assert impact.speed_in == pytest.approx(into, rel=1e-9)
    assert impact.restitution == pytest.approx(out / into, abs=1e-9)


def test_as_loaded_means_bullets_own_step_and_no_gravity(files: tuple[Path, Path]) -> None:
    found = measure(files, speeds=[1.0], diagnose=False)
    assert found.facts.point == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert found.facts.timestep == H
    assert found.facts.gravity == (0.0, 0.0, 0.0)
    assert found.facts.asked == (0.8,)
    assert found.facts.effective_mass == pytest.approx(0.7, rel=1e-12)
    assert found.facts.normal == pytest.approx((0, 0, -1))


@pytest.mark.parametrize("h", [H, 1e-3, 1e-5])
def test_a_world_set_up_right_has_the_e_that_was_set(files: tuple[Path, Path], h: float) -> None:
    built = setup(files, RIGHT_WORLD, RIGHT_BALL, h)
    found = measure(built, phases=8, diagnose=False, rest=False)
    assert [i.restitution for i in found.impacts] == pytest.approx(
        [0.8] * len(found.impacts), abs=1e-9
    )
    assert found.spread < 1e-9


@pytest.mark.parametrize(
    ("shape", "pushes_one_point"),
    [('<cylinder radius="0.05" length="0.1"/>', True), ('<box size="0.1 0.1 0.1"/>', False)],
)
def test_a_body_that_lands_on_its_face_is_read_at_the_middle_of_it(
    tmp_path: Path, shape: str, pushes_one_point: bool
) -> None:
    body, plate = tmp_path / "body.urdf", tmp_path / "plate.urdf"
    body.write_text(urdf("body", shape, 0.7, restitution(0.7)))
    plate.write_text(urdf("plate", '<box size="4 4 2"/>', 0, restitution(1)))
    measured = measure([body, plate], speeds=["2 m/s"], phases=[0.3], diagnose=False)
    assert measured.facts.effective_mass == pytest.approx(0.7, rel=1e-6)
    assert measured.facts.point == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)
    assert any("one point" in note for note in measured.facts.notes) == pushes_one_point


def test_force_is_that_of_the_step_from_its_state(files: tuple[Path, Path]) -> None:
    built = setup(files, RIGHT_WORLD, RIGHT_BALL)
    (impact,) = measure(built, speeds=[1.0], phases=[0.3], diagnose=False).impacts
    assert impact.loop is not None
    assert impact.samples == 1
    assert impact.loop.force.sum() * H == pytest.approx(0.7 * 1.8 * impact.speed_in, rel=1e-9)
    assert impact.penetration_max == pytest.approx(0.7 * H, rel=1e-6), (
        "the overlap in which the touch was seen"
    )


def test_two_free_bodies_have_their_reduced_mass(files: tuple[Path, Path], tmp_path: Path) -> None:
    other = tmp_path / "other.urdf"
    other.write_text(urdf("other", SPHERE, 1.4, restitution(1)))
    built = setup((files[0], other), RIGHT_WORLD, RIGHT_BALL)
    found = measure(built, speeds=[0.5], diagnose=False)
    assert found.facts.effective_mass == pytest.approx(0.7 * 1.4 / 2.1, rel=1e-9)
    assert [i.restitution for i in found.impacts] == pytest.approx([0.8] * 4, abs=1e-9)


SLIDER = f"""<link name="slider"><contact><restitution value="0.8"/></contact>
  <inertial><mass value="0.7"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial>
  <collision><geometry>{SPHERE}</geometry></collision></link>
  <joint name="rail" type="prismatic"><parent link="post_link"/><child link="slider"/><axis xyz="0 0 1"/>
  <limit lower="-5" upper="5" effort="0" velocity="100"/></joint>"""


def test_a_link_on_a_prismatic_joint(files: tuple[Path, Path], tmp_path: Path) -> None:
    post = tmp_path / "post.urdf"
    text = urdf("post", '<box size=".01 .01 .01"/>', 0, joints=SLIDER)
    post.write_text(text)
    body = (
        "p.setJointMotorControl2(ball, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=c)\n"
        "    p.changeDynamics(ball, -1, linearDamping=0, angularDamping=0, physicsClientId=c)\n"
        "    p.changeDynamics(ball, 0, contactProcessingThreshold=0, jointDamping=0, physicsClientId=c)"
    )
    built = setup((post, files[1]), RIGHT_WORLD, body)
    found = measure(built, speeds=[0.5], diagnose=False)
    assert "rail" in found.facts.moved
    assert found.facts.effective_mass == pytest.approx(0.7, rel=1e-9)
    assert [i.restitution for i in found.impacts] == pytest.approx([0.8] * 4, abs=1e-6)
    # A joint has a way of its own: from which side was ignored.
    with pytest.raises(UserError, match="coming_from: given with move 'joint:rail'"):
        measure(built, speeds=[0.5], move="joint:rail", coming_from="above")


def test_one_file_after_another_leaks_nothing(files: tuple[Path, Path]) -> None:
    def e() -> list[float]:
        return [i.restitution for i in measure(files, speeds=[0.1, 0.5], diagnose=False).impacts]

    first = e()
    measure(files, speeds=[0.5], timestep=1e-4, gravity=9.81, rest=False)
    leaky = RIGHT_WORLD + "; p.setPhysicsEngineParameter(contactBreakingThreshold=0.001)"
    measure(setup(files, leaky, RIGHT_BALL), speeds=[0.5], rest=False)
    assert e() == first


def test_gravity_in_substeps_is_no_contact_force(files: tuple[Path, Path]) -> None:
    """A ball in free flight gains g h a step and feels nothing; Bullet reverses it within one step."""
    fine = RIGHT_WORLD + "; p.setPhysicsEngineParameter(numSubSteps=4, physicsClientId=c)"
    world = setup(files, fine, RIGHT_BALL)
    found = measure(world, speeds=[0.5, 1.0], phases=3, gravity=9.81, diagnose=False, rest=False)
    assert [impact.status for impact in found.impacts] == [Status.PARTED] * 6
    assert [impact.samples for impact in found.impacts] == [1] * 6


def measured_live(ball: str, plate: str) -> dict[str, Any]:
    """A live client, before and after; in the worker."""
    import pybullet as p

    from hcbench.engines.pybullet.model.open import LiveWorld as World

    c = p.connect(p.DIRECT)
    p.setPhysicsEngineParameter(fixedTimeStep=1e-3, numSubSteps=0, physicsClientId=c)
    p.setGravity(0, 0, -1.5, physicsClientId=c)
    floor = p.loadURDF(plate, physicsClientId=c)
    body = p.loadURDF(ball, [0.3, 0.1, 0.4], physicsClientId=c)
    p.resetBaseVelocity(body, [0.1, 0, 0.2], [1, 2, 3], physicsClientId=c)

    def state() -> Any:
        place = p.getBasePositionAndOrientation(body, physicsClientId=c)
        return place, p.getBaseVelocity(body, physicsClientId=c), p.getPhysicsEngineParameters(c)

    before = state()
    found = measure(World(c, body, floor), speeds=[1.0], timestep=1e-4, gravity=0)
    by_name = measure(c, ("ball", "plate"), speeds=[1.0], timestep=1e-4, gravity=0)
    seen = {
        "before": before,
        "after": state(),
        "e": [i.restitution for i in found.impacts],
        "named": [i.restitution for i in by_name.impacts],
        "causes": [cause.code for cause in found.causes],
        "remedy": found.remedy,
    }
    p.disconnect(c)
    return seen


def test_a_live_client_is_left_as_it_was(files: tuple[Path, Path]) -> None:
    outcome = call(measured_live, str(files[0]), str(files[1]), limit=30)
    assert outcome["after"] == outcome["before"]
    assert outcome["e"] == outcome["named"]
    assert "erp" in outcome["causes"]
    assert "tried" in outcome["remedy"]


def test_a_restitution_in_another_simulators_tag_is_reported(files: tuple[Path, Path]) -> None:
    tag = "<restitution_coefficient>0.6</restitution_coefficient>"
    gazebo = f"<gazebo><surface><bounce>{tag}</bounce></surface></gazebo>"
    files[0].write_text(urdf("ball", SPHERE, 0.7).replace("</robot>", f"{gazebo}</robot>"))
    found = measure(files, speeds=0.5, rest=False)
    assert found.facts.asked == (0.0,)
    assert found.causes[0].code == "foreign-restitution"
    assert "<restitution_coefficient> 0.6" in found.causes[0].evidence
    assert float(found.remedy.split()[5]) == pytest.approx(0.6, abs=1e-3)
    files[0].write_text(urdf("ball", SPHERE, 0.7, restitution(0.6)))
    assert "foreign-restitution" not in [
        cause.code for cause in measure(files, speeds=0.5, rest=False).causes
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("not a robot", "is not XML"),
        ("<sdf/>", "begins with <sdf>"),
        (urdf("ball", SPHERE, -1), "mass: '-1"),
        (urdf("ball", SPHERE, float("nan")), "mass: 'nan'"),
        (urdf("ball", '<mesh filename="gone.obj"/>', 1), "gone.obj"),
        (
            urdf("ball", SPHERE, 1, '<contact><restitution value="abc"/></contact>'),
            "restitution: 'abc'; expected a finite number",
        ),
        (
            urdf("ball", '<sphere radius="five"/>', 1),
            "sphere: radius 'five'; expected a number above 0",
        ),
        (urdf("ball", '<sphere radius="-0.05"/>', 1), "sphere: radius '-0.05'"),
        (urdf("ball", '<cylinder radius="0.1" length="0"/>', 1), "cylinder: length '0'"),
        (
            urdf("ball", '<box size="0.1 0.1"/>', 1),
            "box: size '0.1 0.1'; expected 3 numbers above 0",
        ),
        ('<robot name="r"><link name="a"/><link name="a"/></robot>', "'a' more than once"),
        ('<robot name="r"><link name="a"/><link name=""/></robot>', "number 2 has no name"),
        ('<robot name="r"><link name="a"/><link name="b"/></robot>', "2 root links: 'a', 'b'"),
        (chain("fixed", ("a", "b"), ("b", "a")), "links in a circle: 'a', 'b'"),
        (chain("fixed", ("a", "a")), "links in a circle: 'a'"),
        (
            chain("fixed", ("a", "d"), ("b", "a"), ("c", "b"), ("b", "c")),
            "links in a circle: 'b', 'c'",
        ),
        (chain("fixed", ("a", "b"), ("c", "b")), "'b' is the child of 'a' and of 'c'"),
        (
            chain("fixed", ("a", "b")).replace('child link="b"', 'child link="z"'),
            "child link 'z' is not in",
        ),
        (chain("glued", ("a", "b")), "type 'glued'; expected one of: revolute"),
        (urdf("ball", '<mesh filename="package://arms/hand.stl"/>', 1), "package arms=FOLDER"),
        # Bullet's own reason, which it prints.
        (urdf("ball", "<cone/>", 1), "Unknown geometry type: cone Could not parse"),
        (
            urdf("ball", SPHERE, 1).replace("<collision>", "<!--").replace("</collision>", "-->"),
            "no collision",
        ),
        (urdf("ball", SPHERE, 0), "both bases are fixed"),
    ],
)
def test_a_bad_file_is_one_clear_line(files: tuple[Path, Path], text: str, words: str) -> None:
    files[0].write_text(text)
    with pytest.raises(UserError, match=words) as caught:
        measure(files)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_a_urdf_is_read_in_the_encoding_that_it_states(
    files: tuple[Path, Path], encoding: str
) -> None:
    text = files[0].read_text().replace("ball_link", "kügelchen").partition("?>")[2]
    files[0].write_text(f'<?xml version="1.0" encoding="{encoding}"?>{text}', encoding=encoding)
    (impact,) = measure(
        files, "kügelchen,plate_link", speeds=[1.0], phases=[0.3], diagnose=False
    ).impacts
    assert impact.status == Status.PARTED


def test_bytes_that_are_no_text_are_a_mistake_of_the_user(files: tuple[Path, Path]) -> None:
    files[0].write_bytes(bytes(range(128, 256)))
    for engine in ("pybullet", "mujoco"):
        with pytest.raises(UserError, match=r"not XML|not text in utf-8"):
            pairs(files[0], engine=engine)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"pair": "bal,plate"}, "Did you mean 'ball'"),
        ({"pair": "ball,ball"}, "same body"),
        ({"key": "home"}, "no keyframe"),
    ],
)
def test_a_request_that_makes_no_sense(
    files: tuple[Path, Path], arguments: dict[str, Any], words: str
) -> None:
    with pytest.raises(UserError, match=words):
        measure(files, **arguments)


@pytest.mark.parametrize(("before", "after"), [(b"\n \t\n", b""), (b"", b"\r\n\0")])
def test_blanks_before_a_urdf_and_a_zero_after_it_are_read_over_as_bullet_does(
    files: tuple[Path, Path], before: bytes, after: bytes
) -> None:
    ball, plate = files
    (same,) = measure(files, speeds=[1.0], phases=1, diagnose=False).curve
    ball.write_bytes(before + ball.read_bytes() + after)
    (found,) = measure((ball, plate), speeds=[1.0], phases=1, diagnose=False).curve
    assert found.restitution == same.restitution


def test_a_missing_file_and_a_lonely_one(files: tuple[Path, Path]) -> None:
    with pytest.raises(SceneError, match="is not there"):
        measure([files[0], "gone.urdf"])
    with pytest.raises(UserError, match="alone, in which no two parts can meet"):
        measure(files[0])


def test_the_same_files_measured_again_give_the_same_bits(files: tuple[Path, Path]) -> None:
    runs = [measure(files, speeds=[0.05, 1.0], diagnose=False).impacts for _ in range(2)]
    assert len({repr([i.restitution for i in run]) for run in runs}) == 1


@pytest.mark.parametrize("place", [".", ".."])
def test_a_mesh_is_found_beside_its_urdf_or_above_as_bullet_finds_it(
    files: tuple[Path, Path], place: str
) -> None:
    meshes = files[0].parent / place / "meshes"
    meshes.mkdir()
    (meshes / "tetra.obj").write_text(
        "v -.1 -.1 0\nv .2 -.1 0\nv -.1 .2 0\nv 0 0 .2\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    )
    files[0].write_text(urdf("ball", '<mesh filename="meshes/tetra.obj"/>', 1.0, restitution(0.8)))
    found = measure(files, speeds=[1.0], diagnose=False)
    assert all(i.status in (Status.PARTED, Status.RESTED) for i in found.impacts)


BOX_ON_PLATE = """
import pybullet as p

def build():
    client = p.connect(p.DIRECT)
    boxes = []
    for mass, half, z in ((0.0, [1, 1, 0.1], -0.1), (1.0, [0.1, 0.1, 0.1], 0.5)):
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
        box = p.createMultiBody(mass, shape, basePosition=[0, 0, z], physicsClientId=client)
        still = dict(linearDamping=0, angularDamping=0, contactProcessingThreshold=0, physicsClientId=client)
        p.changeDynamics(box, -1, restitution=0.95 if mass else 1.0, **still)
    p.setPhysicsEngineParameter(restitutionVelocityThreshold=0, contactSlop=0, contactERP=0,
                                contactBreakingThreshold=0.02, physicsClientId=client, {loose})
    p.setTimeStep(1e-3, physicsClientId=client)
    return client
"""


@pytest.mark.parametrize("loose", ["numSolverIterations=1", "solverResidualThreshold=1e3"])
def test_a_loose_solver_is_named_and_its_fix_cures(tmp_path: Path, loose: str) -> None:
    """Four corners touch at once: one sweep over them gives e = 0.88."""
    file = tmp_path / "box.py"
    file.write_text(BOX_ON_PLATE.replace("{loose}", loose), encoding="utf-8")
    asked: dict[str, Any] = {
        "pair": "body:1,body:0",
        "speeds": 0.1,
        "restitution": 0.95,
        "rest": False,
    }
    found = measure(f"{file}:build", **asked)
    assert [cause.code for cause in found.causes] == ["solver"]
    assert max(abs(i.restitution - 0.95) for i in found.impacts) > 0.05
    (arguments,) = re.findall(r"setPhysicsEngineParameter\((.*)\)", found.causes[0].fix)
    file.write_text(BOX_ON_PLATE.replace("{loose}", arguments), encoding="utf-8")
    cured = measure(f"{file}:build", **asked)
    assert max(abs(i.restitution - 0.95) for i in cured.impacts) < 0.01
