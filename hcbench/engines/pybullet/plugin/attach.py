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
impacts. Bullet's friction does not act between attached pairs: give the law its own.

PyBullet does not return whether a pair was allowed to collide before: `detach` allows it, unless
`collide_after` is False.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Self

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.engines.pybullet.model import BulletBody, contact_row
from hcbench.engines.pybullet.plugin import solve
from hcbench.engines.pybullet.plugin.pairs import LinkPair, check_step, make_pair
from hcbench.engines.pybullet.plugin.solve import ContactPoint
from hcbench.engines.pybullet.vectors import Vector, add_scaled, dot, rotate, vector
from hcbench.errors import EngineFailed, SettingError
from hcbench.laws.contact_law import Friction, Law, coarse, is_force, require_law

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from types import TracebackType

    Pose = tuple[Vector, Sequence[float]]  # position and quaternion (x, y, z, w) of a centre of mass frame
    # (distance, point, unit normal from the second body to the first) of two poses.
    Gap = Callable[[Pose, Pose], tuple[float, Vector, Vector]]

_SPEED = 0.508  # m/s: 20 in/s, up to where the paper's law holds

_attached: dict[int, set[tuple[tuple[int, int], ...]]] = {}  # keys of pairs, by client


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
        out = add_scaled(ball[0], -1.0, add_scaled(plate[0], 1.0, rotate(plate[1], middle)))
        away = math.sqrt(dot(out, out))
        if away == 0.0:
            return cup_radius - ball_radius, ball[0], (0.0, 0.0, 1.0)
        normal = (-out[0] / away, -out[1] / away, -out[2] / away)
        distance = cup_radius - ball_radius - away
        return distance, add_scaled(ball[0], -(ball_radius + 0.5 * distance), normal), normal

    return gap


class AttachedLaw:
    """A law attached to pairs of a client's bodies, until `detach` or the end of a `with` block."""

    def __init__(
        self, bullet: BulletClient, law: Law, friction: Friction | None, gap: Gap | None, collide_after: bool
    ) -> None:
        self._bullet, self._collide_after, self._gap = bullet, collide_after, gap
        self.law, self.friction = law, friction
        self._pairs: list[LinkPair] = []
        self._bodies: list[BulletBody] = []
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

    def step(self) -> list[ContactPoint]:
        """`apply`, then pybullet.stepSimulation()."""
        touches = self.apply()
        self._bullet.stepSimulation()
        return touches

    def apply(self) -> list[ContactPoint]:
        """Add the law's forces for the step that comes next; what they are, for the present state.

        Raises EngineFailed for a state that is not finite.
        """
        world = self._bullet.getPhysicsEngineParameters()
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
        attached = _attached.get(self._bullet.client, set())
        for pair in self._pairs:
            attached.discard(pair.key)
            if self._bullet.isConnected():
                self._collide(pair, int(self._collide_after))
        self._pairs, self._bodies = [], []

    def _collide(self, pair: LinkPair, enable: int) -> None:
        (body1, link1), (body2, link2) = pair.ids
        try:
            self._bullet.setCollisionFilterPair(body1, body2, link1, link2, enable)
        except self._bullet.error as error:  # a body that has been removed meanwhile
            if enable == 0:
                raise EngineFailed("pybullet", str(error), "bodies of this client") from error

    def _find(self, pair: LinkPair, h: float, gravity: Sequence[float]) -> list[ContactPoint]:
        (body1, link1), (body2, link2) = pair.first, pair.second
        touches = []
        for order, (distance, point, normal) in enumerate(self._closest(pair, h, gravity)):
            relative = add_scaled(body1.velocity_at(link1, point), -1.0, body2.velocity_at(link2, point))
            v = -dot(relative, normal)
            if not (math.isfinite(distance) and math.isfinite(v)):
                raise EngineFailed(
                    f"contact of bodies {body1.number} and {body2.number}",
                    f"penetration {-distance!r} m at {v!r} m/s",
                    "a finite state",
                    "Look at the step, or at what else acts on the bodies",
                )
            row = contact_row(pair.first, pair.second, point, normal)
            pulls = [
                sign * dot(gravity, normal)
                for sign, body in ((-1.0, body1), (1.0, body2))
                if body.kind != "fixed"
            ]
            touches.append(
                ContactPoint(
                    pair=pair.ids,
                    order=order,
                    penetration=-distance,
                    rate=v,
                    point=point,
                    normal=normal,
                    slip=add_scaled(relative, v, normal),
                    row=row,
                    inverse_mass=row.inverse_mass,
                    pull=0.0 if "jointed" in (body1.kind, body2.kind) else sum(pulls),
                    weight=max(0.0, *pulls),
                )
            )
        return touches

    def _closest(
        self, pair: LinkPair, h: float, gravity: Sequence[float]
    ) -> list[tuple[float, Vector, Vector]]:
        (body1, link1), (body2, link2) = pair.first, pair.second
        if self._gap is not None:
            return [self._gap(body1.pose(link1), body2.pose(link2))]
        fall = h * h * math.sqrt(dot(gravity, gravity))
        reach = 1.01 * (h * (body1.max_speed(link1) + body2.max_speed(link2)) + fall) + 1e-9
        if not math.isfinite(reach):
            reach = 0.0  # what is not finite is refused where the velocity is read
        points = self._bullet.getClosestPoints(body1.number, body2.number, reach, link1, link2)
        return [
            (p[8], vector([0.5 * (a + b) for a, b in zip(p[5], p[6], strict=True)]), vector(p[7]))
            for p in points
        ]

    def _push(self, touch: ContactPoint, h: float) -> None:
        (body1, body2), ((_, link1), (_, link2)) = touch.row.bodies, touch.pair
        force = add_scaled((0.0, 0.0, 0.0), touch.force, touch.normal)
        slip = math.sqrt(dot(touch.slip, touch.slip))
        if self.friction is not None and slip > 0.0:
            direction = add_scaled((0.0, 0.0, 0.0), 1.0 / slip, touch.slip)
            row = contact_row((body1, link1), (body2, link2), touch.point, direction)
            # A step can stop the slip, never turn it around.
            most = slip / (h * row.inverse_mass)
            force = add_scaled(force, -min(self.friction.coefficient(slip) * touch.force, most), direction)
        body1.push(link1, touch.point, force)
        body2.push(link2, touch.point, add_scaled((0.0, 0.0, 0.0), -1.0, force))


def attach(
    pairs: Iterable[Sequence[Any]],
    law: Law,
    *,
    client: int = 0,
    friction: Friction | None = None,
    gap: Gap | None = None,
    speed: float = _SPEED,
    collide_after: bool = True,
) -> AttachedLaw:
    """Let `law` act on pairs of bodies of a PyBullet client, instead of Bullet's own contact.

    pairs: (body, body), or ((body, link), (body, link)) where a link is meant; a bare body is its base.
    law: HuntCrossley, TouchSpeedLaw, Restitution or ConstantRestitution. friction: none by default.
    gap: distance, point and normal of two poses, where Bullet's closest points are not exact enough: `cup`.
    speed: largest approach speed expected, m/s: a step too coarse for it is refused.
    collide_after: whether Bullet collides the pairs when they are detached.

    Raises SettingError for what cannot be attached; the world is untouched then.
    """
    require_law(law)
    bullet = BulletClient(client)
    if not bullet.isConnected():
        raise SettingError("client", f"{client} is not connected", "the id that pybullet.connect gave")
    contact = AttachedLaw(bullet, law, friction, gap, collide_after)
    bodies: dict[int, BulletBody] = {}
    made = [make_pair(bullet, bodies, list(pair)) for pair in pairs]
    attached = _attached.setdefault(client, set())
    keys = [pair.key for pair in made]
    for pair in made:
        if pair.key in attached or keys.count(pair.key) > 1:
            raise SettingError(
                "contact pair",
                f"bodies {pair.first[0].number} and {pair.second[0].number} attached twice",
                "a pair that has no law yet",
                "Detach that first",
            )
        check_step(bullet, pair, law, speed)
    if not made:
        raise SettingError("contact pairs", "none", "at least one pair of bodies")
    for pair in made:
        contact._collide(pair, 0)
        attached.add(pair.key)
    contact._pairs, contact._bodies = made, list(bodies.values())
    return contact
