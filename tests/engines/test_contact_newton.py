"""The law in Newton's SolverMuJoCo: pairs bounce by the law of each impact's speed."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from law_worlds import GRAVITY, PHASES, SPEEDS

from hcbench.contact.newton import Restitution, restitution
from hcbench.system.errors import SettingError, UserError
from hcbench.terms.impact import Floats

pytestmark = pytest.mark.needs_engine("newton")

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "plugin-newton.md"
RADIUS = 0.05
MODEL = """<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1"/>
<body name="ball" pos="0 0 .1"><freejoint/><geom name="ball" size=".05"/></body>
<body name="box" pos="1 0 .2"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body>
</worldbody></mujoco>"""


def solver_of_balls(name: str = "SolverMuJoCo", worlds: int = SPEEDS.size, **options: Any) -> Any:
    """A solver of Newton for one ball over a plane in each world."""
    import newton
    import warp as wp

    wp.config.quiet = True
    ball, scene = (newton.ModelBuilder(gravity=(0.0, 0.0, -GRAVITY)) for _ in range(2))
    body = ball.add_body(label="thing/ball")
    ball.add_shape_sphere(body, radius=RADIUS, label="thing/ball/skin")
    scene.add_ground_plane(label="floor")
    scene.replicate(ball, worlds)
    return getattr(newton.solvers, name)(scene.finalize(), **options)


def dropped(solver: Any, step: Any, timestep: float, **more: Any) -> tuple[Floats, Floats]:
    """Speeds at the touch plane before and after, m/s, of launches straight down."""
    state, after = solver.model.state(), solver.model.state()
    solver.reset(state)
    control = solver.model.control()
    poses, rates = np.zeros((SPEEDS.size, 7)), np.zeros((SPEEDS.size, 6))
    poses[:, 6] = 1.0
    poses[:, 2] = RADIUS + PHASES * timestep * SPEEDS
    rates[:, 2] = -SPEEDS
    state.joint_q.assign(poses.ravel().astype(np.float32))
    state.joint_qd.assign(rates.ravel().astype(np.float32))
    before = at_plane(state, SPEEDS, timestep)
    for _ in range(6):
        state.clear_forces()
        step(state, after, control, None, timestep, **more)
        state, after = after, state
    return before, at_plane(state, -state.joint_qd.numpy().reshape(-1, 6)[:, 2], timestep)


def at_plane(state: Any, rate: Floats, timestep: float) -> Floats:
    """Speeds at the touch plane: steps that move by the new velocity keep (v + g h/2)² - 2 g x."""
    height = state.joint_q.numpy().reshape(-1, 7)[:, 2].astype(float) - RADIUS
    return np.array(np.sqrt((rate + GRAVITY * timestep / 2) ** 2 + 2 * GRAVITY * height))


@pytest.mark.parametrize("names", [("ball", "floor"), ("skin", "world"), ("thing/ball", "floor")])
def test_each_impact_has_the_e_of_its_own_speed(names: tuple[str, str]) -> None:
    solver = solver_of_balls()
    before, after = dropped(solver, restitution(solver, {names: 0.21}), 2e-3)
    assert after / before == pytest.approx(Restitution(0.21).at(before), abs=1e-5)


def test_worlds_have_an_alpha_of_their_own() -> None:
    import warp as wp

    solver = solver_of_balls()
    alphas = np.linspace(0.0, 0.4, SPEEDS.size)
    values = wp.array(alphas[:, None], dtype=float)
    step = restitution(solver, {("ball", "floor"): 0.1})
    before, after = dropped(solver, step, 1e-3, values=values)
    asked = [Restitution(alpha).at(v) for alpha, v in zip(alphas, before, strict=True)]
    assert after / before == pytest.approx(np.array(asked), abs=1e-5)
    # Between its steps the solver is Newton's own.
    assert "_mujoco_warp_step" not in vars(solver)


def test_the_page_s_scripts_run_in_a_user_s_folder(tmp_path: Path) -> None:
    blocks = re.findall(r"```py\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    script = "\n".join(blocks).replace("worlds = 64", "worlds = 2")
    script += "\nassert state.joint_q.numpy().reshape(4, 7)[:, 2].min() > 0.04"
    (tmp_path / "my.xml").write_text(MODEL)
    (tmp_path / "script.py").write_text(script, encoding="utf-8")
    subprocess.run([sys.executable, "script.py"], cwd=tmp_path, check=True)


def test_a_solver_that_cannot_is_an_error_by_name() -> None:
    with pytest.raises(UserError, match=r"^solver: a SolverXPBD; expected newton.*SolverMuJoCo"):
        restitution(solver_of_balls("SolverXPBD"), {("ball", "floor"): 0.3})
    with pytest.raises(SettingError, match=r"^use_mujoco_cpu: True; expected False"):
        restitution(solver_of_balls(worlds=1, use_mujoco_cpu=True), {("ball", "floor"): 0.3})
    with pytest.raises(UserError, match=r"^pairs: no geom or body 'bal'; .*'ball'"):
        restitution(solver_of_balls(), {("bal", "floor"): 0.3})
    with pytest.raises(SettingError, match=r"^use_mujoco_contacts: False; expected True"):
        restitution(solver_of_balls(use_mujoco_contacts=False), {("ball", "floor"): 0.3})
