"""Recipes that put a law in place of an engine's own contact: eq. (16),
and laws published after 1975.
"""

from __future__ import annotations

from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from hcbench.laws import closed_form
from hcbench.laws.published import LAWS, PublishedLaw, TouchSpeedLaw
from hcbench.recipes.recipe import Recipe, Role, first
from hcbench.recipes.target import contact_times, minimax_constant
from hcbench.system.errors import SettingError
from hcbench.system.text import rounded_down
from hcbench.terms.resolution import STEPS_OF_A_LAW

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from hcbench.laws.force import HuntCrossley
    from hcbench.recipes.target import Target

    Options = Mapping[str, Any]

_PLUG_IN = "A plug-in of hcbench.contact"
_ATTACH = f"{_PLUG_IN}, to attach in your own simulation: not a native setting."
_RESOLVED = f"{_PLUG_IN} for steps that resolve the contact: not a native setting."
_QUARTER = "Needs at least 4 steps in the shortest contact; for longer steps use `restitution-law`."
_IMPULSE = (
    "Works at any step. The bounce takes one step: contact force and contact time mean nothing."
)
_AT_PLANE = (
    "Under gravity e is the ratio of speeds at the touch plane; "
    "below 1.6 g h a body may come to rest."
)
_TOUCH_SPEED = (
    "v_i is the speed of each impact at touch, so e is the same at every speed; the law's e falls."
)
_DELIVERED = "The delivered e follows from χ. It differs from the target, except with `exact`."


def exact_above(slowest: float, e: float) -> float:
    """Impact speed, over g h (gravity times step), from which the e of a restitution plug-in is
    exact.

    slowest: speed over g h below which impacts come to rest or not, by chance of where in the step
    they touch.
    e: the restitution, 0 ... 1.

    Gravity pulls a body that parts at less than g h/2 back within the step: it stays down, as with
    e = 0. For e = 0 that makes no difference.
    """
    return max(slowest, 0.5 / e) if e > 0.0 else slowest


def plug_in_recipes(
    engine: str, native: Sequence[Recipe], common: Options, exact_above: Callable[[float], float]
) -> tuple[Recipe, ...]:
    """Recipes of an engine for which hcbench.contact has a plug-in: the law of 1975 as a force, its
    e at each impact, and the laws published since as forces.

    engine: its name.
    native: recipes of its own contact, which messages name where a law cannot be had.
    common: options of each setting, beside "law".
    exact_above: e to the impact speed over g h from which the restitution law is exact.
    The recipes of a force raise SettingError for a step that does not resolve its contact.
    """
    # Names of native recipes that errors advise: of one e, which works at any step, and of an e that
    # falls with speed.
    constant = first(native, Role.CONSTANT_E, "plane")
    at_any_step = [constant.name] if constant else []
    falling = [recipe.name for recipe in native if recipe.role is Role.FALLING_E]
    plug_in = partial(Recipe, engine, native=False, instead=_any_of([*falling, *at_any_step]))

    def published_law(target: Target, law: TouchSpeedLaw) -> Options:
        """Options of a setting with a published law, which must be resolved at the fastest impact."""
        advice = f"Use {_any_of(at_any_step)}, which has one restitution at any step"
        fastest = law.at(target.speed_max)
        shortest = float(closed_form.duration(fastest, target.mass, target.speed_max))
        _require_resolved(target, shortest, advice)
        options = {"kind": "force", "law": law.family.slug, **published_law_options(target, law)}
        return {"law": options, **common}

    return (
        plug_in(
            "hunt-crossley",
            Role.LAW_AND_LOOP,
            lambda target: {"law": _force_law(target), **common},
            "Plug-in: the law as contact force, for steps that resolve the contact.",
            (_ATTACH, _QUARTER),
            kinds=("law",),
            steps_min=STEPS_OF_A_LAW,
        ),
        plug_in(
            "restitution-law",
            Role.LAW,
            lambda target: {"law": _restitution_law(target), **common},
            "Plug-in: each impact gets the e of its own speed, by the law or one for all, in one step.",
            (_ATTACH, _IMPULSE, _AT_PLANE),
            one_step=True,
            kinds=("law", "linear", "constant"),
            exact_above=exact_above,
        ),
        *published_law_recipes(engine, published_law, _RESOLVED, STEPS_OF_A_LAW),
    )


def python_law_recipes(
    engine: str,
    native: Sequence[Recipe],
    hook: str,
    *,
    force: float = 0.0,
    each_impact: float = 0.0,
    common: Options = MappingProxyType({}),
    each_impact_options: Callable[[Target], Options] = lambda target: {},
) -> tuple[Recipe, ...]:
    """Recipes for an engine that lets a law in from Python, by lines of the user's own, on a plane.

    native: recipes of its own contact, which messages name where a law cannot be had.
    hook: where the law goes in, a sentence.
    force, each_impact: how near e comes with the law as contact force, and with its e set before
    each impact; 0 where the engine has no way.
    common, each_impact_options: options of each setting, and of those that set e, beside "law".
    """
    names = [recipe.name for recipe in native if recipe.role in (Role.CONSTANT_E, Role.FALLING_E)]
    own = partial(Recipe, engine, native=False, instead=_any_of(names), forms=("plane",))
    recipes = []
    if force:
        recipes += [own(
            "hunt-crossley",
            Role.LAW_AND_LOOP,
            lambda target: {"law": _force_law(target), **common},
            "From Python: the law as contact force, for steps that resolve the contact.",
            (hook, "Needs at least 4 steps in the shortest contact."),
            kinds=("law",),
            steps_min=STEPS_OF_A_LAW,
            within=force,
        )]  # fmt: skip
    if each_impact:
        recipes += [own(
            "restitution-law",
            Role.LAW,
            lambda target: {"law": _restitution_law(target), **common, **each_impact_options(target)},
            "From Python: each impact gets the law's e of its own speed, in one step.",
            (hook, _IMPULSE),
            one_step=True,
            kinds=("law", "linear"),
            within=each_impact,
        )]  # fmt: skip
    return tuple(recipes)


def _force_law(target: Target) -> Options:
    shortest, _ = contact_times(target, target.law)
    _require_resolved(target, shortest, "Use `restitution-law`, which needs no resolved contact")
    return {"kind": "force", **law_options(target.law)}


def _restitution_law(target: Target) -> Options:
    if target.kind == "constant":
        return {"kind": "restitution", "restitution": target.points[0][1]}
    return {"kind": "restitution", "alpha": target.law.alpha, "reading": target.reading}


def published_law_recipes(
    engine: str,
    options: Callable[[Target, TouchSpeedLaw], Options],
    note: str,
    steps_min: float = 0.0,
) -> tuple[Recipe, ...]:
    """Recipes of forces F = k x^n (1 + χ(e) v/v_i), one for each law of LAWS; v_i is the speed of
    each impact at touch, so the law has one e for all speeds.

    engine: its name.
    options: makes a setting's options of a target and a law, which is set to the best constant e of
    the target's band.
    note: how the engine runs the law, a sentence.
    steps_min: steps in the shortest contact that the engine needs.
    """

    def recipe(family: PublishedLaw) -> Recipe:
        """The recipe of one law, which sets it to the best constant e of a target's band.

        family: the law without numbers.
        """

        def function(target: Target) -> Options:
            """Options of the setting for a target."""
            e, _ = minimax_constant(target)
            return options(
                target, TouchSpeedLaw(family, target.law.stiffness, e, target.law.exponent)
            )

        return Recipe(
            engine,
            family.slug,
            Role.CONSTANT_E,
            function,
            f"{family.name}, χ = {family.formula}, with the best constant e of the band as target.",
            (_TOUCH_SPEED, _DELIVERED, note),
            native=False,
            steps_min=steps_min,
        )

    return tuple(recipe(family) for family in LAWS.values())


def law_options(law: HuntCrossley) -> dict[str, float]:
    """Eq. (16) as options of a setting."""
    return {"alpha": law.alpha, "stiffness": law.stiffness, "exponent": law.exponent}


def published_law_options(target: Target, law: TouchSpeedLaw) -> dict[str, float]:
    """The numbers of a published law as options of a setting."""
    return {"restitution": law.restitution, "stiffness": law.stiffness, "exponent": law.exponent}


def _any_of(names: Sequence[str]) -> str:
    """ "`two-pair`, `soft` or `impulse`"; "" for no name."""
    quoted = [f"`{name}`" for name in names]
    if len(quoted) < 2:
        return "".join(quoted)
    return f"{', '.join(quoted[:-1])} or {quoted[-1]}"


def _require_resolved(target: Target, shortest: float, advice: str) -> None:
    """Raise SettingError, with `advice`, for a target whose time step does not resolve the law's
    shortest contact (s): less than STEPS_OF_A_LAW steps.
    """
    steps = shortest / target.timestep
    if steps < STEPS_OF_A_LAW:
        raise SettingError(
            "timestep",
            f"{target.timestep:g} s, {steps:.2g} of which are the law's shortest contact",
            f"{rounded_down(target.timestep * steps / STEPS_OF_A_LAW)} s or less",
            advice,
        )
