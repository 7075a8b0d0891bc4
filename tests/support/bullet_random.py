"""Random scenes under PyBullet's plug-in, drawn as a covering design,
and what contact does in each.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import pybullet as bullet
from bullet_scenes import flight_energy
from covering import covering_rows
from drawn_laws import LAWS, law_of

from hcbench.contact import pybullet as contact

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats

FACTORS: dict[str, tuple[Any, ...]] = {
    "shape": ("sphere", "box", "capsule", "cylinder", "mesh", "several shapes"),
    "floor": ("plane", "box", "mesh", "height field"),
    "joint": ("free", "hinge", "slide", "ball joint", "chain", "constraint", "motor"),
    "centre": ("centred mass", "off-centre mass"),
    "coordinates": ("reduced", "maximal"),
    "step": (0.25e-3, 0.5e-3, 1e-3, 2e-3, 4e-3, 5e-3),
    "substeps": (1, 4),
    "law": LAWS,
    "bodies": (1, 2, 4),
    "friction": (0.0, 0.1, 0.5, 1.0),
    "rolling": ("no rolling friction", "rolling friction"),
    "cone": ("pyramid", "cone"),
    "contactERP": (0.08, 0.0),
    "split impulse": ("on", "off"),
    "iterations": (10, 50, 200),
}
CLASSES = (
    "shape",
    "floor",
    "joint",
    "centre",
    "coordinates",
    "step",
    "substeps",
    "law",
    "rolling",
    "contactERP",
)
GRAVITY = 9.81
_NO_TURN = [0, 0, 0, 1]


def allowed(row: dict[str, Any]) -> bool:
    """A constraint holds two bodies; bodies with joints have reduced coordinates; a force of 30
    steps a contact is too soft for a body at coarse steps.
    """
    alone = row.get("joint") == "constraint" and row.get("bodies") == 1
    jointed = row.get("joint", "free") not in ("free", "constraint")
    soft = row.get("law") == "force" and row.get("step", 0.0) > 1e-3
    return not (alone or soft or (jointed and row.get("coordinates") == "maximal"))


@functools.cache
def design(count: int) -> list[dict[str, Any]]:
    """The first rows of the design."""
    return covering_rows(FACTORS, count, allowed)


class World:
    """A client with a scene of the design; the rest of it is drawn from the seed.

    contact: "plug-in", "native", or "none": bodies pass through each other.
    """

    def __init__(self, row: dict[str, Any], seed: int, contact: str) -> None:
        self.row, self.rng = row, np.random.default_rng(seed)
        self.client = bullet.connect(bullet.DIRECT)
        self.here = {"physicsClientId": self.client}
        self.h, self.substeps = row["step"], row["substeps"]
        bullet.setGravity(0, 0, -GRAVITY, **self.here)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=self.h * self.substeps, numSubSteps=self.substeps if self.substeps > 1 else 0,
            contactERP=row["contactERP"], enableConeFriction=int(row["cone"] == "cone"),
            numSolverIterations=row["iterations"], deterministicOverlappingPairs=1,
            useSplitImpulse=int(row["split impulse"] == "on"), **self.here,
        )  # fmt: skip
        self.floor = self._floor()
        self.bodies = [self._body(i) for i in range(row["bodies"])]
        self.held = self._constrain() if row["joint"] == "constraint" else None
        self.links = [
            (body, link)
            for body in self.bodies
            for link in range(-1, bullet.getNumJoints(body, **self.here))
        ]
        self.masses = {one: bullet.getDynamicsInfo(*one, **self.here)[0:3:2] for one in self.links}
        self._set_surfaces()
        self._start()
        self.plugin = self._add_laws() if contact == "plug-in" else None
        if contact == "none":
            for body, link in self.links:
                bullet.setCollisionFilterGroupMask(body, link, 0, 0, **self.here)

    def _floor(self) -> int:
        kind, height = self.row["floor"], 0.0
        if kind == "plane":
            shape: dict[str, Any] = {"shapeType": bullet.GEOM_PLANE}
        elif kind == "box":
            shape, height = {"shapeType": bullet.GEOM_BOX, "halfExtents": [2, 2, 0.2]}, -0.2
        elif kind == "mesh":
            corners = [[x, y, 0] for x in (-2, 0, 2) for y in (-2, 0, 2)]
            indices: list[int] = []
            for at in (0, 1, 3, 4):
                indices += [at, at + 3, at + 1, at + 1, at + 3, at + 4]
            shape = {"shapeType": bullet.GEOM_MESH, "vertices": corners, "indices": indices}
        else:
            heights = self.rng.uniform(0, 0.02, 16 * 16)
            shape = {
                "shapeType": bullet.GEOM_HEIGHTFIELD, "meshScale": [0.25, 0.25, 1],
                "heightfieldData": heights.tolist(), "numHeightfieldRows": 16, "numHeightfieldColumns": 16,
            }  # fmt: skip
            height = -0.5 * float(heights.max() - heights.min())
        made = bullet.createCollisionShape(**shape, **self.here)
        return int(bullet.createMultiBody(0, made, basePosition=[0, 0, height], **self.here))

    def _shape(self, size: Floats, at: Floats) -> int:
        """A shape of the scene's kind; size: half, m; at: its place."""
        kind = self.row["shape"]
        parts = [kind] if kind != "several shapes" else ["box", "sphere", "capsule"]
        given: list[dict[str, Any]] = []
        for k, part in enumerate(parts):
            half = size * (1 - 0.2 * k)
            place = at + (0.04 * self.rng.normal(size=3) if k else 0)
            given.append(_part(part, half, self.rng) | {"place": place.tolist()})
        if len(given) == 1:
            one = given[0]
            place = one.pop("place")
            return int(
                bullet.createCollisionShape(**one, collisionFramePosition=place, **self.here)
            )
        box, ball, capsule = given
        return int(
            bullet.createCollisionShapeArray(
                shapeTypes=[one["shapeType"] for one in given],
                halfExtents=[box["halfExtents"], [0, 0, 0], [0, 0, 0]],
                radii=[0, ball["radius"], capsule["radius"]], lengths=[0, 0, capsule["height"]],
                collisionFramePositions=[one["place"] for one in given], **self.here,
            )
        )  # fmt: skip

    def _off_centre(self, size: Floats) -> Floats:
        is_off = self.row["centre"] == "off-centre mass"
        return np.asarray(0.4 * size * self.rng.normal(size=3) if is_off else np.zeros(3))

    def _body(self, i: int) -> int:
        rng, joint = self.rng, self.row["joint"]
        on_world = joint in ("hinge", "slide", "ball joint")
        size, mass = rng.uniform(0.025, 0.055, 3), float(10 ** rng.uniform(-0.7, 0.7))
        height = {"hinge": 0.16, "ball joint": 0.16, "chain": 0.3, "motor": 0.22}.get(joint, 0.14)
        at = [
            *(0.1 * rng.uniform(-1, 1, 2)),
            height + (0.3 if joint in ("chain", "motor") else 0.2) * i,
        ]
        turn = rng.normal(size=4) if joint != "slide" else np.array(_NO_TURN)
        more: dict[str, Any] = {}
        if on_world:
            kinds = {"hinge": bullet.JOINT_REVOLUTE, "slide": bullet.JOINT_PRISMATIC}
            axis = rng.normal(size=3) if joint != "slide" else np.array([0.2 * rng.normal(), 0, 1])
            arm = np.array([0, 0, 0.0 if joint == "slide" else -0.08])
            more = self._links(
                [kinds.get(joint, bullet.JOINT_SPHERICAL)], [axis], np.zeros(3), arm, mass
            )
            mass, shape, centre = 0.0, -1, np.zeros(3)
        else:
            centre = self._off_centre(size)
            shape = self._shape(size, np.zeros(3))
        if joint in ("chain", "motor"):
            hinges = 2 if joint == "chain" else 1
            away, arm = np.array([0.07, 0, 0]), np.array([0.07, 0, 0])
            axes = list(np.eye(3)[rng.integers(3, size=hinges)])
            more = self._links([bullet.JOINT_REVOLUTE] * hinges, axes, away, arm, mass)
        made = bullet.createMultiBody(
            mass, shape, basePosition=at, baseOrientation=(turn / np.linalg.norm(turn)).tolist(),
            baseInertialFramePosition=centre.tolist(),
            useMaximalCoordinates=self.row["coordinates"] == "maximal", **more, **self.here,
        )  # fmt: skip
        return int(made)

    def _links(
        self, kinds: list[int], axes: list[Floats], away: Floats, arm: Floats, mass: float
    ) -> dict[str, Any]:
        """Links in a row. away: a joint from the one before; arm: the shape from its joint."""
        sizes = [self.rng.uniform(0.025, 0.045, 3) for _ in kinds]
        masses = [mass * 10 ** self.rng.uniform(-0.7, 0.3) for _ in kinds]
        centres = [arm + self._off_centre(size) for size in sizes]
        count = len(kinds)
        return {
            "linkMasses": masses,
            "linkCollisionShapeIndices": [self._shape(size, arm) for size in sizes],
            "linkVisualShapeIndices": [-1] * count,
            "linkPositions": [(away + (arm if i else 0)).tolist() for i in range(count)],
            "linkOrientations": [_NO_TURN] * count,
            "linkInertialFramePositions": [centre.tolist() for centre in centres],
            "linkInertialFrameOrientations": [_NO_TURN] * count,
            "linkParentIndices": list(range(count)),
            "linkJointTypes": kinds,
            "linkJointAxis": [(axis / np.linalg.norm(axis)).tolist() for axis in axes],
        }

    def _constrain(self) -> set[int]:
        one, two = self.bodies[:2]
        (at, turn), (other, turned) = (
            bullet.getBasePositionAndOrientation(body, **self.here) for body in (one, two)
        )
        kind = bullet.JOINT_FIXED if self.row["bodies"] == 2 else bullet.JOINT_POINT2POINT
        middle = (0.5 * (np.array(at) + other)).tolist()
        frames = []
        for place, rotation in ((at, turn), (other, turned)):
            frames.append(
                bullet.multiplyTransforms(
                    *bullet.invertTransform(place, rotation), middle, _NO_TURN
                )
            )
        (pivot, axes), (other_pivot, other_axes) = frames
        bullet.createConstraint(
            one, -1, two, -1, kind, [0, 0, 0], pivot, other_pivot, axes, other_axes, **self.here
        )
        bullet.setCollisionFilterPair(one, two, -1, -1, 0, **self.here)
        return {one, two}

    def _set_surfaces(self) -> None:
        rolls = self.row["rolling"] == "rolling friction"
        for body, link in [*self.links, (self.floor, -1)]:
            bullet.changeDynamics(
                body, link, linearDamping=0, angularDamping=0, jointDamping=0, restitution=0,
                lateralFriction=self.row["friction"] ** 0.5, rollingFriction=1e-3 * rolls,
                spinningFriction=1e-3 * rolls, **self.here,
            )  # fmt: skip

    def _start(self) -> None:
        rng, joint = self.rng, self.row["joint"]
        for k, (body, link) in enumerate(self.links):
            if link < 0:
                if joint not in ("hinge", "slide", "ball joint"):
                    speed, spin = 0.8 * rng.normal(size=3) - [0, 0, 1], 6 * rng.normal(size=3)
                    bullet.resetBaseVelocity(body, speed.tolist(), spin.tolist(), **self.here)
                continue
            if joint == "ball joint":
                free = {
                    "controlMode": bullet.POSITION_CONTROL,
                    "force": [0, 0, 0],
                    "targetPosition": _NO_TURN,
                }
                bullet.setJointMotorControlMultiDof(body, link, **free, **self.here)
                rate = (3 * rng.normal(size=3)).tolist()
                bullet.resetJointStateMultiDof(body, link, _NO_TURN, rate, **self.here)
                continue
            rate = -abs(rng.normal()) if joint == "slide" else 3 * rng.normal()
            bullet.resetJointState(body, link, 0, rate, **self.here)
            force = rng.choice([0.1, 1, 10]) if joint == "motor" else 0
            mode = (
                bullet.POSITION_CONTROL if joint == "motor" and k % 2 else bullet.VELOCITY_CONTROL
            )
            bullet.setJointMotorControl2(body, link, mode, force=force, **self.here)

    def _add_laws(self) -> int:
        plugin = contact.load(self.client)
        for one, two in combinations([*self.bodies, self.floor], 2):
            if {one, two} == self.held:
                continue
            text = contact.command(law_of(self.row))
            made = bullet.executePluginCommand(plugin, text, [one, -2, two, -2], **self.here)
            assert made >= 0, self.message()
        return plugin

    def message(self) -> str:
        """Last message of the plug-in; empty without it."""
        if self.plugin is None:
            return ""
        said = bullet.executePluginCommand(self.plugin, "message", **self.here)[2]
        return bytes(part & 255 for part in said[:-1]).decode()

    def step(self) -> None:
        """Take a step of Bullet."""
        bullet.stepSimulation(**self.here)

    def depth(self) -> float:
        """Depth of the deepest contact, m; below 0 where none overlaps."""
        return max((-point[8] for point in bullet.getContactPoints(**self.here)), default=-1.0)

    def places(self) -> list[Any]:
        """Pose of each body, and the positions of its joints."""
        return [
            bullet.getBasePositionAndOrientation(body, **self.here)
            if link < 0
            else bullet.getJointStateMultiDof(body, link, **self.here)[0]
            for body, link in self.links
        ]

    def rates(self) -> list[Floats]:
        """Velocity and spin of each base, the rates of each joint."""
        return [
            np.concatenate(bullet.getBaseVelocity(body, **self.here))
            if link < 0
            else np.array(bullet.getJointStateMultiDof(body, link, **self.here)[1])
            for body, link in self.links
        ]

    def put(self, places: list[Any], rates: list[Floats]) -> None:
        """Put all bodies there, with these rates."""
        for (body, link), place, rate in zip(self.links, places, rates, strict=True):
            if link < 0:
                bullet.resetBasePositionAndOrientation(body, *place, **self.here)
                bullet.resetBaseVelocity(body, rate[:3].tolist(), rate[3:].tolist(), **self.here)
            else:
                bullet.resetJointStateMultiDof(body, link, place, rate.tolist(), **self.here)

    def energy(self) -> float:
        """Kinetic and potential, J, as steps keep it in flight: half a
        step of gravity in each velocity.
        """
        return flight_energy(self.masses, GRAVITY, self.h, self.here)

    def close(self) -> None:
        """Disconnect."""
        bullet.disconnect(self.client)


def _part(kind: str, half: Floats, rng: Any) -> dict[str, Any]:
    if kind == "box":
        return {"shapeType": bullet.GEOM_BOX, "halfExtents": half.tolist()}
    if kind == "mesh":
        corners = rng.normal(size=(14, 3))
        corners *= half / np.linalg.norm(corners, axis=1)[:, None]
        return {"shapeType": bullet.GEOM_MESH, "vertices": corners.tolist()}
    shape = {
        "sphere": bullet.GEOM_SPHERE,
        "capsule": bullet.GEOM_CAPSULE,
        "cylinder": bullet.GEOM_CYLINDER,
    }
    made = {"shapeType": shape[kind], "radius": float(half[0])}
    return made if kind == "sphere" else made | {"height": 2 * float(half[1])}


@dataclass
class Seen:
    """gain: of contact, over the first energy; depth: the largest, m; both NaN where the state was.

    named: what the plug-in said.
    """

    gain: float
    depth: float
    named: str


def simulate(row: dict[str, Any], seed: int, seconds: float, native: bool = False) -> Seen | None:
    """Simulate a scene with the plug-in, or with Bullet's native contact of e = 0; None if bodies
    overlap at the start, as energy from that is not contact's.

    What Bullet's own step gains, going on without contact from the velocities after the
    impacts, is not contact's gain.
    """
    world, flight = World(row, seed, "native" if native else "plug-in"), World(row, seed, "none")
    try:
        bullet.performCollisionDetection(**world.here)
        if world.depth() > 0 or _overlap(world):
            return None
        return _follow(world, flight, seconds)
    finally:
        world.close()
        flight.close()


def _overlap(world: World) -> bool:
    """Bullet tells contacts of pairs under a force law only when asked for the closest points."""
    return any(
        point[8] < 0
        for one, two in combinations([*world.bodies, world.floor], 2)
        if {one, two} != world.held
        for point in bullet.getClosestPoints(one, two, 0.0, **world.here)
    )


def _follow(world: World, flight: World, seconds: float) -> Seen:
    first = max(world.energy(), 1e-3)
    won, low, most, deepest = 0.0, 0.0, 0.0, 0.0
    has_force = world.row["law"] == "force"
    for _ in range(round(seconds / (world.h * world.substeps))):
        places, before, start = world.places(), world.rates(), world.energy()
        world.step()
        after = world.rates()
        if not np.isfinite(np.concatenate(after)).all():
            return Seen(np.nan, np.nan, world.message())
        deepest = max(deepest, world.depth())
        if world.plugin is None:
            continue
        flight.put(places, before)
        flight.step()
        free = flight.rates()
        if max(float(np.abs(x - y).max()) for x, y in zip(after, free, strict=True)) < 1e-9:
            continue
        gained = world.energy() - start
        if gained > -1e-5 * first:
            gained -= _gain_of_flight(flight, places, before, after, free)
        won += gained
        low = (
            low if has_force else min(low, won)
        )  # a force gives back what it took in the steps before
        most = max(most, won - low)
    return Seen(most / first, deepest, world.message())


def _gain_of_flight(
    flight: World,
    places: list[Any],
    before: list[Floats],
    after: list[Floats],
    reached: list[Floats],
) -> float:
    """Energy (J) that a step of `flight` gains that leads to the rates `after`.

    reached: the rates to which a step from `before` leads.
    """
    rates, best, gain = before, np.inf, 0.0
    for _ in range(12):
        missing = [x - y for x, y in zip(after, reached, strict=True)]
        rates = [x + y for x, y in zip(rates, missing, strict=True)]
        flight.put(places, rates)
        start = flight.energy()
        flight.step()
        reached = flight.rates()
        off = max(float(np.abs(x - y).max()) for x, y in zip(after, reached, strict=True))
        settled = not off < 0.5 * best  # constraints leave the rates that they take away open
        if off < best:
            best, gain = off, flight.energy() - start
        if off < 1e-8 or settled:
            break
    return gain


def classes(rows: list[dict[str, Any]]) -> dict[str, list[int]]:
    """The scenes of each class that the page has, by their numbers."""
    made = {"all": list(range(len(rows)))}
    for factor in CLASSES:
        for level in FACTORS[factor]:
            name = f"{level * 1e3:g} ms" if factor == "step" else str(level)
            made[f"{factor}: {name}"] = [i for i, row in enumerate(rows) if row[factor] == level]
    return made
