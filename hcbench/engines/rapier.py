"""Rapier behind the contract of an engine: a ball on a half space, by rigid contact."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.laws.restitution import Restitution
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Role, on_a_plane, stock
from hcbench.recipes.target import Target, minimax_constant
from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import DescribesContact, Feature, Features
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.scripted import ScriptedEngine, ScriptOptions
from hcbench.system.text import shortest
from hcbench.terms.fields import Finite

if TYPE_CHECKING:
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting


class RapierOptions(ScriptOptions):
    """A setting's options: none of them means colliders with nothing set.

    restitution: of both colliders, whose average it uses.
    """

    restitution: Annotated[Finite | None, Field(ge=0.0, le=1.0)] = None


class RapierEngine(DescribesContact, ScriptedEngine[RapierOptions]):
    """Rapier 3D behind rapier3d; its numbers have 32 bits."""

    name = "rapier"
    title = "Rapier"
    backend = Backend("rapier", "rapier3d", "0.36", "0.36")
    bits = 32
    laws = (Restitution,)
    # Its texts set no friction.
    keeps_friction = True
    table = RapierOptions
    features = Features(
        law=Feature("Newton's e in one step: average of both colliders", "measured, to 3e-7"),
        exponent=Feature("none: rigid", "one step, of any length"),
        threshold=Feature(
            "none; under gravity what rebounds below 1.3 g h stays",
            "measured; without gravity down to 0.1 mm/s",
        ),
        licence=Feature("Apache-2.0", "its wheel"),
    )

    def lines(self, options: RapierOptions, scene: Scene) -> str:
        """Lines of Python: bodies and colliders of a PhysicsWorld."""
        hook = _EACH.replace("\n", "\n    ") if options.law else "pass"
        return _LINES.format(e=_set(options) or "pass", hook=hook)

    def paste(self, options: RapierOptions, timestep: str) -> str:
        """Restitution of both colliders."""
        return _EACH if options.law else _set(options)

    def speed_reading(self, setting: Setting) -> SpeedReading:
        """Rapier's speeds are those at the touch plane: its solver divides the step into four."""
        return SpeedReading.TOUCH_PLANE_FOUR_SUBSTEPS

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """Rapier's restitution of a contact."""
        if contact.restitution is None:
            return Vocabulary()
        note = f"{contact.at}; on both colliders, whose average it uses"
        return Vocabulary((SystemValue("Rapier", "restitution", (contact.restitution,), "", note),))


def _set(options: RapierOptions) -> str:
    e = options.restitution
    return "" if e is None else _SET.format(shortest(e))


_SET = "plate.restitution = ball.restitution = {}"
_EACH = _SET.format("e(-body.linvel.z)")
_LINES = """\
import rapier3d as rapier

def place(height, velocity):
    global world, body, plate, ball
    world = rapier.PhysicsWorld(gravity=(0, 0, -gravity))
    world.integration_parameters.dt = timestep
    start = rapier.RigidBody.dynamic(translation=(0, 0, height), linvel=(0, 0, velocity))
    made, colliders = world.rigid_bodies.insert(start), world.colliders
    body = world.rigid_bodies[made]
    plate = colliders[colliders.insert(rapier.Collider.halfspace((0, 0, 1)))]
    sphere = rapier.Collider.ball(R, mass=m)
    ball = colliders[colliders.insert_with_parent(sphere, made, world.rigid_bodies)]
    {e}
    return body.translation.z, body.linvel.z
def step():
    {hook}
    world.step()
    return body.translation.z, body.linvel.z"""


def restitution(target: Target) -> dict[str, Any]:
    """The best constant e, on both colliders."""
    e, _ = minimax_constant(target)
    return {"restitution": e}


_NATIVE = (
    stock(
        "rapier",
        "Rapier with nothing set: restitution 0 and nothing bounces.",
        forms=("plane",),
    ),
    on_a_plane("rapier", "restitution", Role.CONSTANT_E, restitution, one_step=True, within=1e-6)(
        "Rapier's restitution: the best constant e, at any step and phase, to 32-bit rounding.",
        "Rapier averages the restitutions of both colliders by default: set e on both.",
        "Rapier has no speed threshold, and reverses the speed of the start of the step.",
        "Under gravity a rebound slower than 1.3 g h (5 cm/s at 1/240 s) is back within two steps and stays.",
        "Such a ball counts as at rest, with e = 0.",
        "In float32, a ball that moves less than half a rounding unit of its height a step does not move.",
        "The bounce takes one step: contact force and contact time mean nothing.",
    ),
)
_HOOK = "Before each world.step(), lines of Python set the restitution of both colliders."
RECIPES = (*_NATIVE, *python_law_recipes("rapier", _NATIVE, _HOOK, each_impact=1e-6))
