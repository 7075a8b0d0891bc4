"""Requests from what a user writes: text with units, lists, single numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any, Unpack

from hcbench.measuring.pose import read_direction, read_joints, read_state
from hcbench.sim.model_under_test import Request, Vector
from hcbench.sim.packages import read_packages
from hcbench.system.errors import QuantityError, UserError
from hcbench.system.text import split_names
from hcbench.terms import units
from hcbench.terms.arguments import checked
from hcbench.terms.options import BodyPair, LaunchOptions, Quantity

MAX_PHASES = 1000
LONGEST_LIMIT_S = 1e6
# Three numbers with blanks alone between them.
_THREE_NUMBERS = re.compile(r"\s*[-+\d.e]+\s+[-+\d.e]+\s+[-+\d.e]+.*")


@checked
def make_request(pair: BodyPair | None = None, **launch: Unpack[LaunchOptions]) -> Request:
    """A request from what a user writes, text with units parsed.

    pair: "a,b" or ("a", "b"), first the one that moves.
    launch: as `LaunchOptions` describes it.

    Raises UserError, and QuantityError for numbers and units.
    """
    given: dict[str, Any] = {name: value for name, value in launch.items() if value is not None}
    if "along" in given and "angle" not in given and "spin" not in given:
        raise QuantityError(
            "along", f"{launch['along']!r}, and nothing oblique", "an angle or a spin too"
        )
    if "height" in given and "angle" in given:
        advice = "An angle holds at the first contact, a height at release; spin can be given with a height"
        raise UserError("angle", "given with height", "one of the two", advice)
    packages = read_packages(given.pop("package", {}))
    state = read_state(given.pop("state", None))
    joints = read_joints(given.pop("qpos", None))
    fields: dict[str, Any] = {}
    for name, value in given.items():
        read = _READ.get(name)
        fields[name] = value if read is None else read(value)
    return Request(
        pair=read_pair(pair),
        # Joints that are named replace those of the state.
        pose=(*state, *joints),
        packages=packages,
        adapt_phases="phases" not in given,
        **fields,
    )


def _each_once(
    quantity: str, name: str, kind: str, **bounds: float
) -> Callable[[Any], tuple[float, ...]]:
    """Reads several quantities, each given once."""

    def read(given: Any) -> tuple[float, ...]:
        values = tuple(units.parse_values(given, quantity, name, **bounds).tolist())
        if len(set(values)) != len(values):
            raise QuantityError(name, f"{given!r} has {kind} twice", f"each {kind.split()[1]} once")
        return values

    return read


def _direction(along: Any) -> Vector:
    values = units.parse_values(along, "number", "along").tolist()
    if len(values) != 3:
        raise QuantityError("along", f"{along!r}", "three numbers", "Write for example '0, 1, 0'")
    return values[0], values[1], values[2]


def read_pair(pair: BodyPair | None) -> tuple[str, str] | None:
    """Two names of "a,b" or a sequence of two; None for None. Raises UserError for anything else."""
    if pair is None:
        return None
    names = [_body_name(part) for part in _pair_parts(pair)]
    if len(names) != 2 or not all(names):
        raise UserError(
            "pair",
            repr(pair),
            "two names, first the one that moves",
            "Write for example --pair ball,plate",
        )
    return names[0], names[1]


def _pair_parts(pair: Any) -> list[Any]:
    """The parts of "a,b" or of a list; none of anything else."""
    if isinstance(pair, str):
        return list(split_names(pair))
    if isinstance(pair, list | tuple):
        return list(pair)
    return []


def _body_name(part: Any) -> str:
    """A name without blanks around it; a number is that of a body."""
    return f"body:{part}" if isinstance(part, int) else str(part).strip()


def read_limit(limit: Quantity | None) -> float | None:
    """The time after which a model counts as hung, s; None for the default. Raises QuantityError."""
    if limit is None:
        return None
    seconds = units.parse(limit, "time", "limit")
    if not 0 < seconds <= LONGEST_LIMIT_S:
        raise QuantityError("limit", f"{seconds:g} s", f"above 0 s, up to {LONGEST_LIMIT_S:g} s")
    return seconds


def _move(move: str) -> str:
    """The joints that move the body: "base:", "body:NAME" or "joint:NAME"; "base" means the first.

    Raises UserError for anything else.
    """
    kind, _, name = move.strip().partition(":")
    is_whole_base = kind == "base" and not name
    is_named = kind in ("body", "joint") and bool(name)
    if not is_whole_base and not is_named:
        raise UserError("move", repr(move), "base:, body:NAME or joint:NAME")
    return f"{kind}:{name}"


def _height(height: Any) -> float:
    return units.parse(height, "length", "height", above=0)


def _phases(phases: int | str | Iterable[float]) -> tuple[float, ...]:
    """Shares of a step at which it touches: as given, or as many in the middles of equal parts.

    Raises QuantityError for a number of phases below 1 or above MAX_PHASES, and for shares that are
    alike or not within 0 <= share < 1.
    """
    if isinstance(phases, str):
        text = phases.strip()
        if text.isdecimal():
            phases = int(text)
        else:
            phases = units.parse_values(text, "number", "phases").tolist()
    if not isinstance(phases, Iterable):
        if not 1 <= phases <= MAX_PHASES:
            raise QuantityError("phases", str(phases), f"1 ... {MAX_PHASES}")
        return tuple((i + 0.5) / phases for i in range(phases))
    values = tuple(map(float, phases))
    are_inside = all(0 <= value < 1 for value in values)
    are_different = len(set(values)) == len(values)
    if not values or not are_inside or not are_different:
        raise QuantityError("phases", repr(phases), "different numbers from 0 up to below 1")
    return values


def _gravity(gravity: Any) -> Vector:
    """Gravity, m/s²: three numbers, or one along -z. Raises QuantityError for one below 0, and for
    another number of numbers.
    """
    if isinstance(gravity, str) and "," in gravity:
        gravity = gravity.split(",")
    if isinstance(gravity, str) and _THREE_NUMBERS.fullmatch(gravity):
        raise QuantityError("gravity", repr(gravity), "commas between the three: '0, 0, -9.81'")
    if isinstance(gravity, str) or not isinstance(gravity, Iterable):
        down = units.parse(gravity, "acceleration", "gravity")
        if not down >= 0:
            advice = "Give three for any other way: 0,0,1"
            raise QuantityError("gravity", f"{down:g} m/s^2", "0 or more, along -z", advice)
        # Adding 0.0 turns -0.0 into 0.0, which prints without a sign.
        return 0.0, 0.0, -down + 0.0
    values = [units.parse(part, "acceleration", "gravity") for part in gravity]
    if len(values) != 3:
        advice = "Write for example 0,0,-9.81"
        raise QuantityError("gravity", repr(gravity), "one number along -z, or three", advice)
    return values[0], values[1], values[2]


_READ: dict[str, Callable[[Any], Any]] = {
    "speeds": _each_once("speed", "speeds", "a speed", above=0),
    "phases": _phases,
    "timestep": lambda step: units.parse(step, "timestep", above=0),
    "gravity": _gravity,
    "height": _height,
    "coming_from": read_direction,
    "move": _move,
    "angle": _each_once("angle", "angle", "an angle", least=0),
    "along": _direction,
    "spin": units.parse_spin,
}
