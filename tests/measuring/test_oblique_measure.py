"""Oblique launches in models of users: `measure` and `check` with --angle, --along and --spin."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hcbench.checking import CheckSpec, Outputs, check
from hcbench.engines.mujoco.scene.mjcf import model_xml
from hcbench.laws.force import HuntCrossley
from hcbench.measuring import measure
from hcbench.measuring.text import as_record, as_text
from hcbench.recipes.target import Target
from hcbench.reporting.measurement_page import measurement_page
from hcbench.sim import registry
from hcbench.system.errors import QuantityError, UserError
from hcbench.terms.impact import Launch
from hcbench.terms.scene import load_scene
from hcbench.workers import call

R, STEP, SPIN = 0.0508, 2e-3, (3.0, -20.0, 7.0)
SCENE = replace(
    load_scene("steel-plane"), ball_radius=R, plate_radius=math.inf, friction=0.5, gravity=9.81
)
TARGET = Target(HuntCrossley(SCENE.stiffness, 0.06, 1.5), SCENE.mass, STEP, 0.3, 1.0)
IMPULSE = registry.recipe("mujoco.impulse")(TARGET)
LAUNCHES = [
    Launch.at_angle(a, v, 0.25, spin=SPIN) for v in (0.3, 1.1) for a in (0.0, math.radians(80.0))
]
ASKED: dict[str, Any] = {
    "speeds": [0.3, 1.1],
    "phases": [0.25],
    "angle": "0, 80 deg",
    "spin": list(SPIN),
}


def model(plate: str = "", joint: str = "<freejoint/>", condim: int = 3) -> str:
    row = IMPULSE.options["rows"][0]
    solref, solimp = (" ".join(map(repr, row[key])) for key in ("solref", "solimp"))
    return (
        f'<mujoco><option timestep="{STEP}" cone="elliptic"/><worldbody>'
        f'<geom name="plate" type="plane" size="1 1 .1" {plate}/><body name="ball" pos=".2 0 .2">{joint}'
        f'<geom name="ball" type="sphere" size="{R}" mass=".45"/></body></worldbody><contact>'
        f'<pair geom1="ball" geom2="plate" condim="{condim}" friction=".5 .5"'
        f' solref="{solref}" solimp="{solimp}"/></contact></mujoco>'
    )


def test_the_page_of_several_angles_shows_what_the_model_asks_for_at_each() -> None:
    measured = measure(
        model(), "ball,plate", diagnose=False, speeds=[0.3, 1.1], angle="0, 30 deg", gravity=0
    )
    assert len(measured.curve) == 2 * len(measured.facts.asked)
    page = measurement_page(measured)
    for asked in measured.facts.asked:
        assert page.count(f'<td class="number">{asked:.4f}</td>') >= 2
    for angle in ("0", "30"):
        assert page.count(f'</th><td class="number">{angle}</td>') == 2


def test_benchmark_and_measure_agree_obliquely() -> None:
    measured = measure(model_xml(SCENE, IMPULSE), "ball,plate", diagnose=False, **ASKED).impacts
    simulated = registry.engine("mujoco").run(SCENE, IMPULSE, LAUNCHES)
    for one, other in zip(measured, simulated, strict=True):
        assert one.tangential is not None
        assert other.tangential is not None
        assert one.launch == other.launch
        assert one.restitution == pytest.approx(other.restitution, abs=1e-9)
        for name in (
            "slip_in",
            "slip_out",
            "spin_in",
            "spin_out",
            "impulse",
            "normal_impulse",
            "energy_out",
        ):
            assert getattr(one.tangential, name) == pytest.approx(
                getattr(other.tangential, name), abs=1e-7
            )


def outcome(text: str, along: str | None = None, gravity: str = "0") -> list[float]:
    (impact,) = measure(
        text, "ball,plate", speeds=0.5, phases=[0.3], gravity=gravity, angle="70 deg", spin="9 rad/s",
        along=along, diagnose=False,
    ).impacts  # fmt: skip
    assert impact.tangential is not None
    return [impact.restitution, *impact.tangential.slip_out, *impact.tangential.spin_out]


TILTED, UPRIGHT = 'zaxis="0 .6 .8"', 'zaxis="1 0 0.01"'


@pytest.mark.parametrize(
    ("plate", "along"), [("", "0, 1, 0"), ("", "-3, 4, 9"), (TILTED, None), (UPRIGHT, None)]
)
def test_any_direction_along_any_plate_is_the_same(plate: str, along: str | None) -> None:
    assert outcome(model(plate), along) == pytest.approx(outcome(model()), abs=1e-6)


def pybullet_outcome() -> tuple[list[tuple[float, float]], list[float]]:
    """(impact speed, e) and impulse ratios of a world as a user builds it."""
    import pybullet as p

    from hcbench.engines.pybullet.model.open import LiveWorld as World

    client = p.connect(p.DIRECT)
    me = {"physicsClientId": client}
    exact = dict.fromkeys(("restitutionVelocityThreshold", "contactSlop", "contactERP", "erp"), 0)
    p.setPhysicsEngineParameter(fixedTimeStep=1 / 240, **exact, **me)
    p.setGravity(0, 0, -9.81, **me)
    rigid = {"useMaximalCoordinates": True, **me}
    plate = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE, **me), **rigid)
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=R, **me)
    ball = p.createMultiBody(0.45, shape, basePosition=[0, 0, 0.3], **rigid)
    damping = {"linearDamping": 0, "angularDamping": 0, "contactProcessingThreshold": 0}
    p.changeDynamics(ball, -1, restitution=0.8, lateralFriction=0.5, **damping, **me)
    p.changeDynamics(plate, -1, restitution=1, lateralFriction=1, **me)
    impacts = measure(World(client, ball, plate), diagnose=False, **ASKED).impacts
    p.disconnect(client)
    return [(i.speed_in, i.restitution) for i in impacts], [
        i.tangential.impulse_ratio for i in impacts if i.tangential
    ]


@pytest.mark.needs_engine("pybullet")
def test_a_world_of_pybullet_keeps_its_e_obliquely_at_its_own_step() -> None:
    """Bullet reverses the speed of a step's start, up to v h below the touch plane.

    With e of the speeds there, e at the plane is wrong by at most (1/e - e) g h/v, and by half a
    step's gravity before and after the impact, (1 + e)/2 g h/v.
    """
    impacts, ratios = call(pybullet_outcome, limit=60)
    for speed, e in impacts:
        assert e == pytest.approx(0.8, abs=(1 / 0.8 - 0.8 + 1.8 / 2) * 9.81 / 240 / speed)
    assert ratios[1] == pytest.approx(0.5, abs=1e-6)


def test_measure_finds_what_throws_a_sliding_ball_up_and_its_fix_holds() -> None:
    found = measure(model(), "ball,plate", speeds=[0.3, 1.1], angle="80 deg", restitution=0.97)
    assert max(i.restitution for i in found.measured) > 2.0
    assert not found.energy_gained
    (cause,) = found.causes
    assert cause.code == "sliding-lift"
    assert cause.alone < 0.08
    assert cause.fix.startswith('<option cone="elliptic"')
    assert 'condim="3" friction="0.5 0.5" solref="' in cause.fix
    assert "energy lost" in as_text(found)


def test_check_gates_oblique_impacts(tmp_path: Path) -> None:
    path, baseline = tmp_path / "ball.xml", tmp_path / "bounce.json"
    path.write_text(model())
    held: dict[str, Any] = {"model": str(path), "pair": "ball,plate"}
    asked = {**held, "speeds": [0.3, 1.1], "restitution": 0.97}
    assert check(CheckSpec(**asked, max_error=0.05)).exit_code == 0
    report = check(CheckSpec(**asked, angle="0, 80 deg", max_error=0.05))
    assert report.exit_code == 1
    assert "80 deg" in report.outcomes[0].message
    assert (
        check(CheckSpec(**held, speeds=[0.3], angle="80 deg"), Outputs(baseline=baseline)).exit_code
        == 0
    )
    assert check(CheckSpec(**held, baseline=baseline)).exit_code == 0
    path.write_text(model(condim=1))
    assert check(CheckSpec(**held, baseline=baseline)).exit_code == 1


def test_only_oblique_launches_add_to_the_record() -> None:
    plain = as_record(measure(model(), "ball,plate", speeds=0.5, phases=1, diagnose=False))
    oblique = as_record(
        measure(model(), "ball,plate", speeds=0.5, phases=1, angle="45 deg", diagnose=False)
    )
    assert {*oblique["curve"][0]} - {*plain["curve"][0]} > {
        "angle_rad",
        "slip_out_m_per_s",
        "energy_lost",
    }
    assert {*oblique["impacts"][0]} - {*plain["impacts"][0]} == {"angle_rad", "tangential"}
    json.dumps(oblique)


def test_what_cannot_slide_or_is_no_direction_is_refused() -> None:
    slide = model(joint='<joint type="slide" axis="0 0 1"/>')
    with pytest.raises(UserError, match="slide cannot move along the plate"):
        measure(slide, "ball,plate", angle="45 deg")
    with pytest.raises(UserError, match="normal to the plate"):
        measure(model(), "ball,plate", angle="45 deg", along="0, 0, 1")
    with pytest.raises(QuantityError, match="deg"):
        measure(model(), "ball,plate", angle=60)


@pytest.mark.parametrize("phase", [0.1, 0.6])
def test_a_drop_touches_in_its_phase_at_the_speed_of_its_fall(phase: float) -> None:
    """Compare the phase of the touch with the depth at which the contact first acts, in steps'
    ways.
    """
    (impact,) = measure(
        model(), "ball,plate", speeds="1 mm/s", height="10 cm", gravity=9.81, phases=[phase], diagnose=False
    ).impacts  # fmt: skip
    assert impact.speed_in == pytest.approx(math.sqrt(2 * 9.81 * 0.1), rel=0.02)
    depths = [
        measure(
            model(), "ball,plate", speeds="1 mm/s", height="10 cm", gravity=9.81, phases=[p], diagnose=False
        ).impacts[0].penetration_max
        for p in (phase, phase + 0.2)
    ]  # fmt: skip
    way = STEP * impact.speed_in
    assert (depths[0] - depths[1]) % way == pytest.approx(
        0.2 * way, rel=0.05
    )  # a step's way grows by g h²


def test_an_angle_is_that_of_the_touch() -> None:
    with pytest.raises(UserError, match="given with height"):
        measure(model(), "ball,plate", height="10 cm", angle="45 deg")


def test_a_pyramidal_cone_that_holds_a_sliding_box_too_little_is_a_cause() -> None:
    """Along the diagonal of its pyramid friction is μ / √2; along an axis nothing is short."""
    box = """<mujoco><option timestep="2e-3"/><worldbody>
    <geom name="floor" type="plane" size="9 9 .1" friction=".4"/><body name="box" pos="0 0 .2"><freejoint/>
    <geom name="box" type="box" size=".05 .05 .05" mass="1" friction=".4" solref="-1e-3 -935"
     solimp=".9999 .9999 .001"/></body></worldbody></mujoco>"""

    def codes(along: list[float], cone: str = "pyramidal") -> list[str]:
        text = box.replace("timestep", f'cone="{cone}" timestep')
        launch: Any = {"speeds": [0.5], "angle": ["60 deg"], "along": along, "phases": 1}
        return [cause.code for cause in measure(text, "box,floor", **launch).causes]

    assert "pyramidal-cone" in codes([1, 1, 0])
    assert "pyramidal-cone" not in codes([1, 0, 0])
    assert "pyramidal-cone" not in codes([1, 1, 0], "elliptic")


@pytest.mark.needs_engine("pybullet")
def test_spin_that_bullet_clips_is_a_cause(tmp_path: Path) -> None:
    link = (
        '<link name="l"><inertial><mass value="{m}"/>'
        '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0"'
    )
    link += ' iyz="0"/></inertial><collision><geometry>{shape}</geometry></collision></link>'
    ball = link.format(m=1, i=1e-3, shape='<sphere radius=".05"/>')
    (tmp_path / "ball.urdf").write_text(f'<robot name="ball">{ball}</robot>')
    plate = link.format(m=0, i=0, shape='<box size="9 9 1"/>')
    (tmp_path / "plate.urdf").write_text(f'<robot name="plate">{plate}</robot>')

    def codes(spin: float) -> list[str]:
        files = [tmp_path / "ball.urdf", tmp_path / "plate.urdf"]
        return [cause.code for cause in measure(files, speeds=[0.5], spin=spin, phases=1).causes]

    assert "spin-clamp" in codes(300.0)
    assert "spin-clamp" not in codes(40.0)
