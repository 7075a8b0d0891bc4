"""The law in MJX: pairs bounce by the law of each impact's speed, in a user's own worlds."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from law_worlds import FEET, GRAVITY, PHASES, PRESSED, QUADRUPED, SHAPES, SPEEDS, WORLD, world

from hcbench.contact.mjx import ConstantRestitution, Restitution, restitution
from hcbench.system.errors import SettingError, UserError
from hcbench.terms.impact import Floats

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "plugin-mjx.md"
jax_is_there = pytest.mark.needs_engine("mjx")


@contextmanager
def in_bits(bits: int) -> Iterator[None]:
    """JAX's numbers have so many bits, 32 or 64."""
    import jax

    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", bits == 64)
    try:
        yield
    finally:
        jax.config.update("jax_enable_x64", before)


def thrown(model: mujoco.MjModel, qpos: Floats, qvel: Floats) -> Any:
    """MJX's data of one world for each row."""
    import jax
    from mujoco import mjx

    data = mjx.make_data(model)
    return jax.vmap(lambda p, v: data.replace(qpos=p, qvel=v))(qpos, qvel)


def stepped(
    model: Any, data: Any, values: Any, step: Any, steps: int
) -> tuple[Any, tuple[Floats, Floats]]:
    """(data after these steps, positions and velocities after each)."""
    import jax

    def one(data: Any, _: Any) -> Any:
        data = step(model, data, values)
        return data, (data.qpos, data.qvel)

    data, (qpos, qvel) = jax.jit(lambda data: jax.lax.scan(one, data, length=steps))(data)
    return data, (np.array(qpos, float), np.array(qvel, float))


def dropped(
    model: mujoco.MjModel, step: Any, rest: float, values: Floats | None
) -> tuple[Floats, Floats]:
    """Speeds at the touch plane before and after, m/s, of launches straight down."""
    import jax
    from mujoco import mjx

    h = model.opt.timestep
    count = SPEEDS.size
    qpos = np.tile(model.qpos0, (count, 1))
    qpos[:, 2] = rest + PHASES * h * SPEEDS
    qvel = np.zeros((count, model.nv))
    qvel[:, 2] = -SPEEDS
    # Steps that move by the new velocity keep (v + g h/2)² - 2 g x.
    before = np.sqrt((SPEEDS + GRAVITY * h / 2) ** 2 + 2 * GRAVITY * (qpos[:, 2] - rest))
    data = thrown(model, qpos, qvel)
    own = values if values is not None else np.tile(np.nan, (count, 1))
    own_step = step if values is not None else lambda m, d, _: step(m, d)
    data, _ = stepped(mjx.put_model(model), data, own, jax.vmap(own_step, (None, 0, 0)), 6)
    height, rate = np.array(data.qpos, float)[:, 2], np.array(data.qvel, float)[:, 2]
    after = np.sqrt((-rate + GRAVITY * h / 2) ** 2 + 2 * GRAVITY * (height - rest))
    return before, after


@jax_is_there
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("bits", "within"), [(64, 1e-6), (32, 1e-4)])
def test_each_impact_has_the_e_of_its_own_speed(shape: str, bits: int, within: float) -> None:
    model = world(shape)
    with in_bits(bits):
        step = restitution(model, {("ball", "floor"): 0.21})
        before, after = dropped(model, step, SHAPES[shape][1], None)
    assert after / before == pytest.approx(Restitution(0.21).at(before), abs=within)


@jax_is_there
def test_worlds_have_an_alpha_of_their_own() -> None:
    alphas = np.linspace(0.0, 0.4, SPEEDS.size)
    model = world("box", option='integrator="implicitfast" cone="elliptic"')
    with in_bits(64):
        step = restitution(model, {("ball", "world"): 0.1})
        before, after = dropped(model, step, SHAPES["box"][1], alphas[:, None])
    asked = [Restitution(alpha).at(v) for alpha, v in zip(alphas, before, strict=True)]
    assert after / before == pytest.approx(np.array(asked), abs=1e-5)


@jax_is_there
def test_a_tumbling_box_gains_no_energy_and_rests_where_e_is_below_1() -> None:
    import jax
    from mujoco import mjx

    model = world("box", timestep=5e-4)
    generator = np.random.default_rng(41)
    qpos = np.tile(model.qpos0, (8, 1))
    qpos[:, 2] = 0.12
    turns = generator.normal(size=(8, 4))
    qpos[:, 3:7] = turns / np.linalg.norm(turns, axis=1)[:, None]
    qvel = generator.normal(size=(8, 6)) * [1, 1, 1, 5, 5, 5]
    inertia = np.array([model.body_mass[1]] * 3 + list(model.body_inertia[1]))
    values = np.tile(np.array([0.0, 0.3, 0.6, 1.0])[:, None], (2, 1))
    with in_bits(64):
        step = restitution(model, {("ball", "floor"): ConstantRestitution(0.5)})
        each = jax.vmap(step, in_axes=(None, 0, 0))
        data = thrown(model, qpos, qvel)
        _, (heights, rates) = stepped(mjx.put_model(model), data, values, each, 2000)
    last = np.abs(rates[-1, :2])
    rates[:, :, 2] -= GRAVITY * model.opt.timestep / 2
    path = rates**2 @ inertia / 2 + model.body_mass[1] * GRAVITY * heights[:, :, 2]
    # Half of it is Euler's own in the spinning flight.
    assert np.max(path - np.minimum.accumulate(path)) < 2e-3 * path[0].max()
    assert last.max() < 1e-3


@jax_is_there
@pytest.mark.parametrize("name", PRESSED)
def test_what_others_press_rests_no_deeper_than_on_mjx_s_own_contact(name: str) -> None:
    """A stranger's worlds: contacts that gravity and motors alone do not load sank without end."""
    from mujoco import mjx

    body, names = PRESSED[name]
    pairs = dict.fromkeys(names, 0.3)
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".002"/><worldbody>
<geom name="floor" type="plane" size="5 5 .1"/>{body}</worldbody></mujoco>"""
    )
    with in_bits(64):
        on_device = mjx.put_model(model)
        start = mjx.make_data(model)
        own = restitution(model, pairs)
        _, (poses, rates) = stepped(on_device, start, None, lambda m, d, _: own(m, d), 1500)
        _, (plain, _) = stepped(on_device, start, None, lambda m, d, _: mjx.step(m, d), 1500)
    assert depth(model, poses[-1]) > min(depth(model, pose) for pose in plain[-300:]) - 1e-4
    assert np.abs(rates[-1]).max() < 1e-3


@jax_is_there
@pytest.mark.slow
def test_a_quadruped_rests_on_its_feet_no_deeper_than_on_mjx_s_own_contact() -> None:
    import jax
    from mujoco import mjx

    model = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    pairs = {(foot, "floor"): ConstantRestitution(0.3) for foot in FEET}
    qpos = model.qpos0.copy()
    qpos[2] += 0.1
    worlds = np.array([0.0, 0.6])
    with in_bits(64):
        own = jax.vmap(restitution(model, pairs), in_axes=(None, 0, 0))
        on_device = mjx.put_model(model)
        start = mjx.make_data(model).replace(qpos=qpos)
        data = jax.vmap(lambda _: start)(worlds)
        values = np.tile(worlds[:, None], (1, len(FEET)))
        _, (poses, rates) = stepped(on_device, data, values, own, 500)
        _, (plain, _) = stepped(on_device, start, None, lambda m, d, _: mjx.step(m, d), 500)
    deepest = min(depth(model, pose) for pose in poses.reshape(-1, model.nq))
    assert deepest > min(depth(model, pose) for pose in plain) - 1e-3
    assert np.abs(rates[-1]).max() < 0.05


def depth(model: mujoco.MjModel, qpos: Any) -> float:
    """Distance of the deepest contact in a pose, m, below 0."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return min([0.0, *(float(contact.dist) for contact in data.contact)])


@jax_is_there
def test_the_page_s_scripts_run_in_a_user_s_folder(tmp_path: Path) -> None:
    blocks = re.findall(r"```py\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    model = WORLD.format(timestep=2e-3, option="", shape=SHAPES["sphere"][0])
    box = '<body pos="1 0 .2"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body>'
    (tmp_path / "my.xml").write_text(model.replace("</worldbody>", f"{box}</worldbody>"))
    script = "\n".join(blocks).replace("worlds = 1024", "worlds = 3")
    script += "\nassert batch.qpos.shape == (3, model.nq) and batch.time[2] == 2 * data.time"
    (tmp_path / "script.py").write_text(script, encoding="utf-8")
    subprocess.run([sys.executable, "script.py"], cwd=tmp_path, check=True)


@pytest.mark.parametrize(
    ("option", "pairs", "error", "message"),
    [
        ('integrator="RK4"', {("ball", "floor"): 0.3}, SettingError, "^integrator: RK4; .* Euler"),
        ("", {("bal", "floor"): 0.3}, UserError, "^pairs: no geom or body 'bal'; .*'ball'"),
        ("", {}, UserError, "^pairs: none; expected two names and a law"),
        (
            "",
            {("ball", "floor"): 0.3, ("world", "ball"): 0.2},
            UserError,
            r"^pairs: .*is in two pairs; expected each pair once",
        ),
        ("", {("ball", "floor"): -0.3}, SettingError, "^alpha: -0.3 s/m"),
        ("", {("ball", "floor"): "0.3 s/m"}, UserError, "^pairs: "),
        ("", {("world", "floor"): 0.3}, UserError, "^pairs: .* cannot meet"),
        ("", {("ball", "ball"): 0.3}, UserError, "^pairs: .* cannot meet"),
    ],
)
def test_what_cannot_bounce_is_an_error_by_name(
    option: str, pairs: Mapping[Any, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        restitution(world(option=option), pairs)
