"""PyBullet: the whole of eq. (16), loop included, in Bullet's own contact."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from hcbench.engines.pybullet.recipes.restitution import BALL, WORLD
from hcbench.engines.pybullet.recipes.spring_damper import RIGID
from hcbench.engines.pybullet.recipes.staggered_fit import Contacts, fit_contacts
from hcbench.recipes.constant import resolvable_law
from hcbench.recipes.recipe import Recipe, Role
from hcbench.terms.resolution import STEPS_OF_A_LOOP

if TYPE_CHECKING:
    from hcbench.recipes.target import Target

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
