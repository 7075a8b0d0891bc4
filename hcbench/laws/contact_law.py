"""The laws and the friction that the plug-ins of `hcbench.contact` give to a contact.

Force laws are for steps that resolve the contact: `HuntCrossley`, eq. (16), or `TouchSpeedLaw`, one
of the laws published later, whose α falls as 1/v_i from impact to impact. `Restitution` and
`ConstantRestitution` set the speed after each impact instead, for steps of any length.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeGuard

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import TouchSpeedLaw, law_named
from hcbench.laws.restitution import ConstantRestitution, Restitution
from hcbench.system.errors import SettingError
from hcbench.system.text import rounded_down
from hcbench.terms.arguments import checked_fields
from hcbench.terms.bounds import require as require_that
from hcbench.terms.fields import read_numbers
from hcbench.terms.resolution import STEPS_OF_A_LAW

require = partial(require_that, error=SettingError)


# Stands for a coefficient that was not given: no user writes this number.
_AS_STATIC = -1e-300


@checked_fields
@dataclass(frozen=True)
class Friction:
    """Coulomb friction regularised around rest, as continuous multibody plants do it.

    The coefficient rises as a quintic of slip/slip_speed to `static` at 1 and falls to
    `dynamic` at 3: the Stribeck curve of Drake's MultibodyPlant (`set_stiction_tolerance`);
    Simbody's transition speed is alike.

    static, dynamic: coefficients, static >= dynamic >= 0; `static` alone is both.
    slip_speed: m/s; sticking contacts creep below it.
    """

    static: float
    dynamic: float = _AS_STATIC
    slip_speed: float = 1e-3

    def __post_init__(self) -> None:
        """Take `static` for both where `dynamic` is not given; SettingError for numbers without
        meaning.
        """
        if self.dynamic == _AS_STATIC:
            object.__setattr__(self, "dynamic", self.static)
        require("dynamic friction", self.dynamic, 0 <= self.dynamic < math.inf, "0 or more")
        require(
            "static friction",
            self.static,
            self.dynamic <= self.static < math.inf,
            "dynamic or more",
        )
        require(
            "slip_speed", self.slip_speed, 0 < self.slip_speed < math.inf, "a speed above 0 m/s"
        )

    def coefficient(self, slip: float) -> float:
        """μ at a slip speed in m/s, 0 or more: 0 at rest, `static` at `slip_speed`, `dynamic` from
        3 times it.
        """
        s = slip / self.slip_speed
        if s >= 3.0:
            return self.dynamic
        if s >= 1.0:
            return self.static - (self.static - self.dynamic) * _quintic((s - 1.0) / 2.0)
        return self.static * _quintic(s)


def _quintic(s: float) -> float:
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


PluginForceLaw = HuntCrossley | TouchSpeedLaw
Law = PluginForceLaw | Restitution | ConstantRestitution


def is_force(law: Law) -> TypeGuard[PluginForceLaw]:
    """Say whether a law gives a force over the contact, and so needs steps that resolve the
    contact.
    """
    return isinstance(law, (HuntCrossley, TouchSpeedLaw))


def coarse(law: Law) -> str:
    """The expression for a law with the same restitution at steps that do not resolve the contact."""
    constant = isinstance(law, TouchSpeedLaw)
    return "ConstantRestitution(law.delivered)" if constant else "Restitution(alpha)"


def require_law(law: object) -> None:
    """Raise SettingError unless `law` is one that a plug-in can apply."""
    expected = "HuntCrossley, TouchSpeedLaw, Restitution or ConstantRestitution"
    require("law", law, isinstance(law, Law), expected)


def law_of(options: Mapping[str, Any]) -> Law:
    """Build the law named in a setting's options under "law".

    {"kind": "force", "alpha": s/m, "stiffness": N/m^n, "exponent": 1.5} and {"kind": "restitution",
    "alpha": s/m, "reading": "law"} are eq. (16); {"kind": "restitution", "restitution": e} is one e
    for all speeds; {"kind": "force", "law": "flores", "restitution": e, "stiffness": N/m^n,
    "exponent": 1.5} and {"kind": "restitution", "law": "flores", "restitution": e} a law of
    `laws.published`, asked for e.
    Raises UserError that names the key that is missing, unknown or wrong; `options` stays as it is.
    """
    require(
        "option 'law'", options, hasattr(options, "items"), 'a table such as {"kind": "force", ...}'
    )
    given = dict(options)
    kind = given.pop("kind", None)
    require("option 'law.kind'", kind, kind in ("force", "restitution"), "'force' or 'restitution'")
    if "law" in given:
        return _published_law(kind, given)
    if kind == "force":
        return HuntCrossley(**_numbers(given, ("alpha", "stiffness"), ("exponent",)))
    if "restitution" in given:
        return ConstantRestitution(**_numbers(given, ("restitution",)))
    reading = given.pop("reading", "law")
    numbers = _numbers(given, ("alpha",))
    require("option 'law.reading'", reading, reading in ("law", "linear"), "'law' or 'linear'")
    return Restitution(reading=reading, **numbers)


def _published_law(kind: str, given: dict[str, Any]) -> Law:
    """A law of `laws.published` by its name under "law"; as a restitution, the e that it delivers.

    kind: "force" or "restitution".
    given: the options but "kind"; the name is taken out of it. Its "restitution" is the e asked
    for.
    Raises UserError for a name that no law has and for a number that is missing, unknown or wrong.
    """
    name = given.pop("law")
    if kind == "force":
        numbers = _numbers(given, ("restitution", "stiffness"), ("exponent",))
        return TouchSpeedLaw(law_named(name), **numbers)
    numbers = _numbers(given, ("restitution",))
    # e does not depend on the stiffness, which only scales time.
    any_stiffness = 1.0
    return ConstantRestitution(TouchSpeedLaw(law_named(name), any_stiffness, **numbers).delivered)


def _numbers(
    given: dict[str, Any], required: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, Any]:
    return read_numbers(given, tuple(required), tuple(optional), SettingError, "option 'law.{}'")


def contact_time(law: PluginForceLaw, mass: float, speed: float) -> float:
    """Duration of a contact in s at effective mass (kg) and approach speed (m/s)."""
    at_speed = law if isinstance(law, HuntCrossley) else law.at(speed)
    return float(closed_form.duration(at_speed, mass, speed))


def require_resolved(law: Law, mass: float, speed: float, timestep: float) -> None:
    """Raise SettingError for a step that cannot resolve a force law's contact; other laws pass.

    mass: effective, kg.
    speed: of approach, m/s.
    timestep: s.
    The contact has to last STEPS_OF_A_LAW steps or more.
    """
    if not is_force(law):
        return
    lasts = contact_time(law, mass, speed)
    if timestep > lasts / STEPS_OF_A_LAW:
        raise SettingError(
            f"timestep {timestep:g} s",
            f"too coarse for the force law: ball and plate touch for {lasts:.2g} s at {speed:g} m/s",
            f"a step of {lasts / 20:.1g} s (at most {rounded_down(lasts / STEPS_OF_A_LAW)} s)",
            f"For coarser steps take {coarse(law)} instead",
        )
