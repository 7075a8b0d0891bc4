"""Tunes an engine to a target: chooses a recipe, makes its setting, and evaluates it in the engine itself."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hcbench._notebook import Shown
from hcbench.errors import EngineFailed, EngineMissing, HcbenchError, SettingError, UserError
from hcbench.recipes.constant import minimax_constant
from hcbench.recipes.recipe import Recipe, Role, first
from hcbench.recipes.search import report_progress
from hcbench.recipes.softening import require_end
from hcbench.sim import registry
from hcbench.tuning.choose import Match, candidates
from hcbench.tuning.evaluate import Evaluation, RestResult, evaluate, rest_failures, rest_test

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from hcbench.recipes.target import Target
    from hcbench.scene import Scene
    from hcbench.setting import Setting

MAX_ERROR = 0.05  # of e: what "auto" asks of a setting
_SAME_LOOP = 0.05  # rms of the force over its largest: below it the loop counts as the law's
_DEEP = 0.02  # of the radius: a deeper contact is called soft
_CLEARLY = 0.8  # of a constant e's error: what a setting with more to it must stay below
_BETTER = 0.9  # of the best constant's error: what an e that falls with speed should be below


@dataclass(frozen=True, slots=True)
class Tuned(Shown):
    """A setting, what the engine does with it, why it was chosen, and advice that follows."""

    target: Target
    scene: Scene
    recipe: Recipe
    setting: Setting
    evaluation: Evaluation
    rest: RestResult
    why: str
    advice: tuple[str, ...]

    @property
    def error(self) -> float:
        """Largest error of e; infinite where an impact has none."""
        off = self.evaluation.max_error
        return math.inf if self.evaluation.failed or math.isnan(off) else off

    def holds(self, max_error: float) -> bool:
        """Whether it can be recommended in the target's conditions."""
        return self.error <= max_error and not self.flaws

    @property
    def flaws(self) -> str:
        """What keeps it from being recommended however well it bounces; "" where nothing does."""
        deep = "deep" if self.evaluation.deep else ""
        return ", ".join(filter(None, [deep, "" if self.rest.rests else "does not rest"]))


def tune(
    engine: str,
    target: Target,
    scene: Scene,
    recipe: str = "auto",
    match: Match = "restitution",
    integrator: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    max_error: float = MAX_ERROR,
) -> Tuned:
    """Make a setting that matches a target, and evaluate it under the target's gravity and friction.

    engine: a registered name. recipe: the name of one of its recipes, or "auto": the simplest that stays
    within `max_error`, rests, and is no deeper than the step asks for; where none does, the best constant e,
    unless another that rests is twice as near.
    match: what "auto" aims at. integrator: of an engine that has several; None for the recipe's own.
    progress: called with the evaluations of a search (done, at most).
    Raises SettingError where no recipe can serve the target, EngineMissing, EngineFailed, and
    SearchInterrupted with the best so far where an interrupt ends a search.
    """
    registry.require(engine)
    scene = dataclasses.replace(scene, mass=target.mass, gravity=target.gravity, friction=target.friction)
    if target.friction and scene.form == "plane":  # a solid ball as large as it looks
        scene = dataclasses.replace(scene, ball_radius=scene.relative_radius, plate_radius=math.inf)
    require_end(target)
    recipes = registry.recipes(engine)
    if recipe == "auto":
        with report_progress(progress):
            to_try = candidates(engine, target, scene, match)
            return _measured(_first_that_holds(to_try, target, scene, integrator, max_error))
    if recipe not in recipes:
        raise UserError("recipe", f"{recipe!r} for {engine!r}", f"one of: auto, {', '.join(recipes)}")
    with report_progress(progress):
        return _measured(_tuned(recipes[recipe], "the given recipe", target, scene, integrator))


def _measured(tuned: Tuned) -> Tuned:
    """The result. Raises EngineFailed where launches gave no restitution: they are never a verdict."""
    evaluation = tuned.evaluation
    if evaluation.failed or not math.isfinite(evaluation.max_error):
        slot = f"{tuned.setting.engine} {tuned.recipe.name!r}"
        got = f"{evaluation.failed} launches gave no restitution: {evaluation.reason or 'not a number'}"
        raise EngineFailed(
            slot, got, "a bounce from each", "Try other speeds, another step or another --recipe"
        )
    return tuned


def _tuned(recipe: Recipe, why: str, target: Target, scene: Scene, integrator: str | None) -> Tuned:
    """A recipe's setting, evaluated in its engine."""
    adapter = registry.engine(recipe.engine)
    setting = recipe(target, integrator)
    if target.friction:
        setting = adapter.with_friction(setting, target.friction)
    evaluation = evaluate(adapter, scene, setting, target)
    rest = rest_test(adapter, scene, setting)
    advice = tuple(_advice(target, scene, evaluation, rest, recipe, registry.preferred(recipe.engine)))
    return Tuned(target, scene, recipe, setting, evaluation, rest, why, advice)


def _first_that_holds(
    to_try: Sequence[tuple[Recipe, str]],
    target: Target,
    scene: Scene,
    integrator: str | None,
    max_error: float,
) -> Tuned:
    """The first candidate that holds in the target's conditions; else the best constant e, or what is clearly
    nearer and rests.

    Raises the first candidate's error where none can be made at all.
    """
    _, constant_error = minimax_constant(target)
    constants = [each for each in to_try if each[0].role is Role.CONSTANT_E]
    others = [each for each in to_try if each not in constants]
    # A constant e is the simplest: first where it can hold, else last, to compare the others with.
    enough = constant_error <= max_error
    tried: list[Tuned] = []
    refused: list[HcbenchError] = []
    for recipe, why in [*constants, *others] if enough else [*others, *constants]:
        try:
            tuned = _tuned(recipe, why, target, scene, integrator)
        except (SettingError, EngineMissing) as error:  # such as a version that lacks what one recipe needs
            refused.append(error)
            continue
        tried.append(tuned)
        may_hold = enough or recipe.role is not Role.CONSTANT_E
        if may_hold and (tuned.holds(max_error) or len(to_try) == 1):
            return tuned
    if not tried:
        raise refused[0]
    usable = [t for t in tried if t.holds(math.inf)] or tried
    nearest = min(t.error for t in usable)
    simplest = sorted(usable, key=lambda t: (t.recipe.role is not Role.CONSTANT_E, t.error))
    best = next(t for t in simplest if t.error * _CLEARLY <= nearest)
    off = ", ".join(f"{t.recipe.name} {t.error:.2g}{f' ({t.flaws})' if t.flaws else ''}" for t in tried)
    return dataclasses.replace(best, why=f"no native setting holds within {max_error:g} here: {off}")


def _advice(
    target: Target,
    scene: Scene,
    evaluation: Evaluation,
    rest: RestResult,
    recipe: Recipe,
    recipes: Sequence[Recipe],
) -> Iterator[str]:
    """What to know of a setting of a recipe, a sentence each. recipes: all of its engine's."""
    depth, radius = evaluation.penetration_max, scene.relative_radius
    if not evaluation.max_error < _BETTER * evaluation.constant_error and evaluation.constant_error > 0:
        better = _better(target, scene, recipes) if recipe.native else ""
        yield f"no better than the best constant e = {evaluation.constant:.6g}{better}"
    if depth > _DEEP * radius:
        share = f"{100 * depth / radius:.2g} % of the radius"
        yield f"the contact is soft: {depth:.2g} m deep at the highest speed, {share}"
    if not rest.rests:
        shallow = first(recipes, Role.CONSTANT_E, scene.form)
        other = f"; --recipe {shallow.name} rests shallow" if shallow and shallow is not recipe else ""
        yield f"under gravity {', and '.join(rest_failures(rest, radius))}{other}"
    if not math.isnan(evaluation.loop_rms) and evaluation.loop_rms > _SAME_LOOP:
        yield "forces are not the law's: only the restitution is"


def _better(target: Target, scene: Scene, recipes: Sequence[Recipe]) -> str:
    """What follows a restitution that falls with speed, where a constant e was taken."""
    if target.reading != "points":
        law = first(recipes, Role.LAW, scene.form, native=False)
        return f"; the plug-in `{law.name}` follows the law at any step" if law else ""
    falling = first(recipes, Role.FALLING_E, scene.form)
    sentences = [target.fitting_law()]
    if falling:
        sentences.insert(0, f"--recipe {falling.name} has an e that falls with speed, in a softer contact")
    return "".join(f"; {sentence}" for sentence in sentences if sentence)
