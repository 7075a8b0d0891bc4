"""MJX and MuJoCo Warp simulate what `tune mujoco` writes as it is meant, or refuse it by name."""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_models import HOPPER, PAIR, SPRING, ball

from hcbench import Measurement, cli
from hcbench.benchmark.batch import Batch, run_batch
from hcbench.benchmark.plan import make_plan
from hcbench.benchmark.study import load_study
from hcbench.laws.force import HuntCrossley
from hcbench.measuring.measure import measure
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.sim.columns import Launches
from hcbench.sim.convert import convert
from hcbench.sim.scripted import require_motion
from hcbench.system.errors import CannotRun, SceneError, SettingError, UserError
from hcbench.terms import units
from hcbench.terms.impact import Floats, Launch
from hcbench.terms.scene import Scene, load_scene
from hcbench.terms.setting import Setting
from hcbench.tuning.ask import tune

DOCS_MODEL = (
    Path(__file__).parents[2] / "examples" / "outside" / "mujoco_docs.xml"
)  # of docs/reference/answers.md
EXAMPLE = Path(__file__).parents[2] / "examples" / "study.toml"
PLANE = load_scene("steel-plane")
HEAVY = dataclasses.replace(PLANE, gravity=9.80665)
SPEEDS, PHASES = (0.031, 0.13, 0.37, 0.5), (0.07, 0.31, 0.62, 0.88)  # of no search or other test
DAMPED = PAIR.format('solref="-90000 -200" friction=".3 .3 .005 .0001 .0001"')
LAUNCHES = [Launch(v, p) for v in SPEEDS for p in PHASES]


def target(timestep: float) -> Target:
    law = HuntCrossley(PLANE.stiffness, 0.008 / units.INCH)
    return Target(law, PLANE.mass, timestep, 0.0254, 0.508)


def restitutions(setting: Setting, scene: Scene = PLANE) -> tuple[Floats, Floats]:
    """Speeds and e."""
    impacts = registry.engine(setting.engine).run(scene, setting, LAUNCHES)
    return np.array([i.speed_in for i in impacts]), np.array([i.restitution for i in impacts])


def shared_setting(recipe: str, engine: str, timestep: float) -> Setting:
    """MuJoCo's own setting, in another engine."""
    return dataclasses.replace(registry.recipe(f"mujoco.{recipe}")(target(timestep)), engine=engine)


@pytest.mark.needs_engine
@pytest.mark.parametrize(("engine", "within"), [("mjx", 3e-6), ("mujoco-warp", 1e-6)])
def test_the_bounce_in_one_step_has_the_restitution_asked(engine: str, within: float) -> None:
    _, e = restitutions(registry.recipe(f"{engine}.impulse")(target(1e-3)))
    asked = (target(1e-3).restitution(0.0254) + target(1e-3).restitution(0.508)) / 2
    assert np.abs(e - asked).max() < within


@pytest.mark.needs_engine
@pytest.mark.parametrize(("engine", "within"), [("mjx", 5e-6), ("mujoco-warp", 1e-6)])
def test_each_impact_is_given_its_own_restitution_under_gravity_too(
    engine: str, within: float
) -> None:
    setting = registry.recipe(f"{engine}.restitution-law")(target(1e-3))
    for scene, most in ((PLANE, within), (HEAVY, 1e-5)):  # whose energy has a height in float32
        v, e = restitutions(setting, scene)
        assert np.abs(e - target(1e-3).restitution(v)).max() < most


@pytest.mark.needs_engine
@pytest.mark.parametrize(
    ("recipe", "timestep", "within"),
    [
        ("mjx.staggered-push", 1e-3, 5e-4),
        ("mjx.hunt-crossley", 1e-5, 1e-3),
        ("mujoco-warp.staggered", 1e-5, 4e-3),
        ("mujoco-warp.staggered", 1e-3, 4.9e-4),
        ("mujoco-warp.two-pair", 1e-5, 4e-3),
        ("mujoco-warp.hunt-crossley", 1e-5, 4e-3),
    ],
)
def test_the_law_is_followed_as_far_as_float32_lets_it(
    recipe: str, timestep: float, within: float
) -> None:
    v, e = restitutions(registry.recipe(recipe)(target(timestep)))
    assert np.abs(e - target(timestep).restitution(v)).max() < within


@pytest.mark.needs_engine("mjx")
@pytest.mark.parametrize("recipe", ["two-pair", "staggered"])
def test_mjx_refuses_pairs_that_pull(recipe: str) -> None:
    with pytest.raises(SettingError, match=r"MJX drops a pair's adhesion.*`staggered-push`"):
        restitutions(shared_setting(recipe, "mjx", 1e-3))


@pytest.mark.needs_engine("mjx")
def test_mjx_refuses_an_impedance_that_float32_does_not_keep_and_takes_it_in_float64() -> None:
    setting = shared_setting("impulse", "mjx", 1e-3)
    with pytest.raises(SettingError, match=r"rounded in float32.*'float64'"):
        restitutions(setting)
    exact = dataclasses.replace(setting, options={**setting.options, "precision": "float64"})
    _, e = restitutions(exact)
    asked = target(1e-3).restitution(np.array([0.0254, 0.508])).mean()
    magnified = 1.0 / (
        1.0 - 0.9999
    )  # rounding, by what MJX divides by: MuJoCo's own e is right to 6e-16
    assert np.abs(e - asked).max() < 4 * magnified * np.finfo(float).eps


@pytest.mark.needs_engine
@pytest.mark.parametrize("engine", ["mjx", "mujoco-warp"])
def test_a_power_that_underflows_in_float32_is_refused(engine: str) -> None:
    row = {"solref": [-1e8, -100.0], "solimp": [1e-4, 0.9999, 1e-4, 0.5, 1017.0]}
    with pytest.raises(SettingError, match="power 1017 underflows in float32"):
        restitutions(Setting(engine, "mine", 1e-5, {"rows": [row]}))


def test_a_step_that_moves_no_float32_position_is_refused() -> None:
    require_motion(PLANE, 1e-6, 0.5, 32)
    require_motion(PLANE, 1e-9, 0.5, 64)
    with pytest.raises(SettingError, match=r"1e-08 s in float32.*Use 3e-08 s or more"):
        require_motion(PLANE, 1e-8, 0.5, 32)


def test_mujoco_warp_is_given_a_geom_for_each_pair() -> None:
    setting = registry.recipe("mujoco-warp.two-pair")(target(1e-3))
    root = ET.fromstring(registry.engine("mujoco-warp").script(PLANE, setting))
    pairs = [(pair.get("geom1"), pair.get("geom2")) for pair in root.findall("contact/pair")]
    assert len(pairs) == len(set(pairs)) > 1
    names = {geom.get("name"): geom.get("mass") for geom in root.iter("geom")}
    assert [names[first] for first, _ in pairs] == [None, *["0"] * (len(pairs) - 1)]
    assert "massless copy" in registry.engine("mujoco-warp").snippet(setting, "plane")


def test_convert_says_solref_for_both() -> None:
    rows = {
        row.system: row
        for row in convert(alpha=0.3, speed=0.2, timestep=1e-3).rows
        if row.parameter == "solref"
    }
    assert rows["MJX"].value == rows["MuJoCo Warp"].value == rows["MuJoCo"].value
    assert "0.9 0.9" in rows["MJX"].note


@pytest.mark.needs_engine
@pytest.mark.parametrize(
    ("recipe", "more"),
    [
        ("mjx.compliant", {}),
        ("mujoco-warp.compliant", {}),
        ("mjx.compliant-pairs", {"adhesive": False}),
        pytest.param("mujoco-warp.compliant-pairs", {}, marks=pytest.mark.adhesion),
    ],
)
def test_contacts_of_a_few_steps_bounce_under_gravity_as_in_mujoco(
    recipe: str, more: dict[str, bool]
) -> None:
    made_for = dataclasses.replace(target(1e-3), gravity=HEAVY.gravity)
    _, e = restitutions(registry.recipe(recipe)(made_for), HEAVY)
    mujocos = registry.recipe(recipe.replace(recipe.partition(".")[0], "mujoco"))
    setting = Setting("mujoco", "c", 1e-3, mujocos.function(made_for, "Euler", **more))
    impacts = registry.engine("mujoco").run(HEAVY, setting, LAUNCHES)
    assert e == pytest.approx([impact.restitution for impact in impacts], abs=2e-4)


def measured(model: str, pair: str, engine: str, **asked: Any) -> Measurement:
    """A user's model."""
    options = {"speeds": [0.07, 0.41, 1.3], "phases": [0.2, 0.8], **asked}
    return measure(model, pair, engine=engine, **options)


def scene_xml(engine: str, recipe: str, timestep: float = 1e-3) -> str:
    """The scene that `tune` writes for an engine."""
    setting = registry.recipe(f"{engine}.{recipe}")(
        dataclasses.replace(target(timestep), gravity=HEAVY.gravity)
    )
    return registry.engine(engine).script(HEAVY, setting)


@pytest.mark.needs_engine
@pytest.mark.parametrize("engine", ["mjx", "mujoco-warp"])
@pytest.mark.parametrize("model", ["compliant", "staggered-push", "robot"])
def test_a_users_model_bounces_as_in_mujoco_as_far_as_float32_lets_it(
    model: str, engine: str
) -> None:
    xml, pair = (
        (HOPPER, "foot,floor") if model == "robot" else (scene_xml(engine, model), "ball,plate")
    )
    theirs = measured(xml, pair, engine)
    assert (theirs.facts.engine, theirs.facts.version) == (
        engine,
        registry.engine(engine).version(),
    )
    own = measured(xml, pair, "mujoco")
    for one, other in zip(theirs.impacts, own.impacts, strict=True):
        assert one.restitution == pytest.approx(other.restitution, abs=5e-4)
        assert one.samples == other.samples
        assert one.force_max == pytest.approx(other.force_max, rel=2e-3)
    assert [cause.code for cause in theirs.causes] == [cause.code for cause in own.causes]


@pytest.mark.needs_engine
@pytest.mark.parametrize(
    ("engine", "recipe", "code", "words"),
    [
        ("mjx", "two-pair", "adhesion-dropped", "MJX drops a pair's adhesion"),
        ("mjx", "impulse", "impedance-rounding", "is rounded in float32"),
        ("mujoco-warp", "", "pairs-dropped", "keeps one of several pairs"),
    ],
)
def test_what_a_users_model_loses_is_named(engine: str, recipe: str, code: str, words: str) -> None:
    xml = scene_xml("mujoco", recipe) if recipe else ball(pairs=SPRING + DAMPED)
    found = measured(xml, "ball,plate", engine, speeds=0.41, phases=[0.5])
    (cause,) = [cause for cause in found.causes if cause.code == code]
    assert words in cause.title
    unlike = [cause.code for cause in found.causes if cause.code == "unlike-mujoco"]
    assert unlike == ([] if recipe == "impulse" else ["unlike-mujoco"])


@pytest.mark.needs_engine
@pytest.mark.parametrize("engine", ["mjx", "mujoco-warp"])
def test_what_an_engine_does_not_have_is_said_in_one_line(engine: str) -> None:
    xml = HOPPER.replace('timestep=".001"', 'solver="PGS"')
    with pytest.raises(SceneError, match=r"model: .*PGS.*; expected what .* has of MuJoCo"):
        measured(xml, "foot,floor", engine)


# At 2 ms under gravity, α = 0.3 s/m, 0.0314 ... 0.508 m/s: kind -> largest error of e, as the
# documentation of engines has it.
KINDS = {
    "mjx": {"exact": 1.9e-5, "settings": 0.068, "constant": 0.14},
    "mujoco-warp": {"exact": 1.9e-5, "settings": 0.070, "constant": 0.14},
}


@pytest.mark.needs_engine
@pytest.mark.parametrize("engine", KINDS)
def test_the_kinds_of_settings_that_exist_gain_no_energy_in_float32(engine: str) -> None:
    answer = tune(engine, timestep=2e-3, alpha=0.3, friction=0.0)
    found = {choice.kind: choice.max_error for choice in answer.choices}
    assert found == {kind: pytest.approx(error, rel=0.1) for kind, error in KINDS[engine].items()}
    for choice in answer.choices:
        assert choice.sphere
        assert choice.rests
        assert choice.energy.startswith("energy never grew in")
        assert choice.passivity is not None
        # Boxes and the drops of a ball are MuJoCo's, whose contact these rows have.
        is_law = choice.kind == "exact"
        assert choice.passivity.scenes == (88 if is_law else 88 + 616)
        assert choice.flat is (None if is_law else False)
    never = {each.setting: each.why for each in answer.never}
    assert "gains energy" in never["spring-damper"]
    assert "restitution-law" not in never


@pytest.mark.needs_engine
@pytest.mark.parametrize("engine", ["mjx", "mujoco-warp"])
def test_settings_keep_friction_and_what_slides_on_them_moves_as_in_mujoco(engine: str) -> None:
    """Oblique launches by the engine's own steps: `tune` has them run in MuJoCo."""
    rubbing = dataclasses.replace(target(2e-3), gravity=HEAVY.gravity, friction=1.0)
    setting = registry.recipe(f"{engine}.compliant-pairs")(rubbing)
    assert 'condim="3"' in registry.engine(engine).snippet(setting, "plane")
    xml = registry.engine(engine).script(HEAVY, setting)
    found = [measured(xml, "ball,plate", name, angle="0, 45 deg") for name in (engine, "mujoco")]
    own, mujocos = (measurement.impacts for measurement in found)
    assert len(own) == len(mujocos)
    for ours, theirs in zip(own, mujocos, strict=True):
        assert ours.restitution == pytest.approx(theirs.restitution, abs=2e-4)
        if ours.tangential is not None and theirs.tangential is not None:
            assert ours.tangential.impulse == pytest.approx(theirs.tangential.impulse, abs=1e-4)
    assert any(impact.tangential is not None for impact in own)


def test_what_slides_on_rows_is_judged_in_mujoco_and_on_a_law_nowhere() -> None:
    for engine in ("mjx", "mujoco-warp"):
        adapter = registry.adapter(engine)
        rows = registry.recipe("mujoco.compliant")(target(1e-3)).options
        there = adapter.oblique_setting(Setting(engine, "compliant", 1e-3, rows))
        assert there is not None
        assert there.engine == "mujoco"
        law = {"law": {"kind": "restitution", "alpha": 0.3}}
        assert adapter.oblique_setting(Setting(engine, "restitution-law", 1e-3, law)) is None


@pytest.mark.needs_engine("mjx")
def test_a_contact_without_damping_keeps_all_in_mjx_too(capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["measure", str(DOCS_MODEL), "--speeds", "1 m/s", "--phases", "1", "--engine"]
    rows = []
    for engine in ("mujoco", "mjx"):
        assert cli.run([*asked, engine]) == 0
        rows.append(
            [line.split() for line in capsys.readouterr().out.splitlines() if "e+00" in line]
        )
    assert rows[0] == rows[1]
    assert "1.0007" in rows[0][0]


def on_device(setting: Setting, device: str = "cpu") -> Setting:
    return dataclasses.replace(setting, options={**setting.options, "device": device})


@pytest.mark.needs_engine
@pytest.mark.parametrize(
    ("recipe", "timestep"),
    [
        ("mjx.impulse", 1e-3),
        ("mjx.spring-damper", 1e-5),
        ("mujoco-warp.impulse", 1e-3),
        ("mujoco-warp.restitution-law", 1e-3),
        ("mujoco-warp.spring-damper", 1e-5),
    ],
)
@pytest.mark.parametrize("scene", [PLANE, HEAVY], ids=["no gravity", "gravity"])
def test_what_is_read_on_the_device_is_what_is_read_of_every_step(
    recipe: str, timestep: float, scene: Scene
) -> None:
    setting = registry.recipe(recipe)(target(timestep))
    engine, launches = (
        registry.engine(setting.engine),
        LAUNCHES * 20,
    )  # more than one recorded batch
    kept, read = (engine.run(scene, s, launches) for s in (setting, on_device(setting)))
    assert [impact.status for impact in kept] == [impact.status for impact in read]
    assert [impact.samples for impact in kept] == [impact.samples for impact in read]
    for name, within in (("restitution", 1e-6), ("penetration_max", 1e-4), ("force_max", 1e-4)):
        a, b = (np.array([getattr(impact, name) for impact in each]) for each in (kept, read))
        assert np.abs(a - b).max() < within * a.max(), name
    assert all(impact.loop is None for impact in read)


@pytest.mark.needs_engine("mujoco-warp")
def test_loops_are_kept_of_the_impacts_that_are_named() -> None:
    setting = registry.recipe("mujoco-warp.spring-damper")(target(1e-5))
    sent = Launches.of(LAUNCHES)
    kept, read = (run_batch(Batch(PLANE, s, sent, [2, 11])) for s in (setting, on_device(setting)))
    assert [i for i, _ in read.loops] == [2, 11]
    for (_, one), (_, other) in zip(kept.loops, read.loops, strict=True):
        assert np.allclose(one.time, other.time)
        assert np.abs(one.force - other.force).max() < 1e-4 * one.force.max()


@pytest.mark.needs_engine
@pytest.mark.parametrize("engine", ["mjx", "mujoco-warp"])
def test_a_hundred_thousand_launches_are_one_batch(engine: str) -> None:
    setting = on_device(registry.recipe(f"{engine}.impulse")(target(1e-3)))
    table = np.zeros((100_000, 8))
    table[:, 0], table[:, 1], table[:, 2] = np.linspace(0.03, 0.5, len(table)), 0.5, np.nan
    impacts = registry.engine(engine).run_columns(PLANE, setting, Launches.of_table(table))
    assert impacts.is_measured.all()
    e = impacts.restitution
    assert np.abs(e - e[0]).max() < 5e-4


@pytest.mark.needs_engine
@pytest.mark.parametrize("engine", ["mjx", "mujoco-warp"])
def test_a_gpu_that_is_not_there_is_named_before_anything_runs(engine: str) -> None:
    try:
        registry.engine(engine).require_device("gpu")
    except CannotRun as error:
        assert str(error).startswith(f"{engine} device: no GPU is visible to ")
    registry.engine(engine).require_device("cpu")


@pytest.mark.parametrize("engine", ["mjx", "mujoco-warp"])
def test_another_device_is_refused(engine: str) -> None:
    setting = Setting(engine, "mine", 1e-3, {"device": "tpu"})
    with pytest.raises(SettingError, match=r"option 'device': 'tpu'; expected 'cpu' or 'gpu'"):
        registry.adapter(engine).device_of(setting)


def test_a_study_of_an_engine_without_a_choice_is_refused() -> None:
    study = dataclasses.replace(load_study(EXAMPLE), device="gpu")
    with pytest.raises(UserError, match=r"--device: 'gpu' for mujoco; expected a study of mjx and"):
        make_plan(study)
