"""Targets: the bounce that a setting should match, and the best constant e for one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from hcbench import scoring
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.kelvin_voigt import Ending, damping_ratio_for
from hcbench.laws.restitution import MeasuredRestitution, Restitution, RestitutionCurve
from hcbench.laws.solvers import root
from hcbench.system.errors import SettingError
from hcbench.system.text import rounded_up
from hcbench.terms.arguments import checked_fields
from hcbench.terms.impact import Floats
from hcbench.terms.resolution import (
    STEPS_MOST,
    STEPS_OF_A_LOOP,
    STEPS_OF_A_SOFTENED,
    STEPS_OF_A_SPRING,
)
from hcbench.terms.units import INCH

# Speeds that Hunt and Crossley's law was fitted over, m/s.
PAPER = (1.0 * INCH, 20.0 * INCH)
# Speeds of a band at which the shortest contact is looked for.
_SPEEDS = 65
# In g h: slower impacts end within the step that finds them, and the body stays down.
SLOWEST = 1.6


def default_band(timestep: float, gravity: float) -> tuple[float, float]:
    """Default band of speeds, m/s: the paper's 1 to 20 in/s, cut below the slowest speed at which a
    body can bounce at a step (s) under gravity (m/s²).
    """
    slowest, fastest = PAPER
    low = max(slowest, _above(SLOWEST * gravity * timestep))
    return low, max(fastest, 4.0 * low)


def _above(speed: float) -> float:
    """The next speed above that has three digits, m/s; 0 for 0."""
    if not speed > 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(speed)) - 2)  # of the third digit
    # A little more: a speed of three digits must not round down.
    steps = math.floor(speed / unit + 1e-9) + 1
    return float(f"{unit * steps:.3g}")


def why_cut(low: float, timestep: float, gravity: float) -> str:
    """Explain why a band begins at `low` m/s; "" if that is the user's or the paper's own speed."""
    if low <= PAPER[0] or low != default_band(timestep, gravity)[0]:
        return ""
    step = f"{1e3 * timestep:.3g} ms"
    return f"The band begins above 1 in/s: below {low:.2g} m/s a {step} step cannot bounce."


TargetKind = Literal["law", "linear", "points", "constant"]
# The law is worth a try if its misfit is below this share of the error of one e for all speeds.
_GOOD_FIT = 0.25
_WORDS = {"law": "α of the law, by --alpha", "linear": "1 - α v, by --alpha and --target linear"}
_WORDS |= {"constant": "one e, by --restitution"}


@checked_fields
@dataclass(frozen=True)
class Target:
    """The bounce to match.

    law: eq. (16).
    mass: effective mass of the pair, kg.
    timestep: the engine's, s.
    speed_min, speed_max: the band of impact speeds, m/s.
    reading: "law" for e of (16), "linear" for e = 1 - α v_i of (2), "points" for `points`.
    points: pairs (v m/s, e), straight between them and constant beyond; one pair is a constant e.
    gravity: into the plate, m/s².
    friction: coefficient of Coulomb friction.
    friction_asked: whether the user asked for it; else it is the engine's own default.
    corners: points of the body that meet the plate at once, as the 4 of a flat box.
    corners_asked: whether the user asked for them; else any body may meet the plate.
    material: the measurement that the target is taken from, in a line; "" for numbers of a user.

    Raises SettingError for a mass, step or band that is not above 0, and for an e outside 0 ... 1
    or that rises with v.
    """

    law: HuntCrossley
    mass: float
    timestep: float
    speed_min: float
    speed_max: float
    reading: Literal["law", "linear", "points"] = "law"
    points: tuple[tuple[float, float], ...] = ()
    gravity: float = 0.0
    friction: float = 0.0
    corners: int = 1
    friction_asked: bool = True
    corners_asked: bool = True
    material: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        """Check the fields: SettingError for a mass, step or speed that is not above 0, gravity or
        friction below 0, less than one corner, and an e(v) that rises or leaves 0 ... 1.
        """
        for slot, value, unit in (
            ("mass", self.mass, "kg"),
            ("timestep", self.timestep, "s"),
            ("lowest speed", self.speed_min, "m/s"),
        ):
            if not 0 < value < np.inf:
                raise SettingError(slot, f"{value!r} {unit}", f"above 0 {unit}")
        for slot, value in (("gravity", self.gravity), ("friction", self.friction)):
            if not 0 <= value < np.inf:
                raise SettingError(slot, f"{value!r}", "0 or more")
        if self.corners < 1:
            raise SettingError("corners", f"{self.corners!r}", "1 or more")
        if not self.speed_min <= self.speed_max < np.inf:
            got = f"{self.speed_min!r} ... {self.speed_max!r} m/s"
            raise SettingError("speeds", got, "the lower speed first")
        if isinstance(self.curve, MeasuredRestitution):
            _require_falling(self.curve)
        elif self.reading == "linear" and (loss := self.law.alpha * self.speed_max) > 1:
            raise SettingError(
                "speeds",
                f"1 - α v falls to {1 - loss:.3g} at {self.speed_max:.4g} m/s",
                "a restitution within 0 ... 1",
                f"Keep below {1 / self.law.alpha:.4g} m/s or take the reading 'law'",
            )

    @property
    def is_constant(self) -> bool:
        """True if the target is one e for all speeds of its band."""
        if self.speed_min == self.speed_max:
            return True
        if self.points:
            return len({e for _, e in self.points}) == 1
        return self.law.alpha == 0

    @property
    def kind(self) -> TargetKind:
        """The kind of the target: its reading, or "constant" for points that are one e."""
        if self.reading == "points" and self.is_constant:
            return "constant"
        return self.reading

    @property
    def curve(self) -> RestitutionCurve:
        """e wanted over the impact speed."""
        if self.reading == "points":
            return MeasuredRestitution(self.points)
        return Restitution(self.law.alpha, self.reading)

    def restitution(self, speed: Floats | float) -> Floats:
        """e wanted at impact speeds (m/s), same shape."""
        return self.curve.at(speed)

    def described(self) -> tuple[str, str]:
        """Return the option by which the user gave the target, and its value in words."""
        if self.reading == "points":
            if len(self.points) > 1:
                return "points", f"{len(self.points)} pairs of v and e"
            return "restitution", "one e for all speeds"
        return "target", _WORDS[self.reading].partition(",")[0]

    def fitting_law(self) -> str:
        """Advice to take the law that fits the target's points, with its α, as a sentence; "" if it
        has a single point or none, and if no law fits them.
        """
        if len(self.points) < 2:
            return ""
        measured = MeasuredRestitution(self.points)
        speeds = measured.speeds
        e = measured.values
        alpha, rms = scoring.fit_alpha(speeds, e)
        if rms > _GOOD_FIT * float(np.ptp(e)) / 2:
            return ""
        return f"α = {alpha:.4g} s/m fits these pairs with rms {rms:.1g}: try --alpha {alpha:.4g}"


def _require_falling(measured: MeasuredRestitution) -> None:
    """Raise SettingError for points whose speeds do not rise, or whose e rises with speed; it names
    the first two neighbours of this kind.
    """
    speeds = measured.speeds
    values = measured.values
    # Of two neighbours the first, where e rises or the speed does not.
    wrong = np.flatnonzero((np.diff(values) > 0) | (np.diff(speeds) <= 0))
    if wrong.size:
        i = int(wrong[0])
        before = f"{values[i]:.4g} at {speeds[i]:.4g} m/s"
        after = f"{values[i + 1]:.4g} at {speeds[i + 1]:.4g} m/s"
        got = f"e goes from {before} to {after}"
        raise SettingError("restitution", got, "one e per speed, not rising with speed")


def require_kind(target: Target, recipe: str, kinds: Sequence[TargetKind], instead: str) -> None:
    """Raise SettingError for a target of a kind that a recipe does not serve.

    recipe: its name.
    kinds: those that it serves.
    instead: recipes for the others, as words; or "".
    """
    if target.kind in kinds or target.reading in kinds:
        return
    slot, given = target.described()
    expected = " or ".join(_WORDS[kind] for kind in kinds)
    advice = []
    if instead:
        advice.append(f"Use {instead} for another restitution")
    fit = target.fitting_law()
    if fit:
        advice.append(fit)
    raise SettingError(
        slot, f"{given}, which {recipe!r} does not serve", expected, ". ".join(advice)
    )


# The best that one number can do: a constant e for a band of speeds, and the spring-damper that
# has it.

# ln e of a spring-damper that only pushes tends to -2 at critical damping.
LOWEST_UNDERDAMPED = math.exp(-2.0)


def minimax_constant(target: Target) -> tuple[float, float]:
    """The constant e with the least largest error over a target's band of speeds, and that error.

    e falls with speed, so the error is largest at both ends of the band and the best constant is
    halfway between the e there.
    """
    ends = target.restitution(np.array([target.speed_min, target.speed_max]))
    high = float(ends.max())
    low = float(ends.min())
    return (high + low) / 2, (high - low) / 2


def contact_time(target: Target, steps: float = STEPS_OF_A_SPRING) -> float:
    """Contact time, s, of the spring and damper that replace the law: the law's contact time at the
    geometric mean speed of the band, or `steps` time steps if that is longer.

    A coarse step so still sees a contact; the spring is then softer than the law.
    """
    speed = math.sqrt(target.speed_min * target.speed_max)
    duration = float(closed_form.duration(target.law, target.mass, speed))
    return max(duration, steps * target.timestep)


def implicit_spring_damper(target: Target, duration: float, instead: str) -> tuple[float, float]:
    """Stiffness k, N/m, and damping c, N s/m, of an implicit contact with the best constant e of
    the target: F = k (x + h v') + c v', with v' the rate after the step h.

    duration: of the contact, s.
    instead: recipe to name in an error.
    The steps have the poles exp((-β ± i ω) h) of the continuous contact x'' + 2 β x' + (ω² + β²) x
    = 0 exactly: m exp(2 β h) = m + h c + h² k, so c is smaller than a continuous damper's by k h.
    Where c would be below 0 the contact is made slower until it is not.
    Raises SettingError for e = 1, since such a step always damps, and for an e that only an
    overdamped contact has.
    """
    e, _ = minimax_constant(target)
    h = target.timestep
    m = target.mass
    if e >= 1.0:
        raise SettingError("restitution", "1", "e below 1", "An implicit step always damps")
    beta, omega = spring_damper_rates(e, duration, instead)
    # c >= 0 asks for exp(2 β h) - 1 >= h² k / m, nearly 2 β >= ω² h.
    slower = max(1.0, (omega**2 + beta**2) * h / (2 * beta) * (1 + 1e-9))
    # The estimate is a little short where a step is long beside the contact: 2 % at a time.
    while True:
        # The inverse poles are grow exp(± i turn).
        grow = math.exp(beta / slower * h)
        turn = omega / slower * h
        # Per unit mass, 1/s² and 1/s.
        stiffness = (grow**2 + 1 - 2 * grow * math.cos(turn)) / h**2
        damping = (grow**2 - 1) / h - stiffness * h
        if damping >= 0:
            return m * stiffness, m * damping
        slower *= 1.02


def spring_damper_rates(restitution: float, duration: float, instead: str) -> tuple[float, float]:
    """β and ω, 1/s, of the contact x'' + 2 β x' + (ω² + β²) x = 0 that has this e and duration (s).

    instead: recipe to name in an error.
    The contact only pushes, so it ends when the force is 0, before x is. With the damping ratio
    written as sin ψ, that is at ω t = π - 2 ψ, and β = ω tan ψ.
    Raises SettingError for an e of exp(-2) or less, which only an overdamped contact has, and for
    one above 1.
    """
    if not LOWEST_UNDERDAMPED < restitution <= 1.0:
        raise SettingError(
            "restitution",
            f"{restitution:.4g}",
            f"e within {LOWEST_UNDERDAMPED:.4f} ... 1 for a spring and damper",
            f"Use `{instead}`, which has any e",
        )
    psi = math.asin(damping_ratio_for(restitution, Ending.FORCE))
    omega = (math.pi - 2 * psi) / duration
    return omega * math.tan(psi), omega


def one_way_spring_damper(target: Target, duration: float, instead: str) -> tuple[float, float]:
    """Stiffness k, N/m, and damping c, N s/m, of a contact that damps on the way in alone (F = k x
    + c x', then k x), with the best constant e of the target.

    duration: of the contact, s.
    instead: recipe to name in an error.
    The way in is a damped oscillator's from touch to its first standstill. So with ζ = c/(2 √(k m))
    and ω² = k/m, e = exp(-ζ/√(1-ζ²) acos ζ), and the contact lasts (acos ζ/√(1-ζ²) + π/2)/ω.
    Raises SettingError for an e of exp(-0.99) = 0.372 or less, and for one above 1.
    """
    e, _ = minimax_constant(target)

    def way_in(zeta: float) -> float:
        """Duration of the way in times ω, for a damping ratio ζ below 1."""
        return math.acos(zeta) / math.sqrt(1.0 - zeta**2)

    # At ζ = 1, which is critical damping, e is exp(-1): near it ζ is not told by e any more.
    if not math.exp(-0.99) < e <= 1.0:
        raise SettingError("restitution", f"{e:.4g}", "e within 0.372 ... 1", f"Use `{instead}`")
    zeta = root(lambda z: z * way_in(z) + math.log(e), 0.0, 1.0 - 1e-9, 1e-15)
    omega = (way_in(zeta) + math.pi / 2) / duration
    k = target.mass * omega**2
    return k, 2.0 * zeta * math.sqrt(k * target.mass)


def require_end(target: Target) -> None:
    """Raise SettingError for a time step so short that an evaluation would not end: with more than
    STEPS_MOST steps in the law's shortest contact.
    """
    steps = steps_per_contact(target)
    if steps > STEPS_MOST:
        got = f"{target.timestep:g} s, of which {steps:.2g} are the law's shortest contact"
        nearest = target.timestep * steps / STEPS_MOST
        raise SettingError(
            "timestep", got, f"up to {STEPS_MOST:g} steps", f"Use {rounded_up(nearest)} s or more"
        )


def steps_per_contact(target: Target) -> float:
    """Time steps in the law's shortest contact over the band."""
    shortest, _ = contact_times(target, target.law)
    return shortest / target.timestep


def contact_times(target: Target, law: HuntCrossley) -> tuple[float, float]:
    """Shortest and longest contact, s, of a law over the target's mass and band of speeds.

    A contact lasts longer at lower speeds by elasticity (not with n = 1), and at higher ones by
    loss; so the shortest may be at either end of the band, or between them. It is looked for at
    enough speeds to be within 0.1 %, and the ends are among them.
    """
    speeds = np.geomspace(target.speed_min, target.speed_max, _SPEEDS)
    times = closed_form.duration(law, target.mass, speeds)
    return float(times.min()), float(times.max())


def resolvable_law(target: Target, softened_steps: float = STEPS_OF_A_SOFTENED) -> HuntCrossley:
    """Law of the target, with a lower stiffness if its shortest contact over the band lasts less
    than STEPS_OF_A_LOOP time steps.

    A softened contact lasts `softened_steps` time steps at the speed at which it is shortest: the
    duration goes as k to the power -1/(n + 1).
    """
    steps = steps_per_contact(target)
    if steps >= STEPS_OF_A_LOOP:
        return target.law
    softer = (steps / softened_steps) ** (target.law.exponent + 1.0)
    return replace(target.law, stiffness=target.law.stiffness * softer)
