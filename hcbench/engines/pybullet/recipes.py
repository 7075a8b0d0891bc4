"""Settings of PyBullet, the preferred ones of each role first."""

from __future__ import annotations

from functools import partial
from typing import Any

from hcbench.engines.pybullet.staggered_fit import Contacts, fit_contacts
from hcbench.recipes import constant
from hcbench.recipes.constant import minimax_constant, resolvable_law
from hcbench.recipes.law_recipes import exact_above, plug_in_recipes
from hcbench.recipes.recipe import Recipe, Role, stock
from hcbench.recipes.target import Target
from hcbench.terms.resolution import STEPS_OF_A_LOOP

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
    """Options of a setting: Bullet's own restitution, the best constant e of the band, with all
    that distorts it switched off.
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
    """Options of a setting: a Kelvin-Voigt contact, eq. (4), as Bullet integrates it.

    F = max(0, k (x + h v+) + c v+), with the best constant e of the band. Raises SettingError for
    e = 1.
    """
    duration = constant.contact_time(target)
    stiffness, damping = constant.implicit_spring_damper(target, duration, "restitution")
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
    """Links of the ball that start to touch at staggered depths, each with a spring and a damper."""
    make = partial(_options, target.timestep)
    law = resolvable_law(target)
    return make(fit_contacts(target, law, _LINKS, make))


def _options(timestep: float, contacts: Contacts) -> dict[str, Any]:
    """The options of a setting with these contacts at a time step, s."""
    # Bullet adds k h by itself.
    bullets = contacts.damping - timestep * contacts.stiffness
    columns = (contacts.onset.tolist(), contacts.stiffness.tolist(), bullets.tolist())
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
