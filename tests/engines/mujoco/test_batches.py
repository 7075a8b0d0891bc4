"""Launches are simulated in batches because that is cheap; no result may change by it, not a bit."""

from __future__ import annotations

import dataclasses
import os
import signal
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import pytest
from covering import every_pair

from hcbench.engines.mujoco import engine as mujoco_engine
from hcbench.engines.mujoco.engine import MujocoEngine
from hcbench.engines.mujoco.scene import batch, world
from hcbench.engines.mujoco.scene.batch import BatchedModel, batch_kind
from hcbench.engines.mujoco.scene.mjcf import read_options
from hcbench.engines.mujoco.scene.scene_model import load
from hcbench.engines.mujoco.scene.world import Batching
from hcbench.engines.pybullet.engine import PybulletEngine
from hcbench.engines.pybullet.scene.options import read_options as pybullet_options
from hcbench.engines.pybullet.scene.world import PybulletWorld
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.sim import registry, simulate
from hcbench.terms.impact import Impact, Launch, Status
from hcbench.terms.scene import Scene, load_scene
from hcbench.terms.setting import Setting
from hcbench.workers import call

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

MUJOCO, PYBULLET = MujocoEngine(), PybulletEngine()
PLANE, CUP = load_scene("steel-plane"), load_scene("steel-cup")
FORMS = pytest.mark.parametrize("form", [PLANE, CUP], ids=["plane", "cup"])
SCENES = (dataclasses.replace(PLANE, gravity=9.80665), CUP)
EACH_SCENE = pytest.mark.parametrize("scene", SCENES, ids=["plane under gravity", "cup without"])
SHARES_MODELS = tuple(int(n) for n in mujoco.__version__.split(".")[:2]) >= (3, 17)
NEEDS_SHARED_MODELS = pytest.mark.skipif(
    not SHARES_MODELS, reason="this MuJoCo has no islands with a scale of their own"
)
STIFF = [0.9999, 0.9999, 0.001, 0.5, 2.0]


def at_random(count: int, seed: int = 1) -> list[Launch]:
    random = np.random.default_rng(seed)
    pairs = zip(random.uniform(0.01, 0.6, count), random.random(count), strict=True)
    return [Launch(float(v), float(p)) for v, p in pairs]


def made(recipe: str, scene: Scene, timestep: float, **more: Any) -> Setting:
    law = HuntCrossley(scene.stiffness, 0.008 / 0.0254, scene.exponent)
    setting: Setting = registry.recipe(recipe)(Target(law, scene.mass, timestep, 0.0254, 0.508))
    return dataclasses.replace(setting, options={**setting.options, **more})


def bits(impact: Impact) -> tuple[Any, ...]:
    record = {
        f.name: getattr(impact, f.name) for f in dataclasses.fields(impact) if f.name != "loop"
    }
    loop = impact.loop
    arrays = () if loop is None else (loop.time, loop.penetration, loop.rate, loop.force)
    return repr(record), *(array.tobytes() for array in arrays)


def same(one: Sequence[Impact], other: Sequence[Impact]) -> bool:
    return [bits(i) for i in one] == [bits(i) for i in other]


# --- MuJoCo ---


@pytest.fixture
def sizes(monkeypatch: pytest.MonkeyPatch, nothing_kept: None) -> Any:
    """Sets how launches are put together."""

    def put(chunk: int = simulate.SHORTEST_CHUNK, **batching: Any) -> None:
        monkeypatch.setattr(simulate, "SHORTEST_CHUNK", chunk)
        monkeypatch.setattr(world, "BATCHING", Batching(**batching))
        mujoco_engine.cached_pool.cache_clear()

    return put


INTEGRATORS = ["Euler", "implicit", "implicitfast", "RK4"]
if hasattr(mujoco.mjtIntegrator, "mjINT_DISCRETE"):
    INTEGRATORS.append("discrete")
NATIVE = [
    ("stock", 1e-4),
    ("spring-damper", 2e-5),
    ("impulse", 1e-3),
    *([("staggered", 2e-5)] if hasattr(mujoco.MjModel, "pair_adhesion") else []),
]


@pytest.mark.parametrize(("scene", "integrator", "case"), every_pair(SCENES, INTEGRATORS, NATIVE))
def test_mujoco_alone_together_in_threads_and_in_any_chunks_is_the_same(
    scene: Scene, integrator: str, case: tuple[str, float], sizes: Any
) -> None:
    recipe, timestep = case
    if (scene, recipe) == (CUP, "staggered"):
        pytest.skip("a tendon's limit cannot pull")
    setting = made(f"mujoco.{recipe}", scene, timestep, integrator=integrator)
    launches = at_random(8)
    sizes(compiling=np.inf, cores=1)
    alone = [MUJOCO.run(scene, setting, [launch])[0] for launch in launches]
    sizes(compiling=0.0, cores=1)
    assert same(alone, MUJOCO.run(scene, setting, launches))
    sizes(5, compiling=0.0, cores=3, balls=4, balls_of_many_rows=3, chunk_bytes=20_000)
    assert same(alone[::-1], MUJOCO.run(scene, setting, launches[::-1]))


@NEEDS_SHARED_MODELS
def test_one_balls_end_is_not_another_s(sizes: Any) -> None:
    # Deep enough, the damper is beyond what the step can follow: fast
    # balls diverge, slow ones bounce.
    deep = {"solref": [-1e9, -1e12], "solimp": STIFF, "onset": 1e-5}
    spring = {"solref": [-2.679e8, -815.0], "solimp": STIFF}
    setting = Setting("mujoco", "test", 1e-6, {"integrator": "Euler", "rows": [spring, deep]})
    launches = at_random(24, seed=3)
    sizes(compiling=np.inf)
    alone = MUJOCO.run(PLANE, setting, launches)
    found = {impact.status for impact in alone}
    assert found == {Status.PARTED, Status.DIVERGED}, found
    sizes(compiling=0.0)
    assert same(alone, MUJOCO.run(PLANE, setting, launches))


@pytest.mark.parametrize(
    ("form", "integrator", "case"),
    every_pair([PLANE, CUP], INTEGRATORS, [*NATIVE, ("two rows", 2e-5)]),
)
def test_a_ball_on_the_axis_bounces_on_a_slide_as_it_does_free(
    form: Scene,
    integrator: str,
    case: tuple[str, float],
    monkeypatch: pytest.MonkeyPatch,
    nothing_kept: None,
) -> None:
    recipe, timestep = case
    if (form, recipe) == (CUP, "staggered"):
        pytest.skip("a tendon's limit cannot pull")
    scene, launches = dataclasses.replace(form, gravity=9.80665), at_random(4)
    if recipe == "two rows":
        two = [{"solref": [-2e8, -400.0], "solimp": STIFF, "onset": onset} for onset in (0.0, 1e-5)]
        setting = Setting("mujoco", recipe, timestep, {"integrator": integrator, "rows": two})
    else:
        setting = made(f"mujoco.{recipe}", scene, timestep, integrator=integrator)
    model = load(scene, timestep, read_options(setting.options))
    rows = len(setting.options.get("rows", [1]))
    assert batch_kind(model) == ("sliding" if SHARES_MODELS or rows == 1 else "alone")
    on_a_slide = MUJOCO.run(scene, setting, launches)
    monkeypatch.setattr(world, "batch_kind", lambda _: "alone")
    mujoco_engine.cached_pool.cache_clear()
    free = MUJOCO.run(scene, setting, launches)
    assert [i.status for i in on_a_slide] == [i.status for i in free]
    for one, other in zip(on_a_slide, free, strict=True):
        assert one.samples == other.samples
        # MuJoCo's Newton solver itself is good for 1e-11 under the
        # implicit integrators at d = .9999.
        assert one.restitution == pytest.approx(other.restitution, abs=1e-11, nan_ok=True)
        assert one.force_max == pytest.approx(other.force_max, rel=1e-9, nan_ok=True)


@pytest.mark.parametrize(
    ("name", "edit"),
    [
        ("friction", ('condim="1"', 'condim="3"')),
        ("a slope", ('<geom name="plate"', '<geom name="plate" euler="1e-4 0 0"')),
        (
            "a box for a plate",
            ('type="plane" size="0.2 0.2 0.01"', 'type="box" pos="0 0 -.1" size=".2 .2 .1"'),
        ),
        (
            "a joint that takes defaults",
            ('<freejoint name="ball"/>', '<joint name="ball" type="free"/>'),
        ),
        ("a solver cut short", ("<worldbody>", '<option iterations="0"/><worldbody>')),
        ("a solver content early", ("<worldbody>", '<option tolerance="1"/><worldbody>')),
        ("a masses' sum", ("<worldbody>", '<compiler settotalmass="0.45359237"/><worldbody>')),
    ],
)
def test_what_could_leave_the_axis_or_meets_more_than_the_plate_stays_free(
    name: str, edit: tuple[str, str], tmp_path: Any
) -> None:
    text = PLANE.models["mujoco"]["scene"].read_text("utf-8")
    assert edit[0] in text
    path = tmp_path / "scene.xml"
    path.write_text(text.replace(*edit), "utf-8")
    scene = dataclasses.replace(PLANE, models={"mujoco": {"scene": path}})
    assert batch_kind(load(scene, 1e-4, read_options({}))) != "sliding", name


JOINT = '<freejoint name="ball"/>'


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "<worldbody>",
            '<default><joint springdamper=".01 1" limited="true"/></default><worldbody>',
        ),
        (
            "<worldbody>",
            '<default><joint damping="5" armature="1" frictionloss="3"/></default><worldbody>',
        ),
        (JOINT, f"<frame>{JOINT}</frame>"),
        (JOINT, f'<frame euler="30 40 0">{JOINT}</frame>'),
        ("</worldbody>", '<site name="ball#1" pos="0 0 1"/></worldbody>'),
        (
            "</worldbody>",
            '<site name="a" pos="0 0 1"/><site name="b" pos="0 0 2"/></worldbody>'
            '<tendon><spatial><site site="a"/><site site="b"/></spatial></tendon>',
        ),
    ],
)
def test_what_a_free_ball_does_not_feel_a_ball_in_a_batch_does_not_either(
    old: str, new: str, tmp_path: Any, sizes: Any
) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(
        PLANE.models["mujoco"]["scene"].read_text("utf-8").replace(old, new, 1), "utf-8"
    )
    scene = dataclasses.replace(PLANE, models={"mujoco": {"scene": path}})
    setting, launches = made("mujoco.spring-damper", PLANE, 2e-5), at_random(4)
    sizes(compiling=0.0)
    plain, found = (MUJOCO.run(own, setting, launches) for own in (PLANE, scene))
    for one, other in zip(found, plain, strict=True):
        assert one.restitution == pytest.approx(other.restitution, abs=1e-12)
        assert one.force_max == pytest.approx(other.force_max, rel=1e-12)


@NEEDS_SHARED_MODELS
@FORMS
def test_models_that_pay_are_simulated_many_in_one(
    form: Scene, monkeypatch: pytest.MonkeyPatch, nothing_kept: None
) -> None:
    made_of: list[int] = []
    real = batch.compile_batch

    def compile_batch(*of: Any) -> BatchedModel:
        made_of.append(of[1])
        return real(*of)

    monkeypatch.setattr(world, "compile_batch", compile_batch)
    monkeypatch.setattr(world, "BATCHING", Batching(cores=1))
    MUJOCO.run(form, made("mujoco.spring-damper", form, 1e-6), at_random(48))
    assert made_of == [48]
    MUJOCO.run(form, made("mujoco.impulse", form, 1e-3), at_random(24))
    assert made_of == [48, 1], "a few steps are not worth compiling a model for"


@NEEDS_SHARED_MODELS
@pytest.mark.parametrize(
    ("name", "edit"),
    [
        ("another solver", ("<worldbody>", '<option solver="CG"/><worldbody>')),
        ("no islands", ("<worldbody>", '<option><flag island="disable"/></option><worldbody>')),
        ("a sparse Jacobian", ("<worldbody>", '<option jacobian="sparse"/><worldbody>')),
        (
            "another moving body",
            ("</worldbody>", '<body pos="9 9 9"><freejoint/><geom size=".1"/></body></worldbody>'),
        ),
        (
            "a second thing to touch",
            ("</worldbody>", '<geom type="box" size=".1 .1 .1" pos="9 9 9"/></worldbody>'),
        ),
        (
            "an actuator",
            ("</mujoco>", '<actuator><motor joint="ball" gear="0 0 1 0 0 0"/></actuator></mujoco>'),
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_model_with_more_to_it_is_simulated_alone_and_bounces_alike(
    name: str, edit: tuple[str, str], tmp_path: Any, sizes: Any
) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(PLANE.models["mujoco"]["scene"].read_text("utf-8").replace(*edit), "utf-8")
    scene = dataclasses.replace(PLANE, models={"mujoco": {"scene": path}})
    sizes(compiling=0.0)
    for own, shares in ((PLANE, True), (scene, False)):
        model = load(own, 1e-4, read_options({}))
        assert (batch_kind(model) != "alone") is shares, name
    stock = Setting("mujoco", "stock", 1e-4)
    found, plain = (MUJOCO.run(own, stock, at_random(4)) for own in (scene, PLANE))
    assert [i.restitution for i in found] == pytest.approx([i.restitution for i in plain], abs=1e-6)


def test_what_follows_a_launch_is_bit_for_bit_a_loop_over_mj_step() -> None:
    setting = made("mujoco.spring-damper", PLANE, 2e-6)
    path = MUJOCO.trajectory(PLANE, setting, Launch(0.3, 0.3), 2000 * 2e-6)
    loaded = load(PLANE, 2e-6, read_options(setting.options))
    data = mujoco.MjData(loaded.model)
    data.qpos[2] += Launch(0.3, 0.3).clearance(2e-6)
    data.qvel[2] = -0.3
    rates = []
    for _ in range(2000):
        rates.append(-data.qvel[2])
        mujoco.mj_step(loaded.model, data)
    assert np.array_equal(path.rate, rates)


# --- PyBullet ---


BULLET = [
    ("stock", 1e-3),
    ("stock", 1e-5),
    ("spring-damper", 1e-5),
    ("restitution", 1e-3),
    ("restitution", 1 / 240),
]


@pytest.mark.needs_engine("pybullet")
@pytest.mark.parametrize(("scene", "maximal", "case"), every_pair(SCENES, [False, True], BULLET))
def test_pybullet_alone_and_together_is_the_same(
    scene: Scene, maximal: bool, case: tuple[str, float]
) -> None:
    recipe, timestep = case
    setting = made(f"pybullet.{recipe}", scene, timestep, maximal_coordinates=maximal)
    launches = at_random(6)
    alone = [PYBULLET.run(scene, setting, [launch])[0] for launch in launches]
    assert same(alone, PYBULLET.run(scene, setting, launches))
    assert same(alone[::-1], PYBULLET.run(scene, setting, launches[::-1]))


@pytest.mark.needs_engine("pybullet")
@EACH_SCENE
def test_positions_worked_out_are_the_ones_that_bullet_has(scene: Scene) -> None:
    for recipe, timestep in (("spring-damper", 1e-5), ("restitution", 1e-3)):
        setting, launch = made(f"pybullet.{recipe}", scene, timestep), Launch(0.3, 0.4)
        (impact,) = PYBULLET.run(scene, setting, [launch])
        asked = PYBULLET.trajectory(scene, setting, launch, 90 * timestep)
        loop, start = impact.loop, int(np.flatnonzero(asked.force)[0])
        assert loop is not None
        seen = slice(start, start + impact.samples)
        assert np.array_equal(loop.penetration, asked.penetration[seen])
        assert np.array_equal(loop.rate, asked.rate[seen])


def _recorded_and_asked(scene: Scene, setting: Setting, launches: Sequence[Launch]) -> Any:
    """Impacts that the plug-in recorded, and that Python's functions were
    asked for, together and alone.
    """
    with PybulletWorld(scene, setting.timestep, pybullet_options(setting.options), 1.0) as balls:
        recorded = [simulate.impacts_in(balls, some) for some in (launches, launches[:1])]
        assert balls.recorder is not None
        balls.recorder = None  # as without a compiler
        return recorded, [simulate.impacts_in(balls, some) for some in (launches, launches[:1])]


@pytest.mark.needs_engine("pybullet")
@EACH_SCENE
@pytest.mark.parametrize(("recipe", "timestep"), [*BULLET, ("restitution-law", 1e-3)])
def test_bullet_recorded_is_bullet_asked(scene: Scene, recipe: str, timestep: float) -> None:
    setting = made(f"pybullet.{recipe}", scene, timestep)
    ball = {**setting.options.get("ball", {}), "linearDamping": 0.0}  # or forces are asked for
    setting = dataclasses.replace(setting, options={**setting.options, "ball": ball})
    recorded, asked = call(_recorded_and_asked, scene, setting, at_random(9), limit=60)
    for ours, theirs in zip(recorded, asked, strict=True):
        assert same(ours, theirs)


def _reported_and_worked_out(
    scene: Scene, setting: Setting, launches: Sequence[Launch]
) -> tuple[Any, Any]:
    """Forces of each ball at each step, (n, b): by Bullet's contact
    points, and from the balls' momentum.
    """
    options = pybullet_options(setting.options)
    with PybulletWorld(scene, setting.timestep, options, 1.0) as balls:
        assert not balls.reports_force
        balls.release(launches)
        bullet, reported, rates = balls.bullet, [], []
        # What is apart was not solved for; it still says the force of when it last was.
        for _ in range(120):
            rates.append([bullet.getBaseVelocity(ball)[0][2] for ball in balls.balls])
            balls.step()
            points = [bullet.getContactPoints(ball) for ball in balls.balls]
            reported.append([sum(point[9] for point in own if point[8] <= 0.0) for own in points])
        gained = np.diff(np.array(rates), axis=0) + scene.gravity * setting.timestep
        return np.array(reported)[:-1], scene.mass * gained / setting.timestep


@pytest.mark.needs_engine("pybullet")
@EACH_SCENE
@pytest.mark.parametrize(("recipe", "timestep"), [("spring-damper", 1e-5), ("restitution", 1e-3)])
def test_momentum_tells_the_force_that_bullet_tells(
    scene: Scene, recipe: str, timestep: float
) -> None:
    setting = made(f"pybullet.{recipe}", scene, timestep)
    reported, worked_out = call(_reported_and_worked_out, scene, setting, at_random(4), limit=60)
    assert (reported.max(axis=0) > 0).all()
    assert np.abs(worked_out - reported).max() < 1e-12 * reported.max()


def _die_in_fast_company(
    launches: Sequence[Launch], name: str, scene: Scene, setting: Setting, places: int = 8
) -> Iterator[Impact]:
    """Simulate like `simulate_all`: launches that share a world come back together, or not at all."""
    for i in range(0, len(launches), places):
        group = launches[i : i + places]
        if any(launch.speed > 0.55 for launch in group):
            os.kill(os.getpid(), signal.SIGSEGV)
        yield from (Impact(launch, Status.NO_TOUCH) for launch in group)


@pytest.mark.needs_engine("pybullet")
def test_a_launch_that_kills_a_shared_world_is_the_only_one_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(simulate, "simulate_all", _die_in_fast_company)
    launches = [*at_random(20), Launch(0.56), Launch(0.57)]
    for impact in PYBULLET.run(PLANE, Setting("pybullet", "test", 1e-3), launches):
        lost = impact.launch.speed > 0.55
        assert impact.status is (Status.CRASHED if lost else Status.NO_TOUCH)


@pytest.mark.needs_engine("pybullet")
def test_a_ball_that_goes_through_the_plate_says_so() -> None:
    # A spring far softer than the step can follow: Bullet lets it through the bowl.
    setting = made("pybullet.spring-damper", CUP, 1 / 240, maximal_coordinates=True)
    found = PYBULLET.run(CUP, setting, [Launch(0.05, 0.5), Launch(0.59, 0.4), Launch(0.6, 0.8)])
    assert Status.DIVERGED in {impact.status for impact in found}
    for impact in found:
        if impact.status is Status.DIVERGED:
            assert "through the plate" in impact.reason
        else:
            assert impact.penetration_max < CUP.ball_radius
