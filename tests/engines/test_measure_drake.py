"""Users' URDF, SDF and MJCF in Drake: measured as a Simulator of one's own steps them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hcbench.checking.judge import run_check
from hcbench.checking.outcome import Verdict
from hcbench.checking.spec import CheckSpec, plan
from hcbench.laws.restitution import Restitution
from hcbench.measuring.measure import Job, list_pairs, measure
from hcbench.measuring.request import make_request
from hcbench.system.errors import SceneError, UserError

drake: Any = pytest.importorskip("pydrake.all")

STIFFNESS, DISSIPATION = 4e4, 0.6  # of each body: the pair has half of the one, and the other
PROPERTIES = {
    "urdf": f"""<drake:proximity_properties><drake:point_contact_stiffness value="{STIFFNESS}"/>
      <drake:hunt_crossley_dissipation value="{DISSIPATION}"/></drake:proximity_properties>""",
    "sdf": f"""<drake:proximity_properties>
      <drake:point_contact_stiffness>{STIFFNESS}</drake:point_contact_stiffness>
      <drake:hunt_crossley_dissipation>{DISSIPATION}</drake:hunt_crossley_dissipation>
      </drake:proximity_properties>""",
}
BALL = """<robot xmlns:drake="http://drake.mit.edu" name="toy"><link name="ball">
  <inertial><mass value=".5"/><inertia ixx="2e-4" iyy="2e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision name="shell"><geometry>{shape}</geometry>{properties}</collision></link></robot>"""
SPHERE = '<sphere radius=".05"/>'
SLAB = """<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="slab"><static>true</static>
  <link name="top"><pose>0 0 -.3 0 0 0</pose>
  <collision name="slab"><geometry>{shape}</geometry>{properties}</collision></link></model></sdf>"""
BOX = "<box><size>1 1 .4</size></box>"
PLANE = "<plane><normal>0 0 1</normal></plane>"
ARM = """<mujoco model="arm"><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
  <body name="arm" pos="0 0 .2"><joint name="shoulder" axis="0 1 0"/>
    <geom name="rod" type="capsule" fromto="0 0 0 .25 0 0" size=".01" mass=".2"/>
    <body name="hammer" pos=".3 0 0"><geom name="head" size=".05" mass=".5"/></body></body>
  </worldbody></mujoco>"""


def write(folder: Path, shape: str = SPHERE, ground: str = BOX, stock: bool = False) -> list[str]:
    """A ball, and what it falls on, in two files. stock: nothing said of their contact."""
    files = {"ball.urdf": BALL, "slab.sdf": SLAB}
    for (name, text), what in zip(files.items(), (shape, ground), strict=True):
        properties = "" if stock else PROPERTIES[name.partition(".")[2]]
        (folder / name).write_text(text.format(shape=what, properties=properties))
    return [str(folder / name) for name in files]


def measured(files: Any, pair: str = "ball,slab", **asked: Any) -> Any:
    return measure(
        files,
        pair,
        engine="drake",
        **{"speeds": [0.1, 0.6], "phases": [0.3], "gravity": 0, **asked},
    )


def test_e_is_the_laws_less_what_the_implicit_step_takes(tmp_path: Path) -> None:
    step, omega = 1e-4, np.sqrt(STIFFNESS / 2 / 0.5)
    found = measured(write(tmp_path), timestep=step, phases=[0.3, 0.8], diagnose=False)
    for impact in found.impacts:
        asked = float(Restitution(DISSIPATION / 1.5).at(impact.speed_in))
        taken = asked * (1 - np.exp(-np.pi * omega * step / 2))  # of first order in d v
        assert asked - impact.restitution == pytest.approx(taken, rel=0.15)
    assert found.facts.asked == pytest.approx([float(Restitution(0.4).at(v)) for v in (0.1, 0.6)])
    assert found.facts.effective_mass == pytest.approx(0.5)


def by_hand(files: list[str], speed: float, gap: float, step: float, height: float) -> float:
    """e of a plain Simulator, without gravity."""
    builder = drake.DiagramBuilder()
    plant, _ = drake.AddMultibodyPlant(drake.MultibodyPlantConfig(time_step=step), builder)
    for file in files:
        drake.Parser(plant).AddModels(file)
    plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
    plant.Finalize()
    simulator = drake.Simulator(builder.Build())
    context, ball = (
        plant.GetMyMutableContextFromRoot(simulator.get_mutable_context()),
        plant.GetBodyByName("ball"),
    )
    plant.SetFreeBodyPose(context, ball, drake.RigidTransform([0, 0, height + gap]))
    plant.SetFreeBodySpatialVelocity(
        context, ball, drake.SpatialVelocity([0, 0, 0], [0, 0, -speed])
    )
    for i in range(1, 400):
        simulator.AdvanceTo(i * step)
    return float(plant.GetVelocities(context)[5] / speed)


@pytest.mark.parametrize(
    ("shape", "ground", "height"), [(SPHERE, BOX, -0.05), (SPHERE, PLANE, -0.25)]
)
def test_it_is_what_a_simulator_of_ones_own_does(
    tmp_path: Path, shape: str, ground: str, height: float
) -> None:
    files, step = write(tmp_path, shape, ground), 1e-4
    for impact in measured(files, timestep=step, diagnose=False).impacts:
        gap = impact.launch.clearance_in_phase(step, 0.0)
        assert impact.restitution == pytest.approx(
            by_hand(files, impact.launch.speed, gap, step, height), abs=1e-9
        )


def test_the_force_is_that_of_each_step(tmp_path: Path) -> None:
    impact, _ = measured(write(tmp_path), speeds=[0.6, 0.1], timestep=1e-4, diagnose=False).impacts
    gained = np.diff(-impact.loop.rate) * 0.5 / 1e-4
    assert impact.loop.force[:-1] == pytest.approx(gained, abs=1e-6)
    assert impact.speed_out == pytest.approx(0.6 * impact.restitution, abs=1e-9)


@pytest.mark.parametrize(
    "shape", ['<box size=".1 .08 .06"/>', '<cylinder radius=".03" length=".1"/>']
)
def test_other_shapes_meet_a_half_space_where_they_are_lowest(tmp_path: Path, shape: str) -> None:
    found = measured(write(tmp_path, shape, PLANE), speeds=0.3, timestep=1e-4, diagnose=False)
    assert found.facts.point[2] == pytest.approx(-0.3, abs=1e-12)
    assert found.impacts[0].penetration_max == pytest.approx(
        0.3 * np.sqrt(0.5 / (STIFFNESS / 2)), rel=0.15
    )


def test_a_robots_arm_is_brought_to_touch_and_moves_as_a_push_would_move_it(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(ARM)
    asked: dict[str, Any] = {
        "qpos": "shoulder=-0.3",
        "diagnose": False,
        "speeds": 0.3,
        "timestep": 1e-4,
    }
    (one, other) = (
        measure(tmp_path / "arm.xml", "hammer,floor", engine=engine, phases=[0.5], **asked).facts
        for engine in ("drake", "mujoco")
    )
    assert one.effective_mass == pytest.approx(other.effective_mass, rel=1e-6)
    assert one.point == pytest.approx(other.point, abs=1e-8)
    assert one.gravity == other.gravity
    assert "on its joints (shoulder)" in one.moved


def test_causes_are_drakes_own(tmp_path: Path) -> None:
    found = measured(write(tmp_path, stock=True), timestep=1e-4, speeds=0.3)
    causes = {cause.code: cause for cause in found.causes}
    assert list(causes) == ["default-dissipation", "implicit-step"]
    assert "50 s/m" in causes["default-dissipation"].evidence
    assert "a factor of 0.855" in causes["implicit-step"].evidence


def test_check_gates_it(tmp_path: Path) -> None:
    files = tuple(write(tmp_path))
    common: dict[str, Any] = {
        "pair": "ball,slab",
        "speeds": 0.3,
        "phases": 1,
        "timestep": "0.5 ms",
        "gravity": 0,
    }
    for wanted, verdict in ((0.76, Verdict.PASSED), (0.95, Verdict.FAILED)):
        spec = CheckSpec(model=files, engine="drake", restitution=wanted, max_error=0.03, **common)
        assert run_check(plan(spec)).verdict is verdict


def test_pairs_are_listed(tmp_path: Path) -> None:
    job = Job(tuple(write(tmp_path)), "drake", make_request(None), None, 0.01, False)
    (pair,) = list_pairs(job)
    assert (pair.pair, pair.types) == ("geom:shell,geom:slab", ("Sphere", "Box"))
    assert pair.effective_mass == pytest.approx(0.5)
    assert pair.distance == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"pair": "ball,nope"}, "no body or geom 'nope'"),
        ({"key": "home"}, "Drake reads no keyframes"),
        ({"qpos": "elbow=1"}, "no joint 'elbow'"),
        ({"angle": "30 deg"}, "angle: given"),
        ({"coming_from": "above"}, "from: given"),
    ],
)
def test_a_request_that_drake_cannot_serve(
    tmp_path: Path, asked: dict[str, Any], words: str
) -> None:
    with pytest.raises(UserError, match=words):
        measured(write(tmp_path), **asked)


def test_what_drake_does_not_load_is_said_in_one_line(tmp_path: Path) -> None:
    files = write(tmp_path, shape="<plane/>")
    with pytest.raises(
        SceneError, match=r"model: ball\.urdf: .*; expected a model that Drake loads"
    ):
        measured(files)
    with pytest.raises(SceneError, match="is not there"):
        measured(str(tmp_path / "no.sdf"))
