"""Drake behind the contract of an engine: a ball on a half space, by point contact."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field

from hcbench.engines.drake.opens_files import OpensFiles
from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Role, on_a_plane, stock
from hcbench.recipes.target import Target, contact_time, implicit_spring_damper
from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import DescribesContact, Feature, Features
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.scripted import ScriptedEngine, ScriptOptions
from hcbench.system.text import arguments, shortest
from hcbench.terms.fields import Finite
from hcbench.terms.scene import Scene
from hcbench.terms.setting import Setting

Positive = Annotated[Finite | None, Field(ge=0.0)]


class DrakeOptions(ScriptOptions):
    """A setting's options: none of them means a discrete plant with nothing set.

    plant: a continuous one, of an accuracy, is only looked at in the setting's steps.
    point_stiffness (N/m), dissipation (s/m), relaxation_time (s): of each body.
    """

    plant: Literal["continuous", "discrete"] = "discrete"
    accuracy: Annotated[Finite, Field(gt=0.0, lt=1.0)] = 1e-4
    approximation: Literal["lagged", "similar", "sap"] = "lagged"
    point_stiffness: Positive = None
    dissipation: Positive = None
    relaxation_time: Positive = None


_DOCS = "Drake documentation, Modeling Compliant Contact"
_CAVEATS = (
    "Drake's d is 1.5 α, Simbody's c is α: a number copied from one to the other is wrong by half.",
    "Simbody raises x to 3/2, Drake to 1; e is the same: it depends on α v, not on k or n.",
    "Drake's discrete plant multiplies e by exp(-π ω h/2), ω² = k/m; `sap` ignores d.",
)


class DrakeEngine(DescribesContact, OpensFiles, ScriptedEngine[DrakeOptions]):
    """Drake's MultibodyPlant behind pydrake; it opens URDF, SDF and MJCF files, too."""

    name = "drake"
    title = "Drake"
    backend = Backend("drake", "drake", "1.51", "1.58")
    laws = (HuntCrossley,)
    table = DrakeOptions
    features = Features(
        law=Feature(
            "F = k x (1 + d v), clipped at 0, d = 1.5 α; a discrete plant by implicit Euler", _DOCS
        ),
        exponent=Feature("1 (point contact); about 2 (hydroelastic)", _DOCS),
        threshold=Feature("none", "measured down to 10 µm/s"),
        licence=Feature("BSD-3-Clause", "its wheel"),
    )

    def lines(self, options: DrakeOptions, scene: Scene) -> str:
        """Lines of Python that build a plant with the contact or the law of a setting, and a
        Simulator that steps it.

        options: the setting's.
        scene: not used: its numbers are names that the lines find.
        """
        plant, contact, integrator = _parts(options, "timestep")
        before = ""
        after = ""
        force = ""
        if options.law:
            after = _LAW
        else:
            before = f"{contact}\n{_SHAPES}"
            # Results of a discrete plant are of two times, so its force is not read.
            if options.plant == "continuous":
                force = _FORCE
        return _LINES.format(
            plant=plant, before=before, after=after, integrator=integrator, force=force
        )

    def paste(self, options: DrakeOptions, timestep: str) -> str:
        """Plant, properties or law, and integrator."""
        plant, contact, integrator = _parts(options, timestep)
        return "\n".join(filter(None, (plant, _LAW if options.law else contact, integrator)))

    def speed_reading(self, setting: Setting) -> SpeedReading:
        """Drake's speeds are those at the touch plane: all of its contacts act from there on."""
        exact = self.read(setting).plant == "continuous"
        return SpeedReading.TOUCH_PLANE_EXACT_FLIGHT if exact else SpeedReading.TOUCH_PLANE

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """One contact in Drake's parameters: the dissipation that stands for its α, with caveats."""
        note = "d = 1.5 α, on both bodies; continuous plants only"
        name = "hunt_crossley_dissipation"
        value = SystemValue("Drake", name, (1.5 * contact.alpha,), "s/m", note)
        return Vocabulary(
            (value,),
            caveats=_CAVEATS,
        )


def _parts(options: DrakeOptions, timestep: str) -> tuple[str, str, str]:
    """Lines of Python in three parts: of the plant, of the properties of both bodies, and of the
    integrator, "" for a discrete plant.

    timestep: of a discrete plant, s, as a Python expression.
    """
    properties = "properties = drake.ProximityProperties()  # of both bodies"
    if given := options.model_dump(include={"dissipation", "point_stiffness"}, exclude_none=True):
        friction = f"friction={_FRICTION}, properties=properties"
        properties += f"\ndrake.AddContactMaterial({arguments(given)}, {friction})"
    if (time := options.relaxation_time) is not None:
        properties += f'\nproperties.AddProperty("material", "relaxation_time", {shortest(time)})'
    if options.plant == "continuous":
        return _PLANT.format("0.0"), properties, _INTEGRATOR.format(options.accuracy)
    name = f"drake.DiscreteContactApproximation.k{options.approximation.capitalize()}"
    plant = f"{_PLANT.format(timestep)}\nplant.set_discrete_contact_approximation({name})"
    return plant, properties, ""


# Drake's own, of a shape that states none: static and sliding.
_FRICTION = "drake.CoulombFriction(0.5, 0.5)"
_PLANT = "plant, _ = drake.AddMultibodyPlantSceneGraph(builder, time_step={})"
_INTEGRATOR = """\
drake.ResetIntegratorFromFlags(simulator, "runge_kutta3", 0.001)  # scheme, largest step
simulator.get_mutable_integrator().set_target_accuracy({})"""
_LINES = """\
import logging
import pydrake.all as drake
logging.getLogger("drake").setLevel(logging.ERROR)  # it warns of half spaces in deformable contact
builder = drake.DiagramBuilder()
{plant}
turning = drake.RotationalInertia(*[inertia] * 3)
ball = plant.AddRigidBody("ball", drake.SpatialInertia.MakeFromCentralInertia(m, [0, 0, 0], turning))
{before}
plant.mutable_gravity_field().set_gravity_vector([0, 0, -gravity])
plant.Finalize()
{after}
simulator = drake.Simulator(builder.Build())
{integrator}
root = simulator.get_mutable_context()
context = plant.GetMyMutableContextFromRoot(root)
def place(height, velocity):
    root.SetTime(0.0)
    plant.SetFreeBodyPose(context, ball, drake.RigidTransform([0, 0, height]))
    plant.SetFreeBodySpatialVelocity(context, ball, drake.SpatialVelocity([0, 0, 0], [0, 0, velocity]))
    simulator.Initialize()
    return height, velocity
def step():
    simulator.AdvanceTo((round(root.get_time() / timestep) + 1) * timestep)
    return plant.GetPositionsAndVelocities(context)[[6, 12]]  # of quaternion, x y z, spin, velocity
{force}"""
_SHAPES = """\
for body, shape in ((ball, drake.Sphere(R)), (plant.world_body(), drake.HalfSpace())):
    plant.RegisterCollisionGeometry(body, drake.RigidTransform(), shape, "shape", properties)"""
_LAW = """\
class Law(drake.LeafSystem):  # pushes the ball, of radius R, off the plane z = 0
    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("state", plant.num_multibody_states())
        forces = drake.Value[list[drake.ExternallyAppliedSpatialForce_[float]]]
        self.DeclareAbstractOutputPort("force", forces, self.push)
    def push(self, context, output):
        state = self.get_input_port(0).Eval(context)
        applied = drake.ExternallyAppliedSpatialForce()
        applied.body_index, applied.p_BoBq_B = ball.index(), [0, 0, 0]
        applied.F_Bq_W = drake.SpatialForce([0, 0, 0], [0, 0, law(R - state[6], -state[12])])
        output.set_value([applied])
system = builder.AddSystem(Law())  # after plant.Finalize()
builder.Connect(plant.get_state_output_port(), system.get_input_port(0))
builder.Connect(system.get_output_port(0), plant.get_applied_spatial_force_input_port())"""
_FORCE = """\
def force():  # of the present state; contact_force() is that on the second body
    if plant.GetPositions(context)[6] >= R:
        return None
    results = plant.get_contact_results_output_port().Eval(context)
    contacts = range(results.num_point_pair_contacts())
    return sum(abs(results.point_pair_contact_info(i).contact_force()[2]) for i in contacts)"""


# Share of e that the discrete plant's own damping may take, where that is not too soft
_DAMPED = 2e-3
# The band's highest speed may press the spring as deep as this for it, m.
_DEEPEST = 1e-3


def _hertz_stiffness(target: Target) -> float:
    """Stiffness, N/m, of the linear spring that goes as deep as the law's spring without damping, at
    the geometric mean of the target's speeds.
    """
    n = target.law.exponent
    # J: the product of the two speeds is the square of their geometric mean.
    energy = 0.5 * target.mass * target.speed_min * target.speed_max
    # Where k xⁿ⁺¹/(n + 1) is that energy, m.
    deepest = ((n + 1.0) * energy / target.law.stiffness) ** (1.0 / (n + 1.0))
    return float(2.0 * energy / deepest**2)


def continuous(target: Target) -> dict[str, Any]:
    """Follow the law's e at any step, by an integrator with error control."""
    pair = {
        "point_stiffness": 2.0 * _hertz_stiffness(target),
        "dissipation": target.law.dissipation,
    }
    return {"plant": "continuous", "accuracy": 2e-11, **pair}


def discrete(target: Target) -> dict[str, Any]:
    """Options of a setting of a discrete plant: a spring soft enough that the step takes little of e,
    with the law's dissipation.

    Implicit Euler multiplies e by exp(-π ω h/2), ω² = k/m. Gravity, which a contact of the duration
    π/ω feels, takes about π α g/ω off e: the two are even at ω² = 2 α g/h.
    """
    h = target.timestep
    law = target.law
    # ω, 1/s: at which the step takes _DAMPED of e; at which the fastest impact goes _DEEPEST; and at
    # which step and gravity take as much.
    by_step = 2.0 * _DAMPED / (math.pi * h)
    by_depth = target.speed_max / _DEEPEST
    under_gravity = math.sqrt(2.0 * law.alpha * target.gravity / h)
    omega = max(by_step, by_depth, under_gravity)
    # No stiffer than the law; the two bodies' springs are in series, so each is twice as stiff.
    k = min(target.mass * omega**2, _hertz_stiffness(target))
    return {"approximation": "similar", "point_stiffness": 2.0 * k, "dissipation": law.dissipation}


def spring_damper(target: Target) -> dict[str, Any]:
    """One e for all speeds: `sap` damps by c = k τ, τ the sum of the relaxation times."""
    stiffness, damping = implicit_spring_damper(target, contact_time(target), "continuous")
    pair = {"point_stiffness": 2.0 * stiffness, "relaxation_time": 0.5 * damping / stiffness}
    return {"approximation": "sap", **pair}


_HALF = "The pair has half of the point_stiffness of the two bodies, and their dissipation."
_NATIVE = (
    stock(
        "drake",
        "Drake with nothing set: a discrete plant with almost no bounce, e < 0.4 at 1 in/s, < 0.04 at 20.",
        "The default dissipation of 50 s/m means α = 33 s/m, a hundred times that of steel.",
        "The default point_stiffness is 1e6 N/m.",
        forms=("plane",),
    ),
    on_a_plane("drake", "continuous", Role.LAW, continuous, within=1e-7, kinds=("law",))(
        "Continuous plant, d = 1.5 α: the law's e at any step, with a force linear in penetration.",
        "The plant is continuous (time_step=0): the step only sets how often you read the state.",
        "At Drake's default accuracy of 1e-4, e is wrong by up to 0.03.",
        "An accuracy a hundred times finer takes four times as long.",
        "Coarse fixed steps gain energy: e = 2 at 100 µs with runge_kutta3.",
        _HALF,
    ),
    on_a_plane("drake", "discrete", Role.FALLING_E, discrete, within=2.1e-3, kinds=("law",))(
        "Discrete plant, d = 1.5 α, soft spring: the law's e, of which the implicit step takes 0.2 %.",
        "A discrete plant multiplies e by exp(-π ω h/2), ω² = k/m. No d above 0 makes up for it.",
        "The contact is soft, up to 1 mm deep and milliseconds long, so gravity acts within it.",
        "Above 1 µs the spring would have to be softer than hcbench allows: e is too low there.",
        "`lagged`, the default, gives the same e; `sap` ignores dissipation.",
        _HALF,
    ),
    on_a_plane("drake", "spring-damper", Role.CONSTANT_E, spring_damper)(
        "Discrete plant, `sap`: the best constant e and the law's contact time at the band's middle speed.",
        "The relaxation times of both bodies add up. With Drake's default of 0.1 s each, nothing bounces.",
        "The implicit step adds damping. At coarse steps hcbench softens the spring to keep it small.",
        _HALF,
    ),
)
_HOOK = (
    "A LeafSystem turns the plant's state into an applied spatial force; add no collision geometry."
)
_CONTINUOUS = {"plant": "continuous", "accuracy": 1e-8}
RECIPES = (*_NATIVE, *python_law_recipes("drake", _NATIVE, _HOOK, force=1e-6, common=_CONTINUOUS))
