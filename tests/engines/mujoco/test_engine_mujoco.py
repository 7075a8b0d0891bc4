"""MuJoCo through the contract: what it does is what plain MuJoCo does, and is read off it right."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
import xml.etree.ElementTree as ET
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from covering import every_pair

from hcbench.engines.mujoco.engine import MujocoEngine
from hcbench.engines.mujoco.scene import scene_model
from hcbench.engines.mujoco.scene.mjcf import model_xml, set_mass
from hcbench.sim.backend import installed_version
from hcbench.system.errors import EngineFailed, EngineMissing, SceneError, SettingError
from hcbench.terms.impact import Impact, Launch, Status
from hcbench.terms.scene import Scene, load_scene
from hcbench.terms.setting import Setting

ENGINE = MujocoEngine()
PLANE, CUP = load_scene("steel-plane"), load_scene("steel-cup")
FORMS = pytest.mark.parametrize("scene", [PLANE, CUP], ids=lambda s: str(s.form))
ONE_FORCE_A_STEP = ("Euler", "implicit", "implicitfast")
HAS_DISCRETE = pytest.mark.skipif(
    not hasattr(mujoco.mjtIntegrator, "mjINT_DISCRETE"),
    reason="this MuJoCo has no integrator 'discrete'",
)
DISCRETE = pytest.param("discrete", marks=HAS_DISCRETE)
INTEGRATORS = pytest.mark.parametrize(
    "integrator", ["Euler", "implicit", "implicitfast", "RK4", DISCRETE]
)
SPEEDS = 0.0254 * np.array([1.0, 8.0, 20.0])
PHASES = (np.arange(8) + 0.5) / 8
G = 9.80665

# A spring and damper: S and D of x'' + D x' + S x = 0, 1/s² and 1/s.
S, D = 2.679e8, 815.0
STIFF = [0.9999, 0.9999, 0.001, 0.5, 2.0]


def row(stiffness: float, damping: float, **more: Any) -> dict[str, Any]:
    return {"solref": [-stiffness, -damping], "solimp": STIFF, **more}


def setting(timestep: float, *rows: dict[str, Any], integrator: str = "Euler") -> Setting:
    return Setting("mujoco", "test", timestep, {"integrator": integrator, "rows": list(rows)})


def spring_damper(timestep: float = 1e-6, integrator: str = "Euler") -> Setting:
    return setting(timestep, row(S, D), integrator=integrator)


def impulse(e: float, timestep: float, integrator: str = "Euler") -> Setting:
    return setting(timestep, row(0.0, (1 + e) / timestep), integrator=integrator)


def launches(speeds: Any = SPEEDS, phases: Any = PHASES) -> list[Launch]:
    return [
        Launch(float(v), float(p)) for v in np.atleast_1d(speeds) for p in np.atleast_1d(phases)
    ]


def same_bits(one: Impact, two: Impact) -> bool:
    a, b = dataclasses.asdict(one), dataclasses.asdict(two)
    loops = zip(a.pop("loop").values(), b.pop("loop").values(), strict=True)
    return repr(a) == repr(b) and all(np.array_equal(x, y) for x, y in loops)


def work_lost(impact: Impact) -> float:
    """∮ F dx over the loop, closed at the surface, by the trapezoid rule."""
    assert impact.loop is not None
    x = np.concatenate([[0.0], impact.loop.penetration, [0.0]])
    f = np.concatenate([[0.0], impact.loop.force, [0.0]])
    return float(np.sum((f[1:] + f[:-1]) / 2 * np.diff(x)))


def kinetic_energy_lost(impact: Impact, scene: Scene) -> float:
    return 0.5 * scene.mass * (impact.speed_in**2 - impact.speed_out**2)


# --- what is read off is what MuJoCo itself did ---


def plain_loop(text: str, gap: float, speed: float, steps: int) -> dict[str, np.ndarray]:
    """mj_step, as a user would write it, on the saved model; the engine's
    own depth and force each step.
    """
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[2] += gap
    data.qvel[2] = -speed
    seen = []
    for _ in range(steps):
        rate = -data.qvel[2]
        mujoco.mj_step(model, data)
        depth = -data.efc_pos[0] if data.nefc else np.nan
        seen.append((depth, rate, data.efc_force[: data.nefc].sum()))
    return dict(zip(("penetration", "rate", "force"), np.array(seen).T, strict=True))


@pytest.mark.parametrize(
    ("scene", "integrator", "gravity"), every_pair([PLANE, CUP], ONE_FORCE_A_STEP, [0.0, G])
)
def test_a_trajectory_is_what_a_plain_mujoco_loop_sees(
    scene: Scene, integrator: str, gravity: float
) -> None:
    scene = dataclasses.replace(scene, gravity=gravity)
    own, launch = spring_damper(integrator=integrator), Launch(0.3, 0.3)
    path = ENGINE.trajectory(scene, own, launch, 300e-6)
    plain = plain_loop(model_xml(scene, own), launch.clearance(1e-6), launch.speed, 300)
    touching = plain["force"] > 0
    assert 150 < touching.sum() < 250
    assert np.abs(path.rate - plain["rate"]).max() < 1e-13
    assert np.abs(path.penetration - plain["penetration"])[touching].max() < 1e-15
    assert path.force[touching] == pytest.approx(plain["force"][touching], rel=1e-9)
    assert not path.force[~touching].any(), "free flight is exactly force-free, gravity or not"


@FORMS
def test_the_force_under_rk4_is_that_of_the_state_it_is_paired_with(scene: Scene) -> None:
    (impact,) = ENGINE.run(scene, spring_damper(integrator="RK4"), [Launch(0.3, 0.3)])
    loop = impact.loop
    assert loop is not None
    own = scene.mass * (S * loop.penetration + D * loop.rate)
    inside = loop.penetration > 0
    assert inside.sum() > 180
    assert loop.force[inside] == pytest.approx(own[inside], rel=1e-3, abs=1e-4 * own.max())


@FORMS
@INTEGRATORS
def test_the_area_of_the_loop_is_the_energy_lost(scene: Scene, integrator: str) -> None:
    for impact in ENGINE.run(scene, spring_damper(integrator=integrator), launches(phases=0.5)):
        assert work_lost(impact) == pytest.approx(kinetic_energy_lost(impact, scene), rel=0.01)


@INTEGRATORS
def test_the_cup_bounces_as_its_equivalent_sphere_does(integrator: str) -> None:
    own = spring_damper(integrator=integrator)
    for plane, cup in zip(*(ENGINE.run(s, own, launches()) for s in (PLANE, CUP)), strict=True):
        assert cup.restitution == pytest.approx(plane.restitution, abs=1e-9)
        assert cup.penetration_max == pytest.approx(plane.penetration_max, rel=1e-9)
        assert cup.force_max == pytest.approx(plane.force_max, rel=1e-9)


# --- the settings that the field uses ---


@pytest.mark.parametrize(
    ("scene", "integrator", "timestep", "e"),
    every_pair([PLANE, CUP], ONE_FORCE_A_STEP, [5e-4, 1e-3, 2e-3], [0.2, 0.926, 1.0]),
)
def test_an_impulse_gives_the_restitution_asked_at_every_phase(
    scene: Scene, integrator: str, timestep: float, e: float
) -> None:
    impacts = ENGINE.run(scene, impulse(e, timestep, integrator), launches())
    # The implicit integrators start from the contact's force instead of the acceleration that it
    # leads to. MuJoCo knows that to the round-off of 1 over 1 - d: 1e-16 / 1e-4.
    assert [i.restitution for i in impacts] == pytest.approx(
        24 * [e], abs=1e-12 if integrator == "Euler" else 1e-11
    )
    assert {i.samples for i in impacts} == {1}


@pytest.mark.parametrize("integrator", ["RK4", DISCRETE])
def test_an_impulse_does_not_bounce_where_a_step_has_more_than_one_force(integrator: str) -> None:
    impacts = ENGINE.run(PLANE, impulse(0.9, 1e-3, integrator), launches())
    assert max(i.restitution for i in impacts) < 0.05


@FORMS
@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "RK4"])
def test_a_spring_and_damper_have_the_restitution_of_their_closed_form(
    scene: Scene, integrator: str
) -> None:
    beta = D / 2
    omega = math.sqrt(S - beta**2)
    # Contact only pushes, so it ends where S x + D x' = 0: at ω t = π - 2 ψ with tan ψ = β/ω.
    e = math.exp(-beta / omega * (math.pi - 2 * math.atan(beta / omega)))
    for speed in SPEEDS:
        found = ENGINE.run(scene, spring_damper(integrator=integrator), launches(speed))
        restitution = np.array([i.restitution for i in found])
        assert restitution.mean() == pytest.approx(e, abs=2e-4)
        # The damper's force jumps at touch, so e moves with the phase: by about D h over a step.
        assert np.ptp(restitution) < D * 1e-6
    assert found[0].duration == pytest.approx(
        (math.pi - 2 * math.atan(beta / omega)) / omega, rel=0.02
    )


@HAS_DISCRETE
def test_discrete_takes_restitution_away() -> None:
    euler, discrete = (
        ENGINE.run(PLANE, spring_damper(integrator=i), launches(0.2, 0.5))[0].restitution
        for i in ("Euler", "discrete")
    )
    assert euler - discrete == pytest.approx(0.0226, abs=1e-3)


@FORMS
def test_stock_mujoco_hardly_bounces_and_under_gravity_not_at_all(scene: Scene) -> None:
    stock = Setting("mujoco", "stock", 1e-4)
    for impact in ENGINE.run(scene, stock, launches(phases=0.5)):
        assert impact.status is Status.PARTED
        assert impact.restitution == pytest.approx(0.135, abs=0.002)
    with_gravity = dataclasses.replace(scene, gravity=G)
    for impact in ENGINE.run(with_gravity, stock, launches(phases=0.5)):
        assert impact.status is Status.RESTED
        assert impact.restitution == 0.0


def test_a_contact_too_damped_to_let_go_has_rested() -> None:
    (impact,) = ENGINE.run(PLANE, impulse(0.0, 1e-3), [Launch(0.2)])
    assert impact.status is Status.RESTED
    assert impact.penetration_max > 0


# --- several rows ---


@FORMS
def test_a_row_starts_at_its_own_depth(scene: Scene) -> None:
    onset = 4e-6
    loose = [
        1e-4,
        1e-4,
        0.001,
        0.5,
        2.0,
    ]  # rows of small impedance add up; stiff ones share the load
    rows = [row(S, 0.0, onset=depth) | {"solimp": loose} for depth in (0.0, onset)]
    (impact,) = ENGINE.run(scene, setting(1e-6, *rows), [Launch(0.3, 0.2)])
    loop = impact.loop
    assert loop is not None
    x = loop.penetration
    assert x.max() > 3 * onset
    stretched = np.maximum(x, 0.0) + np.maximum(x - onset, 0.0)
    assert loop.force == pytest.approx(
        scene.mass * S * stretched, rel=1e-3, abs=1e-3 * impact.force_max
    )


@FORMS
def test_one_row_is_the_same_with_the_rest_of_the_contact_far_away(scene: Scene) -> None:
    far = row(S, D, onset=1.0)
    alone, both = (
        ENGINE.run(scene, setting(1e-6, *rows), launches())
        for rows in ([row(S, D)], [row(S, D), far])
    )
    for a, b in zip(
        alone, both, strict=True
    ):  # two rows take MuJoCo's Newton, for one row one division is enough
        assert (a.status, a.samples) == (b.status, b.samples)
        assert a.restitution == pytest.approx(b.restitution, abs=1e-14)
        assert a.force_max == pytest.approx(b.force_max, rel=1e-11)


@pytest.mark.adhesion
def test_adhesion_makes_a_damper_pull() -> None:
    pulls, pushes = (
        ENGINE.run(PLANE, setting(1e-6, row(S, 20 * D, adhesion=a)), [Launch(0.3)])[0]
        for a in (1e5, 0.0)
    )
    assert pulls.loop is not None
    assert pushes.loop is not None
    assert pulls.loop.force.min() < -100.0
    assert pushes.loop.force.min() > 0.0


def test_adhesion_in_a_cup_is_refused_with_the_way_out() -> None:
    with pytest.raises(SettingError, match=r"adhesion.*form 'cup'.*form 'plane'"):
        ENGINE.run(CUP, setting(1e-6, row(S, D, adhesion=1.0)), [Launch(0.3)])


@FORMS
@pytest.mark.parametrize("mass", [1e-3, 1e3])
def test_any_mass_bounces_the_same_on_settings_per_unit_mass(scene: Scene, mass: float) -> None:
    own = ENGINE.run(scene, spring_damper(), launches(phases=0.5))
    other = ENGINE.run(dataclasses.replace(scene, mass=mass), spring_damper(), launches(phases=0.5))
    for a, b in zip(own, other, strict=True):
        assert b.restitution == pytest.approx(a.restitution, abs=1e-9)
        assert b.force_max / mass == pytest.approx(a.force_max / scene.mass, rel=1e-9)


# --- gravity and flight ---


@FORMS
@pytest.mark.parametrize("timestep", [1e-4, 1e-3])
def test_a_drop_meets_the_plate_with_the_speed_of_free_fall(scene: Scene, timestep: float) -> None:
    with_gravity = dataclasses.replace(scene, gravity=G)
    (impact,) = ENGINE.run(with_gravity, impulse(0.9, timestep), [Launch(0.0, height=0.010)])
    fall = G * timestep
    assert impact.speed_in == pytest.approx(
        math.hypot(math.sqrt(2 * G * 0.010), fall / 2), rel=1e-9
    )
    # One step is early or late by up to one: gravity acts on the way there and back.
    assert impact.restitution == pytest.approx(0.9, abs=fall / impact.speed_in)


def test_a_bounce_train_loses_e_squared_of_its_height_each_time() -> None:
    with_gravity, e = dataclasses.replace(PLANE, gravity=G), 0.8
    path = ENGINE.trajectory(with_gravity, impulse(e, 1e-4), Launch(0.0, height=0.010), 0.35)
    assert len(path.time) == 3500
    height = -path.penetration
    tops = height[1:-1][(height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])]
    assert len(tops) >= 4
    assert tops[:3] == pytest.approx(0.010 * e ** (2.0 * np.arange(1, 4)), rel=0.02)


def test_launches_that_cannot_arrive_are_refused() -> None:
    with pytest.raises(SettingError, match="0 m/s without gravity"):
        ENGINE.run(PLANE, spring_damper(), [Launch(0.0, height=0.01)])
    with pytest.raises(SettingError, match=r"height: 0.03 m above the cup.*0.0254"):
        ENGINE.run(CUP, spring_damper(), [Launch(0.1, height=0.03)])


# --- the same bits, always ---


@FORMS
@INTEGRATORS
def test_repeated_and_single_launches_give_the_same_bits(scene: Scene, integrator: str) -> None:
    own, all_launches = spring_damper(2e-6, integrator), launches(0.0254 * np.linspace(1, 20, 7))
    together = ENGINE.run(scene, own, all_launches)
    assert len(together) == 56, "more than are simulated at once"
    for some in (all_launches, *([launch] for launch in all_launches[::11]), all_launches[::-1]):
        for impact in ENGINE.run(scene, own, some):
            assert same_bits(impact, together[all_launches.index(impact.launch)])


FALL = """
from hcbench.system.process import IS_COMMAND
from hcbench.engines.mujoco.backend import backend
IS_COMMAND.set({is_command})
mujoco = backend()
model = mujoco.MjModel.from_xml_string({xml!r})
data = mujoco.MjData(model)
mujoco.mj_step(model, data, nstep=500)
print(data.timer[0].duration > 0.0)
print([place.hex() for place in data.qpos])
"""


def timed_and_places(is_command: bool) -> list[str]:
    """ "True" where a process times the steps of a ball, and the bits of where the ball then lies."""
    ball = '<body pos="0 0 1"><freejoint/><geom size="0.1"/></body>'
    xml = f'<mujoco><worldbody><geom type="plane" size="1 1 1"/>{ball}</worldbody></mujoco>'
    code = FALL.format(is_command=is_command, xml=xml)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


@pytest.mark.skipif(sys.platform == "win32", reason="MuJoCo's clock is out of reach there")
def test_a_command_takes_the_steps_of_a_users_program_without_its_clock() -> None:
    (is_timed, of_user), (is_timed_in_command, of_command) = map(timed_and_places, (False, True))
    assert (is_timed, is_timed_in_command) == ("True", "False")
    assert of_command == of_user


def test_nothing_to_launch_is_nothing_back() -> None:
    assert ENGINE.run(PLANE, spring_damper(), []) == []


# --- the model that is saved ---


@FORMS
def test_the_saved_model_carries_every_digit(scene: Scene) -> None:
    awkward = row(-S / 3, -D / 7)
    awkward |= {
        "solref": [-S / 3, -D / 7],
        "solimp": [1 / 3, 2 / 3, 1e-5 / 3, 1 / 7, 11 / 7],
        "onset": 1e-6 / 3,
    }
    own = setting(1e-6 / 3, awkward, awkward | {"onset": 2e-6 / 3}, integrator="implicitfast")
    scene = dataclasses.replace(scene, gravity=G / 3, mass=scene.mass / 3)
    model = mujoco.MjModel.from_xml_string(model_xml(scene, own))
    assert model.opt.timestep == 1e-6 / 3
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert model.opt.gravity.tolist() == [0.0, 0.0, -G / 3]
    assert model.body("ball").mass[0] == scene.mass
    assert model.body("ball").inertia == pytest.approx(
        3 * [0.4 * scene.mass * scene.ball_radius**2], rel=1e-13
    )
    if scene.form == "plane":
        solref, solimp, onset = model.pair_solref, model.pair_solimp, -model.pair_margin
        assert model.pair_dim.tolist() == [1, 1]
    else:
        solref, solimp = model.tendon_solref_lim, model.tendon_solimp_lim
        onset = model.tendon_range[:, 1] - 0.0254
    assert solref.tolist() == 2 * [awkward["solref"]]
    assert solimp.tolist() == 2 * [awkward["solimp"]]
    assert onset == pytest.approx([1e-6 / 3, 2e-6 / 3], abs=4e-18)


@FORMS
def test_in_the_saved_model_the_ball_just_touches_at_qpos0(scene: Scene) -> None:
    model = mujoco.MjModel.from_xml_string(model_xml(scene, spring_damper()))
    data = mujoco.MjData(model)
    data.qpos[2] -= 1e-7
    mujoco.mj_forward(model, data)
    assert data.nefc == 1
    assert data.efc_pos[0] == pytest.approx(-1e-7, abs=1e-16)


def test_the_saved_model_keeps_what_else_the_user_wrote(tmp_path: Path) -> None:
    own = PLANE.models["mujoco"]["scene"].read_text(encoding="utf-8")
    pair = '<pair geom1="plate" geom2="ball" solref="0.01 1"/>'
    more = f'<contact>{pair}<exclude body1="world" body2="ball"/></contact><option density="1.2"/></mujoco>'
    path = tmp_path / "scene.xml"
    path.write_text(
        own.replace("</mujoco>", more).replace("<worldbody>", "<!-- mine --><worldbody>"), "utf-8"
    )
    text = model_xml(
        dataclasses.replace(PLANE, models={"mujoco": {"scene": path}}), spring_damper()
    )
    model = mujoco.MjModel.from_xml_string(text)
    assert (model.npair, model.nexclude, model.opt.density) == (1, 1, 1.2)
    assert model.pair_solref[0].tolist() == [-S, -D]
    assert "<!-- mine -->" in text


# --- what goes wrong is a record or a clear line ---


@FORMS
@pytest.mark.parametrize(
    "rows",
    [[row(1e9, 1e12)], [row(1e9, 1e2) | {"solimp": [1e-4, 0.9999, 1e-4, 0.5, 1100.0]}]],
    ids=["damped beyond the step", "power that underflows"],
)
def test_a_diverged_impact_is_a_record_that_says_so(
    scene: Scene,
    rows: list[dict[str, Any]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    heard: list[str] = []
    mujoco.set_mju_user_warning(heard.append)
    try:
        impacts = ENGINE.run(scene, setting(1e-5, *rows), [Launch(0.2), Launch(0.3)])
        assert mujoco.get_mju_user_warning() is not None, "the user's own handler is back"
    finally:
        mujoco.set_mju_user_warning(None)
    assert [i.status for i in impacts] == 2 * [Status.DIVERGED]
    assert "MuJoCo gave up" in impacts[0].reason
    assert capfd.readouterr() == ("", "")
    assert heard == []
    assert list(tmp_path.iterdir()) == [], "no MUJOCO_LOG.TXT"


def test_a_trajectory_is_nan_from_where_mujoco_gave_up() -> None:
    path = ENGINE.trajectory(PLANE, setting(1e-3, row(1e9, 1e12)), Launch(0.2), 0.05)
    assert len(path.time) == 50
    lost = np.isnan(path.penetration)
    assert lost.any()
    assert not lost[:3].any()
    assert lost[int(np.argmax(lost)) :].all()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"solver": "CG"}, "'solver': unknown; expected one of: integrator, cone, impratio, rows"),
        ({"integrator": "euler"}, "'integrator': 'euler'; expected one of: Euler"),
        ({"rows": 3}, "'rows': 3; expected a list"),
        ({"rows": [3]}, "'rows[0]': 3; expected a table"),
        ({"rows": [{"solimp": STIFF}]}, "'rows[0].solref': None; expected a list of 2 numbers"),
        (
            {"rows": [row(1.0, 1.0, margin=0.0)]},
            "'rows[0].margin': unknown; expected one of: solref",
        ),
        ({"rows": [row(math.nan, 1.0)]}, "'rows[0].solref': nan; expected a finite number"),
        (
            {"rows": [row(-0.02, 1.0)]},
            "'rows[0].solref': [0.02, -1.0]; expected two numbers above 0",
        ),
        (
            {"rows": [row(1.0, 1.0, onset="1 mm")]},
            "'rows[0].onset': '1 mm'; expected a finite number",
        ),
        (
            {"rows": [row(1.0, 1.0, adhesion=-1.0)]},
            "'rows[0].adhesion': -1.0 N; expected 0 N or more",
        ),
        ({"rows": [row(1.0, 1.0) | {"solimp": [1.0, 2.0]}]}, "'rows[0].solimp'"),
    ],
)
def test_options_that_mujoco_does_not_have_are_refused_by_name(
    options: dict[str, Any], said: str
) -> None:
    with pytest.raises(SettingError) as caught:
        ENGINE.run(PLANE, Setting("mujoco", "test", 1e-3, options), [Launch(0.2)])
    assert said in str(caught.value)


@HAS_DISCRETE
def test_mujocos_own_errors_come_out_as_ours(tmp_path: Path) -> None:
    own = PLANE.models["mujoco"]["scene"].read_text(encoding="utf-8")
    path = tmp_path / "scene.xml"
    asleep = (
        "<worldbody><!-- --></worldbody>"
        '<option><flag sleep="enable" island="disable"/></option><worldbody>'
    )
    path.write_text(own.replace("<worldbody>", asleep), encoding="utf-8")
    scene = dataclasses.replace(PLANE, models={"mujoco": {"scene": path}})
    with pytest.raises(EngineFailed, match="sleep without islands"):
        ENGINE.run(scene, spring_damper(integrator="discrete"), [Launch(0.2)])


@pytest.mark.usefixtures("nothing_kept")
def test_a_missing_mujoco_is_reported_with_the_way_to_get_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def nothing(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", nothing)
    installed_version.cache_clear()
    with pytest.raises(EngineMissing, match="pip install mujoco"):
        ENGINE.version()
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(EngineMissing, match="pip install mujoco"):
        ENGINE.run(PLANE, spring_damper(), [Launch(0.2)])


@pytest.mark.usefixtures("nothing_kept")
@pytest.mark.parametrize(
    ("own", "said"),
    [
        (
            setting(1e-6, row(S, D, adhesion=1.0)),
            "mujoco 3.3.0: has no adhesion; expected 3.11 or later",
        ),
        (
            spring_damper(integrator="discrete"),
            "mujoco 3.3.0: has no integrator 'discrete'; expected 3.13",
        ),
    ],
)
def test_a_mujoco_too_old_for_a_setting_is_reported(
    own: Setting, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = SimpleNamespace(MjModel=object, mjtIntegrator=object, __version__="3.3.0")
    monkeypatch.setattr(scene_model, "backend", lambda: old)
    with pytest.raises(EngineMissing, match=said):
        ENGINE.run(PLANE, own, [Launch(0.2)])


def test_the_version_is_the_installed_one() -> None:
    assert ENGINE.version() == mujoco.__version__


@pytest.mark.parametrize(
    "mass", ['mass="0"', 'mass="-1"', 'mass="nan"', 'mass="inf"', 'mass="heavy"', ""]
)
def test_an_inertial_without_a_mass_above_0_is_refused_by_the_bodys_name(mass: str) -> None:
    body = ET.fromstring(f'<body name="block"><inertial {mass} diaginertia="1 1 1"/></body>')
    with pytest.raises(SceneError, match=r"<inertial> of 'block'.*a mass in kg above 0"):
        set_mass(body, 1.0, Path("scene.xml"))


@pytest.mark.parametrize("name", ["a--b", "a---b", "a----b"])
def test_hyphens_of_a_scene_s_name_leave_its_model_xml(name: str) -> None:
    text = model_xml(dataclasses.replace(PLANE, name=name), spring_damper())
    assert ET.fromstring(text).tag == "mujoco"
