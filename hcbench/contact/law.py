"""What a plug-in makes of a contact: the law, its kind, its friction.

The force law is `hcbench.reference.laws.HuntCrossley` itself, F = k x^n (1 + (3/2) α x'), for steps that
resolve the contact (a tenth of it or less). `Restitution` is what that law does to the speed of one impact,
for steps that do not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, get_args

from hcbench.errors import SettingError
from hcbench.reference import exact
from hcbench.reference.laws import HuntCrossley

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
        return float(exact.restitution(self.alpha, speed))


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


Law = HuntCrossley | Restitution


def law_of(options: Mapping[str, Any]) -> Law:
    """The law that a setting's options name under "law"; SettingError says which word is wrong.

    {"kind": "force", "alpha": s/m, "stiffness": N/m^n, "exponent": 1.5} or
    {"kind": "restitution", "alpha": s/m, "reading": "law"}.
    """
    kinds: dict[Any, type[HuntCrossley] | type[Restitution]] = {
        "force": HuntCrossley,
        "restitution": Restitution,
    }
    given = dict(options)
    kind = given.pop("kind", None)
    require("option 'law.kind'", kind, kind in kinds, "'force' or 'restitution'")
    names = [field.name for field in fields(kinds[kind])]
    for name, value in given.items():
        require(f"option 'law.{name}'", value, name in names, f"only: kind, {', '.join(names)}")
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        require(f"option 'law.{name}'", value, number or name == "reading", "a number")
    for name in ("stiffness", "alpha") if kind == "force" else ("alpha",):
        require(f"option 'law.{name}'", None, name in given, f"a number: the {kind} law needs it")
    return kinds[kind](**given)


def contact_time(law: HuntCrossley, mass: float, speed: float) -> float:
    """Duration of a contact in s at effective mass (kg) and approach speed (m/s)."""
    return float(exact.duration(law, mass, speed))
