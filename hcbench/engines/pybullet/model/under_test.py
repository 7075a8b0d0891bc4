"""PyBullet: files or a live client with a pair in it, measured as loaded.

Bullet keeps settings in globals of its process. Files are therefore loaded in a worker process; a
live client is measured where it is, and left in the state and with the settings it had.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.pybullet import plugin
from hcbench.engines.pybullet.backend import (
    BACKEND,
    BODY_TYPE,
    INERTIA,
    LATERAL_FRICTION,
    MASS,
    RESTITUTION,
)
from hcbench.engines.pybullet.model.bodies import (
    MAXIMAL_COORDINATES,
    FreeBase,
    mass_and_volumes,
    vector,
)
from hcbench.engines.pybullet.model.causes import (
    BulletContext,
    broken_promise,
    find_suspects,
    promise_in,
    restitution_setting,
    restitutions,
    script_of,
    speed_of_hops,
    what_distorts,
    without_spring,
)
from hcbench.engines.pybullet.model.drop_test import ChangedWorld
from hcbench.engines.pybullet.model.in_child import (
    Answer,
    CopyOfWorld,
    LaunchesInPlace,
    can_fork,
    keeps_nothing,
    release_aside,
    run_aside,
)
from hcbench.engines.pybullet.model.landing import land
from hcbench.engines.pybullet.model.list_pairs import find_pair, list_pairs
from hcbench.engines.pybullet.model.loads import PairInWorld, carried_by, standing
from hcbench.engines.pybullet.model.open import (
    LoadedWorld,
    base_states,
    joint_states,
    load_files,
    open_live,
    set_pose,
)
from hcbench.engines.pybullet.model.place import place
from hcbench.engines.pybullet.model.simulation import LaunchInUserWorld, pair_friction
from hcbench.engines.pybullet.model.touchdowns import touchdowns
from hcbench.laws.restitution import RestitutionCurve
from hcbench.sim.model_under_test import (
    CandidatePair,
    Facts,
    ModelSetting,
    ModelUnderTest,
    Request,
    Suspect,
    Texts,
    unit_notes,
)
from hcbench.sim.packages import Packages
from hcbench.sim.touch import overlap_notes
from hcbench.sim.world import Simulation
from hcbench.system.errors import SceneError, UserError
from hcbench.system.text import time_step
from hcbench.terms.bounds import require_bounds
from hcbench.terms.impact import Impact, Launch

if TYPE_CHECKING:
    from hcbench.engines.pybullet.backend import BulletClient
    from hcbench.engines.pybullet.model.open import BodyPart
    from hcbench.engines.pybullet.model.place import BulletPlacement
    from hcbench.sim.landing import DropPlan, Landings
    from hcbench.sim.promise import Promise
    from hcbench.sim.rest import Carried, Standing
    from hcbench.sim.touch import TrajectoryTouchdowns
    from hcbench.terms.impact import Floats

# Refuses a world whose numbers no bouncing body has, as PyBullet read them.

# Quantity, its place in getDynamicsInfo, and its unit.
_CHECKED = (
    ("mass", MASS, "kg"),
    ("friction", LATERAL_FRICTION, ""),
    ("restitution", RESTITUTION, ""),
)
# Places in getCollisionShapeData.
_SHAPE = 2
_SIZES = 3
# Kinds of shapes that have no sizes.
_PLANE = 6
_MESH = 5


def require_plausible(bullet: BulletClient, place: BulletPlacement) -> None:
    """Refuse a world whose time step, s, or gravity, m/s², is outside the bounds, or whose pair has
    numbers that no bouncing body has.

    place: of the pair.
    Raises SceneError for a mass, friction, restitution or inertia below 0 or NaN, QuantityError for
    numbers outside the bounds.
    """
    parameters = bullet.getPhysicsEngineParameters()
    require_bounds("timestep", [parameters["fixedTimeStep"]], "timestep", "s")
    gravity = [parameters[f"gravityAcceleration{axis}"] for axis in "XYZ"]
    require_bounds("gravity", gravity, "acceleration", "m/s^2")
    for side in (place.first, place.second):
        _require_plausible_part(bullet, side)


def _require_plausible_part(bullet: BulletClient, side: BodyPart) -> None:
    """Refuse a part of a pair whose mass, friction, restitution, inertia or size no body has.

    side: the part.
    Raises SceneError for numbers below 0 or NaN, QuantityError for those outside the bounds.
    """
    info = bullet.getDynamicsInfo(side.body, side.link)
    for quantity, index, unit in _CHECKED:
        slot = f"{quantity} of {side.name!r}"
        value = float(info[index])
        # Written so that NaN is refused, too.
        if not value >= 0:
            raise SceneError(slot, f"{value:g}", "a number of 0 or more")
        require_bounds(slot, [value], quantity, unit)
    if not all(value >= 0 for value in info[INERTIA]):
        raise SceneError(f"inertia of {side.name!r}", f"{info[INERTIA]}", "numbers of 0 or more")
    if info[BODY_TYPE] == MAXIMAL_COORDINATES:
        # PyBullet has no shapes to read of such bodies.
        return
    for shape in bullet.getCollisionShapeData(side.body, side.link):
        if shape[_SHAPE] not in (_PLANE, _MESH):
            require_bounds(f"size of {side.name!r}", shape[_SIZES], "length", "m", smallest=0.0)


_UNKNOWN_RESTITUTIONS = (
    "restitutions that PyBullet does not report for bodies with maximal coordinates"
)

_ONE_POINT = (
    "Bullet pushes one point of this face, which turns the body. Speeds are those of its middle."
)


class _Placed(NamedTuple):
    """The pair of a world at touch.

    place: where they touch, and what moves them there.
    law: of the plug-in's between the two; None without one.
    is_put_back_whole: whether one copy of the world can have all launches, one after the other,
    with the same results to the bit as a copy for each.
    promise: of `hcbench tune` for the pair; None without one.
    timestep: s.
    gravity: along the normal, into the other body, m/s²; 0 where both fall.
    """

    place: BulletPlacement
    law: plugin.ActiveLaw | None
    is_put_back_whole: bool
    promise: Promise | None
    timestep: float
    gravity: float


class PybulletModel(ModelUnderTest):
    """A PyBullet world with a pair in it, opened; `close` restores a live client.

    build: makes the world again, for trials; None for a live client, on which nothing is tried.
    fixes: made in the world before the pair is placed, in forked copies of this process where it
    can fork.

    Raises UserError where the request does not fit the world or the two cannot be brought to touch,
    SceneError and QuantityError for numbers that no body has, EngineFailed where PyBullet dies. A
    live client then gets back its pose, time step and gravity; one of our own is closed.
    """

    diverged = "velocity is not finite"

    def __init__(
        self,
        world: LoadedWorld,
        build: Callable[[], LoadedWorld] | None,
        request: Request,
        fixes: Sequence[Suspect] = (),
    ) -> None:
        """Apply the request and the fixes, and bring the pair to touch.

        world: loaded.
        build: makes it again; None for a live client.
        fixes: suspects, made before the pair is placed.
        Raises UserError and its kinds where the pair cannot be measured; a live client then gets
        back what it had.
        """
        self.world = world
        self.request = request
        self.build = build
        self.bullet = world.bullet
        self._copy: CopyOfWorld | None = None
        # Those that its world has: a world made again has none.
        self._made = tuple(fixes)
        # The user's own client gets back what it had.
        self._settings_before = self.bullet.getPhysicsEngineParameters()
        self._pose_before = {}
        self._bases_before = []
        if not world.disconnect:
            self._pose_before = joint_states(self.bullet)
            self._bases_before = base_states(self.bullet, request)
        try:
            self._apply_request()
            set_pose(world, request)
            self._parts = find_pair(world, request.pair)
            for fix in fixes:
                if fix.apply is not None:
                    fix.apply(self.bullet)
            self._take(self._placed())
        except BaseException:
            self._put_back()
            raise

    def _placed(self) -> _Placed:
        """Bring the pair to touch, and read from the present world what holds for it.

        Raises UserError where the two cannot be brought to touch, SceneError and QuantityError for
        numbers that no body has.
        """
        request = self.request
        first, second = self._parts
        self.place = run_aside(
            self.bullet,
            lambda: place(self.world, first, second, request.coming_from, request.move),
        )
        require_plausible(self.bullet, self.place)
        gravity = 0.0
        if self._falls_alone():
            gravity = float((np.array(self._gravity()) * self.place.normal).sum())
        return _Placed(
            place=self.place,
            law=None if self.world.files else self._plugin_law(),
            # A plug-in, and what a user's function made, keep what nobody puts back.
            is_put_back_whole=bool(self.world.files)
            and can_fork(self.bullet)
            and keeps_nothing(self.bullet),
            promise=promise_in(self.bullet, (self.place.first, self.place.second)),
            timestep=float(self.bullet.getPhysicsEngineParameters()["fixedTimeStep"]),
            gravity=gravity,
        )

    def _take(self, placed: _Placed) -> None:
        """Keep the pair at touch as attributes of the model.

        placed: what holds for the pair, as `_placed` read it.
        """
        self.place = placed.place
        self.law = placed.law
        self._is_put_back_whole = placed.is_put_back_whole
        self.promise = placed.promise
        self.timestep = placed.timestep
        self.gravity = placed.gravity
        self.mass = placed.place.effective_mass

    def _plugin_law(self) -> plugin.ActiveLaw | None:
        """Number of the plug-in's law between the two, and the command that added it; None without a
        law.
        """
        first = (self.place.first.body, self.place.first.link)
        second = (self.place.second.body, self.place.second.link)
        return plugin.find(first, second, client=self.bullet.client)

    def _apply_request(self) -> None:
        """Set the request's step, s, and gravity, m/s². Raises UserError for a keyframe."""
        if self.request.key is not None:
            raise UserError("key", repr(self.request.key), "no keyframe: PyBullet has none")
        if self.request.timestep is not None:
            self.bullet.setPhysicsEngineParameter(fixedTimeStep=self.request.timestep)
        if self.request.gravity is not None:
            self.bullet.setGravity(*self.request.gravity)

    def _put_back(self) -> None:
        """Give a live client back the poses, time step and gravity that the request changed; close a
        world of our own.
        """
        if self.world.disconnect:
            if self.bullet.isConnected():
                self.bullet.disconnect()
            return
        for body, pose, velocities in self._bases_before:
            self.bullet.resetBasePositionAndOrientation(body, *pose)
            self.bullet.resetBaseVelocity(body, *velocities)
        for (body, joint), (position, velocity) in self._pose_before.items():
            self.bullet.resetJointState(body, joint, position, velocity)
        self.bullet.setPhysicsEngineParameter(fixedTimeStep=self._settings_before["fixedTimeStep"])
        self.bullet.setGravity(
            *(self._settings_before[f"gravityAcceleration{axis}"] for axis in "XYZ")
        )

    def _gravity(self) -> tuple[float, float, float]:
        """Gravity of the world, m/s^2."""
        parameters = self.bullet.getPhysicsEngineParameters()
        x, y, z = (float(parameters[f"gravityAcceleration{axis}"]) for axis in "XYZ")
        return x, y, z

    def _falls_alone(self) -> bool:
        """Return whether gravity makes the two approach; it does not if both fall, or neither."""
        first_mass = self.bullet.getDynamicsInfo(self.place.first.body, -1)[MASS]
        second_mass = self.bullet.getDynamicsInfo(self.place.second.body, -1)[MASS]
        return isinstance(self.place.mover, FreeBase) and min(first_mass, second_mass) == 0.0

    def release(self, launches: Sequence[Launch]) -> Simulation:
        """Begin a launch from its starting point, in a copy of the world that has seen no other.

        launches: one.
        Raises UserError for an oblique launch of a pair with the plug-in's law, whose friction
        PyBullet does not report.
        """
        (launch,) = launches
        # In the plug-in; None without a law.
        law_number = None
        if self.law is not None:
            law_number = self.law.number
            if launch.is_oblique:
                got = (
                    "oblique, of a pair whose law the plug-in applies: "
                    "PyBullet does not report its friction"
                )
                raise UserError("launch", got, "launches along the normal")
        if self._is_put_back_whole:
            self._copy = self._copy or CopyOfWorld(self._launches_in_copy)
            return self._copy.release(launch)

        def released() -> Simulation:
            self._make_fixes()
            return self._launched(launch, law_number)

        return release_aside(self.bullet, released)

    def _launches_in_copy(self) -> LaunchesInPlace:
        self._make_fixes()
        return LaunchesInPlace(self.bullet, lambda launch: self._launched(launch, None))

    def _make_fixes(self) -> None:
        """Make what is not made in the world itself, in a copy of it: nothing."""

    def _launched(self, launch: Launch, law: int | None) -> Simulation:
        """A launch in the world itself, which it changes. law: number of the plug-in's, or None."""
        along = self.request.along
        return LaunchInUserWorld(self.bullet, self.place, launch, self.gravity, along, law)

    def aside(self, function: Callable[[], Answer]) -> Answer:
        """Call a function that changes the world, and return its result; the world is as before."""
        return run_aside(self.bullet, function)

    def carried(self) -> Carried:
        """Measure which loads the pair carries at rest, on its plate and on a slope."""
        return carried_by(self._pair_in_world())

    def standing(self) -> Standing:
        """Measure how the pair rests on the level and on a slope."""
        return standing(self._pair_in_world(), self.at_rest())

    def _pair_in_world(self) -> PairInWorld:
        return PairInWorld(
            self.bullet, self.place, self.timestep, self._gravity(), self.request.along, self.aside
        )

    @property
    def step_cost(self) -> float:
        """Grows with bodies and joints."""
        return (
            1.0 + sum(1 + int(self.bullet.getNumJoints(body)) for body in self.bullet.bodies()) / 5
        )

    def facts(self) -> Facts:
        """Properties of the world and of its pair, SI, as `measure` prints them: the pair, its mass
        and normal, Bullet's settings, the e that these ask for, notes, and what has changed since
        `tune` wrote them.
        """
        of_pair = restitutions(self.bullet, self.place)
        reported: list[float] | str = "not told"
        if not math.isnan(math.prod(of_pair)):
            reported = list(of_pair)
        asked, words = self._asked(*of_pair)
        parameters = self.bullet.getPhysicsEngineParameters()
        notes = overlap_notes(self.place.overlap)
        first = self.place.first
        notes += unit_notes(first.name, *mass_and_volumes(self.bullet, first.body))
        if self.place.note:
            notes = [self.place.note, *notes]
        if self.world.files and self.request.gravity is None and not any(self._gravity()):
            notes = ["These files set no gravity, so none acts: --gravity 9.81 adds it.", *notes]
        if self.place.face is not None and self.place.face.points == 1:
            notes.append(_ONE_POINT)
        return Facts(
            engine="pybullet",
            version=BACKEND.version(),
            model=self.world.label,
            pair=(self.place.first.name, self.place.second.name),
            moved=self.place.mover.description,
            timestep=self.timestep,
            gravity=self._gravity(),
            effective_mass=self.place.effective_mass,
            normal=vector(self.place.normal),
            settings={
                "restitution": reported,
                "numSubSteps": int(parameters["numSubSteps"]),
                "numSolverIterations": int(parameters["numSolverIterations"]),
            },
            asked=asked,
            asked_description=words,
            notes=tuple(notes),
            friction=pair_friction(self.bullet, self.place),
            point=vector(self.place.point),
            promise=self.promise,
            changed=tuple(suspect.code for suspect in self._changed_since_tuned()),
            in_text=(self.place.first.in_text, self.place.second.in_text),
        )

    def _changed_since_tuned(self) -> list[Suspect]:
        """Return what in the world breaks the promise that `hcbench tune` made; [] without one."""
        if self.promise is None:
            return []
        has_law = self.law is not None
        return list(broken_promise(self.bullet, self.promise, has_law, self._gravity()))

    def _asked(self, first: float, second: float) -> tuple[tuple[float, ...], str]:
        """The e that the world asks for at each launch speed, () where it is not known, and in words
        what asks for it.

        That is the plug-in's law, else the promise of `hcbench tune`, else the product of the
        restitutions.

        first, second: restitutions of the two; NaN where PyBullet does not report them.
        """
        speeds = self.request.speeds
        if self.law is not None:
            curve = plugin.restitution_of(self.law.command)
            words = f"plug-in hcbench: {self.law.command}"
            if curve is None:
                return (), words
            return tuple(float(curve.at(v)) for v in speeds), words
        if self.promise is not None:
            curve = self.promise.curve
            words = f"{self.promise.setting} by hcbench: {curve.description}"
            return tuple(float(curve.at(v)) for v in speeds), words
        e = first * second
        if math.isnan(e):
            return (), _UNKNOWN_RESTITUTIONS
        return (e,) * len(speeds), f"restitution {first:g} x {second:g}"

    def suspects(self, impacts: Sequence[Impact], wanted: RestitutionCurve | None) -> list[Suspect]:
        """Return settings that may keep this pair from bouncing as `wanted`, likeliest first.

        A plug-in's law replaces Bullet's contact: with one only settings that act beside it count.
        Suspects of a live client have no fix to try.

        impacts: of the launches.
        wanted: e over speed; None where the user named none.
        """
        changed = self._changed_since_tuned()
        context = BulletContext(
            bullet=self.bullet,
            place=self.place,
            impacts=impacts,
            wanted=wanted,
            timestep=self.timestep,
            gravity=self._gravity(),
            unread=self.world.unread,
        )
        if self.law is None:
            suspects = [*changed, *find_suspects(context)]
        else:
            suspects = changed
            if self.promise is not None and not self.promise.is_kept(impacts):
                suspects += what_distorts(context)
        # A live client: no fix is tried on it.
        if self.build is None:
            return [dataclasses.replace(suspect, apply=None) for suspect in suspects]
        return suspects

    def fixed(self, suspects: Sequence[Suspect]) -> PybulletModel:
        """The same world with the fixes of `suspects` made before the pair is placed.

        It is this world in forked copies of the process, where that is possible; else it is made
        again.
        Raises UserError for a live client, on which no fix is tried, and what `__init__` raises.
        """
        if self.build is None:
            raise UserError(
                "model", "a live client cannot be made again", "files, or a function for it"
            )
        if can_fork(self.bullet):
            return _FixedInForks(self, suspects)
        return self._made_again(suspects)

    def _made_again(self, fixes: Sequence[Suspect]) -> PybulletModel:
        assert self.build is not None, "`fixed` refuses a live client"
        return PybulletModel(self.build(), self.build, self.request, (*self._made, *fixes))

    def close(self) -> None:
        """Remove everything that hcbench added, and restore the user's world."""
        self._end_copy()
        self._put_back()

    def _end_copy(self) -> None:
        if self._copy is not None:
            self._copy.close()
            self._copy = None


class _FixedInForks(PybulletModel):
    """The world of a model under test with fixes made, each time in a forked copy of this process.

    Loading a robot's meshes again takes as long as hundreds of launches; the world itself is as it
    was loaded, because its launches are stepped in forked copies, too.
    """

    def __init__(self, model: PybulletModel, fixes: Sequence[Suspect]) -> None:
        """Bring the pair to touch with the fixes made, in a forked copy of this process.

        model: the model under test, whose own fixes are made, too.
        fixes: suspects.
        Raises UserError where the two cannot be brought to touch, SceneError and QuantityError for
        numbers that no body has, EngineFailed where PyBullet dies.
        """
        # Its world, its request and its parts.
        self.__dict__.update(model.__dict__)
        self._copy = None
        self._fixes = [*getattr(model, "_fixes", ()), *fixes]
        self._take(self._with_fixes(self._placed))

    def _with_fixes(self, function: Callable[[], Answer]) -> Answer:
        """Call a function in a forked copy of this process where the fixes are made, and return its
        result, which must pickle.
        """

        def run() -> Answer:
            self._make_fixes()
            return function()

        return run_aside(self.bullet, run)

    def aside(self, function: Callable[[], Answer]) -> Answer:
        """Call a function that changes the world where the fixes are made."""
        return self._with_fixes(function)

    def _make_fixes(self) -> None:
        for fix in self._fixes:
            if fix.apply is not None:
                fix.apply(self.bullet)

    def facts(self) -> Facts:
        """Properties of the world and of its pair with the fixes made."""
        return self._with_fixes(super().facts)

    def suspects(self, impacts: Sequence[Impact], wanted: RestitutionCurve | None) -> list[Suspect]:
        """Return settings that may keep this pair from bouncing as `wanted`, with the fixes made."""
        return self._with_fixes(partial(super().suspects, impacts, wanted))

    def fixed(self, suspects: Sequence[Suspect]) -> PybulletModel:
        """The same world with more fixes made."""
        return _FixedInForks(self, suspects)

    def close(self) -> None:
        """End what this has of its own: the world is that of the model, which closes it."""
        self._end_copy()


def open_world(source: Any, request: Request, rebuild: Callable[[], Any] | None) -> PybulletModel:
    """The model under test of a PyBullet world and the request's pair in it.

    source: files (paths), a `World`, or a client.
    rebuild: makes the `World` or client again; None where no function built it.
    Raises SceneError for files that do not load and for numbers that no body has, UserError where
    the request does not fit the world, EngineFailed where PyBullet dies.
    """
    return PybulletModel(*loaded(source, rebuild, request.packages), request)


def list_pairs_of(
    source: Any, request: Request, rebuild: Callable[[], Any] | None
) -> list[CandidatePair]:
    """Pairs of links of a world that can meet, in the request's pose.

    source: files, a `World`, or a client.
    rebuild: makes the world again; None where no function built it.
    Raises SceneError for files that do not load, UserError for a pose that does not fit or one file
    alone, EngineFailed where PyBullet dies.
    """
    world, _ = loaded(source, rebuild, request.packages)
    try:
        return run_aside(world.bullet, lambda: _listed(world, request))
    finally:
        if world.disconnect:
            world.bullet.disconnect()


def land_in(
    source: Any, request: Request, drops: DropPlan, rebuild: Callable[[], Any] | None
) -> Landings:
    """Drop the robot of a world from each height, m, and tilt, rad, of a plan, each time in a forked
    copy of this process, and return the landings.

    source: files, a `World`, or a client.
    drops: the plan.
    rebuild: makes the world again; None where no function built it.
    Raises SceneError for files that do not load, UserError where there is no robot or nothing to
    land on, EngineFailed where a velocity is no longer finite.
    """
    world, _ = loaded(source, rebuild, request.packages)
    try:
        return land(world, request, drops)
    finally:
        if world.disconnect:
            world.bullet.disconnect()


def touchdowns_in(
    source: Any, request: Request, recorded: Mapping[str, Floats]
) -> TrajectoryTouchdowns:
    """Find the touchdowns in a recorded motion of a world, which stays as it is.

    source: files, a `World`, or a client.
    request: its pair counts; without one, each link that moves on each body that does not.
    recorded: "qpos" and "qvel", (states, numbers of all bodies that move), in PyBullet's order, and
    "time", s, (states,), where it is known.
    Raises SceneError for files that do not load, UserError for a recording that does not fit the
    world or has numbers that are not finite, and for a pair that the world does not have;
    QuantityError for a quaternion of length 0.
    """
    world, _ = loaded(source, None, request.packages)
    try:
        return run_aside(world.bullet, lambda: touchdowns(world, request, recorded))
    finally:
        if world.disconnect:
            world.bullet.disconnect()


def _listed(world: LoadedWorld, request: Request) -> list[CandidatePair]:
    set_pose(world, request)
    return list_pairs(world)


def loaded(
    source: Any, rebuild: Callable[[], Any] | None, packages: Packages
) -> tuple[LoadedWorld, Callable[[], LoadedWorld] | None]:
    """Load or take up a world; returns it and a function that makes it again, None for a live client.

    source: one path or several, a `World`, a client or its id.
    rebuild: makes the `World` or client again; None where no function built it.
    packages: folders of the packages that URDFs name.
    Raises SceneError for files that do not load, UserError for another source.
    """
    if isinstance(source, str | list | tuple) or hasattr(source, "__fspath__"):
        paths: Sequence[str | Path] = source if isinstance(source, list | tuple) else [source]
        files = [str(path) for path in paths]
        return load_files(files, packages), lambda: load_files(files, packages)
    if rebuild is None:
        return open_live(source, disconnect=False), None
    first = open_live(source, disconnect=True)

    def build() -> LoadedWorld:
        # A script that names no client means the first one, which must be the new one.
        if first.bullet.isConnected():
            first.bullet.disconnect()
        return open_live(rebuild(), disconnect=True)

    return first, build


def model_settings(
    source: Any,
    requests: Sequence[Request],
    goal: RestitutionCurve,
    rebuild: Callable[[], Any] | None,
) -> Iterator[ModelSetting]:
    """Settings that make all given pairs of a world bounce by Bullet's own restitution, each as lines
    of a script, without the defaults that spoil it.

    The first has a speed below which nothing bounces, so that bodies come to rest under gravity; it
    is left out where the world needs none, or where it would reach the launches. The second has
    none.

    source: files, a `World`, or a client.
    rebuild: makes it again; None where no function built it.
    requests: of the pairs, one or more, which differ in the pair alone.
    goal: e over speed; the constant nearest to it over the requests' speeds, m/s, is set.
    Raises UserError for a live client and for a part that is the first of one pair and the second
    of another; SceneError for files that do not load; also what opening a pair raises.
    """
    world, build = loaded(source, rebuild, requests[0].packages)
    if build is None:
        raise UserError(
            "model", "a live client cannot be made again", "files, or a function for it"
        )
    # Requests differ in pairs alone.
    e = goal.best_constant(min(requests[0].speeds), max(requests[0].speeds))
    # Highest speed of hops that bodies at rest make, and lowest speed of a touch, m/s.
    still = 0.0
    slowest = math.inf
    # Each pair at touch, and for its two parts the settings that switch a spring off.
    places: list[tuple[BulletPlacement, list[dict[str, float]]]] = []
    # (body, link) -> 0 for the first of a pair, 1 for the second: only the first gets the e.
    side_of: dict[tuple[int, int], int] = {}
    for i, request in enumerate(requests):
        with PybulletModel(build() if i else world, build, request) as model:
            step, gravity = model.timestep, model.gravity
            still = max(still, speed_of_hops(step, gravity))
            touching = [launch.touch_speed(step, gravity) for launch in request.launches()]
            slowest = min(slowest, *touching)
            parts = (model.place.first, model.place.second)
            places.append((model.place, [without_spring(model.bullet, part) for part in parts]))
            for side, part in enumerate(parts):
                if side_of.setdefault((part.body, part.link), side) != side:
                    got = f"{part.name!r} is the first of one pair and the second of another"
                    advice = "Restitutions multiply: tune one pair after the other"
                    raise UserError("pair", got, "each part on one side", advice)
    needed = unwritten(requests[0])
    if 0.0 < still < slowest:
        rests = f"Below {still:.2g} m/s nothing bounces, so that bodies come to rest."
        yield _restitution(places, e, still, build, (rests, *needed))
    if still > 0.0:
        needed = (*needed, "Bodies with this restitution hop for ever in place of a rest.")
    yield _restitution(places, e, 0.0, build, needed)


def unwritten(request: Request) -> tuple[str, ...]:
    """A sentence on the step and gravity of a request, which no line of a setting makes; none where
    it has those of the world.
    """
    calls = []
    if request.timestep is not None:
        calls.append(f"setTimeStep({time_step(request.timestep)})")
    if request.gravity is not None:
        calls.append(f"setGravity({', '.join(f'{g:g}' for g in request.gravity)})")
    if not calls:
        return ()
    return (f"The world must have {' and '.join(calls)}, with which this was tuned.",)


def _restitution(
    places: Sequence[tuple[BulletPlacement, list[dict[str, float]]]],
    e: float,
    still: float,
    build: Callable[[], LoadedWorld],
    more: tuple[str, ...],
) -> ModelSetting:
    """The setting that gives all pairs one restitution, as lines of a script and as a world to open.

    places: of the pairs, at touch, each with the settings that switch springs of its two parts off.
    e: of each pair.
    still: speed below which nothing bounces, m/s; 0: none.
    build: makes the world.
    more: notes for the user on this setting.
    """
    suspects = [restitution_setting(place, springless, e, still) for place, springless in places]
    # Each line once, in order: pairs may share parts.
    lines: dict[str, None] = {}
    for suspect in suspects:
        lines |= dict.fromkeys(suspect.fix.split("; "))
    parts = [part for place, _ in places for part in (place.first, place.second)]
    text = script_of(lines, parts)
    notes = (
        f"Restitutions multiply: {e:.4g} is on the first, 1 on the second. Set all before the first step.",
        "contactBreakingThreshold outlives resetSimulation and leaks into other clients of the process.",
        *more,
    )

    def opened(request: Request) -> PybulletModel:
        return PybulletModel(build(), build, request, suspects)

    def apply(bullet: BulletClient) -> None:
        for suspect in suspects:
            assert suspect.apply is not None
            suspect.apply(bullet)

    return ModelSetting(
        "restitution",
        notes,
        opened,
        lambda *_: Texts(text),
        source=ChangedWorld(build, apply),
    )
