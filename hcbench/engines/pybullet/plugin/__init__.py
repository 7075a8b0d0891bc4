"""Contact laws as a plug-in of Bullet's own kind, for any script with PyBullet.

    from hcbench.contact import pybullet as contact

    contact.add(HuntCrossley(stiffness=3.4e10, alpha=0.315), ball, plate)
    pybullet.stepSimulation()  # as always

`add` loads the plug-in and sends it one line of text, as any script may; docs/reference/plugins.md
has them. Force laws are for steps that resolve the contact; `Restitution` and
`ConstantRestitution` set e at any step.
"""

from __future__ import annotations

import ctypes
import functools
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hcbench.engines.pybullet.backend import MASS, BulletClient
from hcbench.engines.pybullet.model.bodies import LINK_NAME
from hcbench.laws.contact_law import Friction, Law, is_force, require_law, require_resolved
from hcbench.laws.published import TouchSpeedLaw
from hcbench.laws.restitution import (
    ConstantRestitution,
    Reading,
    Restitution,
    RestitutionCurve,
)
from hcbench.sim.packages import suggest_names
from hcbench.system import compiler as _compile
from hcbench.system.errors import EngineFailed, HcbenchError, SettingError
from hcbench.system.text import shortest
from hcbench.terms.arguments import checked
from hcbench.terms.impact import Floats

# A body, or a body and its link by number or name.
Side = int | tuple[int, int | str]
SOURCE = "engines/pybullet/plugin/plugin.c"
LINK = ["-ldl"]
# 20 in/s, in m/s: the paper's law holds up to it.
_SPEED = 0.508
# Link that stands for any of a body.
_ANY_LINK = -2


@functools.cache
def library() -> Path:
    """Path of the plug-in's library, compiled at the first call. Raises CannotRun without a C
    compiler.
    """
    return _compile.build(SOURCE, link=LINK)


@checked
def load(client: int = 0) -> int:
    """Load the plug-in into a client, unless it is loaded, and return its number there.

    Raises SettingError for a client that is not connected, EngineFailed where
    it does not take the plug-in.
    """
    bullet = BulletClient(client)
    if not bullet.isConnected():
        raise SettingError(
            "client", f"{client} is not connected", "the id that pybullet.connect gave"
        )
    number = int(bullet.loadPlugin(str(library())))
    if number < 0:
        raise EngineFailed("pybullet", f"does not load {library()}", "PyBullet 3.2.5 or later")
    return number


@checked
def command(
    law: Law,
    friction: Friction | float | None = None,
    cup: Sequence[float] | None = None,
) -> str:
    """The text that adds a law, for executePluginCommand.

    friction: a coefficient, or `Friction`, of which a law that sets e takes the dynamic coefficient
    alone; None for the product of the bodies' own.
    cup: (radius, x, y, z), m, of the spherical cup that the first body, a sphere, lies in: its
    centre is in the frame of the second body's centre of mass.

    Raises UserError for an argument of another type, SettingError for what is not a contact law.
    Numbers out of range and a cup of another length are refused later, by the plug-in.
    """
    require_law(law)
    # The law's own keys, then those of friction and cup: "name key=value key=value ...".
    keys: dict[str, Any]
    if isinstance(law, ConstantRestitution):
        keys = {"restitution": law.restitution}
    elif isinstance(law, Restitution):
        keys = {"alpha": law.alpha}
        if law.reading == "linear":
            keys["reading"] = "linear"
    else:
        keys = {"stiffness": law.stiffness, "exponent": law.exponent}
        if isinstance(law, TouchSpeedLaw):
            keys |= {"law": law.family.slug, "restitution": law.restitution}
        else:
            keys["alpha"] = law.alpha
    if isinstance(friction, Friction) and is_force(law):
        keys |= {"friction": friction.static, "dynamic_friction": friction.dynamic}
        keys["slip_speed"] = friction.slip_speed
    elif isinstance(friction, Friction):
        keys["friction"] = friction.dynamic
    elif friction is not None:
        keys["friction"] = friction
    if cup is not None:
        keys["cup"] = ",".join(shortest(float(part)) for part in cup)
    words = ["hunt_crossley" if is_force(law) else "restitution"]
    for key, value in keys.items():
        text = value if isinstance(value, str) else shortest(float(value))
        words.append(f"{key}={text}")
    return " ".join(words)


@checked
def add(
    law: Law, first: Side, second: Side, *, client: int = 0, friction: Friction | float | None = None,
    cup: Sequence[float] | None = None, speed: float = _SPEED,
) -> int:  # fmt: skip
    """Let a law act between two bodies of a client in every step from now on; returns its number.

    first, second: a body, whose base is meant, or (body, link) with the link's number or name; -2
    means any.
    friction: a coefficient, or `Friction`; the product of the bodies' own where not given.
    cup: (radius, x, y, z), m, of the spherical cup that the first body, a sphere, lies in, its
    centre in the frame of the second body's centre of mass; a mesh would be less exact.
    speed: largest approach speed expected, m/s: a step too coarse for a force law there is refused.

    A force law takes the place of Bullet's own contact of the pair. resetSimulation ends all laws.
    Raises SettingError for what cannot be a pair or a law, CannotRun without a C compiler.
    """
    text = command(law, friction, cup)
    bullet = BulletClient(client)
    plugin = load(client)
    # (body, link) of each, which the plug-in takes as four numbers.
    sides = [_side(bullet, first), _side(bullet, second)]
    number = int(bullet.executePluginCommand(plugin, text, [*sides[0], *sides[1]]))
    if number < 0:
        # Its answer to "message" is its last error: in the third place, as text that ends with a 0.
        answer = bullet.executePluginCommand(plugin, "message")
        said = bytes(answer[2][:-1]).decode()
        raise SettingError("contact law", said, "", "docs/reference/plugins.md has all commands")
    if is_force(law):
        world = bullet.getPhysicsEngineParameters()
        # Bullet's 0 substeps are one step.
        step = world["fixedTimeStep"] / max(world["numSubSteps"], 1)
        try:
            require_resolved(law, _reduced_mass(bullet, sides), speed, step)
        # What is refused does not act either.
        except SettingError:
            remove(number, client=client)
            raise
    return number


def _reduced_mass(bullet: BulletClient, sides: Iterable[tuple[int, int]]) -> float:
    """Reduced mass 1/(1/m1 + 1/m2) of a pair, kg, of which at least one can move.

    sides: (body, link) of the two.
    The link -2, which stands for any, counts as the base, and where that is fixed as the lightest
    link that moves.
    """
    # Sum of 1/m, 1/kg. A body that cannot move has a mass of 0 in Bullet.
    mobility = 0.0
    for body, link in sides:
        # Bullet's number of the base is -1.
        mass = bullet.getDynamicsInfo(body, max(link, -1))[MASS]
        if link == _ANY_LINK and not mass > 0.0:
            links = range(bullet.getNumJoints(body))
            masses = [bullet.getDynamicsInfo(body, number)[MASS] for number in links]
            mass = min((some for some in masses if some > 0.0), default=0.0)
        if mass > 0.0:
            mobility += 1.0 / mass
    return 1.0 / mobility


@checked
def remove(number: int, *, client: int = 0) -> None:
    """End a law; Bullet's own contact of its pair acts again.

    number: of the law, as `add` returned it.
    Raises SettingError if the client has no such law.
    """
    if BulletClient(client).executePluginCommand(load(client), "remove", [number]) < 0:
        raise SettingError(
            f"contact law {number}", "not in this client", "a number that `add` returned"
        )


@checked
def force(number: int, *, client: int = 0) -> float:
    """The normal force of a law in the last (sub)step, N, of all its contacts together.

    number: of the law, as `add` returned it.
    Raises SettingError for one that the client has not.
    """
    # The 8 bytes of a double in answer[2]; an integer below 0 for an unknown law.
    answer = BulletClient(client).executePluginCommand(load(client), "force", [number])
    if isinstance(answer, int):
        raise SettingError(
            f"contact law {number}", "not in this client", "a number that `add` returned"
        )
    return float(struct.unpack("d", bytes(part & 255 for part in answer[2]))[0])


class Recorder:
    """Takes steps in a client and reads bodies after each: as stepSimulation,
    getBasePositionAndOrientation and getBaseVelocity do, to the bit, in half the time. Raises
    CannotRun without a C compiler.
    """

    def __init__(self, bullet: BulletClient) -> None:
        """Load the plug-in, and find the client's world in memory.

        Raises CannotRun without a C compiler, SettingError for a client that is not connected,
        EngineFailed where it does not take the plug-in.
        """
        _, _, parts = bullet.executePluginCommand(load(bullet.client), "world")
        (world,) = struct.unpack("P", bytes(part & 255 for part in parts))
        self._world = ctypes.c_void_p(world)
        self._record = ctypes.CDLL(str(library())).hcbench_record

    def record(self, bodies: Sequence[int], steps: int) -> Floats:
        """Take `steps` steps, and return position, m, velocity, m/s, and angular velocity, rad/s, of
        bodies after each, (steps, bodies, 3 quantities, 3).

        bodies: their ids.
        Raises EngineFailed where a body is gone.
        """
        ids = np.array(bodies, dtype=np.intc)
        seen = np.empty((steps, len(bodies), 3, 3))
        ids_at = ctypes.c_void_p(ids.ctypes.data)
        seen_at = ctypes.c_void_p(seen.ctypes.data)
        if not self._record(self._world, steps, ids_at, len(ids), seen_at):
            raise EngineFailed("pybullet", "a body is gone", "")
        return seen


def recorder(bullet: BulletClient) -> Recorder | None:
    """A client's recorder; None where it cannot be compiled, as Python's own functions do the same."""
    try:
        return Recorder(bullet)
    except HcbenchError:
        return None


class ActiveLaw(NamedTuple):
    """A law of the plug-in that acts in a client: its number there, and the command that added it."""

    number: int
    command: str


def find(first: tuple[int, int], second: tuple[int, int], *, client: int = 0) -> ActiveLaw | None:
    """Find the plug-in's law between two parts of a client; None without one.

    first, second: (body, link) each.
    """
    # A process that has not loaded the plug-in has no law: nothing is loaded into it.
    path = library() if library.cache_info().currsize else _compile.loaded(SOURCE)
    if path is None:
        return None
    bullet = BulletClient(client)
    answer = bullet.executePluginCommand(bullet.loadPlugin(str(path)), "find", [*first, *second])
    # An integer below 0: no law. Else the law's number is in the first place, and the text that added
    # it in the third, with a 0 at its end.
    if isinstance(answer, int):
        return None
    return ActiveLaw(int(answer[0]), bytes(answer[2][:-1]).decode())


def restitution_of(command: str) -> RestitutionCurve | None:
    """The restitution curve that a command of the plug-in asks for; None for a force law other than
    Hunt and Crossley's of 1975.

    command: text that added a law, such as "restitution alpha=.3".
    """
    name, *parts = command.split()
    keys = dict(part.split("=", 1) for part in parts)
    # `constant` is an earlier name of the key.
    e = keys.get("restitution", keys.get("constant"))
    if name == "restitution" and e is not None:
        return ConstantRestitution(float(e))
    if "alpha" not in keys:
        return None
    reading: Reading = "linear" if keys.get("reading") == "linear" else "law"
    return Restitution(float(keys["alpha"]), reading)


def _side(bullet: BulletClient, side: Side) -> tuple[int, int]:
    """Body and link of one side of a pair, as numbers, which the plug-in checks.

    side: a body, whose base, -1, is meant, or (body, number or name of a link).
    Raises SettingError for a name that no link of the body has.
    """
    if isinstance(side, int):
        return side, -1
    body, link = side
    if isinstance(link, int):
        return body, link
    links = [
        bullet.getJointInfo(body, i)[LINK_NAME].decode() for i in range(bullet.getNumJoints(body))
    ]
    if link not in links:
        raise SettingError(
            f"link {link!r} of body {body}", "not there", *suggest_names(link, links)
        )
    return body, links.index(link)
