"""Tunes an engine to a target: chooses a recipe, makes its setting, and evaluates it in the engine itself."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hcbench.errors import UserError
from hcbench.sim import registry
from hcbench.tune.choose import Match, choose
from hcbench.tune.evaluate import Evaluation, RestResult, evaluate, rest_failures, rest_test
from hcbench.tune.recipe import Recipe, Role, first
from hcbench.tune.search import report_progress
from hcbench.tune.softening import require_end

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.tune.target import Target

_SAME_LOOP = 0.05  # rms of the force over its largest: below it the loop counts as the law's
_DEEP = 0.02  # of the radius: a deeper contact is called soft
_BETTER = 0.9  # of the best constant's error: what an e that falls with speed should be below


@dataclass(frozen=True, slots=True)
class Tuned:
    """A setting, what the engine does with it, why it was chosen, and advice that follows."""

    target: Target
    scene: Scene
    recipe: Recipe
    setting: Setting
    evaluation: Evaluation
    rest: RestResult
    why: str
    advice: tuple[str, ...]


def tune(
    engine: str,
    target: Target,
    scene: Scene,
    recipe: str = "auto",
    match: Match = "restitution",
    integrator: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Tuned:
    """Make a setting that matches a target, and evaluate it at speeds and phases that no recipe has used.

    engine: a registered name. recipe: the name of one of its recipes, or "auto". match: what "auto" aims at.
    integrator: of an engine that has several; None for the recipe's own. progress: called with the
    evaluations of a search (done, at most).
    Raises SettingError where no recipe can serve the target, EngineMissing, EngineFailed, and
    SearchInterrupted with the best so far where an interrupt ends a search.
    """
    adapter = registry.engine(engine)
    adapter.version()
    scene = dataclasses.replace(scene, mass=target.mass)
    require_end(target)
    recipes = registry.recipes(engine)
    if recipe == "auto":
        chosen, why = choose(engine, target, scene, match)
    elif recipe in recipes:
        chosen, why = recipes[recipe], "the recipe asked for"
    else:
        raise UserError("recipe", f"{recipe!r} for {engine!r}", f"one of: auto, {', '.join(recipes)}")
    with report_progress(progress):
        setting = chosen(target, integrator)
    evaluation = evaluate(adapter, scene, setting, target)
    rest = rest_test(adapter, scene, setting)
    advice = tuple(_advice(target, scene, evaluation, rest, adapter.recipes()))
    return Tuned(target, scene, chosen, setting, evaluation, rest, why, advice)


def _advice(
    target: Target, scene: Scene, evaluation: Evaluation, rest: RestResult, recipes: Sequence[Recipe]
) -> Iterator[str]:
    """What to know of a setting, a sentence each."""
    depth, radius = evaluation.penetration_max, scene.relative_radius
    if evaluation.failed:
        yield f"{evaluation.failed} impacts gave no restitution: {evaluation.reason}"
    if not evaluation.max_error < _BETTER * evaluation.constant_error and evaluation.constant_error > 0:
        better = _better(target, scene, recipes)
        yield f"no better than the best constant e = {evaluation.constant:.6g}{better}"
    if depth > _DEEP * radius:
        share = f"{100 * depth / radius:.2g} % of the radius"
        yield f"the contact is soft: {depth:.2g} m deep at the highest speed, {share}"
    if not rest.rests:
        shallow = first(recipes, Role.CONSTANT_E, scene.form)
        other = f"; --recipe {shallow.name} rests shallow" if shallow else ""
        yield f"under gravity {', and '.join(rest_failures(rest, radius))}{other}"
    if not math.isnan(evaluation.loop_rms) and evaluation.loop_rms > _SAME_LOOP:
        yield "forces are not the law's: only the restitution is"


def _better(target: Target, scene: Scene, recipes: Sequence[Recipe]) -> str:
    """What follows a restitution that falls with speed, where a constant e was taken."""
    if target.reading != "points":
        law = first(recipes, Role.LAW, scene.form, native=False)
        return f"; the plug-in `{law.name}` of hcbench.contact follows the law at any step" if law else ""
    falling = first(recipes, Role.FALLING_E, scene.form)
    sentences = [target.fitting_law()]
    if falling:
        sentences.insert(0, f"--recipe {falling.name} has an e that falls with speed, in a softer contact")
    return "".join(f"; {sentence}" for sentence in sentences if sentence)
