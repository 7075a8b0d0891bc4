"""Which pairs of a PyBullet world a law is for, checked: what cannot work is refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.engines.pybullet.model import JOINT_TYPE, PLANAR, BulletBody
from hcbench.errors import SettingError
from hcbench.laws.contact_law import STEPS_PER_CONTACT, Law, coarse, contact_time, is_force

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True, slots=True)
class LinkPair:
    """Two links of two bodies, base -1 among them."""

    first: tuple[BulletBody, int]
    second: tuple[BulletBody, int]

    @property
    def ids(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """(body id, link) of both."""
        return (self.first[0].number, self.first[1]), (self.second[0].number, self.second[1])

    @property
    def key(self) -> tuple[tuple[int, int], ...]:
        """Equal for equal pairs, whichever is first."""
        return tuple(sorted(self.ids))


def pairs_between(
    body1: int, body2: int, *, client: int = 0
) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """All pairs of links (base -1 among them) of two bodies that have a collision shape."""
    bullet = BulletClient(client)

    def shaped(body: int) -> list[int]:
        links = range(-1, bullet.getNumJoints(body))
        return [link for link in links if bullet.getCollisionShapeData(body, link)]

    return [((body1, one), (body2, two)) for one in shaped(body1) for two in shaped(body2)]


def make_pair(bullet: BulletClient, bodies: dict[int, BulletBody], pair: Sequence[Any]) -> LinkPair:
    """A checked pair; `bodies` grows by those that are new. SettingError for what cannot be one."""
    if len(pair) != 2:
        raise SettingError("contact pair", repr(pair), "two bodies, such as (ball, plate)")
    first, second = (_make_side(bullet, bodies, part) for part in pair)
    if first == second:
        raise SettingError("contact pair", f"{pair!r} is one and the same", "two different ones")
    if first[0].kind == second[0].kind == "fixed":
        raise SettingError("contact pair", f"{pair!r} cannot move", "a body with a mass above 0")
    return LinkPair(first, second)


def _make_side(bullet: BulletClient, bodies: dict[int, BulletBody], part: Any) -> tuple[BulletBody, int]:
    number, link = (part, -1) if isinstance(part, int) else (int(part[0]), int(part[1]))
    if number not in bodies:
        try:
            bodies[number] = BulletBody(bullet, number)
        except bullet.error:
            expected = f"one of its {bullet.getNumBodies()} bodies"
            raise SettingError(f"body {number}", "not in this client", expected) from None
    joints = bodies[number].joints
    if not -1 <= link < len(joints):
        raise SettingError(f"link {link} of body {number}", "not there", f"-1 (base) to {len(joints) - 1}")
    if any(joint[JOINT_TYPE] == PLANAR for joint in joints):
        raise SettingError(
            f"body {number}", "has a planar joint", "other joints: PyBullet does not return its axis"
        )
    return bodies[number], link


def check_step(bullet: BulletClient, pair: LinkPair, law: Law, speed: float) -> None:
    """Refuse a world that is not stepped, and a step that cannot resolve the force law at `speed` m/s.

    Where the two will touch is not known yet, so the masses of the links stand in for the effective mass.
    """
    world = bullet.getPhysicsEngineParameters()
    if world["useRealTimeSimulation"]:
        raise SettingError("client", "runs in real time", "one that is stepped: setRealTimeSimulation(0)")
    if world["numSubSteps"] > 1:
        raise SettingError(
            "numSubSteps", str(world["numSubSteps"]), "0", "External forces act in the first substep only"
        )
    if not is_force(law):
        return
    masses = [
        bullet.getDynamicsInfo(body.number, link)[0]
        for body, link in (pair.first, pair.second)
        if body.kind != "fixed"
    ]
    mass = 1.0 / sum(1.0 / one for one in masses if one > 0.0)
    lasts, step = contact_time(law, mass, speed), float(world["fixedTimeStep"])
    if step > lasts / STEPS_PER_CONTACT:
        raise SettingError(
            f"timestep {step:g} s",
            f"too coarse for the force law: this contact lasts {lasts:.2g} s at {speed:g} m/s",
            f"a step of {lasts / 20:.1g} s (at most {lasts / STEPS_PER_CONTACT:.1g} s)",
            f"For coarser steps attach {coarse(law)} instead",
        )
