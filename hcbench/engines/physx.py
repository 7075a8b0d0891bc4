"""PhysX behind the contract of an engine: a ball on a plane, by SAPIEN's Python bindings.

Options of a setting (all optional; none means as SAPIEN makes it):
    bounce_threshold (m/s), enable_tgs: of the scene's configuration, set before the system is made.
    restitution: e of the material of ball and plate, which PhysX averages.
    law: {"kind": "restitution", ...} for e(v) set before each impact, or {"kind": "force", ...} in
    place of
        the contact, as `hcbench.laws.contact_law.law_of` reads them.

SAPIEN keeps its configuration in globals of the process, so it is stepped in a process of its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, StrictBool

from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Recipe, Role, stock
from hcbench.recipes.target import Target, minimax_constant
from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import DescribesContact, Feature, Features
from hcbench.sim.scripted import ScriptedEngine, ScriptOptions
from hcbench.system.errors import SettingError
from hcbench.system.text import shortest
from hcbench.terms.fields import Finite

if TYPE_CHECKING:
    from hcbench.terms.scene import Scene


class PhysxOptions(ScriptOptions):
    """A setting's options, checked."""

    bounce_threshold: Annotated[Finite | None, Field(ge=0.0)] = None
    enable_tgs: StrictBool | None = None
    restitution: Annotated[Finite | None, Field(ge=0.0, le=1.0)] = None


_SOURCE = "PhysX SDK 5 documentation, Rigid Body Collision: Restitution"
_CAVEATS = (
    "PhysX averages the restitutions of both materials; SAPIEN's threshold of 2 m/s must be 0.",
)


class PhysxEngine(DescribesContact, ScriptedEngine[PhysxOptions]):
    """PhysX 5 behind SAPIEN."""

    name = "physx"
    title = "PhysX (SAPIEN)"
    backend = Backend("physx", "sapien", "3.0.3", "3.0.3")
    bits = 32
    own_process = True
    table = PhysxOptions
    features = Features(
        law=Feature(
            "an impulse by Newton's e in one step; a negative e is a spring, F = k x", _SOURCE
        ),
        exponent=Feature("none: rigid", _SOURCE),
        threshold=Feature(
            "bounce_threshold, 2 m/s in SAPIEN; set before the system is made, 0 is taken",
            "measured to 0.5 %",
        ),
        licence=Feature("MIT (SAPIEN), BSD-3-Clause (PhysX)", "its wheel"),
    )

    def lines(self, options: PhysxOptions, scene: Scene) -> str:
        """Lines of Python that configure PhysX, define the material or the law of a setting, and make
        a new scene for each launch.

        options: the setting's.
        scene: not used: its numbers are names that the lines find.
        Raises SettingError for a law beside a restitution.
        """
        if options.law is not None and options.restitution is not None:
            raise SettingError("physx option 'law'", "given with a restitution", "one of the two")
        config, material, hook = _parts(options)
        by_force = isinstance(options.law, HuntCrossley)
        return _LINES.format(
            config=config,
            material=material,
            hook=hook,
            shapes=", material=material" if material else "",
            filtered=_UNFILTERED if by_force else "",
            call="\n    before_step()" if hook else "",
        )

    def paste(self, options: PhysxOptions, timestep: str) -> str:
        """Configuration, material, and what to call before each step."""
        return "\n".join(filter(None, _parts(options)))

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """One contact in PhysX's parameters: its restitution, if it has an e, with caveats."""
        if contact.restitution is None:
            return Vocabulary(caveats=_CAVEATS)
        note = f"{contact.at}; on both materials"
        return Vocabulary(
            (SystemValue("PhysX", "restitution", (contact.restitution,), "", note),),
            caveats=_CAVEATS,
        )


def _parts(options: PhysxOptions) -> tuple[str, str, str]:
    """Lines of Python of a setting in three parts: of PhysX's configuration, of the material, "" for
    none, and of the function that acts before each step, "" for none.
    """
    given = options.model_dump(include={"bounce_threshold", "enable_tgs"}, exclude_none=True)
    arguments = ["gravity=np.array([0, 0, -gravity])"]
    arguments += [f"{name}={value}" for name, value in given.items()]
    config = ", ".join(arguments)
    material = ""
    hook = ""
    if isinstance(options.law, HuntCrossley):
        hook = _FORCE
    elif options.law is not None:
        hook = _EACH
        # The hook sets the material's e before each impact.
        material = _MATERIAL.format("0")
    elif options.restitution is not None:
        material = _MATERIAL.format(shortest(options.restitution))
    return _CONFIG.format(config), material, hook


_CONFIG = "sapien.physx.set_scene_config({})  # before the system is made"
_MATERIAL = (
    "material = sapien.physx.PhysxMaterial(0, 0, {})  # two frictions: write yours; e, averaged"
)
_UNFILTERED = """
    for shape in body.collision_shapes:  # nothing but the law acts
        shape.set_collision_groups([0, 0, 0, 0])"""
_LINES = """\
import numpy as np
import sapien

{config}
{material}

def place(height, velocity):
    global system, scene, body
    system = sapien.physx.PhysxCpuSystem()
    system.timestep = timestep
    scene = sapien.Scene([system])
    plate, ball = scene.create_actor_builder(), scene.create_actor_builder()
    plate.add_plane_collision(sapien.Pose(q=[0.70710678, 0, -0.70710678, 0]){shapes})  # normal x to z
    plate.build_static("plate")
    ball.add_sphere_collision(radius=R{shapes})
    body = ball.build("ball").find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
    body.mass, body.inertia = m, [inertia] * 3{filtered}
    body.entity.pose, body.linear_velocity = sapien.Pose([0, 0, height]), [0, 0, velocity]
    return state()

def state():
    return float(body.entity_pose.p[2]), float(body.linear_velocity[2])
{hook}
def step():{call}
    system.step()
    return state()"""
_FORCE = """
def force():
    z, v = state()
    return law(R - z, -v)

def before_step():
    body.add_force_at_point([0, 0, force()], body.entity_pose.p)
"""
_EACH = """
def before_step():
    z, v = state()
    speed = gravity * timestep - v  # what PhysX turns around
    if z - R < 2 * timestep * speed:  # else the step brings no touch
        material.restitution = e(speed)
"""


_SCENE = {"bounce_threshold": 0.0, "enable_tgs": True}
# Error of e by float32.
_WITHIN = 1.3e-6
# Range of e by float32 under a force law at 1e-5 s: a position at R has steps of 4 nm.
_SCATTER = 3e-3


def restitution(target: Target) -> dict[str, Any]:
    """PhysX's own restitution: the best constant e of the band, without a threshold."""
    e, _ = minimax_constant(target)
    return {**_SCENE, "restitution": e}


_NATIVE = (
    stock(
        "physx",
        "PhysX with SAPIEN's defaults: nothing bounces below 2 m/s.",
        "Above 2 m/s bodies bounce with e = 0.1, that of the default material.",
        forms=("plane",),
    ),
    Recipe(
        "physx",
        "restitution",
        Role.CONSTANT_E,
        restitution,
        "PhysX's restitution, bounce threshold 0, TGS solver: the best constant e, at any step and phase.",
        (
            "Set the threshold before the system is made: later edits of system.config do nothing.",
            "PhysX averages the materials of the two, which SAPIEN cannot change: set e on both.",
            "Use TGS: under PGS a restitution of 0.9 gives 0.77 ... 0.9, by the phase of the step.",
            "PhysX takes a restitution below 0 as the stiffness of a spring.",
            "Under gravity a body rebounds with e (v + g h), v its speed before the contact.",
            "The ball reverses above the plate, in the step in which it would touch: there is no force loop.",
            "float32, within metres of the origin: e is within 1.3e-6 at 10 µs ... 1/240 s, 0.003 at 1 µs.",
        ),
        one_step=True,
        forms=("plane",),
        within=_WITHIN,
    ),
)
RECIPES = (
    *_NATIVE,
    *python_law_recipes(
        "physx",
        _NATIVE,
        f"Call it before each step: PhysX has no callbacks. In float32, force laws vary e by {_SCATTER:g}.",
        force=_SCATTER,
        each_impact=_WITHIN,
        common=_SCENE,
    ),
)
