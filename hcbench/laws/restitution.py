"""What a plug-in makes of a contact: the law, its kind, its friction.

The force law is `hcbench.laws.force.HuntCrossley` itself, F = k x^n (1 + (3/2) α x'), for steps that
resolve the contact (a tenth of it or less), or `OwnSpeedLaw`, one of the laws that came after, whose α falls
as 1/v_i from impact to impact. `Restitution` and `ConstantRestitution` are what they do to the speed of one
impact, for steps that do not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeGuard, get_args

from hcbench.errors import SettingError
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import OwnSpeedLaw, law_named

if TYPE_CHECKING:
    from collections.abc import Mapping

Reading = Literal["law", "linear"]
STEPS_PER_CONTACT = 4.0  # fewer, and the force over a step is no longer well defined


def require(slot: str, value: object, good: bool, expected: str, todo: str = "") -> None:
    """Raise SettingError for `slot` unless `good`."""
    if not good:
        raise SettingError(slot, f"{value!r}", expected, todo)


@dataclass(frozen=True, slots=True)
class Restitution:
    """Each impact leaves with e(v) of its own approach speed, within the step that it happens in.

    alpha: α, s/m. reading: "law" for e of (16), "linear" for e = 1 - α v of (2).
    """

    alpha: float
    reading: Reading = "law"

    def __post_init__(self) -> None:
        require("alpha", self.alpha, 0 <= self.alpha < math.inf, "0 s/m or more")
        require("reading", self.reading, self.reading in get_args(Reading), "'law' or 'linear'")

    def at(self, speed: float) -> float:
        """E at an approach speed in m/s."""
        if self.reading == "linear":
            return max(0.0, 1.0 - self.alpha * speed)
        return float(closed_form.restitution(self.alpha, speed))


@dataclass(frozen=True, slots=True)
class ConstantRestitution:
    """Each impact leaves with the same e, within the step that it happens in.

    restitution: e, 0 ... 1. `Flores.delivered(0.8)` is what the law of that name makes of an e of 0.8.
    """

    restitution: float

    def __post_init__(self) -> None:
        require("restitution", self.restitution, 0 <= self.restitution <= 1, "0 ... 1")
        object.__setattr__(self, "restitution", float(self.restitution))

    def at(self, speed: float) -> float:
        """E at any approach speed."""
        return self.restitution


@dataclass(frozen=True, slots=True)
class Friction:
    """Coulomb friction regularised around rest, as continuous multibody plants do it.

    The coefficient rises as a quintic of slip/slip_speed to `static` at 1 and falls to `dynamic` at 3: the
    Stribeck curve of Drake's MultibodyPlant (`set_stiction_tolerance`); Simbody's transition speed is alike.

    static, dynamic: coefficients, static >= dynamic >= 0. slip_speed: m/s; sticking contacts creep below it.
    """

    static: float
    dynamic: float
    slip_speed: float = 1e-3

    def __post_init__(self) -> None:
        require("dynamic friction", self.dynamic, 0 <= self.dynamic < math.inf, "0 or more")
        require("static friction", self.static, self.dynamic <= self.static < math.inf, "dynamic or more")
        require("slip_speed", self.slip_speed, 0 < self.slip_speed < math.inf, "a speed above 0 m/s")

    def coefficient(self, slip: float) -> float:
        """μ at a slip speed in m/s."""
        s = slip / self.slip_speed
        if s >= 3.0:
            return self.dynamic
        if s >= 1.0:
            return self.static - (self.static - self.dynamic) * _quintic((s - 1.0) / 2.0)
        return self.static * _quintic(s)


def _quintic(s: float) -> float:
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


ForceLaw = HuntCrossley | OwnSpeedLaw
Law = ForceLaw | Restitution | ConstantRestitution
_KINDS: dict[tuple[str, bool], tuple[type[Law], tuple[str, ...], tuple[str, ...]]] = {
    # kind and whether it names a law: what it makes, what that needs, and what it may have
    ("force", False): (HuntCrossley, ("alpha", "stiffness"), ("exponent",)),
    ("force", True): (OwnSpeedLaw, ("law", "restitution", "stiffness"), ("exponent",)),
    ("restitution", False): (Restitution, ("alpha",), ("reading",)),
    ("restitution", True): (ConstantRestitution, ("law", "restitution"), ()),
}


def is_force(law: Law) -> TypeGuard[ForceLaw]:
    """Whether a law needs steps that resolve the contact."""
    return isinstance(law, (HuntCrossley, OwnSpeedLaw))


def coarse(law: Law) -> str:
    """What gives the restitution of a force law at steps that do not resolve its contact, as written."""
    own = isinstance(law, OwnSpeedLaw)
    return "ConstantRestitution(law.delivered)" if own else "Restitution(alpha)"


def require_law(law: object) -> None:
    """Raise SettingError for what is no law of a plug-in."""
    known = "HuntCrossley, OwnSpeedLaw, Restitution or ConstantRestitution"
    require("law", law, isinstance(law, Law), known)


def law_of(options: Mapping[str, Any]) -> Law:
    """The law that a setting's options name under "law"; UserError says which word is wrong.

    {"kind": "force", "alpha": s/m, "stiffness": N/m^n, "exponent": 1.5} and
    {"kind": "restitution", "alpha": s/m, "reading": "law"} are eq. (16);
    {"kind": "force", "law": "flores", "restitution": e, "stiffness": N/m^n, "exponent": 1.5} and
    {"kind": "restitution", "law": "flores", "restitution": e} a law of `reference.later_laws`, asked for e.
    """
    given = dict(options)
    kind = given.pop("kind", None)
    require("option 'law.kind'", kind, kind in ("force", "restitution"), "'force' or 'restitution'")
    make, needs, may = _KINDS[kind, "law" in given]
    for name, value in given.items():
        require(
            f"option 'law.{name}'", value, name in needs + may, f"only: {', '.join(('kind', *needs, *may))}"
        )
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        require(f"option 'law.{name}'", value, number or name in ("law", "reading"), "a number")
    for name in needs:
        require(f"option 'law.{name}'", None, name in given, f"a number: the {kind} law needs it")
    if "law" in given:
        family = law_named(given.pop("law"))
        if make is ConstantRestitution:
            return ConstantRestitution(OwnSpeedLaw(family, 1.0, **given).delivered)
        return OwnSpeedLaw(family, **given)
    made: Law = make(**given)
    return made


def contact_time(law: ForceLaw, mass: float, speed: float) -> float:
    """Duration of a contact in s at effective mass (kg) and approach speed (m/s)."""
    one = law if isinstance(law, HuntCrossley) else law.at(speed).hunt_crossley
    return float(closed_form.duration(one, mass, speed))
