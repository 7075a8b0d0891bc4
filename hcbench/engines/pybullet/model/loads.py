"""PyBullet: a pair at rest in a user's world, pressed together, pushed along its plate, and tilted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.pybullet.backend import DISTANCE, FORCE, POINT_A, POINT_B
from hcbench.engines.pybullet.model.bodies import BulletBody
from hcbench.engines.pybullet.model.simulation import FRICTIONS, pair_friction
from hcbench.sim.rest import (
    LAST,
    LOADS,
    PRESSED_S,
    PRESSED_STEPS,
    PUSHED_STEPS,
    UNKNOWN,
    BorneLoad,
    Carried,
    Rest,
    Standing,
    borne,
    creep_of,
    last_half,
    push_of,
    rest_of,
    slope_of,
)
from hcbench.sim.tangential import plate_frame

if TYPE_CHECKING:
    from hcbench.engines.pybullet.backend import BulletClient
    from hcbench.engines.pybullet.model.place import BulletPlacement
    from hcbench.sim.model_under_test import Vector
    from hcbench.terms.impact import Floats

# Time until the pair is taken to lie as it will, and of a rest on a slope, s.
_SECONDS = 4.0
# Bounds the steps of each.
_MOST_STEPS = 4000


class _ContactAfterStep(NamedTuple):
    """The contact of a pair after a step.

    normal: its force, N.
    friction: the sum of both its directions, on the moving part, N, (3,), but for its sign.
    depth: m.
    point: where the force acts, m.
    """

    normal: float
    friction: Floats
    depth: float
    point: Floats


class PairInWorld(NamedTuple):
    """A placed pair, and how to try something with it.

    timestep: s.
    gravity: (3,), m/s².
    along: a way in the plate; None: x or y.
    aside: calls a function that changes the world and returns its result; the world stays as it is.
    """

    bullet: BulletClient
    place: BulletPlacement
    timestep: float
    gravity: Vector
    along: Vector | None
    aside: Callable[[Callable[[], Any]], Any]

    @property
    def falls(self) -> bool:
        """True if gravity presses the two together."""
        return float(np.dot(self.gravity, self.place.normal)) > 0.0

    @property
    def friction(self) -> float:
        """Coulomb's μ of the pair."""
        return pair_friction(self.bullet, self.place)


class _Resting:
    """The pair of a world that is stepped until it lies; the world is changed.

    steps: number of those taken.
    first, second: the two bodies, timestep: s.
    """

    def __init__(self, pair: PairInWorld) -> None:
        """Put the pair at touch without speed, and take as many steps as it needs to come to rest."""
        self.pair = pair
        self.bullet = pair.bullet
        self.place = pair.place
        self.timestep = pair.timestep
        self.first = BulletBody(self.bullet, self.place.first.body)
        self.second = BulletBody(self.bullet, self.place.second.body)
        self.steps = min(_MOST_STEPS, round(_SECONDS / self.timestep))
        self.place.launch(self.bullet, 0.0, 0.0)
        for _ in range(self.steps):
            self.bullet.stepSimulation()

    def touch(self) -> _ContactAfterStep | None:
        """The contact of the pair in the step just taken: force, friction, depth and place, SI; None
        where nothing pushes.
        """
        first, second = self.place.first, self.place.second
        contacts = self.bullet.getContactPoints(first.body, second.body, first.link, second.link)
        normal = sum(contact[FORCE] for contact in contacts)
        if not normal > 0.0:
            return None
        friction = np.zeros(3)
        point = np.zeros(3)
        for contact in contacts:
            for force, way in FRICTIONS:
                friction += contact[force] * np.array(contact[way])
            middle = 0.5 * (np.array(contact[POINT_A]) + np.array(contact[POINT_B]))
            point += contact[FORCE] / normal * middle
        depth = -min(contact[DISTANCE] for contact in contacts)
        return _ContactAfterStep(normal, friction, depth, point)

    def push(self, force: Floats, point: Floats) -> None:
        """Let a force, N, (3,), act on the moving part in the next step, and its opposite on the
        other.

        point: where it acts, m, (3,), in the world.
        A fixed part takes none.
        """
        world = self.bullet.module.WORLD_FRAME
        for sign, part, body in (
            (1.0, self.place.first, self.first),
            (-1.0, self.place.second, self.second),
        ):
            if body.kind != "fixed":
                self.bullet.applyExternalForce(
                    part.body, part.link, (sign * force).tolist(), point.tolist(), world
                )

    def pressed(self, times: float) -> BorneLoad:
        """Press the resting pair together by `times` its force at rest: the force that the contact
        then bears, N, and its penetration, m, over the last steps; NaN where it does not push.
        """
        touch = self.touch()
        if touch is None:
            return BorneLoad(times, math.nan, math.nan)
        steps = min(PRESSED_STEPS, round(PRESSED_S / self.timestep))
        last = max(1, round(LAST * steps))
        added = (times - 1.0) * touch.normal * self.place.normal
        rows = []
        for _ in range(steps):
            self.push(added, touch.point)
            self.bullet.stepSimulation()
            now = self.touch()
            rows.append((0.0, 0.0) if now is None else (now.normal, now.depth))
        return borne(times, touch.normal, np.array(rows[-last:]))

    def friction(self, way: Floats) -> float:
        """The largest friction over the normal force along a direction in the plate; NaN where the
        contact does not push.

        way: the direction, unit vector, (3,). The pair is pushed along it by more than friction
        bears.
        """
        touch = self.touch()
        if touch is None:
            return math.nan
        size = push_of(self.pair.friction, touch.normal)
        limit = 0.0
        for _ in range(PUSHED_STEPS):
            self.push(size * way, touch.point)
            self.bullet.stepSimulation()
            now = self.touch()
            if now is not None:
                limit = max(limit, abs(float(now.friction @ way)) / now.normal)
        return limit

    def on_slope(self, angle: float) -> Rest:
        """Let the pair rest on a slope, and measure how it does; the drift is NaN where the body rolls
        or has left the plate.

        angle: of the slope, rad: gravity is turned by it from the plate's normal, and stays so.
        """
        bullet = self.bullet
        link = self.place.first.link
        normal = self.place.normal
        gravity = np.array(self.pair.gravity)
        along, _, _ = plate_frame(normal, None)
        down = math.cos(angle) * normal + math.sin(angle) * along
        bullet.setGravity(*(np.linalg.norm(gravity) * down).tolist())
        for _ in range(self.steps // 2):
            bullet.stepSimulation()
        # Of each step: position of the centre, m (3 columns), depth, m, force, N, and spin, rad/s
        # (3 columns).
        rows = []
        touch = None
        for _ in range(self.steps - self.steps // 2):
            bullet.stepSimulation()
            self.first.refresh()
            now = self.touch()
            touch = now or touch
            depth, force = (0.0, 0.0) if now is None else (now.depth, now.normal)
            centre, _ = self.first.pose(link)
            rows.append([*centre, depth, force, *self.first.spin_of(link)])
        path = np.array(rows)
        position = path[:, :3]
        depth_of_step = path[:, 3]
        force_of_step = path[:, 4]
        height = position @ normal
        time = np.arange(float(len(path))) * self.timestep
        rate = np.gradient(height, self.timestep)
        sideways = position - np.outer(height, normal)
        rest = rest_of(time, depth_of_step, rate, force_of_step, sideways)
        # No force in the last quarter: the body has left the plate.
        if touch is None or not last_half(last_half(force_of_step)).any():
            return replace(rest, drift=math.nan)
        spin = float(np.linalg.norm(last_half(path[:, 5:]).mean(axis=0)))
        lever = float(np.linalg.norm(touch.point - position[-1]))
        return replace(rest, drift=creep_of(rest.drift, spin, lever))


def carried_by(pair: PairInWorld) -> Carried:
    """Measure what the contact of a pair carries at rest: multiples of its load, the limits of
    friction, and the creep on a slope; nothing where nothing holds the two together, or they do not
    come to rest.
    """

    def tried(trial: Callable[[_Resting], Any]) -> Any:
        return pair.aside(lambda: trial(_Resting(pair)))

    if not pair.falls or tried(_Resting.touch) is None:
        return Carried()
    loads = [tried(partial(_Resting.pressed, times=times)) for times in LOADS]
    if math.isnan(loads[0].force):
        # It hops or hammers.
        return Carried()
    one, two, _ = plate_frame(pair.place.normal, pair.along)
    ways = (one, two, (one + two) / math.sqrt(2.0))
    limits = [tried(partial(_Resting.friction, way=way)) for way in ways]
    slope, rest = _rest_on_slope(pair)
    return Carried(tuple(loads), max(limits), min(limits), slope, rest.drift)


def standing(pair: PairInWorld, level: Rest | None) -> Standing:
    """Measure how the pair of a world rests on a slope, and join that with its rest on the level.

    level: None where the two do not rest: then all is unknown. The drift of what rolls down the
    slope is NaN.
    """
    if level is None:
        return UNKNOWN
    slope, rest = _rest_on_slope(pair)
    unknown = math.nan
    return Standing.of(level, rest, unknown, unknown, (unknown, unknown), slope)


def _rest_on_slope(pair: PairInWorld) -> tuple[float, Rest]:
    """(slope, rad; rest on it); NaN for what the world has not."""
    slope = slope_of(pair.friction)
    is_fixed = BulletBody(pair.bullet, pair.place.second.body).kind == "fixed"
    if not is_fixed or not slope > 0.0 or not pair.falls:
        return math.nan, Rest(*[math.nan] * 4)
    return slope, pair.aside(lambda: _Resting(pair).on_slope(slope))
