"""The law in MuJoCo Warp: pairs bounce by the law of each impact's speed, in many worlds at once."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from law_worlds import FEET, GRAVITY, PHASES, PRESSED, QUADRUPED, SHAPES, SPEEDS, WORLD, world

from hcbench.contact.warp import ConstantRestitution, Restitution, restitution
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.system.errors import SettingError, UserError
from hcbench.terms.impact import Floats

pytestmark = pytest.mark.needs_engine("mujoco-warp")

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "plugin-warp.md"
FLOOR = (
    '<mujoco><option timestep=".002"/><worldbody><geom name="floor" type="plane" size="5 5 .1"/>'
)


class Worlds:
    """Worlds of a model on the device that Warp prefers: a GPU where there is one."""

    def __init__(self, model: mujoco.MjModel, qpos: Floats, qvel: Floats | None = None) -> None:
        """Put each row of qpos, and of qvel, into a world of its own."""
        import mujoco_warp as mjw
        import warp as wp

        wp.config.quiet = True
        self.m = mjw.put_model(model)
        self.d = mjw.make_data(model, nworld=len(qpos), nconmax=16, njmax=64)
        self.d.qpos.assign(np.asarray(qpos, np.float32))
        if qvel is not None:
            self.d.qvel.assign(np.asarray(qvel, np.float32))

    @property
    def qpos(self) -> Floats:
        return np.array(self.d.qpos.numpy(), float)

    @property
    def qvel(self) -> Floats:
        return np.array(self.d.qvel.numpy(), float)

    def stepped(self, step: Callable[..., None], steps: int, *values: Any) -> tuple[Floats, Floats]:
        """(positions, velocities) after each of some steps."""
        path = []
        for _ in range(steps):
            step(self.m, self.d, *values)
            path.append((self.qpos, self.qvel))
        qpos, qvel = zip(*path, strict=True)
        return np.array(qpos), np.array(qvel)


def engine_step(m: Any, d: Any) -> None:
    import mujoco_warp as mjw

    mjw.step(m, d)


def on_device(values: Floats) -> Any:
    import warp as wp

    return wp.array(values, dtype=float)


def dropped(
    model: mujoco.MjModel, step: Callable[..., None], rest: float, *values: Any
) -> tuple[Floats, Floats]:
    """Speeds at the touch plane before and after, m/s, of launches straight down."""
    h = model.opt.timestep
    qpos = np.tile(model.qpos0, (SPEEDS.size, 1))
    qpos[:, 2] = rest + PHASES * h * SPEEDS
    qvel = np.zeros((SPEEDS.size, model.nv))
    qvel[:, 2] = -SPEEDS
    worlds = Worlds(model, qpos, qvel)
    # Steps that move by the new velocity keep (v + g h/2)² - 2 g x.
    lift = 2 * GRAVITY * (worlds.qpos[:, 2] - rest)
    before = np.sqrt((SPEEDS + GRAVITY * h / 2) ** 2 + lift)
    worlds.stepped(step, 6, *values)
    lift = 2 * GRAVITY * (worlds.qpos[:, 2] - rest)
    after = np.sqrt((-worlds.qvel[:, 2] + GRAVITY * h / 2) ** 2 + lift)
    return before, after


@pytest.mark.parametrize(
    ("shape", "timestep"),
    [("sphere", 1e-3), ("box", 1e-3), ("capsule", 1e-3), ("sphere", 2e-3), ("sphere", 5e-3)],
)
def test_each_impact_has_the_e_of_its_own_speed(shape: str, timestep: float) -> None:
    model = world(shape, timestep)
    step = restitution(model, {("ball", "floor"): 0.21})
    before, after = dropped(model, step, SHAPES[shape][1])
    assert after / before == pytest.approx(Restitution(0.21).at(before), abs=1e-5)


def test_worlds_have_an_alpha_of_their_own() -> None:
    alphas = np.linspace(0.0, 0.4, SPEEDS.size)
    model = world("box", option='integrator="implicitfast" cone="elliptic" jacobian="sparse"')
    step = restitution(model, {("ball", "world"): 0.1})
    before, after = dropped(model, step, SHAPES["box"][1], on_device(alphas[:, None]))
    asked = [Restitution(alpha).at(v) for alpha, v in zip(alphas, before, strict=True)]
    assert after / before == pytest.approx(np.array(asked), abs=1e-5)


@pytest.mark.parametrize("law", [ConstantRestitution(0.62), Restitution(0.3, "linear")])
def test_a_pair_may_have_another_law(law: Any) -> None:
    model = world()
    before, after = dropped(
        model, restitution(model, {("ball", "floor"): law}), SHAPES["sphere"][1]
    )
    assert after / before == pytest.approx(law.at(before), abs=1e-5)


def test_tumbling_boxes_gain_no_energy_and_rest_where_e_is_below_1() -> None:
    model = world("box", timestep=5e-4)
    generator = np.random.default_rng(41)
    qpos = np.tile(model.qpos0, (8, 1))
    qpos[:, 2] = 0.12
    turns = generator.normal(size=(8, 4))
    qpos[:, 3:7] = turns / np.linalg.norm(turns, axis=1)[:, None]
    qvel = generator.normal(size=(8, 6)) * [1, 1, 1, 5, 5, 5]
    inertia = np.array([model.body_mass[1]] * 3 + list(model.body_inertia[1]))
    values = on_device(np.tile(np.array([0.0, 0.3, 0.6, 1.0])[:, None], (2, 1)))
    step = restitution(model, {("ball", "floor"): ConstantRestitution(0.5)})
    heights, rates = Worlds(model, qpos, qvel).stepped(step, 2000, values)
    last = np.abs(rates[-1, :2])
    rates[:, :, 2] -= GRAVITY * model.opt.timestep / 2
    path = rates**2 @ inertia / 2 + model.body_mass[1] * GRAVITY * heights[:, :, 2]
    # Half of it is Euler's own in the spinning flight.
    assert np.max(path - np.minimum.accumulate(path)) < 2e-3 * path[0].max()
    assert last.max() < 1e-3


@pytest.mark.parametrize("name", PRESSED)
def test_what_others_press_rests_no_deeper_than_on_the_engine_s_own_contact(name: str) -> None:
    body, names = PRESSED[name]
    alpha = 3.0 if name == "undamped" else 0.3
    pairs = dict.fromkeys(names, alpha)
    model = mujoco.MjModel.from_xml_string(f"{FLOOR}{body}</worldbody></mujoco>")
    start = model.qpos0[None]
    poses, rates = Worlds(model, start).stepped(restitution(model, pairs), 700)
    plain, _ = Worlds(model, start).stepped(engine_step, 700)
    own = min(depth(model, pose) for pose in plain[-300:, 0])
    assert depth(model, poses[-1, 0]) > own - 1e-4
    assert np.abs(rates[-1]).max() < 1e-3


def test_quadrupeds_rest_on_their_feet_no_deeper_than_on_the_engine_s_own_contact() -> None:
    model = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    qpos = np.tile(model.qpos0, (3, 1))
    qpos[:, 2] += 0.1
    step = restitution(model, {(foot, "floor"): ConstantRestitution(0.3) for foot in FEET})
    values = on_device(np.tile(np.array([0.0, 0.3, 0.6])[:, None], (1, len(FEET))))
    poses, rates = Worlds(model, qpos).stepped(step, 500, values)
    plain, _ = Worlds(model, qpos[:1]).stepped(engine_step, 500)
    deepest = min(depth(model, pose) for pose in poses.reshape(-1, model.nq))
    assert deepest > min(depth(model, pose) for pose in plain[:, 0]) - 1e-3
    assert np.abs(rates[-1]).max() < 0.05


def depth(model: mujoco.MjModel, qpos: Any) -> float:
    """Distance of the deepest contact in a pose, m, below 0."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return min([0.0, *(float(contact.dist) for contact in data.contact)])


def test_without_a_contact_of_the_pair_the_step_is_the_engine_s() -> None:
    import warp as wp

    model = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    qpos = np.tile(model.qpos0, (2, 1))
    # The feet of a side, which do not meet.
    step = restitution(model, {(FEET[0], FEET[1]): 0.3})
    poses, rates = Worlds(model, qpos).stepped(step, 40)
    plain, speeds = Worlds(model, qpos).stepped(engine_step, 40)
    # A GPU adds up in the order of its threads, which is another each time.
    within = 1e-3 if wp.get_device().is_cuda else 0.0
    assert poses == pytest.approx(plain, rel=0.0, abs=within)
    assert rates == pytest.approx(speeds, rel=0.0, abs=within)


def test_contacts_are_afterwards_as_the_engine_found_them() -> None:
    model = world(option='integrator="implicitfast"')
    qpos = np.tile(model.qpos0, (2, 1))
    qpos[:, 2] = [0.0499, 0.0498]
    worlds = Worlds(model, qpos, np.array([[0, 0, -1.0, 0, 0, 0], [0] * 6]))
    restitution(model, {("ball", "floor"): 0.3})(worlds.m, worlds.d)
    assert worlds.d.contact.dist.numpy()[:2] == pytest.approx(qpos[:, 2] - 0.05, abs=1e-7)
    assert worlds.d.contact.solref.numpy()[:2] == pytest.approx(np.array([[0.02, 1.0]] * 2))


def test_a_graph_of_a_step_moves_worlds_as_the_step_does() -> None:
    import warp as wp

    if not wp.is_cuda_available():
        pytest.skip("graphs are of a GPU")
    model = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    qpos = np.tile(model.qpos0, (64, 1))
    qpos[:, 2] += np.linspace(0.02, 0.1, 64)
    step = restitution(model, {(foot, "floor"): ConstantRestitution(0.3) for foot in FEET})
    eager, captured = Worlds(model, qpos), Worlds(model, qpos)
    heights, _ = eager.stepped(step, 200)
    step(captured.m, captured.d)
    with wp.ScopedCapture() as capture:
        step(captured.m, captured.d)
    for _ in range(199):
        wp.capture_launch(capture.graph)
    # The engine adds up in the order of threads: both go their own ways by float32's noise.
    assert captured.qpos[:, 2] == pytest.approx(heights[-1, :, 2], abs=2e-3)


def test_the_page_s_scripts_run_in_a_user_s_folder(tmp_path: Path) -> None:
    blocks = re.findall(r"```py\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    box = '<body pos="1 0 .2"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body>'
    model = WORLD.format(timestep=2e-3, option="", shape=SHAPES["sphere"][0])
    script = "\n".join(blocks).replace("worlds = 1024", "worlds = 3")
    script += "\nassert d.qpos.shape == (3, model.nq) and d.time.numpy()[2] > 0.003"
    run_script(script, model.replace("</worldbody>", f"{box}</worldbody>"), tmp_path)


@pytest.mark.parametrize(
    ("recipe", "contact"),
    [("restitution-law", ""), ("hunt-crossley", 'contype="0" conaffinity="0"')],
)
def test_what_tune_prints_is_a_script_that_runs(recipe: str, contact: str, tmp_path: Path) -> None:
    """A ball that falls 1 cm is at 0.8 cm again after 0.1 s."""
    made_for = Target(HuntCrossley(1e6, 0.3), 0.5, 1e-4, 0.03, 0.5)
    setting = registry.recipe(f"mujoco-warp.{recipe}")(made_for)
    script = registry.engine("mujoco-warp").snippet(setting, "plane", ("ball", "floor"))
    script = script.replace("nworld=1024", "nworld=2")
    script += "\nassert 0.056 < d.qpos.numpy()[1, 2] < 0.0585"
    model = WORLD.format(timestep=1e-4, option="", shape=f"{SHAPES['sphere'][0]} {contact}")
    run_script(script, model.replace('pos="0 0 1"', 'pos="0 0 .06"'), tmp_path)


def run_script(script: str, model: str, folder: Path) -> None:
    """Run it in a folder that has this model as my.xml."""
    (folder / "my.xml").write_text(model)
    (folder / "script.py").write_text(script, encoding="utf-8")
    subprocess.run([sys.executable, "script.py"], cwd=folder, check=True)


@pytest.mark.parametrize(
    ("model", "pairs", "error", "message"),
    [
        (
            world(option='integrator="RK4"'),
            {("ball", "floor"): 0.3},
            SettingError,
            "^integrator: RK4",
        ),
        (world(), {("bal", "floor"): 0.3}, UserError, "^pairs: no geom or body 'bal'; .*'ball'"),
        (None, {("ball", "floor"): 0.3}, UserError, "^model: a NoneType; expected an MjModel"),
    ],
)
def test_what_cannot_bounce_is_an_error_by_name(
    model: Any, pairs: Mapping[Any, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        restitution(model, pairs)


@pytest.mark.parametrize(
    ("option", "value", "error", "message"),
    [
        ("integrator", 1, SettingError, "^integrator: RK4; expected Euler or implicitfast"),
        ("run_collision_detection", False, SettingError, "^run_collision_detection: False"),
        ("enableflags", 1 << 5, SettingError, "^enableflags: sleep"),
    ],
)
def test_options_that_were_not_tried_are_errors_by_name(
    option: str, value: Any, error: type[Exception], message: str
) -> None:
    model = world()
    worlds = Worlds(model, model.qpos0[None])
    setattr(worlds.m.opt, option, value)
    with pytest.raises(error, match=message):
        restitution(model, {("ball", "floor"): 0.3})(worlds.m, worlds.d)


def test_values_of_another_shape_and_another_model_are_errors_by_name() -> None:
    model = world()
    worlds = Worlds(model, np.tile(model.qpos0, (3, 1)))
    step = restitution(model, {("ball", "floor"): 0.3})
    with pytest.raises(UserError, match=r"^values: an array of shape \(2, 1\); expected \(3, 1\)"):
        step(worlds.m, worlds.d, on_device(np.zeros((2, 1))))
    other = restitution(mujoco.MjModel.from_xml_path(str(QUADRUPED)), {(FEET[0], "floor"): 0.3})
    with pytest.raises(UserError, match=r"^m: a model of 2 geoms"):
        other(worlds.m, worlds.d)
