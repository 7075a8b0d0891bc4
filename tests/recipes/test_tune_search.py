"""Searches tell how far they are, and an interrupt in the middle of one
hands out the best until then.
"""

from __future__ import annotations

import json
import math
import re
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from hcbench.cli import run
from hcbench.engines.mujoco.engine import MujocoEngine
from hcbench.engines.mujoco.recipes import one_row, two_pair
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.recipe import Search, SearchInterrupted, report_progress
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.terms.impact import Launch
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Setting

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SCENE = load_scene("steel-plane")
ALPHA = 0.008 / 0.0254


TARGET = Target(HuntCrossley(SCENE.stiffness, ALPHA), SCENE.mass, 1e-5, 0.0254, 0.508)


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search of few generations, that nothing is remembered of."""
    for name, value in {"_GENERATIONS": 3, "_POLISH_TWO": 20, "_POLISH_ALL": 20}.items():
        monkeypatch.setattr(one_row, name, value)
    one_row._search.cache_clear()
    monkeypatch.setattr(two_pair, "_STEPS_MAX", 4)


def searched(recipe: str, progress: Any = None) -> Setting:
    with report_progress(progress):
        made: Setting = registry.recipe(f"mujoco.{recipe}")(TARGET)
        return made


@pytest.mark.parametrize("recipe", ["soft", "two-pair"])
def test_a_search_tells_how_far_it_is_and_is_not_changed_by_that(recipe: str) -> None:
    reported: list[tuple[int, int]] = []
    seen = searched(recipe, lambda done, total: reported.append((done, total)))
    one_row._search.cache_clear()
    assert seen.key == searched(recipe).key
    done, totals = np.array(reported).T
    assert (np.diff(done) >= 0).all()
    assert len(set(totals)) == 1
    assert 0 < done[0] <= totals[0] / 4
    assert totals[0] / 4 < done[-1] <= totals[0]


def test_a_fit_in_stages_tells_them_to_the_end() -> None:
    reported: list[tuple[int, int]] = []
    searched("staggered-push", lambda done, total: reported.append((done, total)))
    done, totals = np.array(reported).T
    assert (np.diff(done) >= 0).all()
    assert len(reported) > 50
    assert set(totals) == {done[-1]}


@pytest.mark.parametrize("recipe", ["soft", "two-pair"])
def test_a_search_that_is_interrupted_hands_out_its_best(recipe: str) -> None:
    def interrupt(done: int, total: int) -> None:
        if done > 20:
            raise KeyboardInterrupt

    with pytest.raises(SearchInterrupted, match=r"cut short after \d+ of at most") as caught:
        searched(recipe, interrupt)
    cut = caught.value
    assert 20 < cut.done < cut.budget
    assert isinstance(cut.best, Setting)
    assert cut.best.name == recipe
    if recipe == "soft":  # what it says of itself is what the engine does with it
        v = [0.05, 0.2, 0.45]
        impacts = MujocoEngine().run(SCENE, cut.best, [Launch(speed) for speed in v])
        off = [abs(i.restitution - closed_form.restitution(ALPHA, i.speed_in)) for i in impacts]
        assert max(off) < cut.error + 1e-3
        assert cut.error < 0.06, "no worse than the best constant e"


def test_the_best_of_a_search_is_the_least_error_seen() -> None:
    search = Search(10)
    with pytest.raises(SearchInterrupted) as caught, search.interrupt_with_best():
        search.record(np.array([[1.0], [2.0]]), np.array([0.3, math.nan]))
        search.record(np.array([[3.0], [4.0]]), np.array([0.1, 0.2]))
        search.record(np.array([[5.0]]), np.array([0.4]))
        raise KeyboardInterrupt
    assert (caught.value.best, caught.value.error) == ([3.0], 0.1)
    assert (caught.value.done, caught.value.budget) == (5, 10)


@pytest.mark.parametrize("as_json", [False, True])
def test_the_command_prints_what_a_search_has_found_when_it_is_interrupted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], as_json: bool
) -> None:
    @contextmanager
    def impatient(what: str) -> Iterator[Callable[[int, int], None]]:
        def tick(done: int, total: int) -> None:
            if done > 50:
                raise KeyboardInterrupt

        yield tick

    # `hcbench.cli.tune` is the command, not its module.
    monkeypatch.setattr(sys.modules["hcbench.cli.tune"], "progress", impatient)
    arguments = [
        "tune",
        "mujoco",
        "--alpha",
        "0.008 s/in",
        "--timestep",
        "1e-6",
        "--recipe",
        "soft",
    ]
    assert run([*arguments, "--json"] if as_json else arguments) == 130
    caught = capsys.readouterr()
    (line,) = caught.err.splitlines()
    assert re.fullmatch(
        r"hcbench: interrupted: the search was cut short after \d+ of at most \d+ evaluations", line
    )
    if as_json:
        said = json.loads(caught.out)
        assert said["cut_short"]["evaluations"] < said["cut_short"]["at_most"]
        assert said["options"]["rows"] and "solref" in said["paste"]
    else:
        assert "the best so far" in caught.out
        assert re.search(r"largest error of e +0\.\d+ by the search's own model", caught.out)
        assert "solref=" in caught.out


def test_an_interrupt_before_anything_was_found_is_just_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupt(*_: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(one_row, "_restitution", interrupt)
    with pytest.raises(KeyboardInterrupt) as caught:
        searched("soft")
    assert not isinstance(caught.value, SearchInterrupted)
