"""One body tossed onto a fixed horizontal plate at z = 0: what an engine does
with a measured motion's start.

An engine that can simulate it has a module `toss` in its package (`registry.submodule`) with

    SETTINGS: tuple[ContactSetting, ...]
        What can be set of the contact, from nothing to all that the engine has.
    SHAPES: frozenset[str]
        Of `Body.shape`, those that it has.
    simulate(body, setting, values, timestep, tosses) -> list of arrays of shape (steps + 1, 13)
        `States` of the body at the ends of steps, one array a toss; values: one for each of the setting's
        parameters. Called in a worker process; raises EngineMissing where the backend is missing.

Vectors are in the world's frame, z up, SI; quaternions are (w, x, y, z).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np

from hcbench.laws.restitution import ConstantRestitution, Restitution
from hcbench.sim import registry
from hcbench.terms.impact import Floats

GRAVITY = 9.81  # m/s²
Shape = Literal["box", "ellipsoid", "sphere"]
# Columns of the states that engines return.
POSITION = slice(0, 3)
QUATERNION = slice(3, 7)
VELOCITY = slice(7, 10)
SPIN = slice(10, 13)


@dataclass(frozen=True, slots=True)
class Body:
    """A body by its mass (kg), and by sizes (m) and moments of inertia (kg m²) along its own axes.

    half_sizes: half edges of a box, semi-axes of an ellipsoid, thrice the radius of a sphere.
    """

    shape: Shape
    half_sizes: tuple[float, float, float]
    mass: float
    inertia: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Toss:
    """The start of a toss: position (m), quaternion, velocity (m/s) and
    spin (rad/s), and how many steps.
    """

    position: Floats
    quaternion: Floats
    velocity: Floats
    spin: Floats
    steps: int


@dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter of a setting that is to be identified.

    starts: of each search, all positive.
    most: upper bound.
    """

    name: str
    starts: tuple[float, ...]
    most: float = np.inf


@dataclass(frozen=True, slots=True)
class ContactSetting:
    """A way to set an engine's contact.

    name: the same for what engines have in common.

    cone: of friction, where the engine has several.
    """

    name: str
    parameters: tuple[Parameter, ...] = ()
    cone: Literal["elliptic", "pyramidal", ""] = ""

    @property
    def key(self) -> str:
        """The setting among those of its engine."""
        return f"{self.name}, {self.cone}" if self.cone else self.name

    def named(self, values: Sequence[float]) -> dict[str, float]:
        """Values of the parameters, by their names."""
        return {p.name: value for p, value in zip(self.parameters, values, strict=True)}


NOTHING = "nothing set"
FRICTION = "friction alone"
RESTITUTION = "restitution"
PLUGIN_E = "plug-in constant e"
PLUGIN_ALPHA = "plug-in alpha"
# Parameters by starts of a search.
MU = Parameter("friction", (0.18, 0.3, 0.1))
E = Parameter("restitution", (0.2, 0.5, 0.9), most=1.0)
ALPHA = Parameter("alpha", (2.0, 0.5, 0.1))


def plugin_law(
    setting: ContactSetting, given: Mapping[str, float]
) -> Restitution | ConstantRestitution | None:
    """The law that a contact setting gives the plug-in: one e, or e(v) of an α; None for a setting
    of the engine's own contact.

    given: values of the setting's parameters by name; α in s/m.
    Raises KeyError where the law's is missing.
    """
    if setting.name == PLUGIN_E:
        return ConstantRestitution(given[E.name])
    if setting.name == PLUGIN_ALPHA:
        return Restitution(given[ALPHA.name])
    return None


class TossModule(Protocol):
    """Functions that the module `toss` in an engine's folder must have."""

    SETTINGS: tuple[ContactSetting, ...]
    SHAPES: frozenset[Shape]

    def simulate(
        self,
        body: Body,
        setting: ContactSetting,
        values: Sequence[float],
        timestep: float,
        tosses: Sequence[Toss],
    ) -> list[Floats]:
        """Simulate each toss of a body: its state at the start and after each step, SI, an array
        (steps + 1, 13) per toss: position, quaternion, velocity, spin.

        values: one for each of the setting's parameters.
        timestep: s.
        Raises EngineMissing where the backend is missing.
        """
        ...


def engines() -> Iterator[tuple[str, TossModule]]:
    """Engines that can simulate a toss, installed or not, each with its module."""
    for name in registry.names():
        module: Any = registry.submodule(name, "toss")
        if module is not None:
            yield name, module


def as_integrated(velocity: Floats, timestep: float) -> Floats:
    """Velocity to give an engine that moves bodies by the new velocity of a step, shape (..., 3).

    velocity: of the body, m/s, z up.
    timestep: s.
    It has half a step of gravity more: the engine's positions then lie on the parabola of free
    flight, at any step. The engine's velocity at a step's end exceeds the body's by the same amount
    (`as_body`).
    """
    given: Floats = velocity + np.array([0.0, 0.0, 0.5 * GRAVITY * timestep])
    return given


def as_body(velocity: Floats, timestep: float) -> Floats:
    """Velocity of the body in free flight, from the engine's at the end of a step;
    the inverse of `as_integrated`.
    """
    own: Floats = velocity - np.array([0.0, 0.0, 0.5 * GRAVITY * timestep])
    return own
