"""Chooses a recipe by what it matches and by how many steps the law's
contact lasts, never by its name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from hcbench.recipes.constant import steps_per_contact
from hcbench.recipes.recipe import Recipe, Role, first
from hcbench.sim import registry
from hcbench.system.errors import SettingError
from hcbench.system.text import time_step
from hcbench.terms.resolution import STEPS_OF_A_LOOP

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.recipes.target import Target
    from hcbench.terms.scene import Scene

Match = Literal["restitution", "loop", "both"]


def candidates(engine: str, target: Target, scene: Scene, match: Match) -> list[tuple[Recipe, str]]:
    """An engine's own recipes that may serve a target, the simplest first, and what each promises.

    match: what the setting aims at: one recipe for the loop; for restitution all that "auto" tries
    in turn.
    Raises SettingError where there is none, UserError for an unknown engine.
    """
    recipes = registry.preferred(engine)
    form = scene.form
    steps = steps_per_contact(target)
    contact = f"the law's contact lasts {steps:.3g} steps of {time_step(target.timestep)} s"
    if match != "restitution":
        return [_choose_for_loop(engine, recipes, target, form, match, contact)]
    promises = {Role.CONSTANT_E: "one restitution for all speeds"}
    if not target.is_constant:
        promises[Role.FALLING_E] = "restitution that falls with speed"
        if target.reading == "law":
            as_law = "restitution that falls with speed as the law's does"
            promises |= {Role.LAW: as_law, Role.LAW_AND_LOOP: as_law}

    def serves(recipe: Recipe, role: Role) -> bool:
        """Say whether "auto" may take a recipe for this role, in this form and at this step."""
        if not (recipe.native and recipe.by_auto):
            return False
        if recipe.role is not role or form not in recipe.forms:
            return False
        if target.gravity and recipe.steps_min_with_gravity > steps:
            return False
        return recipe.steps_min <= steps

    chosen = []
    for role, promise in promises.items():
        why = f"{promise}; {contact}"
        chosen += [(recipe, why) for recipe in recipes if serves(recipe, role)]
    if not chosen:
        names = ", ".join(registry.recipes(engine))
        got = f"'auto' has no recipe for {engine!r} here"
        raise SettingError("recipe", got, f"one of: {names}", "Name one with --recipe")
    return chosen


def _choose_for_loop(
    engine: str, recipes: Sequence[Recipe], target: Target, form: str, match: Match, contact: str
) -> tuple[Recipe, str]:
    """Native recipe whose loop is that of the law, and what it promises.

    recipes: the engine's. form: of the scene.
    contact: how many steps the law's contact lasts, as a sentence.
    Raises SettingError where the step does not resolve the loop, for a target without α, and for an
    engine without such a recipe.
    """
    steps = steps_per_contact(target)
    if steps < STEPS_OF_A_LOOP:
        nearest = target.timestep * steps / STEPS_OF_A_LOOP
        raise SettingError(
            "match",
            f"the loop, where {contact}",
            f"at least {STEPS_OF_A_LOOP:g} steps",
            f"Use a step of {nearest:.2g} s or less, a lower stiffness, or --match restitution",
        )
    if target.reading != "law":
        slot, given = target.described()
        raise SettingError(
            slot,
            f"{given}, with --match {match}",
            "α of the law, by --alpha: only the law has a loop",
            "Use --match restitution",
        )
    native = first(recipes, Role.LAW_AND_LOOP, form, steps)
    if native is not None:
        return native, f"the only native setting with the law's loop; {contact}"
    plug_in = first(recipes, Role.LAW_AND_LOOP, form, steps, native=False)
    other = ""
    if plug_in is not None:
        other = f"the plug-in `{plug_in.name}` of hcbench.contact, or "
    raise SettingError(
        "match",
        f"the loop in {engine!r}",
        "a setting whose loop is the law's",
        f"Use {other}--match restitution",
    )
