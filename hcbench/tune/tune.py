"""Tune an engine to a target: choose a recipe, make its setting, let the engine itself be the judge."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from hcbench.errors import SettingError, UserError
from hcbench.laws import closed_form
from hcbench.sim import registry
from hcbench.tune.evaluate import Rest, Verdict, faults, judge, settle
from hcbench.tune.search import watched
from hcbench.tune.softening import FEWEST_STEPS
from hcbench.tune.target_kind import describe, law_that_fits

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.tune.target import Recipe, Target

GROUP = "hcbench.recipes"
Match = Literal["restitution", "loop", "both"]
# A cup's contact is a tendon's limit, which cannot pull.
_STAGGERED = {"plane": "staggered", "cup": "staggered-push"}
_LOOP_RIGHT = 0.05  # of the largest force: what counts as the law's loop


@dataclass(frozen=True, slots=True)
class Tuned:
    """A setting, what the engine does with it, and why it was chosen.

    rest: None where the engine cannot be followed. alternatives: recipes that were not taken, each with why.
    """

    target: Target
    scene: Scene
    recipe: Recipe
    setting: Setting
    verdict: Verdict
    rest: Rest | None
    why: str
    advice: tuple[str, ...]


def recipes_of(engine: str) -> dict[str, Recipe]:
    """An engine's recipes by name; UserError for an engine that has none."""
    registry.engine(engine)
    names = [name for name in registry.names(GROUP) if name.startswith(f"{engine}.")]
    return {recipe.name: recipe for recipe in (registry.load(GROUP, name) for name in names)}


def steps_a_contact(target: Target) -> float:
    """Steps in the law's own shortest contact of the band."""
    return float(closed_form.duration(target.law, target.mass, target.speed_max)) / target.timestep


def _seen(target: Target) -> str:
    return f"the law's contact lasts {steps_a_contact(target):.3g} steps of {target.timestep:g} s"


def choose(engine: str, target: Target, scene: Scene, match: Match) -> tuple[str, str]:
    """The recipe's name, and why. Raises SettingError when nothing there reaches the wish."""
    steps, known = steps_a_contact(target), recipes_of(engine)
    one = len({e for _, e in target.points}) == 1 if target.points else target.law.alpha == 0
    constant = one or target.speed_min == target.speed_max
    seen = _seen(target)
    if match in ("loop", "both"):
        return _choose_loop(engine, known, target, match, _STAGGERED[scene.form])
    staggered = _STAGGERED[scene.form]
    soft = f"{seen}; its springs are softened for more" if steps < FEWEST_STEPS else seen
    if target.reading == "law" and not constant and staggered in known:
        return staggered, f"restitution that falls with speed as the law's does; {soft}"
    if not constant:
        # A restitution that falls with speed, but is not the law's, or not on a plane.
        for name in ("two-pair", "soft") if steps >= FEWEST_STEPS else ("two-pair",):
            if name in known and (name != "two-pair" or scene.form == "plane"):
                return name, f"restitution that falls with speed; {soft}"
    one_step = {"mujoco": "impulse", "pybullet": "restitution"}.get(engine)
    if one_step in known:
        return one_step, f"one restitution for all speeds, exact at any step; {seen}"
    raise SettingError(
        "recipe", f"'auto' knows none for {engine!r}", f"one of: {', '.join(known)}", "Name one with --recipe"
    )


def _choose_loop(
    engine: str, known: dict[str, Recipe], target: Target, match: Match, staggered: str
) -> tuple[str, str]:
    steps, seen = steps_a_contact(target), _seen(target)
    if steps < FEWEST_STEPS:
        nearest = target.timestep * steps / FEWEST_STEPS
        raise SettingError(
            "match",
            f"the loop, where {seen}",
            f"at least {FEWEST_STEPS:g} steps",
            f"Use a step of {nearest:.2g} s or less, a lower stiffness, or --match restitution",
        )
    if target.reading == "law" and staggered in known:
        return staggered, f"the only native setting with the law's loop; {seen}"
    slot, given = describe(target)
    own = target.reading == "law"
    raise SettingError(
        "match" if own else slot,
        f"the loop in {engine!r}" if own else f"{given}, with --match {match}",
        "a setting whose loop is the law's" if own else "α of eq. (16), by --alpha: only the law has a loop",
        "Use the plug-in `hunt-crossley` of hcbench.contact, or --match restitution"
        if own
        else "Use --match restitution",
    )


def tune(
    engine: str,
    target: Target,
    scene: Scene,
    recipe: str = "auto",
    match: Match = "restitution",
    integrator: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Tuned:
    """Make a setting that matches a target and judge it at speeds and phases that no recipe has looked at.

    engine: a registered name. recipe: one of `recipes_of(engine)`, or "auto". match: what "auto" aims at.
    integrator: of an engine that has several; None for the recipe's own. progress: told of the evaluations of
    a search (done, at most).
    Raises SettingError where no recipe can serve the target, EngineMissing, EngineFailed, and SearchCut with
    the best so far where an interrupt ends a search.
    """
    registry.engine(engine).version()
    scene = dataclasses.replace(scene, mass=target.mass)
    known = recipes_of(engine)
    if recipe == "auto":
        recipe, why = choose(engine, target, scene, match)
    elif recipe in known:
        why = "the recipe asked for"
    else:
        raise UserError("recipe", f"{recipe!r} for {engine!r}", f"one of: auto, {', '.join(known)}")
    made = known[recipe] if integrator is None else _with_integrator(known[recipe], integrator)
    with watched(progress):
        setting = made(target)
    verdict = judge(registry.engine(engine), scene, setting, target)
    rest = settle(registry.engine(engine), scene, setting)
    return Tuned(
        target, scene, made, setting, verdict, rest, why, _advice(engine, target, scene, verdict, rest, known)
    )


def _with_integrator(recipe: Any, integrator: str) -> Recipe:
    if "integrator" not in getattr(recipe, "__dataclass_fields__", {}):
        raise SettingError(
            "integrator", f"{integrator!r} for {recipe.name!r}", "none: it has no choice of one"
        )
    made: Recipe = dataclasses.replace(recipe, integrator=integrator)
    return made


def _advice(
    engine: str, target: Target, scene: Scene, verdict: Verdict, rest: Rest, known: dict[str, Recipe]
) -> tuple[str, ...]:
    found = []
    if verdict.failed:
        found.append(f"{verdict.failed} impacts gave no restitution: {verdict.reason}")
    if not verdict.max_error < 0.9 * verdict.constant_error and verdict.constant_error > 0:
        found.append(
            f"no better than the best constant e = {verdict.constant:.6g}{_better(target, scene, known)}"
        )
    if verdict.penetration_max > 0.02 * scene.relative_radius:
        found.append(
            f"the contact is soft: {verdict.penetration_max:.2g} m deep at the highest speed, "
            f"{100 * verdict.penetration_max / scene.relative_radius:.2g} % of the radius"
        )
    if not rest.rests:
        shallow = {"mujoco": "impulse", "pybullet": "restitution"}.get(engine)
        other = f"; --recipe {shallow} rests shallow" if shallow in known else ""
        found.append(f"under gravity {', and '.join(faults(rest, scene.relative_radius))}{other}")
    if not math.isnan(verdict.loop_rms) and verdict.loop_rms > _LOOP_RIGHT:
        found.append("forces are not the law's: only the restitution is")
    return tuple(found)


def _better(target: Target, scene: Scene, known: dict[str, Recipe]) -> str:
    """What follows a falling restitution where a constant e was taken."""
    if target.reading != "points":
        plug_in = "; the plug-in `restitution-law` of hcbench.contact follows the law at any step"
        return plug_in if "restitution-law" in known else ""
    falling = "; --recipe two-pair has an e that falls with speed, in a softer contact"
    fit = law_that_fits(target)
    return (falling if "two-pair" in known and scene.form == "plane" else "") + (f"; {fit}" if fit else "")


def rest_words(rest: Rest) -> str:
    """Rest in words."""
    if math.isnan(rest.depth):
        return "it diverges"
    return f"creep {rest.creep:.1e} m/s, depth {rest.depth:.1e} m, buzz {rest.buzz:.1e} m/s"
