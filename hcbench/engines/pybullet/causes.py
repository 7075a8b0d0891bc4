"""PyBullet: what may keep a pair from bouncing as asked. Most is how Bullet starts out, so it is tried."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.measure import causes
from hcbench.sim.model_under_test import Suspect

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from hcbench.engines.pybullet.place import Placement
    from hcbench.engines.pybullet.user_model import Bullet, Side
    from hcbench.impact import Impact
    from hcbench.laws.restitution import RestitutionCurve

RESTITUTION, STIFFNESS, KIND = 5, 9, 10  # places in getDynamicsInfo
_RIGID = 1  # kind of a body with maximal coordinates
_THRESHOLD = 0.2  # m/s, Bullet's own restitutionVelocityThreshold
_SLOP = 1e-5  # m, Bullet's own contactSlop


@dataclass(frozen=True, slots=True)
class Context:
    """All that the search for causes looks at."""

    bullet: Bullet
    place: Placement
    impacts: Sequence[Impact]
    wanted: RestitutionCurve | None
    timestep: float
    gravity: tuple[float, ...]
    foreign: Mapping[int, tuple[str, float]]

    @property
    def restitutions(self) -> tuple[float, float]:
        """Of the two links."""
        return restitutions(self.bullet, self.place)

    @property
    def slowest(self) -> float:
        """The lowest approach speed seen, m/s."""
        return min((i.speed_in for i in self.impacts if np.isfinite(i.speed_in)), default=0.0)

    @property
    def compliant(self) -> bool:
        """Whether one of the two has a contact stiffness, which makes springs of contacts."""
        infos = [self.bullet.getDynamicsInfo(s.body, s.link) for s in (self.place.first, self.place.second)]
        return any(info[STIFFNESS] > 0 for info in infos)


def restitutions(bullet: Bullet, place: Placement) -> tuple[float, float]:
    """Restitution of the two links that meet; NaN for a body with maximal coordinates, of which
    PyBullet tells whatever it told last.
    """
    infos = [bullet.getDynamicsInfo(side.body, side.link) for side in (place.first, place.second)]
    first, second = (math.nan if info[KIND] == _RIGID else float(info[RESTITUTION]) for info in infos)
    return first, second


def find_suspects(s: Context) -> list[Suspect]:
    """Everything that may matter here, likeliest first."""
    return [c for check in CHECKS for c in check(s)]


def _set_world(bullet: Bullet, **settings: float) -> None:
    bullet.setPhysicsEngineParameter(**settings)


def _set_links(bullet: Bullet, sides: Sequence[tuple[int, int]], **settings: float) -> None:
    for body, link in sides:
        bullet.changeDynamics(body, link, **settings)


def _link(side: Side) -> tuple[int, int]:
    assert side.link is not None
    return side.body, side.link


def _call(side: Side, **settings: float) -> str:
    """The call that sets a link; bodies from files are called as their files."""
    words = ", ".join(f"{k}={v:g}" for k, v in settings.items())
    name = side.name.split(".")[0]
    return f"p.changeDynamics({name if name.isidentifier() else side.body}, {side.link}, {words})"


def _restitution(s: Context) -> Iterator[Suspect]:
    """The two restitutions multiply, an unset one is 0, and one in another simulator's tag is not read."""
    sides, values = (s.place.first, s.place.second), list(s.restitutions)
    if any(math.isnan(value) for value in values):
        return
    found = [
        s.foreign.get(side.body) if value == 0.0 else None for side, value in zip(sides, values, strict=True)
    ]
    told = [(side, *tag) for side, tag in zip(sides, found, strict=True) if tag is not None]
    values = [value if tag is None else tag[1] for value, tag in zip(values, found, strict=True)]
    set_ones = [value for value in values if value > 0.0]
    aim = None if s.wanted is not None else math.prod(set_ones) if set_ones else causes.BOUNCY
    if told:
        yield Suspect(
            "foreign-restitution",
            "The file has its restitution in a tag that PyBullet does not read.",
            ", ".join(f"<{tag}> {value:g} of {side.name!r}" for side, tag, value in told),
            f'<contact><restitution value="{told[0][2]:g}"/></contact> in the <link>, or '
            + "; ".join(_call(side, restitution=value) for side, _, value in told),
            partial(_both, links=[_link(side) for side, _, _ in told], values=[v for *_, v in told]),
            always_reported=True,
            assumed_e=aim,
        )
    if not set_ones:
        e = _goal(s)
        yield Suspect(
            "no-restitution",
            "Neither of the two has a restitution: an unset one is 0.",
            "restitution 0 and 0",
            f"{_call(sides[0], restitution=e)}; {_call(sides[1], restitution=1)}",
            partial(_both, links=[_link(side) for side in sides], values=(e, 1.0)),
            always_reported=True,
            assumed_e=aim,
        )
    elif len(set_ones) == 1:
        unset, other = sides if values[0] == 0.0 else sides[::-1]
        yield Suspect(
            "other-body",
            f"The restitution of {unset.name!r} is not set: the two multiply, so the pair has e = 0.",
            f"restitution {set_ones[0]:g} on {other.name!r}, 0 on {unset.name!r}",
            _call(unset, restitution=1),
            partial(_set_links, sides=[_link(unset)], restitution=1.0),
            always_reported=True,
            assumed_e=aim,
        )


def _goal(s: Context) -> float:
    e = causes.constant_e(s.impacts, s.wanted)
    return causes.BOUNCY if e is None else e


def _both(bullet: Bullet, links: Sequence[tuple[int, int]], values: Sequence[float]) -> None:
    for (body, link), value in zip(links, values, strict=True):
        bullet.changeDynamics(body, link, restitution=value)


def _product(s: Context) -> Iterator[Suspect]:
    """Set, but not to what is wanted."""
    first, second = s.restitutions
    if s.wanted is None or not first * second > 0.0:
        return
    e = _goal(s)
    if abs(first * second - e) > 0.005:
        sides = (s.place.first, s.place.second)
        yield Suspect(
            "product",
            "The restitutions of the two multiply to another e than the one wanted.",
            f"{first:g} x {second:g} = {first * second:.4g}, wanted {e:.4g}",
            f"{_call(sides[0], restitution=e)}; {_call(sides[1], restitution=1)}",
            partial(_both, links=[_link(side) for side in sides], values=(e, 1.0)),
        )


def _engine(s: Context) -> Iterator[Suspect]:
    """What Bullet does to a bounce unless told otherwise; none of it can be read back, so it is tried."""
    links = [_link(s.place.first), _link(s.place.second)]
    if s.slowest <= _THRESHOLD:
        yield Suspect(
            "velocity-threshold",
            "Below restitutionVelocityThreshold Bullet does not bounce at all.",
            f"impacts from {s.slowest:.3g} m/s, threshold {_THRESHOLD:g} m/s unless set",
            "p.setPhysicsEngineParameter(restitutionVelocityThreshold=0)",
            partial(_set_world, restitutionVelocityThreshold=0.0),
        )
    yield Suspect(
        "predictive-contact",
        "Bullet acts on contacts before they touch: the body is stopped short and restitution is lost.",
        f"contacts up to {0.02:g} m away are solved for, at {s.slowest * s.timestep:.3g} m a step",
        f"{_call(s.place.first, contactProcessingThreshold=0)} "
        f"and p.setPhysicsEngineParameter(contactBreakingThreshold=0.02)",
        partial(_set_links, sides=links[:1], contactProcessingThreshold=0.0),
    )
    deepest = max((i.penetration_max for i in s.impacts if np.isfinite(i.penetration_max)), default=0.0)
    yield Suspect(
        "slop",
        "contactSlop lets bodies overlap by as much as a hard contact's whole depth before anything acts.",
        f"contactSlop {_SLOP:g} m unless set, deepest penetration seen {deepest:.3g} m",
        "p.setPhysicsEngineParameter(contactSlop=0)",
        partial(_set_world, contactSlop=0.0),
    )
    yield Suspect(
        "erp",
        "Error reduction (ERP) pushes an overlap apart and adds its own speed to the rebound.",
        "contactERP and erp are 0.2 unless set",
        "p.setPhysicsEngineParameter(contactERP=0, erp=0)",
        partial(_set_world, contactERP=0.0, erp=0.0),
    )
    yield Suspect(
        "damping",
        "Bullet damps all motion: linearDamping and angularDamping are not 0 by themselves.",
        f"linearDamping 0.04 /s unless set, {0.04 * s.timestep:.2g} of the speed a step",
        _call(s.place.first, linearDamping=0, angularDamping=0),
        partial(_set_links, sides=[(s.place.mover.body, -1)], linearDamping=0.0, angularDamping=0.0),
    )


def _compliance(s: Context) -> Iterator[Suspect]:
    """Restitutions above 1 together; contact stiffness and damping, which take restitution's place."""
    first, second = s.restitutions
    if first * second > 1:
        sides = (s.place.first, s.place.second)
        yield Suspect(
            "energy-gain",
            "The restitutions of the two multiply to more than 1: every bounce makes energy from nothing.",
            f"{first:g} x {second:g} = {first * second:.4g}",
            "; ".join(_call(side, restitution=1) for side in sides),
            partial(_both, links=[_link(side) for side in sides], values=(1.0, 1.0)),
        )
    elif s.compliant:
        step = causes.StepFix(s.timestep, "p.setTimeStep({})", _set_timestep)
        yield from causes.energy_gain(s.impacts, step)
        yield from causes.few_steps(s.impacts, step, "a lower contactStiffness")


def _gravity(s: Context) -> Iterator[Suspect]:
    """Gravity in a step, or in a contact with a stiffness."""
    fix = "p.setTimeStep({:.2g}), or loadURDF with useMaximalCoordinates"
    return causes.gravity(
        s.impacts, s.gravity, s.timestep, lambda longest: fix.format(longest / 5), _no_gravity
    )


def _set_timestep(bullet: Bullet, timestep: float) -> None:
    bullet.setPhysicsEngineParameter(fixedTimeStep=timestep)


def _no_gravity(bullet: Bullet) -> None:
    bullet.setGravity(0.0, 0.0, 0.0)


def _motor(s: Context) -> Iterator[Suspect]:
    """Joints are loaded with a motor that brakes them."""
    mover = s.place.mover
    if mover.joint is None:
        return
    yield Suspect(
        "joint-motor",
        "PyBullet loads every joint with a velocity motor on, which brakes it.",
        mover.words,
        f"p.setJointMotorControl2({mover.body}, {mover.joint}, p.VELOCITY_CONTROL, force=0)",
        partial(_release, body=mover.body, joint=mover.joint),
    )


def _release(bullet: Bullet, body: int, joint: int) -> None:
    bullet.setJointMotorControl2(body, joint, bullet.module.VELOCITY_CONTROL, force=0)


CHECKS: tuple[Any, ...] = (_restitution, _product, _engine, _compliance, _gravity, _motor)
