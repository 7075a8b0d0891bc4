"""Hunt-Crossley contact for a PyBullet simulation of your own.

    from hcbench.contact import pybullet as contact
    from hcbench.reference.laws import HuntCrossley

    with contact.attach([(ball, plate)], HuntCrossley(stiffness=3.4e10, alpha=0.315)) as law:
        for _ in range(steps):
            law.step()  # instead of pybullet.stepSimulation(); or law.apply() before it

The law takes the attached pairs over: Bullet no longer collides them, and each `apply` finds their closest
points (Bullet's own, or a gap of yours) and adds external forces, equal and opposite. Nothing else in the
world is changed: no restitution, threshold, slop or damping of Bullet's. What Bullet does to all bodies it
still does to these: switch its linearDamping of 0.04 off if the speed between impacts matters.

`HuntCrossley` is the force law, for steps that resolve the contact: laws/exact_step.py says how the force
over a step is found, and its order. `Restitution(alpha)` gives each impact e(v) of its own approach speed in
the step that it happens in, for steps that do not; several contacts at once are solved together, resting ones
rest. `TouchSpeedLaw(Flores, k, e)` is a law of `laws.published`, `ConstantRestitution(e)` one e for all
impacts: law.py. Bullet's friction does not act between attached pairs: give the law its own.

PyBullet cannot say whether a pair was allowed to collide before: `detach` allows it, unless told otherwise.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Self

from hcbench.engines.pybullet.plugin import solve
from hcbench.engines.pybullet.plugin.bodies import Body, product
from hcbench.engines.pybullet.plugin.pairs import Pair, check_step, make_pair, pairs_between
from hcbench.engines.pybullet.plugin.solve import Touch
from hcbench.engines.pybullet.plugin.vectors import Vector, along, dot, turned, vector
from hcbench.errors import EngineFailed, SettingError
from hcbench.laws.contact_law import Friction, Law, coarse, is_force, require_law
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import TouchSpeedLaw
from hcbench.laws.restitution import ConstantRestitution, Restitution

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from types import TracebackType

    Pose = tuple[Vector, Sequence[float]]  # position and quaternion (x, y, z, w) of a centre of mass frame
    # (distance, point, unit normal from the second body to the first) of two poses.
    Gap = Callable[[Pose, Pose], tuple[float, Vector, Vector]]

__all__ = [
    "ConstantRestitution",
    "Contact",
    "Friction",
    "HuntCrossley",
    "Restitution",
    "Touch",
    "TouchSpeedLaw",
    "attach",
    "cup",
    "pairs_between",
]

_SPEED = 0.508  # m/s: 20 in/s, up to where the paper's law holds

_attached: dict[int, set[tuple[int, int, int, int]]] = {}  # by client


def cup(ball_radius: float, cup_radius: float, centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Gap:
    """The exact gap of a ball (first body) in a concave spherical cup (second): its mesh would be coarse.

    ball_radius, cup_radius: m, the cup's larger. centre: the cup's centre of curvature in the frame of the
    second body's centre of mass, m.
    """
    if not 0 < ball_radius < cup_radius:
        raise SettingError(
            "ball_radius", f"{ball_radius!r} m", f"above 0 and below the cup's {cup_radius!r} m"
        )
    middle = vector(centre)

    def gap(ball: Pose, plate: Pose) -> tuple[float, Vector, Vector]:
        out = along(ball[0], -1.0, along(plate[0], 1.0, turned(plate[1], middle)))
        away = math.sqrt(dot(out, out))
        if away == 0.0:
            return cup_radius - ball_radius, ball[0], (0.0, 0.0, 1.0)
        normal = (-out[0] / away, -out[1] / away, -out[2] / away)
        distance = cup_radius - ball_radius - away
        return distance, along(ball[0], -(ball_radius + 0.5 * distance), normal), normal

    return gap


class Contact:
    """A law attached to pairs of a client's bodies, until `detach` or the end of a `with` block."""

    def __init__(
        self, bullet: Any, client: int, law: Law, friction: Friction | None, gap: Gap | None, again: bool
    ) -> None:
        self._bullet, self._client, self._again, self._gap = bullet, client, again, gap
        self.law, self.friction = law, friction
        self._pairs: list[Pair] = []
        self._bodies: list[Body] = []
        self._solver = solve.solver_of(law)
        self._too_coarse = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.detach()
        if kind is None:
            self.check()

    def step(self) -> list[Touch]:
        """`apply`, then pybullet.stepSimulation()."""
        touches = self.apply()
        self._bullet.stepSimulation(physicsClientId=self._client)
        return touches

    def apply(self) -> list[Touch]:
        """Add the law's forces for the step that comes next; what they are, for the present state.

        Raises EngineFailed for a state that is not finite.
        """
        world = self._bullet.getPhysicsEngineParameters(physicsClientId=self._client)
        h = world["fixedTimeStep"]
        gravity = tuple(world[f"gravityAcceleration{axis}"] for axis in "XYZ")
        for body in self._bodies:
            body.refresh()
        touches = [touch for pair in self._pairs for touch in self._find(pair, h, gravity)]
        self._solver.solve(touches, h)
        for touch in touches:
            if touch.force > 0.0:
                self._push(touch, h)
        if is_force(self.law):
            self._too_coarse += sum(touch.rate_of_step > 1.0 for touch in touches)
        return touches

    def check(self) -> None:
        """Raise EngineFailed if a contact was too fast for the step."""
        if self._too_coarse:
            raise EngineFailed(
                "contact",
                f"{self._too_coarse} times a penetration too fast for the step",
                "a smaller timestep",
                f"Or attach {coarse(self.law)}, which needs no resolved contact",
            )

    def detach(self) -> None:
        """Give the pairs back to Bullet. Twice is no harm."""
        known = _attached.get(self._client, set())
        for pair in self._pairs:
            known.discard(pair.key)
            if self._bullet.isConnected(self._client):
                self._collide(pair, int(self._again))
        self._pairs, self._bodies = [], []

    def _collide(self, pair: Pair, enable: int) -> None:
        try:
            self._bullet.setCollisionFilterPair(
                pair.first.number,
                pair.second.number,
                pair.link1,
                pair.link2,
                enable,
                physicsClientId=self._client,
            )
        except self._bullet.error as error:  # a body that has been removed meanwhile
            if enable == 0:
                raise EngineFailed("pybullet", str(error), "bodies of this client") from error

    def _find(self, pair: Pair, h: float, gravity: Sequence[float]) -> list[Touch]:
        made = []
        for order, (distance, point, normal) in enumerate(self._closest(pair, h, gravity)):
            relative = along(
                pair.first.velocity_at(pair.link1, point), -1.0, pair.second.velocity_at(pair.link2, point)
            )
            v = -dot(relative, normal)
            if not (math.isfinite(distance) and math.isfinite(v)):
                raise EngineFailed(
                    f"contact of bodies {pair.first.number} and {pair.second.number}",
                    f"penetration {-distance!r} m at {v!r} m/s",
                    "a finite state",
                    "Look at the step, or at what else acts on the bodies",
                )
            rows = (
                pair.first.row(pair.link1, point, normal),
                pair.second.row(pair.link2, point, normal),
            )
            pulls = [
                sign * dot(gravity, normal)
                for sign, body in ((-1.0, pair.first), (1.0, pair.second))
                if body.kind != "fixed"
            ]
            free = all(body.kind != "jointed" for body in (pair.first, pair.second))
            made.append(
                Touch(
                    pair=((pair.first.number, pair.link1), (pair.second.number, pair.link2)),
                    order=order,
                    penetration=-distance,
                    rate=v,
                    point=point,
                    normal=normal,
                    slip=along(relative, v, normal),
                    bodies=(pair.first, pair.second),
                    rows=rows,
                    inverse_mass=sum(product(row, row) for row in rows),
                    pull=sum(pulls) if free else 0.0,
                    weight=max(0.0, *pulls),
                )
            )
        return made

    def _closest(self, pair: Pair, h: float, gravity: Sequence[float]) -> list[tuple[float, Vector, Vector]]:
        if self._gap is not None:
            return [self._gap(pair.first.pose(pair.link1), pair.second.pose(pair.link2))]
        fall = h * h * math.sqrt(dot(gravity, gravity))
        reach = 1.01 * (h * (pair.first.speed(pair.link1) + pair.second.speed(pair.link2)) + fall) + 1e-9
        if not math.isfinite(reach):
            reach = 0.0  # the state is told of where it is read
        points = self._bullet.getClosestPoints(
            pair.first.number, pair.second.number, reach, pair.link1, pair.link2, physicsClientId=self._client
        )
        found = []
        for one in points:
            middle = vector([0.5 * (a + b) for a, b in zip(one[5], one[6], strict=True)])
            found.append((one[8], middle, vector(one[7])))
        return found

    def _push(self, touch: Touch, h: float) -> None:
        force = along((0.0, 0.0, 0.0), touch.force, touch.normal)
        slip = math.sqrt(dot(touch.slip, touch.slip))
        if self.friction is not None and slip > 0.0:
            direction = along((0.0, 0.0, 0.0), 1.0 / slip, touch.slip)
            links = (touch.pair[0][1], touch.pair[1][1])
            rows = [
                body.row(link, touch.point, direction) for body, link in zip(touch.bodies, links, strict=True)
            ]
            # A step can stop the slip, never turn it around.
            most = slip / (h * sum(product(row, row) for row in rows))
            force = along(force, -min(self.friction.coefficient(slip) * touch.force, most), direction)
        touch.bodies[0].push(touch.pair[0][1], touch.point, force)
        touch.bodies[1].push(touch.pair[1][1], touch.point, along((0.0, 0.0, 0.0), -1.0, force))


def attach(
    pairs: Iterable[Sequence[Any]],
    law: Law,
    *,
    client: int = 0,
    friction: Friction | None = None,
    gap: Gap | None = None,
    speed: float = _SPEED,
    collide_after: bool = True,
) -> Contact:
    """Let `law` act on pairs of bodies of a PyBullet client, instead of Bullet's own contact.

    pairs: (body, body), or ((body, link), (body, link)) where a link is meant; a bare body is its base.
    law: HuntCrossley, TouchSpeedLaw, Restitution or ConstantRestitution. friction: none by default.
    gap: distance, point and normal of two poses, where Bullet's closest points are not exact enough: `cup`.
    speed: largest approach speed expected, m/s: a step too coarse for it is refused.
    collide_after: whether Bullet collides the pairs when they are detached.

    Raises SettingError for what cannot be attached; the world is untouched then.
    """
    import pybullet as bullet

    require_law(law)
    if not bullet.isConnected(client):
        raise SettingError("client", f"{client} is not connected", "the id that pybullet.connect gave")
    contact = Contact(bullet, client, law, friction, gap, collide_after)
    bodies: dict[int, Body] = {}
    made = [make_pair(bullet, client, bodies, list(pair)) for pair in pairs]
    known = _attached.setdefault(client, set())
    keys = [pair.key for pair in made]
    for pair in made:
        if pair.key in known or keys.count(pair.key) > 1:
            raise SettingError(
                "contact pair",
                f"bodies {pair.first.number} and {pair.second.number} attached twice",
                "a pair that has no law yet",
                "Detach that first",
            )
        check_step(bullet, client, pair, law, speed)
    if not made:
        raise SettingError("contact pairs", "none", "at least one pair of bodies")
    for pair in made:
        contact._collide(pair, 0)
        known.add(pair.key)
    contact._pairs, contact._bodies = made, list(bodies.values())
    return contact
