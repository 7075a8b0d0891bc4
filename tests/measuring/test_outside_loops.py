"""Models that others wrote, made to bounce: `measure` against a loop over
`mj_step` that knows nothing of it.

The loop sees the distance of the two (`mj_geomDistance`) at each state, and by `mj_jac`
how fast their nearest points approach at the launch. The contact of the pair gets a
spring of 20 steps, so that all bounce.
"""

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from bounce_loop import bounce_of
from outside_models import found_file, outside

from hcbench.measuring import measure
from hcbench.measuring.request import make_request
from hcbench.sim import registry

ALOHA, XARM, HIL = "gym_aloha/assets/", "gym_xarm/tasks/assets/", "gym_hil/assets/"
SAFETY, BRAX, BRAX_DATA = "safety_gymnasium/assets/xmls/", "brax/envs/assets/", "brax/test_data/"
GYM, ROBOTICS = "gymnasium/envs/mujoco/assets/", "gymnasium_robotics/envs/assets/"
SUITE, METAWORLD = "dm_control/suite/", "metaworld/assets/sawyer_xyz/"
FINGERS = "vx300s_{0}/10_left_gripper_finger,vx300s_{0}/10_right_gripper_finger"
MODELS = [
    (f"{ALOHA}bimanual_viperx_end_effector_insertion.xml", FINGERS.format("left")),
    (f"{ALOHA}bimanual_viperx_end_effector_transfer_cube.xml", FINGERS.format("right")),
    (f"{XARM}lift.xml", "object0,floorgeom0"),
    (f"{XARM}peg_in_box.xml", "box_side0,floorgeom0"),
    (f"{HIL}arrange_boxes_scene.xml", "geom:block1,floor"),
    (f"{HIL}scene.xml", "geom:block,floor"),
    (f"{SAFETY}car.xml", "geom:left,floor"),
    (f"{SAFETY}doggo.xml", "ankle_1,floor"),
    (f"{BRAX}half_cheetah.xml", "geom:bfoot,floor"),
    (f"{BRAX}hopper.xml", "foot_geom,floor"),
    (f"{BRAX}humanoidstandup.xml", "right_larm,floor"),
    (f"{BRAX}walker2d.xml", "foot_geom,floor"),
    (f"{BRAX_DATA}capsule.xml", "cap1,floor"),
    (f"{BRAX_DATA}convex_convex.xml", "geom:tetrahedron,floor"),
    (f"{BRAX_DATA}convex_convex.xml", "geom:dodecahedron,box1"),
    (f"{BRAX_DATA}fluid_ellipsoid.xml", "box1,floor"),
    (f"{BRAX_DATA}nonzero_joint_ref.xml", "foot_geom,floor"),
    (f"{BRAX_DATA}world_fromto.xml", "cap1,pelvis_geom"),
    (f"{BRAX_DATA}world_self_collision.xml", "geom:ball,sideS"),
    (f"{SUITE}walker.xml", "geom:right_foot,floor"),
    (f"{GYM}half_cheetah.xml", "geom:bfoot,floor"),
    (f"{GYM}hopper.xml", "foot_geom,floor"),
    (f"{GYM}humanoid.xml", "geom:right_foot,floor"),
    (f"{GYM}humanoid.xml", "geom:right_foot,geom:left_foot"),
    (f"{GYM}walker2d_v5.xml", "foot_left_geom,floor"),
    (f"{ROBOTICS}adroit_hand/adroit_relocate.xml", "sphere,ground"),
    (f"{ROBOTICS}fetch/pick_and_place.xml", "geom:object0,geom:floor0"),
    (f"{ROBOTICS}fetch/slide.xml", "geom:object0,geom:floor0"),
    (f"{METAWORLD}sawyer_bin_picking.xml", "geom:37,geom:43"),
    (f"{METAWORLD}sawyer_peg_insertion_side.xml", "geom:peg,geom:3"),
    (f"{METAWORLD}sawyer_push_back_v3.xml", "objGeom,geom:3"),
    (f"{METAWORLD}sawyer_reach_push_pick_and_place.xml", "geom:37,geom:3"),
]
# A cylinder that joints turn onto a mesh: on this way the speeds are those of the launch up to here.
BAXTER = "robosuite/models/assets/robots/baxter/robot.xml"
SLOW = 0.25
STEPS, RATIO = 20, 0.15  # of the contact, and of its damping


def made_to_bounce(file: str, pair: str) -> Any:
    """The compiled model with the same spring on all geoms of the pair."""
    model = mujoco.MjModel.from_xml_path(str(found_file(file)))
    rate = math.pi / (STEPS * model.opt.timestep)
    spring, impedance = (-(rate**2), -2 * RATIO * rate), (0.95, 0.95, 0.001, 0.5, 2)
    opened: Any = registry.engine("mujoco")
    place = opened.open(model, make_request(pair)).place
    geoms = [*place.pair.first.geoms, *place.pair.second.geoms]
    model.geom_solref[geoms], model.geom_solimp[geoms] = spring, impedance
    model.geom_priority[geoms] = model.geom_priority.max() + 1
    explicit = np.isin(model.pair_geom1, geoms) & np.isin(model.pair_geom2, geoms)
    model.pair_solref[explicit], model.pair_solimp[explicit] = spring, impedance
    return model


@outside
@pytest.mark.parametrize("speed", [0.5, 1.0])
@pytest.mark.parametrize(("file", "pair"), MODELS, ids=lambda value: value[:60])
def test_e_is_that_of_a_loop_of_our_own(file: str, pair: str, speed: float) -> None:
    model = made_to_bounce(file, pair)
    launch: Any = {"speeds": [speed], "phases": [0.3]}
    (impact,) = measure(model, pair, diagnose=False, **launch).impacts
    engine: Any = registry.engine("mujoco")
    opened = engine.open(model, make_request(pair, **launch))
    place, data = opened.place, mujoco.MjData(model)
    for name in ("qpos", "ctrl", "act", "mocap_pos", "mocap_quat", "eq_active"):
        getattr(data, name)[:] = getattr(opened.start, name)
    data.qpos[:] = place.qpos
    clearance = impact.launch.clearance_in_phase(opened.timestep, opened.gravity)
    mujoco.mj_integratePos(model, data.qpos, place.direction, -clearance)
    data.qvel[:] = speed * place.direction
    pairs = [(a, b) for a in place.pair.first.geoms for b in place.pair.second.geoms]
    assert approach(model, data, pairs) == pytest.approx(speed, rel=0.02)
    into, out = bounce_of(model, data, pairs, place.contact.onset)
    assert impact.restitution == pytest.approx(out / into, abs=0.005)


def approach(model: Any, data: Any, pairs: list[tuple[int, int]]) -> float:
    """Speed at which the nearest points of the two approach, by `mj_jac`, m/s."""
    mujoco.mj_fwdPosition(model, data)
    spans = []
    for a, b in pairs:
        ends = np.zeros(6)
        spans.append((mujoco.mj_geomDistance(model, data, a, b, 10.0, ends), ends, a, b))
    _, ends, a, b = min(spans, key=lambda span: span[0])
    normal = (ends[3:] - ends[:3]) / np.linalg.norm(ends[3:] - ends[:3])
    velocity, jacobian = np.zeros(3), np.zeros((3, model.nv))
    for geom, point, sign in ((a, ends[:3], 1.0), (b, ends[3:], -1.0)):
        mujoco.mj_jac(model, data, jacobian, None, point, int(model.geom_bodyid[geom]))
        velocity += sign * (jacobian @ data.qvel)
    return float(normal @ velocity)


@outside
def test_nearest_points_that_coincide_to_rounding_turn_no_arm_aside() -> None:
    """The arm meets the mesh along MuJoCo's contact, and e is that of the loop."""
    test_e_is_that_of_a_loop_of_our_own(BAXTER, "left_e0_collision,base_link_col", SLOW)
