"""Pages show what the commands print: every session is run again, in an
empty folder with the examples.
"""

from __future__ import annotations

import os
from pathlib import Path

import notebooks
import pytest
from same_text import is_same
from sessions import PAGES, ROOT, Shell, agrees, page_steps, prepare, rewritten

pytestmark = pytest.mark.usefixtures("tuned_once")

WITH_SESSIONS = [page for page in PAGES if page_steps(page)]


@pytest.mark.locked_engines
@pytest.mark.parametrize("page", WITH_SESSIONS, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_page_shows_what_its_commands_print(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(prepare(page, tmp_path))
    monkeypatch.setenv("HCBENCH_DATA", os.devnull)
    shell, wrong = Shell(), []
    for step in page_steps(page):
        printed = shell.printed(step)
        if not agrees(step.shown, printed):
            wrong.append("\n".join([f"$ {step.command}", *rewritten(step.shown, printed)]))
    assert not wrong, "\n\n".join(["`make sessions` writes:", *wrong])


@pytest.mark.locked_engines
@pytest.mark.parametrize("page", notebooks.PAGES, ids=lambda p: p.name)
def test_a_notebook_shows_what_its_cells_do(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HCBENCH_DATA", os.devnull)
    stored, executed = (
        notebooks.texts(outputs) for outputs in (notebooks.stored(page), notebooks.executed(page))
    )
    assert notebooks.agrees(stored, executed), (stored, executed)


def test_lines_left_out_may_be_any() -> None:
    printed = ["a 1", "b 2", "c 3", "d 4"]
    assert agrees(("a 1", "b 2", "c 3", "d 4"), printed)
    assert agrees(("a ...", "...", "d 4"), printed)
    assert agrees(("...", "b 2", "...", "d ..."), printed)
    assert agrees(("...", "c 3", "d 4"), printed)
    assert not agrees(("a 1", "b 2"), printed)
    assert not agrees(("a 1", "...", "c 3"), printed)
    assert not agrees(("...", "c 3", "...", "b 2", "..."), printed)


def test_a_session_is_written_again_with_the_same_lines_left_out() -> None:
    printed = ["head 1.2.3", "a 0.11", "b", "c 0.33", "tail"]
    assert rewritten((), printed) == ["head ...", "a 0.11", "b", "c 0.33", "tail"]
    assert rewritten(("head 1...", "...", "c 0.30", "..."), printed) == [
        "head 1...",
        "...",
        "c 0.33",
        "...",
    ]
    assert rewritten(("...", "b", "...", "c 0.33", "tail"), printed) == [
        "...",
        "b",
        "c 0.33",
        "tail",
    ]


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("α 0.2979449282603493 s/m", "α 0.29794492826034896 s/m", True),
        ("α 0.297945 s/m", "α 0.297946 s/m", False),
        ("α -47.5427... 1/s", "α -47.54270011 1/s", True),
        ("e 0.5 in 10 of 16", "e 0.5 in 11 of 16", False),
        ("e 1e-09, 0.25", "e 1.0000000001e-09, 0.25", True),
        ("e 0.25", "e -0.25", False),
        ("mujoco 3.12.1", "mujoco 3.12.2", False),
    ],
)
def test_numbers_are_compared_by_value_and_words_by_their_letters(
    shown: str, printed: str, same: bool
) -> None:
    assert is_same(shown, printed) == same
