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

# Steps of the way to the touch, at most.
_ROUNDS = 60
# Distance that counts as touching, m.
_CLOSE = 1e-13
# Distance, m, at the end of a way from which the two do not meet.
_MISSED = 1e-6


@dataclass(frozen=True, slots=True)
class PlacedPair:
    """Two parts that just touch, the moving body first; SI.

    moved: what moves it, in words.
    positions: (nq,), at touch.
    direction: (nv,), the velocity that approaches at 1 m/s.
    gravity: acceleration of the approach in free flight.
    overlap: at the start.
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
            start = 0
            count = plant.num_positions()
        elif name in joints:
            start = joints[name].position_start()
            count = joints[name].num_positions()
        else:
            raise UserError("qpos", f"no joint {name!r}", *suggest_names(name, joints))
        if len(values) != count:
            raise UserError(
                "qpos", f"{name}: {len(values)} numbers", f"{count}: m, rad, quaternion w x y z"
            )
        positions[start : start + count] = values
    plant.SetPositions(context, positions)


def approach_row(loaded: LoadedPlant, context: Any, pair: tuple[Part, Part], gap: Gap) -> Floats:
    """(nv,) J: the approach rate of the two parts' material points at the contact is J @ v."""
    plant = loaded.plant
    world = plant.world_frame()
    by_velocity = loaded.drake.JacobianWrtVariable.kV
    row = np.zeros(plant.num_velocities())
    for part, sign in zip(pair, (1.0, -1.0), strict=True):
        frame = part.body.body_frame()
        point = plant.CalcPointsPositions(context, world, gap.point, frame)
        jacobian = plant.CalcJacobianTranslationalVelocity(
            context, by_velocity, frame, point, world, world
        )
        row += sign * (gap.normal @ jacobian)
    return row


def bring_to_touch(loaded: LoadedPlant, context: Any, request: Request) -> PlacedPair:
    """Bring the two just to touch, by moving the first, or else the
    second, along their common normal.

    context: the plant's, with everything at rest where it starts; it ends at touch. Raises
    UserError with the reason where that cannot be done.
    """
    names = request.pair or _only_pair(loaded)
    first, second = (loaded.part(name) for name in names)
    near = loaded.nearest(context, first, second)
    start = loaded.plant.GetPositions(context)
    require_apart(near.distance, _size(loaded, near), first.name, second.name)
    overlap = max(0.0, -near.distance)
    for pair in ((first, second), (second, first)):
        moving, _ = pair
        for dofs, words in movers(loaded, moving.body):
            gap = _touch(loaded, context, pair, dofs)
            if gap is not None:
                return _placed(loaded, context, pair, dofs, words, gap, overlap)
            loaded.plant.SetPositions(context, start)
    got = f"no joint moves {first.name!r} and {second.name!r} to each other"
    raise UserError(
        "pair", got, "two that meet along their common normal", "Start from another --qpos"
    )


def _only_pair(loaded: LoadedPlant) -> tuple[str, str]:
    """The names of the only two shapes that can meet, one that moves first. UserError for a choice."""
    if len(loaded.collide) != 1:
        got = f"none given, and the model leaves a choice of {len(loaded.collide)}"
        advice = "`hcbench pairs` lists all"
        raise UserError("pair", got, "the names of two bodies or geoms", advice)
    (both,) = loaded.collide
    first, second = sorted(both, key=lambda g: loaded.plant.IsAnchored(loaded.body_of(g)))
    return f"geom:{loaded.short(first)}", f"geom:{loaded.short(second)}"


def _size(loaded: LoadedPlant, gap: Gap) -> float:
    """Half of the smaller shape's longest side, m; 0.1 of shapes that have no end."""
    boxes = [loaded.inspector.GetObbInGeometryFrame(geometry) for geometry in gap.geometries]
    return min((float(max(box.half_width())) for box in boxes if box is not None), default=0.1)


def movers(loaded: LoadedPlant, body: Any) -> Iterator[tuple[list[int], str]]:
    """Yield the joints that could move a body: its own free or prismatic joint, those it hangs on,
    then all. Each with its places in the velocities, and in words.
    """
    plant = loaded.plant
    joint_of = {
        plant.get_joint(i).child_body().index(): plant.get_joint(i) for i in plant.GetJointIndices()
    }
    # Joints that turn, nearest first.
    chain = []
    joint = joint_of.get(body.index())
    while joint is not None:
        start = joint.velocity_start()
        count = joint.num_velocities()
        if count == 6:
            # Of a free joint's velocities the rotations are first.
            translations = list(range(start + 3, start + 6))
            yield translations, f"body {body.name()!r} on its free joint"
        elif joint.type_name() == "prismatic":
            yield [start], f"body {body.name()!r} on its slide"
        elif count:
            chain.append(joint.name())
        body = joint.parent_body()
        joint = joint_of.get(body.index())
    if chain:
        yield list(range(plant.num_velocities())), f"on its joints ({', '.join(chain)})"


def _direction(loaded: LoadedPlant, context: Any, row: Floats, dofs: list[int]) -> Floats | None:
    """(nv,), approaches at 1 m/s: the least velocity of translations, of a
    robot as a push would move it.

    None where the degrees of freedom do not lead to the other.
    """
    moves_all = len(dofs) == len(row) and len(row) not in (1, 3)
    if moves_all:
        move = np.linalg.solve(loaded.plant.CalcMassMatrix(context), row)
    else:
        # Translations alone: the least velocity is along the row itself.
        move = np.zeros_like(row)
        move[dofs] = row[dofs]
    approach = float(row @ move)
    least = LEAST_APPROACH**2 * float(move @ move > 0)
    if approach > least:
        return np.asarray(move / approach)
    return None


def _touch(
    loaded: LoadedPlant, context: Any, pair: tuple[Part, Part], dofs: list[int]
) -> Gap | None:
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
    """The pair as it stands in `context`, at touch, with what a launch needs to know of it.

    dofs: places in the velocities that move it.
    words: a name for them.
    overlap: at the start, m.
    """
    plant = loaded.plant
    row = approach_row(loaded, context, pair, gap)
    direction = _direction(loaded, context, row, dofs)
    assert direction is not None
    mass = plant.CalcMassMatrix(context)
    # What gravity, springs and dampers do to the plant at rest.
    forces = loaded.drake.MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    at_rest = np.zeros(plant.num_velocities())
    falls = -np.linalg.solve(mass, plant.CalcInverseDynamics(context, at_rest, forces))
    first, second = pair
    return PlacedPair(
        first=first,
        second=second,
        moved=words,
        positions=plant.GetPositions(context),
        direction=direction,
        gap=gap,
        effective_mass=1.0 / float(row @ np.linalg.solve(mass, row)),
        gravity=float(row @ falls),
        overlap=overlap,
    )
