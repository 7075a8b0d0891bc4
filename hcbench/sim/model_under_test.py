"""A user's own model: the pairs of its parts that can collide, as text and as records; and what an engine
must offer so that a pair of them can be measured.
"""

from __future__ import annotations

import itertools
import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote
from typing import Any

from hcbench.laws.restitution import RestitutionCurve
from hcbench.sim.packages import Packages
from hcbench.sim.promise import Promise
from hcbench.sim.rest import Carried, Rest, let_down
from hcbench.sim.world import World
from hcbench.system.errors import PairUnnamed, UserError
from hcbench.system.text import number, sanitized, table
from hcbench.terms.impact import Impact, Launch

# Pairs that can collide.

# Pairs that an error names.
_NAMED = 6


@dataclass(frozen=True)
class CandidatePair:
    """Two geoms of a model that its engine lets collide.

    bodies, geoms, types: of the two, the one that moves first.
    pair: what to say to `measure`.
    joint: what moves one of the two, in words.
    effective_mass: 1 / (J M^-1 J^T) where they are nearest, kg; NaN where it is unknown.
    distance: between them at the start, m.
    touching: whether they touch there.
    touching_in: names of all poses in which they do.
    settings: the contact's parameters in force, in the engine's own words.
    """

    bodies: tuple[str, str]
    geoms: tuple[str, str]
    types: tuple[str, str]
    pair: str
    joint: str
    effective_mass: float
    distance: float
    touching: bool
    touching_in: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)


def as_records(pairs: Sequence[CandidatePair]) -> list[dict[str, Any]]:
    """The pairs as `--json` prints them, an object each."""
    records = []
    for pair in pairs:
        content = {
            "pair": pair.pair,
            "bodies": list(pair.bodies),
            "geoms": list(pair.geoms),
            "types": list(pair.types),
            "joint": pair.joint,
            "effective_mass_kg": pair.effective_mass,
            "distance_m": pair.distance,
            "touching": pair.touching,
            "touching_in": list(pair.touching_in),
            "contact": dict(pair.settings),
        }
        records.append(content)
    return records


def as_table(pairs: Sequence[CandidatePair], longest: int = 40) -> str:
    """The pairs as a table, in the order given, with notes on poses and contact settings below it.

    longest: rows at most.
    Distances are m, masses kg.
    """
    if not pairs:
        return "no two parts of this model can meet\n"
    rows = []
    # By the text of a contact's settings, the pairs that have it.
    alike: dict[str, list[str]] = {}
    for p in pairs[:longest]:
        touching = number(p.distance, ".3g")
        if p.touching:
            touching = "yes"
        mass = number(p.effective_mass, ".4g")
        rows.append(
            (sanitized(p.pair), f"{p.types[0]}, {p.types[1]}", touching, mass, sanitized(p.joint))
        )
        parameters = [f"{name} {_text(value)}" for name, value in p.settings.items()]
        setting = sanitized("; ".join(parameters))
        alike.setdefault(setting, []).append(sanitized(p.pair))
    header = ("--pair", "types", "touching, or m", "kg", "moved by")
    lines = table(header, rows)
    in_other_poses = []
    for p in pairs:
        poses = ", ".join(p.touching_in)
        if poses and not p.touching:
            in_other_poses.append(sanitized(f"{p.pair} in {poses}"))
    if in_other_poses:
        lines.append(f"touching in other poses: {'; '.join(in_other_poses[:_NAMED])}")
    if len(pairs) > longest:
        lines.append(f"and {len(pairs) - longest} more: --json lists all")
    lines += [f"contact of {_some(of)}: {setting}" for setting, of in alike.items() if setting]
    return "\n".join(lines) + "\n"


def _some(names: Sequence[str]) -> str:
    """The first of some names, and how many more there are."""
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def _text(value: Any) -> str:
    """A number or several in four digits."""
    if isinstance(value, list | tuple):
        return " ".join(f"{x:.4g}" for x in value)
    return f"{value:.4g}"


def in_order(pairs: Sequence[CandidatePair]) -> list[CandidatePair]:
    """Pairs in order: touching at the start, touching in another pose, then the nearest."""
    far = math.inf

    def rank(p: CandidatePair) -> tuple[bool, bool, float]:
        return not p.touching, not p.touching_in, p.distance if math.isfinite(p.distance) else far

    return sorted(pairs, key=rank)


# Advice where no pair is named.
LISTS_PAIRS = "`hcbench measure` without --pair lists all"


def choice_error(pairs: Sequence[CandidatePair]) -> UserError:
    """The error to raise for a request that names no pair, in a model with several pairs that can
    meet, or with none.

    pairs: those that can meet, those that touch first.
    """
    if not pairs:
        got = "none given, and no two parts of the model can meet"
        return UserError("pair", got, "a model with two parts that collide, one of which moves")
    some = "; ".join(f"{p.pair}{' (touching)' * p.touching}" for p in pairs[:_NAMED])
    more = ""
    if len(pairs) > _NAMED:
        more = f"; and {len(pairs) - _NAMED} more"
    return PairUnnamed(
        "pair",
        f"none given, and the model leaves a choice of {len(pairs)}: {some}{more}",
        "the names of two bodies or geoms",
        f"Try --pair {quote(pairs[0].pair)}; {LISTS_PAIRS}, and --all measures those that touch",
    )


# Over the default band of models, m/s.
DEFAULT_SPEEDS = (0.1, 0.15, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0)
# Phases at each speed, where in a step the contact starts.
DEFAULT_PHASES = 4
# Two of the causes in `Facts.shares`.
CONTACT = "the contact of the pair"
WEIGHT = "gravity and motion of the links"
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Request:
    """Options of a measurement in a user's model: the pair, its launches
    and the pose they start from.

    pair: names of the two, moving one first; None where the model leaves no choice.
    speeds: launch speeds, m/s. phases: where in a step the contact starts, each 0 ... 1.
    timestep: s; None: the model's own. gravity: m/s^2; None: the model's own.
    key: name or number of the keyframe that everything starts from, "qpos0" for the model's zero;
        None: the first keyframe, or qpos0 where there is none.
    height: clearance at release, m; None: two to three steps of flight.
    pose: (joint, values) to start from in place of the keyframe's, m and rad; or fields of a state such as
        "qpos", whole.
    packages: (name, folder) of ROS packages that the model names its files by.
    move: what is launched: "base:", "body:NAME" or "joint:NAME"; None: as the engine chooses.
    coming_from: unit vector from the other to where the moving body comes from; None: the nearest way.
    actuators: whether the model's actuators hold and push as it says; else they are off.
    angle: from the normal, rad; each launch is made at each of them. along: the way that oblique launches
        take, any vector that is not normal to the two; None: x, or y where the normal is along x.
    spin: see `Launch`, rad/s.
    adapt_phases: one phase only at speeds where the contact takes so many steps that the phase does not
        matter, more of them where e scatters.
    """

    pair: tuple[str, str] | None = None
    speeds: tuple[float, ...] = DEFAULT_SPEEDS
    phases: tuple[float, ...] = tuple((i + 0.5) / DEFAULT_PHASES for i in range(DEFAULT_PHASES))
    timestep: float | None = None
    gravity: Vector | None = None
    key: str | None = None
    height: float | None = None
    pose: tuple[tuple[str, tuple[float, ...]], ...] = ()
    coming_from: Vector | None = None
    actuators: bool = True
    adapt_phases: bool = False
    angle: tuple[float, ...] = (0.0,)
    along: Vector | None = None
    spin: Vector = (0.0, 0.0, 0.0)
    move: str | None = None
    packages: Packages = ()

    @property
    def is_oblique(self) -> bool:
        """True if any launch has an angle or spin."""
        return any(self.angle) or any(self.spin)

    def launches(self) -> list[Launch]:
        """One for each speed, angle and phase, speeds in order."""
        sent = itertools.product(self.speeds, self.angle, self.phases)
        return [Launch.at_angle(a, v, p, self.height, self.spin) for v, a, p in sent]


@dataclass(frozen=True, slots=True)
class Suspect:
    """Something in a model that may keep it from bouncing as asked.

    code: short and stable.
    title: the sentence that names it.
    evidence: numbers found.
    fix: text to paste.
    apply: makes the fix in the engine's own form of the model; None where it cannot be tried.
    always_reported: even if e is correct, because it concerns the model's settings.
    assumed_e: e that the fix is written for, where the user named no target; e is then compared
    with it.
    named_if_half: reported, too, where it alone takes away half of the error and another fix takes
    all.
    apply_last: its fix depends on the step and integrator, so it is made after those that change
    them.
    """

    code: str
    title: str
    evidence: str
    fix: str
    apply: Callable[[Any], None] | None = None
    always_reported: bool = False
    assumed_e: float | None = None
    apply_last: bool = False
    named_if_half: bool = False


@dataclass(frozen=True, slots=True)
class Facts:
    """Properties of a model and of its pair, as an engine reads them from the model, SI.

    pair: as the model names the two, the moving body first.
    moved: what moves it, as a phrase.
    effective_mass: 1 / (J M^-1 J^T) along the contact normal, kg.
    normal: unit vector, from the moving body towards the other.
    settings: the engine's own words for what decides the bounce.
    asked: e that the model asks for at each speed of the request; () where it cannot be said.
    asked_description: what in the model asks for it.
    notes: sentences a reader must know.
    warnings: those of the notes by which the numbers may be wrong, so that a verdict has them too.
    friction: Coulomb's μ of the pair, NaN where it cannot be said.
    point: where the two meet, m.
    shares: what took how much off the approach speed during the contact, over the speed at touch,
    by cause, in the launch in which joints and actuators took most; empty where there are none.
    promise: what hcbench promised of the pair, where it wrote the setting.
    changed: codes of the suspects that are not as they were when it promised.
    in_text: the two as a text to paste calls them, where that is not by their names; else ().
    """

    engine: str
    version: str
    model: str
    pair: tuple[str, str]
    moved: str
    timestep: float
    gravity: Vector
    effective_mass: float
    normal: Vector
    settings: Mapping[str, Any] = field(default_factory=dict)
    asked: tuple[float, ...] = ()
    asked_description: str = ""
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    friction: float = math.nan
    point: Vector = (math.nan, math.nan, math.nan)
    shares: Mapping[str, float] = field(default_factory=dict)
    promise: Promise | None = None
    changed: tuple[str, ...] = ()
    in_text: tuple[str, ...] = ()

    @property
    def more_than_contact(self) -> float:
        """Changes of the approach speed during the contact by causes other than the contact and
        gravity: the sum of their absolute values, over the speed at touch; NaN where unknown.
        """
        if not self.shares:
            return math.nan
        return sum(
            abs(share) for name, share in self.shares.items() if name not in (CONTACT, WEIGHT)
        )

    @property
    def meeting(self) -> str:
        """Phrase of the contact point, m, and of the side from which the moving body approaches."""
        along_z = max(range(3), key=lambda axis: abs(self.normal[axis])) == 2
        side = "from the side"
        if along_z:
            side = "from below" if self.normal[2] > 0 else "from above"
        way = _three_digits(self.normal)
        return f"at {_three_digits(self.point)} m; {self.pair[0]} approaches {side}, along {way}"


def _three_digits(vector: Iterable[float]) -> str:
    # Adding 0.0 leaves no "-0" to read.
    return " ".join(f"{x + 0.0:.3g}" for x in vector)


@dataclass(frozen=True, slots=True)
class Output:
    """Destination of a setting that is to be written into a model.

    folder: of the model; None: that of the source.
    include: the name of a file of its own for its lines; "" for none.
    engine, version: that have to load it, such as (3, 5); () for the installed one.
    """

    folder: Path | None = None
    include: str = ""
    engine: str = ""
    version: tuple[int, ...] = ()


# The source itself, for the installed engine.
BESIDE = Output()


@dataclass(frozen=True, slots=True)
class Texts:
    """A setting as text.

    paste: lines for the model or script.
    written: the whole model with them, or "".
    include: a file of the lines alone, or "".
    """

    paste: str
    written: str = ""
    include: str = ""


@dataclass(frozen=True, slots=True)
class ModelSetting:
    """A setting for pairs in their own model, to be tried there.

    open: the model with the setting, for the launches of a request.
    texts: of it, with what was promised of each pair.
    slides: true where friction may change e of bodies that slide, so that oblique launches judge
    it.
    source: the whole model with the setting, as the engine opens it; None where it has none.
    """

    name: str
    notes: tuple[str, ...]
    open: Callable[[Request], ModelUnderTest]
    texts: Callable[[Sequence[Promise], Output], Texts]
    slides: bool = False
    source: Any = None


class ModelUnderTest(World):
    """A user's own model with a pair of bodies brought to touch: what
    `measure` needs beyond a world.
    """

    @abstractmethod
    def facts(self) -> Facts:
        """Return the properties of the model and of its pair."""

    @abstractmethod
    def suspects(self, impacts: Sequence[Impact], wanted: RestitutionCurve | None) -> list[Suspect]:
        """Return settings that may keep this pair from bouncing as `wanted`, likeliest first."""

    def at_rest(self) -> Rest | None:
        """Lay one body on the other and return how it lies after a while; None
        if nothing holds them together.
        """
        return let_down(self)

    def carried(self) -> Carried:
        """Press the pair together where it rests, push it along its plate, and tilt it; without
        loads where nothing holds the two together, or where the engine does not measure that.
        """
        return Carried()

    def rest_suspects(self) -> list[Suspect]:
        """Return settings that may keep the two from lying still and
        shallow, besides those of `suspects`.
        """
        return []

    @abstractmethod
    def fixed(self, suspects: Sequence[Suspect]) -> ModelUnderTest:
        """The same pair with the fixes of `suspects` made, in a copy of the model."""

    @property
    def step_cost(self) -> float:
        """Cost of a step over that of a ball on a plane; roughly, and the same on every machine."""
        return 1.0


# Densities that no body has, as signs of a model in other units than metres and kilograms.

# Density, kg/m³, over the boxes about each of a body's shapes. Lead has ten times less in a model in
# centimetres; of 1 720 bodies in three engines' packages none is below 0.4.
_LIGHTEST = 0.1
# The same over the box around all of a body with its frames; none of those bodies is above 4e4.
_HEAVIEST = 2e5
# Densities of robots and things, kg/m³: foam to lead.
_USUAL = (20.0, 2e4)


def unit_notes(name: str, mass: float, shapes: float, around: float) -> list[str]:
    """A list of one sentence, if the density of a body shows that the model is not in metres and
    kilograms; empty where the density is plausible, or the body has no mass or no size.

    name: of the body.
    mass: of all that hangs on it, kg.
    shapes: volume of the boxes about each of its shapes, m³; around: of the box about all of them
    and their frames, m³.
    """
    if not (mass > 0.0 and shapes > 0.0 and around > 0.0):
        return []
    # The box about all is larger than what fills it: it can only show a body too heavy.
    density = mass / shapes
    least_density = mass / around
    if density < _LIGHTEST:
        units = "millimetres"
        # Centimetres for metres make a density 1e6 times too small.
        if _is_usual(1e6 * density):
            units = "centimetres, or in millimetres and grams"
        return [_sentence(name, density, units)]
    if least_density > _HEAVIEST:
        return [_sentence(name, least_density, "grams")]
    return []


def _is_usual(density: float) -> bool:
    low, high = _USUAL
    return low <= density <= high


def _sentence(name: str, density: float, units: str) -> str:
    return (
        f"{name} weighs {density:.2g} kg/m^3: is the model in {units}? hcbench reads metres, "
        "kilograms and seconds."
    )
