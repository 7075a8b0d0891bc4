"""Exudyn behind the contract of an engine: a ball on a large sphere or in the true cup, by sphere contact."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.laws.force import HuntCrossley
from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import DescribesContact, Feature, Features
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.scripted import ScriptedEngine, ScriptOptions
from hcbench.system.text import arguments, shortest
from hcbench.terms.fields import Finite

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# m, of the sphere that stands for a plane: on its axis the gap is that of a plane
_PLATE_RADIUS = 10.0
Number = Annotated[Finite | None, Field(ge=0.0)]


class ExudynOptions(ScriptOptions):
    """A setting's options, in Exudyn's words: none of them means a contact with nothing set.

    solver: of exudyn.DynamicSolverType. The others: of ObjectContactSphereSphere, SI.
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
    """Exudyn's ObjectContactSphereSphere."""

    name = "exudyn"
    title = "Exudyn"
    backend = Backend("exudyn", "exudyn", "1.13.6", "1.13.6")
    laws = (HuntCrossley,)
    table = ExudynOptions
    features = Features(
        law=Feature("F = k x^n (1 + 1.5 (1 - e)/max(v_in, V) v): the law if V is above all speeds", _DOCS),
        exponent=Feature("any", _DOCS),
        threshold=Feature("none", "measured down to 0.1 mm/s"),
        licence=Feature("its own text with the clauses of BSD-3-Clause", "its wheel"),
    )

    def forms(self, setting: Setting) -> Sequence[str]:
        """The law from Python knows heights only."""
        return ("plane",) if "law" in setting.options else ("plane", "cup")

    def lines(self, options: ExudynOptions, scene: Scene) -> str:
        """A mass point, its contact or the law, and a solver that takes one step at a time."""
        cup = scene.form == "cup"
        centre = -scene.plate_radius if cup else -_PLATE_RADIUS
        where = {"centre": shortest(centre), "radius": shortest(abs(centre)), "hollow": cup}
        contact = _LAW if options.law else _CONTACT.format(numbers=_numbers(options), **where)
        return _LINES.format(
            contact=contact,
            settings=_SETTINGS,
            solver=_SOLVER.format(options.solver),
            data=int(options.law is None),
            force="" if options.law else _FORCE,
        )

    def paste(self, options: ExudynOptions, timestep: str) -> str:
        """Return the lines for a user's script: numbers of the contact, or the law, and settings of
        the solver.
        """
        contact = _LAW if options.law else _numbers(options)
        return "\n".join((contact, _SETTINGS, _SOLVER.format(options.solver)))

    def speed_reading(self, setting: Setting) -> SpeedReading:
        """Exudyn's speeds are those at the touch plane, by what its solver keeps in free flight."""
        return SpeedReading.TOUCH_PLANE_EXACT_FLIGHT

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """e and V of impactModel 1, the law at all speeds up to V: here the one given."""
        v, alpha = contact.speed, contact.alpha
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
