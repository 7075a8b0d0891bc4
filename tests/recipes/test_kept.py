"""Search results are kept, and never change the settings of a recipe."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from hcbench.laws.force import HuntCrossley
from hcbench.recipes import kept
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.terms.setting import Setting

TARGET = Target(HuntCrossley(3.4064e10, 0.315, 1.5), 0.45359237, 1e-3, 0.1, 0.5)
VERSIONS = {"hcbench": "1", "mujoco": "2"}
RECIPE = registry.recipe("mujoco.impulse")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Place of the recipe's setting in a new cache folder; every setting counts as one that a
    search found.
    """
    monkeypatch.setenv("HCBENCH_CACHE", str(tmp_path))
    monkeypatch.setattr(kept, "_WORTH_S", 0.0)
    place = kept.place_of(RECIPE, TARGET, VERSIONS)
    assert place is not None
    assert place.is_relative_to(tmp_path)
    return place


def test_what_was_found_is_read_back_as_it_was(place: Path) -> None:
    assert kept.kept(RECIPE, TARGET, place) is None
    found = kept.make(RECIPE, TARGET, place)
    assert found == RECIPE(TARGET)
    assert kept.kept(RECIPE, TARGET, place) == found


@pytest.mark.parametrize(
    "change", [lambda text: text[:-1], lambda text: text.replace("0", "1"), lambda _: "\0"]
)
def test_a_file_that_is_not_whole_is_searched_for_again(place: Path, change: object) -> None:
    found = kept.make(RECIPE, TARGET, place)
    place.write_text(change(place.read_text()))  # type: ignore[operator]
    assert kept.kept(RECIPE, TARGET, place) is None
    assert kept.make(RECIPE, TARGET, place) == found == kept.kept(RECIPE, TARGET, place)


def test_where_others_may_write_nothing_is_read(place: Path) -> None:
    kept.make(RECIPE, TARGET, place)
    place.parent.chmod(0o777)
    assert kept.kept(RECIPE, TARGET, place) is None


def test_without_a_folder_the_search_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "_WORTH_S", 0.0)
    monkeypatch.setenv("HCBENCH_CACHE", "/dev/null")
    place = kept.place_of(RECIPE, TARGET, VERSIONS)
    assert kept.make(RECIPE, TARGET, place) == RECIPE(TARGET)
    assert kept.kept(RECIPE, TARGET, place) is None


def test_another_target_version_or_recipe_has_another_place(place: Path) -> None:
    others = [
        kept.place_of(RECIPE, replace(TARGET, speed_max=0.6), VERSIONS),
        kept.place_of(RECIPE, TARGET, {**VERSIONS, "mujoco": "3"}),
        kept.place_of(registry.recipe("mujoco.compliant"), TARGET, VERSIONS),
    ]
    assert len({place, *others}) == 4


def test_a_recipe_of_another_package_is_not_kept() -> None:
    def foreign(_: Target) -> dict[str, float]:
        return {}

    assert kept.place_of(replace(RECIPE, function=foreign), TARGET, VERSIONS) is None
    assert isinstance(kept.make(replace(RECIPE, function=foreign), TARGET, None), Setting)
