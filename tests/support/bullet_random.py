"""Random scenes in PyBullet under the restitution plug-in, and the energy that contact wins in them."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import pybullet as bullet
from bullet_scenes import flight_energy

from hcbench.contact import pybullet as contact

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats

KINDS = ("friction", "rolling friction", "compound shapes", "joints with motors")
GRAVITY = 9.81


class World:
    """A client with bodies that fall on each other and a floor; without `contact` they pass through."""

    def __init__(self, seed: int, kind: str, contact: bool = True) -> None:
        self.rng, self.kind, self.client = np.random.default_rng(seed), kind, bullet.connect(bullet.DIRECT)
        self.here = {"physicsClientId": self.client}
        self.h = float(self.rng.choice([1e-3, 2e-3, 1 / 240, 4e-3]))
        bullet.setTimeStep(self.h, **self.here)
        bullet.setGravity(0, 0, -GRAVITY, **self.here)
        bullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, **self.here)
        if self.rng.random() < 0.5:
            bullet.setPhysicsEngineParameter(contactERP=0, **self.here)
        rolling = kind == "rolling friction"
        self.surface = {
            "lateralFriction": float(self.rng.choice([0, 0.3, 0.7, 1.0])),
            "rollingFriction": float(self.rng.choice([1e-4, 1e-3, 1e-2])) if rolling else 0.0,
            "spinningFriction": float(self.rng.choice([0, 1e-3])) if rolling else 0.0,
            "restitution": 0.0,
        }
        is_plane = self.rng.random() < 0.5
        shape = {"shapeType": bullet.GEOM_PLANE} if is_plane else _box([3, 3, 0.5])
        made = bullet.createCollisionShape(**shape, **self.here)
        floor = bullet.createMultiBody(0, made, basePosition=[0, 0, 0 if is_plane else -0.5], **self.here)
        bullet.changeDynamics(floor, -1, **self.surface, **self.here)
        self.maximal = kind == "friction" and bool(self.rng.random() < 0.3)
        count = int(self.rng.integers(1, 4 if kind == KINDS[3] else 6))
        self.bodies = [self._body(i) for i in range(count)]
        self.masses = {
            (body, link): bullet.getDynamicsInfo(body, link, **self.here)[0:3:2]
            for body in self.bodies
            for link in range(-1, bullet.getNumJoints(body, **self.here))
        }
        if contact:
            self._add_laws(floor)
        else:
            for body, link in self.masses:
                bullet.setCollisionFilterGroupMask(body, link, 0, 0, **self.here)

    def _shape(self, size: float) -> int:
        rng = self.rng
        if self.kind == "compound shapes" and rng.random() < 0.8:
            parts: dict[str, Any] = {
                "shapeTypes": [bullet.GEOM_BOX] * 2,
                "halfExtents": [[size, size / 2, 0.4 * size], [0.3 * size, 0.3 * size, size]],
                "collisionFramePositions": [[0, 0, 0], [size, 0, size / 2]],
            }
            if rng.random() < 0.5:  # a dumb-bell
                parts = {
                    "shapeTypes": [bullet.GEOM_SPHERE] * 2,
                    "radii": [0.6 * size] * 2,
                    "collisionFramePositions": [[-1.2 * size, 0, 0], [1.2 * size, 0, 0]],
                }
            return int(bullet.createCollisionShapeArray(**parts, **self.here))
        shapes = [
            {"shapeType": bullet.GEOM_SPHERE, "radius": size},
            _box(rng.uniform(0.4 * size, 1.3 * size, 3).tolist()),
            {"shapeType": bullet.GEOM_CAPSULE, "radius": size / 2, "height": 2 * size},
            {"shapeType": bullet.GEOM_CYLINDER, "radius": 0.6 * size, "height": 2 * size},
        ]
        return int(
            bullet.createCollisionShape(**shapes[rng.choice(4, p=[0.4, 0.35, 0.15, 0.1])], **self.here)
        )

    def _links(self, mass: float) -> dict[str, Any]:
        count, rng = int(self.rng.integers(1, 4)), self.rng
        turning = [bullet.JOINT_REVOLUTE, bullet.JOINT_REVOLUTE, bullet.JOINT_PRISMATIC]
        return {
            "linkMasses": (mass * 10 ** rng.uniform(-0.7, 0.3, count)).tolist(),
            "linkCollisionShapeIndices": [self._shape(rng.uniform(0.03, 0.05)) for _ in range(count)],
            "linkVisualShapeIndices": [-1] * count,
            "linkPositions": [[*rng.uniform(-0.03, 0.03, 2), 0.1] for _ in range(count)],
            "linkOrientations": [[0, 0, 0, 1]] * count,
            "linkInertialFramePositions": [[0, 0, 0.05]] * count,
            "linkInertialFrameOrientations": [[0, 0, 0, 1]] * count,
            "linkParentIndices": [int(rng.integers(0, i + 1)) for i in range(count)],
            "linkJointTypes": rng.choice(turning, count).tolist(),
            "linkJointAxis": np.eye(3)[rng.integers(3, size=count)].tolist(),
        }

    def _body(self, i: int) -> int:
        rng, jointed = self.rng, self.kind == KINDS[3]
        at = [*rng.uniform(-0.12, 0.12, 2), 0.33 + 0.35 * i if jointed else 0.13 + 0.17 * i]
        turn, mass = rng.normal(size=4), float(10 ** rng.uniform(-1, 1))
        made = bullet.createMultiBody(
            mass, self._shape(rng.uniform(0.03, 0.07)), basePosition=at, useMaximalCoordinates=self.maximal,
            baseOrientation=(turn / np.linalg.norm(turn)).tolist(), **(self._links(mass) if jointed else {}),
            **self.here,
        )  # fmt: skip
        joints = range(bullet.getNumJoints(made, **self.here))
        for link in (-1, *joints):
            free = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 0}
            bullet.changeDynamics(made, link, **free, **self.surface, **self.here)
        speed = 0.8 * rng.normal(size=3) - [0, 0, 1]
        bullet.resetBaseVelocity(made, speed.tolist(), (6 * rng.normal(size=3)).tolist(), **self.here)
        for joint in joints:
            turns = bullet.getJointInfo(made, joint, **self.here)[2] == bullet.JOINT_REVOLUTE
            bullet.resetJointState(made, joint, 0, rng.normal() * (3 if turns else 0.3), **self.here)
            motor = [bullet.VELOCITY_CONTROL, bullet.POSITION_CONTROL][int(rng.random() < 0.4)]
            bullet.setJointMotorControl2(made, joint, motor, force=rng.choice([0, 0.1, 1, 10]), **self.here)
        return int(made)

    def _add_laws(self, floor: int) -> None:
        self.plugin = contact.load(self.client)
        for one, two in combinations([*self.bodies, floor], 2):
            law = f"alpha={self.rng.choice([0.05, 0.315, 1, 3])}"
            if self.rng.random() < 0.5:
                law = f"constant={self.rng.choice([0, 0.3, 0.5, 0.7, 0.9, 1])}"
            pair = [one, -2, two, -2]
            assert bullet.executePluginCommand(self.plugin, f"restitution {law}", pair, **self.here) >= 0

    def message(self) -> str:
        """Last message of the plug-in."""
        said = bullet.executePluginCommand(self.plugin, "message", **self.here)[2]
        return bytes(part & 255 for part in said[:-1]).decode()

    def step(self) -> None:
        """Take steps of Bullet."""
        bullet.stepSimulation(**self.here)

    def places(self) -> list[Any]:
        """Pose of each body, and the positions of its joints."""
        return [
            (bullet.getBasePositionAndOrientation(body, **self.here), [at for at, _ in self._joints(body)])
            for body in self.bodies
        ]

    def rates(self) -> list[Floats]:
        """Velocity, spin and the rates of the joints of each body."""
        return [
            np.concatenate([*bullet.getBaseVelocity(body, **self.here), [v for _, v in self._joints(body)]])
            for body in self.bodies
        ]

    def _joints(self, body: int) -> list[Any]:
        joints = range(bullet.getNumJoints(body, **self.here))
        return [bullet.getJointState(body, joint, **self.here)[:2] for joint in joints]

    def put(self, places: list[Any], rates: list[Floats]) -> None:
        """Put all bodies there, with these rates."""
        for body, (pose, joints), rate in zip(self.bodies, places, rates, strict=True):
            bullet.resetBasePositionAndOrientation(body, *pose, **self.here)
            bullet.resetBaseVelocity(body, rate[:3].tolist(), rate[3:6].tolist(), **self.here)
            for joint, at in enumerate(joints):
                bullet.resetJointState(body, joint, at, rate[6 + joint], **self.here)

    def energy(self) -> float:
        """Kinetic and potential, J, as steps keep it in flight: half a step of gravity in each velocity."""
        return flight_energy(self.masses, GRAVITY, self.h, self.here)


def _box(half: list[float]) -> dict[str, Any]:
    return {"shapeType": bullet.GEOM_BOX, "halfExtents": half}


def energy_won(seed: int, kind: str, seconds: float) -> tuple[float, str]:
    """The largest rise of what contact has won, over the energy at the start; what the plug-in said of it.

    In a step contact wins E(v + dv) - E(v), where Bullet's own step without contact goes from v + dv to
    the velocities that the step with contact has: what that step wins or loses by itself is not contact's.
    """
    world, flight = World(seed, kind), World(seed, kind, contact=False)
    start, won, low, most = world.energy(), 0.0, 0.0, 0.0
    for _ in range(round(seconds / world.h)):
        places, before = world.places(), world.rates()
        world.step()
        if world.message():
            break
        if not bullet.getContactPoints(**world.here):
            continue
        after = world.rates()
        rates = _rates_after_impacts(flight, places, before, after)
        flight.put(places, rates)
        with_contact = flight.energy()
        flight.put(places, before)
        won += with_contact - flight.energy()
        low = min(low, won)
        most = max(most, won - low)
        assert np.isfinite(np.concatenate(after)).all()
    said = world.message()
    for one in (world, flight):
        bullet.disconnect(one.client)
    return most / start, said


def _rates_after_impacts(
    flight: World, places: list[Any], before: list[Floats], after: list[Floats]
) -> list[Floats]:
    """The rates from which a step of `flight` leads to those `after`."""
    rates, best = before, (np.inf, before)
    for _ in range(12):
        flight.put(places, rates)
        flight.step()
        missing = [x - y for x, y in zip(after, flight.rates(), strict=True)]
        off = float(np.abs(np.concatenate(missing)).max())
        best = min(best, (off, rates), key=lambda one: one[0])
        if off < 1e-9:
            break
        rates = [x + y for x, y in zip(rates, missing, strict=True)]
    return best[1]
