"""OpenSim behind the contract of an engine: a ball on a half space, by Simbody's contact forces.

Options of a setting (all optional; none means OpenSim's default):
    stiffness: K of F = K x^1.5 (1 + 1.5 c x'), N/m^1.5, of the pair: HuntCrossleyForce, with one
    set of
        parameters for both geometries, is given S = 2^1.5 K/((4/3) sqrt(R)). dissipation: c, s/m.
    accuracy: of the Manager's error control (RungeKuttaMerson), looked at once a step.
    law: {"kind": "force", ...} in place of the contact, as `hcbench.laws.contact_law.law_of` reads
    it.

OpenSim logs to stdout and into a file: it is run in a process of its own.
"""

from __future__ import annotations

from functools import partial
from textwrap import indent
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Recipe, Role, stock
from hcbench.recipes.target import Target
from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import DescribesContact, Feature, Features
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.scripted import ScriptedEngine, ScriptOptions
from hcbench.system.errors import SettingError
from hcbench.system.text import shortest
from hcbench.terms.fields import Finite
from hcbench.terms.impact import Status

if TYPE_CHECKING:
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

NotNegative = Annotated[Finite | None, Field(ge=0.0)]


class OpensimOptions(ScriptOptions):
    """A setting's options, checked."""

    stiffness: NotNegative = None
    dissipation: NotNegative = None
    accuracy: Annotated[Finite | None, Field(gt=0.0, lt=1.0)] = None


_SOURCE = "Simbody, HuntCrossleyForce.cpp"
_CAVEAT = "OpenSim's HuntCrossleyForce is the law. At its default accuracy, 1e-3, e is wrong by 0.2 or more."


class OpensimEngine(DescribesContact, ScriptedEngine[OpensimOptions]):
    """OpenSim, whose dynamics are Simbody's."""

    name = "opensim"
    title = "OpenSim (Simbody)"
    backend = Backend("opensim", "opensim", "4.6", "4.6")
    own_process = True
    laws = (HuntCrossley,)
    # Its texts set no friction.
    keeps_friction = True
    table = OpensimOptions
    features = Features(
        law=Feature(
            "Hunt-Crossley with Hertz, as the paper: F = k x^1.5 (1 + 1.5 c x'), c = α", _SOURCE
        ),
        exponent=Feature("1.5", _SOURCE),
        threshold=Feature("none", "measured down to 10 µm/s"),
        licence=Feature("Apache-2.0", "its wheel"),
        energy=Feature(
            "e up to 1.008 at its own accuracy of 1e-3: real energy", "measured without gravity"
        ),
    )

    def lines(self, options: OpensimOptions, scene: Scene) -> str:
        """Lines of Python that build a model with the contact or the law of a setting, and a Manager
        that integrates it.

        options: the setting's.
        scene: not used: its numbers are names that the lines find.
        """
        contact, integrator = _parts(options)
        return _LINES.format(
            contact=contact,
            integrator=indent(integrator, "    "),
            force="" if options.law else _READ,
        )

    def paste(self, options: OpensimOptions, timestep: str) -> str:
        """Contact or law, and integrator."""
        return "\n".join(filter(None, _parts(options)))

    def speed_reading(self, setting: Setting) -> SpeedReading:
        """OpenSim's speeds are those at the touch plane; its flights are exact."""
        return SpeedReading.TOUCH_PLANE_EXACT_FLIGHT

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """OpenSim's dissipation of a contact."""
        note = "c = α, of HuntCrossleyForce; with an accuracy of 1e-9 or less"
        return Vocabulary(
            (SystemValue("OpenSim", "dissipation", (contact.alpha,), "s/m", note),),
            caveats=(_CAVEAT,),
        )


def _parts(options: OpensimOptions) -> tuple[str, str]:
    """Lines of Python of a setting in two parts: of the contact or the law, and of the integrator's
    accuracy, "" for OpenSim's default.
    """
    law = options.law
    if law is None:
        numbers = ""
        if options.stiffness is not None:
            numbers += _STIFFNESS.format(shortest(options.stiffness))
        if options.dissipation is not None:
            numbers += _DISSIPATION.format(shortest(options.dissipation))
        contact = _CONTACT.format(numbers)
    else:
        assert isinstance(law, HuntCrossley)
        contact = _LAW.format(
            k=shortest(law.stiffness), n=shortest(law.exponent), a=shortest(1.5 * law.alpha)
        )
    integrator = ""
    if options.accuracy is not None:
        integrator = f"manager.setIntegratorAccuracy({shortest(options.accuracy)})"
    return contact, integrator


_CONTACT = """\
model.addContactGeometry(osim.ContactSphere(R, osim.Vec3(0), ball, "sphere"))
upwards = osim.Vec3(0, 0, -math.pi / 2)  # the half space's normal is -x of its frame
model.addContactGeometry(osim.ContactHalfSpace(osim.Vec3(0), upwards, model.getGround(), "plate"))
contact = osim.HuntCrossleyForce()
contact.addGeometry("sphere")
contact.addGeometry("plate"){}
model.addForce(contact)"""
_STIFFNESS = """
contact.setStiffness(2**1.5 * {} / (4 / 3 * math.sqrt(R)))  # of the two, so after their names"""
_DISSIPATION = """
contact.setDissipation({})"""
_LAW = """\
push = "{k}*max(0,%r-q)^{n}*max(0,1-{a}*qdot)" % R  # q: the coordinate, the centre's height
model.addForce(osim.ExpressionBasedCoordinateForce("height", push))

def force():
    return law(R - height.getValue(state), -height.getSpeedValue(state)) or None"""
_LINES = """\
import math

import opensim as osim

osim.Logger.setLevelString("Off")  # else 12 lines a step, and a file
osim.Logger.removeFileSink()
model = osim.Model()
model.setGravity(osim.Vec3(0, -gravity, 0))
ball = osim.Body("ball", m, osim.Vec3(0), osim.Inertia(inertia, inertia, inertia))
model.addBody(ball)
turn = osim.Vec3(0, 0, math.pi / 2)  # a slider moves along x of its frame
slider = osim.SliderJoint("slider", model.getGround(), osim.Vec3(0), turn, ball, osim.Vec3(0), turn)
height = slider.updCoordinate()
height.setName("height")
model.addJoint(slider)
{contact}
model.finalizeConnections()
origin = model.initSystem()
height = model.getCoordinateSet().get(0)

def place(z, v):
    global state, manager, steps
    steps, state = 0, osim.State(origin)
    height.setValue(state, z)
    height.setSpeedValue(state, v)
    manager = osim.Manager(model)
    manager.setWriteToStorage(False)
    manager.setPerformAnalyses(False)
{integrator}
    manager.initialize(state)
    return z, v

def step():
    global state, steps
    steps += 1
    state = manager.integrate(steps * timestep)
    return height.getValue(state), height.getSpeedValue(state)
{force}"""
_READ = """
def force():
    if height.getValue(state) > R:
        return None
    model.realizeDynamics(state)
    return contact.getRecordValues(state).get(1) or None  # on the ball: x, y, z ..."""


# At this accuracy e is within 5e-9; at OpenSim's own, 1e-3, it is wrong by 0.2 or more.
_ACCURACY = 1e-11
# The one exponent of Simbody's contact.
_HERTZ = 1.5


def stock_accuracy(target: Target) -> dict[str, Any]:
    """Options of a setting with OpenSim's own accuracy: the law's k, and α as Simbody's dissipation,
    which is the same number.

    Raises SettingError for an exponent other than 1.5, which Simbody's contact does not have.
    """
    law = target.law
    if law.exponent != _HERTZ:
        given = f"n = {law.exponent:g} in opensim"
        advice = "The plug-in `hunt-crossley` has any"
        raise SettingError("exponent", given, "n = 1.5 for HuntCrossleyForce", advice)
    return {"stiffness": law.stiffness, "dissipation": law.alpha}


def hunt_crossley_force(target: Target) -> dict[str, Any]:
    """Set the law as OpenSim's force, under error control that is tight enough for e."""
    return {**stock_accuracy(target), "accuracy": _ACCURACY}


_ON_A_PLANE = partial(Recipe, "opensim", forms=("plane",), kinds=("law",))
_SHARED = "Both geometries share one set of numbers: call addGeometry for both, then set them on the force."
_NATIVE = (
    stock(
        "opensim",
        "OpenSim with nothing set: the force has stiffness 0, and the state becomes NaN without a warning.",
        forms=("plane",),
        ends=Status.DIVERGED,
    ),
    _ON_A_PLANE(
        "force",
        Role.LAW_AND_LOOP,
        hunt_crossley_force,
        "HuntCrossleyForce with c = α and accuracy 1e-11: the law, force loop included, at any step.",
        (
            "Its dissipation c is α itself, where Drake's d is 1.5 α.",
            "The step only sets how often you read the state; the integrator takes smaller ones.",
            "e is within 5e-9. At accuracy 1e-5 it is wrong by 0.0024, at 1e-7 by 5e-5, at 1e-9 by 3e-7.",
            "Coarse fixed steps gain energy.",
            _SHARED,
        ),
        within=1e-8,
    ),
    _ON_A_PLANE(
        "stock-accuracy",
        Role.FALLING_E,
        stock_accuracy,
        "HuntCrossleyForce with c = α at OpenSim's default accuracy, 1e-3: e wrong by 0.2, or energy gained.",
        (
            "Launched at 1 in/s from 1 mm and read once a millisecond, a ball leaves 2.9 times as fast.",
            "Frequent calls of integrate() shorten its steps and hide the error: 0.001 at 20 µs.",
            _SHARED,
        ),
        by_auto=False,
    ),
)
RECIPES = (
    *_NATIVE,
    *python_law_recipes(
        "opensim",
        _NATIVE,
        "Uses an ExpressionBasedCoordinateForce, for any exponent: Python cannot define a Force.",
        force=1e-8,
        common={"accuracy": _ACCURACY},
    ),
)
