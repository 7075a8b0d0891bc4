"""MuJoCo's plug-ins: named in a model, copied, saved, and with oblique or many impacts at once."""

from __future__ import annotations

import copy
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pytest
from contact_scenes import (
    BOX,
    HALF,
    RADIUS,
    Scene,
    add_body,
    before_turning,
    cradle,
    full_mass,
    pile,
    plugged,
    rack,
    require_plugins_in_specs,
    row,
    run,
    stack,
    tumbling,
    world,
)
from covering import every_pair

from hcbench.cli import run as run_command
from hcbench.cli.engines import plugin
from hcbench.contact import mujoco as contact
from hcbench.contact.mujoco import (
    ConstantRestitution,
    Friction,
    HuntCrossley,
    Restitution,
    TouchSpeedLaw,
)
from hcbench.engines.mujoco.plugin import law_snippet
from hcbench.engines.mujoco.scene.mjcf import model_xml
from hcbench.laws import closed_form
from hcbench.laws.published import LAWS, Flores
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.system import compiler as _compile
from hcbench.system.errors import CannotRun, SettingError, UserError
from hcbench.terms.scene import Material, load_scene

try:
    from mujoco import batch
except (ImportError, AttributeError):
    batch = None

ALPHA = 0.008 / 0.0254
LAW = HuntCrossley(3.4064e10, ALPHA)
ELASTIC = ConstantRestitution(1.0)
FORCE_KEYS = {"stiffness": "3.4064e10", "alpha": "0.315"}
BALL = """<mujoco><option timestep="{h}" gravity="0 0 0">{option}</option>{extension}<worldbody>
  <geom name="plate" type="plane" size="1 1 1" condim="1"/>
  <body name="ball" pos="0 0 .0508"><freejoint/>{inside}
  <geom name="ball" size=".0508" mass=".45359237" condim="1"/></body></worldbody>{rest}</mujoco>"""
EXCLUDE = '<contact><exclude body1="world" body2="ball"/></contact>'


@pytest.fixture(autouse=True, scope="module")
def _loaded() -> None:
    contact.load()


def xml(
    plugin: str,
    keys: dict[str, str],
    h: float = 1e-5,
    rest: str = "",
    option: str = "",
    inside: str = "",
) -> str:
    """A ball over a plate with a plug-in, as its user writes it."""
    pair = {} if {"geom1", "body1", "tendon"} & keys.keys() else {"geom1": "ball", "geom2": "plate"}
    config = "".join(
        f'<config key="{key}" value="{value}"/>' for key, value in (pair | keys).items()
    )
    instance = f'<instance name="bounce">{config}</instance>'
    extension = f'<extension><plugin plugin="{plugin}">{instance}</plugin></extension>'
    return BALL.format(h=h, extension=extension, rest=rest, option=option, inside=inside)


def compiled(*args: Any, **more: Any) -> Any:
    return mujoco.MjModel.from_xml_string(xml(*args, **more))


def launched(model: Any, speed: float = 0.3) -> Any:
    data = mujoco.MjData(model)
    data.qpos[2] += 2.3 * model.opt.timestep * speed
    data.qvel[2] = -speed
    return data


def bounce(model: Any, speed: float = 0.3, steps: int = 60) -> float:
    data = launched(model, speed)
    mujoco.mj_step(model, data, nstep=steps)
    return float(data.qvel[2] / speed)


def e(speed: float = 0.3, alpha: float = 0.315) -> float:
    return float(closed_form.restitution(alpha, speed))


# Named in MJCF


@pytest.mark.parametrize("inside", ["", '<plugin instance="bounce"/>'])
@pytest.mark.parametrize("pair", [{}, {"body1": "ball", "body2": "world"}], ids=["geoms", "bodies"])
def test_a_force_law_is_declared_in_plain_mjcf(pair: dict[str, str], inside: str) -> None:
    model = compiled("hcbench.hunt_crossley", FORCE_KEYS | pair, rest=EXCLUDE, inside=inside)
    assert bounce(model) == pytest.approx(e(), abs=1e-6)


def test_a_restitution_law_keeps_the_engines_own_contact_on() -> None:
    model = compiled("hcbench.restitution", {"alpha": "0.315"}, h=1e-3)
    assert bounce(model) == pytest.approx(e(), abs=1e-12)
    model = compiled("hcbench.restitution", {"restitution": "0.8"}, h=1e-3)
    assert bounce(model) == pytest.approx(0.8, abs=1e-12)
    model = compiled("hcbench.restitution", {"alpha": "0.315", "reading": "linear"}, h=1e-3)
    assert bounce(model) == pytest.approx(1 - 0.315 * 0.3, abs=1e-12)


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.slug)
def test_laws_that_came_after_are_named_by_their_slug(law: Any) -> None:
    keys = {"stiffness": "3.4064e10", "law": law.slug, "restitution": "0.7"}
    model = compiled("hcbench.hunt_crossley", keys, rest=EXCLUDE)
    assert bounce(model, steps=80) == pytest.approx(
        TouchSpeedLaw(law, 3.4064e10, 0.7).delivered, abs=1e-5
    )


@pytest.mark.parametrize(
    ("plugin", "keys", "rest", "says"),
    [
        ("hunt_crossley", {**FORCE_KEYS, "geom1": "bal"}, EXCLUDE, 'geom1.*no geom "bal"'),
        (
            "hunt_crossley",
            {**FORCE_KEYS, "geom1": "ball", "geom2": "ball"},
            EXCLUDE,
            "the same body",
        ),
        ("hunt_crossley", {"alpha": "0.3"}, EXCLUDE, '"stiffness" is missing'),
        (
            "hunt_crossley",
            {"stiffness": "1e9"},
            EXCLUDE,
            'needs "alpha", or "law" and "restitution"',
        ),
        ("hunt_crossley", {**FORCE_KEYS, "alpha": "-1"}, EXCLUDE, "alpha.*-1, needs 0"),
        (
            "hunt_crossley",
            {**FORCE_KEYS, "alpha": "much"},
            EXCLUDE,
            "not a number, and there is no <numeric>",
        ),
        ("hunt_crossley", FORCE_KEYS, "", '"ball" and "plate" is on as well: add <exclude'),
        (
            "hunt_crossley",
            {"stiffness": "1e9", "law": "florez", "restitution": ".8"},
            EXCLUDE,
            "no law.*only: first",
        ),
        (
            "hunt_crossley",
            {"stiffness": "1e9", "law": "flores", "restitution": "0"},
            EXCLUDE,
            "above 0",
        ),
        ("hunt_crossley", {**FORCE_KEYS, "tendon": "cup"}, EXCLUDE, 'no tendon "cup"'),
        ("restitution", {}, "", 'either "alpha" or "restitution"'),
        ("restitution", {"alpha": "1", "reading": "x"}, "", "needs law or linear"),
        ("restitution", {"restitution": "1.1"}, "", "needs 0 ... 1"),
        ("restitution", {"restitution": "1", "alfa": "1"}, "", "unrecognized attribute.*alfa"),
    ],
)
def test_a_mistake_in_a_config_is_reported_with_the_instances_name(
    plugin: str, keys: dict[str, str], rest: str, says: str
) -> None:
    with pytest.raises(ValueError, match=f"(?s){says}"):
        compiled(f"hcbench.{plugin}", keys, rest=rest)


PAIRS = {
    "geoms": {"geom1": "ball", "geom2": "plate"},
    "geoms turned round": {"geom1": "plate", "geom2": "ball"},
    "bodies": {"body1": "ball", "body2": "world"},
}


@pytest.mark.parametrize("second", PAIRS)
@pytest.mark.parametrize("first", PAIRS)
@pytest.mark.parametrize("plugin", ["hunt_crossley", "restitution"])
def test_two_laws_for_one_pair_are_refused(plugin: str, first: str, second: str) -> None:
    keys = FORCE_KEYS if plugin == "hunt_crossley" else {"restitution": "0.5"}
    instances = "".join(
        f'<instance name="{name}">'
        + "".join(f'<config key="{key}" value="{value}"/>' for key, value in config.items())
        + "</instance>"
        for name, config in (("one", keys | PAIRS[first]), ("two", keys | PAIRS[second]))
    )
    text = BALL.format(
        h=1e-3,
        option="",
        inside="",
        rest=EXCLUDE if plugin == "hunt_crossley" else "",
        extension=f'<extension><plugin plugin="hcbench.{plugin}">{instances}</plugin></extension>',
    )
    with pytest.raises(
        ValueError, match='"two": the geoms "plate" and "ball" have the law of instance "one"'
    ):
        mujoco.MjModel.from_xml_string(text)


@pytest.mark.skipif(
    not hasattr(mujoco.mjtDisableBit, "mjDSBL_DAMPER"), reason="one flag in this MuJoCo"
)
@pytest.mark.parametrize("plugin", ["hunt_crossley", "restitution"])
def test_flags_that_switch_plugins_off_are_refused(plugin: str) -> None:
    is_force = plugin == "hunt_crossley"
    keys = FORCE_KEYS if is_force else {"alpha": "0.3"}
    text = xml(f"hcbench.{plugin}", keys, h=1e-5, rest=EXCLUDE if is_force else "")
    for flags in ('spring="disable"', 'damper="disable"'):
        option = f"<option><flag {flags}/></option><worldbody>"
        bounce(mujoco.MjModel.from_xml_string(text.replace("<worldbody>", option)))
    option = '<option><flag spring="disable" damper="disable"/></option><worldbody>'
    with pytest.raises(ValueError, match="flags spring and damper are both"):
        mujoco.MjModel.from_xml_string(text.replace("<worldbody>", option))


@pytest.mark.skipif(
    not hasattr(mujoco.mjtIntegrator, "mjINT_DISCRETE"), reason="this MuJoCo has no such integrator"
)
def test_restitution_is_refused_where_it_would_be_wrong() -> None:
    text = xml("hcbench.restitution", {"alpha": "0.3"}, h=1e-3)
    text = text.replace("gravity=", 'integrator="discrete" gravity=')
    with pytest.raises((ValueError, mujoco.FatalError), match="integrator must be"):
        bounce(mujoco.MjModel.from_xml_string(text))


def test_a_step_too_coarse_is_warned_of_once(
    capfd: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log
    model = compiled("hcbench.hunt_crossley", FORCE_KEYS, h=1e-3, rest=EXCLUDE)
    warnings: list[str] = []
    mujoco.set_mju_user_warning(warnings.append)
    try:
        bounce(model)
    finally:
        mujoco.set_mju_user_warning(None)
    assert len(warnings) == 1
    assert "too coarse" in warnings[0]
    assert "hcbench.restitution" in warnings[0]


# In Python, by names


def spec(h: float = 1e-5, more: str = "") -> Any:
    return mujoco.MjSpec.from_string(
        BALL.format(h=h, extension="", rest=more, option="", inside="")
    )


def test_a_law_is_added_to_a_spec_and_stays_in_its_xml() -> None:
    require_plugins_in_specs()
    made = spec()
    name = contact.add_to_spec(made, LAW, geoms=("ball", "plate"), friction=Friction(0.3, 0.2))
    model = made.compile()
    again = mujoco.MjModel.from_xml_string(made.to_xml())
    for one in (model, again):
        assert bounce(one) == pytest.approx(e(alpha=ALPHA), abs=1e-6)
        assert mujoco.mj_id2name(one, mujoco.mjtObj.mjOBJ_PLUGIN, 0) == name


@pytest.mark.parametrize(
    ("law", "pair", "says"),
    [
        (LAW, {"geoms": ("bal", "plate")}, "geom 'bal'.*'ball'"),
        (LAW, {"bodies": ("bowl", "ball")}, "body 'bowl'"),
        (LAW, {"tendon": "cup"}, "tendon 'cup'"),
        (LAW, {}, "one of geoms, bodies and tendon"),
        (LAW, {"geoms": ("ball",)}, "2 values"),
        (None, {"geoms": ("ball", "plate")}, "HuntCrossley"),
        (Flores, {"geoms": ("ball", "plate")}, "law"),
        (
            Restitution(0.1),
            {"geoms": ("ball", "plate"), "friction": Friction(0.1, 0.1)},
            "friction",
        ),
    ],
)
def test_what_cannot_be_added_is_refused_by_name(law: Any, pair: dict[str, Any], says: str) -> None:
    with pytest.raises(UserError, match=says):
        contact.add_to_spec(spec(), law, **pair)


def test_attach_says_what_to_write_instead() -> None:
    with pytest.raises(SettingError, match=r"add_to_spec\(spec, law.*spec\.compile\(\)"):
        contact.attach(spec().compile(), ("ball", "plate"), LAW)


def test_stiffness_by_hertz_is_that_of_the_paper() -> None:
    steel = Material(young_modulus=206.8e9, poisson_ratio=0.3)
    model = spec().compile()
    assert contact.hertz_stiffness(model, "ball", "plate", steel, steel) == pytest.approx(
        3.4064e10, rel=5e-3
    )
    with pytest.raises(SettingError, match="not in the model"):
        contact.hertz_stiffness(model, "torso", "plate", steel, steel)


def test_shapes_that_mujoco_sees_too_coarsely_are_warned_of() -> None:
    require_plugins_in_specs()
    turns = np.linspace(0, 2 * np.pi, 13)[:-1]
    points = [
        (np.cos(a) * np.sin(p), np.sin(a) * np.sin(p), np.cos(p))
        for p in (0.5, 1.5, 2.5)
        for a in turns
    ]
    vertices = " ".join(f"{0.05 * x} {0.05 * y} {0.05 * z}" for x, y, z in points)
    made = spec(more=f'<asset><mesh name="rock" vertex="{vertices}"/></asset>')
    body = made.worldbody.add_body(name="rock", pos=[0, 0, 1])
    body.add_freejoint()
    body.add_geom(name="rock", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="rock")
    with pytest.warns(contact.ContactAccuracyWarning, match="'rock' is a mesh"):
        contact.add_to_spec(made, LAW, geoms=("rock", "plate"))


def test_what_has_no_law_moves_bit_for_bit_as_before() -> None:
    require_plugins_in_specs()

    def scene() -> Any:
        made = world(1e-3)
        add_body(made, "ball", (0, 0, RADIUS + 1e-4))
        add_body(made, "box", (1, 0, 0.1), BOX, (0.05,) * 3, quat=(0.9, 0.1, 0.2, 0.3))
        return made

    plain, with_law = scene().compile(), plugged(scene(), [("ball", "floor")], Restitution(0.3))
    runs = [mujoco.MjData(plain), mujoco.MjData(with_law)]
    for model, data in zip((plain, with_law), runs, strict=True):
        data.qvel[6:12] = 0.3, 0, -1, 2, 0, 1
        mujoco.mj_step(model, data, nstep=400)
    # The two share a solver, whose stopping rule looks at both.
    assert runs[0].qpos[7:] == pytest.approx(runs[1].qpos[7:], abs=1e-6)


# Copies, saved models, threads, batches


def test_copies_saved_models_and_resets_keep_the_law(tmp_path: Path) -> None:
    model = compiled("hcbench.hunt_crossley", FORCE_KEYS, rest=EXCLUDE)
    path = str(tmp_path / "model.mjb")
    mujoco.mj_saveModel(model, path)
    for one in (copy.copy(model), copy.deepcopy(model), mujoco.MjModel.from_binary_path(path)):
        assert bounce(one) == bounce(model)
    data = launched(model)
    mujoco.mj_step(model, data, nstep=7)
    other = copy.copy(data)
    for one in (data, other):
        mujoco.mj_step(model, one, nstep=40)
    assert np.array_equal(data.qpos, other.qpos)
    mujoco.mj_resetData(model, data)
    data.qvel[2], data.qpos[2] = -0.3, 0.0508 + 2.3e-5 * 0.3
    mujoco.mj_step(model, data, nstep=60)
    assert data.qvel[2] / 0.3 == bounce(model)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_rollout_takes_models_of_their_own(integrator: str) -> None:
    alphas = np.array([0.0, 0.1, 0.3, 0.6])
    models = [
        compiled("hcbench.hunt_crossley", {**FORCE_KEYS, "alpha": f"{alpha:.1f}"}, rest=EXCLUDE)
        for alpha in alphas
    ]
    for model in models:
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    state = np.zeros((4, mujoco.mj_stateSize(models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    for one in state:
        mujoco.mj_getState(models[0], launched(models[0]), one, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    threads = [mujoco.MjData(models[0]) for _ in range(2)]
    states, _ = mujoco.rollout.rollout(models, threads, state, nstep=60)
    assert states[:, -1, -4] / 0.3 == pytest.approx(closed_form.restitution(alphas, 0.3), abs=1e-5)


@pytest.mark.skipif(batch is None, reason="this MuJoCo has no mujoco.batch")
def test_a_batch_varies_the_numerics_that_a_config_points_to() -> None:
    rest = (
        EXCLUDE
        + '<custom><numeric name="loss" data="0.3"/><numeric name="k" data="3e10"/></custom>'
    )
    model = compiled("hcbench.hunt_crossley", {"stiffness": "k", "alpha": "loss"}, rest=rest)
    alphas, stiffness = np.array([0.0, 0.1, 0.3, 0.6]), np.array([1e10, 2e10, 3e10, 4e10])
    many = batch.Batch(model, 4, 2)
    many.expand("numeric_data")[:] = np.stack([alphas, stiffness], axis=-1)
    many.qpos[:, 2] = 0.0508 + 2.3e-5 * 0.3
    many.qvel[:, 2] = -0.3
    deepest = np.zeros(4)
    for _ in range(60):
        many.step()
        deepest = np.maximum(deepest, 0.0508 - many.qpos[:, 2])
    assert many.qvel[:, 2] / 0.3 == pytest.approx(closed_form.restitution(alphas, 0.3), abs=1e-6)
    truth = [
        float(closed_form.penetration_max(HuntCrossley(k, a), 0.45359237, 0.3))
        for k, a in zip(stiffness, alphas, strict=True)
    ]
    assert deepest == pytest.approx(truth, rel=5e-3)


# The library


@pytest.mark.usefixtures("with_cache")
def test_the_command_prints_a_path_that_plain_mujoco_loads(capsys: Any, tmp_path: Path) -> None:
    assert run_command(["plugin", "mujoco"]) == 0
    path = capsys.readouterr().out.strip()
    assert Path(path) == contact.library()
    scene = load_scene("steel-plane")
    for recipe, h in (("mujoco.hunt-crossley", 1e-5), ("mujoco.restitution-law", 1e-3)):
        target = Target(HuntCrossley(scene.stiffness, 0.3), scene.mass, h, 0.0254, 0.508)
        model = tmp_path / "model.xml"
        model.write_text(model_xml(scene, registry.recipe(recipe)(target)), encoding="utf-8")
        code = (
            f"import mujoco; mujoco.mj_loadPluginLibrary({path!r})\n"
            f"m = mujoco.MjModel.from_xml_path({str(model)!r}); d = mujoco.MjData(m)\n"
            "d.qvel[2] = -0.3; mujoco.mj_step(m, d, nstep=60); print(d.qvel[2] / 0.3)"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert float(done.stdout) == pytest.approx(e(alpha=0.3), abs=1e-5)
        assert done.stderr == ""


@pytest.mark.usefixtures("with_cache")
def test_a_written_scene_says_in_its_first_comment_how_plain_mujoco_loads_it(
    tmp_path: Path,
) -> None:
    """Every instruction of the comment is followed to the letter, in processes of their own."""
    model = tmp_path / "drop.xml"
    asked = ["--plugin", "--alpha", "0.3 s/m", "--timestep", "2 ms", "--speeds", "0.1:2 m/s"]
    assert run_command(["tune", "mujoco", *asked, "--write-scene", str(model)]) == 0
    text = model.read_text(encoding="utf-8")
    comment = text.partition("<!--")[2].partition("-->")[0]
    assert text.startswith("<!--")
    assert ET.fromstring(text).tag == "mujoco"  # no two hyphens in it
    (command, again) = re.findall(r"`hcbench ([a-z ]+)`", comment)
    assert command == again
    printed = subprocess.run(
        [sys.executable, "-m", "hcbench", *command.split()],
        capture_output=True,
        text=True,
        check=True,
    )
    (call,) = re.findall(r"mujoco\.mj_loadPluginLibrary\(path\)", comment)
    code = (
        f"import mujoco; path = {printed.stdout.strip()!r}; {call}\n"
        f"m = mujoco.MjModel.from_xml_path({str(model)!r}); d = mujoco.MjData(m)\n"
        "m.opt.gravity[:] = 0; d.qvel[2] = -0.3; mujoco.mj_step(m, d, nstep=60)\n"
        "import sys; print('hcbench' in sys.modules, d.qvel[2] / 0.3)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    imported, ratio = done.stdout.split()
    assert imported == "False"
    assert float(ratio) == pytest.approx(e(alpha=0.3), abs=1e-5)
    refused = subprocess.run(
        [sys.executable, "-c", code.replace(call, "")], capture_output=True, text=True, check=False
    )
    assert "hcbench.restitution" in refused.stderr
    assert '"install"' in comment
    assert ["--install"] in [option.opts for option in plugin.params]


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_a_margin_is_where_bodies_meet(integrator: str) -> None:
    """A ball bounces on, and rests at, the margin over the floor, as on MuJoCo's own contact."""
    margin, h, drop, e = 0.01, 2e-3, 0.2, 0.6
    spec = world(h, integrator=integrator)
    spec.worldbody.first_geom().margin = margin
    add_body(spec, "b", (0, 0, RADIUS + margin + drop))
    model = plugged(spec, [("b", "floor")], ConstantRestitution(e))
    data, heights = mujoco.MjData(model), []
    for _ in range(2000):
        mujoco.mj_step(model, data)
        heights.append(float(data.qpos[2]) - RADIUS - margin)
    landed = int(np.argmax(np.diff(heights) > 0))
    assert max(heights[landed:]) == pytest.approx(e**2 * drop, rel=5e-3)
    assert abs(heights[-1]) < 1e-3


@pytest.mark.parametrize("form", ["plane", "cup"])
@pytest.mark.parametrize("law", [Restitution(0.3), HuntCrossley(stiffness=1e6, alpha=0.3)], ids=str)
def test_a_text_to_paste_is_xml_that_strict_parsers_read(law: Any, form: str) -> None:
    ET.fromstring(f"<mujoco>{law_snippet(law, form)}</mujoco>")


def test_install_puts_it_beside_mujocos_own_and_an_old_one_is_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Any
) -> None:
    place = tmp_path / "plugin" / "libhcbench.so"
    monkeypatch.setattr("hcbench.engines.mujoco.plugin._installed", lambda: place)
    assert run_command(["plugin", "mujoco", "--install"]) == 0
    assert capsys.readouterr().out.strip() == str(place)
    assert place.read_bytes() == contact.library().read_bytes()
    contact.load.__wrapped__()  # the same library once more
    place.write_bytes(b"old")
    with pytest.raises(CannotRun, match="--install` again"):
        contact.load.__wrapped__()


def test_install_leaves_the_library_that_a_running_program_has_loaded(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Written over in place, a mapped library crashes who has it: install gives the name a new file."""
    place = tmp_path / "plugin" / "libhcbench.so"
    monkeypatch.setattr("hcbench.engines.mujoco.plugin._installed", lambda: place)
    assert run_command(["plugin", "mujoco", "--install"]) == 0
    with place.open("rb") as loaded:
        before = loaded.read()
        for _ in range(2):
            assert run_command(["plugin", "mujoco", "--install"]) == 0
        assert place.stat().st_ino != os.fstat(loaded.fileno()).st_ino
        loaded.seek(0)
        assert loaded.read() == before
    assert [each.name for each in place.parent.iterdir()] == [place.name]


def test_an_engine_without_plug_ins_says_so(capsys: Any) -> None:
    assert run_command(["plugin", "reference"]) == 2
    assert "no plug-in" in capsys.readouterr().err


def test_without_a_compiler_one_line_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(CannotRun, match=r"no C compiler found.*pip install 'hcbench\[plugin\]'"):
        contact.library()


def test_a_compiler_that_fails_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HCBENCH_CACHE", str(tmp_path))
    monkeypatch.setenv("CC", "false")
    with pytest.raises(_compile.NotCompiled, match="false failed"):
        contact.library()
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(_compile.NotCompiled, match="no-such-compiler"):
        contact.library()


# Oblique impacts, and several at once


def oblique(seed: int, cone: str) -> tuple[float, float, float, float]:
    """Error of e, friction over normal impulse, the friction there is, and
    energy won, of one random impact.

    A ball or the corner of a box that spins, on a floor or on another ball, at any step and
    friction. e is of the speeds at the touch plane. MuJoCo's least friction is 1e-5.
    """
    rng = np.random.default_rng(seed)
    mu, law = (
        float(rng.choice([0.0, 0.001, rng.uniform(0, 1)])),
        (Restitution(0.315), HALF)[int(rng.integers(2))],
    )
    gravity = float(rng.choice([0, 9.81]))
    require_plugins_in_specs()
    spec = world(float(10 ** rng.uniform(-4, -2.3)), gravity=gravity, friction=mu, cone=cone)
    kind = (mujoco.mjtGeom.mjGEOM_SPHERE, BOX)[int(rng.integers(2))]
    quat = np.array([1, *rng.uniform(-0.6, 0.6, 3)])
    add_body(
        spec,
        "b",
        (0, 0, 1),
        kind,
        rng.uniform(0.03, 0.06, 3),
        1.0,
        mu,
        quat=quat / np.linalg.norm(quat),
    )
    if other := kind != BOX and rng.random() < 0.5:
        add_body(
            spec, "o", (0, 0, 0.5), size=(0.05, 0, 0), mass=10 ** rng.uniform(-1, 1), friction=mu
        )
    model = Scene(spec, law).model()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    if other:  # off-centre
        data.qpos[:2] = rng.uniform(-0.03, 0.03, 2)
        radius = model.geom("b").size[0] + 0.05 - 1e-6
        data.qpos[2] = 0.5 + np.sqrt(radius**2 - data.qpos[0] ** 2 - data.qpos[1] ** 2)
    else:
        low = np.abs(data.geom("b").xmat.reshape(3, 3)) @ model.geom("b").size
        data.qpos[2] = (low[2] if kind == BOX else model.geom("b").size[0]) - 1e-6
    data.qvel[:6] = [*rng.uniform(-2, 2, 2), -rng.uniform(0.3, 1.5), *rng.uniform(-20, 20, 3)]
    mujoco.mj_forward(model, data)
    if data.ncon != 1:
        return 0.0, 0.0, 0.0, 0.0
    frame, rows = data.contact[0].frame.reshape(3, 3), np.zeros((3, model.nv))
    for body, sign in ((data.contact[0].geom[1], 1), (data.contact[0].geom[0], -1)):
        jac = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jac, None, data.contact[0].pos, model.geom_bodyid[body])
        rows += sign * frame @ jac
    before = data.qvel.copy()
    if (rows @ before)[0] > -0.1:
        return 0.0, 0.0, 0.0, 0.0
    half = np.array([0, 0, -gravity * model.opt.timestep / 2, 0, 0, 0] * (model.nv // 6))
    before += half  # the rates whose energy, with the work of gravity, flight keeps
    lift = (
        4 * (rows @ half)[0] / model.opt.timestep * data.contact[0].dist
    )  # 2 g x, up to the touch plane
    u = rows @ before
    mass = full_mass(model, data)
    mujoco.mj_step(model, data)
    after = data.qvel - half  # the impulse acts first, then the body flies on and turns for a step
    after[3:6] = before_turning(model, 1, data.qvel[3:6])
    blow = after - before
    impulse = np.linalg.lstsq(rows.T, mass @ blow, rcond=None)[0]
    speed, parting = (np.sqrt(rate**2 - lift) for rate in (u[0], (rows @ after)[0]))
    error = abs(parting / speed - float(law.at(speed)))
    won = 0.5 * (after @ mass @ after - before @ mass @ before) / (0.5 * before @ mass @ before)
    return error, float(np.hypot(*impulse[1:])), max(mu, 1e-5) * float(impulse[0]), float(won)


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_oblique_impacts_have_the_e_of_the_law_and_friction_within_its_cone(cone: str) -> None:
    seen = np.array([oblique(seed, cone) for seed in range(75)])
    assert (seen[:, 0] > 0).sum() > 25
    assert seen[:, 0].max() < 1e-9
    assert (seen[:, 1] - seen[:, 2]).max() < 1e-9
    assert seen[:, 3].max() < 1e-12


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize(
    ("slip", "mu", "v"), [(2.0, 0.1, 0.3), (2.0, 0.3, 0.3), (40 * 0.0508, 1.0, 0.1)]
)
def test_a_ball_that_slides_or_spins_bounces_as_high_as_one_that_does_not(
    slip: float, mu: float, v: float, cone: str
) -> None:
    made = world(1e-3, gravity=0.0, friction=mu, cone=cone)
    add_body(made, "b", (0, 0, RADIUS - 1e-6), friction=mu)
    model = plugged(made, [("b", "floor")], Restitution(0.315))
    data = mujoco.MjData(model)
    data.qvel[:3] = slip, 0, -v
    mujoco.mj_step(model, data)
    assert data.qvel[2] / v == pytest.approx(e(v), abs=1e-12)
    assert slip - data.qvel[0] == pytest.approx(min(mu * (1 + e(v)) * v, slip * 2 / 7), rel=1e-3)


@pytest.mark.parametrize("law", [ELASTIC, Restitution(0.002), HALF], ids=["1", "law", "half"])
@pytest.mark.parametrize(("n", "moving"), [(3, 1), (5, 1), (5, 2), (6, 1), (10, 1)])
def test_rows_of_touching_balls_win_no_energy(n: int, moving: int, law: Any) -> None:
    seen = run(row(n, 1e-3, law, moving), 0.3)
    assert seen.growth < 1e-12
    if law is ELASTIC:
        assert seen.data.qvel[::6] == pytest.approx([0.0] * (n - moving) + [1.0] * moving, abs=1e-9)


def test_a_cradle_swings_on_the_other_side() -> None:
    seen = run(cradle(5, 1e-3, ELASTIC), 1.2)
    assert seen.growth < 2e-4  # as a pendulum of one ball in this engine, without contact
    high = run(cradle(5, 1e-3, ELASTIC), 0.7).data.qpos
    assert high[-1] < -0.3
    assert np.abs(high[:-1]).max() < 0.01


@pytest.mark.parametrize("law", [ELASTIC, Restitution(0.315)], ids=["1", "law"])
def test_a_rack_breaks_without_winning_energy(law: Any) -> None:
    seen = run(rack(2e-3, law), 0.6)
    assert seen.growth < 1e-9
    assert np.hypot(*seen.data.qpos.reshape(-1, 7)[1:, :2].T).max() > 0.5


@pytest.mark.parametrize(
    ("size", "integrator", "law"),
    every_pair(
        [(3, 5e-3), (5, 2e-3), (10, 1e-3)],
        ["Euler", "implicitfast", "RK4"],
        [HALF, Restitution(0.315)],
    ),
)
def test_stacks_stand(size: tuple[int, float], integrator: str, law: Any) -> None:
    n, h = size
    seen = run(stack(n, h, law, integrator=integrator), 1.5)
    upright = RADIUS * (2 * np.arange(n) + 1)
    assert np.abs(seen.data.qpos[2::7] - upright).max() < 1e-3 * (1 if h < 5e-3 else 1.5)
    # MuJoCo 3.11 finds three or five corners of two flat boxes 1e-14 m
    # apart, which tips one a little.
    meets_flat = tuple(map(int, mujoco.__version__.split(".")[:2])) >= (3, 12)
    assert np.abs(seen.data.qpos[0::7]).max() < (
        1e-6 if integrator == "Euler" and meets_flat else 2e-4
    )
    assert np.abs(seen.data.qvel).max() < 1e-6
    assert seen.growth < 1e-9


@pytest.mark.parametrize("friction", [0.0, 1e-4, 1e-3, 0.01, 0.5])
@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_boxes_tumble_without_winning_energy(friction: float, cone: str) -> None:
    assert run(tumbling(1, 2e-3, Restitution(0.315), friction, cone), 2.0).growth < 1e-9


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast"])
@pytest.mark.parametrize("seed", range(5))
def test_piles_win_no_energy(seed: int, integrator: str) -> None:
    law = (HALF, Restitution(0.315), ConstantRestitution(0.9), Restitution(0.315), HALF)[seed]
    seen = run(pile(seed, 5e-3, law, integrator=integrator), 4.0)
    assert seen.growth < 1e-9
    assert not any(warning.number for warning in seen.data.warning)


@pytest.mark.parametrize(
    "order", [("hunt_crossley", "restitution"), ("restitution", "hunt_crossley")]
)
def test_both_laws_stand_in_one_model_in_any_order(order: tuple[str, str]) -> None:
    """A law finds its own pairs while the other's are not read yet."""
    keys = {
        "hunt_crossley": FORCE_KEYS | {"geom1": "ball", "geom2": "plate"},
        "restitution": {"alpha": "0.3", "geom1": "other", "geom2": "plate"},
    }
    plugins = "".join(
        f'<plugin plugin="hcbench.{name}"><instance name="{name}">'
        + "".join(f'<config key="{key}" value="{value}"/>' for key, value in keys[name].items())
        + "</instance></plugin>"
        for name in order
    )
    text = f"""<mujoco><option timestep="1e-4"/><extension>{plugins}</extension>
      <worldbody><geom name="plate" type="plane" size="1 1 1"/>
      <body name="ball" pos="0 0 1"><freejoint/><geom name="ball" size=".05"/></body>
      <body pos="1 0 1"><freejoint/><geom name="other" size=".05"/></body></worldbody>
      <contact><exclude body1="world" body2="ball"/></contact></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    mujoco.mj_step(model, mujoco.MjData(model))
    assert model.nplugin == 2
