"""Settings of PyBullet, the preferred ones of each role first, and the fit of the contacts of
`staggered`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.laws import closed_form
from hcbench.recipes.law_recipes import exact_above, plug_in_recipes
from hcbench.recipes.recipe import Recipe, Role, Search, map_result, stock
from hcbench.recipes.target import (
    Target,
    contact_time,
    contact_times,
    implicit_spring_damper,
    minimax_constant,
    resolvable_law,
)
from hcbench.terms.resolution import STEPS_OF_A_LOOP

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.laws.force import HuntCrossley
    from hcbench.recipes.target import Target
    from hcbench.terms.impact import Floats


# Fits contacts of Bullet's own that start at staggered depths to eq. (16), by a model of Bullet's
# steps.
#
# A contact with contactStiffness k and contactDamping c' whose depth x is above 0 at a step's
# start pushes with F = max(0, k (x + h v) + c' v), v the approach rate at the step's end; several
# add up. So with c' = c - k h it is a spring on the depth at the start and a damper c on the rate
# at the end: near touch the law asks for c' below 0.

# Onset of the second contact over the largest penetration.
_FIRST = 0.03
# Least onset of the second contact, over the longest way in a step.
_FIRST_STEP = 0.43
# Multiples of that onset that are tried: the best is taken.
_FIRST_TRIED = (1.0, 1.16)
# Most steps of the shortest contact that a fit takes: finer steps are fitted at so many.
_STEPS_MOST = 250.0
# Phases of a step at each speed are so many over the steps of the shortest contact.
_LAUNCHES = 320.0
# Fewest and most phases.
_PHASES_LEAST = 3
_PHASES_MOST = 16
# Impact speeds of the fit.
_SPEEDS = 40
# Impact speeds of its check, which lie between those of the fit.
_OTHER_SPEEDS = 97
# Loops of force over penetration that are fitted.
_LOOPS = 12
# Points of each of the two branches of a loop.
_POINTS = 24
# One unit of misfit in e, as a share of the error of one e for all speeds.
_SHARE = 0.015
# Least unit of misfit in e.
_LEAST = 1e-5
# Units of misfit in a loop's force over its largest, in those of e.
_FORCE_SHARE = 13.0
# Powers of the misfit in e, one after another: a higher one minds the worst.
_POWERS = (1, 2)
# Evaluations with each power.
_EVALUATIONS = 30
# Relative change of a parameter for derivatives: wide, as e jumps where a
# contact starts a step earlier.
_NUDGE = 1e-2
# Least k and c of a start, over the median: no search revives a contact that does nothing.
_FAINTEST = 0.1
# Launches at a time: more do not fit into a cache.
_BLOCK = 60
# Rounds until it is known which contacts push: more change nothing.
_ACTIVE_ROUNDS = 3


@dataclass(frozen=True, slots=True)
class Contacts:
    """Contacts that each begin to push at a depth of their own; n contacts, or b sets of them.

    onset: depth from which a contact pushes, m.
    stiffness: k, N/m.
    damping: c, N s/m, of the law on the rate at a step's end.
    Shapes (n,) or (b, n).
    """

    onset: Floats
    stiffness: Floats
    damping: Floats


@dataclass(frozen=True, slots=True)
class FittedImpacts:
    """Impacts of a ball that Bullet's steps are worked out for.

    speeds: m/s, (n,).
    phases: of the touch within a step, 0 to 1, (n,).
    mass: kg.
    h: time step, s.
    g: gravity, m/s².
    steps: enough for all to part.
    """

    speeds: Floats
    phases: Floats
    mass: float
    h: float
    g: float
    steps: int

    @classmethod
    def of(
        cls, target: Target, law: HuntCrossley, speeds: int, denser: float = 1.0
    ) -> FittedImpacts:
        """Impacts that a fit looks at, over a target's band of speeds.

        The time step is the target's, but not finer than a share of the law's shortest contact.

        speeds: how many.
        denser: factor on the number of phases of a step at each speed.
        """
        shortest, longest = contact_times(target, law)
        h = max(target.timestep, shortest / _STEPS_MOST)
        phases_of_step = np.clip(round(_LAUNCHES * h / shortest), _PHASES_LEAST, _PHASES_MOST)
        phases = int(denser * phases_of_step)
        # Slow impacts are the hard ones: the speeds lie denser there.
        share = np.linspace(0.0, 1.0, speeds) ** 1.2
        at = target.speed_min + (target.speed_max - target.speed_min) * share
        return cls(
            # Each speed at each phase, phases of one speed after another.
            speeds=np.repeat(at, phases),
            phases=np.tile((np.arange(phases) + 0.5) / phases, speeds),
            mass=target.mass,
            h=h,
            g=target.gravity,
            steps=int(1.25 * longest / h) + 6,
        )

    def restitution(self, contacts: Contacts) -> Floats:
        """e that Bullet delivers at each impact, (b, n), of b sets of contacts, (b, contacts)."""
        # Few launches at a time, rounded up.
        blocks = -(-len(self.speeds) // _BLOCK)
        speeds = np.array_split(self.speeds, blocks)
        phases = np.array_split(self.phases, blocks)
        parts = []
        for of_speeds, of_phases in zip(speeds, phases, strict=True):
            part = replace(self, speeds=of_speeds, phases=of_phases)
            parts.append(part._restitution(contacts))
        return np.concatenate(parts, axis=1)

    def _restitution(self, contacts: Contacts) -> Floats:
        """e that Bullet delivers at each impact, (b, n), with all impacts at once.

        The speeds before and after are those at the plane of touch, to which free flight, which
        conserves energy, carries them from the first state and from the last.

        contacts: b sets, (b, contacts).
        """
        h = self.h
        # Speed that gravity adds in a step, m/s.
        fall = self.h * self.g
        # (contacts, b, 1): m; and what a step adds to the speed per depth, 1/s, and per rate, 1.
        onset = contacts.onset.T[..., None]
        k = (h / self.mass) * contacts.stiffness.T[..., None]
        c = (h / self.mass) * contacts.damping.T[..., None]
        # Depth, m, and its rate, m/s, (b, n): before the touch by the phase of a step.
        x = np.tile(-self.phases * h * self.speeds, (k.shape[1], 1))
        v = np.tile(self.speeds - self.phases * fall, (k.shape[1], 1))
        # The squared speed at the plane: semi-implicit Euler conserves it in flight with the rate of
        # half a step later.
        before = (v + fall / 2) ** 2 - 2 * self.g * x
        for _ in range(self.steps):
            depth = x - onset
            spring = k * np.maximum(depth, 0.0)
            damper = np.where(depth > 0, c, 0.0)
            # Launches that have parted stay as they are.
            parted = (x <= 0) & (v < 0)
            v = np.where(parted, v, _rate_after(v + fall, spring, damper))
            x = np.where(parted, x, x + h * v)
            if parted.all():
                break
        after = (v + fall / 2) ** 2 - 2 * self.g * x
        return np.asarray(np.sqrt(np.maximum(after, 0.0) / before))


def _rate_after(free: Floats, spring: Floats, damper: Floats) -> Floats:
    """Approach rate at a step's end, m/s, (b, n), with contacts that push by springs and dampers.

    It solves v = free - sum of max(0, spring + damper v), by finding which contacts push.

    free: rate without the contacts, m/s, (b, n).
    spring: what each spring takes of the rate, m/s; damper: what each damper takes, as a share of
    v; (contacts, b, n) each.
    """
    v = (free - spring.sum(0)) / (1 + damper.sum(0))
    for _ in range(_ACTIVE_ROUNDS):
        before = v
        pushes = spring + damper * v > 0
        v = (free - (spring * pushes).sum(0)) / (1 + (damper * pushes).sum(0))
        if np.array_equal(v, before):
            break
    return np.asarray(v)


@dataclass(frozen=True, slots=True)
class _Loops:
    """Points of loops of the law's force over penetration, that contacts are to follow; (n,) each.

    x: penetration at a step's start, m.
    v: its rate at the step's end, m/s.
    force: of the law, N.
    scale: factor that makes of an error of the force a share of the loop's largest force, 1/N,
    weighted so that the sum of squares of all is the mean over the loops of the squared error.
    """

    x: Floats
    v: Floats
    force: Floats
    scale: Floats

    @classmethod
    def of(cls, law: HuntCrossley, mass: float, speeds: Floats, h: float) -> _Loops:
        """Loops of a law for a ball, one at each impact speed.

        mass: kg.
        speeds: m/s, (loops,).
        h: time step, s, at whose end the rates are.
        """
        # Points lie evenly in the angle: the depth is its sine, as in a half swing.
        angle = (np.arange(_POINTS) + 0.5) / _POINTS * np.pi / 2
        columns = []
        for speed in speeds.tolist():
            x = float(closed_form.penetration_max(law, mass, speed)) * np.sin(angle)
            largest = float(closed_form.force_max(law, mass, speed))
            # A point's part of the depth is cos(angle) of its part of the angle; half of each loop
            # is a branch.
            scale = np.sqrt(np.cos(angle) * np.pi / 4 / _POINTS / len(speeds)) / largest
            for branch in ("approach", "rebound"):
                v = closed_form.rate_at(law, mass, speed, x, branch)
                force = law.force(x, v)
                rate_at_end = v - h * force / mass
                columns.append((x, rate_at_end, force, scale))
        return cls(*(np.concatenate(column) for column in zip(*columns, strict=True)))

    def misfit(self, contacts: Contacts) -> Floats:
        """Errors of the summed force of b sets of contacts, (b, contacts), at the loops' points, as
        weighted shares of the largest force, (b, n).
        """
        # Depth of each point in each contact, m, and the contact's force there, N, (b, n, contacts).
        depth = self.x[:, None] - contacts.onset[:, None]
        each = contacts.stiffness[:, None] * depth + contacts.damping[:, None] * self.v[:, None]
        # A contact acts from its onset on, and does not pull.
        pushes = np.where(depth > 0, np.maximum(0.0, each), 0.0)
        return np.asarray((pushes.sum(-1) - self.force) * self.scale)

    def first_guess(self, onset: Floats, step: float) -> Contacts:
        """Contacts with given onsets whose summed force is near the loops', to start a search from.

        The stiffnesses and dampings are fitted linearly, again and again without the points where a
        contact would pull. None stays at 0, from where no later search revives it.

        onset: m, (contacts,).
        step: time step, s.
        """
        # SciPy's optimisation is slow to import, and a list of recipes needs none of it.
        from scipy.optimize import nnls

        # Of each point in each contact, (points, contacts), 0 before its onset: m and m/s.
        depth = np.maximum(0.0, self.x[:, None] - onset)
        rate = np.where(depth > 0, self.v[:, None], 0.0)
        pushes = depth > 0
        # More rounds change hardly which contacts push where.
        for _ in range(8):
            # A column for each stiffness, then one for each damping, (points, 2 contacts); scaled
            # to length 1 for the fit.
            columns = np.concatenate([depth * pushes, rate * pushes], axis=1) * self.scale[:, None]
            unit = np.linalg.norm(columns, axis=0) + 1e-300
            solution = nnls(columns / unit, self.force * self.scale, maxiter=10_000)[0] / unit
            k, c = np.split(solution, 2)
            pushes = (depth > 0) & (k * depth + c * rate > 0)
        least_k = max(_FAINTEST * np.median(k), 1e-3 * k.max())
        least_c = _FAINTEST * np.median(c)
        k = np.maximum(k, least_k)
        c = np.maximum(c, np.maximum(least_c, 1e-3 * step * k))
        return Contacts(onset, k, c)


@dataclass(frozen=True, slots=True)
class _Misfit:
    """Errors of contacts, in e at launches and in force over loops, for a least-squares search.

    Its parameters are the logarithms of the contacts' stiffnesses, N/m, dampings, N s/m, and
    distances between onsets, m: 3 contacts - 1.

    wanted: e of the target at each launch, (n,).
    unit: error of e that counts as 1.
    """

    launches: FittedImpacts
    wanted: Floats
    loops: _Loops
    unit: float

    @staticmethod
    def contacts(parameters: Floats) -> Contacts:
        """Contacts of parameters of the search, (b, 3 contacts - 1); the first begins at depth 0."""
        count = (parameters.shape[-1] + 1) // 3
        k, c, apart = np.split(np.exp(parameters), [count, 2 * count], axis=-1)
        # The distances between onsets, m, from the first one at 0 on.
        first = 0.0 * k[..., :1]
        onset = np.cumsum(np.concatenate([first, apart], axis=-1), axis=-1)
        return Contacts(onset, k, c)

    @staticmethod
    def parameters(contacts: Contacts) -> Floats:
        """Parameters of the search, (3 contacts - 1,), of contacts, (contacts,)."""
        return np.asarray(
            np.log(np.concatenate([contacts.stiffness, contacts.damping, np.diff(contacts.onset)]))
        )

    def residuals(self, parameters: Floats, power: int) -> Floats:
        """Errors of b trials of the search, (b, n): of e at each launch, then of the force at each
        point of the loops, in shares of `unit`.

        parameters: of the search, (b, 3 contacts - 1).
        power: to which errors of e are taken, with their sign: a higher one makes a sum of squares
        mind the worst more.
        """
        made = self.contacts(parameters)
        error = (self.launches.restitution(made) - self.wanted) / self.unit
        # Over √n, so that the sum of squares is a mean.
        of_e = np.sign(error) * np.abs(error) ** power / np.sqrt(error.shape[1])
        of_force = self.loops.misfit(made) / (_FORCE_SHARE * self.unit)
        return np.concatenate([of_e, of_force], axis=1)

    def jacobian(self, parameters: Floats, power: int) -> Floats:
        """Jacobian of `residuals` at one point: (residuals, parameters)."""
        nudges = _NUDGE * np.eye(len(parameters))
        up = self.residuals(parameters + nudges, power)
        down = self.residuals(parameters - nudges, power)
        return np.asarray((up - down).T / (2 * _NUDGE))

    def fitted(self, parameters: Floats, record: Callable[[Floats, Floats], None]) -> Floats:
        """Better parameters of the search, by least squares from given ones; (3 contacts - 1,) each.

        record: called with each trial's parameters, (1, 3 contacts - 1), and its largest error of
        e, (1,).
        """
        from scipy.optimize import least_squares

        def residuals(parameters: Floats, power: int) -> Floats:
            """Errors of one trial, (n,), which is recorded."""
            residuals = self.residuals(parameters[None], power)
            # Back from errors to a power, as shares of a mean, to the errors themselves.
            worst = np.abs(residuals[:, : self.wanted.size]).max(axis=1) * np.sqrt(self.wanted.size)
            record(parameters[None], self.unit * worst ** (1 / power))
            return np.asarray(residuals[0])

        for power in _POWERS:
            fit = least_squares(
                residuals,
                parameters,
                self.jacobian,
                xtol=1e-5,
                ftol=1e-4,
                max_nfev=_EVALUATIONS,
                args=(power,),
            )
            parameters = fit.x
        return parameters


def fit_contacts(
    target: Target, law: HuntCrossley, count: int, result: Callable[[Contacts], Any]
) -> Contacts:
    """Find contacts of Bullet's own that together follow a law, in e, and in force nearly, over a
    target's band of speeds.

    count: of contacts.
    result: makes of contacts what an interrupted search hands out.

    Raises SearchInterrupted, with the result of the best contacts until then.
    """
    launches = FittedImpacts.of(target, law, _SPEEDS)
    others = FittedImpacts.of(target, law, _OTHER_SPEEDS, 3.0)
    speeds = np.geomspace(target.speed_min, target.speed_max, _LOOPS)
    loops = _Loops.of(law, target.mass, speeds, launches.h)
    wanted = closed_form.restitution(law.alpha, launches.speeds)
    _, error_of_constant = minimax_constant(target)
    misfit = _Misfit(launches, wanted, loops, max(_SHARE * error_of_constant, _LEAST))
    elastic = replace(law, alpha=0.0)
    # Largest penetration, m, up to which the contacts are spread, and where the second begins.
    top = float(closed_form.penetration_max(elastic, target.mass, target.speed_max))
    first = min(max(_FIRST * top, _FIRST_STEP * launches.h * target.speed_max), 0.5 * top)
    search = Search(len(_FIRST_TRIED) * len(_POWERS) * _EVALUATIONS)
    fits = []
    with map_result(lambda best: result(misfit.contacts(best))), search.interrupt_with_best():
        for tried in _FIRST_TRIED:
            onset = np.concatenate([[0.0], np.geomspace(tried * first, top, count)[:-1]])
            start = misfit.parameters(loops.first_guess(onset, launches.h))
            fits.append(misfit.fitted(start, search.record))
    # The best is the one with the smallest largest error of e at speeds between those of the fit.
    of_law = closed_form.restitution(law.alpha, others.speeds)
    error = others.restitution(misfit.contacts(np.array(fits))) - of_law  # (fits, launches)
    # The progress is full, though a fit may have needed fewer evaluations.
    search.add(len(_FIRST_TRIED) * len(_POWERS) * _EVALUATIONS)
    best = int(np.abs(error).max(axis=1).argmin())
    return misfit.contacts(fits[best])


# PyBullet: delivers exactly the restitution that is set.

# What stands between the number and the bounce out of the box: a speed threshold of 0.2 m/s, error
# reduction and slop that add or eat speed, and damping of free flight.
WORLD: dict[str, Any] = {
    "restitutionVelocityThreshold": 0.0,
    "contactSlop": 0.0,
    "contactERP": 0.0,
    "contactBreakingThreshold": 0.02,
}
BALL: dict[str, Any] = {
    "linearDamping": 0.0,
    "angularDamping": 0.0,
    "contactProcessingThreshold": 0.0,
}


def restitution(target: Target) -> dict[str, Any]:
    """Options of a setting with Bullet's own restitution: the best constant e of a target's band of
    speeds, with all that distorts it switched off.
    """
    e, _ = minimax_constant(target)
    return {
        "world": WORLD,
        "ball": {**BALL, "restitution": e},
        "plate": {"restitution": 1.0},
        "maximal_coordinates": True,
    }


RESTITUTION = Recipe(
    "pybullet",
    "restitution",
    Role.CONSTANT_E,
    restitution,
    "Bullet's restitution with what distorts it turned off: the best constant e, at any step and phase.",
    (
        "The restitutions of the two bodies multiply: set e on the ball and 1 on the plate.",
        "Set all of this before the first step.",
        "Leave erp at its default: with 0, constraints and joints of rigid bodies would drift apart.",
        "A bounce needs contactERP=0 only.",
        "resetSimulation does not reset contactBreakingThreshold, and all clients of the process share it.",
        "Use maximal coordinates (loadURDF's useMaximalCoordinates) to keep e under gravity.",
        "By default Bullet reverses the speed v + g dt instead of v.",
        "The bounce takes one step: contact force and contact time mean nothing.",
    ),
    one_step=True,
)


# PyBullet: contactStiffness and contactDamping with the law's contact time.

# Bullet puts the springs of the two bodies in series: the plate's must not yield.
RIGID = 1e30


def spring_damper(target: Target) -> dict[str, Any]:
    """Options of a setting with Bullet's spring and damper, a Kelvin-Voigt contact, eq. (4).

    Bullet integrates it as F = max(0, k (x + h v+) + c v+), v+ the rate at the step's end. k and c
    make the best constant e of the target's band of speeds, and its time of contact.
    Raises SettingError for e = 1.
    """
    duration = contact_time(target)
    stiffness, damping = implicit_spring_damper(target, duration, "restitution")
    return {
        "world": WORLD,
        "ball": {**BALL, "contactStiffness": stiffness, "contactDamping": damping},
        "plate": {"contactStiffness": RIGID, "contactDamping": 0.0},
        "maximal_coordinates": False,
    }


SPRING_DAMPER = Recipe(
    "pybullet",
    "spring-damper",
    Role.CONSTANT_E,
    spring_damper,
    "contactStiffness and contactDamping: the best constant e, the law's contact time at middle speed.",
    (
        "k (N/m) and c (N s/m) are for this mass, unlike MuJoCo's.",
        "Bullet's implicit step adds damping. At coarse steps hcbench softens the spring to keep it small.",
        "The plate needs contactStiffness 1e30: Bullet puts the springs of the two bodies in series.",
        "e does not depend on speed, and the force jumps at touch: the force loop is not the law's.",
        "resetSimulation does not reset contactBreakingThreshold, and all clients of the process share it.",
    ),
)


# PyBullet: the whole of eq. (16), loop included, in Bullet's own contact.

# Spheres of the ball, each a link with a contact of its own.
_LINKS = 12


def staggered(target: Target) -> dict[str, Any]:
    """Options of a setting whose ball has links that start to touch at staggered depths, each with a
    spring and a damper. Raises SearchInterrupted, with the options of the best until then.
    """
    make = partial(_options, target.timestep)
    law = resolvable_law(target)
    return make(fit_contacts(target, law, _LINKS, make))


def _options(timestep: float, contacts: Contacts) -> dict[str, Any]:
    """Options of a setting whose ball has a link for each contact.

    timestep: h, s.
    contacts: (n,), with dampings c of the law on the rate at a step's end.
    """
    # Bullet adds k h by itself.
    damping = contacts.damping - timestep * contacts.stiffness
    columns = (contacts.onset.tolist(), contacts.stiffness.tolist(), damping.tolist())
    links = []
    for x, k, c in zip(*columns, strict=True):
        links.append({"onset": x, "stiffness": k, "damping": c})
    return {
        "world": WORLD,
        "ball": BALL,
        "plate": {"contactStiffness": RIGID, "contactDamping": 0.0},
        "links": links,
    }


STAGGERED = Recipe(
    "pybullet",
    "staggered",
    Role.LAW_AND_LOOP,
    staggered,
    "A ball of a dozen massless spheres that touch at staggered depths: the law, force loop included.",
    (
        "hcbench writes the ball's URDF: Bullet accepts a contact damping below 0 only from a URDF.",
        "k and c are for this mass and step: c is the law's minus k h, which Bullet's implicit step adds.",
        "Your loop calls plain stepSimulation. A step in contact takes about ten times as long.",
        "If the law's shortest contact lasts fewer than 10 steps, hcbench softens the springs to 24 steps.",
        "Without gravity e stays the same. The ball must be larger than the penetration.",
        "The plate needs contactStiffness 1e30: Bullet puts the springs of the two bodies in series.",
        "Friction follows Coulomb's law, for the sum of all contacts; leave frictionAnchor off.",
        "resetSimulation does not reset contactBreakingThreshold, and all clients of the process share it.",
    ),
    kinds=("law",),
    instead="`spring-damper` or `restitution`",
    forms=("plane",),
    # Error of e at a step of 1e-6 s.
    within=1.6e-3,
    steps_min=STEPS_OF_A_LOOP,
)


STOCK = stock(
    "pybullet",
    "PyBullet as it loads the model: restitution 0, and no bounce below 0.2 m/s with any setting.",
    "Knows nothing of the law. Bullet acts on a contact it predicts for the coming step,"
    " so what bounce there is depends on the phase.",
)
_NATIVE = (STOCK, RESTITUTION, SPRING_DAMPER, STAGGERED)
# Bullet slows every body in flight; the law is about contact alone. A rigid body of maximal
# coordinates is stopped by contacts that it will reach only later, unless their threshold is 0, and
# Bullet adds the restitution of such bodies to what the law does.
_NO_DRAG = {
    "ball": {
        "linearDamping": 0.0,
        "angularDamping": 0.0,
        "contactProcessingThreshold": 0.0,
        "restitution": 0.0,
    },
    "plate": {"restitution": 0.0},
}


# In g h: at 1.6 itself, where round-off decides, some bodies stay down.
_SLOWEST = 1.601

RECIPES = (
    *_NATIVE,
    *plug_in_recipes("pybullet", _NATIVE, _NO_DRAG, partial(exact_above, _SLOWEST)),
)
