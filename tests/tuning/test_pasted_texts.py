"""Each text that hcbench hands out bounces as promised in a plain model or script of other names."""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pasted import FLOOR, FOOT, NAMES, bounces, bullet_bounces, plain_mujoco, renamed
from sessions import PAGES, page_steps

from hcbench.cli import run
from hcbench.contact.mujoco import load
from hcbench.contact.pybullet import library
from hcbench.laws import closed_form
from hcbench.sim import registry
from hcbench.terms.impact import Launch
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Setting
from hcbench.tuning import usual
from hcbench.tuning.ask import make_target

pytestmark = pytest.mark.usefixtures("tuned_once")

ROOT = Path(__file__).parents[2]
ALPHA, SPEED = 0.315, 0.3
KNOWN = [a for a in usual.file_content()["answers"] if a["gravity"] or a["timestep"] == 2e-3]
GRID = [(0.0, 0.1), (0.02, 0.6), (0.3, 0.35), (0.7, 0.85), (1.0, 0.5)]  # share of the band, phase
LINKS = ROOT / "tests" / "engines" / "bullet" / "staggered_links.json"


@pytest.fixture(scope="module", autouse=True)
def _plugin() -> None:
    load()


def over(band: list[float]) -> list[tuple[float, float]]:
    """Launches over a band, m/s."""
    low, high = band
    return [(low + share * (high - low), phase) for share, phase in GRID]


def off(e: list[float], launches: list[tuple[float, float]], alpha: float) -> float:
    """The largest error against the law."""
    law = closed_form.restitution(alpha, np.array([v for v, _ in launches]))
    return float(np.abs(np.array(e) - law).max())


@pytest.mark.adhesion
def test_each_text_of_the_pages_first_screen_for_mujoco() -> None:
    texts = 0
    for answer in KNOWN:
        for choice in answer["choices"] if answer["engine"] == "mujoco" else ():
            model = plain_mujoco(renamed(choice["text"]), answer["timestep"], answer["gravity"])
            launches = over(choice["speeds_m_per_s"])
            found = off(bounces(model, launches), launches, answer["alpha"])
            assert found <= 1.1 * choice["max_error"] + 1e-7, (answer["timestep"], choice["line"])
            texts += 1
    assert texts > 50


@pytest.mark.needs_engine("pybullet")
def test_each_text_of_the_pages_first_screen_for_pybullet(tmp_path: Path) -> None:
    given, promised = [], []
    library()  # compiled here, once
    for answer in KNOWN:
        for choice in answer["choices"] if answer["engine"] == "pybullet" else ():
            launches = over(choice["speeds_m_per_s"])
            given.append((renamed(choice["text"]), answer["timestep"], answer["gravity"], launches))
            promised.append((answer["alpha"], choice))
    assert len(given) == 40
    for (*_, launches), e, (alpha, choice) in zip(
        given, bullet_bounces(given, tmp_path), promised, strict=True
    ):
        assert off(e, launches, alpha) <= 1.1 * choice["max_error"] + 1e-6, choice["line"]


@cache
def setting_of(name: str, step: float) -> Setting:
    _, target = make_target(timestep=step, alpha=ALPHA, gravity=0.0)
    return registry.recipe(name)(target)


@pytest.mark.parametrize(
    ("recipe", "step"),
    [
        ("impulse", 1e-3),
        ("compliant", 1e-3),
        ("compliant-pairs", 2e-3),
        ("spring-damper", 1e-6),
        pytest.param("staggered", 1e-3, marks=pytest.mark.adhesion),
        ("hunt-crossley", 1e-5),
        ("flores", 1e-5),
        ("restitution-law", 2e-3),
    ],
)
def test_each_setting_of_the_pages_list_for_mujoco(recipe: str, step: float) -> None:
    """In plain MuJoCo e is what hcbench measured of the setting."""
    setting, scene = (
        setting_of(f"mujoco.{recipe}", step),
        replace(load_scene("steel-plane"), gravity=0.0),
    )
    text = registry.engine("mujoco").snippet(setting, "plane", NAMES)
    launches = over([0.1, 0.5])
    sent = [Launch(v, phase) for v, phase in launches]
    measured = [
        impact.restitution for impact in registry.engine("mujoco").run(scene, setting, sent)
    ]
    found = np.array(bounces(plain_mujoco(text, step, 0.0), launches))
    assert np.abs(found - measured).max() < 2e-3


@pytest.mark.needs_engine("pybullet")
def test_each_setting_of_the_pages_list_for_pybullet(tmp_path: Path) -> None:
    """The URDF that `staggered` writes among them."""
    (links,) = (
        each
        for each in json.loads(LINKS.read_text())
        if (each["timestep"], each["alpha"]) == (1e-6, 0.008)
    )
    rows = [
        dict(zip(("onset", "stiffness", "damping"), row, strict=True)) for row in links["links"]
    ]
    recipe = registry.recipe("pybullet.staggered")
    still = {"linearDamping": 0.0, "angularDamping": 0.0, "contactProcessingThreshold": 0.0}
    world = {
        "restitutionVelocityThreshold": 0.0,
        "contactSlop": 0.0,
        "contactERP": 0.0,
        "contactBreakingThreshold": 0.02,
    }
    plate = {"contactStiffness": 1e30, "contactDamping": 0.0}
    options = {"world": world, "ball": still, "plate": plate, "links": rows}
    staggered = Setting("pybullet", recipe.name, 1e-6, options)
    settings = [
        staggered,
        *(setting_of(f"pybullet.{name}", 1e-6) for name in ("spring-damper", "hunt-crossley")),
        *(setting_of(f"pybullet.{name}", 1e-3) for name in ("restitution", "restitution-law")),
    ]
    engine, launches = registry.engine("pybullet"), over([0.1, 0.5])
    scene = replace(load_scene("steel-plane"), gravity=0.0)
    sent = [Launch(v, phase) for v, phase in launches]
    given = [(engine.snippet(s, "plane", NAMES), s.timestep, 0.0, launches) for s in settings]
    for setting, e in zip(settings, bullet_bounces(given, tmp_path), strict=True):
        measured = [impact.restitution for impact in engine.run(scene, setting, sent)]
        assert np.abs(np.array(e) - measured).max() < 2e-3, setting.name
    assert (tmp_path / f"{FOOT}.urdf").is_file()


@pytest.mark.needs_engine("pybullet")
def test_what_convert_prints_for_mujoco_and_pybullet(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ["convert", "--alpha", "0.3 s/m", "--speed", f"{SPEED} m/s", "--timestep", "1e-3"]
    assert run(arguments) == 0
    printed = capsys.readouterr().out
    law = float(closed_form.restitution(0.3, SPEED))
    (stiff,) = re.findall(
        r"^MuJoCo +solref +(\S+ \S+)\n.*Euler.*; solimp ([\d. ]+)$", printed, re.MULTILINE
    )
    solref, solimp = stiff
    numbers = f'condim="1" solref="{solref}" solimp="{solimp} 0.5 2"'
    pair = f'<contact><pair geom1="{FOOT}" geom2="{FLOOR}" {numbers}/></contact>'
    assert bounces(plain_mujoco(pair, 1e-3, 0.0), [(SPEED, 0.4)])[0] == pytest.approx(law, abs=1e-3)
    (e,) = re.findall(r"^PyBullet +restitution +(\S+)", printed, re.MULTILINE)
    assert "contactERP must be 0, and contactProcessingThreshold of the body too" in printed
    text = (
        "pybullet.setPhysicsEngineParameter(restitutionVelocityThreshold=0, contactSlop=0, contactERP=0)\n"
        f"pybullet.changeDynamics({FOOT}, -1, restitution={e}, contactProcessingThreshold=0)\n"
        f"pybullet.changeDynamics({FOOT}, -1, linearDamping=0)\n"
        f"pybullet.changeDynamics({FLOOR}, -1, restitution=1)"
    )
    ((found,),) = bullet_bounces([(text, 1e-3, 0.0, [(SPEED, 0.4)])], tmp_path)
    assert found == pytest.approx(law, abs=1e-3)


def blocks(path: Path, language: str) -> list[str]:
    return re.findall(
        rf"^```{language}\n(.*?)^```", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )


def test_the_plug_ins_of_the_documentation() -> None:
    given = [
        text
        for text in blocks(ROOT / "docs" / "reference" / "plugins.md", "xml")
        if "<extension>" in text
    ]
    assert len(given) == 2
    for text in given:
        step = 1e-5 if "hunt_crossley" in text else 2e-3
        launches = over([0.1, 0.5])
        e = bounces(plain_mujoco(renamed(text), step, 0.0), launches)
        assert off(e, launches, 0.315) < 1e-3


def commands() -> list[str]:
    """Each `hcbench tune ENGINE` of README and documentation whose answer a plain model can show."""
    words = [step.words for page in PAGES for step in page_steps(page)]
    tunes = [w for w in words if w[1:2] == ["tune"] and w[2] in ("mujoco", "pybullet")]
    found = dict.fromkeys(
        shlex.join(w) for w in tunes if not {"--points", "--match", "--json"} & set(w)
    )
    assert found
    return list(found)


@pytest.mark.parametrize("command", commands())
def test_what_the_commands_of_readme_and_documentation_print(
    command: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    words = shlex.split(re.sub(r" --pair \S+", "", command))[1:]
    assert run([*words, "--json", "--pair", ",".join(NAMES)]) == 0
    said: dict[str, Any] = json.loads(capsys.readouterr().out)
    target, choice = said["target"], next(c for c in said["choices"] if c["text"] == said["paste"])
    launches = over(choice["speeds_m_per_s"])
    if said["engine"] == "mujoco":
        e = bounces(plain_mujoco(said["paste"], said["timestep_s"], target["gravity"]), launches)
    else:
        (e,) = bullet_bounces(
            [(said["paste"], said["timestep_s"], target["gravity"], launches)], tmp_path
        )
    if target["points"]:
        v, wanted = np.array(target["points"]).T
        found = float(
            np.abs(np.array(e) - np.interp([speed for speed, _ in launches], v, wanted)).max()
        )
    else:
        found = off(e, launches, target["law"]["alpha"])
    assert found <= 1.1 * choice["max_error"] + 1e-6, choice["line"]
