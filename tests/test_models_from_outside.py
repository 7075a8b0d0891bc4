"""Models that others wrote, from their packages: measured, or refused for the right reason."""

import importlib.util
import os
from pathlib import Path

import pytest

from hcbench.errors import UserError
from hcbench.measure import measure

GYM, ROBOTICS = "gymnasium/envs/mujoco/assets/", "gymnasium_robotics/envs/assets/"
SUITE, BULLET = "dm_control/suite/", "pybullet_data/"
MEASURED = ""
# (package and file, or two files; pair; words of the refusal, or MEASURED)
MODELS: list[tuple[str, str | None, str]] = [
    (f"{GYM}ant.xml", "left_ankle_geom,floor", "outside their limits"),
    (f"{GYM}half_cheetah.xml", "ffoot,floor", MEASURED),
    (f"{GYM}hopper.xml", "foot,floor", MEASURED),
    (f"{GYM}humanoid.xml", "geom:right_foot,floor", MEASURED),
    (f"{GYM}humanoidstandup.xml", "geom:right_foot,floor", "cannot reach 'floor': 'head'"),
    (f"{GYM}inverted_double_pendulum.xml", "cpole2,floor", "never touch: contype"),
    (f"{GYM}inverted_pendulum.xml", "cpole,rail", "never touch"),
    (f"{GYM}point.xml", "pointarrow,floor", "never touch|passes|slide past|cannot"),
    (f"{GYM}pusher_v5.xml", "object,r_wrist_roll_link", "passes 'r_wrist_roll_link'.*heights"),
    (f"{GYM}reacher.xml", "fingertip,target", "never touch: contype"),
    (f"{GYM}swimmer.xml", "torso,floor", "slide past|do not bring|cannot|never touch"),
    (f"{GYM}walker2d_v5.xml", "foot,floor", MEASURED),
    (f"{ROBOTICS}fetch/push.xml", "object0,table0", MEASURED),
    (f"{ROBOTICS}fetch/slide.xml", "object0,table0", MEASURED),
    (f"{ROBOTICS}fetch/pick_and_place.xml", "object0,table0", MEASURED),
    (f"{ROBOTICS}hand/manipulate_block.xml", "object,robot0:palm", MEASURED),
    (f"{ROBOTICS}hand/manipulate_egg.xml", "object,robot0:palm", MEASURED),
    (f"{SUITE}acrobot.xml", "lower_arm,floor", "never touch"),
    (f"{SUITE}ball_in_cup.xml", "ball,cup", MEASURED),
    (f"{SUITE}cartpole.xml", "pole_1,floor", "never touch"),
    (f"{SUITE}cheetah.xml", "ffoot,ground", MEASURED),
    (f"{SUITE}finger.xml", "fingertip,spinner", MEASURED),
    (f"{SUITE}hopper.xml", "foot,floor", MEASURED),
    (f"{SUITE}humanoid.xml", "right_foot,floor", MEASURED),
    (f"{SUITE}manipulator.xml", "ball,floor", "'ball', which moves with it, would be .* inside 'wall2'"),
    (f"{SUITE}manipulator.xml", "thumbtip,floor", MEASURED),
    (f"{SUITE}pendulum.xml", "pole,floor", "never touch"),
    (f"{SUITE}quadruped.xml", "toe_front_left,floor", MEASURED),
    (f"{SUITE}stacker.xml", "box0,floor", "'box0', which moves with it, would be .* inside 'wall2'"),
    (f"{SUITE}walker.xml", "right_foot,floor", MEASURED),
    (f"{BULLET}soccerball.urdf {BULLET}table/table.urdf", None, MEASURED),
    (f"{BULLET}jenga/jenga.urdf {BULLET}jenga/jenga.urdf", None, MEASURED),
    (f"{BULLET}cube_small.urdf {BULLET}cube_small.urdf", None, MEASURED),
    (f"{BULLET}sphere_small.urdf {BULLET}kuka_iiwa/model.urdf", None, MEASURED),
    (f"{BULLET}r2d2.urdf {BULLET}plane.urdf", None, MEASURED),
    (f"{BULLET}quadruped/minitaur.urdf {BULLET}plane.urdf", None, MEASURED),
    (f"{BULLET}racecar/racecar.urdf {BULLET}plane.urdf", None, MEASURED),
    (f"{BULLET}duck_vhacd.urdf {BULLET}table/table.urdf", None, MEASURED),
    (f"{BULLET}teddy_vhacd.urdf {BULLET}plane.urdf", None, MEASURED),
    (f"{BULLET}humanoid/humanoid.urdf {BULLET}plane.urdf", None, "not well-formed"),
]


def found(name: str) -> Path:
    """A file of an installed package."""
    package, _, rest = name.partition("/")
    spec = importlib.util.find_spec(package)
    assert spec is not None, f"{package} is not installed: make test-models"
    assert spec.origin is not None
    return Path(spec.origin).parent / rest


@pytest.mark.skipif("HCBENCH_MODELS" not in os.environ, reason="needs other packages: make test-models")
@pytest.mark.parametrize(("files", "pair", "refusal"), MODELS, ids=lambda value: str(value)[:60])
def test_a_model_from_outside_is_measured_or_refused_for_its_reason(
    files: str, pair: str | None, refusal: str
) -> None:
    paths = [found(name) for name in files.split()]
    source = paths if len(paths) > 1 else paths[0]
    if refusal:
        with pytest.raises(UserError, match=refusal):
            measure(source, pair, speeds=[0.5, 1.0], diagnose=False)
        return
    measurement = measure(source, pair, speeds=[0.5, 1.0], diagnose=False)
    assert all(impact.is_measured or impact.reason for impact in measurement.impacts)
