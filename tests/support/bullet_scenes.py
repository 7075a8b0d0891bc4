"""Scenes with several contacts at once in PyBullet, and what becomes of their energy."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import pybullet as bullet
from free_flight import before_turning

from hcbench.contact import pybullet as contact
from hcbench.contact.pybullet import ConstantRestitution, Restitution

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from hcbench.laws.contact_law import Law
    from hcbench.terms.impact import Floats

RADIUS = 0.05
Masses = dict[
    tuple[int, int], Any
]  # (mass, inertia about its axes) by (body, link); -1 is the base


def flight_energy(masses: Masses, gravity: float, h: float, here: dict[str, Any]) -> float:
    """Kinetic and potential, J, as steps h keep it in flight: half a
    step of gravity in each velocity.
    """
    total = 0.0
    for (body, link), (mass, inertia) in masses.items():
        at, turn = bullet.getBasePositionAndOrientation(body, **here)
        v, w = bullet.getBaseVelocity(body, **here)
        if link >= 0:
            at, turn, *_, v, w = bullet.getLinkState(body, link, 1, 1, **here)
        m = bullet.getMatrixFromQuaternion(turn)
        own = [m[i] * w[0] + m[i + 3] * w[1] + m[i + 6] * w[2] for i in range(3)]
        total += mass * (0.5 * sum(x * x for x in v) + gravity * (at[2] - 0.5 * h * v[2]))
        total += 0.5 * sum(i * x * x for i, x in zip(inertia, own, strict=True))
    return float(total)


class Scene:
    """A client of its own; bodies that meet each other and, if there is one, the floor by one law."""

    def __init__(
        self,
        h: float,
        law: Law | None,
        gravity: float = 9.81,
        floor: bool = True,
        friction: float = 0.5,
    ):
        self.client, self.h, self.law = bullet.connect(bullet.DIRECT), h, law
        self.gravity, self.friction = gravity, friction
        self.here = {"physicsClientId": self.client}
        bullet.setPhysicsEngineParameter(fixedTimeStep=h, numSubSteps=0, **self.here)
        bullet.setGravity(0, 0, -gravity, **self.here)
        self.bodies: list[int] = []
        self._masses: Masses = {}
        self.floor = self.body((0, 0, -1), (5, 5, 1), mass=0) if floor else None

    def body(
        self,
        at: ArrayLike,
        size: ArrayLike = RADIUS,
        mass: float = 1.0,
        turn: ArrayLike = (0, 0, 0, 1),
        velocity: ArrayLike = (0, 0, 0),
        spin: ArrayLike = (0, 0, 0),
    ) -> int:
        """A sphere (a radius), a box (three half sizes), or a plane (infinite)."""
        if np.isinf(size).any():
            shape = bullet.createCollisionShape(bullet.GEOM_PLANE, **self.here)
        elif np.ndim(size):
            shape = bullet.createCollisionShape(
                bullet.GEOM_BOX, halfExtents=np.array(size).tolist(), **self.here
            )
        else:
            shape = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=size, **self.here)
        made = int(
            bullet.createMultiBody(mass, shape, basePosition=at, baseOrientation=turn, **self.here)
        )
        free = {
            "linearDamping": 0,
            "angularDamping": 0,
            "lateralFriction": self.friction if mass else 1.0,
        }
        bullet.changeDynamics(
            made, -1, **free, **self.here
        )  # Bullet multiplies the friction of the two
        bullet.resetBaseVelocity(made, velocity, spin, **self.here)
        if mass:
            self.bodies.append(made)
        return made

    def ready(self, link: int = -1) -> Scene:
        """The scene with the law between all pairs of bodies, of which `link` has the shape."""
        pairs = [((one, link), (two, link)) for one, two in combinations(self.bodies, 2)]
        if self.floor is not None:
            pairs += [((body, link), (self.floor, -1)) for body in self.bodies]
        if self.law is not None:
            own = None if self.floor is not None else self.friction
            for one, two in pairs:
                contact.add(self.law, one, two, client=self.client, friction=own)
        return self

    def put(self, which: int, at: ArrayLike, velocity: ArrayLike) -> None:
        """Put a body somewhere, upright."""
        bullet.resetBasePositionAndOrientation(self.bodies[which], at, (0, 0, 0, 1), **self.here)
        bullet.resetBaseVelocity(self.bodies[which], velocity, (0, 0, 0), **self.here)

    def step(self, count: int = 1) -> None:
        """Take steps of Bullet."""
        for _ in range(count):
            bullet.stepSimulation(**self.here)

    def state(self) -> tuple[Floats, Floats]:
        """Positions and velocities, shape (bodies, 3)."""
        at = [bullet.getBasePositionAndOrientation(body, **self.here)[0] for body in self.bodies]
        return np.array(at), np.array(
            [bullet.getBaseVelocity(body, **self.here)[0] for body in self.bodies]
        )

    def energy(self) -> float:
        """Kinetic and potential, J, as steps keep it in flight: half a
        step of gravity in each velocity.
        """
        for body in self.bodies:
            link = bullet.getNumJoints(body, **self.here) - 1  # the bob of a pendulum, or the base
            if (body, link) not in self._masses:
                self._masses[body, link] = bullet.getDynamicsInfo(body, link, **self.here)[0:3:2]
        return flight_energy(self._masses, self.gravity, self.h, self.here)

    def motions(self) -> Floats:
        """Velocities, spins and the rates of joints, shape (n, 3): of a joint the rate comes first."""
        rows: list[Any] = []
        for body in self.bodies:
            rows += bullet.getBaseVelocity(body, **self.here)
            joints = range(bullet.getNumJoints(body, **self.here))
            rows += [(bullet.getJointState(body, joint, **self.here)[1], 0, 0) for joint in joints]
        return np.array(rows)

    def step_beside(self, flight: Scene) -> float:
        """Step; what it won after its impacts, J. flight: this scene with collisions off."""
        for again in range(2):
            for body in self.bodies:
                flight.set_body(body, self)
            if not again:
                flight.step()
                free = flight.motions()
        before = self.motions()
        self.step()
        flight.set_motions(before + self.motions() - free)
        return max(0.0, self.energy() - flight.energy())

    def set_motions(self, rows: Floats) -> None:
        """Velocities, spins and joint rates in the order of `motions`, at the places where all is."""
        left = iter(rows.tolist())
        for body in self.bodies:
            bullet.resetBaseVelocity(body, next(left), next(left), **self.here)
            for joint in range(bullet.getNumJoints(body, **self.here)):
                at = bullet.getJointState(body, joint, **self.here)[0]
                bullet.resetJointState(body, joint, at, next(left)[0], **self.here)

    def without_contact(self) -> Scene:
        """This scene with collisions off."""
        for body in self.bodies:
            for link in range(-1, bullet.getNumJoints(body, **self.here)):
                bullet.setCollisionFilterGroupMask(body, link, 0, 0, **self.here)
        return self

    def set_body(self, body: int, other: Scene) -> None:
        """Give a body the state that it has in the other scene."""
        bullet.resetBasePositionAndOrientation(
            body, *bullet.getBasePositionAndOrientation(body, **other.here), **self.here
        )
        bullet.resetBaseVelocity(body, *bullet.getBaseVelocity(body, **other.here), **self.here)
        for joint in range(bullet.getNumJoints(body, **self.here)):
            bullet.resetJointState(
                body, joint, *bullet.getJointState(body, joint, **other.here)[:2], **self.here
            )

    def close(self) -> None:
        """Disconnect."""
        bullet.disconnect(self.client)


def rise(make: Callable[[Law | None], Scene], law: Law, seconds: float) -> float:
    """Largest energy above the start, less what steps without contact
    won until then, over the start.
    """
    scene, flight = make(law), make(None).without_contact()
    start = scene.energy()
    own = highest = 0.0
    steps = round(seconds / scene.h)
    most = start
    for _ in range(steps):
        scene.step()
        most = max(most, scene.energy())
    if most > start:  # again, with a look at who won it
        scene.close()
        scene = make(law)
        for _ in range(steps):
            own += scene.step_beside(flight)
            highest = max(highest, scene.energy() - start - own)
    scene.close()
    flight.close()
    return highest / max(abs(start), 1e-9)


def row(
    n: int, h: float, law: Law | None, moving: int = 1, speed: float = 1.0, friction: float = 0.0
) -> Scene:
    """Balls that touch in a row without gravity; the first ones come in."""
    made = Scene(h, law, gravity=0.0, floor=False, friction=friction)
    for i in range(n):
        gap = 0.1 * RADIUS if i < moving else 0.0
        made.body((2 * RADIUS * i - gap, 0, 0), velocity=(speed if i < moving else 0, 0, 0))
    return made.ready()


def rack(h: float, law: Law | None, speed: float = 3.0, friction: float = 0.1) -> Scene:
    """Ten balls on a table, and a cue ball that breaks them."""
    made = Scene(h, law, friction=friction)
    made.body((-0.3, 0, RADIUS), velocity=(speed, 0, 0))
    for i in range(4):
        for j in range(i + 1):
            made.body((np.sqrt(3) * RADIUS * i, RADIUS * (2 * j - i), RADIUS))
    return made.ready()


def stack(n: int, h: float, law: Law | None, friction: float = 0.5, gap: float = 0.0) -> Scene:
    """Boxes on each other."""
    made = Scene(h, law, friction=friction)
    for i in range(n):
        made.body((0, 0, RADIUS * (2 * i + 1) + gap * (i + 1)), (RADIUS,) * 3)
    return made.ready()


def cradle(n: int, h: float, law: Law | None, angle: float = 0.5) -> Scene:
    """Balls on hinges that touch; the first one is lifted."""
    made = Scene(h, law, floor=False, friction=0.0)
    ball = bullet.createCollisionShape(
        bullet.GEOM_SPHERE, radius=RADIUS, collisionFramePosition=[0, 0, -0.5], **made.here
    )
    hinge = {
        "linkMasses": [1.0],
        "linkCollisionShapeIndices": [ball],
        "linkVisualShapeIndices": [-1],
        "linkPositions": [[0, 0, 0]],
        "linkOrientations": [[0, 0, 0, 1]],
        "linkInertialFramePositions": [[0, 0, -0.5]],
        "linkInertialFrameOrientations": [[0, 0, 0, 1]],
        "linkParentIndices": [0],
        "linkJointTypes": [bullet.JOINT_REVOLUTE],
        "linkJointAxis": [[0, 1, 0]],
    }
    free = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 0, "lateralFriction": 0}
    for i in range(n):
        bob = bullet.createMultiBody(0, basePosition=[2 * RADIUS * i, 0, 1], **hinge, **made.here)
        bullet.changeDynamics(bob, 0, **free, **made.here)
        bullet.setJointMotorControl2(bob, 0, bullet.VELOCITY_CONTROL, force=0, **made.here)
        bullet.resetJointState(bob, 0, angle if i == 0 else 0.0, 0, **made.here)
        made.bodies.append(bob)
    return made.ready(link=0)


def pile(seed: int, h: float, law: Law | None, n: int = 8) -> Scene:
    """Boxes and balls of 100:1 in mass that fall on each other."""
    rng = np.random.default_rng(seed)
    made = Scene(h, law, friction=float(rng.choice([0.0, 0.001, 0.1, 0.5, 1.0])))
    for i in range(n):
        turn, size = rng.normal(size=4), rng.uniform(0.03, 0.06, 3)
        made.body(
            (*rng.uniform(-0.1, 0.1, 2), 0.15 + 0.15 * i),
            size if rng.integers(2) else size[0],
            10 ** rng.uniform(-1, 1),
            turn / np.linalg.norm(turn),
            rng.normal(size=3),
            rng.normal(size=3),
        )
    return made.ready()


def tumbling(
    seed: int, h: float, law: Law | None, friction: float, size: ArrayLike = (0.05, 0.08, 0.03)
) -> Scene:
    """One box that falls on a corner, turning."""
    rng = np.random.default_rng(seed)
    made = Scene(h, law, friction=friction)
    turn = rng.normal(size=4)
    made.body(
        (0, 0, 0.3),
        size,
        1.0,
        turn / np.linalg.norm(turn),
        rng.normal(size=3),
        5 * rng.normal(size=3),
    )
    return made.ready()


def oblique(seed: int) -> tuple[float, float, float, float]:
    """Error of e, friction over normal impulse, the friction there is, and
    energy won, of one random impact.

    A ball or the corner of a box that spins, on a floor or on another ball, at any step and
    friction. e is of the speeds at the touch plane.
    """
    rng = np.random.default_rng(seed)
    mu = float(rng.choice([0.0, 0.001, rng.uniform(0, 1)]))
    law = (Restitution(0.315), ConstantRestitution(0.5))[int(rng.integers(2))]
    h, gravity = float(10 ** rng.uniform(-4, -2.3)), float(rng.choice([0, 9.81]))
    is_box, turn = bool(rng.integers(2)), np.array([*rng.uniform(-0.6, 0.6, 3), 1])
    turn /= np.linalg.norm(turn)
    size, on_ball = rng.uniform(0.03, 0.06, 3), not is_box and rng.random() < 0.5
    v, w = [*rng.uniform(-2, 2, 2), -rng.uniform(0.3, 1.5)], rng.uniform(-20, 20, 3)
    heavy, aside, gap = (
        10 ** rng.uniform(-1, 1),
        rng.uniform(-0.03, 0.03, 2),
        h * (0.0 if is_box else rng.choice([0.0, 0.1])) - 1e-6,
    )
    axes = np.array(bullet.getMatrixFromQuaternion(turn)).reshape(3, 3)
    if on_ball:  # off-centre
        normal = np.array([*aside, np.sqrt((size[0] + RADIUS) ** 2 - aside @ aside)]) / (
            size[0] + RADIUS
        )
        at = np.array([0, 0, 0.5]) + (size[0] + RADIUS + gap) * normal
        arm = -size[0] * normal
    else:
        normal = np.array([0.0, 0.0, 1.0])
        arm = -axes @ (np.sign(axes[2]) * size) if is_box else -size[0] * normal
        at = -arm + [0, 0, gap]
        at[:2] = 0

    def made(acts: Law | None) -> Scene:
        scene = Scene(h, acts, gravity, friction=mu)
        scene.body(at, size if is_box else size[0], 1.0, turn, v, w)
        if on_ball:
            scene.body((0, 0, 0.5), RADIUS, heavy)
        return scene.ready()

    scene, flight = made(law), made(None).without_contact()
    motions, masses = [], []
    for one in (scene, flight):
        one.step()
        motions.append(np.array([bullet.getBaseVelocity(body, **one.here) for body in one.bodies]))
    for body in scene.bodies:
        mass, _, inertia = bullet.getDynamicsInfo(body, -1, **scene.here)[:3]
        turned = axes if body == scene.bodies[0] else np.eye(3)
        masses.append((mass, turned @ np.diag(inertia) @ turned.T))
    scene.close()
    flight.close()
    before = np.zeros_like(motions[0])
    before[0] = v, w
    before[:, 0, 2] -= (
        0.5 * h * gravity
    )  # the rates whose energy, with the work of gravity, flight keeps
    after = before + motions[0] - motions[1]
    # An impact comes first, then the body turns freely for the step.
    after[0, 1] = axes @ before_turning(axes.T @ masses[0][1] @ axes, axes.T @ motions[0][0, 1], h)
    arms = [arm, arm + at - [0, 0, 0.5]]

    def rate(motion: Floats) -> Floats:
        points = [one[0] + np.cross(one[1], to) for one, to in zip(motion, arms, strict=False)]
        return np.asarray(points[0] - (points[1] if on_ball else 0.0))

    def kinetic(motion: Floats) -> float:
        pairs = zip(masses, motion, strict=True)
        return float(
            sum(0.5 * m * one[0] @ one[0] + 0.5 * one[1] @ i @ one[1] for (m, i), one in pairs)
        )

    u, impulse = rate(before) @ normal, motions[0][0, 0] - motions[1][0, 0]
    if u > -0.1:
        return 0.0, 0.0, 0.0, 0.0
    lift = 0.0 if on_ball else -2 * gravity * gap  # up to the touch plane
    speed, parting = np.sqrt(u**2 - lift), np.sqrt((rate(after) @ normal) ** 2 - lift)
    error = abs(parting / speed - float(law.at(speed)))
    rubbed = np.linalg.norm(impulse - impulse @ normal * normal)
    return (
        error,
        float(rubbed),
        mu * float(impulse @ normal),
        (kinetic(after) - kinetic(before)) / kinetic(before),
    )
