"""Promises that a model holds in its text, and causes that it does not keep them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import explicit_pairs, integrator_name
from hcbench.engines.mujoco.model.causes import fixes
from hcbench.engines.mujoco.scene.elements import quoted
from hcbench.measuring.measurement import TOLERANCE
from hcbench.sim.model_under_test import Suspect
from hcbench.sim.promise import Promise
from hcbench.system.text import shortest, time_step

if TYPE_CHECKING:
    from collections.abc import Iterable

    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.terms.impact import Impact
    from hcbench.terms.setting import Pair

# Promises of `hcbench tune` in MJCF: a <text> of the <custom> section, named by the two geoms.


def promise_lines(pairs: Iterable[Pair], promise: Promise) -> str:
    """The <custom> section of MJCF that states a promise for some pairs, as text; "" for a promise
    whose target a text cannot state.

    pairs: names of two geoms each.
    promise: that of all of them. `promise_in` reads it again.
    """
    if not promise.text:
        return ""
    lines = [f"  <text name={quoted(_name(*pair))} data={quoted(promise.text)}/>" for pair in pairs]
    return "\n".join(["<custom>", *lines, "</custom>"])


def promise_in(model: Any, geoms: tuple[int, int]) -> Promise | None:
    """Read the promise that `hcbench tune` wrote for two geoms of a compiled model.

    geoms: their numbers, in either order.
    None where the model has none, or one in another form.
    """
    names = [str(model.geom(geom).name) for geom in geoms]
    for pair in (names, names[::-1]):
        number = backend().mj_name2id(model, backend().mjtObj.mjOBJ_TEXT, _name(*pair))
        if number >= 0:
            start = int(model.text_adr[number])
            size = int(model.text_size[number])
            return Promise.read(bytes(model.text_data[start : start + size - 1]).decode())
    return None


def option_in_force(model: Any) -> tuple[tuple[str, str], ...]:
    """(name, text) of the options of a compiled model on which e and friction of a contact depend.

    Texts as XML writes them: timestep (s), integrator, cone and impratio.
    """
    option = model.opt
    cone = str(backend().mjtCone(int(option.cone)).name).removeprefix("mjCONE_").lower()
    return (
        ("timestep", shortest(float(option.timestep))),
        ("integrator", integrator_name(model)),
        ("cone", cone),
        ("impratio", shortest(float(option.impratio))),
    )


def _name(first: str, second: str) -> str:
    return f"hcbench:{first}:{second}"


# Causes that keep a pair with the plug-in hcbench.restitution from the e of its config.

# Gravity gives a resting body g h in a step. The plug-in cannot tell an impact of about that speed
# from rest. In units of g h: impacts slower than this are suspected.
_SLOW = 3.0
# In units of g h: speed of the slowest impact with the step that is advised.
_CURED = 4.0


def slow_for_plugin(
    model: Any, impacts: Sequence[Impact], law: RestitutionCurve, gravity: float
) -> Iterator[Suspect]:
    """Suspect a time step so long that the plug-in takes the slowest impacts for bodies at rest; at
    most one suspect.

    impacts: of the model.
    law: e over speed that the plug-in was given.
    gravity: g along the normal, m/s².
    It is suspected where an impact slower than _SLOW g h has an e below the law's by more than
    TOLERANCE.
    """
    timestep = float(model.opt.timestep)
    gained = abs(gravity) * timestep  # m/s
    dead_speeds = []
    for impact in impacts:
        speed = impact.speed_in
        if speed < _SLOW * gained and impact.restitution < float(law.at(speed)) - TOLERANCE:
            dead_speeds.append(speed)
    if not dead_speeds:
        return
    slowest = min(dead_speeds)
    shorter = float(f"{slowest / (_CURED * abs(gravity)):.2g}")  # s
    yield Suspect(
        "slow-for-step",
        "The step is too long for the slowest impacts: the plug-in takes them for a body at rest.",
        f"{slowest:.3g} m/s, and gravity gives {gained:.3g} m/s in a step of {time_step(timestep)} s",
        f'<option timestep="{shorter:g}"/>, or speeds above {_CURED * gained:.2g} m/s',
        partial(fixes.set_options, timestep=shorter),
    )


# Differences between a model and the one in which `hcbench tune` measured the error it promised.

# Relative difference of two numbers that the digits of XML make.
_SAME = 1e-6


# A gravity this many times the promised one or more is that of another unit of length.
_OTHER_UNIT = 50.0


def broken_promise(
    model: Any, promise: Promise, geoms: tuple[int, int], gravity: float, contacts: int = 0
) -> Iterator[Suspect]:
    """Yield a suspect for each difference between a pair and the one that `hcbench tune` wrote.

    promise: what it wrote into the model; of a promise without rows, which is a plug-in's, only the
    unit of gravity and the time step count.
    geoms: numbers of the two.
    gravity: of the model, m/s².
    contacts: number of MuJoCo's contacts of the pair at touch, one for each <pair> at each point; 0
    where that is not known.
    """
    yield from _gravity(promise, gravity)
    if not promise.rows:
        yield from _longer_step(model, promise)
        return
    joining = explicit_pairs(model, geoms)
    yield from _number_of_pairs(promise, len(joining))
    yield from _margin(model, joining)
    yield from _friction(model, promise, joining)
    # Each <pair> makes a contact at each point; without <pair>s the geoms make one.
    yield from _corners(promise, contacts // max(1, len(joining)))
    yield from _override(model)
    now = dict(option_in_force(model))
    for name, text in promise.option:
        if name in now and not _equal(now[name], text):
            yield Suspect(
                f"promised-{name}",
                f"The model has another {name} than hcbench wrote this pair for.",
                f'{name}="{now[name]}" now; tuned for "{text}". A later <option> replaces an earlier one',
                f'<option {name}="{text}"/>, after every other <option>',
                partial(_set_option, name=name, text=text),
                always_reported=True,
            )


def _longer_step(model: Any, promise: Promise) -> Iterator[Suspect]:
    """Yield the suspect of a time step longer than that up to which a plug-in bounces over its
    whole band; at most one.

    promise: what hcbench wrote, with that step, s; one without a step is kept at any.
    """
    step = float(model.opt.timestep)
    promised = float(dict(promise.option).get("timestep", math.inf))
    if step > (1.0 + _SAME) * promised:
        yield Suspect(
            "promised-timestep",
            "The model has a longer timestep than hcbench wrote this plug-in for.",
            f"{step:.4g} s now, tuned for {promised:.4g} s: slow impacts of its band may not bounce",
            f'<option timestep="{promised:.6g}"/>, after every other <option>',
            partial(_set_option, name="timestep", text=repr(promised)),
            always_reported=True,
        )


def _gravity(promise: Promise, gravity: float) -> Iterator[Suspect]:
    """Suspect another gravity than that under which the pair was tuned, or another unit of length;
    at most one suspect, none where the promise names no gravity.

    gravity: of the model, m/s².
    A plug-in holds under any gravity in metres.
    """
    if math.isnan(promise.gravity):
        return
    if gravity > _OTHER_UNIT * max(promise.gravity, 1.0):
        yield Suspect(
            "promised-unit",
            "The model's unit of length is not the metre, and hcbench wrote this pair for metres.",
            f"gravity is {gravity:.5g} of its unit per s^2; tuned under {promise.gravity:.4g} m/s^2",
            "write the model in metres; a plug-in's alpha is per speed in the model's unit",
            always_reported=True,
        )
        return
    if promise.rows and promise.is_other_gravity(gravity):
        yield Suspect(
            "promised-gravity",
            "The model has another gravity than hcbench wrote this pair for.",
            f"{gravity:.4g} m/s^2 now; tuned under {promise.gravity:.4g} m/s^2",
            f'hcbench tune mujoco with --gravity "{gravity:.4g} m/s^2"',
            always_reported=True,
        )


def _number_of_pairs(promise: Promise, count: int) -> Iterator[Suspect]:
    """Suspect that some of the <pair>s of two geoms that hcbench wrote are missing, or that others
    were added; at most one suspect.

    promise: what hcbench wrote of the two.
    count: of their <pair>s in the model.
    """
    lost = promise.rows - count
    if lost > 0:
        yield Suspect(
            "missing-pair",
            f"{lost} of the {promise.rows} pairs that hcbench wrote for these two geoms is missing.",
            f"the model keeps the promise of {promise.rows} pairs: {promise.text}",
            "paste all <pair> elements that `hcbench tune` printed, all of the same two geoms",
            always_reported=True,
        )
    if lost < 0:
        yield Suspect(
            "second-pair",
            f"{count} <pair>s join these two geoms where hcbench wrote {promise.rows}: all act.",
            f"the model keeps the promise of {promise.rows}: {promise.text}",
            "take out the <pair>s of these two geoms that `hcbench tune` did not print",
            always_reported=True,
        )


def _margin(model: Any, joining: Sequence[int]) -> Iterator[Suspect]:
    """Suspect a margin or gap, m, by which a <pair> acts before its geoms touch; at most one suspect,
    of the first such <pair>.

    joining: numbers of the <pair>s of two geoms.
    """
    for number in joining:
        if model.pair_margin[number] > 0.0 or model.pair_gap[number] > 0.0:
            yield Suspect(
                "promised-margin",
                "A <pair> of these two geoms acts before they touch; hcbench wrote none that does.",
                f"margin {model.pair_margin[number]:.4g} m, gap {model.pair_gap[number]:.4g} m",
                'margin="0" gap="0" in each <pair> of these two geoms',
                partial(_set_pairs, numbers=joining, margin=0.0, gap=0.0),
                always_reported=True,
            )
            return


def _friction(model: Any, promise: Promise, joining: Sequence[int]) -> Iterator[Suspect]:
    """Suspect another friction of two geoms than hcbench wrote; at most one suspect, none where the
    promise names no friction.

    joining: numbers of the <pair>s of the two.
    """
    if math.isnan(promise.friction):
        return
    friction = 0.0
    for number in joining:
        # With condim 1 there is none.
        if model.pair_dim[number] > 1:
            friction = max(friction, float(model.pair_friction[number, 0]))
    if not _equal(friction, promise.friction):
        yield Suspect(
            "promised-friction",
            "The pair has another friction than hcbench wrote.",
            f"{friction:.4g} now; tuned with {promise.friction:.4g}",
            f"hcbench tune mujoco with --friction {friction:.4g}",
            always_reported=True,
        )


def _corners(promise: Promise, points: int) -> Iterator[Suspect]:
    """Suspect that the two meet at another number of points at once than the pair was tuned for:
    with more it gains energy, with fewer e is another. At most one suspect.

    promise: what hcbench wrote.
    points: at which they meet; 0 where that is not known.
    """
    if not promise.corners or points in (0, promise.corners):
        return
    number = "more"
    follows = "it gains energy"
    if points < promise.corners:
        number = "fewer"
        follows = "e is another"
    yield Suspect(
        "promised-corners",
        f"The two meet at {number} points at once than hcbench wrote this pair for: {follows}.",
        f"{points} points now; tuned for {promise.corners}",
        f"hcbench tune mujoco with --corners {points}, or --plugin",
        always_reported=True,
    )


def _override(model: Any) -> Iterator[Suspect]:
    """Suspect the flag override, which replaces solref and solimp of every contact, if a model sets
    it; at most one suspect.
    """
    flag = int(backend().mjtEnableBit.mjENBL_OVERRIDE)
    if not model.opt.enableflags & flag:
        return
    yield Suspect(
        "override",
        "The override flag replaces every contact's solref and solimp.",
        "the pair's own numbers, which hcbench wrote, are not used",
        '<option><flag override="disable"/></option>',
        partial(fixes.set_options, enableflags=int(model.opt.enableflags) & ~flag),
        always_reported=True,
    )


def _set_pairs(model: Any, numbers: Sequence[int], margin: float, gap: float) -> None:
    """Set margin and gap, m, of some pairs."""
    model.pair_margin[list(numbers)] = margin
    model.pair_gap[list(numbers)] = gap


def _equal(now: str | float, promised: str | float) -> bool:
    """Say whether two values are the same: numbers within the digits of XML, others as text."""
    try:
        return abs(float(now) - float(promised)) <= _SAME * abs(float(promised))
    except ValueError:
        return now == promised


def _set_option(model: Any, name: str, text: str) -> None:
    """Set one of the options of `option_in_force` in a compiled model, from its text in XML.

    model: changed.
    name: of the option.
    text: as XML writes its value, such as "RK4" or "0.002".
    """
    mujoco = backend()
    if name == "integrator":
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{text.upper()}")
    elif name == "cone":
        model.opt.cone = getattr(mujoco.mjtCone, f"mjCONE_{text.upper()}")
    else:
        setattr(model.opt, name, float(text))
