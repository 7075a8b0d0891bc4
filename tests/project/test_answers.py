"""The page of answers: each command prints what the page shows of it."""

from __future__ import annotations

import re
import shlex
from functools import cache
from pathlib import Path

import pytest
from same_text import LEFT_OUT, is_within

from hcbench.cli import run

pytestmark = pytest.mark.usefixtures("tuned_once")

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "answers.md").read_text(encoding="utf-8")
ANSWERS = re.findall(r"```sh\n(.*?)```\n\n```text\n(.*?)```", PAGE, re.DOTALL)


@cache
def words(command: str) -> tuple[str, ...]:
    return tuple(shlex.split(command)[1:])


def commands(block: str) -> list[str]:
    return [line.strip() for line in block.replace("\\\n", " ").splitlines()]


@pytest.fixture(scope="module")
def printed() -> dict[str, list[str]]:
    return {}


def output(
    command: str, printed: dict[str, list[str]], capsys: pytest.CaptureFixture[str]
) -> list[str]:
    """The lines of a command, single-spaced; each command runs once."""
    if command not in printed:
        run(list(words(command)))
        shown = capsys.readouterr()
        printed[command] = [" ".join(line.split()) for line in (shown.out + shown.err).splitlines()]
    return printed[command]


@pytest.mark.locked_engines
@pytest.mark.parametrize(("block", "shown"), ANSWERS, ids=lambda text: text.split("\n")[0][:60])
def test_a_command_prints_what_the_page_shows(
    block: str,
    shown: str,
    printed: dict[str, list[str]],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if "pybullet" in block or "bullet.py" in block or ".urdf" in block:
        pytest.importorskip("pybullet")
    monkeypatch.chdir(ROOT)
    lines = [line for command in commands(block) for line in output(command, printed, capsys)]
    assert shown.strip()
    for line in shown.splitlines():
        part = LEFT_OUT.join(words.strip() for words in line.split(LEFT_OUT))
        at = next((i for i, each in enumerate(lines) if is_within(part, each)), None)
        assert at is not None, line
        del lines[: at + 1]  # in this order


def test_at_least_24_questions_are_answered_of_40() -> None:
    open_ones = PAGE.partition("## Not answered here")[2]
    assert len(ANSWERS) >= 24
    assert len(ANSWERS) + open_ones.count("\n| ") - 1 >= 40


# Scenes of the askers, or of whoever has none, each with a thread of the engine that runs it.
OWN_SCENES = {
    "mujoco_2080.xml": "mujoco 2080",
    "bullet.py:wall": "bullet3 3094",
    "bullet.py:drop": "bullet3 1530",
    "newton_1137.py": "newton 1137",
}


def test_an_answer_says_first_where_its_scene_is_not_the_askers() -> None:
    seen = set[str]()
    for answer in PAGE.partition("## Not answered here")[0].split("\n**")[1:]:
        said, _, rest = answer.partition("```sh")
        command, *_ = rest.partition("```")
        of_a_scene = re.search(r"hcbench (measure|check|pairs|tune|cases)", command)
        own = {
            scene
            for scene, thread in OWN_SCENES.items()
            if scene in said + command and thread in answer.partition(")")[0]
        }
        seen |= own
        if of_a_scene and not own:
            assert re.match(r"[^(]*\([^)]*\)\.? Not ", answer), answer
    assert seen == {*OWN_SCENES}
