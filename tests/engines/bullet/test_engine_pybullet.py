"""PyBullet through the contract: its contact as the settings say, and nothing of it left behind."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from dataclasses import replace
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest
from covering import every_pair

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.engines.pybullet.engine import PybulletEngine
from hcbench.sim import simulate
from hcbench.sim.backend import installed_version
from hcbench.system.errors import (
    EngineFailed,
    EngineMissing,
    SceneError,
    SettingError,
    foreign_errors,
)
from hcbench.terms.impact import Impact, Launch, Status
from hcbench.terms.scene import Material, Scene
from hcbench.terms.setting import Setting
from hcbench.workers import call

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

Form = Literal["plane", "cup"]

SCENES = Path(__file__).parents[3] / "scenes"
STEEL = Material(young_modulus=2.0e11, poisson_ratio=0.3)
MASS, R1, R2 = 0.45359237, 0.0254, 0.0508
FORMS: tuple[Form, ...] = ("plane", "cup")
ENGINE = PybulletEngine()

WORLD = {
    "restitutionVelocityThreshold": 0.0,
    "contactSlop": 0.0,
    "contactERP": 0.0,
    "contactBreakingThreshold": 0.02,
}
BALL = {"linearDamping": 0.0, "angularDamping": 0.0, "contactProcessingThreshold": 0.0}
SPEEDS = (0.0254, 0.2032, 0.508)  # 1, 8, 20 in/s
EVERY_PHASE = [Launch(speed, phase / 8) for speed in SPEEDS for phase in range(8)]


def steel(form: Form, gravity: float = 0.0) -> Scene:
    folder = SCENES / f"steel-{form}"
    return Scene(
        name=folder.name,
        title="",
        form=form,
        mass=MASS,
        ball_radius=R1,
        plate_radius=-R2,
        ball_material=STEEL,
        plate_material=STEEL,
        stiffness=3.4064e10,
        gravity=gravity,
        models={"pybullet": {"ball": folder / "ball.urdf", "plate": folder / "plate.urdf"}},
    )


def restitution(e: float, maximal: bool = True) -> dict[str, Any]:
    ball = {**BALL, "restitution": e}
    return {
        "world": WORLD,
        "ball": ball,
        "plate": {"restitution": 1.0},
        "maximal_coordinates": maximal,
    }


def spring_damper(
    stiffness: float, damping: float, timestep: float, maximal: bool = False
) -> dict[str, Any]:
    ball = {**BALL, "contactStiffness": stiffness, "contactDamping": damping - stiffness * timestep}
    plate = {"contactStiffness": 1e30, "contactDamping": 0.0}
    return {"world": WORLD, "ball": ball, "plate": plate, "maximal_coordinates": maximal}


def simulated(
    form: Form,
    timestep: float,
    options: dict[str, Any],
    launches: Sequence[Launch],
    gravity: float = 0.0,
) -> list[Impact]:
    return ENGINE.run(
        steel(form, gravity), Setting("pybullet", "test", timestep, options), launches
    )


# --- restitution
# ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("maximal", [False, True], ids=["multibody", "maximal"])
@pytest.mark.parametrize("timestep", [1e-3, 1 / 240, 1e-6])
@pytest.mark.parametrize("form", FORMS)
def test_the_restitution_set_is_the_restitution_had(
    form: Form, timestep: float, maximal: bool
) -> None:
    for e in (0.25, 0.92694, 1.0):
        impacts = simulated(form, timestep, restitution(e, maximal), EVERY_PHASE)
        assert {impact.status for impact in impacts} == {Status.PARTED}
        assert {impact.samples for impact in impacts} == {1}  # one impulse
        np.testing.assert_allclose(
            [impact.restitution for impact in impacts], e, rtol=0, atol=1e-12
        )


def test_under_gravity_bullet_reverses_the_speed_at_the_steps_end_or_start_and_e_is_at_the_plane() -> (
    None
):
    h, g, fall = 1e-3, 9.80665, Launch(speed=0.0, height=2e-3)
    for maximal, gain in ((True, 0.0), (False, g * h)):
        (impact,) = simulated("plane", h, restitution(0.9, maximal=maximal), [fall], g)
        assert impact.speed_in == pytest.approx(
            math.hypot(math.sqrt(2 * g * 2e-3), g * h / 2), rel=1e-12
        )
        assert impact.loop is not None
        (gap,), (rate,) = -impact.loop.penetration, impact.loop.rate
        left = 0.9 * (rate + gain)
        after = math.sqrt(
            (left - g * h / 2) ** 2 + 2 * g * (gap + h * left)
        )  # what its flight keeps
        assert impact.restitution == pytest.approx(after / impact.speed_in, abs=1e-12)


def test_out_of_the_box_nothing_rebounds_from_the_plane() -> None:
    for timestep in (1e-3, 1e-6):
        impacts = simulated("plane", timestep, {}, EVERY_PHASE)
        assert all(impact.restitution < 1e-9 for impact in impacts)


def test_predictive_contact_acts_no_earlier_than_the_step_of_the_touch() -> None:
    # Stock: contact before the touch, in a flight that air damping slows all the way.
    h = 1e-3
    (impact,) = simulated("plane", h, {}, [Launch(0.2, height=5e-3)])
    assert impact.loop is not None
    assert -0.2 * h <= impact.loop.penetration[0] < 0.0
    assert 0.19 < impact.speed_in < 0.2


# --- springs and dampers
# -------------------------------------------------------------------------------


@pytest.mark.parametrize("maximal", [False, True], ids=["multibody", "maximal"])
@pytest.mark.parametrize("form", FORMS)
def test_force_is_kelvin_voigt_and_belongs_to_the_state_it_acts_from(
    form: Form, maximal: bool
) -> None:
    k, c, h = 1.2e8, 364.5, 1e-6
    (impact,) = simulated(form, h, spring_damper(k, c, h, maximal), [Launch(0.2, 0.3)])
    loop = impact.loop
    assert loop is not None and impact.status is Status.PARTED
    x, v, v_next, force = loop.penetration[:-1], loop.rate[:-1], loop.rate[1:], loop.force[:-1]
    scale = force.max()
    np.testing.assert_allclose(force / scale, MASS * (v - v_next) / h / scale, atol=1e-12)
    np.testing.assert_allclose(loop.penetration[1:], x + h * v_next, atol=1e-15)
    inside = x > 0
    # Bullet's own depth differs from the exact one by rounding, or by the field of the cup.
    slack = {"plane": 1e-16, "cup": 1e-8}[form]
    np.testing.assert_allclose((k * x + c * v_next)[inside], force[inside], rtol=0, atol=k * slack)


@pytest.mark.parametrize("form", FORMS)
def test_the_loop_holds_the_energy_lost(form: Form) -> None:
    h = 1e-6
    for impact in simulated(form, h, spring_damper(1.2e8, 364.5, h), EVERY_PHASE):
        assert impact.loop is not None
        lost = 0.5 * MASS * (impact.speed_in**2 - impact.speed_out**2)
        assert np.trapezoid(impact.loop.force, impact.loop.penetration) == pytest.approx(
            lost, rel=0.01
        )


def test_the_implicit_step_meets_the_bounce_of_the_continuous_damper() -> None:
    k, c = 1.2e8, 364.5
    zeta = c / (2 * math.sqrt(k * MASS))
    e = math.exp(
        -zeta / math.sqrt(1 - zeta**2) * math.acos(2 * zeta**2 - 1)
    )  # until F, not x, is 0 again
    impacts = simulated("plane", 1e-6, spring_damper(k, c, 1e-6), EVERY_PHASE)
    np.testing.assert_allclose([impact.restitution for impact in impacts], e, rtol=0, atol=5e-4)


# --- the same again
# ------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
def test_runs_repeat_bit_by_bit_whatever_ran_between(form: Form) -> None:
    a = (form, 1e-5, spring_damper(1e6, 40.0, 1e-5), EVERY_PHASE[::3])
    leaky = {"world": {**WORLD, "contactBreakingThreshold": 1e-4, "numSolverIterations": 3}}
    first = simulated(*a)
    simulated("plane", 2e-3, {**restitution(0.3), **leaky}, EVERY_PHASE[:4], gravity=3.0)
    assert _same(first, simulated(*a))
    stock: dict[str, Any] = {}
    before = simulated(form, 1e-3, stock, EVERY_PHASE[::5])
    simulated("cup", 1e-6, {**restitution(0.5), **leaky}, EVERY_PHASE[:2])
    assert _same(before, simulated(form, 1e-3, stock, EVERY_PHASE[::5]))


@pytest.mark.parametrize(
    ("form", "options", "gravity"),
    every_pair(
        FORMS,
        [{}, restitution(0.0), restitution(0.9), spring_damper(1e6, 40.0, 1e-5)],
        [0.0, 9.8],
    ),
)
def test_a_batch_is_its_launches_one_by_one(
    form: Form, options: dict[str, Any], gravity: float
) -> None:
    # Also after a launch that ends at rest, in contact: what Bullet remembers of
    # it must not act on the next.
    launches = [
        Launch(0.3, 0.1),
        Launch(0.05, 0.9),
        Launch(0.508, 0.5),
        Launch(0.3, 0.1),
        Launch(0.01, 0.3),
    ]
    h = 1e-3 if "ball" not in options or "restitution" in options["ball"] else 1e-5
    together = simulated(form, h, options, launches, gravity)
    assert _same(
        together, [simulated(form, h, options, [launch], gravity)[0] for launch in launches]
    )


def _same(one: Sequence[Impact], other: Sequence[Impact]) -> bool:
    """Bit by bit."""
    return [_bits(impact) for impact in one] == [_bits(impact) for impact in other]


def _bits(impact: Impact) -> tuple[Any, ...]:
    loop = impact.loop
    arrays = () if loop is None else (loop.time, loop.penetration, loop.rate, loop.force)
    numbers = (
        impact.speed_in,
        impact.speed_out,
        impact.duration,
        impact.penetration_max,
        impact.force_max,
    )
    return impact.status, np.array(numbers).tobytes(), *(array.tobytes() for array in arrays)


# --- the user's own PyBullet
# -----------------------------------------------------------------------------


def _drop_of_their_own(bullet: Any, client: int) -> list[float]:
    """A user's simulation, with restitution and the globals that the client has."""
    bullet.resetSimulation(physicsClientId=client)
    folder = SCENES / "steel-plane"
    ball, plate = (
        bullet.loadURDF(str(folder / f), physicsClientId=client)
        for f in ("ball.urdf", "plate.urdf")
    )
    bullet.changeDynamics(ball, -1, restitution=0.9, physicsClientId=client)
    bullet.changeDynamics(plate, -1, restitution=1.0, physicsClientId=client)
    bullet.resetBasePositionAndOrientation(
        ball, [0, 0, 0.053], [0, 0, 0, 1], physicsClientId=client
    )
    bullet.resetBaseVelocity(ball, [0.1, 0, -0.3], [1, 2, 3], physicsClientId=client)
    heights = []
    for _ in range(60):
        bullet.stepSimulation(physicsClientId=client)
        heights.append(bullet.getBasePositionAndOrientation(ball, physicsClientId=client)[0][2])
    return heights


def test_nothing_leaks_between_the_users_pybullet_and_ours() -> None:
    import pybullet as bullet

    ours = (
        1e-3,
        {**restitution(0.9), "world": {**WORLD, "contactBreakingThreshold": 0.5}},
        EVERY_PHASE[:3],
    )
    unseen = simulated("plane", *ours)
    client = bullet.connect(bullet.DIRECT)
    try:
        bullet.setPhysicsEngineParameter(
            contactBreakingThreshold=1e-4, fixedTimeStep=2e-3, numSubSteps=2, physicsClientId=client
        )
        theirs = _drop_of_their_own(bullet, client)
        assert _same(unseen, simulated("plane", *ours))
        assert _drop_of_their_own(bullet, client) == theirs
        assert bullet.getPhysicsEngineParameters(physicsClientId=client)["fixedTimeStep"] == 2e-3
        # It would have shown: another client of this process does reach into the first one.
        other = bullet.connect(bullet.DIRECT)
        bullet.setPhysicsEngineParameter(contactBreakingThreshold=0.5, physicsClientId=other)
        bullet.disconnect(other)
        assert _drop_of_their_own(bullet, client) != theirs
    finally:
        bullet.setPhysicsEngineParameter(contactBreakingThreshold=0.02, physicsClientId=client)
        bullet.disconnect(client)


def test_pybullet_is_never_imported_in_the_users_process_and_never_prints() -> None:
    here = Path(__file__).parent
    paths = [str(here), str(here.parents[1] / "support")]
    code = (
        f"import sys; sys.path[:0] = {paths!r}; import test_engine_pybullet as t;"
        "e = t.simulated('cup', 1e-3, t.restitution(.5), t.EVERY_PHASE[:1])[0].restitution;"
        "assert abs(e - .5) < 1e-12 and 'pybullet' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


def _die_on_fast_ones(launches: Sequence[Launch], *_: Any) -> Iterator[Impact]:
    for launch in launches:
        if launch.speed > 0.4:
            os.kill(os.getpid(), signal.SIGSEGV)
        yield Impact(launch, Status.NO_TOUCH)


def test_a_launch_that_kills_the_engine_is_a_record(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulate, "simulate_all", _die_on_fast_ones)
    launches = [Launch(0.1), Launch(0.5), Launch(0.2)]
    impacts = simulated("plane", 1e-3, {}, launches)
    assert [impact.launch for impact in impacts] == launches
    assert [impact.status for impact in impacts] == [
        Status.NO_TOUCH,
        Status.CRASHED,
        Status.NO_TOUCH,
    ]
    assert impacts[1].reason == "crashed with SIGSEGV"
    assert math.isnan(impacts[1].restitution)


# --- scenes
# --------------------------------------------------------------------------------------------


def test_a_file_of_the_same_name_in_the_working_directory_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cup.cdf").write_bytes(b"not a field")
    monkeypatch.chdir(tmp_path)
    (impact,) = simulated("cup", 1e-3, restitution(0.9), [Launch(0.2)])
    assert impact.restitution == pytest.approx(0.9, abs=1e-12)


def test_a_model_may_be_named_from_the_working_directory(monkeypatch: pytest.MonkeyPatch) -> None:
    simulated("plane", 1e-3, {}, [Launch(0.2)])  # the worker is there before the user moves
    monkeypatch.chdir(SCENES)
    models = {"pybullet": {role: Path("steel-cup") / f"{role}.urdf" for role in ("ball", "plate")}}
    setting = Setting("pybullet", "test", 1e-3, restitution(0.9))
    (impact,) = ENGINE.run(replace(steel("cup"), models=models), setting, [Launch(0.2)])
    assert impact.restitution == pytest.approx(0.9, abs=1e-12)


def test_the_scene_says_the_mass() -> None:
    with_gravity, setting = (
        replace(steel("plane"), mass=2 * MASS),
        Setting("pybullet", "test", 1e-3, restitution(0.9)),
    )
    (impact,) = ENGINE.run(with_gravity, setting, [Launch(0.2)])
    assert impact.force_max == pytest.approx(2 * MASS * 0.2 * 1.9 / 1e-3, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"models": {}}, "no PyBullet model for the ball"),
        ({"models": {"pybullet": {"ball": Path("gone.urdf")}}}, r"gone\.urdf does not exist"),
        ({"models": {"pybullet": {"ball": Path(__file__)}}}, "cannot be read: .*; expected a URDF"),
        (
            {"ball_radius": 0.0253},
            r"ball\.urdf: sphere radius: '0\.0508'; expected 0\.0504015\d* m, the",
        ),
    ],
)
def test_a_scene_that_cannot_be_loaded_or_says_something_else(
    change: dict[str, Any], message: str
) -> None:
    setting = Setting("pybullet", "test", 1e-3)
    with pytest.raises(SceneError, match=message):
        ENGINE.run(replace(steel("plane"), **change), setting, [Launch(0.2)])


# --- requests
# ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"solref": [1, 2]}, "option 'solref': unknown; expected one of: world, ball"),
        (
            {"world": {"gravity": 1}},
            r"option 'world\.gravity': unknown; expected one of setPhysics",
        ),
        ({"world": {"fixedTimeStep": 1e-3}}, r"'world\.fixedTimeStep': not to be set here"),
        ({"world": {"numSubSteps": 4}}, "reported; use a smaller timestep"),
        ({"ball": {"mass": 1.0}}, "The scene says it"),
        (
            {"ball": {"restitution": -0.5}},
            r"'ball\.restitution': -0\.5; expected a finite number of 0 or more",
        ),
        ({"ball": {"restitution": math.nan}}, r"'ball\.restitution': nan"),
        ({"ball": {"restitution": "high"}}, r"'ball\.restitution': 'high'; expected a number"),
        ({"world": {"numSolverIterations": 1.5}}, "expected a whole number"),
        ({"world": {"numSolverIterations": 2**31}}, "expected a whole number below 2147483648"),
        ({"plate": {"contactStiffness": 1e8}}, "'plate': contactStiffness alone"),
        ({"plate": 3}, "'plate': 3; expected a table of changeDynamics's keywords"),
        ({"maximal_coordinates": 1}, "'maximal_coordinates': 1; expected true or false"),
    ],
)
def test_a_word_that_bullet_does_not_have_is_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError, match=message) as error:
        simulated("plane", 1e-3, options, [Launch(0.2)])
    assert error.value.exit_code == 2


def test_a_launch_that_cannot_arrive_is_refused() -> None:
    with pytest.raises(SettingError, match="0 m/s without gravity"):
        simulated("plane", 1e-3, {}, [Launch(0.0, height=0.01)])


def _ask_for_a_file_that_is_not_there() -> None:
    bullet = BulletClient.direct()
    with foreign_errors("pybullet", bullet.error):
        bullet.loadURDF("nowhere.urdf")


def test_what_pybullet_refuses_comes_as_our_own_error() -> None:
    with pytest.raises(EngineFailed, match=r"pybullet: Cannot load URDF file\."):
        call(_ask_for_a_file_that_is_not_there, limit=60)


def test_a_missing_pybullet_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    assert ENGINE.version() == metadata.version("pybullet")
    monkeypatch.setattr(metadata, "version", nowhere)
    installed_version.cache_clear()
    simulate.require_installed.cache_clear()
    with pytest.raises(EngineMissing, match=r"pip install 'pybullet>=3\.2\.7'"):
        simulated("plane", 1e-3, {}, [Launch(0.2)])


def test_a_plate_that_is_never_reached_is_no_touch() -> None:
    syrup = {"ball": {"linearDamping": 10.0}}
    (impact,) = simulated("plane", 1e-3, syrup, [Launch(0.1, height=0.05)])  # stops after 10 mm
    assert impact.status is Status.NO_TOUCH


# --- beyond the first bounce
# ---------------------------------------------------------------------------


def test_a_train_of_bounces_is_followed_to_the_end() -> None:
    g, h, e, height = 9.80665, 1e-4, 0.5, 2e-3
    setting = Setting("pybullet", "test", h, restitution(e))
    path = ENGINE.trajectory(steel("plane", g), setting, Launch(0.0, height=height), 0.1)
    assert path.time[-1] == pytest.approx(0.1 - h)
    assert path.penetration[0] == pytest.approx(-height)
    hits = np.flatnonzero(path.force)
    assert hits[0] == pytest.approx(math.sqrt(2 * height / g) / h, abs=2)
    for hit in hits[:4]:
        assert path.rate[hit + 1] + g * h == pytest.approx(
            -e * path.rate[hit] + g * h, abs=2 * g * h
        )
    peaks = [path.penetration[a:b].min() for a, b in pairwise(hits[:4])]
    np.testing.assert_allclose(peaks, [-height * e ** (2 * n) for n in (1, 2, 3)], rtol=0.05)


def test_a_ball_set_down_rests_on_the_spring_that_carries_it() -> None:
    g, k, h = 9.80665, 1e5, 1e-4
    setting = Setting("pybullet", "test", h, spring_damper(k, 60.0, h))
    path = ENGINE.trajectory(steel("plane", g), setting, Launch(0.0, height=1e-9), 0.5)
    assert path.penetration[-1] == pytest.approx(MASS * g / k, rel=1e-6)
    assert path.force[-1] == pytest.approx(MASS * g, rel=1e-6)


def test_a_contact_of_more_steps_than_usual_is_no_rest() -> None:
    """A with_gravity ball stays 0.036 s on the plate, 36 000 steps of 1 µs, and then leaves."""
    with_gravity = replace(steel("plane"), mass=2e5)
    law = {"kind": "force", "alpha": 0.3, "stiffness": with_gravity.stiffness}
    (impact,) = ENGINE.run(
        with_gravity, Setting("pybullet", "law", 1e-6, {"law": law}), [Launch(0.3)]
    )
    assert impact.status is Status.PARTED, impact.reason
    assert impact.samples > 20_000
