"""Finds the one answer of an engine to a target: the best choice of each kind, and what is never to
be used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from hcbench.laws.restitution import ConstantRestitution
from hcbench.recipes.recipe import Recipe, Role, first, report_progress
from hcbench.recipes.target import minimax_constant, require_end, require_kind, steps_per_contact
from hcbench.sim import registry
from hcbench.sim.passivity import LongestTrain
from hcbench.sim.promise import Promise
from hcbench.system.compiler import NotCompiled
from hcbench.system.errors import EngineFailed, EngineMissing, HcbenchError, SettingError, UserError
from hcbench.system.text import rounded_down, time_step, two_digits
from hcbench.terms.impact import Launch
from hcbench.terms.resolution import STEPS_OF_A_LOOP
from hcbench.terms.setting import PAIR, Pair
from hcbench.tuning.answer import MAX_ERROR, Answer, Choice, Kind, Never
from hcbench.tuning.tuned import Tuned, make_tuned

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.recipes.target import Target
    from hcbench.sim.passivity import Passivity
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting


Match = Literal["restitution", "loop", "both"]


def candidates(engine: str, target: Target, scene: Scene, match: Match) -> list[tuple[Recipe, str]]:
    """An engine's own recipes that may serve a target, the simplest first, and what each promises.

    They are chosen by what they match and by how many steps the law's contact lasts, never by name.
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
    """Native recipe whose loop of force over penetration is that of the law, and what it promises.

    recipes: the engine's.
    form: of the scene, "plane" or "cup".
    match: what the user asked to match, for the errors.
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
            f"Use a step of {rounded_down(nearest)} s or less, a lower stiffness, or --match restitution",
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


# A compiled plug-in stays within this error of e.
_EXACT = 1e-7
# Rounds of the search; it ends earlier if the speed no longer changes.
_TURNS = 20
# A constant setting need not come nearer than this multiple of the best constant's error.
_NEAR = 1.1


def find_answer(
    engine: str,
    target: Target,
    scene: Scene,
    recipe: str = "auto",
    match: Match = "restitution",
    integrator: str | None = None,
    max_error: float = MAX_ERROR,
    pair: Pair = PAIR,
    asked: Kind | None = None,
) -> Answer:
    """Find settings of an engine for a target, under the target's gravity and friction.

    engine: a registered name.
    recipe: the name of one of its recipes, or "auto".
    match: what "auto" aims at.
    integrator: of an engine that has several; None for the recipe's own.
    max_error: of e, within which the simplest setting will do.
    pair: what the two bodies are called in the user's model.
    asked: the kind; None for all of them, the exact one first.

    Raises SettingError where no recipe can serve the target, EngineMissing, EngineFailed, and
    SearchInterrupted with the best so far where an interrupt ends a search.
    """
    registry.require(engine)
    _require_friction(engine, target.friction)
    _require_corners(engine, target.corners)
    if integrator is not None:
        _require_integrator(engine, integrator)
    scene = replace(scene, mass=target.mass, gravity=target.gravity, friction=target.friction)
    # A solid ball of the radius that the scene shows: friction acts on its spin.
    if target.friction and scene.form == "plane":
        scene = replace(scene, ball_radius=scene.relative_radius, plate_radius=math.inf)
    require_end(target)
    finder = _Finder(
        engine=engine,
        target=target,
        scene=scene,
        integrator=integrator,
        max_error=max_error,
        pair=pair,
    )
    if recipe != "auto":
        named = finder.named(recipe)
        return _answered(finder, asked, [named], named)
    recipes = candidates(engine, target, scene, match)
    if match != "restitution":
        named = finder.choice("settings", make_tuned(*recipes[0], target, scene, integrator))
        return _answered(finder, asked, [named], named)
    return _answered(finder, asked, finder.choices(recipes, asked))


def _require_friction(engine: str, friction: float) -> None:
    """Raise SettingError for a friction (Coulomb's μ) above 0 in an engine in which no sliding body
    can be judged: it has no oblique launches, nor the contact of an engine that has them.
    """
    adapter = registry.engine(engine)
    if not friction or adapter.oblique or adapter.default_friction:
        return
    advice = "Leave it out: settings of this engine are found without friction"
    if adapter.keeps_friction:
        advice = "Leave it out: the text leaves the friction of your bodies as it is"
    raise SettingError("friction", f"{friction:g} with {engine!r}", "0", advice)


def _require_corners(engine: str, corners: int) -> None:
    """Raise SettingError for several corners in an engine where no such body could be judged."""
    if corners > 1 and not registry.engine(engine).several_corners:
        advice = "Leave it out: settings of this engine are judged by a ball"
        raise SettingError("corners", f"{corners} with {engine!r}", "1", advice)


def _require_integrator(engine: str, integrator: str) -> None:
    """Raise SettingError for an integrator with which no recipe of the engine works."""
    names: dict[str, None] = {}
    for recipe in registry.recipes(engine).values():
        if recipe.integrators is not None:
            names |= dict.fromkeys(recipe.integrators.names)
    if integrator not in names:
        expected = "none: the engine has one alone"
        if names:
            expected = f"one of: {', '.join(names)}"
        raise SettingError("integrator", f"{integrator!r} for {engine!r}", expected)


def _answered(
    finder: _Finder, asked: Kind | None, choices: Sequence[Choice], named: Choice | None = None
) -> Answer:
    """The answer of these choices, without those that have flaws.

    asked: the kind that is preferred, None for none.
    named: the choice by the recipe that the user named, which stays the answer's `named` even with
    flaws; then it is listed as one never to use.
    """
    advised = [choice for choice in choices if choice.tuned is None or not choice.tuned.flaws]
    never = [*finder.never]
    if named is not None and named not in advised and named.tuned is not None:
        never.append(Never(named.setting.name, named.tuned.flaws))
    return Answer(
        engine=finder.engine,
        target=finder.target,
        scene=finder.scene,
        pair=finder.pair,
        asked=asked,
        choices=tuple(advised),
        never=tuple(never),
        named=named,
        left_out=finder.left_out,
    )


class _Finder:
    """Finds the choices of one answer."""

    def __init__(
        self,
        engine: str,
        target: Target,
        scene: Scene,
        integrator: str | None,
        max_error: float,
        pair: Pair,
    ) -> None:
        """Prepare the search of one answer.

        engine: a registered name.
        scene: in the target's conditions.
        integrator: of an engine that has several; None for each recipe's own.
        max_error: of e, within which the simplest setting will do.
        pair: names of the two bodies in the user's model.
        Raises UserError for an unknown engine.
        """
        self.engine = engine
        self.target = target
        self.scene = scene
        self.pair = pair
        self._integrator = integrator
        self._max_error = max_error
        self.never: list[Never] = []
        self.left_out = ""
        # The last setting's error, which the user sees where no other serves.
        self._refused: HcbenchError | None = None
        self._adapter = registry.engine(engine)

    def named(self, name: str) -> Choice:
        """The evaluated choice by the recipe of this name, whatever its flaws.

        Raises UserError for a name that the engine does not have, EngineFailed where no launch of
        the setting has an e, SettingError where the recipe cannot serve the target, and what
        `make_tuned` raises.
        """
        recipes = registry.recipes(self.engine)
        if name not in recipes:
            raise UserError(
                "recipe", f"{name!r} for {self.engine!r}", f"one of: auto, {', '.join(recipes)}"
            )
        recipe = recipes[name]
        tuned = make_tuned(recipe, "the given recipe", self.target, self.scene, self._integrator)
        if not math.isfinite(tuned.error):
            raise self._failure(tuned)
        kind: Kind = "exact"
        if recipe.role in (Role.CONSTANT_E, Role.STOCK):
            kind = "constant"
        elif recipe.native:
            kind = "settings"
        return self.choice(kind, tuned)

    def choices(self, tried: Sequence[tuple[Recipe, str]], asked: Kind | None) -> list[Choice]:
        """The best choice of each kind: exact, settings, constant. The plug-in alone where the
        exact kind was asked for, as it needs no search.

        tried: candidates for settings and for one e, the simplest first, each with the reason for
        it.
        asked: the kind that the user prefers, or None.
        Settings not nearer to the target than one e for all speeds go to `never`. Without a
        C compiler the plug-in is left out, unless it is the kind asked for: then NotCompiled.
        If no setting of the engine's own is left, raises the first refusal or failure, but not
        where the plug-in is an answer and the user names no integrator.
        """
        exact = self._exact_if_compiled(asked)
        if asked == "exact" and exact is not None:
            return [exact]
        if asked == "exact" and (law := self._law()) is not None:
            require_kind(self.target, law.name, law.kinds, law.instead)
        constants = [each for each in tried if each[0].role is Role.CONSTANT_E]
        others = [each for each in tried if each not in constants]
        _, least = minimax_constant(self.target)
        settings = self._best(others, self._max_error)
        constant = self._best(constants, max(_NEAR * least, 1e-9))
        if settings is not None and constant is not None and not settings.error < constant.error:
            why = (
                f"no nearer than one e for all speeds: {two_digits(settings.error)} where that is "
                f"wrong by {two_digits(constant.error)}"
            )
            self.never.append(Never(settings.setting.name, why))
            settings = None
        has_native = settings is not None or constant is not None
        # An integrator is of the engine's own contact: the plug-in does not answer who names one.
        plug_in_will_do = exact is not None and not self._integrator
        if self._refused is not None and not has_native and not plug_in_will_do:
            raise self._refused
        chosen: list[Choice] = []
        if exact is not None:
            chosen.append(exact)
        if settings is not None:
            chosen.append(self.choice("settings", settings))
        if constant is not None:
            chosen.append(self.choice("constant", constant))
        return chosen

    def _best(self, tried: Sequence[tuple[Recipe, str]], enough: float) -> Tuned | None:
        """Evaluate recipes in turn: the first setting without flaws whose error is small enough, or
        else the one with the least error; None if none is without flaws.

        tried: recipes, each with the reason for it.
        enough: an error of e that is small enough. Settings with flaws go to `never`; a recipe that
        raises SettingError or EngineMissing is passed over, and the first such error kept for
        `choices`.
        """
        usable: list[Tuned] = []
        for recipe, why in tried:
            try:
                tuned = make_tuned(recipe, why, self.target, self.scene, self._integrator)
            except (SettingError, EngineMissing) as error:
                # For example a version that lacks what the recipe needs.
                self._refused = self._refused or error
                continue
            if not math.isfinite(tuned.error):
                self._refused = self._refused or self._failure(tuned)
            # Else boxes speak against no setting: they are tried of what is chosen alone.
            if self.target.corners > 1:
                tuned = tuned.with_boxes()
            if tuned.flaws:
                self.never.append(Never(recipe.name, tuned.flaws))
                continue
            usable.append(tuned)
            if tuned.error <= enough:
                return tuned
        return min(usable, key=lambda tuned: tuned.error, default=None)

    def _failure(self, tuned: Tuned) -> EngineFailed:
        """The error to raise for a setting with launches that gave no restitution.

        It is an engine's failure, not a verdict on the setting: nothing was measured.
        """
        evaluation = tuned.evaluation
        reason = evaluation.reason or "not a number"
        got = f"{evaluation.failed} launches gave no restitution: {reason}"
        advice = "Try other speeds, another step or another --recipe"
        return EngineFailed(
            f"{self.engine} {tuned.recipe.name!r}", got, "a bounce from each", advice
        )

    def choice(self, kind: Kind, tuned: Tuned) -> Choice:
        """An evaluated setting as a choice of a kind: its energy tested with boxes and a capsule,
        too, its text to paste, and the promise of its error if that is known.
        """
        tuned = tuned.with_boxes()
        setting = tuned.setting
        target = self.target
        band = target.speed_min, target.speed_max
        text = self._adapter.snippet(setting, self.scene.form, self.pair)
        promise = None
        if math.isfinite(tuned.error):
            promise = self._promise(setting, tuned.error, band, tuned.passivity)
            text = self._adapter.promised(text, self.pair, promise)
        return Choice(
            kind=kind,
            setting=setting,
            text=text,
            max_error=tuned.error,
            speeds=band,
            max_e=tuned.max_e,
            passivity=tuned.passivity,
            rests=tuned.rests,
            needs=self._adapter.needs(setting),
            notes=tuned.recipe.notes,
            tuned=tuned,
            promise=promise,
        )

    def _promise(
        self,
        setting: Setting,
        error: float,
        band: tuple[float, float],
        passivity: Passivity | None,
    ) -> Promise:
        """The largest error of e over a band, with the conditions in which it was found.

        error: of e.
        band: lowest and highest impact speed, m/s.
        passivity: of the test of energy; None where there was none.
        """
        target = self.target
        curve = target.curve
        if len(target.points) == 1:
            _speed, e = target.points[0]
            curve = ConstantRestitution(e)
        rows = len(setting.options.get("rows", ()))
        # The promise is for this number of contact points if a flat face gains energy, or if the
        # rows were sized for several points: with another number e is another. 0: for any.
        corners = 0
        gains = passivity is not None and passivity.flat is False
        if gains or (rows and target.corners > 1):
            corners = target.corners
        contacts = 0
        if "law" not in setting.options:
            # An engine whose settings have no rows has one contact for a pair.
            contacts = max(rows, 1)
        return Promise(
            setting=setting.name,
            rows=contacts,
            curve=curve,
            error=error,
            speeds=band,
            option=self._adapter.model_options(setting),
            gravity=target.gravity,
            # A plug-in keeps the friction of the geoms.
            friction=target.friction if rows else math.nan,
            corners=corners,
        )

    def _bounces(self, setting: Setting, band: tuple[float, float]) -> bool:
        """True where a launch at each end of the band, m/s, gives an e."""
        launches = [Launch.touching(v, 0.5, setting.timestep, self.scene.gravity) for v in band]
        return all(
            impact.is_measured for impact in self._adapter.run(self.scene, setting, launches)
        )

    def _exact_if_compiled(self, asked: Kind | None) -> Choice | None:
        """The choice with the plug-in; None where there is none, or where it cannot be compiled.

        asked: the kind that the user prefers, or None.
        Raises NotCompiled where that is "exact"; else `left_out` has the reason.
        """
        try:
            return self._exact()
        except NotCompiled as error:
            if asked == "exact":
                raise
            self.left_out = f"left out, not compiled: the plug-in. {error}"
            return None

    def _law(self) -> Recipe | None:
        """The recipe that puts a law in place of the contact at any step;
        None where the engine has none.
        """
        return first(registry.preferred(self.engine), Role.LAW, self.scene.form, native=False)

    def _exact(self) -> Choice | None:
        """The choice with the plug-in: its error of e is the one that the recipe states, its energy
        is measured here.

        None where the engine has no plug-in for such a target, where it is exact nowhere in the
        band, where a launch gives no e, and where energy grows. Where the engine is missing or
        fails, energy is not measured.
        Raises NotCompiled.
        """
        target = self.target
        recipe = self._law()
        if recipe is None or not {target.kind, target.reading} & set(recipe.kinds):
            return None
        if recipe.exact_above is None:
            # Its recipe states no speed from which it is exact: it is judged as any other setting.
            tuned = self._best([(recipe, "a law in place of the contact")], math.inf)
            if tuned is None:
                return None
            return self.choice("exact", tuned)
        setting = recipe(target)
        low = exact_from(recipe, target)
        if low > target.speed_max:
            return None
        band = low, target.speed_max
        passivity = self._passivity_of_law(setting, band)
        # e falls with speed: by the law it is largest at the lowest.
        max_e = float(target.restitution(low))
        if passivity is not None:
            if not self._bounces(setting, band):
                self._refused = self._refused or self._no_bounce(recipe, band)
                return None
            if passivity.warning:
                self.never.append(Never(recipe.name, passivity.warning))
                return None
            max_e = max(max_e, passivity.bounces.max_e)
        error = recipe.within or _EXACT
        promise = self._promise(setting, error, band, passivity)
        text = self._adapter.snippet(setting, self.scene.form, self.pair)
        return Choice(
            kind="exact",
            setting=setting,
            text=self._adapter.promised(text, self.pair, promise),
            max_error=error,
            speeds=band,
            max_e=max_e,
            passivity=passivity,
            rests=passivity is None or passivity.bounces.passive,
            needs=(*self._adapter.needs(setting), *_above(low, target.speed_min)),
            notes=recipe.notes,
            promise=promise,
        )

    def _passivity_of_law(self, setting: Setting, band: tuple[float, float]) -> Passivity | None:
        """Test whether the plug-in's setting gains energy, with a ball, boxes and a capsule; None
        where the engine is missing or fails, so that nothing was measured.

        band: lowest and highest impact speed at which the law is exact, m/s.
        """
        target = self.target
        train = LongestTrain(target.curve, _EXACT, target.speed_max)
        try:
            passivity = self._adapter.passivity(self.scene, setting, band, train=train)
            return self._adapter.with_boxes(self.scene, setting, passivity)
        except (EngineMissing, EngineFailed):
            return None

    def _no_bounce(self, recipe: Recipe, band: tuple[float, float]) -> EngineFailed:
        """The error to raise for a plug-in with which a launch at an end of the band, m/s, has no e."""
        low, high = band
        return EngineFailed(
            f"{self.engine} {recipe.name!r}",
            f"launches gave no restitution at {low:.3g} or {high:.3g} m/s",
            "a bounce from each",
            "Try other speeds or another step",
        )


def exact_from(recipe: Recipe, target: Target) -> float:
    """The impact speed, m/s, from which the law of a plug-in is exact, within the target's band.

    It is at least the band's lowest speed, and above the highest where the law is exact nowhere in
    the band. A recipe's `exact_above` is that speed over g h, by the e at it.
    """
    low = target.speed_min
    # e at that speed decides how high the speed is: a fixed point.
    for _ in range(_TURNS):
        if recipe.exact_above is None or low > target.speed_max:
            break
        above = recipe.exact_above(float(target.restitution(low)))
        low = max(target.speed_min, above * target.gravity * target.timestep)
    return low


def _above(low: float, asked: float) -> Iterator[str]:
    if low > asked:
        yield f"impacts faster than {low:.2g} m/s: slower bodies may come to rest"


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
    """Find a setting that matches a target, evaluated under the target's gravity and friction.

    engine: a registered name.
    recipe: the name of one of its recipes, or "auto".
    match: what "auto" aims at.
    integrator: of an engine that has several; None for the recipe's own.
    progress: called with the evaluations of a search (done, at most).
    max_error: of e, within which the simplest setting will do.
    Raises SettingError where no recipe can serve the target, EngineMissing, EngineFailed, and
    SearchInterrupted with the best so far where an interrupt ends a search.
    """
    with report_progress(progress):
        return find_answer(
            engine, target, scene, recipe, match, integrator, max_error, asked="settings"
        ).tuned
