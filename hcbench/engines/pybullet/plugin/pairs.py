"""Which pairs of a PyBullet world a law is for, checked: what cannot work is refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hcbench.engines.pybullet.plugin.bodies import Body
from hcbench.errors import SettingError
from hcbench.laws.contact_law import STEPS_PER_CONTACT, Law, coarse, contact_time, is_force


@dataclass(frozen=True, slots=True)
class Pair:
    """Two links of two bodies, base -1 among them."""

    first: Body
    link1: int
    second: Body
    link2: int

    @property
    def key(self) -> tuple[int, int, int, int]:
        """Equal for equal pairs, whichever is first."""
        one, two = sorted([(self.first.number, self.link1), (self.second.number, self.link2)])
        return (*one, *two)


def pairs_between(
    body1: int, body2: int, *, client: int = 0
) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """All pairs of links (base -1 among them) of two bodies that have a collision shape."""
    import pybullet as bullet

    def shaped(body: int) -> list[int]:
        links = range(-1, bullet.getNumJoints(body, physicsClientId=client))
        return [link for link in links if bullet.getCollisionShapeData(body, link, physicsClientId=client)]

    return [((body1, one), (body2, two)) for one in shaped(body1) for two in shaped(body2)]


def make_pair(bullet: Any, client: int, bodies: dict[int, Body], pair: list[Any]) -> Pair:
    """A checked pair; `bodies` grows by those that are new. SettingError for what cannot be one."""
    if len(pair) != 2:
        raise SettingError("contact pair", repr(pair), "two bodies, such as (ball, plate)")
    sides: list[tuple[Body, int]] = []
    for one in pair:
        number, link = (one, -1) if isinstance(one, int) else (int(one[0]), int(one[1]))
        if number not in bodies:
            try:
                bodies[number] = Body(bullet, client, number)
            except bullet.error:
                count = bullet.getNumBodies(physicsClientId=client)
                raise SettingError(
                    f"body {number}", "not in this client", f"one of its {count} bodies"
                ) from None
        bodies[number].check_link(link)
        sides.append((bodies[number], link))
    if sides[0] == sides[1]:
        raise SettingError("contact pair", f"{pair!r} is one and the same", "two different ones")
    if all(body.kind == "fixed" for body, _ in sides):
        raise SettingError("contact pair", f"{pair!r} cannot move", "a body with a mass above 0")
    return Pair(*sides[0], *sides[1])


def check_step(bullet: Any, client: int, pair: Pair, law: Law, speed: float) -> None:
    """Refuse a world that is not stepped, and a step that cannot resolve the force law at `speed` m/s."""
    world = bullet.getPhysicsEngineParameters(physicsClientId=client)
    if world["useRealTimeSimulation"]:
        raise SettingError("client", "runs in real time", "one that is stepped: setRealTimeSimulation(0)")
    if world["numSubSteps"] > 1:
        raise SettingError(
            "numSubSteps", str(world["numSubSteps"]), "0", "External forces act in the first substep only"
        )
    if not is_force(law):
        return
    masses = [
        body.bullet.getDynamicsInfo(body.number, link, physicsClientId=client)[0]
        for body, link in ((pair.first, pair.link1), (pair.second, pair.link2))
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
