"""Exudyn behind the contract of an engine: a ball on a large sphere or in
the true cup, by sphere contact.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Recipe, Role, stock
from hcbench.recipes.target import Target, minimax_constant, resolvable_law
from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import DescribesContact, Feature, Features
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.scripted import ScriptedEngine, ScriptOptions
from hcbench.system.errors import SettingError
from hcbench.system.text import arguments, shortest
from hcbench.terms.fields import Finite
from hcbench.terms.impact import Status
from hcbench.terms.resolution import STEPS_OF_A_SOFTENED_EXPLICIT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# Radius of the sphere that stands for a plane, m: on its axis the gap is that of a plane.
_PLATE_RADIUS = 10.0
Number = Annotated[Finite | None, Field(ge=0.0)]


class ExudynOptions(ScriptOptions):
    """A setting's options, in Exudyn's words: none of them means a contact with nothing set.

    solver: of exudyn.DynamicSolverType.
    The others: of ObjectContactSphereSphere, SI.
    """

    solver: Literal["GeneralizedAlpha", "RK44"] = "GeneralizedAlpha"
    contactStiffness: Number = None
    contactStiffnessExponent: Number = None
    contactDamping: Number = None
    impactModel: Literal[0, 1, 2] | None = None
    restitutionCoefficient: Annotated[Finite | None, Field(gt=0.0, le=1.0)] = None
    minimumImpactVelocity: Number = None


_DOCS = "Exudyn documentation, ObjectContactSphereSphere"


class ExudynEngine(DescribesContact, ScriptedEngine[ExudynOptions]):
    """The engine Exudyn, with its ObjectContactSphereSphere."""

    name = "exudyn"
    title = "Exudyn"
    backend = Backend("exudyn", "exudyn", "1.13.6", "1.13.6")
    laws = (HuntCrossley,)
    # Its texts set no friction.
    keeps_friction = True
    table = ExudynOptions
    features = Features(
        law=Feature(
            "F = k x^n (1 + 1.5 (1 - e)/max(v_in, V) v): the law if V is above all speeds", _DOCS
        ),
        exponent=Feature("any", _DOCS),
        threshold=Feature("none", "measured down to 0.1 mm/s"),
        licence=Feature("its own text with the clauses of BSD-3-Clause", "its wheel"),
    )

    def forms(self, setting: Setting) -> Sequence[str]:
        """The law from Python knows heights only."""
        return ("plane",) if "law" in setting.options else ("plane", "cup")

    def lines(self, options: ExudynOptions, scene: Scene) -> str:
        """Lines of Python that build a mass point with the contact or the law of a setting, and a
        solver of one step a call.

        options: the setting's.
        scene: its form and radius of the plate, for the sphere or cup.
        """
        # Height of the plate's centre over its surface, m: a cup's radius is below 0, so its centre
        # is above; a plane is a large sphere below.
        is_cup = scene.form == "cup"
        centre = -scene.plate_radius if is_cup else -_PLATE_RADIUS
        where = {"centre": shortest(centre), "radius": shortest(abs(centre)), "hollow": is_cup}
        contact = _LAW if options.law else _CONTACT.format(numbers=_numbers(options), **where)
        return _LINES.format(
            contact=contact,
            settings=_SETTINGS,
            solver=_SOLVER.format(options.solver),
            data=int(options.law is None),
            force="" if options.law else _FORCE,
        )

    def paste(self, options: ExudynOptions, timestep: str) -> str:
        """Return the lines for a user's script: numbers of the contact, or the
        law, and settings of the solver.
        """
        contact = _LAW if options.law else _numbers(options)
        return "\n".join((contact, _SETTINGS, _SOLVER.format(options.solver)))

    def speed_reading(self, setting: Setting) -> SpeedReading:
        """Exudyn's speeds are those at the touch plane, by what its solver keeps in free flight."""
        return SpeedReading.TOUCH_PLANE_EXACT_FLIGHT

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """One contact in Exudyn's parameters: e and V of its impactModel 1, which is the law at all
        speeds up to V, here the contact's speed; nothing without a speed, or where the law has no
        bounce there.
        """
        v = contact.speed
        alpha = contact.alpha
        if v is None or alpha * v >= 1.0:
            return Vocabulary()
        note = f"impactModel 1: the law up to {v:.6g} m/s, with the law's contactStiffness and its exponent"
        name = "restitutionCoefficient, minimumImpactVelocity"
        return Vocabulary((SystemValue("Exudyn", name, (1.0 - alpha * v, v), "1, m/s", note),))


def _numbers(options: ExudynOptions) -> str:
    given = options.model_dump(exclude={"law", "solver"}, exclude_none=True)
    return f"numbers = dict({arguments(given)})  # of ObjectContactSphereSphere"


_SOLVER = "solver = exudyn.DynamicSolverType.{}"
_FORCE = """\
def force():
    if states.GetODE2Coordinates()[2] >= 0:
        return None
    return mbs.GetObjectOutput(contact, exudyn.OutputVariableType.Force)[2]"""
_SETTINGS = """\
settings = exudyn.SimulationSettings()
settings.timeIntegration.minimumStepSize = 1e-16  # the default, 1e-8, ends one impact in five at parting
settings.timeIntegration.adaptiveStep = False
settings.timeIntegration.discontinuous.useRecommendedStepSize = False"""
_CONTACT = """\
{numbers}
on_plate = mbs.AddMarker(MarkerBodyRigid(bodyNumber=ground, localPosition=[0, 0, {centre}]))
touch = mbs.AddNode(NodeGenericData(initialCoordinates=[0.1, 0, 0, 0], numberOfDataCoordinates=4))
contact = mbs.AddObject(ObjectContactSphereSphere(
    markerNumbers=[on_ball, on_plate], nodeNumber=touch, spheresRadii=[R, {radius}],
    isHollowSphere1={hollow}, **numbers,
))"""
_LAW = """\
def push(mbs, t, item, offset, velocity, stiffness, damping, force):
    return -law(-offset, -velocity)
height = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=2))
rest = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
contact = mbs.AddObject(CoordinateSpringDamper(markerNumbers=[rest, height], springForceUserFunction=push))"""
_LINES = """\
import exudyn
from exudyn.itemInterface import (
    CoordinateSpringDamper, Force, MarkerBodyPosition, MarkerBodyRigid, MarkerNodeCoordinate, MassPoint,
    NodeGenericData, NodePoint, NodePointGround, ObjectContactSphereSphere, ObjectGround,
)

container = exudyn.SystemContainer()
mbs = container.AddSystem()
ground = mbs.AddObject(ObjectGround())
node = mbs.AddNode(NodePoint(referenceCoordinates=[0, 0, R]))  # where the ball touches
ball = mbs.AddObject(MassPoint(mass=m, nodeNumber=node))
on_ball = mbs.AddMarker(MarkerBodyPosition(bodyNumber=ball))
mbs.AddLoad(Force(markerNumber=on_ball, loadVector=[0, 0, -gravity * m]))
{contact}
mbs.Assemble()
{settings}
settings.solution.file.write = False
settings.timeIntegration.numberOfSteps = 1
settings.timeIntegration.endTime = timestep
{solver}
states, initial = mbs.systemData, exudyn.ConfigurationType.Initial
def place(height, velocity):
    states.SetODE2Coordinates([0, 0, height - R], initial)
    states.SetODE2Coordinates_t([0, 0, velocity], initial)
    states.SetODE2Coordinates_tt([0, 0, -gravity], initial)
    states.SetDataCoordinates([0.1, 0, 0, 0][: 4 * {data}], initial)
    return height, velocity
def step():
    mbs.SolveDynamic(settings, solverType=solver, updateInitialValues=True)
    return R + states.GetODE2Coordinates()[2], states.GetODE2Coordinates_t()[2]
{force}"""


def _contact(target: Target, model: int, e: float, **more: float) -> dict[str, Any]:
    law = resolvable_law(target, STEPS_OF_A_SOFTENED_EXPLICIT)
    spring = {"contactStiffness": law.stiffness, "contactStiffnessExponent": law.exponent}
    return {"solver": "RK44", **spring, "impactModel": model, "restitutionCoefficient": e, **more}


def contact_law(target: Target) -> dict[str, Any]:
    """Options of a setting: the law of 1975 itself, which Exudyn's contact has at all speeds up to a
    speed V, by its restitution coefficient 1 - α V.

    V is twice the band's highest speed, or halfway between that speed and 1/α where that is less.
    Raises SettingError for speeds from 1/α on, at which the law does not bounce in this form.
    """
    fastest = target.speed_max
    alpha = target.law.alpha
    # Exudyn's e is 1 - α V, which must be above 0.
    if alpha * fastest >= 1.0:
        raise SettingError(
            "speeds", f"up to {fastest:.4g} m/s", f"below 1/α = {1.0 / alpha:.4g} m/s"
        )
    threshold = 2.0 * fastest if alpha * fastest < 1.0 / 3.0 else 0.5 * (fastest + 1.0 / alpha)
    return _contact(target, model=1, e=1.0 - alpha * threshold, minimumImpactVelocity=threshold)


def restitution(target: Target) -> dict[str, Any]:
    """The best constant e."""
    e, _ = minimax_constant(target)
    return _contact(target, model=2, e=e, minimumImpactVelocity=0.0)


_STEPS = "Lower timeIntegration.minimumStepSize: its default, 1e-8, ends one impact in five with an error."
_GAIN = (
    "A contact of few steps gains energy: with 20 steps e is 0.007 too high.",
    "Below 10 steps a contact, hcbench softens the spring to 60.",
)
_NATIVE = (
    stock(
        "exudyn",
        "Exudyn with nothing set: contactStiffness is 0, and the ball falls through the plate silently.",
        ends=Status.DIVERGED,
    ),
    Recipe(
        "exudyn",
        "contact-law",
        Role.LAW_AND_LOOP,
        contact_law,
        "impactModel 1, minimumImpactVelocity V above all speeds, e = 1 - α V: the law, force loop included.",
        (
            "Impacts faster than V lose less energy than the law says: their α is (1 - e)/v.",
            "contactStiffness belongs to the pair: no two values are combined.",
            "A cup is modelled exactly, as a hollow sphere.",
            _STEPS,
            *_GAIN,
        ),
        kinds=("law",),
        within=3e-5,
    ),
    Recipe(
        "exudyn",
        "restitution",
        Role.CONSTANT_E,
        restitution,
        "impactModel 2: the best constant e, with the stiffness and exponent of the law.",
        (
            "e is within 2e-5 of the number that you set from 0.9 up; 0.3 gives 0.3042.",
            "impactModel 0 ignores restitutionCoefficient.",
            _STEPS,
            *_GAIN,
        ),
        within=5e-5,
    ),
)
_HOOK = (
    "Runs as springForceUserFunction of a CoordinateSpringDamper between the ball and the ground."
)
RECIPES = (
    *_NATIVE,
    *python_law_recipes("exudyn", _NATIVE, _HOOK, force=5e-6, common={"solver": "RK44"}),
)
