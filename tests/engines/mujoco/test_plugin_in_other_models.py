"""A model with the plug-in by its XML alone: the viewer's loader, threads,
and the libraries above MuJoCo.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pytest
from swapped_names import at_the_floor, parting_speeds, two_balls

from hcbench.contact import mujoco as contact
from hcbench.engines.mujoco.model.pair import restitution_law
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import ConstantRestitution
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.terms.scene import load_scene

SPEED, ALPHA = 0.3, 0.315
E = float(closed_form.restitution(ALPHA, SPEED))


@pytest.fixture(params=["hunt-crossley", "restitution-law"])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A file that `hcbench tune mujoco --write-scene` writes, of a
    ball that just touches its plate.
    """
    contact.load()
    scene, step = load_scene("steel-plane"), 1e-5 if request.param == "hunt-crossley" else 1e-3
    target = Target(HuntCrossley(scene.stiffness, ALPHA), scene.mass, step, 0.0254, 0.508)
    setting = registry.recipe(f"mujoco.{request.param}")(target)
    file = tmp_path / "model.xml"
    file.write_text(registry.engine("mujoco").script(scene, setting), encoding="utf-8")
    return str(file)


def _bounced(data: Any, step: Callable[[], object]) -> float:
    """e of the ball, launched at SPEED."""
    data.qpos[2] += 2.3 * SPEED * 1e-5
    data.qvel[2] = -SPEED
    for _ in range(80):
        step()
    return float(data.qvel[2]) / SPEED


def test_the_viewers_loader_opens_it(path: str) -> None:
    viewer = pytest.importorskip("mujoco.viewer")
    model, data, _ = viewer._file_loader(path)()
    assert _bounced(data, lambda: mujoco.mj_step(model, data)) == pytest.approx(E, abs=1e-5)


def test_threads_share_a_model(path: str) -> None:
    model = mujoco.MjModel.from_xml_path(path)

    def run(_: int) -> float:
        data = mujoco.MjData(model)
        return _bounced(data, lambda: mujoco.mj_step(model, data))

    with ThreadPoolExecutor(4) as pool:
        several = list(pool.map(run, range(8)))
    assert several == [pytest.approx(E, abs=1e-5)] * 8
    assert len(set(several)) == 1


def test_rollout_in_threads_is_that_in_one(path: str) -> None:
    model = mujoco.MjModel.from_xml_path(path)
    data, full = mujoco.MjData(model), mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts = np.zeros((16, mujoco.mj_stateSize(model, full)))
    for one, speed in zip(starts, np.linspace(0.1, 0.4, 16), strict=True):
        data.qvel[2] = -speed
        mujoco.mj_getState(model, data, one, full)
    paths = [
        mujoco.rollout.rollout(model, [mujoco.MjData(model) for _ in range(n)], starts, nstep=60)[0]
        for n in (1, 3)
    ]
    assert np.array_equal(*paths)


def _speeds(model: Any, data: Any) -> Any:
    """Speeds of both balls after they met the floor, m/s upwards."""
    at_the_floor(model, data)
    states = []
    for _ in range(20):
        mujoco.mj_step(model, data)
        states.append(data.qvel.copy())
    return parting_speeds(np.array(states))


def test_a_law_acts_on_the_geom_that_bears_its_name_in_the_model_that_is_stepped() -> None:
    """Two models with the same config, stepped with the same MjData."""
    contact.load()
    first, second = two_balls(("bouncer", "other")), two_balls(("other", "bouncer"))
    data = mujoco.MjData(first)
    own = _speeds(first, data)
    assert own[0] > 0.85
    assert own[1] < 0.5
    assert np.array_equal(_speeds(second, data), own[::-1])
    assert np.array_equal(_speeds(first, data), own)


def test_a_model_made_after_another_is_freed_is_another_model() -> None:
    """The second model often lies at the address of the first."""
    contact.load()
    names = ("bouncer", "other")
    model = two_balls(names)
    data = mujoco.MjData(model)
    own = _speeds(model, data)
    for _ in range(6):
        names, own = names[::-1], own[::-1]
        del model
        model = two_balls(names)
        assert np.array_equal(_speeds(model, data), own)


def test_rollout_of_models_with_exchanged_names_lets_the_named_ball_bounce() -> None:
    contact.load()
    models = [two_balls(("bouncer", "other")), two_balls(("other", "bouncer"))]
    data, full = mujoco.MjData(models[0]), mujoco.mjtState.mjSTATE_FULLPHYSICS
    at_the_floor(models[0], data)
    start = np.zeros((2, mujoco.mj_stateSize(models[0], full)))
    mujoco.mj_getState(models[0], data, start[0], full)
    start[1] = start[0]
    states = mujoco.rollout.rollout(models, [mujoco.MjData(models[0])], start, nstep=20)[0]
    speeds = [parting_speeds(path[:, -12:]) for path in states]
    assert speeds[0][0] > 0.85
    assert speeds[0][1] < 0.5
    assert np.array_equal(speeds[1], speeds[0][::-1])


def test_dm_control_steps_it(path: str) -> None:
    made = pytest.importorskip("dm_control.mujoco").Physics
    try:
        made.from_xml_string("<mujoco/>")
    except AttributeError as error:
        pytest.skip(f"this dm_control does not know this MuJoCo: {error}")
    physics = made.from_xml_path(path)
    physics.legacy_step = False
    assert _bounced(physics.data, physics.step) == pytest.approx(E, abs=1e-5)


def test_a_gymnasium_environment_steps_it(path: str) -> None:
    spaces = pytest.importorskip("gymnasium.spaces")
    environment = pytest.importorskip("gymnasium.envs.mujoco").MujocoEnv

    class Drop(environment):  # type: ignore[misc, valid-type]
        metadata = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"]}  # noqa: RUF012

        def reset_model(self) -> Any:
            return self.data.qpos.copy()

    step = mujoco.MjModel.from_xml_path(path).opt.timestep
    Drop.metadata["render_fps"] = round(1 / step)
    drop = Drop(path, 1, spaces.Box(-np.inf, np.inf, (7,)))
    drop.reset()
    assert _bounced(drop.data, lambda: drop.do_simulation(np.zeros(0), 1)) == pytest.approx(
        E, abs=1e-5
    )


def test_a_law_of_bodies_is_not_that_of_other_geoms_without_names() -> None:
    """An instance for bodies names no geoms, and neither do these."""
    contact.load()
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><extension><plugin plugin="hcbench.restitution"><instance name="law">'
        '<config key="body1" value="ball"/><config key="body2" value="world"/>'
        '<config key="restitution" value="0.5"/></instance></plugin></extension><worldbody>'
        '<geom type="plane" size="1 1 1"/>'
        '<body name="ball" pos="0 0 1"><freejoint/><geom size=".05"/></body>'
        '<body name="other" pos="1 0 1"><freejoint/><geom size=".05"/></body></worldbody></mujoco>'
    )
    plane, ball, other = range(3)
    assert restitution_law(model, (ball, plane)) == ConstantRestitution(0.5)
    assert restitution_law(model, (other, plane)) is None
    assert restitution_law(model, (ball, other)) is None
