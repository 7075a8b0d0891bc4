"""Options of a PyBullet setting, checked strictly.

PyBullet ignores negative numbers in silence. So what it would drop is refused here, by name, and
what it would refuse is refused before anything runs.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, PlainValidator, StrictBool, ValidationInfo, field_validator

from hcbench.laws.contact_law import Law, law_of
from hcbench.system.errors import SettingError
from hcbench.terms.fields import Finite, OptionTable, mistake, validate

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
    "fixedTimeStep": "The setting's own timestep says it",
    "numSubSteps": "Forces of substeps are not reported; use a smaller timestep",
    "mass": "The scene says it",
}


class LinkOptions(OptionTable):
    """A sphere of the ball, `onset` m smaller, with contactStiffness
    (N/m) and contactDamping (N s/m).
    """

    onset: Finite
    stiffness: Finite
    damping: Finite

    @field_validator("onset", "stiffness")
    @classmethod
    def _in_range(cls, value: float, info: ValidationInfo) -> float:
        """Refuse an onset below 0 m, and a stiffness that is not above 0 N/m."""
        if value < 0 or (value == 0 and info.field_name == "stiffness"):
            expected = "above 0 N/m"
            if info.field_name == "onset":
                expected = "0 m or more"
            raise mistake(expected, f"{value!r}")
        return value


class PybulletOptions(OptionTable):
    """A setting's options, checked. All empty: the models as loaded, in a world as Bullet makes it.

    links: in place of the one sphere of the ball.
    """

    world: dict[str, Any] = Field({}, description="a table of setPhysicsEngineParameter's keywords")
    ball: dict[str, Any] = Field({}, description="a table of changeDynamics's keywords")
    plate: dict[str, Any] = Field({}, description="a table of changeDynamics's keywords")
    links: tuple[LinkOptions, ...] = Field((), description="a list of the ball's links")
    maximal_coordinates: StrictBool = Field(False, description="true or false")
    law: Annotated[Law, PlainValidator(law_of)] | None = None


def read_options(options: Mapping[str, Any]) -> PybulletOptions:
    """Options from a setting; SettingError names the first word that PyBullet does not have."""
    checked = validate(PybulletOptions, options, SettingError, "pybullet option '{}'")
    alone = (
        checked.law is None
        and not checked.maximal_coordinates
        and "restitution" not in checked.ball
    )
    if checked.links and not alone:
        got = "given with a law, a restitution or maximal coordinates"
        raise SettingError("pybullet option 'links'", got, "links alone: they are the contact")
    _check(checked.world, "world", _WORLD, "setPhysicsEngineParameter")
    _check(checked.ball, "ball", _BODY, "changeDynamics")
    _check(checked.plate, "plate", _BODY, "changeDynamics")
    return checked


def _check(keywords: Mapping[str, Any], part: str, types: Mapping[str, type], call: str) -> None:
    """Raise SettingError for the first keyword that a call of PyBullet
    does not take, or would ignore.
    """
    for key, value in keywords.items():
        slot = f"pybullet option '{part}.{key}'"
        if key in _ELSEWHERE:
            raise SettingError(slot, "not to be set here", "", _ELSEWHERE[key])
        if key not in types:
            raise SettingError(slot, "unknown", f"one of {call}'s: {', '.join(types)}")
        if isinstance(value, bool) and types[key] is int:
            continue
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise SettingError(slot, repr(value), "a number")
        if types[key] is int and not (isinstance(value, int) and value < 2**31):
            raise SettingError(slot, repr(value), f"a whole number below {2**31}")
        if not (math.isfinite(value) and value >= 0):
            advice = "Bullet ignores others silently"
            raise SettingError(slot, repr(value), "a finite number of 0 or more", advice)
    alone = {"contactStiffness", "contactDamping"} & keywords.keys()
    if len(alone) == 1:
        got = f"{alone.pop()} alone"
        raise SettingError(f"pybullet option {part!r}", got, "contactStiffness and contactDamping")
