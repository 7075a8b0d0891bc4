"""Fields of the records that hcbench writes: name, unit, key and meaning of each, stated once.

JSON, CSV files, data frames, baselines and the documentation's tables take their keys from here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from operator import attrgetter
from typing import Any

from hcbench.terms.impact import Status

_SUFFIXES = {
    "": "",
    "m": "_m",
    "s": "_s",
    "N": "_n",
    "N s": "_n_s",
    "N/m": "_n_per_m",
    "N s/m": "_n_s_per_m",
    "rad": "_rad",
    "m/s": "_m_per_s",
    "rad/s": "_rad_per_s",
    "s/m": "_s_per_m",
    "m/s²": "_m_per_s2",
}


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a record.

    name: in Python.
    unit: SI; "" for a number without one.
    meaning: one line, without the unit.
    kind: type of the value; a float may be NaN, which is null in JSON, unless it is `given`.
    attribute: where a Python object has it, with dots for parts of parts; the name by default.
    oblique: only records of oblique launches have it.
    """

    name: str
    unit: str
    meaning: str
    kind: Any = float
    attribute: str = ""
    oblique: bool = False
    given: bool = False

    @property
    def key(self) -> str:
        """Key in JSON, and column of CSV files and data frames: the name and the unit."""
        return self.name + _SUFFIXES[self.unit]

    @property
    def description(self) -> str:
        """Meaning with the unit."""
        return f"{self.meaning}, {self.unit}" if self.unit else self.meaning

    def of(self, source: Any) -> Any:
        """The value that an object has, as JSON takes it. Raises AttributeError for none."""
        value = attrgetter(self.attribute or self.name)(source)
        return value.value if isinstance(value, Enum) else value

    def within(self, part: str) -> Field:
        """The same field, which an object has in a part of it."""
        return replace(self, attribute=f"{part}.{self.attribute or self.name}")


Fields = tuple[Field, ...]


def record(fields: Fields, source: Any, oblique: bool = True) -> dict[str, Any]:
    """The fields of an object by their keys.

    oblique: whether to add those of oblique launches.
    """
    return {field.key: field.of(source) for field in fields if oblique or not field.oblique}


def keys(fields: Fields) -> list[str]:
    """The keys of fields."""
    return [field.key for field in fields]


# Launches

SPEED = Field("speed", "m/s", "launch speed", given=True)
PHASE = Field("phase", "", "where in a time step the contact starts, 0 to 1", given=True)
ANGLE = Field("angle", "rad", "angle of the launch from the normal", oblique=True, given=True)
HEIGHT = Field(
    "height", "m", "clearance at release; null for two to three steps of flight", float | None
)
SLIP = Field("slip", "m/s", "velocity along the plate at release", list[float])
SPIN = Field("spin", "rad/s", "angular velocity at release", list[float])

# Impacts

STATUS = Field("status", "", "how the impact ended", Status)
REASON = Field("reason", "", "why there is no e", str)
SPEED_IN = Field("speed_in", "m/s", "impact speed")
SPEED_OUT = Field("speed_out", "m/s", "speed out")
RESTITUTION = Field("restitution", "", "e")
AFTER_FORCE = Field(
    "restitution_after_force", "", "e just after the contact's force, before joints and servos act"
)
DURATION = Field("duration", "s", "contact time")
PENETRATION_MAX = Field("penetration_max", "m", "largest penetration")
FORCE_MAX = Field("force_max", "N", "largest force")
SAMPLES = Field("samples", "", "steps in which the contact force acts", int)

IMPACT = (
    SPEED.within("launch"),
    PHASE.within("launch"),
    ANGLE.within("launch"),
    STATUS,
    REASON,
    SPEED_IN,
    SPEED_OUT,
    RESTITUTION,
    AFTER_FORCE,
    DURATION,
    PENETRATION_MAX,
    FORCE_MAX,
    SAMPLES,
)

# A run of a study: one setting at one step for one α, under the conditions of its scene.
CONDITIONS = (
    Field("gravity", "m/s²", "gravity along the normal"),
    Field("off_axis", "m", "distance of the launch from the axis of a cup"),
    Field("friction", "", "coefficient of friction"),
)
RUN = (
    Field("scene", "", "name of the scene", str),
    *CONDITIONS,
    Field("engine", "", "name of the engine", str),
    Field("setting", "", "name of the setting", str),
    Field("alpha", "s/m", "α"),
    Field("timestep", "s", "time step"),
)

# An impact of a study has its speed and phase as they were asked for, and e by
# the law at its impact speed.
LAW = Field("restitution_law", "", "e of the law at the impact speed")
LINEAR = Field("restitution_linear", "", "1 - α v at the impact speed")
STUDY_IMPACT = (
    SPEED,
    PHASE,
    STATUS,
    REASON,
    SPEED_IN,
    SPEED_OUT,
    RESTITUTION,
    LAW,
    LINEAR,
    DURATION,
    PENETRATION_MAX,
    FORCE_MAX,
    SAMPLES,
)

# An impact of a baseline: what it takes to launch it again, and how it ended.
BASELINE_IMPACT = (
    SPEED.within("launch"),
    PHASE.within("launch"),
    HEIGHT.within("launch"),
    SLIP.within("launch"),
    SPIN.within("launch"),
    STATUS,
    RESTITUTION,
)

# Along the plate, in oblique impacts: the fields of `AlongPlate` in their order.
SLIP_IN = Field("slip_in", "m/s", "slip of the contact point before", oblique=True)
IMPULSE_RATIO = Field(
    "impulse_ratio", "", "impulse of friction over the normal impulse", oblique=True
)
ALONG = (
    SLIP_IN,
    Field("slip_out", "m/s", "slip of the contact point after", oblique=True),
    Field("spin_in", "rad/s", "spin before", oblique=True),
    Field("spin_out", "rad/s", "spin after", oblique=True),
    IMPULSE_RATIO,
    Field("energy_lost", "", "share of the kinetic energy that was lost", oblique=True),
)
COULOMB = Field("impulse_ratio_coulomb", "", "impulse ratio by Coulomb's law", oblique=True)

# e over speed

CURVE_POINT = (
    SPEED,
    SPEED_IN,
    RESTITUTION,
    Field("restitution_min", "", "smallest e of all phases", attribute="lowest"),
    Field("restitution_max", "", "largest e of all phases", attribute="highest"),
    AFTER_FORCE,
    Field("target", "", "e that is wanted at these speeds; null without a target"),
    Field("error", "", "e - target"),
    Field(
        "error_worst_phase",
        "",
        "e - target of the one phase in which it is largest, with its sign: what `--max-error` limits",
        attribute="worst_phase",
    ),
    replace(SAMPLES, meaning="steps in contact, the fewest of all phases"),
    Field("failed", "", "impacts without an e", int),
    ANGLE,
    *(field.within("along") for field in ALONG),
)

# Force loops: columns of numbers, a step each.

LOOP = (
    Field("time", "s", "time of each step", list[float]),
    Field("penetration", "m", "penetration", list[float]),
    Field("rate", "m/s", "rate of the penetration, above 0 on approach", list[float]),
    Field("force", "N", "normal force at the start of each step", list[float]),
)

# A drop under gravity in a study: its bounces, and how the body lies at the end.
BOUNCE = (
    Field("bounce", "", "number of the bounce, from 1", int),
    Field("touch", "s", "time of the touch from release"),
    Field("parting", "s", "time at which the bodies part"),
    Field("height", "m", "height to which the body rises after it"),
    Field("height_law", "m", "the same by the law"),
)
LAID = (
    Field("followed", "s", "time for which the body was followed"),
    Field("depth", "m", "mean penetration in the last second"),
    Field("motion", "m", "largest less least penetration in the last second"),
)

# Bodies at rest, and robots that land

REST = (
    Field("penetration", "m", "penetration"),
    Field("vibration", "m/s", "vibration at rest"),
    Field("force_noise", "", "standard deviation of the contact force at rest, over its mean"),
    Field("sinking", "m/s", "speed into the plate at rest"),
)
LANDING = (
    Field(
        "height", "m", "height of the robot's lowest point over the floor at release", given=True
    ),
    Field("tilt", "rad", "tilt of the robot's base at release", given=True),
    replace(SPEED_IN, meaning="speed of the centre of mass towards the floor at the first touch"),
    replace(RESTITUTION, meaning="e of the robot's centre of mass"),
    Field(
        "peak_over_weight",
        "",
        "largest force of the floor over the robot's weight",
        attribute="peak",
    ),
    Field(
        "impulse",
        "N s",
        "largest impulse of the floor in one step, where feet have a plug-in's restitution law",
    ),
    Field("contact", "s", "longest first contact of a foot"),
    Field("slip", "m", "longest way of a foot along the floor"),
    Field("penetration", "m", "largest penetration of a foot"),
    Field("feet_that_bounce", "", "how many feet bounce", int, attribute="bouncing"),
)
LANDING_SPEED_OUT = replace(
    SPEED_OUT,
    meaning="largest speed of the centre of mass away from the floor when no part touches it, or 0",
)
# Of drops that judge the feet of a robot: the other quantities are `LandingQuantities`.
REBOUND = (
    Field(
        "rebound",
        "m",
        "rebound of the centre of mass from a drop of 10 cm, flat: mean over phases",
    ),
    Field(
        "rebound_spread", "m", "largest difference of a phase from that mean", attribute="spread"
    ),
)
LANDING_TIME = Field("time", "s", "time of each step from the first touch", list[float])
LANDING_FORCE = Field("force", "N", "force of the floor on the robot at each step", list[float])

# Meaning of a contact: impacts, loads at rest, landings and time steps

CONTACT = (
    Field("load", "N", "force of the contact at rest", attribute="carried.load"),
    Field(
        "stiffness_at_rest",
        "N/m",
        "force over penetration at rest",
        attribute="carried.stiffness",
    ),
    Field(
        "holds",
        "rad",
        "steepest slope that friction holds in every direction",
        attribute="carried.holds",
    ),
    Field(
        "holds_most",
        "rad",
        "steepest slope that friction holds in the direction in which it holds most",
        attribute="carried.holds_most",
    ),
    Field("slope", "rad", "slope on which the creep was measured", attribute="carried.slope"),
    Field("creep", "m/s", "speed of the resting body down the slope", attribute="carried.creep"),
    Field(
        "largest_stable_step",
        "s",
        "largest time step of `steps` up to which none of the fastest launches gains energy",
    ),
)
CONTACT_IMPACT = (
    SPEED.within("point"),
    SPEED_IN.within("point"),
    RESTITUTION.within("point"),
    DURATION,
    SAMPLES.within("point"),
    replace(PENETRATION_MAX, attribute="penetration"),
    replace(FORCE_MAX, attribute="force"),
    Field("stiffness", "N/m", "stiffness of the spring and damper nearest to the contact's force"),
    Field("damping", "N s/m", "damping of that spring and damper"),
    Field("damping_ratio", "", "damping over 2 √(stiffness · effective mass)"),
    Field("misfit", "", "rms force that the spring and damper leave, over the largest force"),
)
CONTACT_LOAD = (
    Field("times", "", "multiple of the force at rest", given=True),
    Field("force", "N", "force that the contact bears; null where it does not bear this load"),
    Field("penetration", "m", "penetration"),
)
CONTACT_STEP = (
    Field("timestep", "s", "time step", given=True),
    replace(RESTITUTION, meaning="mean e of the fastest launches"),
    Field("restitution_min", "", "smallest e of all phases", attribute="lowest"),
    Field("restitution_max", "", "largest e of all phases", attribute="highest"),
    replace(SAMPLES, meaning="steps in contact, the fewest of all phases"),
    Field("stable", "", "whether each launch has an e of 1 at most", bool, attribute="is_stable"),
)
LANDING_PEAK = (
    Field("height", "m", "height of the lowest point at release", given=True),
    Field(
        "peak_over_weight_min",
        "",
        "lowest peak force over the weight, of all phases",
        attribute="lowest",
    ),
    Field(
        "peak_over_weight_max",
        "",
        "highest peak force over the weight, of all phases",
        attribute="highest",
    ),
)
