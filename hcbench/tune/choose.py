"""Chooses a recipe by what it matches and by how many steps the law's contact lasts, never by its name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from hcbench.errors import SettingError
from hcbench.sim import registry
from hcbench.tune.recipe import Recipe, Role, first
from hcbench.tune.softening import FEWEST_STEPS, steps_per_contact

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.scene import Scene
    from hcbench.tune.target import Target

Match = Literal["restitution", "loop", "both"]


def choose(engine: str, target: Target, scene: Scene, match: Match) -> tuple[Recipe, str]:
    """An engine's own recipe for a target, and why. Raises SettingError when none can match it."""
    recipes, form = registry.engine(engine).recipes(), scene.form
    steps = steps_per_contact(target)
    contact = f"the law's contact lasts {steps:.3g} steps of {target.timestep:g} s"
    if match != "restitution":
        return _choose_for_loop(engine, recipes, target, form, match, contact)
    if not target.is_constant:
        softened = "; its springs are softened for more" if steps < FEWEST_STEPS else ""
        for role in (Role.LAW_AND_LOOP, Role.LAW) if target.reading == "law" else ():
            if recipe := first(recipes, role, form, steps):
                return recipe, f"restitution that falls with speed as the law's does; {contact}{softened}"
        if recipe := first(recipes, Role.FALLING_E, form, steps):
            return recipe, f"restitution that falls with speed; {contact}{softened}"
    if recipe := first(recipes, Role.CONSTANT_E, form, steps):
        exact = ", exact at any step" if recipe.one_step else ""
        return recipe, f"one restitution for all speeds{exact}; {contact}"
    names = ", ".join(registry.recipes(engine))
    raise SettingError(
        "recipe", f"'auto' knows none for {engine!r}", f"one of: {names}", "Name one with --recipe"
    )


def _choose_for_loop(
    engine: str, recipes: Sequence[Recipe], target: Target, form: str, match: Match, contact: str
) -> tuple[Recipe, str]:
    steps = steps_per_contact(target)
    if steps < FEWEST_STEPS:
        nearest = target.timestep * steps / FEWEST_STEPS
        raise SettingError(
            "match",
            f"the loop, where {contact}",
            f"at least {FEWEST_STEPS:g} steps",
            f"Use a step of {nearest:.2g} s or less, a lower stiffness, or --match restitution",
        )
    if target.reading != "law":
        slot, given = target.described()
        raise SettingError(
            slot,
            f"{given}, with --match {match}",
            "α of eq. (16), by --alpha: only the law has a loop",
            "Use --match restitution",
        )
    if recipe := first(recipes, Role.LAW_AND_LOOP, form, steps):
        return recipe, f"the only native setting with the law's loop; {contact}"
    plug_in = first(recipes, Role.LAW_AND_LOOP, form, steps, native=False)
    other = f"the plug-in `{plug_in.name}` of hcbench.contact, or " if plug_in else ""
    raise SettingError(
        "match",
        f"the loop in {engine!r}",
        "a setting whose loop is the law's",
        f"Use {other}--match restitution",
    )
