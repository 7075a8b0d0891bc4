"""Attaching a law to a MuJoCo model and taking it off again: what else there is stays as it was."""

import copy
import ctypes
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pytest

from hcbench import _compile
from hcbench.engines.mujoco.plugin import attach as contact
from hcbench.engines.mujoco.plugin import native
from hcbench.engines.mujoco.plugin.attach import Friction, HuntCrossley, Restitution
from hcbench.errors import CannotRun, EngineFailed, SettingError
from hcbench.laws import closed_form
from hcbench.scene import Material

LAW = HuntCrossley(3.4064e10, 0.008 / 0.0254)
BACKENDS = pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "python"])
try:
    from mujoco import batch
except ImportError:
    batch = None
HAS_BATCH = pytest.mark.skipif(batch is None, reason="this MuJoCo has no mujoco.batch")

# A walker of hinges on its feet, balls beside it, a tendon with a limit, a <pair> with a margin.
SCENE = """<mujoco><option timestep="2e-6"/><default><geom condim="3"/></default><worldbody>
  <geom name="floor" type="plane" size="5 5 .1"/>
  <body name="torso" pos="0 0 .2795"><freejoint/>
    <geom name="torso" type="capsule" fromto="-.1 0 0 .1 0 0" size=".05"/>
    <body name="leg1" pos="-.1 0 0"><joint type="hinge" axis="0 1 0"/>
      <geom name="leg1" type="capsule" fromto="0 0 -.05 0 0 -.25" size=".03"/></body>
    <body name="leg2" pos=".1 0 0"><joint name="hip" type="hinge" axis="0 1 0"/>
      <geom name="leg2" type="capsule" fromto="0 0 -.05 0 0 -.25" size=".03"/></body></body>
  <body name="ball" pos="1 0 .0509"><freejoint/><geom name="ball" size=".0508" mass=".45359237"/></body>
  <body name="other" pos="1 1 .0507"><freejoint/><geom name="other" size=".0508" mass=".45359237"/></body>
  <geom name="anvil" type="box" size=".1 .1 .1" pos="3 0 .1"/>
  <body name="far" pos="3 0 .31"><freejoint/><geom name="far" size=".0508" mass=".45359237"/></body>
  </worldbody>
  <contact><pair geom1="far" geom2="anvil" margin=".001" gap=".0005"/></contact>
  <actuator><motor joint="hip"/></actuator>
  <tendon><fixed name="limb" limited="true" range="-1 1"><joint joint="hip" coef="1"/></fixed></tendon>
  </mujoco>"""
BALL = """<mujoco><option timestep="{h}" gravity="0 0 0"/><worldbody>
  <geom name="plate" type="plane" size="1 1 1" condim="1"/><body name="ball" pos="0 0 .0508"><freejoint/>
  <geom name="ball" size=".0508" mass=".45359237" condim="1"/></body>{more}</worldbody>{rest}</mujoco>"""


def scene() -> Any:
    return mujoco.MjModel.from_xml_string(SCENE)


def ball(h: float = 1e-5, more: str = "", rest: str = "") -> Any:
    return mujoco.MjModel.from_xml_string(BALL.format(h=h, more=more, rest=rest))


def image(model: Any) -> bytes:
    """Every byte of a model."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


@pytest.fixture(autouse=True)
def _nothing_left_behind() -> Iterator[None]:
    yield
    left = mujoco.get_mjcb_passive(), mujoco.get_mjcb_contactfilter()
    mujoco.set_mjcb_passive(None)
    mujoco.set_mjcb_contactfilter(None)
    assert left == (None, None)


def launched(model: Any, speed: float = 0.3) -> Any:
    data = mujoco.MjData(model)
    data.qpos[2] += 2.3 * model.opt.timestep * speed
    data.qvel[2] = -speed
    return data


@BACKENDS
@pytest.mark.parametrize("law", [LAW, Restitution(0.3)], ids=["force", "restitution"])
def test_detaching_gives_every_bit_back(law: Any, compiled: bool) -> None:
    model = scene()
    before = image(model)
    first = contact.attach(model, [("ball", "floor"), ("far", "anvil")], law, compiled=compiled)
    second = contact.attach(model, law=Restitution(0.1), pairs=[("other", "floor")], compiled=compiled)
    third = contact.attach(model, law=law, tendons=["limb"], compiled=compiled)
    assert image(model) != before
    for law_ in (second, first, third):
        law_.detach()
        law_.detach()
    assert image(model) == before


@BACKENDS
def test_what_is_not_attached_moves_bit_for_bit_as_before(compiled: bool) -> None:
    plain, model = scene(), scene()
    # The attached ball is on its way down; the walker falls, the other ball lies, `far` hangs over the anvil.
    runs = []
    for one in (plain, model):
        data = mujoco.MjData(one)
        data.ctrl[0] = 0.2
        runs.append(data)
    with contact.attach(model, [("ball", "floor")], LAW, compiled=compiled):
        for _ in range(60):
            mujoco.mj_step(plain, runs[0])
            mujoco.mj_step(model, runs[1])
    assert runs[0].ncon >= 3
    assert np.array_equal(runs[0].qpos, runs[1].qpos)
    assert np.array_equal(runs[0].qvel, runs[1].qvel)


@BACKENDS
def test_the_native_contact_of_an_attached_pair_is_gone_and_back_after(compiled: bool) -> None:
    model = scene()
    data = mujoco.MjData(model)
    data.qpos[model.joint("hip").qposadr[0]] = 0.1
    far = int(model.body("far").dofadr[0])
    data.qpos[-5] = 0.2 + 0.0508 - 1e-5  # `far` overlaps the anvil by 1e-5 m

    def touching() -> bool:
        mujoco.mj_forward(model, data)
        pair = {model.geom("far").id, model.geom("anvil").id}
        return any({int(c.geom1), int(c.geom2)} == pair for c in data.contact)

    assert touching()
    with contact.attach(model, [("far", "anvil")], LAW, compiled=compiled) as law:
        assert not touching()
        (touch,) = law.touches(data)
        assert touch.penetration == pytest.approx(1e-5, rel=1e-6)
        assert touch.force == pytest.approx(3.4064e10 * 1e-5**1.5, rel=0.02)
        assert data.qfrc_passive[far + 2] == pytest.approx(touch.force)
        assert touch.effective_mass == pytest.approx(0.45359237)
    assert touching()


def test_rollout_takes_the_law_and_models_of_its_own() -> None:
    model = ball()
    data = launched(model)
    state = np.zeros((1, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    mujoco.mj_getState(model, data, state[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    alphas, steps = np.array([0.0, 0.1, 0.3, 0.6]), 40
    with contact.attach(model, ("ball", "plate"), LAW) as law:
        models = law.models(alpha=alphas)
        states, _ = mujoco.rollout.rollout(
            models, [mujoco.MjData(model) for _ in range(2)], np.repeat(state, 4, axis=0), nstep=steps
        )
        for _ in range(steps):
            mujoco.mj_step(models[2], data)
    assert states[:, -1, -4] / 0.3 == pytest.approx(closed_form.restitution(alphas, 0.3), abs=1e-6)
    assert np.array_equal(states[2, -1, 1:8], data.qpos)


@HAS_BATCH
def test_batch_takes_the_law_with_parameters_of_each_simulation() -> None:
    model = ball()
    alphas, stiffness = np.array([0.0, 0.1, 0.3, 0.6]), np.array([1e10, 2e10, 3e10, 4e10])
    early = batch.Batch(model, 4, 2)
    with contact.attach(model, ("ball", "plate"), LAW) as law:
        with pytest.raises(SettingError, match="before the law"):
            law.vary(early, alpha=alphas)
        many = batch.Batch(model, 4, 2)
        law.vary(many, alpha=alphas, stiffness=stiffness)
        many.qpos[:, 2] = 0.0508 + 2.3e-5 * 0.3
        many.qvel[:, 2] = -0.3
        deepest = np.zeros(4)
        for _ in range(60):
            many.step()
            deepest = np.maximum(deepest, 0.0508 - many.qpos[:, 2])
        out = many.qvel[:, 2].copy()
    assert out / 0.3 == pytest.approx(closed_form.restitution(alphas, 0.3), abs=1e-6)
    truth = [
        float(closed_form.penetration_max(HuntCrossley(k, a), 0.45359237, 0.3))
        for k, a in zip(stiffness, alphas, strict=True)
    ]
    assert deepest == pytest.approx(truth, rel=5e-3)


@HAS_BATCH
def test_batch_refuses_python_callbacks_and_takes_restitution() -> None:
    model = ball(1e-3)
    alphas = np.array([0.1, 0.5])
    with contact.attach(model, ("ball", "plate"), Restitution(0.3), compiled=False):
        many = batch.Batch(model, 2, 1)
        with pytest.raises(ValueError, match="Python"):
            many.step()
    with contact.attach(model, ("ball", "plate"), Restitution(0.3)) as law:
        many = batch.Batch(model, 2, 1)
        law.vary(many, alpha=alphas)
        many.qvel[:, 2] = -0.3
        many.step(nstep=4)
        assert many.qvel[:, 2] / 0.3 == pytest.approx(closed_form.restitution(alphas, 0.3), abs=1e-12)


@BACKENDS
def test_callbacks_of_the_users_are_called_too(compiled: bool) -> None:
    model, calls = ball(more='<body pos="1 0 1"><freejoint/><geom name="b" size=".1"/></body>'), []

    def passive(_: Any, data: Any) -> None:
        calls.append("passive")
        data.qfrc_passive[6] += 2.0

    def refuse(_: Any, __: Any, geom1: int, geom2: int) -> int:
        calls.append("filter")
        return 1

    mujoco.set_mjcb_passive(passive)
    mujoco.set_mjcb_contactfilter(refuse)
    try:
        with contact.attach(model, ("ball", "plate"), LAW, compiled=compiled):
            data = launched(model)
            for _ in range(50):
                mujoco.mj_step(model, data)
        assert data.qvel[2] / 0.3 == pytest.approx(float(closed_form.restitution(LAW.alpha, 0.3)), abs=1e-6)
        assert data.qvel[6] == pytest.approx(2.0 / model.body_mass[2] * 50e-5)
        assert {"passive", "filter"} == set(calls)
        assert mujoco.get_mjcb_passive() is passive
        assert mujoco.get_mjcb_contactfilter() is refuse
    finally:
        mujoco.set_mjcb_passive(None)
        mujoco.set_mjcb_contactfilter(None)


def test_compiled_callbacks_of_the_users_stay_compiled() -> None:
    counter = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
    calls = []
    passive = counter(lambda _, __: calls.append(1))
    model = ball()
    mujoco.set_mjcb_passive(passive)
    try:
        with contact.attach(model, ("ball", "plate"), LAW):
            data = launched(model)
            mujoco.mj_step(model, data)
            assert calls == [1]
            assert isinstance(mujoco.get_mjcb_passive(), ctypes._CFuncPtr)  # type: ignore[attr-defined]
    finally:
        mujoco.set_mjcb_passive(None)


def test_models_of_others_in_the_process_are_left_alone() -> None:
    mine, other = ball(), ball()
    reference = launched(other)
    for _ in range(30):
        mujoco.mj_step(other, reference)
    with contact.attach(mine, ("ball", "plate"), LAW):
        data = launched(other)
        for _ in range(30):
            mujoco.mj_step(other, data)
    assert np.array_equal(data.qpos, reference.qpos)


def test_pairs_are_found_by_body() -> None:
    model = scene()
    leg = model.geom("leg1").id
    assert contact.pairs_between(model, "leg1", 0) == [
        (leg, model.geom("floor").id),
        (leg, model.geom("anvil").id),
    ]
    assert (model.geom("ball").id, model.geom("other").id) in contact.pairs_of(model, "ball")
    assert contact.pairs_between(model, "torso", "leg1") == []  # parent and child do not collide
    with contact.attach(model, contact.pairs_of(model, "ball"), LAW) as law:
        assert len(law.keys) == model.ngeom - 1


def test_stiffness_by_hertz_is_that_of_the_paper() -> None:
    steel = Material(young_modulus=206.8e9, poisson_ratio=0.3)
    model = ball()
    k = contact.hertz_stiffness(model, "ball", "plate", steel, steel)
    assert k == pytest.approx(3.4064e10, rel=5e-3)
    with pytest.raises(SettingError, match="neither a sphere"):
        contact.hertz_stiffness(scene(), "torso", "floor", steel, steel)


BAD: dict[str, tuple[Callable[[Any], Any], str]] = {
    "an unknown geom": (lambda m: contact.attach(m, ("bal", "plate"), LAW), "geom 'bal'.*'?ball"),
    "an unknown id": (lambda m: contact.attach(m, [(17, "plate")], LAW), "geom 17"),
    "an unknown body": (lambda m: contact.pairs_of(m, "bowl"), "body 'bowl'"),
    "an unknown tendon": (lambda m: contact.attach(m, law=LAW, tendons=["cup"]), "tendon 'cup'"),
    "no pairs": (lambda m: contact.attach(m, [], LAW), "at least one pair"),
    "one geom": (lambda m: contact.attach(m, [("ball",)], LAW), "two geoms"),
    "a geom with itself": (lambda m: contact.attach(m, ("ball", "ball"), LAW), "same body"),
    "no law": (lambda m: contact.attach(m, ("ball", "plate"), None), "HuntCrossley"),
    "a pair twice": (lambda m: contact.attach(m, [("ball", "plate"), ("plate", "ball")], LAW), "given twice"),
    "friction of restitution": (
        lambda m: contact.attach(m, ("ball", "plate"), Restitution(0.1), friction=Friction(0.1, 0.1)),
        "friction",
    ),
    "more dynamic than static": (lambda m: Friction(0.1, 0.2), "static"),
    "α below 0": (lambda m: Restitution(-0.1), "alpha"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_attached_is_refused_and_changes_nothing(case: str) -> None:
    model = ball()
    before = image(model)
    call, words = BAD[case]
    with pytest.raises(SettingError, match=words):
        call(model)
    assert image(model) == before


def test_a_pair_that_has_a_law_is_refused_and_the_first_stays() -> None:
    model = ball()
    before = image(model)
    with contact.attach(model, ("ball", "plate"), LAW):
        with pytest.raises(SettingError, match="has a law already"):
            contact.attach(model, ("plate", "ball"), Restitution(0.3))
        with pytest.raises(SettingError, match="copy"):
            contact.attach(copy.copy(model), ("plate", "ball"), LAW)
        data = launched(model)
        for _ in range(50):
            mujoco.mj_step(model, data)
        assert data.qvel[2] / 0.3 == pytest.approx(float(closed_form.restitution(LAW.alpha, 0.3)), abs=1e-6)
    assert image(model) == before


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ('<flag override="enable"/>', "override"),
        ('<flag spring="disable" damper="disable"/>', "passive"),
        ('<flag passive="disable"/>', "passive"),
        ('<flag sleep="enable"/>', "sleep"),
    ],
)
def test_models_whose_options_leave_no_room_for_the_law_are_refused(option: str, words: str) -> None:
    try:
        model = ball(rest=f"<option>{option}</option>")
    except ValueError:
        pytest.skip("this MuJoCo has no such flag")
    with pytest.raises(SettingError, match=words):
        contact.attach(model, ("ball", "plate"), LAW)


@pytest.mark.parametrize("name", ["discrete", "PGS"])
def test_restitution_is_refused_where_it_would_be_wrong(name: str) -> None:
    option = f'<option integrator="{name}"/>' if name == "discrete" else f'<option solver="{name}"/>'
    try:
        model = ball(1e-3, rest=option)
    except ValueError:
        pytest.skip("this MuJoCo has no such integrator")
    with pytest.raises(SettingError, match=name):
        contact.attach(model, ("ball", "plate"), Restitution(0.3))


def test_a_step_too_coarse_names_one_that_is_not_and_the_other_kind() -> None:
    model = ball(1e-3)
    with pytest.raises(SettingError, match=r"touch for 0\.00017 s.*a step of 8e-06 s.*Restitution"):
        contact.attach(model, ("ball", "plate"), LAW)
    # Slow enough for the step when attached, too fast when it runs.
    model = ball(4e-5)
    with (
        pytest.raises(EngineFailed, match="too fast for the step"),
        contact.attach(model, ("ball", "plate"), LAW),
    ):
        data = launched(model, 60.0)
        for _ in range(20):
            mujoco.mj_step(model, data)
    assert image(model) == image(ball(4e-5))


@BACKENDS
@pytest.mark.parametrize(
    "law", [HuntCrossley(3.4064e10, 0.3), Restitution(0.3)], ids=["force", "restitution"]
)
def test_a_state_that_is_not_finite_is_told_and_the_model_restored(law: Any, compiled: bool) -> None:
    model = ball()
    before = image(model)
    data = launched(model)
    with (
        pytest.raises(EngineFailed, match="not finite"),
        contact.attach(model, ("ball", "plate"), law, compiled=compiled),
    ):
        data.qvel[2] = np.nan
        mujoco.mj_step(model, data)  # MuJoCo warns, resets and goes on
    assert image(model) == before


def test_a_callback_that_replaces_the_laws_is_told() -> None:
    model = ball()
    with pytest.raises(EngineFailed, match="mjcb_passive"), contact.attach(model, ("ball", "plate"), LAW):
        mujoco.set_mjcb_passive(lambda m, d: None)
    mujoco.set_mjcb_passive(None)


def test_shapes_that_mujoco_sees_too_coarsely_are_warned_of_with_the_size() -> None:
    turns = np.linspace(0, 2 * np.pi, 13)[:-1]
    points = [
        (np.cos(a) * np.sin(p), np.sin(a) * np.sin(p), np.cos(p)) for p in (0.5, 1.5, 2.5) for a in turns
    ]
    vertices = " ".join(f"{0.05 * x} {0.05 * y} {0.05 * z}" for x, y, z in points)
    model = ball(
        more='<body pos="0 0 .5"><freejoint/><geom name="rock" type="mesh" mesh="rock"/></body>',
        rest=f'<asset><mesh name="rock" vertex="{vertices}"/></asset>',
    )
    with (
        pytest.warns(contact.ContactAccuracyWarning, match=r"'rock' is a mesh.*off by about 0\.00\d m"),
        contact.attach(model, ("rock", "plate"), LAW, speed=0.01),
    ):
        pass


def test_without_a_compiler_python_takes_over_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HCBENCH_COMPILED", "0")
    monkeypatch.setattr(native, "callbacks", native.callbacks.__wrapped__)
    model = ball()
    with (
        pytest.warns(contact.PythonContactWarning, match="HCBENCH_COMPILED=0"),
        contact.attach(model, ("ball", "plate"), LAW) as law,
    ):
        assert not law.compiled
    with pytest.raises(CannotRun, match="HCBENCH_COMPILED=0"):
        contact.attach(model, ("ball", "plate"), LAW, compiled=True)


def test_a_compiler_that_fails_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setenv("HCBENCH_CACHE", str(tmp_path))
    monkeypatch.setenv("CC", "false")
    with pytest.raises(_compile.NotCompiled, match="false failed"):
        _compile.library("_law.c")
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(_compile.NotCompiled, match="no-such-compiler"):
        _compile.library("_law.c")
    assert not list(tmp_path.rglob("*.so"))


def test_headers_that_do_not_fit_the_library_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    made = native.callbacks()
    layout = native._expected
    monkeypatch.setattr(native, "_expected", lambda m, d: [*layout(m, d)[:-1], 0.5])
    with pytest.raises(_compile.NotCompiled, match="do not describe"):
        native._check_layout(made)
