"""Hunt-Crossley contact inside MuJoCo: the law's physics in models that a user might have."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from contact_scenes import plugged
from covering import every_pair
from scipy.integrate import solve_ivp

from hcbench.contact.mujoco import Friction, HuntCrossley, Restitution
from hcbench.engines.mujoco.model.bodies import speed_reading
from hcbench.laws import closed_form

MASS, STIFFNESS, ALPHA, RADIUS = 0.45359237, 3.4064e10, 0.008 / 0.0254, 0.0508
LAW = HuntCrossley(STIFFNESS, ALPHA)
CUP = Path(__file__).parents[3] / "scenes" / "steel-cup" / "scene.xml"
PHASES = [0.06 + i / 8 for i in range(8)]
HAS_DISCRETE = hasattr(mujoco.mjtIntegrator, "mjINT_DISCRETE")
INTEGRATORS = ["Euler", "implicitfast", "implicit", "RK4", *(["discrete"] if HAS_DISCRETE else [])]

BALL = f'<freejoint/><geom name="{{0}}" size="{RADIUS}" mass="{{1}}" condim="{{2}}"/>'


def plane(
    h: float, integrator: str = "Euler", gravity: float = 0.0, condim: int = 1, more: str = ""
) -> Any:
    return mujoco.MjSpec.from_string(f"""<mujoco>
      <option timestep="{h}" integrator="{integrator}" gravity="0 0 {-gravity}"/><worldbody>
      <geom name="plate" type="plane" size="1 1 1" condim="{condim}"/>
      <body name="ball" pos="0 0 {RADIUS}">{BALL.format("ball", MASS, condim)}</body>{more}
      </worldbody></mujoco>""")


def free_balls(h: float, masses: list[float], gap: float = 1e-3) -> Any:
    """Balls in a row along x, at rest, `gap` apart."""
    bodies = "".join(
        f'<body name="b{i}" pos="{i * (2 * RADIUS + gap)} 0 0">{BALL.format(f"b{i}", mass, 1)}</body>'
        for i, mass in enumerate(masses)
    )
    return mujoco.MjSpec.from_string(
        f'<mujoco><option timestep="{h}" gravity="0 0 0"/><worldbody>{bodies}</worldbody></mujoco>'
    )


def cup(h: float, integrator: str = "Euler", gravity: float = 0.0) -> Any:
    model = mujoco.MjSpec.from_file(str(CUP))
    model.option.timestep, model.option.gravity = h, [0, 0, -gravity]
    model.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    return model


def drop(model: Any, speed: float, phase: float, ready: float) -> tuple[float, float]:
    """(v before, v after) of an impact along z; `ready` is the height
    of the ball's centre at touch.
    """
    data, gap = mujoco.MjData(model), (2 + phase) * model.opt.timestep * speed
    data.qpos[2], data.qvel[2] = ready + gap, -speed
    before = speed
    for _ in range(100_000):
        if data.qvel[2] < 0 and data.qpos[2] > ready:
            before = -float(data.qvel[2])
        mujoco.mj_step(model, data)
        if data.qvel[2] > 0 and data.qpos[2] > ready + gap:
            return before, float(data.qvel[2])
    raise AssertionError("the ball never left")


def run(model: Any, data: Any, over: Callable[[], bool], most: int = 200_000) -> None:
    for _ in range(most):
        mujoco.mj_step(model, data)
        if over():
            return
    raise AssertionError("it never ended")


def momentum(model: Any, data: Any) -> Any:
    """Linear and angular momentum about the world's origin, of free single bodies."""
    total = np.zeros(6)
    for body in range(1, model.nbody):
        if model.body_dofnum[body] != 6:
            continue
        dof = model.body_dofadr[body]
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, data.qpos[model.jnt_qposadr[model.body_jntadr[body]] :][3:7])
        where = data.qpos[model.jnt_qposadr[model.body_jntadr[body]] :][:3]
        p = model.body_mass[body] * data.qvel[dof : dof + 3]
        spin = turn.reshape(3, 3) @ (model.body_inertia[body] * data.qvel[dof + 3 : dof + 6])
        total += np.concatenate([p, np.cross(where, p) + spin])
    return total


@pytest.mark.parametrize(
    ("integrator", "h", "scene"), every_pair(INTEGRATORS, [1e-5, 2e-5], ["plane", "cup"])
)
def test_force_law_bounces_as_the_law_at_every_phase(integrator: str, h: float, scene: str) -> None:
    model, ready = (
        (plane(h, integrator), RADIUS) if scene == "plane" else (cup(h, integrator), 0.0254)
    )
    pairs, tendon = ([("ball", "plate")], None) if scene == "plane" else ([], "contact")
    model = plugged(model, pairs, LAW, tendon)
    for speed in (0.0254, 0.2032, 0.508):
        for phase in PHASES:
            _, out = drop(model, speed, phase, ready)
            assert out / speed == pytest.approx(
                float(closed_form.restitution(ALPHA, speed)), abs=5e-6
            )


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_force_law_at_a_fine_step(integrator: str) -> None:
    h, error = 1e-6, 1e-9
    model = plane(h, integrator)
    model = plugged(model, [("ball", "plate")], LAW)
    for phase in PHASES[::3]:
        _, out = drop(model, 0.2032, phase, RADIUS)
        assert out / 0.2032 == pytest.approx(
            float(closed_form.restitution(ALPHA, 0.2032)), abs=error
        )


def test_two_free_balls_of_unequal_mass() -> None:
    model = free_balls(1e-5, [0.2, 0.7])
    model = plugged(model, [("b0", "b1")], LAW)
    effective = 0.2 * 0.7 / 0.9
    data = mujoco.MjData(model)
    data.qvel[0] = 0.4
    start, deepest = momentum(model, data), -1.0

    def over() -> bool:
        nonlocal deepest
        deepest = max(deepest, 2 * RADIUS - float(data.qpos[7] - data.qpos[0]))
        return bool(data.qpos[7] - data.qpos[0] > 2 * RADIUS + 1e-5 and data.qvel[6] > data.qvel[0])

    run(model, data, over)
    assert not data.qfrc_passive.any()
    assert momentum(model, data) == pytest.approx(start, abs=1e-12 * start[0])
    assert (data.qvel[6] - data.qvel[0]) / 0.4 == pytest.approx(
        float(closed_form.restitution(ALPHA, 0.4)), abs=1e-6
    )
    assert deepest == pytest.approx(
        float(closed_form.penetration_max(LAW, effective, 0.4)), rel=1e-2
    )


def test_a_ball_on_a_plate_that_moves() -> None:
    model = mujoco.MjSpec.from_string(f"""<mujoco><option timestep="1e-5" gravity="0 0 0"/><worldbody>
      <body name="ball" pos="0 0 {0.011 + RADIUS}">{BALL.format("ball", MASS, 1)}</body>
      <body><joint type="slide" axis="0 0 1"/><geom name="top" type="box" size=".2 .2 .01" mass="3"/></body>
      </worldbody></mujoco>""")
    model = plugged(model, [("ball", "top")], LAW)
    data = mujoco.MjData(model)
    data.qvel[2], data.qvel[6] = -0.25, 0.15
    run(
        model,
        data,
        lambda: data.qvel[2] > data.qvel[6] and data.qpos[2] - data.qpos[7] > 0.0101 + RADIUS,
    )
    assert MASS * data.qvel[2] + 3 * data.qvel[6] == pytest.approx(
        3 * 0.15 - MASS * 0.25, abs=1e-12
    )
    assert (data.qvel[2] - data.qvel[6]) / 0.4 == pytest.approx(
        float(closed_form.restitution(ALPHA, 0.4)), abs=1e-6
    )


def test_a_chain_of_three_one_impact_after_the_other() -> None:
    model = free_balls(1e-5, [0.3, 0.5, 0.4])
    model = plugged(model, [("b0", "b1"), ("b1", "b2")], LAW)
    data = mujoco.MjData(model)
    data.qvel[0] = v = 0.5
    run(model, data, lambda: data.qvel[12] > 0 and data.qpos[14] - data.qpos[7] > 2 * RADIUS + 1e-4)
    speeds = np.array([v, 0.0, 0.0])
    for i, j, mi, mj in ((0, 1, 0.3, 0.5), (1, 2, 0.5, 0.4)):
        closing = speeds[i] - speeds[j]
        push = (1 + float(closed_form.restitution(ALPHA, closing))) * closing * mi * mj / (mi + mj)
        speeds[i], speeds[j] = speeds[i] - push / mi, speeds[j] + push / mj
    assert data.qvel[::6] == pytest.approx(speeds, abs=2e-6)
    assert np.dot([0.3, 0.5, 0.4], data.qvel[::6]) == pytest.approx(0.3 * v, abs=1e-12)


def test_a_chain_of_three_that_touch_all_at_once() -> None:
    masses, v, h = np.array([0.3, 0.5, 0.4]), 0.4, 2e-6

    def rates(_: float, y: Any) -> Any:
        x, u = y[:3], y[3:]
        depth, closing = np.maximum(x[:-1] - x[1:], 0), u[:-1] - u[1:]
        force = np.maximum(LAW.force(depth, closing), 0.0)
        return np.concatenate([u, (np.append(0.0, force) - np.append(force, 0.0)) / masses])

    truth = solve_ivp(
        rates, (0, 1e-3), [0, 0, 0, v, 0, 0], rtol=1e-10, atol=1e-14, max_step=2e-6
    ).y[3:, -1]
    model = free_balls(h, list(masses), gap=0.0)
    model = plugged(model, [("b0", "b1"), ("b1", "b2")], LAW)
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = -2.3 * h * v, v
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert masses @ data.qvel[::6] == pytest.approx(0.3 * v, abs=1e-13)
    assert data.qvel[::6] == pytest.approx(truth, abs=2e-5)


def test_an_oblique_hit_without_friction_keeps_its_tangential_speed() -> None:
    model = plane(1e-5)
    model = plugged(model, [("ball", "plate")], LAW)
    data = mujoco.MjData(model)
    data.qpos[2] += 1e-5
    data.qvel[:3] = 0.31, -0.17, -0.4
    run(model, data, lambda: data.qvel[2] > 0 and data.qpos[2] > RADIUS + 1e-5)
    assert data.qvel[:2] == pytest.approx([0.31, -0.17], abs=1e-12)
    assert data.qvel[3:6] == pytest.approx(np.zeros(3), abs=1e-12)
    assert data.qvel[2] / 0.4 == pytest.approx(float(closed_form.restitution(ALPHA, 0.4)), abs=1e-6)


def test_an_off_axis_hit_in_the_cup() -> None:
    model, centre = cup(2e-6), np.array([0.0, 0.0, 0.0508])
    model = plugged(model, [], LAW, "contact")
    data = mujoco.MjData(model)
    away = np.array([np.sin(0.4), 0.0, -np.cos(0.4)])
    data.qpos[:3] = centre + (0.0254 - 1e-6) * away
    data.qvel[:3] = 0.3 * away + 0.2 * np.array([np.cos(0.4), 0.0, np.sin(0.4)])
    start = np.cross(data.qpos[:3] - centre, data.qvel[:3])

    def gap() -> float:
        return 0.0254 - float(np.linalg.norm(data.qpos[:3] - centre))

    run(model, data, lambda: gap() <= 0, 100)
    run(model, data, lambda: gap() > 0)
    out = (data.qpos[:3] - centre) / np.linalg.norm(data.qpos[:3] - centre)
    assert np.cross(data.qpos[:3] - centre, data.qvel[:3]) == pytest.approx(start, abs=1e-14)
    # The wall turns away under the sliding ball at v_t²/R: 1e-3 of the force's
    # acceleration, not in the law.
    assert -(out @ data.qvel[:3]) / 0.3 == pytest.approx(
        float(closed_form.restitution(ALPHA, 0.3)), abs=2e-3
    )


def test_a_spinning_ball_with_friction_keeps_momentum_and_slips_less() -> None:
    model = plugged(
        free_balls(1e-5, [0.3, 0.5], gap=2e-5),
        [("b0", "b1")],
        LAW,
        friction=Friction(0.3, 0.2, 1e-3),
    )
    data = mujoco.MjData(model)
    data.qpos[1] = 0.4 * RADIUS  # off-centre too
    data.qpos[0] = data.qpos[7] - np.sqrt((2 * RADIUS) ** 2 - data.qpos[1] ** 2) - 2e-5
    data.qvel[:6] = 0.4, 0.0, 0.0, 3.0, -7.0, 5.0
    start = momentum(model, data)
    energy = [_kinetic(model, data)]
    run(model, data, lambda: bool(data.qvel[6] > 0.01), 2000)
    run(model, data, lambda: not _touching(data), 2000)
    energy.append(_kinetic(model, data))
    # Rotations integrate to first order, forces and torques are equal and opposite to rounding.
    assert momentum(model, data)[:3] == pytest.approx(start[:3], abs=1e-13)
    assert momentum(model, data)[3:] == pytest.approx(start[3:], abs=1e-12)
    assert energy[1] < energy[0]
    assert abs(data.qvel[9:12]).max() > 0.1  # the other ball has been spun


def _touching(data: Any) -> bool:
    return bool(np.linalg.norm(data.qpos[7:10] - data.qpos[:3]) <= 2 * RADIUS + 1e-6)


def _kinetic(model: Any, data: Any) -> float:
    mujoco.mj_forward(model, data)
    mujoco.mj_energyVel(model, data)
    return float(data.energy[1])


def test_friction_stops_a_sliding_ball_but_never_turns_it_around() -> None:
    model = plane(1e-5, gravity=9.81)
    model = plugged(model, [("ball", "plate")], LAW, friction=Friction(5.0, 5.0, 1e-06))
    data = mujoco.MjData(model)
    data.qvel[0] = 1e-3
    slip = []
    for _ in range(3000):
        mujoco.mj_step(model, data)
        slip.append(data.qvel[0] - RADIUS * data.qvel[4])
    assert min(slip) > -1e-5 * slip[0]
    assert slip[-1] < 1e-6
    assert data.qvel[0] == pytest.approx(1e-3 * 5 / 7, rel=1e-2)  # it rolls


def test_a_pendulum_hits_with_the_effective_mass_of_its_joint() -> None:
    model = mujoco.MjSpec.from_string("""<mujoco><option timestep="1e-5" gravity="0 0 0"/><worldbody>
      <geom name="wall" type="plane" size="1 1 1" pos="0.05 0 -0.5" zaxis="-1 0 0"/><body>
      <joint type="hinge" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.5" size=".01" mass=".3"/>
      <body pos="0 0 -.5"><geom name="bob" size="0.049" mass=".4"/></body></body></worldbody></mujoco>""")
    model = plugged(model, [("bob", "wall")], LAW)
    data = mujoco.MjData(model)
    data.qvel[0] = -0.6
    depth = [0.0]
    speed = 0.6 * 0.5

    def over() -> bool:
        mujoco.mj_forward(model, data)
        wall = data.geom("wall")
        centre = data.geom("bob").xpos - wall.xpos
        depth.append(0.049 - float(centre @ wall.xmat.reshape(3, 3)[:, 2]))
        return bool(data.qvel[0] > 0 and not data.qfrc_passive.any())

    run(model, data, over)
    assert data.qvel[0] / 0.6 == pytest.approx(
        float(closed_form.restitution(ALPHA, speed)), abs=5e-4
    )
    inertia = model.body_inertia[1, 1] + 0.3 * 0.25**2 + model.body_inertia[2, 1] + 0.4 * 0.5**2
    mass = inertia / 0.5**2
    assert max(depth) == pytest.approx(
        float(closed_form.penetration_max(LAW, mass, speed)), rel=1e-2
    )


def test_a_hundred_balls_bounce_each_as_if_alone() -> None:
    h, speeds = 1e-5, np.linspace(0.05, 0.5, 100)
    bodies = "".join(
        f'<body pos="{0.12 * (i % 10)} {0.12 * (i // 10)} {RADIUS}">{BALL.format(f"b{i}", MASS, 1)}</body>'
        for i in range(100)
    )
    model = mujoco.MjSpec.from_string(f"""<mujoco><option timestep="{h}" gravity="0 0 0"/><worldbody>
      <geom name="plate" type="plane" size="5 5 1" condim="1"/>{bodies}</worldbody></mujoco>""")
    pairs = [(f"b{i}", "plate") for i in range(100)]
    pairs += [(f"b{i}", f"b{j}") for i in range(100) for j in range(max(0, i - 10), i)]
    model = plugged(model, pairs, LAW)
    data = mujoco.MjData(model)
    data.qpos[2::7] += 3.3 * h * speeds
    data.qvel[2::6] = -speeds
    for _ in range(60):
        mujoco.mj_step(model, data)
    assert data.qvel[2::6] / speeds == pytest.approx(
        closed_form.restitution(ALPHA, speeds), abs=2e-6
    )


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_a_box_falls_flat_on_four_contacts(integrator: str) -> None:
    def box(h: float) -> Any:
        return mujoco.MjSpec.from_string(f"""<mujoco>
          <option timestep="{h}" integrator="{integrator}" gravity="0 0 0"/><worldbody>
          <geom name="plate" type="plane" size="1 1 1"/><body pos="0 0 .05"><freejoint/>
          <geom name="box" type="box" size=".03 .04 .05" mass="{MASS}"/></body></worldbody></mujoco>""")

    # Four springs of k/4 that share a body: each takes the others in to
    # first order, all are of second.
    for h, error in ((2e-6, 2e-5), (1e-5, 4e-4)):
        model = box(h)
        model = plugged(model, [("box", "plate")], HuntCrossley(STIFFNESS / 4, ALPHA))
        for speed in (0.05, 0.5):
            _, out = drop(model, speed, 0.4, 0.05)
            assert out / speed == pytest.approx(
                float(closed_form.restitution(ALPHA, speed)), abs=error
            )
    model = box(1e-3)
    model = plugged(model, [("box", "plate")], Restitution(ALPHA))
    before, out = drop(model, 0.3, 0.4, 0.05)
    error = 1e-6 if integrator == "implicitfast" else 1e-9
    assert out / before == pytest.approx(float(closed_form.restitution(ALPHA, 0.3)), abs=error)


def test_a_force_law_bounces_to_the_heights_of_the_law() -> None:
    model = plane(2e-5, gravity=9.81)
    model = plugged(model, [("ball", "plate")], LAW)
    data = mujoco.MjData(model)
    data.qpos[2] += 2e-4
    tops, rising, energy = [2e-4], False, []
    while len(tops) < 4:
        mujoco.mj_step(model, data)
        if data.qpos[2] - RADIUS > 2e-5:
            energy.append(
                0.5 * data.qvel[2] ** 2
                + 9.81 * (data.qpos[2] - RADIUS)
                - 0.5 * 2e-5 * 9.81 * data.qvel[2]
            )
        if rising and data.qvel[2] <= 0:
            tops.append(float(data.qpos[2] - RADIUS))
        rising = bool(data.qvel[2] > 0)
    assert np.diff(energy).max() < 1e-12
    for before, after in pairwise(tops):
        speed = np.sqrt(2 * 9.81 * before)
        # Gravity acts during contact too and is not in (16): 9.81 m/s² over some 1e-4 s.
        assert np.sqrt(2 * 9.81 * after) / speed == pytest.approx(
            float(closed_form.restitution(ALPHA, speed)), abs=4e-3
        )


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize("scene", ["plane", "cup"])
def test_restitution_law_gives_each_impact_its_own(scene: str, integrator: str) -> None:
    for h in (1e-4, 1e-3, 4e-3):
        for gravity in (0.0, 9.81):
            on_plane = scene == "plane"
            spec = plane(h, integrator, gravity, 3) if on_plane else cup(h, integrator, gravity)
            pairs, tendon = ([("ball", "plate")], None) if on_plane else ([], "contact")
            model = plugged(spec, pairs, Restitution(ALPHA), tendon)
            ready = RADIUS if on_plane else 0.0254
            for speed in (0.0508, 0.508):
                for phase in PHASES[::2]:
                    assert _one_bounce(model, speed, phase, ready) < 1e-12


def _one_bounce(model: Any, speed: float, phase: float, ready: float) -> float:
    """Error of e, of the speeds at the touch plane."""
    data = mujoco.MjData(model)
    h, g = model.opt.timestep, -model.opt.gravity[2]
    data.qpos[2], data.qvel[2] = ready + (1 + phase) * h * speed, -speed
    for _ in range(50):
        came = ready - data.qpos[2:3], -data.qvel[2:3]
        mujoco.mj_step(model, data)
        if data.qvel[2] > 0:
            left = ready - data.qpos[2:3], -data.qvel[2:3]
            (speed_in,), (speed_out,) = speed_reading(model).speeds(came, left, g * h, g)
            return float(abs(speed_out / speed_in - closed_form.restitution(ALPHA, speed_in)))
    raise AssertionError("no bounce")


def test_restitution_of_the_linear_reading() -> None:
    model = plane(1e-3)
    model = plugged(model, [("ball", "plate")], Restitution(ALPHA, "linear"))
    before, after = drop(model, 0.4, 0.3, RADIUS)
    assert after / before == pytest.approx(1 - ALPHA * 0.4, abs=1e-12)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize("condim", [1, 3])
def test_a_bounce_train_loses_energy_in_every_impact_and_comes_to_rest(
    integrator: str, condim: int
) -> None:
    h, alpha = 1e-3, 20 * ALPHA  # so that rest comes soon
    model = plane(h, integrator, 9.81, condim)
    model = plugged(model, [("ball", "plate")], Restitution(alpha))
    data = mujoco.MjData(model)
    data.qpos[2] += 0.02
    energy, at = [], []
    for _ in range(3000):
        mujoco.mj_step(model, data)
        # What is conserved in free flight: with Euler it differs from the true energy by g h v / 2.
        lag = 0.0 if integrator == "RK4" else 0.5 * h * 9.81 * data.qvel[2]
        energy.append(0.5 * data.qvel[2] ** 2 + 9.81 * data.qpos[2] - lag)
        at.append(float(data.qpos[2]))
    # Implicit integrators take the solver's force: there rows that rest are
    # softer, and creep by 1e-8 m/s.
    creep = 10.0 if integrator == "implicitfast" else 1.0
    assert abs(data.qvel[2]) < 1e-9 * creep
    assert np.ptp(at[-500:]) < 1e-9 * creep
    assert np.diff(energy).max() < (1e-11 if integrator == "implicitfast" else 1e-12)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_what_rests_stays(integrator: str) -> None:
    top = f'<body name="top" pos="0 0 {3 * RADIUS}">{BALL.format("top", 2.0, 3)}</body>'
    model = plane(2e-3, integrator, 9.81, 3, top)
    model = plugged(model, [("ball", "plate"), ("top", "ball")], Restitution(ALPHA))
    data, heights = mujoco.MjData(model), []
    for _ in range(200):
        mujoco.mj_step(model, data)
        heights.append(data.qpos[[2, 9]].copy())
    # It begins at touch, which is not yet contact, and falls for a step or two; then nothing moves.
    assert heights[20] == pytest.approx([RADIUS, 3 * RADIUS], abs=1e-4)
    # Implicit integrators take the solver's force, so there rows that rest are softer: 2e-7 m/s.
    assert heights[-1] == pytest.approx(
        heights[20], abs=2e-7 if integrator == "implicitfast" else 2e-9
    )
