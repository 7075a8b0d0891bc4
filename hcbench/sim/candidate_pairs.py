"""Pairs of parts that can collide in a user's model, as an engine lists
them: as text and as records.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from shlex import quote
from typing import Any

from hcbench.system.errors import UserError
from hcbench.system.text import number, sanitized, table

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
    return [
        {
            "pair": p.pair,
            "bodies": list(p.bodies),
            "geoms": list(p.geoms),
            "types": list(p.types),
            "joint": p.joint,
            "effective_mass_kg": p.effective_mass,
            "distance_m": p.distance,
            "touching": p.touching,
            "touching_in": list(p.touching_in),
            "contact": dict(p.settings),
        }
        for p in pairs
    ]


def as_table(pairs: Sequence[CandidatePair], longest: int = 40) -> str:
    """The pairs as a table, in the order given, with notes on poses and contact settings below it.

    longest: rows at most. Distances are m, masses kg.
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


def choice_error(pairs: Sequence[CandidatePair]) -> UserError:
    """The error for a request that names no pair, where the model leaves a choice, or none.

    pairs: those that can meet, those that touch first. The error is returned, not raised.
    """
    if not pairs:
        got = "none given, and no two parts of the model can meet"
        return UserError("pair", got, "a model with two parts that collide, one of which moves")
    some = "; ".join(f"{p.pair}{' (touching)' * p.touching}" for p in pairs[:_NAMED])
    more = ""
    if len(pairs) > _NAMED:
        more = f"; and {len(pairs) - _NAMED} more"
    return UserError(
        "pair",
        f"none given, and the model leaves a choice of {len(pairs)}: {some}{more}",
        "the names of two bodies or geoms",
        f"Try --pair {quote(pairs[0].pair)}; `hcbench pairs` lists all, and --all measures those that touch",
    )
