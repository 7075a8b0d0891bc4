"""The page, the command and Python say the same of the same question;
the page's text is the command's.
"""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

import hcbench
from hcbench.benchmark.study import load_study
from hcbench.cli import run
from hcbench.reporting.ranking import choices
from hcbench.reporting.view import View
from hcbench.sim import registry
from hcbench.tuning import usual
from hcbench.tuning.usual import Question, usual_answers

pytestmark = pytest.mark.usefixtures("tuned_once")

STUDY = load_study(Path(__file__).parents[2] / "reports" / "steel-1lb" / "study.toml").described()
# The answers' own versions: a file has them, and the page leaves it out for others.
VERSIONS = usual.file_content()["versions"]
HERE = {engine: registry.require(engine) for engine in VERSIONS if registry.is_there(engine)}
ALPHAS = (0.004 / 0.0254, 0.008 / 0.0254, 0.016 / 0.0254)
QUESTIONS = [
    Question(engine, step, 9.81, alpha)
    for engine in VERSIONS
    for step in (1e-3, 2e-3, 1 / 240, 5e-3)
    for alpha in ALPHAS
]
NAMED = {"ball": "foot", "plate": "floor"}
# Both engines among them; `make test-answers` asks all.
FEW = [QUESTIONS[i] for i in (1, 22)]


def on_page(question: Question, small_view: View) -> list[dict[str, Any]]:
    """Text of the first screen for a question."""
    (answer,) = (
        answer
        for answer in usual_answers(STUDY, VERSIONS)
        if all(answer[name] == value for name, value in question._asdict().items())
    )
    return [
        {"kind": choice.kind, "say": choice.say, "text": choice.text, "more": " ".join(choice.more)}
        for choice in choices(small_view, answer)
    ]


@pytest.fixture(scope="module")
def small_view() -> View:
    from small_results import small_results

    return View(small_results())


def within(text: str) -> str:
    """ "e within 0.07 from 0.0314 to 0.508 m/s", of any of the three."""
    (found,) = re.findall(r"e within \S+ from \S+ to \S+ m/s", text)
    return str(found)


@pytest.mark.skipif(HERE != VERSIONS, reason="the answers are of other versions of the engines")
@pytest.mark.parametrize(
    "question", QUESTIONS if os.environ.get("HCBENCH_ANSWERS") else FEW, ids=str
)
def test_page_command_and_python_give_the_same_number_and_text(
    question: Question, small_view: View, capsys: pytest.CaptureFixture[str]
) -> None:
    page = on_page(question, small_view)
    for (
        each
    ) in page:  # the page's script puts the reader's names in place of the words ball and plate
        each["text"] = re.sub(r"\b(ball|plate)\b", lambda found: NAMED[found[0]], each["text"])
    names = ("foot", "floor")
    answer = hcbench.tune(question.engine, names, timestep=question.timestep, alpha=question.alpha)
    arguments = ["--alpha", repr(question.alpha), "--timestep", repr(question.timestep)]
    arguments += ["--pair", ",".join(names)]
    assert run(["tune", question.engine, *arguments, "--json"]) == 0
    command = json.loads(capsys.readouterr().out)
    assert page[0]["text"] == answer.best.text == command["paste"]
    assert page[0]["kind"] == answer.best.kind == command["kind"]
    assert {each["kind"]: (within(each["say"]), each["text"]) for each in page} == {
        choice.kind: (within(choice.line), choice.text) for choice in answer.choices
    }
    assert {each["kind"]: (within(each["line"]), each["text"]) for each in command["choices"]} == {
        choice.kind: (within(choice.line), choice.text) for choice in answer.choices
    }
    for note in (answer.band_note, *(never.why for never in answer.never)):
        assert note in page[0]["more"]
    assert any(answer.caution in each["more"] for each in page)
    assert command["never"] == [{"setting": n.setting, "why": n.why} for n in answer.never]


@pytest.mark.adhesion
def test_the_page_knows_the_answer_to_each_of_24_questions(small_view: View) -> None:
    for question in QUESTIONS:
        kinds = [choice["kind"] for choice in on_page(question, small_view)]
        assert kinds[0] == "exact"
        assert {"settings", "constant"} & set(kinds)


def test_a_study_of_another_ball_or_version_has_no_usual_answer() -> None:
    assert usual_answers({**STUDY, "mass_kg": 1.0}, VERSIONS) == []
    assert usual_answers(STUDY, {"mujoco": "3.3.0"}) == []
