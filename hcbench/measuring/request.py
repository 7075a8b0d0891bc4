"""Requests from what a user writes: text with units, lists, single numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypedDict

from hcbench import units
from hcbench._arguments import checked
from hcbench.errors import QuantityError, UserError
from hcbench.impact import Floats
from hcbench.measuring.pose import read_direction, read_joints, read_state
from hcbench.sim.model_under_test import DEFAULT_PHASES, DEFAULT_SPEEDS, Request, Vector

MAX_PHASES = 1000
MAX_HEIGHT = 1e4  # m


class RequestOptions(TypedDict, total=False):
    """How to launch a pair in a model, as a user writes it: SI numbers, or text with units.

    speeds: launch speeds, m/s or text like "1:20 in/s".
    phases: how many, or which, of a time step; None: 4, one where they cannot matter, and up to 32 where e
        scatters over them.
    timestep: s. gravity: m/s^2, a vector or a number along -z. key: keyframe. height: clearance, m.
    qpos: joints to start from, "hip=0.3, knee=-30 deg" or a mapping. state: a file with a pose (.npz, JSON).
    coming_from: where the moving one comes from: "above", "+x", three numbers; None: the nearest way.
    actuators: False turns them off.
    angle: from the normal, rad or text like "30, 60 deg": speeds are then along the normal, with tan(angle)
        times as much along the plate. along: which way, a vector. spin: rad/s, about the axis across that
        way, with which the body rolls on; or three, about that way, across it, and away from the plate.
    """

    speeds: Any
    phases: int | Sequence[float] | None
    timestep: Any
    gravity: float | str | Sequence[float | str] | Floats | None
    key: str | None
    height: float | str | None
    qpos: Any
    state: str | Path | None
    coming_from: str | Sequence[float | str] | None
    actuators: bool
    angle: Any
    along: Any
    spin: Any


@checked
def make_request(
    pair: Sequence[str] | str | None = None,
    speeds: Any = None,
    phases: int | Sequence[float] | None = None,
    timestep: Any = None,
    gravity: float | str | Sequence[float | str] | Floats | None = None,
    key: str | None = None,
    height: float | str | None = None,
    *,
    qpos: Any = None,
    state: str | Path | None = None,
    coming_from: str | Sequence[float | str] | None = None,
    actuators: bool = True,
    angle: Any = None,
    along: Any = None,
    spin: Any = None,
) -> Request:
    """A request from what a user writes; see `RequestOptions`. Raises QuantityError."""
    values = DEFAULT_SPEEDS if speeds is None else units.parse_values(speeds, "speed", "speeds", above=0)
    if len(set(values)) != len(values):
        raise QuantityError("speeds", f"{speeds!r} has a speed twice", "each speed once")
    if along is not None and angle is None and spin is None:
        raise QuantityError("along", f"{along!r}, and nothing oblique", "an angle or a spin beside it")
    if height is not None and angle is not None:
        todo = "It is the angle at touch, of launches; spin goes with a height"
        raise UserError("angle", "given beside height", "one of the two", todo)
    return Request(
        pair=_pair(pair),
        speeds=tuple(float(v) for v in values),
        phases=_phases(DEFAULT_PHASES if phases is None else phases),
        timestep=None if timestep is None else units.parse(timestep, "timestep", above=0),
        gravity=_gravity(gravity),
        key=None if key is None else str(key),
        height=_height(height),
        adapt_phases=phases is None,
        pose=(*read_state(state), *read_joints(qpos)),
        coming_from=read_direction(coming_from),
        actuators=actuators,
        angles=_angles(angle),
        along=None if along is None else _direction(along),
        spin=(0.0, 0.0, 0.0) if spin is None else units.parse_spin(spin),
    )


def _angles(angle: Any) -> tuple[float, ...]:
    if angle is None:
        return (0.0,)
    values = units.parse_values(angle, "angle", "angle", least=0.0).tolist()
    if len(set(values)) != len(values):
        raise QuantityError("angle", f"{angle!r} has an angle twice", "each angle once")
    return tuple(values)


def _direction(along: Any) -> Vector:
    values = units.parse_values(along, "number", "along").tolist()
    if len(values) != 3:
        raise QuantityError("along", f"{along!r}", "three numbers", "Write for example '0, 1, 0'")
    return values[0], values[1], values[2]


def _pair(pair: Sequence[str] | str | None) -> tuple[str, str] | None:
    if pair is None:
        return None
    names = pair.split(",") if isinstance(pair, str) else list(pair)
    names = [str(name).strip() for name in names]
    if len(names) != 2 or not all(names):
        raise UserError(
            "pair", repr(pair), "two names, the moving one first", "Write for example --pair ball,plate"
        )
    return names[0], names[1]


def _height(height: Any) -> float | None:
    if height is None:
        return None
    clearance = units.parse(height, "length", "height", above=0)
    if clearance > MAX_HEIGHT:
        raise QuantityError("height", f"{clearance:g} m", f"up to {MAX_HEIGHT:g} m")
    return clearance


def _phases(phases: int | Sequence[float]) -> tuple[float, ...]:
    if isinstance(phases, int):
        if not 1 <= phases <= MAX_PHASES:
            raise QuantityError("phases", str(phases), f"1 ... {MAX_PHASES}")
        return tuple((i + 0.5) / phases for i in range(phases))
    values = tuple(float(p) for p in phases)
    if not values or not all(0 <= p < 1 for p in values) or len(set(values)) != len(values):
        raise QuantityError("phases", repr(phases), "different numbers from 0 up to below 1")
    return values


def _gravity(gravity: Any) -> Vector | None:
    if gravity is None:
        return None
    if isinstance(gravity, str) and "," in gravity:
        gravity = gravity.split(",")
    if isinstance(gravity, str | int | float):
        down = units.parse(gravity, "acceleration", "gravity")
        if not down >= 0:
            raise QuantityError(
                "gravity", f"{down:g} m/s^2", "0 or more, along -z", "Give three for any other way: 0,0,1"
            )
        return 0.0, 0.0, -down + 0.0
    values = [units.parse(part, "acceleration", "gravity") for part in gravity]
    if len(values) != 3:
        raise QuantityError(
            "gravity", repr(gravity), "one number along -z, or three", "Write for example 0,0,-9.81"
        )
    return values[0], values[1], values[2]
