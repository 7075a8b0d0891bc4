"""Tuning: choices, their descriptions, and that the pasted text does it in the plain engine."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from long_searches import long_search

from hcbench.cli import run
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.sim.rest import DIVERGED, Rest
from hcbench.system.errors import SettingError, UserError
from hcbench.terms.scene import load_scene
from hcbench.tuning.evaluate import held_out_launches
from hcbench.tuning.find import Match, candidates, tune
from hcbench.tuning.model import snippet

pytestmark = pytest.mark.usefixtures("tuned_once")

SCENE = load_scene("steel-plane")
ALPHA = 0.008 / 0.0254


def target(timestep: float, **changes: object) -> Target:
    law = HuntCrossley(SCENE.stiffness, ALPHA, SCENE.exponent)
    given: dict[str, object] = {
        "law": law, "mass": SCENE.mass, "timestep": timestep, "speed_min": 0.0254, "speed_max": 0.508,
    }  # fmt: skip
    return Target(**{**given, **changes})  # type: ignore[arg-type]


def test_held_out_launches_span_the_band_and_the_step() -> None:
    launches = held_out_launches(target(1e-3))
    speeds, phases = (
        np.array([getattr(one, name) for one in launches]) for name in ("speed", "phase")
    )
    assert speeds.min() == 0.0254
    assert speeds.max() == 0.508
    assert len(set(speeds[72:])) == len(set(phases[72:])) == len(launches) - 72 >= 400
    assert phases.min() < 0.01
    assert phases.max() > 0.99


@pytest.mark.parametrize(
    ("engine", "timestep", "match", "recipe"),
    [
        pytest.param("mujoco", 1e-6, "both", "staggered", marks=long_search),
        pytest.param(
            "mujoco", 1e-6, "restitution", "two-pair", marks=[pytest.mark.adhesion, long_search]
        ),
        ("mujoco", 1e-3, "restitution", "compliant-pairs"),
        pytest.param("pybullet", 1e-3, "restitution", "restitution", marks=long_search),
    ],
)
def test_auto_takes_the_simplest_that_holds_under_gravity_and_says_why(
    engine: str, timestep: float, match: Match, recipe: str
) -> None:
    tuned = tune(engine, target(timestep, gravity=9.81), SCENE, match=match)
    assert tuned.recipe.name == recipe
    assert tuned.rests
    assert "steps" in tuned.why or "no native setting holds within 0.05" in tuned.why


def test_bullets_own_contact_is_chosen_for_the_loop_under_gravity() -> None:
    ((chosen, why),) = candidates("pybullet", target(1e-6, gravity=9.81), SCENE, "both")
    assert chosen.name == "staggered"
    assert "steps" in why


CHOOSE = """
import sys
from hcbench.laws.force import HuntCrossley
from hcbench.terms.scene import load_scene
from hcbench.tuning.find import candidates
from hcbench.recipes.target import Target

scene, alpha, timestep, match = load_scene("steel-plane"), *sys.argv[1:]
target = Target(HuntCrossley(scene.stiffness, float(alpha)), scene.mass, float(timestep), 0.0254, 0.508)
print(candidates("rk4", target, scene, match)[0][0].name)
"""


@pytest.mark.parametrize(
    ("arguments", "recipe"),
    [(["0.3", "1e-6", "both"], "law"), (["0.0", "1e-3", "restitution"], "bounce")],
)
def test_recipes_of_an_engine_written_elsewhere_are_chosen_by_their_roles(
    monkeypatch: pytest.MonkeyPatch, arguments: list[str], recipe: str
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1] / "outside"))
    command = [sys.executable, "-c", CHOOSE, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == f"{recipe}\n"


@long_search
def test_in_a_true_cup_the_rows_only_push() -> None:
    cup = load_scene("steel-cup")
    ((chosen, _),) = candidates("mujoco", target(1e-6), cup, "both")
    assert chosen.name == "staggered-push"
    verdict = tune("mujoco", target(1e-6), cup, match="both").evaluation
    assert verdict.max_error < 1e-4
    assert verdict.loop_rms < 0.005


def test_a_constant_is_served_by_one_step_and_not_by_springs() -> None:
    wanted = target(1e-3, reading="points", points=((0.1, 0.8),))
    tuned = tune("mujoco", wanted, SCENE)
    assert tuned.recipe.name == "impulse"
    assert tuned.evaluation.max_error < 1e-12


def test_a_loop_that_the_step_cannot_see_is_refused_with_the_step_that_can() -> None:
    with pytest.raises(SettingError, match=r"Use a step of 1\.6e-05 s or less"):
        candidates("mujoco", target(1e-3), SCENE, "loop")


def test_a_loop_that_no_native_setting_has_names_the_plug_in() -> None:
    with pytest.raises(SettingError, match="plug-in"):
        candidates("pybullet", target(1e-6), load_scene("steel-cup"), "loop")


@pytest.mark.needs_engine("pybullet")
def test_an_integrator_that_breaks_a_recipe_is_refused_and_others_serve() -> None:
    with pytest.raises(SettingError, match="RK4"):
        tune("mujoco", target(1e-3), SCENE, recipe="impulse", integrator="RK4")
    with pytest.raises(SettingError, match="expected none: the engine has one alone"):
        tune("pybullet", target(1e-3), SCENE, integrator="RK4")
    served = tune("mujoco", target(1e-3), SCENE, recipe="impulse", integrator="implicitfast")
    assert served.evaluation.max_error < served.evaluation.constant_error + 1e-6


def test_an_unknown_recipe_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UserError, match="impulse"):
        tune("mujoco", target(1e-3), SCENE, recipe="wish")


PLAIN_MUJOCO = """
import sys, mujoco
model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
h, out = model.opt.timestep, []
for speed in (0.06, 0.27, 0.45):
    for phase in (0.1, 0.35, 0.6, 0.85):
        mujoco.mj_resetData(model, data)
        data.qpos[2] += (2 + phase) * h * speed
        data.qvel[2] = -speed
        start = data.qpos[2]
        for _ in range(1000000):
            mujoco.mj_step(model, data)
            if data.qvel[2] > 0 and data.qpos[2] > start:
                break
        out.append(f"{speed} {float(data.qvel[2] / speed)!r}")
print("\\n".join(out))
"""


@pytest.mark.parametrize(
    ("recipe", "timestep", "within"),
    [
        pytest.param("staggered", 1e-6, 3e-5, marks=[pytest.mark.adhesion, long_search]),
        pytest.param("staggered", 1e-3, 1e-3, marks=pytest.mark.adhesion),
        ("impulse", 1e-3, None),
    ],
)
def test_the_written_scene_does_in_plain_mujoco_what_tune_says(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    recipe: str,
    timestep: float,
    within: float | None,
) -> None:
    scene = tmp_path / "tuned.xml"
    arguments = [
        "tune",
        "mujoco",
        "--alpha",
        "0.008 s/in",
        "--timestep",
        repr(timestep),
        "--recipe",
        recipe,
    ]
    # A recipe that is asked for by name is written, even one that tune itself
    # would not recommend: exit 1.
    assert run([*arguments, "--gravity", "0", "--write-scene", str(scene), "--json"]) in (0, 1)
    said = json.loads(capsys.readouterr().out)
    done = subprocess.run(
        [sys.executable, "-c", PLAIN_MUJOCO, str(scene)], capture_output=True, text=True, check=True
    )
    v, e = np.array([line.split() for line in done.stdout.splitlines()], dtype=float).T
    error = np.abs(e - closed_form.restitution(ALPHA, v)).max()
    assert error <= said["evaluation"]["max_error"] * 1.2 + 1e-9
    if within is not None:
        assert error < within


@pytest.mark.needs_engine("pybullet")
def test_the_written_script_does_in_plain_pybullet_what_tune_says(tmp_path: Path) -> None:
    tuned = tune("pybullet", target(1e-3), SCENE)
    (tmp_path / "drop.py").write_text(
        registry.engine("pybullet").script(tuned.scene, tuned.setting), encoding="utf-8"
    )
    done = subprocess.run(
        [sys.executable, "drop.py"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    rows = [line.split() for line in done.stdout.splitlines() if line[:2] == "0."]
    assert len(rows) == 6
    assert all(abs(float(e) - tuned.evaluation.constant) < 1e-12 for _, e in rows)


@pytest.mark.parametrize("recipe", ["hunt-crossley", "restitution-law"])
def test_a_plug_in_pastes_as_mjcf(recipe: str) -> None:
    from hcbench.contact.mujoco import load
    from hcbench.engines.mujoco.scene.mjcf import model_xml
    from hcbench.terms.setting import Setting

    wanted = target(1e-6 if recipe == "hunt-crossley" else 1e-3)
    setting = registry.recipe(f"mujoco.{recipe}")(wanted)
    plain = model_xml(SCENE, Setting("mujoco", "stock", setting.timestep))
    pasted = snippet(setting, "plane")
    load()
    model = mujoco.MjModel.from_xml_string(plain.replace("</mujoco>", f"{pasted}</mujoco>"))
    data = mujoco.MjData(model)
    data.qpos[2] += 2.3 * setting.timestep * 0.3
    data.qvel[2] = -0.3
    start = data.qpos[2]
    while not (data.qvel[2] > 0 and data.qpos[2] > start):
        mujoco.mj_step(model, data)
    assert data.qvel[2] / 0.3 == pytest.approx(float(closed_form.restitution(ALPHA, 0.3)), abs=1e-7)


@pytest.mark.usefixtures("nothing_kept")
@pytest.mark.parametrize("recipe", ["staggered", "two-pair"])
def test_a_mujoco_without_adhesion_is_one_line_that_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], recipe: str
) -> None:
    monkeypatch.delattr(mujoco.MjModel, "pair_adhesion", raising=False)
    arguments = [
        "tune",
        "mujoco",
        "--alpha",
        "0.008 s/in",
        "--timestep",
        "1e-3",
        "--recipe",
        recipe,
    ]
    assert run(arguments) == 3
    caught = capsys.readouterr()
    assert caught.out == ""
    said = f"mujoco {mujoco.__version__}: has no adhesion; expected 3.11 or later"
    assert caught.err == f"hcbench: {said}. Try: pip install mujoco --upgrade\n"


@pytest.mark.parametrize("arguments", [["mujoco"], ["pybullet", "--recipe", "restitution"]])
def test_failed_launches_are_never_a_verdict(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    fast = ["--speeds", "1e7:1e8", "--beyond-bounds"]
    assert run(["tune", *arguments, "--restitution", "0.9", "--timestep", "1 ms", *fast]) == 3
    caught = capsys.readouterr()
    assert caught.out == ""
    assert "launches gave no restitution" in caught.err


@pytest.mark.needs_engine("pybullet")
def test_a_limit_passed_exits_1_and_prints_its_best_all_the_same(
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = ["tune", "pybullet", "--alpha", "0.008 s/in", "--timestep", "1e-3", "--constant"]
    assert run([*arguments, "--gravity", "0", "--max-error", "0.01"]) == 1
    caught = capsys.readouterr()
    assert "restitution=0.92693" in caught.out
    assert "0.01 or less" in caught.err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "--alpha"),
        (["--alpha", "0.1", "--restitution", "0.5"], "--alpha and --restitution"),
        (["--restitution", "1.5"], "restitution"),
        (["--restitution=-0.1"], "restitution"),
        (["--points", "0.1:0.8, 0.2:0.9 m/s"], "not rising"),
        (["--points", "0.1=0.8"], "--points"),
        (["--alpha", "0.3", "--timestep", "0"], "--timestep"),
        (["--alpha", "0.3", "--mass", "-1 lb"], "--mass"),
        (["--alpha", "3", "--target", "linear"], "Keep below"),
        (["--alpha", "0.3", "--recipe", "magic"], "magic"),
        (["--alpha", "0.3", "--match", "loop"], "Use a step of"),
        (["--alpha", "0.3", "--scene", "moon"], "moon"),
        (["--alpha", "0.3", "--exponent", "1"], "--stiffness"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(
    capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    given = ["tune", "mujoco", *arguments]
    if "--timestep" not in arguments:
        given += ["--timestep", "1e-3"]
    assert run(given) == 2
    caught = capsys.readouterr()
    assert len(caught.err.splitlines()) == 1
    assert says in caught.err


def test_a_target_of_measured_pairs_is_read_from_a_csv(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "measured.csv"
    file.write_text("speed [in/s],restitution\n16,0.88\n4,0.97\n", encoding="utf-8")
    asked = ["tune", "mujoco", "--points", str(file), "--timestep", "1e-3", *FRICTIONLESS]
    assert run([*asked, "--max-error", "0.1", "--json"]) == 0
    target_json = json.loads(capsys.readouterr().out)["target"]
    assert np.array(target_json["points"]) == pytest.approx(
        np.array([[0.1016, 0.97], [0.4064, 0.88]])
    )


# `impulse`, which serves without friction alone, in the fewest words.
FRICTIONLESS = ["--recipe", "impulse", "--friction", "0"]
PAIRS = "4:0.969, 8:0.94, 12:0.912, 16:0.886 in/s"  # e of (16) for 0.008 s/in, to three digits


@pytest.mark.parametrize(
    ("speeds", "band"),
    [([], (0.1016, 0.4064)), (["--speeds", "2:20 in/s"], (0.0508, 0.508))],
)
def test_pairs_are_judged_over_their_own_span_unless_an_option_says_otherwise(
    capsys: pytest.CaptureFixture[str], speeds: list[str], band: tuple[float, float]
) -> None:
    arguments = [
        "tune",
        "mujoco",
        "--points",
        PAIRS,
        "--timestep",
        "1e-4",
        *FRICTIONLESS,
        "--json",
    ]
    assert run([*arguments, *speeds]) == 0
    asked = json.loads(capsys.readouterr().out)["target"]
    assert (asked["speed_min"], asked["speed_max"]) == pytest.approx(band)


@pytest.mark.adhesion
def test_measured_pairs_get_an_e_that_falls_as_theirs_at_a_coarse_step_too(
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked = [
        "tune",
        "mujoco",
        "--points",
        PAIRS,
        "--timestep",
        "1e-4",
        "--max-error",
        "0.008",
        "--corners",
        "1",
        "--json",
    ]
    assert run(asked) == 0
    assert json.loads(capsys.readouterr().out)["recipe"] == "compliant-pairs"


def test_pairs_near_the_law_are_given_its_alpha_and_no_plug_in_that_needs_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked = ["tune", "mujoco", "--timestep", "1e-4", *FRICTIONLESS, "--points"]
    assert run([*asked, PAIRS]) == 0
    printed = capsys.readouterr().out
    assert "restitution-law" not in printed
    assert "try --alpha 0.31" in printed
    assert "--recipe compliant-pairs" in printed
    assert run([*asked, "0.1:0.9, 0.2:0.3 m/s"]) == 1  # no one e is near such a fall
    assert "--alpha" not in capsys.readouterr().out  # no α has such a fall


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["--points", PAIRS], "--points: 4 pairs of v and e, which 'staggered' does not serve"),
        (["--points", PAIRS], "Use `two-pair` or `soft` for another restitution. α = 0.31"),
        (["--restitution", "0.8"], "--restitution: one e for all speeds, which 'staggered'"),
        (["--alpha", "0.3", "--target", "linear"], "--target: 1 - α v, which 'staggered'"),
    ],
)
def test_what_a_recipe_does_not_serve_is_said_in_the_users_words(
    capsys: pytest.CaptureFixture[str], given: list[str], says: str
) -> None:
    assert run(["tune", "mujoco", *given, "--timestep", "1e-4", "--recipe", "staggered"]) == 2
    assert says in capsys.readouterr().err


def test_pairs_have_no_loop(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["tune", "mujoco", "--points", PAIRS, "--timestep", "1e-6", "--match", "loop"]) == 2
    assert "--points: 4 pairs of v and e, with --match loop" in capsys.readouterr().err


@pytest.mark.adhesion
def test_notes_of_a_softened_contact_do_not_contradict_what_was_measured(
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = [
        "tune",
        "mujoco",
        "--alpha",
        "0.008 s/in",
        "--timestep",
        "1e-3",
        "--recipe",
        "staggered",
    ]
    assert run([*arguments, "--gravity", "0"]) == 1
    caught = capsys.readouterr()
    printed = caught.out
    assert "'staggered': deep" in caught.err
    assert "mujoco staggered: the given recipe" in printed
    assert "99.7 % of the largest force" in printed
    assert (
        "- under gravity it rests 9.7e-04 m deep, 1.9 % of the radius; --recipe impulse" in printed
    )
    assert (
        "- With the law's own stiffness, a body rests about as deep as by the law, without drift."
        in printed
    )


def test_what_keeps_a_body_from_resting_is_named_and_nothing_else() -> None:
    radius = 0.05
    assert Rest(1e-6, 1e-7, 1e-3, 0.5).failures(radius, 0.0) == []
    (sinks,) = Rest(1e-6, 1e-4, 0.0, 0.0).failures(radius, 0.0)
    assert sinks == "it still sinks at 1.0e-04 m/s when the test ends"
    (deep,) = Rest(1e-3, 0.0, 1e-3, 0.5).failures(radius, 0.0)
    assert "2 % of the radius" in deep
    (moves,) = Rest(1e-6, 0.0, 1e-3, 1.0).failures(radius, 0.0)
    assert "keeps on moving" in moves
    assert DIVERGED.failures(radius, 0.0) == ["it diverges"]
