"""Movers that launch a pair in PyBullet: a free base, a sliding joint, or joints that swing a link."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.terms.impact import Floats


@dataclass(frozen=True, slots=True)
class FreeBase:
    """A body that is moved as a whole. position (m), quaternion: where it starts. direction: unit vector."""

    body: int
    description: str
    position: Floats
    quaternion: Sequence[float]
    direction: Floats

    def put(self, bullet: BulletClient, travel: float, speed: float = 0.0) -> None:
        """Put it `travel` m nearer than it starts, at `speed` m/s towards the other."""
        position = self.position + self.direction * travel
        bullet.resetBasePositionAndOrientation(self.body, position.tolist(), self.quaternion)
        bullet.resetBaseVelocity(self.body, (self.direction * speed).tolist(), [0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class SlidingJoint:
    """A prismatic joint that moves a link. start: its position. approach: m towards the other for 1 of it."""

    body: int
    description: str
    joint: int
    start: float
    approach: float

    def put(self, bullet: BulletClient, travel: float, speed: float = 0.0) -> None:
        """Put the link `travel` m nearer than it starts, at `speed` m/s towards the other."""
        bullet.resetJointState(
            self.body, self.joint, self.start + travel / self.approach, speed / self.approach
        )


@dataclass(frozen=True, slots=True)
class SwingingLink:
    """Joints that together move a link as a push at its contact would. starts: their positions at touch.
    rates: their velocities for an approach at 1 m/s.
    """

    body: int
    description: str
    starts: Mapping[int, float]
    rates: Mapping[int, float]

    def put(self, bullet: BulletClient, travel: float, speed: float = 0.0) -> None:
        """Put the link `travel` m nearer than it starts, at `speed` m/s towards the other."""
        for joint, start in self.starts.items():
            rate = self.rates[joint]
            bullet.resetJointState(self.body, joint, start + rate * travel, rate * speed)


Mover = FreeBase | SlidingJoint | SwingingLink
