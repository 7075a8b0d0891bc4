"""DART behind the contract of an engine: a ball on a box, by rigid contact."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import Restitution
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Role, on_a_plane, stock
from hcbench.recipes.target import Target, minimax_constant
from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import DescribesContact, Feature, Features
from hcbench.sim.scripted import ScriptedEngine, ScriptOptions
from hcbench.system.errors import SettingError
from hcbench.system.text import shortest
from hcbench.terms.fields import Finite

if TYPE_CHECKING:
    from hcbench.terms.scene import Scene


class DartOptions(ScriptOptions):
    """A setting's options: none of them means a scene in metres with nothing set.

    restitution: of the ball's shape; the plate's is 1.
    units_per_metre: of DART's unit of length, 100 for cm.
    """

    restitution: Annotated[Finite | None, Field(ge=0.0, le=1.0)] = None
    units_per_metre: Annotated[Finite, Field(gt=0.0)] = 1.0


_CAVEATS = (
    "DART bounces nothing while e v is below 0.1 units of length a second: model a band of low speeds in cm.",
    "DART multiplies the restitutions of both shapes; stock is 0, so the plate needs 1.",
)


class DartEngine(DescribesContact, ScriptedEngine[DartOptions]):
    """DART 6 behind dartpy."""

    name = "dart"
    title = "DART"
    backend = Backend("dart", "dartpy", "6.20", "6.20")
    # Its texts set no friction.
    keeps_friction = True
    table = DartOptions
    features = Features(
        law=Feature("Newton's e in one step: e of both shapes multiplied", "measured, to 1e-14"),
        exponent=Feature("none: rigid", "one step, of any length"),
        threshold=Feature(
            "e v of 0.1 units of length a second; nothing faster than 100", "measured, to 1e-13"
        ),
        licence=Feature("BSD-2-Clause", "its wheel"),
    )

    def lines(self, options: DartOptions, scene: Scene) -> str:
        """Lines of Python that build a world of plate and ball for a setting, and define its step.

        options: the setting's.
        scene: not used: its numbers are names that the lines find.
        """
        # Without a collision aspect nothing but the law's force acts on the ball.
        shapes = "ball_shape.createDynamicsAspect()"
        if not isinstance(options.law, HuntCrossley):
            shapes = f"{_SHAPES}\n{_restitution_lines(options)}".rstrip()
        # Indented: it stands within the step's function.
        hook = _hook(options).replace("\n", "\n    ") or "pass"
        return _LINES.format(length=shortest(options.units_per_metre), shapes=shapes, hook=hook)

    def paste(self, options: DartOptions, timestep: str) -> str:
        """Restitutions of both shapes, and what to do before each step."""
        length = f"L = {shortest(options.units_per_metre)}  # of DART's lengths in a metre"
        return "\n".join(filter(None, (length, _restitution_lines(options), _hook(options))))

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """DART's restitution for an e, with what constraint force mixing takes of it added; caveats
        alone for a contact without an e.
        """
        e = contact.restitution
        if e is None:
            return Vocabulary(caveats=_CAVEATS)
        note = f"{contact.at}; setRestitutionCoeff on one shape, 1 on the other"
        value = SystemValue("DART", "restitution", (_coefficient(e),), "", note)
        return Vocabulary((value,), caveats=_CAVEATS)


# Constraint force mixing is built in: two shapes whose coefficients multiply to p bounce with
# (1 + p)/(1 + 1e-5) - 1.
_MIXING = 1e-5


def _coefficient(e: float) -> float:
    """The restitution to set of one shape so that it bounces with e on another, which has 1; 1 at
    most, as DART takes no more.
    """
    return min(1.0, (1.0 + e) * (1.0 + _MIXING) - 1.0)


def _restitution_lines(options: DartOptions) -> str:
    """Lines that set restitutions: 1 of the plate, and that of the ball if it is one for all impacts;
    "" where neither an e nor a law by e is given.
    """
    if options.restitution is None and not isinstance(options.law, Restitution):
        return ""
    lines = "plate_shape.getDynamicsAspect().setRestitutionCoeff(1.0)  # they multiply"
    if options.restitution is not None:
        lines += f"\n{_SET_BALL.format(shortest(options.restitution))}"
    return lines


def _hook(options: DartOptions) -> str:
    """Before each step."""
    if isinstance(options.law, HuntCrossley):
        return _PUSH
    return _SET_EACH if options.law else ""


_SET_BALL = "ball_shape.getDynamicsAspect().setRestitutionCoeff({})"
_SET_EACH = f"""\
x, v = R - ball.getPositions()[5] / L, -ball.getVelocities()[5] / L
leaves = float(curve.rebound(x, v, timestep, gravity))  # so that e is that of the speed at the plane
share = leaves / (v + gravity * timestep) if v > 0 else 0.0  # DART reverses v + g h, at the step's end
{_SET_BALL.format("min(1.0, (1 + share) * (1 + 1e-5) - 1)")}"""
_PUSH = """\
x, v = R - ball.getPositions()[5] / L, -ball.getVelocities()[5] / L
body.addExtForce([0, 0, law(x, v) * L], [0, 0, 0], False, True)"""
_SHAPES = """\
for shape in (plate_shape, ball_shape):
    shape.createCollisionAspect()
    shape.createDynamicsAspect()"""
_LINES = """\
import dartpy as dart
import numpy as np

L = {length}  # of DART's lengths in a metre
world = dart.simulation.World()
world.setTimeStep(timestep)
world.setGravity([0, 0, -gravity * L])
plate, ball = dart.dynamics.Skeleton("plate"), dart.dynamics.Skeleton("ball")
_, ground = plate.createWeldJointAndBodyNodePair()
_, body = ball.createFreeJointAndBodyNodePair()
body.setInertia(dart.dynamics.Inertia(m, [0, 0, 0], np.eye(3) * inertia * L**2))
plate_shape = ground.createShapeNode(dart.dynamics.BoxShape([50 * L, 50 * L, 0.2 * L]))
plate_shape.setRelativeTranslation([0, 0, -0.1 * L])
ball_shape = body.createShapeNode(dart.dynamics.SphereShape(R * L))
{shapes}
world.addSkeleton(plate)
world.addSkeleton(ball)
def state():
    return ball.getPositions()[5] / L, ball.getVelocities()[5] / L
def place(height, velocity):
    world.reset()
    ball.setPositions([0, 0, 0, 0, 0, height * L])  # rotation, then x y z
    ball.setVelocities([0, 0, 0, 0, 0, velocity * L])
    return state()
def step():
    {hook}
    world.step()
    return state()"""


# In units of length a second: no bounce below the first in e v, none faster than the second.
_THRESHOLD = 0.1
_CAP = 100.0


def units_per_metre(target: Target, e: float) -> float:
    """Number of DART's units of length in a metre, a power of ten.

    e: of the target. The unit is the smallest whose cap is at least half again the band's highest
    speed: DART bounces nothing slower than _THRESHOLD units a second (in e v), and nothing faster
    than _CAP.
    Raises SettingError for a band too wide to lie between the two, and for e = 0.
    """
    units = 10.0 ** math.floor(math.log10(_CAP / (1.5 * target.speed_max)))
    if e * target.speed_min * units <= _THRESHOLD:
        got = f"from {target.speed_min:.4g} m/s on"
        least = _THRESHOLD / (e * units) if e else math.inf  # m/s
        raise SettingError(
            "speeds", got, f"{least:.4g} m/s or more: DART bounces within a band of 1000 only"
        )
    return units


def restitution(target: Target) -> dict[str, Any]:
    """The best constant e, in a unit of length that keeps the band between threshold and cap."""
    e, _ = minimax_constant(target)
    return {
        "restitution": _coefficient(e),
        "units_per_metre": units_per_metre(target, e),
    }


_UNITS = (
    "Nothing bounces while e v is below 0.1 units of length a second; no rebound is faster than 100.",
    "So a scene in cm bounces from 1 mm/s to 1 m/s, a scene in metres from 0.1 m/s on.",
    "Scale all lengths of the scene to your unit, gravity too.",
    "Under gravity the rebound is e (v + g h): energy grows.",
    "The ball goes on bouncing at e g h/(1 - e), 0.12 m/s for e = 0.93 at 1 ms.",
    "It stops where that is below the threshold. `restitution-law` avoids it: it sets e v/(v + g h).",
)
_NATIVE = (
    stock(
        "dart",
        "DART with nothing set: a shape's restitution is 0 and nothing bounces.",
        "URDF, SDF and SKEL files cannot set restitution: set it in Python.",
        forms=("plane",),
    ),
    on_a_plane("dart", "restitution", Role.CONSTANT_E, restitution, one_step=True)(
        "DART's restitution: the best constant e, exact at any step and phase, in suitable units of length.",
        "Restitutions multiply: set the plate's to 1; its default is 0.",
        "DART's constraint force mixing of 1e-5 lowers e: set (1 + e)(1 + 1e-5) - 1.",
        "The highest e is 0.99998.",
        *_UNITS,
        "The bounce takes one step: contact force and contact time mean nothing.",
    ),
)
_HOOK = "Before each world.step(), call addExtForce, or setRestitutionCoeff on the ball's shape."


def _unit_of_law(target: Target) -> dict[str, Any]:
    return {"units_per_metre": units_per_metre(target, float(target.restitution(target.speed_min)))}


_LAWS = python_law_recipes(
    "dart", _NATIVE, _HOOK, force=5e-6, each_impact=1e-12, each_impact_options=_unit_of_law
)
RECIPES = (*_NATIVE, *_LAWS)
