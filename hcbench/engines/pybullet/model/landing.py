"""PyBullet: a robot dropped on its floor, its joints held, and the floor read as a force plate."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.pybullet.backend import (
    BACKEND,
    DISTANCE,
    FORCE,
    LINK_A,
    NORMAL,
    POINT_A,
)
from hcbench.engines.pybullet.model.bodies import mass_and_volumes
from hcbench.engines.pybullet.model.in_child import can_fork, run_aside
from hcbench.engines.pybullet.model.list_pairs import body_of
from hcbench.engines.pybullet.model.over_floor import (
    LinkMotion,
    WorldOverFloor,
    drive_of,
    prepare,
    turn_about,
)
from hcbench.sim.landing import (
    WINDOW_S,
    DropPlan,
    FootfallLog,
    Landing,
    Landings,
    latest_touch,
    over_phases,
    raised_for,
    take_off_speed,
)
from hcbench.sim.model_under_test import unit_notes
from hcbench.system.errors import EngineFailed, UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.engines.pybullet.model.open import LoadedWorld
    from hcbench.sim.model_under_test import Request
    from hcbench.terms.impact import Floats


# Names of other bodies that fall, in a note.
_SHOWN = 4


def land(world: LoadedWorld, request: Request, drops: DropPlan) -> Landings:
    """Drop the robot of a world from each height (m) at each tilt (rad) of a plan, each time in a
    forked copy of this process: the world stays as it is.

    Raises UserError where the world has no robot or nothing to land on, for a keyframe, for a body
    to move that is unknown or fixed, and for a client that is another process's; EngineFailed where
    a velocity is no longer finite.
    """
    bullet = world.bullet
    chosen = None
    if request.move is not None and request.move != "base:":
        chosen = body_of(world, request.move)
    if not can_fork(bullet):
        got = "a client that no copy of this process has"
        raise UserError("model", got, "files, or a client by pybullet.DIRECT")

    def prepared() -> tuple[_DropBench, Callable[[], None], str]:
        """Put the robot in its pose over its floor: the robot, the function that drives its joints
        before each step, and a phrase of that. Called in forked copies, whose world it changes.
        """
        prepare(world, request)
        bench = _DropBench(world, chosen)
        return bench, *drive_of(drops.controller, bench)

    def described() -> Landings:
        """The landings without a drop: names, mass, step and gravity, and notes on the robot's
        unit.
        """
        bench, _, words = prepared()
        floors = ", ".join(world.name_of(floor) for floor in bench.floors)
        start = ", ".join(["the pose of the world", *(joint for joint, _ in request.pose)])
        notes = unit_notes(bench.name, *mass_and_volumes(bullet, bench.robot))
        others = [repr(world.name_of(body)) for body in bench.falling if body != bench.robot]
        if others and chosen is None:
            notes.append(
                f"{len(bench.falling)} bodies fall; {bench.name!r} is dropped. --move body:NAME drops"
                f" another: {', '.join(others[:_SHOWN])}{', ...' if others[_SHOWN:] else ''}."
            )
        return Landings(
            "pybullet",
            BACKEND.version(),
            world.label,
            bench.name,
            floors,
            start,
            words,
            bench.mass,
            bench.h,
            bench.g,
            (),
            tuple(notes),
        )

    def dropped(height: float, tilt: float, phase: float) -> Landing:
        """One landing, in a forked copy. height: m. tilt: rad. phase: of a step, 0 to 1."""

        def landing() -> Landing:
            bench, drive, _ = prepared()
            return bench.landing(height, tilt, turn_about(drops.axis, tilt), drive, phase)

        return run_aside(bullet, landing)

    landings = [
        over_phases(partial(dropped, height, tilt))
        for height in drops.heights
        for tilt in drops.tilts
    ]
    return replace(run_aside(bullet, described), drops=tuple(landings))


class _DropBench(WorldOverFloor):
    """A robot over its floor that is dropped once, in a copy of its world."""

    def landing(
        self,
        height: float,
        tilt: float,
        turn: Sequence[float],
        drive: Callable[[], None],
        phase: float,
    ) -> Landing:
        """Drop the robot once, and read how it lands.

        height: of its lowest point over the floor, m.
        tilt: by which its base is turned, rad; turn: that turn, a quaternion x y z w.
        drive: called before each step.
        phase: place of the touch in a step.
        Raises UserError where nothing is below the robot or it meets nothing, EngineFailed for a
        velocity that is not finite.
        """
        for_phase = raised_for(phase, height, self.g, self.h)
        self.put(height + for_phase, turn)
        return self._fall(height, tilt, drive)

    def _fall(self, height: float, tilt: float, drive: Callable[[], None]) -> Landing:
        """Simulate a drop until WINDOW_S (s) after the first touch, and read it.

        height, m, tilt, rad: of the drop, for the result.
        drive: called before each step.
        Raises EngineFailed for a velocity that is not finite, UserError where nothing is met, and
        where something is met before it falls.
        """
        latest = latest_touch(height, self.g)
        forces: list[float] = []
        rising: list[float] = []
        feet: dict[int, FootfallLog] = {}
        first = math.nan
        for step in range(math.ceil((latest + WINDOW_S) / self.h)):
            drive()
            before = self.motion()
            then = step * self.h
            self.bullet.stepSimulation()
            speed = self.rising(before)
            if not math.isfinite(speed):
                got = f"a velocity is not finite {then:.3g} s after release"
                advice = "Try --controller pd:KP,KD or a smaller --timestep"
                raise EngineFailed("model", got, "a robot that its controller holds", advice)
            force = self._tread(before, then - first if feet else 0.0, feet)
            if not feet:
                if then > latest:
                    break
                continue
            if not forces:
                self._require_fall(speed)
                first = then
            forces.append(force)
            rising.append(speed)
            if then - first > WINDOW_S:
                break
        if not feet:
            got = f"the robot met nothing within {latest:.3g} s"
            raise UserError("model", got, "a floor that it collides with")
        pushed: Floats = np.array(forces)
        speed_out = take_off_speed(pushed, np.array(rising), self.h)
        time: Floats = np.arange(len(forces), dtype=np.float64) * self.h
        fallen = tuple(
            log.footfall(self._world.name_of(self.robot, link)) for link, log in feet.items()
        )
        weight = self.mass * self.g
        return Landing(height, tilt, -rising[0], speed_out, weight, fallen, time, pushed)

    def _require_fall(self, speed: float) -> None:
        """Raise UserError for a robot that does not fall at the first touch, as something fixed stands
        in its way where the drop begins. speed: of its centre of mass then, upwards, m/s.
        """
        if speed < 0.0:
            return
        fixed = ", ".join(map(self._world.name_of, self.floors))
        got = f"{self.name!r} touches what is fixed ({fixed}) where its drop begins"
        advice = "Put it elsewhere by --qpos base=X,Y,Z, or leave out what it need not meet"
        raise UserError("model", got, "a free way down to a floor", advice)

    def _tread(self, before: LinkMotion, time: float, feet: dict[int, FootfallLog]) -> float:
        """Read the contacts with the floors in the step just taken: add it to the logs of the feet,
        and return the force on the robot, N upwards.

        before: motion of the links before the step.
        time: since the first touch, s.
        feet: logs by the number of the link; changed. The force is that of the contacts' normals
        alone, as PyBullet does not tell the direction of their friction.
        """
        # (force N, depth m, speed towards the floor, speed along it) of each point, by link.
        parts: dict[int, list[tuple[float, float, float, float]]] = {}
        upward = 0.0
        for floor in self.floors:
            for contact in self.bullet.getContactPoints(self.robot, floor):
                if not contact[FORCE] > 0.0:
                    continue
                normal = np.array(contact[NORMAL])
                upward += contact[FORCE] * float(self.up @ normal)
                velocity = before.at(contact[LINK_A], np.array(contact[POINT_A]))
                away = float(normal @ velocity)
                slide = float(np.linalg.norm(velocity - away * normal))
                point = (contact[FORCE], -contact[DISTANCE], -away, slide)
                parts.setdefault(contact[LINK_A], []).append(point)
        for link, points in parts.items():
            force, depth, speed, slide = np.array(points).T
            if link not in feet:
                feet[link] = FootfallLog(time, float(speed.max()), float(slide.max()))
            slip = float(force @ slide / force.sum())
            feet[link].add(time, self.h, float(force.sum()), slip, float(depth.max()))
        return upward
