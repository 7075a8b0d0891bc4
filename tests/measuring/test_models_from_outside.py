"""Models that others wrote, from their packages: measured, or refused for the right reason."""

from pathlib import Path

import pytest
from outside_models import found_file, outside

from hcbench.measuring import Wanted, measure
from hcbench.measuring.request import make_request
from hcbench.sim.model_under_test import Output
from hcbench.system.errors import UserError
from hcbench.tuning.model import tune_job

GYM, ROBOTICS = "gymnasium/envs/mujoco/assets/", "gymnasium_robotics/envs/assets/"
SUITE, BULLET = "dm_control/suite/", "pybullet_data/"
METAWORLD, ROBOSUITE = "metaworld/assets/sawyer_xyz/", "robosuite/models/assets/robots/"
MEASURED = ""
# (package and file, or two files; pair; words of the refusal, or MEASURED)
MODELS: list[tuple[str, str | None, str]] = [
    (f"{GYM}ant.xml", "left_ankle_geom,floor", "outside their limits"),
    (f"{GYM}half_cheetah.xml", "ffoot,floor", MEASURED),
    (f"{GYM}hopper.xml", "foot,floor", MEASURED),
    (f"{GYM}humanoid.xml", "geom:right_foot,floor", MEASURED),
    (f"{GYM}humanoidstandup.xml", "geom:right_foot,floor", "cannot reach 'floor': 'head'"),
    (f"{GYM}inverted_double_pendulum.xml", "cpole2,floor", "never touch: contype"),
    (f"{GYM}inverted_pendulum.xml", "cpole,rail", "never touch: contype"),
    (f"{GYM}point.xml", "pointarrow,floor", "slide past each other: no joint moves one"),
    (f"{GYM}pusher_v5.xml", "object,r_wrist_roll_link", MEASURED),
    (f"{GYM}reacher.xml", "fingertip,target", "never touch: contype"),
    (f"{GYM}swimmer.xml", "torso,floor", "never touch: contype"),
    (f"{GYM}walker2d_v5.xml", "foot,floor", MEASURED),
    (f"{ROBOTICS}fetch/push.xml", "object0,table0", MEASURED),
    (f"{ROBOTICS}fetch/slide.xml", "object0,table0", MEASURED),
    (f"{ROBOTICS}fetch/pick_and_place.xml", "object0,table0", MEASURED),
    (f"{ROBOTICS}hand/manipulate_block.xml", "object,robot0:palm", MEASURED),
    (f"{ROBOTICS}hand/manipulate_egg.xml", "object,robot0:palm", MEASURED),
    (f"{SUITE}acrobot.xml", "lower_arm,floor", "contacts are disabled"),
    (f"{SUITE}ball_in_cup.xml", "ball,cup", MEASURED),
    (f"{SUITE}cartpole.xml", "pole_1,floor", "contacts are disabled"),
    (f"{SUITE}cheetah.xml", "ffoot,ground", MEASURED),
    (f"{SUITE}finger.xml", "fingertip,spinner", "never touched.*springs and damping of joints"),
    (f"{SUITE}hopper.xml", "foot,floor", MEASURED),
    (f"{SUITE}humanoid.xml", "right_foot,floor", MEASURED),
    (
        f"{SUITE}manipulator.xml",
        "ball,floor",
        "'ball', which moves with it, would be .* inside 'wall2'",
    ),
    (f"{SUITE}manipulator.xml", "thumbtip,floor", MEASURED),
    (f"{SUITE}pendulum.xml", "pole,floor", "contacts are disabled"),
    (f"{SUITE}quadruped.xml", "toe_front_left,floor", MEASURED),
    (
        f"{SUITE}stacker.xml",
        "box0,floor",
        "'box0', which moves with it, would be .* inside 'wall2'",
    ),
    (f"{SUITE}walker.xml", "right_foot,floor", MEASURED),
    (f"{METAWORLD}sawyer_soccer.xml", "soccer_ball1,tablelink", MEASURED),
    (f"{METAWORLD}sawyer_basketball.xml", "basketball,tablelink", MEASURED),
    (f"{METAWORLD}sawyer_drawer.xml", "drawer_link,RetainingWall", MEASURED),
    (f"{METAWORLD}sawyer_reach_push_pick_and_place.xml", "geom:37,tablelink", MEASURED),
    (f"{METAWORLD}sawyer_hammer.xml", "hammer,tablelink", MEASURED),
    (
        f"{ROBOSUITE}spot/robot.xml",
        "fr_uleg,fl_uleg",
        "outside their limits.*fr_kn_leg_joint by 14.6 deg",
    ),
    (f"{ROBOSUITE}panda/robot.xml", "link5,link7", MEASURED),
    (f"{BULLET}soccerball.urdf {BULLET}table/table.urdf", None, MEASURED),
    (f"{BULLET}jenga/jenga.urdf {BULLET}jenga/jenga.urdf", None, MEASURED),
    (f"{BULLET}cube_small.urdf {BULLET}cube_small.urdf", None, MEASURED),
    (f"{BULLET}sphere_small.urdf {BULLET}kuka_iiwa/model.urdf", None, MEASURED),
    (f"{BULLET}r2d2.urdf {BULLET}plane.urdf", None, MEASURED),
    (f"{BULLET}quadruped/minitaur.urdf {BULLET}plane.urdf", None, MEASURED),
    (f"{BULLET}racecar/racecar.urdf {BULLET}plane.urdf", None, MEASURED),
    (f"{BULLET}duck_vhacd.urdf {BULLET}table/table.urdf", None, MEASURED),
    (f"{BULLET}teddy_vhacd.urdf {BULLET}plane.urdf", None, MEASURED),
    (f"{BULLET}humanoid/humanoid.urdf {BULLET}plane.urdf", None, MEASURED),
]


@outside
@pytest.mark.parametrize(("files", "pair", "refusal"), MODELS, ids=lambda value: str(value)[:60])
def test_a_model_from_outside_is_measured_or_refused_for_its_reason(
    files: str, pair: str | None, refusal: str
) -> None:
    paths = [found_file(name) for name in files.split()]
    source = paths if len(paths) > 1 else paths[0]
    if refusal:
        with pytest.raises(UserError, match=refusal):
            measure(source, pair, speeds=[0.5, 1.0], diagnose=False)
        return
    measurement = measure(source, pair, speeds=[0.5, 1.0], diagnose=False)
    assert all(impact.is_measured or impact.reason for impact in measurement.impacts)


TUNED: list[tuple[str, str]] = [
    (f"{GYM}hopper.xml", "foot,floor"),
    (f"{GYM}walker2d_v5.xml", "foot,floor"),
    (f"{GYM}half_cheetah.xml", "bfoot,floor"),
    (f"{GYM}humanoid.xml", "geom:right_foot,floor"),
    (f"{ROBOTICS}fetch/push.xml", "object0,table0"),
    (f"{SUITE}ball_in_cup.xml", "ball,cup"),
    (f"{SUITE}hopper.xml", "foot,floor"),
    (f"{SUITE}walker.xml", "right_foot,floor"),
    (f"{SUITE}quadruped.xml", "toe_front_left,floor"),
    (f"{SUITE}humanoid.xml", "right_foot,floor"),
    (f"{METAWORLD}sawyer_soccer.xml", "soccer_ball1,tablelink"),
    (f"{METAWORLD}sawyer_basketball.xml", "basketball,tablelink"),
]


@outside
@pytest.mark.parametrize(("file", "pair"), TUNED)
def test_the_tuned_model_bounces_as_tune_says(file: str, pair: str, tmp_path: Path) -> None:
    """The speeds and phases are none of those that tune saw; the model has a folder of its own."""
    wanted = Wanted(restitution=0.5)
    found = tune_job(
        str(found_file(file)),
        [make_request(pair, speeds=[0.3, 1.5])],
        wanted,
        output=Output(tmp_path),
    )
    if not found.written:
        # The model as it is is nearest, or the robot lands worse with every setting.
        assert not found.gains
        assert found.no_gain
        return
    (tmp_path / "tuned.xml").write_text(found.written)
    again = measure(tmp_path / "tuned.xml", pair, speeds=[0.35, 0.8, 1.3], phases=5, diagnose=False)
    print(f"{file} {found.name}: e = 0.5 within {found.max_error:.3f}")
    worst = max(abs(error) for _, error in again.errors(wanted))
    assert not again.failed
    assert worst <= found.max_error + 0.02
