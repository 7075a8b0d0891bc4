"""The first screen of the committed report, run in Node: what a reader chooses, and what is there then."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import hcbench as hb

ROOT = Path(__file__).parents[2]
REPORT = ROOT / "reports" / "steel-1lb" / "index.html"
RUN = ROOT / "tests" / "support" / "page_in_node.js"
NODE = shutil.which("node")
SEEN = """
const shown = ["say", "more", "plain", "paste-text", "kinds", "balls", "loop-words"];
const see = () => ({
  ...Object.fromEntries(shown.map(id => [id, at(id).textContent])),
  mistaken: document.body.classList.contains("mistaken"),
  fallen: balls.map(({drop}) => drop && Math.max(0, ...drop.height)),
});
const material = words => data.materials.find(({label}) => label.startsWith(words)).id;
const seen = [];
"""

pytestmark = [
    pytest.mark.skipif(NODE is None, reason="Node is not installed"),
    pytest.mark.skipif(not REPORT.is_file(), reason="not a clone"),
]


def screens(*steps: str) -> list[dict[str, Any]]:
    """Texts of the screen after each step, which is JavaScript."""
    code = SEEN + "\n".join(f"{step}; seen.push(see());" for step in steps)
    code += "console.log(JSON.stringify(seen));"
    done = subprocess.run(
        [str(NODE), RUN, REPORT, code], capture_output=True, encoding="utf-8", check=False
    )
    assert not done.returncode, done.stderr
    found: list[dict[str, Any]] = json.loads(done.stdout)
    return found


def code_lines(text: str) -> str:
    """A text without the way its lines are broken."""
    return re.sub(r'"\s+"|\s+', " ", text).strip()


def test_the_page_opens_with_the_exact_answer_and_three_balls() -> None:
    (first,) = screens("")
    assert first["say"] == "Attach restitution-law: e within 1e-7 from 32 mm/s to 0.5 m/s."
    assert "Friction stays as your model has it." in first["more"]
    assert first["balls"] == "the lawMuJoCo as it iswith what we print"
    law, stock, ours = first["fallen"]
    assert stock < 1e-3 < 0.9 * law < ours < 1.02 * law  # m, after the first bounce


def test_a_value_that_cannot_be_used_leaves_no_older_answer() -> None:
    name, alpha, friction, good = screens(
        'at("first-name").enter("<b>")',
        'at("first-name").enter("FL foot"); at("alpha").enter("other"); at("own-alpha").enter("-1")',
        'at("own-alpha").enter("0.2"); at("friction").enter("-2")',
        'at("friction").enter("")',
    )
    for screen, words in ((name, "“<b>”"), (alpha, "α = -1 s/m"), (friction, "Friction -2")):
        assert screen["mistaken"] and words in screen["say"] and not screen["paste-text"]
    assert (
        not good["mistaken"]
        and "ball,FL foot" not in good["say"]
        and "FL foot" in good["paste-text"]
    )


@pytest.mark.usefixtures("tuned_once")
@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_the_text_for_another_material_is_the_one_that_tune_prints(engine: str) -> None:
    """At 2 ms, under gravity: for an α, and for one e."""
    if engine == "pybullet":
        pytest.importorskip("pybullet")
    chosen = f'at("engine").enter("{engine}"); at("step").enter("0.002")'
    own, rubber = screens(
        chosen + '; at("alpha").enter("other"); at("own-alpha").enter("0.3"); chooseKind("exact")',
        'at("alpha").enter(material("rubber on concrete"))',
    )
    at_2_ms = partial(hb.tune, engine, timestep="2 ms", kind="exact")
    answers = (own, at_2_ms(alpha=0.3)), (rubber, at_2_ms(restitution=0.752))
    for screen, known in answers:
        assert code_lines(screen["paste-text"]) == code_lines(known.text)


def test_for_another_alpha_the_exact_answer_still_comes_first() -> None:
    (typed,) = screens('at("alpha").enter("other"); at("own-alpha").enter("0.3")')
    assert typed["say"].startswith("Attach restitution-law: e within 1e-7")
    assert typed["kinds"].startswith("Plug-in")


def test_a_published_pair_shows_its_one_e_and_claims_no_other() -> None:
    (rubber,) = screens('at("alpha").enter(material("rubber on concrete"))')
    assert rubber["plain"].startswith("rubber on concrete: e = 0.752 at 4.25 m/s.")
    assert "e at other speeds is not known" in rubber["plain"]
    assert rubber["fallen"][0] == pytest.approx(0.01 * 0.752**2)  # of a drop from 10 mm
    assert "choose an α" in rubber["loop-words"]


def test_a_text_keeps_friction_and_gives_way_to_a_command_for_another() -> None:
    plain, other, none = screens(
        'chooseKind("settings")', 'at("friction").enter("0.8")', 'at("friction").enter("0")'
    )
    assert 'condim="3"' in plain["paste-text"] and 'friction="1 1"' in plain["paste-text"]
    assert "It has friction 1, as two bodies of MuJoCo have" in plain["more"]
    assert "--friction 0.8" in other["paste-text"] and other["say"].startswith("Ask for it")
    assert "--friction 0 " in none["paste-text"]


def test_no_answer_of_the_page_takes_friction_away() -> None:
    """Each text of MuJoCo's own settings has a pair with friction; the others leave it as it is."""
    page = REPORT.read_text(encoding="utf-8")
    found = re.search(r'id="explorer-data">(.*?)</script>', page, re.S)
    assert found is not None
    texts = [
        choice["text"] for answer in json.loads(found[1])["answers"] for choice in answer["choices"]
    ]
    pairs = [text for text in texts if "<pair" in text]
    assert len(texts) > 100 and len(pairs) > 30
    assert all('condim="3"' in text and 'friction="1 1"' in text for text in pairs)
    assert not any("lateralFriction" in text for text in texts)


def test_an_error_between_known_ones_is_called_frictionless_unless_that_was_asked() -> None:
    """The table of errors at any α is without friction, and so it names no setting with it."""
    ask = 'at("alpha").enter("other"); at("own-alpha").enter("0.25"); chooseKind("constant")'
    kept, none = screens(ask, 'at("friction").enter("0")')
    assert kept["say"] == "Ask for it: this command finds one e of MuJoCo."
    assert "--friction" not in kept["paste-text"] and "without friction" in kept["kinds"]
    assert none["say"].startswith("Set impulse: e within")
    assert "--friction 0 " in none["paste-text"]
