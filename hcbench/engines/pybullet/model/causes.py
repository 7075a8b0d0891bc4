"""Suspects that may keep a pair in PyBullet from bouncing as asked, and promises of `hcbench tune`
that a world no longer keeps. Most cannot be read back, so they are tried.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.pybullet.backend import (
    BODY_TYPE,
    LASTING_SETTINGS,
    RESTITUTION,
    STIFFNESS,
    UNCLIPPED,
    BulletClient,
)
from hcbench.engines.pybullet.model.bodies import MAXIMAL_COORDINATES, SlidingJoint
from hcbench.engines.pybullet.model.open import BodyPart
from hcbench.engines.pybullet.model.place import BulletPlacement
from hcbench.engines.pybullet.scene.options import part_in_script
from hcbench.laws.restitution import RestitutionCurve
from hcbench.measuring import diagnose
from hcbench.sim.model_under_test import Suspect
from hcbench.sim.promise import Promise
from hcbench.system.text import time_step
from hcbench.terms.impact import Impact

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from hcbench.engines.pybullet.backend import BulletClient
    from hcbench.engines.pybullet.model.place import BulletPlacement
    from hcbench.terms.setting import Pair


# Bullet's own restitutionVelocityThreshold, m/s.
_THRESHOLD = 0.2
# Bullet's own contactSlop, m.
_SLOP = 1e-5
# Bullet's own linearDamping, 1/s.
_DAMPING = 0.04
# Bullet's own numSolverIterations.
_ITERATIONS = 50
# Bullet's own maxJointVelocity, rad/s.
_FASTEST = 100.0
# A spin within this share of it was clipped.
_CLIPPED = 1e-3
# Speed of the hops of a body at rest, in speeds that gravity gives in a step.
_HOPS = 2.5
# A contactDamping, N s/m, that does not yield.
_RIGID = 1e30
# Restitutions nearer than this are taken for the same.
_SAME_E = 0.005


@dataclass(frozen=True, slots=True)
class BulletContext:
    """Pair, impacts and world that the search for causes examines.

    timestep: s.
    gravity: (3,), m/s².
    unread: body id -> (tag, e) of a restitution that its file has where PyBullet does not look.
    """

    bullet: BulletClient
    place: BulletPlacement
    impacts: Sequence[Impact]
    wanted: RestitutionCurve | None
    timestep: float
    gravity: tuple[float, ...]
    unread: Mapping[int, tuple[str, float]]

    @property
    def sides(self) -> tuple[BodyPart, BodyPart]:
        """The two links that meet."""
        return self.place.first, self.place.second

    @property
    def is_spring(self) -> bool:
        """True if a contactStiffness takes the place of restitution."""
        return any(self.bullet.getDynamicsInfo(s.body, s.link)[STIFFNESS] > 0 for s in self.sides)

    @property
    def slowest(self) -> float:
        """The lowest approach speed seen, m/s."""
        return min((i.speed_in for i in self.impacts if np.isfinite(i.speed_in)), default=0.0)

    @property
    def fix_e(self) -> float:
        """The restitution to write in a fix."""
        e = diagnose.constant_e(self.impacts, self.wanted)
        return diagnose.BOUNCY if e is None else e


@dataclass(frozen=True, slots=True)
class Call:
    """A call in a fix.

    settings: its keywords.
    side: the link that it sets; None for the world.
    """

    settings: Mapping[str, float]
    side: BodyPart | None = None

    @property
    def text(self) -> str:
        """The fix as a user writes it; bodies from files are called as their files."""
        keywords = ", ".join(f"{k}={v:g}" for k, v in self.settings.items())
        if self.side is None:
            return f"p.setPhysicsEngineParameter({keywords})"
        return f"p.changeDynamics({self.side.variable}, {self.side.link}, {keywords})"

    def apply(self, bullet: BulletClient) -> None:
        """Make the fix in the world."""
        if self.side is None:
            bullet.setPhysicsEngineParameter(**self.settings)
        else:
            bullet.changeDynamics(self.side.body, self.side.link, **self.settings)


def script_of(lines: Iterable[str], parts: Iterable[BodyPart]) -> str:
    """Lines of calls as a text to paste: with the module that they call, and a comment on the
    variables of bodies from files.

    parts: whose bodies the lines name.
    """
    variables = dict.fromkeys(part.variable for part in parts)
    names = [variable for variable in variables if isinstance(variable, str)]
    head = ["import pybullet as p"]
    if names:
        head.append(f"# {', '.join(names)}: the bodies that loadURDF returned")
    return "\n".join([*head, *lines])


def _fix(*calls: Call) -> tuple[str, Callable[[BulletClient], None]]:
    """(text, apply) of a fix that is made of calls."""
    return "; ".join(call.text for call in calls), partial(apply_calls, calls=calls)


def apply_calls(bullet: BulletClient, calls: Sequence[Call]) -> None:
    """Make calls in the world, in order."""
    for call in calls:
        call.apply(bullet)


def _fix_restitutions(
    sides: Sequence[BodyPart], values: Sequence[float]
) -> tuple[str, Callable[[BulletClient], None]]:
    """The fix that sets the restitution of links: text for the user, and a function that makes it in
    a client. Springs of the links stay, as they are a cause of their own.

    sides: the links.
    values: the restitution of each.
    """
    return _fix(*(Call({"restitution": e}, side) for side, e in zip(sides, values, strict=True)))


def without_spring(bullet: BulletClient, side: BodyPart) -> dict[str, float]:
    """Keywords of changeDynamics that take the spring and damper of a link away, which would change
    its restitution; empty for a link without them.

    PyBullet cannot unset them. But a stiffness of 0 with a huge damping is Bullet's rigid contact,
    without error reduction.
    """
    if not bullet.getDynamicsInfo(side.body, side.link)[STIFFNESS] > 0.0:
        return {}
    return {"contactStiffness": 0.0, "contactDamping": _RIGID}


def restitutions(bullet: BulletClient, place: BulletPlacement) -> tuple[float, float]:
    """Restitutions that are set of the two links that meet, the moving one first.

    NaN for a body with maximal coordinates: PyBullet returns the value of an earlier query for it.
    """
    first = _restitution(bullet.getDynamicsInfo(place.first.body, place.first.link))
    second = _restitution(bullet.getDynamicsInfo(place.second.body, place.second.link))
    return first, second


def _restitution(info: Sequence[float]) -> float:
    """The restitution in what getDynamicsInfo returned."""
    if info[BODY_TYPE] == MAXIMAL_COORDINATES:
        return math.nan
    return float(info[RESTITUTION])


def find_suspects(context: BulletContext) -> list[Suspect]:
    """Suspects of all checks that may keep the pair from bouncing as asked, likeliest first."""
    checks = (
        _unset_restitutions,
        _restitution_product,
        _bullet_defaults,
        _solver,
        _few_steps,
        _gravity,
        _joint_motor,
        _spin_clamp,
    )
    suspects: list[Suspect] = []
    for check in checks:
        suspects += check(context)
    return suspects


def what_distorts(context: BulletContext) -> list[Suspect]:
    """Bullet's defaults that change a bounce of the plug-in, too."""
    beside = ("predictive-contact", "erp", "damping")
    return [suspect for suspect in _bullet_defaults(context) if suspect.code in beside]


def _unset_restitutions(c: BulletContext) -> Iterator[Suspect]:
    """Suspect restitutions that are not set, of one body or of both: Bullet multiplies the two, and
    an unset one is 0. Also one that a file has in another simulator's tag, which PyBullet does not
    read. Up to two suspects.
    """
    values = list(restitutions(c.bullet, c.place))
    if math.isnan(sum(values)):
        return
    foreign_sides = []
    foreign_values = []
    foreign_words = []
    for i, side in enumerate(c.sides):
        if values[i] == 0.0 and side.body in c.unread:
            tag, e = c.unread[side.body]
            values[i] = e
            foreign_sides.append(side)
            foreign_values.append(e)
            foreign_words.append(f"<{tag}> {e:g} of {side.name!r}")
    positive = [e for e in values if e > 0.0]
    assumed_e = None
    if c.wanted is None:
        assumed_e = math.prod(positive) if positive else diagnose.BOUNCY
    report = partial(Suspect, always_reported=True, assumed_e=assumed_e)
    if foreign_sides:
        text, apply = _fix_restitutions(foreign_sides, foreign_values)
        e = foreign_values[0]
        yield report(
            "foreign-restitution",
            "The file has its restitution in a tag that PyBullet does not read.",
            ", ".join(foreign_words),
            f'<contact><restitution value="{e:g}"/></contact> in the <link>, or {text}',
            apply,
        )
    if not positive:
        text, apply = _fix_restitutions(c.sides, (c.fix_e, 1.0))
        yield report(
            "no-restitution",
            "Neither of the two has a restitution: an unset one is 0.",
            "restitution 0 and 0",
            text,
            apply,
        )
    elif len(positive) == 1:
        unset, other = c.sides
        if values[0] != 0.0:
            unset, other = other, unset
        text, apply = _fix_restitutions([unset], [1.0])
        yield report(
            "other-body",
            f"The restitution of {unset.name!r} is not set: the two multiply, so the pair has e = 0.",
            f"restitution {positive[0]:g} on {other.name!r}, 0 on {unset.name!r}",
            text,
            apply,
        )


def _restitution_product(c: BulletContext) -> Iterator[Suspect]:
    """Suspect restitutions that are both set, but whose product is not the target e.

    Nothing without a target.
    """
    first, second = restitutions(c.bullet, c.place)
    product = first * second
    e = c.fix_e
    if product > 0.0 and c.wanted is not None and abs(product - e) > _SAME_E:
        text, apply = _fix_restitutions(c.sides, (e, 1.0))
        yield Suspect(
            "product",
            "The product of the two restitutions is not the target e.",
            f"{first:g} x {second:g} = {product:.4g}, target {e:.4g}",
            text,
            apply,
        )


def _bullet_defaults(c: BulletContext) -> Iterator[Suspect]:
    """Suspect five defaults of Bullet that change a bounce, whether they were changed or not: PyBullet
    does not give these numbers back, so their fixes are tried.
    """
    if c.slowest <= _THRESHOLD:
        yield Suspect(
            "velocity-threshold",
            "Below restitutionVelocityThreshold Bullet does not bounce at all.",
            f"impacts from {c.slowest:.3g} m/s, threshold {_THRESHOLD:g} m/s unless set",
            *_fix(Call({"restitutionVelocityThreshold": 0.0})),
        )
    distance = LASTING_SETTINGS["contactBreakingThreshold"]
    text, apply = _fix(Call({"contactProcessingThreshold": 0.0}, c.place.first))
    yield Suspect(
        "predictive-contact",
        "Bullet acts on contacts before they touch: the body is stopped short and restitution is lost.",
        f"contacts up to {distance:g} m away are solved for, at {c.slowest * c.timestep:.3g} m a step",
        f"{text} and {Call({'contactBreakingThreshold': distance}).text}",
        apply,
    )
    deepest = max(
        (i.penetration_max for i in c.impacts if np.isfinite(i.penetration_max)), default=0.0
    )
    yield Suspect(
        "slop",
        "contactSlop lets bodies overlap by as much as a hard contact's whole depth before anything acts.",
        f"contactSlop {_SLOP:g} m unless set, deepest penetration seen {deepest:.3g} m",
        *_fix(Call({"contactSlop": 0.0})),
    )
    yield Suspect(
        "erp",
        "Error reduction (ERP) pushes an overlap apart and adds its own speed to the rebound.",
        "contactERP is 0.2 unless set; erp, which holds joints and constraints together, is left as it is",
        *_fix(Call({"contactERP": 0.0})),
    )
    yield Suspect(
        "damping",
        "Bullet damps all motion: linearDamping and angularDamping are not 0 by themselves.",
        f"linearDamping {_DAMPING:g} /s unless set, {_DAMPING * c.timestep:.2g} of the speed a step",
        *_fix(Call({"linearDamping": 0.0, "angularDamping": 0.0}, c.place.first)),
    )


def _solver(c: BulletContext) -> Iterator[Suspect]:
    """Suspect a solver that stops before it has found the impulses, in any case: PyBullet does not
    give its threshold back, so the fix is tried.
    """
    iterations = int(c.bullet.getPhysicsEngineParameters()["numSolverIterations"])
    yield Suspect(
        "solver",
        "The solver stops before it has found the contact's impulse.",
        f"numSolverIterations {iterations}, solverResidualThreshold 1e-7 unless set",
        *_fix(
            Call(
                {
                    "numSolverIterations": max(_ITERATIONS, iterations),
                    "solverResidualThreshold": 1e-7,
                }
            )
        ),
    )


def _few_steps(c: BulletContext) -> Iterator[Suspect]:
    """Suspect restitutions whose product is above 1; else, for a contact with a stiffness, which
    takes the place of restitution, a step at which impacts gain energy or last few steps. At most
    one suspect.

    c: the pair in its world, and the impacts to explain.
    """
    first, second = restitutions(c.bullet, c.place)
    if first * second > 1:
        yield Suspect(
            "energy-gain",
            "The restitutions of the two multiply to more than 1: every bounce adds energy.",
            f"{first:g} x {second:g} = {first * second:.4g}",
            *_fix_restitutions(c.sides, (1.0, 1.0)),
        )
    elif c.is_spring:
        step = diagnose.StepFix(c.timestep, "p.setTimeStep({})", _set_step)
        yield from diagnose.energy_gain(c.impacts, step)
        yield from diagnose.few_steps(c.impacts, step, "a lower contactStiffness")


def _gravity(c: BulletContext) -> Iterator[Suspect]:
    """Suspect gravity, where it acts for a notable part of an impact's speed."""
    fix = "a stiffer contact, or p.setTimeStep({:.2g})"
    return diagnose.gravity(
        c.impacts,
        c.gravity,
        c.timestep,
        lambda longest: fix.format(longest / 5),
        _take_gravity_away,
    )


# Fixes are functions with a name, as a forked copy of the process sends them.


def _set_step(bullet: BulletClient, timestep: float) -> None:
    """Set the time step, s."""
    bullet.setTimeStep(timestep)


def _take_gravity_away(bullet: BulletClient) -> None:
    bullet.setGravity(0.0, 0.0, 0.0)


def _release_motor(bullet: BulletClient, body: int, joint: int) -> None:
    """Take its velocity motor off a joint."""
    bullet.setJointMotorControl2(body, joint, bullet.module.VELOCITY_CONTROL, force=0)


def _joint_motor(c: BulletContext) -> Iterator[Suspect]:
    """Suspect the motor with which PyBullet loads every joint, of a body on a sliding joint."""
    mover = c.place.mover
    if isinstance(mover, SlidingJoint):
        yield Suspect(
            "joint-motor",
            "PyBullet loads every joint with a velocity motor on, which brakes it.",
            mover.description,
            f"p.setJointMotorControl2({mover.body}, {mover.joint}, p.VELOCITY_CONTROL, force=0)",
            partial(_release_motor, body=mover.body, joint=mover.joint),
        )


def _spin_clamp(c: BulletContext) -> Iterator[Suspect]:
    """Suspect Bullet's limit of each component of a body's velocity and spin, which it applies
    without a word, if a launch's spin was lost before the impact or a spin is at the limit; at most
    one suspect.
    """
    for impact in c.impacts:
        along = impact.tangential
        if along is None:
            continue
        launched = max(map(abs, impact.launch.spin))
        spin_in = np.abs(along.spin_in)
        spins = np.abs([along.spin_in, along.spin_out])
        is_lost_in_flight = launched > _FASTEST >= spin_in.max()
        is_at_the_limit = (np.abs(spins - _FASTEST) < _CLIPPED * _FASTEST).any()
        if is_lost_in_flight or is_at_the_limit:
            text, apply = _fix(Call({"maxJointVelocity": UNCLIPPED}, c.place.first))
            yield Suspect(
                "spin-clamp",
                "Bullet clips spin at maxJointVelocity, 100 rad/s unless set.",
                f"launched at {launched:.4g} rad/s, spins at {spin_in.max():.4g} rad/s before the impact",
                text,
                apply,
                always_reported=True,
            )
            return


def speed_of_hops(timestep: float, gravity: float) -> float:
    """The largest speed with which a body that has a restitution hops although it should rest, m/s.

    timestep: h, s.
    gravity: g along the normal, m/s².
    In each step gravity brings the body to the plate at g h, and restitution throws it up again. So
    with e it hops for ever, at up to 2 g h/(1 + e); the corners of a face that hop in turn are a
    little faster.
    """
    return _HOPS * max(gravity, 0.0) * timestep


def restitution_setting(
    place: BulletPlacement, springless: Sequence[Mapping[str, float]], e: float, still: float
) -> Suspect:
    """All calls that give a pair this e, as the fix of a suspect without title and evidence.

    The first part gets e, the second 1: Bullet multiplies them.
    springless: for each of the two parts the keywords that take away its spring and damper, {} for
    none.
    still: speed below which nothing is to bounce, m/s.
    place: the pair at touch.
    """
    first, second = ({"restitution": 1.0, **keywords} for keywords in springless)
    first["restitution"] = e
    world = {"restitutionVelocityThreshold": still, "contactSlop": 0.0, "contactERP": 0.0}
    undamped = {"linearDamping": 0.0, "angularDamping": 0.0, "contactProcessingThreshold": 0.0}
    text, apply = _fix(
        Call({**world, "contactBreakingThreshold": LASTING_SETTINGS["contactBreakingThreshold"]}),
        Call({**undamped, **first}, place.first),
        Call({**second, "contactProcessingThreshold": 0.0}, place.second),
    )
    return Suspect("restitution", "", "", text, apply)


# Promises of `hcbench tune` that a PyBullet world keeps as user data of a body, and causes that
# it does not keep them.

# Relative difference of two numbers that digits of a text make.
_SAME = 1e-6


def promise_line(pair: Pair, promise: Promise) -> str:
    """The line of Python that keeps a promise in a world, as user data of the first body; "" for a
    promise whose target a text cannot state.

    pair: the two, as `part_in_script` takes them.
    """
    if not promise.text:
        return ""
    (first, first_link), (second, second_link) = map(part_in_script, pair)
    # Braces of an f-string: the script's own number of the second body.
    key = f'f"{_key("{" + second + "}", second_link)}"'
    # Parts of one text, which Python joins, in lines that a page can show.
    words = [f"{part}; " for part in promise.text.split("; ")]
    words[-1] = words[-1].removesuffix("; ")
    half = len(words) // 2
    parts = [json.dumps("".join(some)) for some in (words[:half], words[half:])]
    of_link = "" if first_link < 0 else f", linkIndex={first_link}"
    return f"pybullet.addUserData({first}, {key},\n    {parts[0]}\n    {parts[1]}{of_link})"


def promise_in(bullet: BulletClient, sides: tuple[BodyPart, BodyPart]) -> Promise | None:
    """Read the promise that `hcbench tune` wrote for two links, in either order; None without one."""
    for first, second in (sides, sides[::-1]):
        key = _key(str(second.body), second.link)
        number = bullet.getUserDataId(first.body, key, linkIndex=first.link)
        if number >= 0:
            return Promise.read(bullet.getUserData(number).decode())
    return None


def _key(body: str, link: int) -> str:
    return f"hcbench:{body}:{link}"


def broken_promise(
    bullet: BulletClient, promise: Promise, has_law: bool, gravity: Sequence[float]
) -> Iterator[Suspect]:
    """Yield a suspect for each difference between a pair and the one that `hcbench tune` wrote.

    promise: what it wrote.
    has_law: whether a law of the plug-in acts between the two now.
    gravity: m/s², (3,).
    """
    parameters = bullet.getPhysicsEngineParameters()
    is_plugin = not promise.rows
    if is_plugin and not has_law:
        yield Suspect(
            "promised-plugin",
            "hcbench wrote a plug-in for these two, and none of its laws acts between them.",
            "resetSimulation and the command remove end a law",
            "paste all that `hcbench tune pybullet` printed again, after the bodies are loaded",
            always_reported=True,
        )
    step = float(parameters["fixedTimeStep"])
    promised = float(dict(promise.option).get("fixedTimeStep", step))
    # The plug-in holds up to its step, Bullet's own contact at it.
    is_other = step > (1.0 + _SAME) * promised
    if not is_plugin:
        is_other = abs(step - promised) > _SAME * promised
    if is_other:
        yield Suspect(
            "promised-timestep",
            "The world has another time step than hcbench wrote this setting for.",
            f"{time_step(step)} s now, tuned for {time_step(promised)} s",
            f"p.setPhysicsEngineParameter(fixedTimeStep={promised:.6g})",
            partial(_set_parameter, fixedTimeStep=promised),
            always_reported=True,
        )
    if parameters["numSubSteps"]:
        yield Suspect(
            "promised-substeps",
            "Bullet takes sub-steps, and hcbench wrote this setting for whole steps.",
            f"numSubSteps {parameters['numSubSteps']} now, 0 when it was tuned",
            "p.setPhysicsEngineParameter(numSubSteps=0)",
            partial(_set_parameter, numSubSteps=0),
            always_reported=True,
        )
    strength = float(np.linalg.norm(gravity))
    if not is_plugin and promise.is_other_gravity(strength):
        yield Suspect(
            "promised-gravity",
            "The world has another gravity than hcbench wrote this setting for.",
            f"{strength:.4g} m/s^2 now; tuned under {promise.gravity:.4g} m/s^2",
            f'hcbench tune pybullet with --gravity "{strength:.4g} m/s^2"',
            always_reported=True,
        )


def _set_parameter(bullet: BulletClient, **settings: float) -> None:
    bullet.setPhysicsEngineParameter(**settings)
