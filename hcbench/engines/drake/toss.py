"""Tosses in Drake, by a discrete plant with point contact: see `hcbench.sim.toss`."""

import importlib
import logging
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hcbench.sim.toss import (
    FRICTION,
    GRAVITY,
    MU,
    NOTHING,
    Body,
    ContactSetting,
    Parameter,
    Shape,
    Toss,
    as_body,
    as_integrated,
)
from hcbench.system.errors import foreign_errors
from hcbench.terms.impact import Floats

SPRING = "stiffness and dissipation"
_BOUNCE = Parameter("dissipation", (1.0, 5.0, 0.2))
SHAPES: frozenset[Shape] = frozenset({"box", "ellipsoid", "sphere"})
SETTINGS = (
    ContactSetting(NOTHING),
    ContactSetting(FRICTION, (MU,)),
    ContactSetting(SPRING, (Parameter("stiffness", (1e4, 1e5, 1e3)), _BOUNCE, MU)),
)


def simulate(
    body: Body,
    setting: ContactSetting,
    values: Sequence[float],
    timestep: float,
    tosses: Sequence[Toss],
) -> list[Floats]:
    """Simulate tosses of a body onto a plate in a discrete plant: states before the first step and
    after each, (steps + 1, 13), an array a toss: position, quaternion w x y z, velocity and spin in
    the world, SI.

    values: of the setting's parameters, SI, in its order.
    timestep: s.
    tosses: starts, each with its number of steps.
    Raises EngineFailed where Drake fails.
    """
    given = setting.named(values)
    with foreign_errors("drake"):
        drake: Any = importlib.import_module("pydrake.all")
        # It warns of half spaces in deformable contact.
        logging.getLogger("drake").setLevel(logging.ERROR)
        builder = drake.DiagramBuilder()
        plant, _ = drake.AddMultibodyPlantSceneGraph(builder, time_step=timestep)
        _add(drake, plant, body, setting, given)
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY])
        plant.Finalize()
        logger = drake.LogVectorOutput(plant.get_state_output_port(), builder, timestep)
        simulator = drake.Simulator(builder.Build())
        return [_simulate(drake, simulator, plant, logger, toss, timestep) for toss in tosses]


def _add(
    drake: Any, plant: Any, body: Body, setting: ContactSetting, given: Mapping[str, float]
) -> None:
    """Add body and plate with their contact to a plant.

    drake: the module pydrake.all.
    plant: changed.
    body: shape, mass and inertia of what is tossed.
    setting: kind of contact: a spring and a dissipation, or no more than friction.
    given: its parameters by name, SI.
    """
    turning = drake.RotationalInertia(*body.inertia)
    inertia = drake.SpatialInertia.MakeFromCentralInertia(body.mass, [0, 0, 0], turning)
    tossed = plant.AddRigidBody("body", inertia)
    # Functions: a body has half sizes for one of them alone.
    shapes = {
        "box": lambda: drake.Box(*(2.0 * half for half in body.half_sizes)),
        "sphere": lambda: drake.Sphere(body.half_sizes[0]),
        "ellipsoid": lambda: drake.Ellipsoid(*body.half_sizes),
    }
    material: dict[str, Any] = {}
    if setting.name == SPRING:
        # Two surfaces act in series, as springs do.
        material = {
            "point_stiffness": 2.0 * given["stiffness"],
            "dissipation": given["dissipation"],
        }
    if "friction" in given:
        material["friction"] = drake.CoulombFriction(given["friction"], given["friction"])
    for link, shape in ((tossed, shapes[body.shape]()), (plant.world_body(), drake.HalfSpace())):
        properties = drake.ProximityProperties()
        if material:
            drake.AddContactMaterial(**material, properties=properties)
        name = f"contact of {link.name()}"
        plant.RegisterCollisionGeometry(link, drake.RigidTransform(), shape, name, properties)


def _simulate(
    drake: Any, simulator: Any, plant: Any, logger: Any, toss: Toss, timestep: float
) -> Floats:
    """Simulate one toss: its states before the first step and after each, (steps + 1, 13): position,
    quaternion w x y z, velocity and spin, SI.

    simulator, plant, logger: Drake's, of one diagram; the logger keeps the plant's state at each
    step.
    timestep: s.
    Drake itself has the quaternion before the place, and the spin before the velocity.
    """
    context = simulator.get_mutable_context()
    context.SetTime(0.0)
    velocity = as_integrated(toss.velocity, timestep)
    state = np.concatenate([toss.quaternion, toss.position, toss.spin, velocity])
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), state)
    log = logger.FindMutableLog(context)
    log.Clear()
    simulator.Initialize()
    # A quarter of a step beyond the last one, so that rounding leaves out none.
    simulator.AdvanceTo((toss.steps + 0.25) * timestep)
    rows = log.data().T[: toss.steps + 1]
    quaternion, position, spin, velocity_at = np.split(rows, [4, 7, 10], axis=1)
    states: Floats = np.hstack([position, quaternion, as_body(velocity_at, timestep), spin])
    return states
