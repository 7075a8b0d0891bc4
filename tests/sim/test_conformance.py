"""Every engine keeps what `hcbench.testing` asks, ours and those of others alike."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from long_searches import LONG, long_search
from ready_settings import SEARCHES, ready_setting

import hcbench.testing
from hcbench.laws.published import LAWS, PublishedLaw
from hcbench.sim import registry
from hcbench.terms.scene import scene_names
from hcbench.testing import LAUNCHES, EngineConformance, impacts_for, setting_for

if TYPE_CHECKING:
    from collections.abc import Iterator

DAMPED = {"pybullet": {"stock_damping": 0.01}}  # its linearDamping of 0.04 slows the flight

# Published laws differ in one term of the force: one of them stands for all where no e is asked
# for. The e of every law is that of `test_later_laws_deliver_...` below.
ALIKE = {law.slug for law in LAWS.values()} - {"flores"}
# It takes longer than all other settings of the small engines together. Its e at two stiffnesses
# is in tests/engines/test_small_engines.py.
SLOW = {"drake.discrete"}


def _cases_of_this_run(cls: type[EngineConformance], test: Any) -> list[tuple[str, str]]:
    """Recipes and scenes of a test: `make test-all` takes every law and what is slow, too."""
    cases: list[tuple[str, str]] = EngineConformance._cases.__func__(cls, test)  # type: ignore[attr-defined]
    if LONG:
        return cases
    return [
        (name, scene)
        for name, scene in cases
        if name.partition(".")[2] not in ALIKE and name not in SLOW
    ]


WITH_RECIPES = [name for name in registry.names() if registry.recipes(name)]
for _name in WITH_RECIPES:
    if registry.is_there(_name):
        _title = f"Test{_name.title()}"
        _about = {
            "engine": _name,
            "_cases": classmethod(_cases_of_this_run),
            **DAMPED.get(_name, {}),
        }
        globals()[_title] = type(_title, (EngineConformance,), _about)


@pytest.fixture(autouse=True, scope="module")
def ready() -> Iterator[None]:
    """Settings that take long to search for come from a file; `make test-all` searches for them."""
    with pytest.MonkeyPatch.context() as patch:
        if not LONG:
            patch.setattr(hcbench.testing, "setting_for", ready_setting)
        yield


@long_search
@pytest.mark.locked_engines
@pytest.mark.parametrize(("recipe", "scene"), SEARCHES)
def test_a_setting_of_the_file_is_what_its_recipe_finds(recipe: str, scene: str) -> None:
    """`python tests/support/ready_settings.py` writes the file."""
    assert ready_setting(recipe, scene) == setting_for(recipe, scene)


@pytest.mark.needs_engine
@pytest.mark.parametrize("engine", WITH_RECIPES)
def test_every_engine_that_is_installed_is_tested(engine: str) -> None:
    assert issubclass(globals()[f"Test{engine.title()}"], EngineConformance)


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.slug)
@pytest.mark.parametrize(
    "engine", [name for name in registry.names() if "flores" in registry.recipes(name)]
)
def test_later_laws_deliver_what_follows_from_their_chi_at_every_speed_and_phase(
    engine: str, law: PublishedLaw
) -> None:
    setting, scenes = setting_for(f"{engine}.{law.slug}", "steel-plane"), scene_names()
    asked = setting.options.get("law", setting.options)["restitution"]
    e = [i.restitution for scene in scenes for i in impacts_for(f"{engine}.{law.slug}", scene)]
    assert len(e) == len(scenes) * len(LAUNCHES)
    tolerance = 1e-13 if engine == "reference" else 5e-8
    assert np.abs(np.array(e) - float(law.delivered(asked))).max() < tolerance
