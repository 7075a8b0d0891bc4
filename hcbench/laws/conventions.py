"""One contact, many names: α here, d in Drake, c in Simbody, solref in
MuJoCo, restitution elsewhere.

The law's factor of v is a = λ/k = (3/2) α: F = k x^n (1 + a v). Drake's
`hunt_crossley_dissipation` d is a, Simbody's `dissipation` c is α, so the same word
"dissipation" differs by 3/2 between two libraries of one family. Engines that know a constant
restitution, or a spring and damper, can match the law at one speed only.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hcbench.laws import closed_form
from hcbench.laws import kelvin_voigt as kv
from hcbench.laws.restitution import Reading
from hcbench.laws.solvers import root
from hcbench.system.errors import UserError
from hcbench.system.text import Shown
from hcbench.terms.arguments import checked_fields
from hcbench.terms.bounds import LARGEST, positive, require
from hcbench.terms.impact import Floats

# Contacts given by a stiffness and a damping in SI: IMPACT of MSC Adams, ke and kd of Newton.
#
# The restitution of both depends on the effective mass. IMPACT's depends on the speed, too: it
# does not follow one α; `convert` matches it at one speed, `tune` over a band.


@checked_fields
@dataclass(frozen=True, slots=True)
class AdamsImpact:
    """F = max(0, k x^e + step(x, 0, 0, d, c_max) v), IMPACT of MSC Adams' function reference.

    step is the cubic from 0 at the touch to c_max at the depth d, and c_max below it.

    stiffness: k, N/m^e.
    exponent: e, 1 or more.
    damping: c_max, N s/m.
    depth: d, m.
    """

    stiffness: float
    exponent: float
    damping: float
    depth: float

    def __post_init__(self) -> None:
        """Raise UserError for an exponent outside 1 ... 10, a damping below 0, a k or d not above
        0.
        """
        positive("stiffness", self.stiffness, "N/m^n")
        require("exponent", self.exponent, 1 <= self.exponent <= 10, "n within 1 ... 10")
        require(
            "damping",
            self.damping,
            0 <= self.damping <= LARGEST,
            f"0 N s/m or more, up to {LARGEST:g}",
        )
        positive("depth", self.depth, "m")

    def force(self, x: Floats | float, v: Floats | float) -> Floats:
        """F(x, v) in N; x >= 0 in m and v in m/s, > 0 on approach, broadcast. It never pulls."""
        share = np.clip(np.asarray(x) / self.depth, 0.0, 1.0)
        damping = self.damping * share**2 * (3.0 - 2.0 * share)
        force = self.stiffness * np.power(x, self.exponent) + damping * np.asarray(v)
        return np.asarray(np.maximum(force, 0.0))

    def restitution(self, mass: float, speed: float) -> float:
        """e of an effective mass (kg) at an impact speed (m/s), by integration over time.

        0 where the body does not part.
        Raises UserError for a mass or speed that is not above 0.
        """
        # SciPy's integrators are slow to import.
        from hcbench.laws import ode

        impact = ode.impact(self, mass, speed, count=3)
        return impact.speed_out / impact.speed_in

    def points(self, mass: float, low: float, high: float) -> tuple[tuple[float, float], ...]:
        """(speed m/s, e) over a band of speeds."""
        return tuple((v, self.restitution(mass, v)) for v in np.geomspace(low, high, 13).tolist())


@checked_fields
@dataclass(frozen=True, slots=True)
class NewtonSpring:
    """ke and kd of Newton's shapes.

    per_mass: whether the solver reads them in 1/s² and 1/s, the same for every mass,
    and never pulls. Else F = ke x + kd v on the way in and ke x on the way out, N/m
    and N s/m (SolverSemiImplicit).
    """

    per_mass: bool
    ke: float
    kd: float

    def __post_init__(self) -> None:
        positive("ke", self.ke, "1/s^2" if self.per_mass else "N/m")
        require("kd", self.kd, 0 <= self.kd <= LARGEST, f"0 or more, up to {LARGEST:g}")

    def restitution(self, mass: float) -> float:
        """e of an effective mass (kg), at any speed."""
        if self.per_mass:
            return float(kv.restitution(self.kd / (2.0 * math.sqrt(self.ke)), kv.Ending.FORCE))
        return one_way_restitution(self.kd / (2.0 * math.sqrt(self.ke * mass)))

    def points(self, mass: float, low: float, high: float) -> tuple[tuple[float, float], ...]:
        """(speed m/s, e): one pair, as e is the same over the band.

        high: m/s.
        """
        return ((low, self.restitution(mass)),)


def one_way_restitution(zeta: float) -> float:
    """e of a damper that acts on the way in only, over its damping ratio ζ: exp(-ζ acos ζ/√(1-ζ²)).

    zeta: 0 or more; from 1 on acosh and √(ζ²-1) go on smoothly, and at 1 e is 1/e = 0.368.
    The way in is a damped oscillator's from touch to its first standstill, at ω X/v = e; the spring
    returns it all.
    """
    if abs(zeta - 1.0) < 1e-8:
        return math.exp(-1.0)
    root = math.sqrt(abs(1.0 - zeta**2))
    if zeta < 1.0:
        angle = math.acos(zeta)
    else:
        angle = math.acosh(zeta)
    return math.exp(-zeta * angle / root)


# Each convention's dissipation over α.
_OVER_ALPHA = {"alpha": 1.0, "drake": 1.5, "simbody": 1.0}
# Solvers that read ke and kd; True if they take them per unit mass.
SOLVERS_OF_NEWTON = {"mujoco": True, "semi-implicit": False}

_CAVEATS = (
    "An e holds at one speed: by the law it falls as v grows; in engines with a restitution it is constant.",
    "e = 1 - α v is not the law's e: 0.80 against 0.833 at α v = 0.2. Choose by --target.",
)


@dataclass(frozen=True, slots=True)
class SystemValue:
    """Parameter of one system and its value: one number or, for solref, two."""

    system: str
    parameter: str
    value: tuple[float, ...]
    unit: str
    note: str

    @property
    def text(self) -> str:
        """The value as it is written."""
        return " ".join(f"{v:.10g}" for v in self.value)


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """One contact as one system writes it.

    missing: what has no value, and why, a sentence each.
    """

    rows: tuple[SystemValue, ...] = ()
    missing: tuple[str, ...] = ()
    caveats: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class OneContact:
    """Contact that is to be expressed in every system's parameters.

    alpha: α, s/m.
    speed: where a restitution should hold, m/s, or None.
    reading: "law" if that restitution is e of (16), "linear" if it is 1 - α v.
    contact_time: of a spring and damper, s.
    timestep: of a bounce in one step, s; None: not known.
    """

    alpha: float
    speed: float | None = None
    contact_time: float | None = None
    timestep: float | None = None
    reading: Reading = "law"

    @property
    def restitution(self) -> float | None:
        """e at `speed`, above 0, for engines that take one constant e; None where no speed is
        given, and where 1 - α v is 0 or less, which no engine takes.
        """
        if self.speed is None:
            return None
        e = self.curve_at_speed
        if self.reading == "linear":
            e = 1.0 - self.alpha * self.speed
        return e if e > 0.0 else None

    @property
    def curve_at_speed(self) -> float:
        """e of (16) at `speed`."""
        return float(closed_form.restitution(self.alpha, self.speed or 0.0))

    @property
    def at(self) -> str:
        """The speed at which a constant e holds, as a note."""
        return f"matches at {self.speed:.6g} m/s only"


@dataclass(frozen=True, repr=False)
class Conversion(Shown):
    """One contact in all conventions.

    alpha: α, s/m.
    speed: where the restitution holds, m/s, or None.
    restitution: e of the law there, restitution_linear: 1 - α v.
    rows: the contact in each convention.
    caveats: sentences on what the numbers do not tell.
    missing: what has no value, and why, a sentence each.
    """

    alpha: float
    speed: float | None
    restitution: float | None
    restitution_linear: float | None
    rows: tuple[SystemValue, ...]
    missing: tuple[str, ...]
    caveats: tuple[str, ...]

    def _lines(self) -> Iterator[str]:
        yield f"α = {self.alpha:.6g} s/m"
        if self.speed is not None:
            yield f"at {self.speed:.6g} m/s: e of the law {self.restitution:.6g}"
        for row in self.rows:
            yield f"{row.system} {row.parameter}: {row.text} {row.unit}".rstrip()

    def _rows(self) -> Iterator[dict[str, Any]]:
        return (asdict(row) | {"value": row.text} for row in self.rows)

    def as_dict(self) -> dict[str, Any]:
        """The contact as JSON; units are in the keys, and None stands for what has no value."""
        return {
            "alpha_s_per_m": self.alpha,
            "speed_m_per_s": self.speed,
            "restitution": self.restitution,
            "restitution_linear": self.restitution_linear,
            "rows": [asdict(row) | {"value": list(row.value)} for row in self.rows],
            "missing": list(self.missing),
            "caveats": list(self.caveats),
        }


def contact_of(
    *,
    alpha: float | None = None,
    drake: float | None = None,
    simbody: float | None = None,
    restitution: float | None = None,
    solref: tuple[float, float] | None = None,
    adams: AdamsImpact | None = None,
    newton: NewtonSpring | None = None,
    mass: float | None = None,
    speed: float | None = None,
    contact_time: float | None = None,
    timestep: float | None = None,
    reading: Reading = "law",
) -> OneContact:
    """One contact, from exactly one of alpha, drake, simbody, restitution, solref, adams and newton.

    alpha: α, s/m.
    drake: hunt_crossley_dissipation, s/m.
    simbody: dissipation, s/m.
    restitution: e at `speed`, above 0, up to 1.
    solref: MuJoCo's two numbers (constant impedance assumed); with a 0 in front the one-step
    setting at `timestep`.
    adams, newton: of an effective mass in kg; MuJoCo's solver in Newton needs none.
    mass, speed, contact_time, timestep, reading: SI, the rest as in `OneContact`. What the one
    given does not need has no effect on α.
    Raises UserError for numbers without meaning, for none or several of the seven, and where
    mass, speed or step is missing that the one given needs: all but alpha, drake and simbody need
    `speed`.
    """
    dissipations = {"alpha": alpha, "drake": drake, "simbody": simbody}
    given = {
        **dissipations,
        "restitution": restitution,
        "solref": solref,
        "adams": adams,
        "newton": newton,
    }
    names = [name for name, value in given.items() if value is not None]
    if len(names) != 1:
        raise UserError(
            "convert",
            f"got {' and '.join(names) or 'nothing'}",
            f"exactly one of {', '.join(given)}",
        )
    require("reading", reading, reading in ("law", "linear"), "law or linear")
    for slot, value, unit in (
        ("mass", mass, "kg"), ("speed", speed, "m/s"),
        ("contact_time", contact_time, "s"), ("timestep", timestep, "s"),
    ):  # fmt: skip
        if value is not None:
            positive(slot, value, unit)
    (name,) = names
    dissipation = dissipations.get(name)
    if dissipation is not None:
        require(name, dissipation, 0.0 <= dissipation < math.inf, "0 s/m or more")
        alpha = dissipation / _OVER_ALPHA[name]
    else:
        # All others state an e, which at a speed has an α.
        e = restitution
        if solref is not None:
            e = _restitution_of_solref(solref, timestep)
        elif adams is not None:
            e = adams.restitution(_needed("mass", mass, "kg"), _needed("speed", speed, "m/s"))
        elif newton is not None:
            # A spring per unit mass has the same e for every mass.
            m = 1.0 if newton.per_mass else _needed("mass", mass, "kg")
            e = newton.restitution(m)
        assert e is not None
        alpha = _alpha_of(e, speed, reading)
    if speed is not None:
        require(
            "alpha",
            alpha,
            math.isfinite(alpha * speed),
            "α v that is a number: a smaller α or speed",
        )
    return OneContact(alpha, speed, contact_time, timestep, reading)


def said(contact: OneContact, engines: Iterable[Vocabulary | None]) -> Conversion:
    """Write the contact in all conventions: of the paper, of libraries that hcbench does not run,
    and of engines.

    engines: the rows, caveats and missing values of each engine; None for an engine that has no
    parameters for such a contact.
    Restitutions and solref are in `missing` of the result where the contact has no speed, or no e
    above 0 there.
    """
    e = None
    linear = None
    missing = []
    if contact.speed is None:
        missing.append("Restitutions and solref: they need the speed at which they should hold.")
    else:
        e = contact.curve_at_speed
        linear = 1.0 - contact.alpha * contact.speed
        if contact.restitution is None:
            low = f"1 - α v is {linear:.4g} at {contact.speed:g} m/s"
            missing.append(f"Restitutions and solref: {low}, below what any has.")
    rows = list(_others(contact))
    caveats = list(_CAVEATS)
    for vocabulary in engines:
        if vocabulary is not None:
            rows.extend(vocabulary.rows)
            missing.extend(vocabulary.missing)
            caveats.extend(vocabulary.caveats)
    return Conversion(
        alpha=contact.alpha,
        speed=contact.speed,
        restitution=e,
        restitution_linear=linear,
        rows=tuple(rows),
        missing=tuple(missing),
        caveats=tuple(caveats),
    )


def _needed(slot: str, value: float | None, unit: str) -> float:
    """Value as given; UserError, in the name of its slot, for None.

    unit: for the message.
    """
    if value is None:
        raise UserError(
            slot, "none", f"a number in {unit}", "The restitution of this contact depends on it"
        )
    return value


def _alpha_of(e: float, speed: float | None, reading: Reading) -> float:
    """α in s/m of the contact that has this e at this speed (m/s).

    reading: "law" if e is that of eq. (16), "linear" if it is 1 - α v.
    Raises UserError without a speed, and for an e outside 0 < e <= 1.
    """
    if speed is None:
        raise UserError(
            "speed", "none", "the impact speed at which e is to hold", "e alone fixes no α"
        )
    require("restitution", e, 0.0 < e <= 1.0, "0 < e <= 1")
    if reading == "linear":
        return (1.0 - e) / speed
    return float(closed_form.alpha_of(e, speed))


def _restitution_of_solref(solref: tuple[float, float], timestep: float | None) -> float:
    """e of MuJoCo's contact, which ends at F = 0 as it cannot pull; constant impedance, small
    steps.

    solref: "timeconst dampratio" (s and a ratio), "-stiffness -damping" (per unit mass, 1/s² and
    1/s), or "0 -D" of one step, D in 1/s.
    timestep: s, for the form "0 -D".
    Raises UserError for numbers in none of MuJoCo's forms, and for the last form without its step.
    """
    first, second = solref
    require("solref", solref, all(map(math.isfinite, solref)), "two finite numbers")
    if first == 0.0 and second < 0.0:
        if timestep is None:
            raise UserError(
                "timestep", "none", "the step: solref '0 -D' bounces in one step, e = D h - 1"
            )
        e = -second * timestep - 1.0
        require("solref", solref, 0.0 < e <= 1.0, f"D between 1/h and 2/h: e = D h - 1 is {e:.4g}")
        return e
    if first < 0.0 and second <= 0.0:
        return float(kv.restitution(-second / (2.0 * math.sqrt(-first)), kv.Ending.FORCE))
    want = "'-stiffness -damping', 'timeconst dampratio' or '0 -damping'"
    require("solref", solref, first > 0.0 and second >= 0.0, want)
    return float(kv.restitution(second, kv.Ending.FORCE))


def _others(contact: OneContact) -> Iterator[SystemValue]:
    """Rows for the paper, and for libraries that hcbench does not run. A contact without an e, see
    `OneContact.restitution`, has only those rows that α alone decides.
    """
    alpha = contact.alpha
    e = contact.restitution
    yield SystemValue("paper", "α", (alpha,), "s/m", "e = 1 - α v for small α v")
    yield SystemValue(
        "paper", "λ/k", (1.5 * alpha,), "s/m", "F = k x^n (1 + (λ/k) v), eqs. (15), (16)"
    )
    yield SystemValue(
        "Simbody", "dissipation", (alpha,), "s/m", "c = α: its force has the 3/2 written out"
    )
    if e is None:
        return
    assert contact.speed is not None
    at = contact.at
    yield SystemValue("Chrono", "restitution", (e,), "", f"{at}; NSC")
    if (asked := _smc_for(e)) is not None:
        note = f"{at}; Hooke or Hertz, which do not pull: set to {e:.4g}, they give {_smc_delivers(e):.4g}"
        yield SystemValue("Chrono", "restitution (SMC)", (asked,), "", note)
    flores = _flores_for(alpha * contact.speed)
    note = "SMC with the Flores model at that impact speed: the number to set, to get this e"
    yield SystemValue("Chrono", "restitution (Flores)", (flores,), "", note)
    yield SystemValue("LAMMPS", "damping coeff_restitution", (e,), "", f"{at}; hertz and hooke")
    note = (
        f"{at}; before the release of 2 September 2026 it delivered {_old_tsuji(e):.4g} for this e"
    )
    yield SystemValue("LAMMPS", "damping tsuji", (e,), "", note)


def _smc_delivers(asked: float) -> float:
    """e that Chrono's SMC contact, Hooke or Hertz, has where it is set to `asked` (above 0, up to
    1).

    Its contact ends at F = 0, before the surface; ζ = -ln e/sqrt(π² + ln² e) would give e at the
    surface. The Hertz model's damping, √5 ζ √(m k) x^(1/4) v, makes it the linear one over x^(5/4)
    and ∫x^(1/4) dt, so both end alike (see `_old_tsuji`).
    """
    log = math.log(asked)
    return float(kv.restitution(-log / math.hypot(math.pi, log), kv.Ending.FORCE))


def _smc_for(e: float) -> float | None:
    """The e to set in SMC so that it gives e, above 0 and up to 1; None below the least that it can
    give.
    """
    if e == 1.0:
        return 1.0
    # Damping, however large, leaves an e where the contact ends at F = 0.
    least = 1e-300
    if e > 1.0 or e <= _smc_delivers(least):
        return None
    return math.exp(root(lambda log: _smc_delivers(math.exp(log)) - e, math.log(least), 0.0, 1e-14))


def _flores_for(alpha_speed: float) -> float:
    """The e to ask Flores for: χ = 8 (1 - e)/(5 e) of `published` has to be (3/2) α v."""
    return 8.0 / (8.0 + 5.0 * 1.5 * alpha_speed)


def _old_tsuji(e: float) -> float:
    """Restitution that LAMMPS' tsuji damping delivered for an e asked for, 0 to 1, before its
    missing factor √2 was corrected.

    F = k x^(3/2) + A √(m k) x^(1/4) v is a damped linear spring in x^(5/4) with ζ = A/√5
    (D. Antypov, J. A. Elliott, "On an analytical solution for the damped Hertzian spring",
    EPL 94, 2011, 50004, doi 10.1209/0295-5075/94/50004). The polynomial for A is that of
    the manual; A/√2 was taken for A.
    """
    a = 1.2728 + e * (
        -4.2783 + e * (11.087 + e * (-22.348 + e * (27.467 + e * (-18.022 + e * 4.8218))))
    )
    return float(kv.restitution(max(a, 0.0) / math.sqrt(5.0), kv.Ending.SURFACE))
