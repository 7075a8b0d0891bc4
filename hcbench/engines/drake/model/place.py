"""Brings two parts of a Drake plant just to touch, and finds how to launch one at the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.sim.packages import suggest_names
from hcbench.sim.touch import LEAST_APPROACH, require_apart
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from hcbench.engines.drake.model.user_model import Gap, LoadedPlant, Part
    from hcbench.sim.model_under_test import Request
    from hcbench.terms.impact import Floats

_ROUNDS = 60
_CLOSE = 1e-13  # m: a distance that counts as touching
_MISSED = 1e-6  # m


@dataclass(frozen=True, slots=True)
class PlacedPair:
    """Two parts that just touch, the moving body first; SI.

    moved: what moves it, in words. positions: (nq,), at touch. direction: (nv,), the velocity that approaches
    at 1 m/s. gravity: acceleration of the approach in free flight. overlap: at the start.
    """

    first: Part
    second: Part
    moved: str
    positions: Floats
    direction: Floats
    gap: Gap
    effective_mass: float
    gravity: float
    overlap: float


def set_pose(loaded: LoadedPlant, context: Any, request: Request) -> None:
    """Put joints where the request says. Raises UserError for what no Drake plant has."""
    plant = loaded.plant
    if request.key is not None:
        raise UserError("key", repr(request.key), "none: Drake reads no keyframes", "Try --qpos")
    joints = {plant.get_joint(i).name(): plant.get_joint(i) for i in plant.GetJointIndices()}
    positions = plant.GetPositions(context)
    for name, values in request.pose:
        if name == "qpos":
            start, count = 0, plant.num_positions()
        elif name in joints:
            start, count = joints[name].position_start(), joints[name].num_positions()
        else:
            raise UserError("qpos", f"no joint {name!r}", *suggest_names(name, joints))
        if len(values) != count:
            raise UserError("qpos", f"{name}: {len(values)} numbers", f"{count}: m, rad, quaternion w x y z")
        positions[start : start + count] = values
    plant.SetPositions(context, positions)


def approach_row(loaded: LoadedPlant, context: Any, pair: tuple[Part, Part], gap: Gap) -> Floats:
    """(nv,) J: the approach rate of the two parts' material points at the contact is J @ v."""
    plant, world = loaded.plant, loaded.plant.world_frame()
    row = np.zeros(plant.num_velocities())
    for part, sign in zip(pair, (1.0, -1.0), strict=True):
        frame = part.body.body_frame()
        point = plant.CalcPointsPositions(context, world, gap.point, frame)
        kind = loaded.drake.JacobianWrtVariable.kV
        jacobian = plant.CalcJacobianTranslationalVelocity(context, kind, frame, point, world, world)
        row += sign * (gap.normal @ jacobian)
    return row


def bring_to_touch(loaded: LoadedPlant, context: Any, request: Request) -> PlacedPair:
    """Bring the two just to touch, by moving the first, or else the second, along their common normal.

    context: the plant's, with everything at rest where it starts. Raises UserError with the reason where that
    cannot be done.
    """
    names = request.pair or _only_pair(loaded)
    first, second = (loaded.part(name) for name in names)
    near, start = loaded.nearest(context, first, second), loaded.plant.GetPositions(context)
    require_apart(near.distance, _size(loaded, near), first.name, second.name)
    for pair in ((first, second), (second, first)):
        for dofs, words in movers(loaded, pair[0].body):
            if (gap := _touch(loaded, context, pair, dofs)) is not None:
                return _placed(loaded, context, pair, dofs, words, gap, max(0.0, -near.distance))
            loaded.plant.SetPositions(context, start)
    got = f"no joint moves {first.name!r} and {second.name!r} to each other"
    raise UserError("pair", got, "two that meet along their common normal", "Start from another --qpos")


def _only_pair(loaded: LoadedPlant) -> tuple[str, str]:
    pairs = [
        sorted(both, key=lambda g: loaded.plant.IsAnchored(loaded.body_of(g))) for both in loaded.collide
    ]
    if len(pairs) != 1:
        got = f"none given, and the model leaves a choice of {len(pairs)}"
        advice = "`hcbench pairs` lists all"
        raise UserError("pair", got, "the names of two bodies or geoms", advice)
    return f"geom:{loaded.short(pairs[0][0])}", f"geom:{loaded.short(pairs[0][1])}"


def _size(loaded: LoadedPlant, gap: Gap) -> float:
    boxes = [loaded.inspector.GetObbInGeometryFrame(geometry) for geometry in gap.geometries]
    return min((float(max(box.half_width())) for box in boxes if box is not None), default=0.1)


def movers(loaded: LoadedPlant, body: Any) -> Iterator[tuple[list[int], str]]:
    """Yield the joints that could move a body: its own free or prismatic joint, those it hangs on,
    then all.
    """
    plant = loaded.plant
    above = {plant.get_joint(i).child_body().index(): plant.get_joint(i) for i in plant.GetJointIndices()}
    turns, chain = False, []
    while (joint := above.get(body.index())) is not None:
        start, count, kind = joint.velocity_start(), joint.num_velocities(), joint.type_name()
        if count == 6 or kind == "prismatic":
            free = "free joint" if count == 6 else "slide"
            yield (
                list(range(start + count)[-3:] if count == 6 else [start]),
                f"body {body.name()!r} on its {free}",
            )
        elif count:
            turns = True
            chain.append(joint.name())
        body = joint.parent_body()
    if turns:
        yield list(range(plant.num_velocities())), f"on its joints ({', '.join(chain)})"


def _direction(loaded: LoadedPlant, context: Any, row: Floats, dofs: list[int]) -> Floats | None:
    """(nv,), approaches at 1 m/s: the least velocity of translations, of a robot as a push would move it."""
    move = np.zeros_like(row)
    if len(dofs) == len(row) and len(row) not in (1, 3):
        move = np.linalg.solve(loaded.plant.CalcMassMatrix(context), row)
    else:
        move[dofs] = row[dofs]
    approach = float(row @ move)
    return move / approach if approach > LEAST_APPROACH**2 * float(move @ move > 0) else None


def _touch(loaded: LoadedPlant, context: Any, pair: tuple[Part, Part], dofs: list[int]) -> Gap | None:
    """Move on until the two touch; None where these degrees of freedom do not bring them together."""
    for _ in range(_ROUNDS):
        gap = loaded.nearest(context, *pair)
        move = _direction(loaded, context, approach_row(loaded, context, pair, gap), dofs)
        if move is None or not np.isfinite(gap.distance):
            return None
        if abs(gap.distance) < _CLOSE:
            return gap
        move_on(loaded, context, move * gap.distance)
    return gap if abs(gap.distance) < _MISSED else None


def move_on(loaded: LoadedPlant, context: Any, motion: Floats) -> None:
    """Add a motion, (nv,), to the positions; also where it turns a free body."""
    plant = loaded.plant
    positions = plant.GetPositions(context) + plant.MapVelocityToQDot(context, motion)
    plant.SetPositions(context, positions)


def _placed(
    loaded: LoadedPlant,
    context: Any,
    pair: tuple[Part, Part],
    dofs: list[int],
    words: str,
    gap: Gap,
    overlap: float,
) -> PlacedPair:
    """context: at touch."""
    plant, row = loaded.plant, approach_row(loaded, context, pair, gap)
    direction, mass = _direction(loaded, context, row, dofs), plant.CalcMassMatrix(context)
    assert direction is not None
    # Of gravity, springs and dampers
    forces = loaded.drake.MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    rest = np.zeros(plant.num_velocities())
    falls = -np.linalg.solve(mass, plant.CalcInverseDynamics(context, rest, forces))
    effective = 1.0 / float(row @ np.linalg.solve(mass, row))
    at_touch = plant.GetPositions(context)
    return PlacedPair(*pair, words, at_touch, direction, gap, effective, float(row @ falls), overlap)
