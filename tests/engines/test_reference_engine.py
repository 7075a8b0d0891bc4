"""The reference and recordings as engines: the same contract, the same records, and clear refusals."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from hcbench.laws import closed_form, kelvin_voigt, ode
from hcbench.laws.force import HuntCrossley, KelvinVoigt
from hcbench.laws.published import LAWS, Flores, PublishedLaw, TouchSpeedLaw
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.system.errors import SettingError, UserError
from hcbench.terms.impact import Impact, Launch, Status
from hcbench.terms.scene import Material, Scene
from hcbench.terms.setting import Setting

if TYPE_CHECKING:
    from pathlib import Path

STEEL = Material(2.07e11, 0.3)
SCENE = Scene(
    "drop", "Drop", "plane", 0.45359237, 0.0508, math.inf, STEEL, STEEL, stiffness=3.4064e10
)
REFERENCE, RECORDED = registry.engine("reference"), registry.engine("recorded")
ALPHA = 0.315


def law_setting(timestep: float = 1e-6, **options: Any) -> Setting:
    return Setting("reference", "hunt-crossley", timestep, {"alpha": ALPHA, **options})


def drop(setting: Setting, *launches: Launch, scene: Scene = SCENE) -> list[Impact]:
    return registry.engine(setting.engine).run(scene, setting, launches)


# --- the reference
# -------------------------------------------------------------------------------------


def test_reference_is_the_closed_form_at_every_phase() -> None:
    launches = [Launch(v, phase) for v in (0.1, 0.4) for phase in (0.0, 0.37, 0.9)]
    impacts = drop(law_setting(), *launches)
    assert [impact.launch for impact in impacts] == launches
    law = HuntCrossley(SCENE.stiffness, ALPHA)
    for impact in impacts:
        v = impact.launch.speed
        assert impact.status is Status.PARTED
        assert impact.speed_in == v
        assert impact.restitution == pytest.approx(
            float(closed_form.restitution(ALPHA, v)), rel=1e-15
        )
        assert impact.force_max == closed_form.force_max(law, SCENE.mass, v)
        assert impact.penetration_max == closed_form.penetration_max(law, SCENE.mass, v)
        assert impact.duration == closed_form.duration(law, SCENE.mass, v)


@pytest.mark.parametrize("alpha", [0.05, 0.315, 2.0])
def test_the_spring_and_damper_has_the_best_constant_e_and_the_laws_contact_time(
    alpha: float,
) -> None:
    """At the geometric middle of the band; the contact ends where the surfaces part."""
    law = HuntCrossley(SCENE.stiffness, alpha)
    target = Target(law, SCENE.mass, 1e-3, 0.1, 0.9)
    contact = KelvinVoigt(**registry.recipe("reference.kelvin-voigt")(target).options)
    found = kelvin_voigt.bounce(contact, SCENE.mass, 0.3, kelvin_voigt.Ending.SURFACE)
    ends = closed_form.restitution(alpha, np.array([0.1, 0.9]))
    assert found.restitution == pytest.approx(float(ends.mean()), rel=1e-9)
    assert found.duration == pytest.approx(
        float(closed_form.duration(law, SCENE.mass, 0.3)), rel=1e-9
    )


def test_no_spring_and_damper_stops_a_body_without_rebound() -> None:
    law = HuntCrossley(SCENE.stiffness, ALPHA)
    target = Target(law, SCENE.mass, 1e-3, 0.1, 0.9, reading="points", points=((1.0, 0.0),))
    with pytest.raises(SettingError, match=r"^restitution: 0; expected e above 0"):
        registry.recipe("reference.kelvin-voigt")(target)


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.slug)
def test_laws_that_came_after_have_one_restitution_for_all_speeds(law: PublishedLaw) -> None:
    setting = Setting("reference", law.slug, 1e-6, {"restitution": 0.7})
    for impact in drop(
        setting, *(Launch(v, phase) for v in (0.0254, 0.508) for phase in (0.0, 0.4))
    ):
        assert impact.restitution == pytest.approx(float(law.delivered(0.7)), rel=1e-14)
        assert impact.loop is not None
        own = TouchSpeedLaw(law, SCENE.stiffness, 0.7).at(impact.speed_in)
        force = own.force(impact.loop.penetration, impact.loop.rate)
        np.testing.assert_allclose(
            impact.loop.force, force, rtol=1e-10, atol=1e-9 * impact.force_max
        )


def test_laws_that_came_after_know_gravity() -> None:
    with_gravity = replace(SCENE, gravity=9.81)
    (impact,) = drop(
        Setting("reference", "flores", 1e-6, {"restitution": 0.7}), Launch(0.05), scene=with_gravity
    )
    law = TouchSpeedLaw(Flores, SCENE.stiffness, 0.7)
    truth = ode.impact(law, SCENE.mass, impact.speed_in, gravity=9.81)
    assert impact.restitution == pytest.approx(truth.restitution, rel=1e-12)
    assert impact.restitution < law.delivered


def test_reference_takes_stiffness_and_exponent_of_the_scene_unless_set() -> None:
    (own,) = drop(law_setting(), Launch(0.4))
    (same,) = drop(law_setting(stiffness=SCENE.stiffness, exponent=1.5), Launch(0.4))
    (soft,) = drop(law_setting(stiffness=1e6, exponent=1.0), Launch(0.4))
    assert own.penetration_max == same.penetration_max
    assert soft.penetration_max > 10 * own.penetration_max
    assert soft.restitution == own.restitution  # of α v alone


def test_the_step_only_samples_the_loop() -> None:
    fine, coarse = (drop(law_setting(h), Launch(0.4))[0] for h in (1e-7, 1e-3))
    assert fine.loop is not None
    assert coarse.loop is not None
    assert fine.restitution == coarse.restitution
    assert len(fine.loop.time) > len(coarse.loop.time) > 100
    assert fine.samples == len(fine.loop.time)
    assert coarse.loop.penetration.max() == coarse.penetration_max


def test_repeated_runs_are_bit_equal_and_cannot_be_spoilt() -> None:
    (first,), (again,) = (drop(law_setting(), Launch(0.2)) for _ in range(2))
    assert first.loop is not None
    assert again.loop is not None
    assert first.loop.force.tobytes() == again.loop.force.tobytes()
    with pytest.raises(ValueError, match="read-only"):
        first.loop.force[3] = 0.0


def test_gravity_adds_the_fall_and_presses_through_the_contact() -> None:
    scene = replace(SCENE, gravity=9.81)
    (impact,) = drop(law_setting(), Launch(0.0, height=0.005), scene=scene)
    speed = math.sqrt(2 * 9.81 * 0.005)
    truth = ode.impact(HuntCrossley(SCENE.stiffness, ALPHA), SCENE.mass, speed, gravity=9.81)
    assert impact.speed_in == pytest.approx(speed, rel=1e-15)
    assert impact.restitution == pytest.approx(truth.restitution, rel=1e-12)
    assert impact.restitution < closed_form.restitution(ALPHA, speed)


def test_a_body_left_alone_in_free_space_never_touches() -> None:
    (impact,) = drop(law_setting(), Launch(0.0, height=0.1))
    assert impact.status is Status.NO_TOUCH
    assert math.isnan(impact.restitution)


def test_kelvin_voigt_is_the_damped_sine_to_the_surface() -> None:
    law = KelvinVoigt(1e8, 800.0)
    setting = Setting("reference", "kelvin-voigt", 1e-6, {"stiffness": 1e8, "damping": 800.0})
    slow, fast = drop(setting, Launch(0.1), Launch(0.4))
    truth = kelvin_voigt.bounce(law, SCENE.mass, 0.4, kelvin_voigt.Ending.SURFACE)
    assert fast.restitution == pytest.approx(truth.restitution, rel=1e-15)
    assert slow.restitution == pytest.approx(fast.restitution, rel=1e-15)  # whatever the speed
    assert fast.loop is not None
    assert fast.loop.force[0] == pytest.approx(800.0 * 0.4)
    assert fast.loop.force[-1] < 0


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_an_overdamped_contact_rests(gravity: float) -> None:
    setting = Setting("reference", "kelvin-voigt", 1e-6, {"stiffness": 1e8, "damping": 5e4})
    (impact,) = drop(setting, Launch(0.4), scene=replace(SCENE, gravity=gravity))
    assert impact.status is Status.RESTED
    assert impact.restitution == 0.0


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        (Setting("reference", "hunt-crossley", 1e-6, {}), "alpha.*missing"),
        (Setting("reference", "hunt-crossley", 1e-6, {"alpha": "0.3"}), "alpha.*'0.3'.*number"),
        (Setting("reference", "hunt-crossley", 1e-6, {"alpha": True}), "alpha.*True.*number"),
        (
            Setting("reference", "hunt-crossley", 1e-6, {"alpha": 0.3, "damping": 1}),
            "'damping'.*one of.*alpha",
        ),
        (Setting("reference", "kelvin-voigt", 1e-6, {"stiffness": 1e8}), "damping.*missing"),
        (Setting("reference", "impulse", 1e-6, {}), "'impulse'.*'hunt-crossley', 'kelvin-voigt'"),
        (Setting("recorded", "recorded", 1e-6, {}), "'file'.*missing"),
        (Setting("recorded", "recorded", 1e-6, {"file": 3}), "'file'.*3.*path"),
        (Setting("recorded", "recorded", 1e-6, {"path": "a.csv"}), "'path'.*'file'"),
        (
            Setting("recorded", "recorded", 1e-6, {"file": ["a.csv", "b.csv"]}),
            "2 files for 1 launch",
        ),
    ],
)
def test_settings_it_does_not_have_are_refused(setting: Setting, says: str) -> None:
    with pytest.raises(SettingError, match=says):
        drop(setting, Launch(0.4))


def test_numbers_the_law_has_no_meaning_for_are_refused() -> None:
    with pytest.raises(UserError, match=r"alpha: -0\.1"):
        drop(law_setting(alpha=-0.1), Launch(0.4))


@pytest.mark.parametrize("engine", [REFERENCE, RECORDED])
def test_engines_without_a_backend_carry_our_version(engine: Any) -> None:
    assert engine.version()[0].isdigit()
    assert engine.backend is None


# --- recordings
# ----------------------------------------------------------------------------------------

HEADER = "time_s,penetration_m,rate_m_per_s,force_n"


def record(folder: Path, speed: float = 0.4, name: str = "drop.csv") -> Path:
    """A trajectory with free flight on either side of the law's impact, even in time."""
    law, h = HuntCrossley(SCENE.stiffness, ALPHA), 1e-6
    loop = closed_form.loop(law, SCENE.mass, speed, 2001)
    inside = np.arange(0.0, loop.time[-1], h)
    before, after = np.arange(-5, 0) * h, loop.time[-1] + np.arange(1, 6) * h
    time = np.concatenate([before, inside, inside[-1] + h * np.arange(1, 6)])
    out = float(loop.rate[-1])
    x, v, f = (np.interp(inside, loop.time, a) for a in (loop.penetration, loop.rate, loop.force))
    f[0] = 1e-9  # touching: what acts from here on
    x = np.concatenate([before * speed, x, (after - loop.time[-1]) * out])
    v = np.concatenate([np.full(5, speed), v, np.full(5, out)])
    f = np.concatenate([np.zeros(5), f, np.zeros(5)])
    file = folder / name
    lines = [
        ",".join(f"{number:.12g}" for number in row) for row in zip(time, x, v, f, strict=True)
    ]
    file.write_text("\n".join([HEADER, *lines]) + "\n", encoding="utf-8")
    return file


def recorded(file: Any) -> Setting:
    return Setting("recorded", "recorded", 1e-6, {"file": file})


def test_a_recorded_impact_comes_back_as_it_was(tmp_path: Path) -> None:
    (impact,) = drop(recorded(str(record(tmp_path))), Launch(0.1))
    law = HuntCrossley(SCENE.stiffness, ALPHA)
    assert impact.status is Status.PARTED
    assert impact.launch == Launch(0.1)
    assert impact.speed_in == pytest.approx(0.4)  # what was recorded, not what was asked for
    assert impact.restitution == pytest.approx(float(closed_form.restitution(ALPHA, 0.4)), rel=1e-9)
    assert impact.force_max == pytest.approx(
        float(closed_form.force_max(law, SCENE.mass, 0.4)), rel=1e-4
    )
    assert impact.duration == pytest.approx(
        float(closed_form.duration(law, SCENE.mass, 0.4)), abs=1.1e-6
    )


def test_one_file_for_each_launch(tmp_path: Path) -> None:
    files = [str(record(tmp_path, speed, f"{speed}.csv")) for speed in (0.1, 0.4)]
    slow, fast = drop(recorded(files), Launch(0.1), Launch(0.4))
    assert slow.restitution > fast.restitution


def test_other_columns_and_any_order_are_welcome(tmp_path: Path) -> None:
    file = tmp_path / "rig.csv"
    file.write_text(
        "\ufeffforce_n,note,rate_m_per_s,time_s,penetration_m\n"
        "0,a,1,0,-0.5\n5,b,1,1,0.5\n0,c,-0.5,2,0\n0,d,-0.5,3,-0.5\n",
        encoding="utf-8",
    )
    (impact,) = drop(recorded(str(file)), Launch(1.0))
    assert impact.restitution == 0.5
    assert impact.force_max == 5.0


def test_numbers_that_ran_away_are_a_status(tmp_path: Path) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(f"{HEADER}\n0,-1,1,0\n1,0,nan,2\n2,1,1,0\n", encoding="utf-8")
    assert drop(recorded(str(file)), Launch(1.0))[0].status is Status.DIVERGED


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "no rows"),
        (HEADER + "\n", "no rows"),
        (HEADER + "\n0,0,1,0\n", "one row"),
        ("time_s,penetration_m,force_n\n0,0,0\n1,0,0\n", "no column 'rate_m_per_s'"),
        (HEADER + "\n0,-1,1,0\n1,deep,1,0\n", "'deep' on line 3, column 'penetration_m'"),
        (HEADER + "\n0,-1,1,0\n1,0,1\n", "line 3, column 'force_n'"),
        (HEADER + "\n0,-1,1,0\n1,0,1,0\n3,1,1,0\n", "even steps"),
        (HEADER + "\n0,-1,1,0\n-1,0,1,0\n", "rise in even steps"),
        (HEADER + "\n0,-1,1,0\ninf,0,1,0\n", "not finite"),
    ],
)
def test_a_recording_with_a_mistake_in_it_is_refused(
    tmp_path: Path, content: str, says: str
) -> None:
    file = tmp_path / "rig.csv"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(SettingError, match=f"rig.csv: .*{says}"):
        drop(recorded(str(file)), Launch(1.0))


def test_a_recording_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"gone\.csv: could not be read"):
        drop(recorded(str(tmp_path / "gone.csv")), Launch(1.0))
