"""What a PyBullet setting may say, checked strictly.

PyBullet ignores negative numbers in silence. So what it would drop is refused here, by name, and what it
would refuse is refused before anything runs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hcbench.errors import SettingError
from hcbench.laws.contact_law import law_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hcbench.laws.contact_law import Law

# Keywords of setPhysicsEngineParameter and of changeDynamics, by the type that PyBullet asks for.
_WORLD: dict[str, type] = {
    "allowedCcdPenetration": float,
    "collisionFilterMode": int,
    "constraintSolverType": int,
    "contactBreakingThreshold": float,
    "contactERP": float,
    "contactSlop": float,
    "deterministicOverlappingPairs": int,
    "enableConeFriction": int,
    "enableSAT": int,
    "erp": float,
    "frictionERP": float,
    "globalCFM": float,
    "minimumSolverIslandSize": int,
    "numNonContactInnerIterations": int,
    "numSolverIterations": int,
    "restitutionVelocityThreshold": float,
    "solverResidualThreshold": float,
    "splitImpulsePenetrationThreshold": float,
    "useSplitImpulse": int,
    "warmStartingFactor": float,
}
_BODY: dict[str, type] = {
    "activationState": int,
    "angularDamping": float,
    "ccdSweptSphereRadius": float,
    "collisionMargin": float,
    "contactDamping": float,
    "contactProcessingThreshold": float,
    "contactStiffness": float,
    "frictionAnchor": int,
    "lateralFriction": float,
    "linearDamping": float,
    "restitution": float,
    "rollingFriction": float,
    "spinningFriction": float,
}
_ELSEWHERE = {
    "fixedTimeStep": "the setting's own timestep says it",
    "numSubSteps": "forces of substeps are not reported; use a smaller timestep",
    "mass": "the scene says it",
}


@dataclass(frozen=True, slots=True)
class Options:
    """A setting's options, checked. All empty: the models as loaded, in a world as Bullet makes it."""

    world: Mapping[str, float]
    ball: Mapping[str, float]
    plate: Mapping[str, float]
    maximal_coordinates: bool
    law: Law | None = None


def read_options(options: Mapping[str, Any]) -> Options:
    """Options from a setting; SettingError names the first word that PyBullet does not have."""
    known = ("world", "ball", "plate", "maximal_coordinates", "law")
    for key in options:
        if key not in known:
            raise SettingError(f"pybullet option {key!r}", "unknown", f"one of: {', '.join(known)}")
    maximal = options.get("maximal_coordinates", False)
    if not isinstance(maximal, bool):
        raise SettingError("pybullet option 'maximal_coordinates'", repr(maximal), "true or false")
    return Options(
        world=_read(options.get("world", {}), "world", _WORLD, "setPhysicsEngineParameter"),
        ball=_read(options.get("ball", {}), "ball", _BODY, "changeDynamics"),
        plate=_read(options.get("plate", {}), "plate", _BODY, "changeDynamics"),
        maximal_coordinates=maximal,
        law=_law(options["law"]) if "law" in options else None,
    )


def _law(given: Any) -> Law:
    if not hasattr(given, "items"):
        raise SettingError("pybullet option 'law'", repr(given), 'a table such as {"kind": "force", ...}')
    return law_of(given)


def _read(given: Any, part: str, known: Mapping[str, type], call: str) -> dict[str, float]:
    if not hasattr(given, "items"):
        raise SettingError(f"pybullet option {part!r}", repr(given), f"a table of {call}'s keywords")
    for key, value in given.items():
        slot = f"pybullet option '{part}.{key}'"
        if key in _ELSEWHERE:
            raise SettingError(slot, "not to be set here", "", _ELSEWHERE[key].capitalize())
        if key not in known:
            raise SettingError(slot, "unknown", f"one of {call}'s: {', '.join(known)}")
        if isinstance(value, bool) and known[key] is int:
            continue
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise SettingError(slot, repr(value), "a number")
        if known[key] is int and not (isinstance(value, int) and value < 2**31):
            raise SettingError(slot, repr(value), f"a whole number below {2**31}")
        if not (math.isfinite(value) and value >= 0):
            raise SettingError(
                slot, repr(value), "a finite number of 0 or more", "Bullet ignores others silently"
            )
    if ("contactStiffness" in given) != ("contactDamping" in given):
        only = next(key for key in given if key in ("contactStiffness", "contactDamping"))
        raise SettingError(
            f"pybullet option {part!r}", f"{only} alone", "contactStiffness and contactDamping"
        )
    return dict(given)
