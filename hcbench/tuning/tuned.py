"""One setting of a recipe: what the engine did with it, and what to know of it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from hcbench.recipes.recipe import Recipe, Role, first
from hcbench.sim import registry
from hcbench.sim.passivity import MOST_E, LongestTrain
from hcbench.system.text import Drawn
from hcbench.tuning.evaluate import Evaluation, evaluate, rest_test

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.recipes.target import Target
    from hcbench.sim.engine import Engine
    from hcbench.sim.passivity import Passivity
    from hcbench.sim.rest import Rest
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# A loop whose rms difference over the largest force is below this counts as the law's.
_SAME_LOOP = 0.05
# A contact deeper than this share of the radius is called soft.
_DEEP = 0.02
# The largest e of a setting that is advised, in all launches and drops.
MOST_ADVISED = 1.001
# An e that falls with speed should have an error below this multiple of the best constant's.
_BETTER = 0.9


@dataclass(frozen=True, repr=False)
class Tuned(Drawn):
    """A setting, what the engine does with it, why it was chosen, and advice that follows."""

    target: Target
    scene: Scene
    recipe: Recipe
    setting: Setting
    evaluation: Evaluation
    rest: Rest
    passivity: Passivity
    why: str
    advice: tuple[str, ...]

    def _lines(self) -> Iterator[str]:
        band = f"from {self.target.speed_min:.3g} to {self.target.speed_max:.3g} m/s"
        yield f"{self.setting.engine} {self.setting.name}: e within {self.error:.2g} {band}"
        yield self.why

    def _rows(self) -> Iterator[dict[str, Any]]:
        yield asdict(self.evaluation)

    @property
    def error(self) -> float:
        """Largest error of e; infinite where an impact has none."""
        off = self.evaluation.max_error
        return math.inf if self.evaluation.failed or math.isnan(off) else off

    @property
    def max_e(self) -> float:
        """The largest e in the band, below it and in drops."""
        return max(self.evaluation.max_e, self.passivity.bounces.max_e)

    def with_boxes(self) -> Tuned:
        """The same with boxes and a capsule tried up to the first that gains energy, where the engine
        tries any.
        """
        if self.passivity.flat is not None:
            return self
        adapter = registry.engine(self.recipe.engine)
        passivity = adapter.with_boxes(self.scene, self.setting, self.passivity)
        return replace(self, passivity=passivity)

    @property
    def rest_failures(self) -> list[str]:
        """Reasons why a body does not rest under the setting, a phrase each; empty if it rests."""
        return self.rest.failures(self.scene.relative_radius, self.setting.timestep)

    @property
    def rests(self) -> bool:
        """True if a body comes to rest under the setting, both laid down and dropped."""
        return not self.rest_failures and not self.passivity.bounces.still_bouncing

    def holds(self, max_error: float) -> bool:
        """Say whether the setting can be recommended in the target's conditions."""
        return self.error <= max_error and not self.flaws

    @property
    def flaws(self) -> str:
        """Phrases of what speaks against the setting, however well it bounces; "" without any."""
        reasons = [self.passivity.warning, self._gain]
        if self.target.corners > 1 and self.passivity.flat is False:
            reasons.append("a flat face gains energy")
        if self.evaluation.deep:
            reasons.append("deep")
        if self.rest_failures:
            reasons.append("does not rest")
        if self.evaluation.failed:
            reasons.append(f"{self.evaluation.failed} impacts gave no restitution")
        return ", ".join(filter(None, reasons))

    @property
    def _gain(self) -> str:
        """Phrase on a gain of energy in any launch or drop, with the largest e; "" for none, and
        where the warning of the passivity test names it already.
        """
        if not self.max_e > MOST_ADVISED or self.passivity.bounces.max_e > MOST_E:
            return ""
        slides = " where it slides and spins" if self.target.friction else ""
        return f"gains energy{slides} (e up to {self.max_e:.4g})"


def make_tuned(
    recipe: Recipe, why: str, target: Target, scene: Scene, integrator: str | None
) -> Tuned:
    """Find the setting of a recipe for a target and evaluate it in its engine: errors of e, energy,
    and rest of a ball.

    why: it was chosen, as a phrase for the user.
    integrator: None for the recipe's own.
    Raises SettingError where the recipe cannot serve the target, and what the engine raises.
    """
    adapter = registry.engine(recipe.engine)
    setting = recipe(target, integrator)
    # A friction that the user's bodies have without the text, and did not ask for, is left to them.
    is_theirs = adapter.keeps_friction and not target.friction_asked
    if target.friction and not is_theirs:
        setting = adapter.with_friction(setting, target.friction)
    setting = adapter.with_corners(setting, target.corners)
    evaluation = evaluate(adapter, scene, setting, target)
    train = LongestTrain(target.curve, evaluation.max_error, target.speed_max)
    passivity = adapter.passivity(scene, setting, (target.speed_min, target.speed_max), train=train)
    rest = rest_test(adapter, scene, setting)
    advice = tuple(filter(None, [passivity.others, _judged_elsewhere(adapter, setting, target)]))
    advice += tuple(
        _advice(target, scene, evaluation, rest, recipe, registry.preferred(recipe.engine))
    )
    return Tuned(
        target=target,
        scene=scene,
        recipe=recipe,
        setting=setting,
        evaluation=evaluation,
        rest=rest,
        passivity=passivity,
        why=why,
        advice=advice,
    )


def _judged_elsewhere(adapter: Engine, setting: Setting, target: Target) -> str:
    """Sentence that names the engine in which what slides was judged; "" where it is this one."""
    oblique = adapter.oblique_setting(setting) if target.friction else None
    if oblique is None or oblique.engine == adapter.name:
        return ""
    other = registry.engine(oblique.engine)
    return (
        f"What slides and spins, boxes and a capsule were judged in {other.title} {other.version()}, "
        f"whose contact {adapter.title} has; launches along the normal in {adapter.title} itself."
    )


def _advice(
    target: Target,
    scene: Scene,
    evaluation: Evaluation,
    rest: Rest,
    recipe: Recipe,
    recipes: Sequence[Recipe],
) -> Iterator[str]:
    """Yield phrases that warn the user of a setting: no better than one e, soft, restless, or with
    other forces than the law's.

    evaluation: of its launches.
    rest: after a drop.
    recipe: the setting's.
    recipes: all of its engine's, of which one may be recommended.
    """
    depth = evaluation.penetration_max
    radius = scene.relative_radius
    if (
        not evaluation.max_error < _BETTER * evaluation.constant_error
        and evaluation.constant_error > 0
    ):
        better = _better(target, scene, recipes) if recipe.native else ""
        yield f"no better than the best constant e = {evaluation.constant:.6g}{better}"
    if depth > _DEEP * radius:
        share = f"{100 * depth / radius:.2g} % of the radius"
        yield f"the contact is soft: {depth:.2g} m deep at the highest speed, {share}"
    failures = rest.failures(radius, target.timestep)
    if failures:
        shallow = first(recipes, Role.CONSTANT_E, scene.form)
        other = ""
        if shallow and shallow is not recipe:
            other = f"; --recipe {shallow.name} rests shallow"
        yield f"under gravity {', and '.join(failures)}{other}"
    if not math.isnan(evaluation.loop_rms) and evaluation.loop_rms > _SAME_LOOP:
        yield "forces are not the law's: only the restitution is"


def _better(target: Target, scene: Scene, recipes: Sequence[Recipe]) -> str:
    """Recommendations of another way to an e that falls with speed, as phrases that follow a
    sentence on the constant e, each after "; "; "" for none.

    recipes: all of the engine's.
    """
    if target.reading != "points":
        law = first(recipes, Role.LAW, scene.form, native=False)
        return f"; the plug-in `{law.name}` follows the law at any step" if law else ""
    falling = first(recipes, Role.FALLING_E, scene.form)
    sentences = [target.fitting_law()]
    if falling:
        sentences.insert(
            0, f"--recipe {falling.name} has an e that falls with speed, in a softer contact"
        )
    return "".join(f"; {sentence}" for sentence in sentences if sentence)
