"""The names that hcbench promises: each is documented, and a wrong
argument is an error that names it.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import hcbench
from hcbench.fitting.ask import fit
from hcbench.laws.published import law_named
from hcbench.sim import registry
from hcbench.system.errors import HcbenchError
from hcbench.terms.scene import Material

ROOT = Path(__file__).parents[2]
MODULES = (
    "hcbench",
    "hcbench.paper",
    "hcbench.contact.mjx",
    "hcbench.contact.mujoco",
    "hcbench.contact.newton",
    "hcbench.contact.pybullet",
    "hcbench.contact.warp",
)
WRONG: list[Any] = [
    None,
    "x",
    "",
    "1 in/s",
    b"x",
    True,
    -1,
    -1.0,
    math.nan,
    math.inf,
    1e300,
    1e-300,
    10**400,
    [],
    {},
    (),
    [1, "a"],
    np.array([1.0, 2.0]),
    object(),
]
LAW = hcbench.HuntCrossley(3.4e10, 0.3)
STEEL = Material(2.1e11, 0.3)
SPEC = mujoco.MjSpec.from_string(
    """<mujoco><worldbody><geom name="plate" type="plane" size="1 1 1"/><body name="ball"><freejoint/>
    <geom name="ball" size=".1"/></body></worldbody></mujoco>"""
)
SCENE = hcbench.load_scene("steel-plane")
FIELDS = {name: getattr(SCENE, name) for name in inspect.signature(hcbench.Scene).parameters}
STUDY: dict[str, Any] = {
    "title": "t",
    "scene": SCENE,
    "alphas": (0.3,),
    "speeds": (0.1,),
    "loop_speeds": (),
    "phases": 1,
    "main_alpha": 0.3,
    "step_speed": 0.1,
    "runs": (),
}
# Arguments that each name takes; of `measure` such that nothing is simulated.
# For wrong types of arguments, which a type checker would refuse.
UNTYPED: Any = hcbench
ANY_LAW: Any = LAW
RIGHT: dict[str, dict[str, Any]] = {
    "hcbench.HuntCrossley": {"stiffness": 3.4e10, "alpha": 0.3},
    "hcbench.KelvinVoigt": {"stiffness": 1e6, "damping": 3.0},
    "hcbench.Scene": FIELDS,
    "hcbench.Setting": {"engine": "reference", "name": "x", "timestep": 1e-3},
    "hcbench.Study": STUDY,
    "hcbench.Target": {
        "law": LAW,
        "mass": 0.45,
        "timestep": 1e-3,
        "speed_min": 0.1,
        "speed_max": 0.5,
    },
    "hcbench.Wanted": {"alpha": 0.3},
    "hcbench.check": {"model": "no-such.xml", "pair": "a,b"},
    "hcbench.convert": {"alpha": 0.3, "speed": 0.5},
    "hcbench.engine": {"name": "reference"},
    "hcbench.fit": {"law": "auto"},
    "hcbench.fit_force": {"file": "no-such.csv"},
    "hcbench.land": {"model": object()},
    "hcbench.law": {"alpha": 0.3},
    "hcbench.load_scene": {"name_or_path": "steel-plane"},
    "hcbench.load_study": {"path": ROOT / "reports" / "steel-1lb" / "study.toml"},
    "hcbench.materials": {"name": "rubber on concrete"},
    "hcbench.measure": {"model": object(), "pair": "a,b"},
    "hcbench.measure_trajectory": {"model": object(), "trajectory": {"qpos": [[0.0]]}},
    "hcbench.pairs": {"model": object()},
    "hcbench.report": {"study": "no-such-study"},
    "hcbench.run_study": {"study": None},
    "hcbench.score": {"impacts": [], "law": LAW, "mass": 0.45},
    "hcbench.tune": {"engine": "reference", "timestep": 1e-3, "alpha": 0.3},
    "hcbench.randomize": {"model": object(), "pair": "a,b", "restitution": "0.3:0.6"},
    "hcbench.tune_model": {"model": object(), "pair": "a,b", "alpha": 0.3},
    "hcbench.contact.mujoco.ConstantRestitution": {"restitution": 0.9},
    "hcbench.contact.mujoco.Restitution": {"alpha": 0.3},
    "hcbench.contact.mujoco.Friction": {"static": 0.5, "dynamic": 0.4},
    "hcbench.contact.mujoco.TouchSpeedLaw": {
        "family": law_named("flores"),
        "stiffness": 1e7,
        "restitution": 0.9,
    },
    "hcbench.contact.mjx.restitution": {"model": SPEC.compile(), "pairs": {("ball", "plate"): 0.3}},
    "hcbench.contact.newton.restitution": {
        "solver": object(),
        "pairs": {("ball", "plate"): 0.3},
    },
    "hcbench.contact.warp.restitution": {
        "model": SPEC.compile(),
        "pairs": {("ball", "plate"): 0.3},
    },
    "hcbench.contact.mujoco.config": {"law": LAW},
    "hcbench.contact.mujoco.add_to_spec": {"spec": SPEC, "law": LAW, "geoms": ("ball", "plate")},
    "hcbench.contact.mujoco.hertz_stiffness": {
        "model": SPEC.compile(),
        "geom1": "ball",
        "geom2": "plate",
        "material1": STEEL,
        "material2": STEEL,
    },
    "hcbench.paper.data": {"name": "figure-2"},
    "hcbench.paper.figure": {"name": "figure-2"},
    "hcbench.fitting.setup.Known": {"value": 1.0},
    "hcbench.fitting.setup.MeasurementSetup": {"timing": 1e-3},
    "hcbench.tuning.model.tune_job": {"source": "", "requests": [], "wanted": hcbench.Wanted(0.3)},
    "hcbench.contact.pybullet.command": {"law": LAW},
    "hcbench.contact.pybullet.add": {"law": LAW, "first": 0, "second": 1, "client": None},
    "hcbench.contact.pybullet.force": {"number": 0, "client": None},
    "hcbench.contact.pybullet.remove": {"number": 0, "client": None},
    "hcbench.contact.pybullet.load": {"client": None},
}
# Records of results, which only hcbench makes; exceptions; and what is about a
# model or client of an engine.
MADE_BY_HCBENCH = {
    "Answer",
    "Impact",
    "ImpactLaw",
    "ImpactLaws",
    "MaterialPair",
    "Materials",
    "Loop",
    "Measurement",
    "RandomWorlds",
    "Results",
    "Score",
    "Status",
    "beyond_bounds",
    "HcbenchError",
    "Landings",
    "Launch",
}


def calls() -> Iterator[tuple[str, str]]:
    for name in RIGHT:
        for parameter in inspect.signature(resolve(name)).parameters.values():
            if parameter.kind not in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
                yield name, parameter.name


def resolve(name: str) -> Callable[..., Any]:
    module, _, attribute = name.rpartition(".")
    found: Callable[..., Any] = getattr(import_module(module), attribute)
    return found


@pytest.fixture(scope="module")
def client() -> Iterator[int]:
    """A client of PyBullet with a ball, 0, and a plate, 1; where it is not installed, 0."""
    if not registry.is_there("pybullet"):
        yield 0
        return
    import pybullet

    number = pybullet.connect(pybullet.DIRECT)
    for mass in (1.0, 0.0):
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_SPHERE, radius=0.1, physicsClientId=number
        )
        pybullet.createMultiBody(mass, shape, physicsClientId=number)
    yield number
    pybullet.disconnect(number)


def arguments(name: str, client: int) -> dict[str, Any]:
    given = {key: value.copy() if value is SPEC else value for key, value in RIGHT[name].items()}
    return given | ({"client": client} if "client" in given else {})


@pytest.mark.parametrize(("name", "parameter"), list(calls()))
def test_a_wrong_argument_is_an_error_of_ours_or_none(
    name: str, parameter: str, client: int
) -> None:
    """241 of 580 such calls raised TypeError, AttributeError and the like."""
    for value in WRONG:
        try:
            resolve(name)(**{**arguments(name, client), parameter: value})
        except HcbenchError as error:
            assert str(error).isprintable()


@pytest.mark.parametrize(
    ("name", "parameter", "value", "message"),
    [
        ("hcbench.HuntCrossley", "alpha", "0.3", r"^alpha: '0.3'; expected a number$"),
        (
            "hcbench.Target",
            "reading",
            "lawful",
            "^reading: 'lawful'; expected 'law' or 'linear'",
        ),
        ("hcbench.Target", "law", 0.3, "^law: 0.3; expected a HuntCrossley$"),
        ("hcbench.convert", "speed", {}, "^speed: {}; expected a number, or text with a unit$"),
        ("hcbench.engine", "name", ["x"], "^name: .*expected text$"),
        ("hcbench.measure", "pair", 7, "^pair: 7; expected two names, first the one that moves$"),
        ("hcbench.tune", "engine", "my.xml", "^engine: 'my.xml', a model; .* Use `tune_model`"),
        (
            "hcbench.fit_force",
            "speeds",
            1.0,
            "^speeds: unknown argument; expected one of: file, kind",
        ),
        ("hcbench.load_study", "path", 7, "^path: 7; expected text or a path$"),
        ("hcbench.measure", "limit", "60 m", "^limit: '60 m'.*expected a unit that converts to s"),
        ("hcbench.law", "alpha", "0.3 m/s", "^alpha: .*expected a unit that converts to s/m"),
        ("hcbench.tune", "engine", "mujco", "^engine: 'mujco'.*"),
        ("hcbench.measure", "limit", 1e10, "^limit: "),
        ("hcbench.measure", "tolerance", math.nan, "^tolerance: "),
        ("hcbench.run_study", "study", "study.toml", "^study: 'study.toml'; expected a Study$"),
        ("hcbench.score", "mass", -1.0, "^(mass|impacts): "),
    ],
)
def test_the_error_names_the_argument(
    name: str, parameter: str, value: object, message: str, client: int
) -> None:
    with pytest.raises(HcbenchError, match=message):
        resolve(name)(**{**arguments(name, client), parameter: value})


@pytest.mark.parametrize("value", WRONG, ids=[str(i) for i in range(len(WRONG))])
def test_what_is_handed_to_methods_and_to_fits_is_checked_too(value: Any, tmp_path: Path) -> None:
    setting, reference = (
        hcbench.Setting("reference", "hunt-crossley", 1e-5),
        hcbench.engine("reference"),
    )
    right: dict[str, Any] = {"scene": SCENE, "setting": setting, "launches": [hcbench.Launch(0.1)]}
    for slot in right:
        if slot != "launches" or not isinstance(value, list | tuple) or value:
            with pytest.raises(HcbenchError, match=slot if slot != "launches" else "^launch"):
                reference.run(**{**right, slot: value})
    with pytest.raises(HcbenchError):
        hcbench.Results.read(value)
    with pytest.raises(HcbenchError):
        fit(value)
    (tmp_path / "pairs.csv").write_text("speed [m/s],restitution\n0.1,0.9\n0.2,0.8\n0.3,0.7\n")
    with pytest.raises(HcbenchError, match=r"^law: "):
        fit(tmp_path / "pairs.csv", law=value)
    if value is not None and not isinstance(value, float):
        with pytest.raises(HcbenchError, match=r"^(height|number|value)"):
            fit(tmp_path / "pairs.csv", height=value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: UNTYPED.law(0.3).loop(1.0, count=10**12), "^count: 1000000000000; expected a whole"),
        (lambda: UNTYPED.law(0.3).loop(1.0, count=10**9), r"^count: 1000000000; expected 3 \.\.\."),
        (lambda: UNTYPED.law(0.3).trajectory(1.0, count=5e9), "^count: 5000000000.0; expected a who"),
        (lambda: UNTYPED.law(0.3).trajectory(1.0, count="5"), "^count: '5'; expected a whole number"),
        (lambda: ANY_LAW.force("a", 1.0), "^x: 'a'; expected a number, or an array of them"),
        (lambda: ANY_LAW.force(1.0, None), "^v: None; expected a number, or an array of them"),
        (lambda: UNTYPED.ImpactLaw(None, None), "^force: None; expected a HuntCrossley"),
        (lambda: UNTYPED.ImpactLaw(LAW, 0.0), "^mass: 0; expected a value above 0 kg"),
        (lambda: UNTYPED.Launch(speed="1 m/s"), "^speed: '1 m/s'; expected a number"),
        (lambda: UNTYPED.Launch(speed=1, phase="a"), "^phase: 'a'; expected a number"),
        (lambda: UNTYPED.Launch(speed=1, height=True), "^height: True; expected a number"),
        (lambda: UNTYPED.Launch(speed=1, slip=(1,)), r"^slip: \(1,\); expected 2 numbers"),
        (lambda: UNTYPED.Launch(speed=1, spin=(0, 0, "a")), "^spin: .*; expected 3 numbers"),
        (lambda: UNTYPED.materials("a" * 100_000), "^material: a name of 100000 characters; .* 200"),
    ],
)  # fmt: skip
def test_methods_and_records_refuse_what_is_no_number(
    call: Callable[[], Any], message: str
) -> None:
    """Each was a MemoryError, a TypeError, or taken and wrong later; the last took 17 s."""
    with pytest.raises(HcbenchError, match=message):
        call()


@pytest.mark.spec_plugins
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_numpy_numbers_are_numbers(kind: Any) -> None:
    """A plug-in's keys once read "np.float64(0.2)", which MuJoCo refused."""
    friction = hcbench.contact.mujoco.Friction(kind(0.5))
    spec, law = SPEC.copy(), hcbench.contact.mujoco.HuntCrossley(kind(1e5), kind(1.0))
    hcbench.contact.mujoco.add_to_spec(spec, law, geoms=("ball", "plate"), friction=friction)
    assert spec.compile().nplugin == 1
    setting = hcbench.Setting("mujoco", "x", kind(0.5), {"rows": [{"onset": kind(0.25)}]})
    assert setting == hcbench.Setting("mujoco", "x", 0.5, {"rows": [{"onset": 0.25}]})
    assert setting.key == hcbench.Setting("mujoco", "x", 0.5, {"rows": [{"onset": 0.25}]}).key


def test_every_public_name_of_the_package_is_tried_here() -> None:
    tried = {name.removeprefix("hcbench.") for name in RIGHT if name.count(".") == 1}
    assert tried | MADE_BY_HCBENCH == {*hcbench._VERBS, *hcbench._CLASSES}


def test_dir_shows_few_names_which_is_what_a_user_calls() -> None:
    assert dir(hcbench) == sorted([*hcbench.__all__, "__version__", "paper"])
    assert len(hcbench.__all__) == 16
    for name in (*hcbench._VERBS, *hcbench._CLASSES):
        assert getattr(hcbench, name).__module__.startswith("hcbench.")


def test_a_class_has_one_home() -> None:
    for module in MODULES[1:]:
        for name in import_module(module).__all__:
            if name in hcbench._CLASSES:
                assert getattr(import_module(module), name) is getattr(hcbench, name)


@pytest.mark.parametrize(
    ("section", "names"),
    [
        ("`hcbench`", sorted(hcbench._VERBS)),
        ("`hcbench`: results, studies and engines", sorted(hcbench._CLASSES)),
        *((f"`{module}`", sorted(import_module(module).__all__)) for module in MODULES[1:]),
    ],
)
def test_every_public_name_has_a_docstring_and_a_line_in_the_documentation(
    section: str, names: list[str]
) -> None:
    text = (ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    found = text.partition(f"## {section}\n")[2].partition("\n## ")[0]
    listed = re.findall(r"^\.\. auto\w+:: (?:hcbench\.measure\.)?(\w+)$", found, flags=re.MULTILINE)
    assert listed == names
    home = import_module(section.split("`")[1])
    assert all(getattr(home, name).__doc__ for name in names)
