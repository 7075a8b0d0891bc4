"""PyBullet: what may keep a pair from bouncing as asked. Most is how Bullet starts out, so it is tried."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.impact import Status
from hcbench.measure.measurement import NOTABLE_GAIN, Candidate

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from hcbench.engines.pybullet.place import Placement
    from hcbench.engines.pybullet.user_model import Bullet, Side
    from hcbench.impact import Impact
    from hcbench.measure.measurement import Wanted

RESTITUTION, STIFFNESS, KIND = 5, 9, 10  # places in getDynamicsInfo
_RIGID = 1  # kind of a body with maximal coordinates
_THRESHOLD = 0.2  # m/s, Bullet's own restitutionVelocityThreshold
_SLOP = 1e-5  # m, Bullet's own contactSlop
_FEW_STEPS = 12
_GRAVITY_SHARE = 0.02
_BOUNCY = 0.9


@dataclass(frozen=True, slots=True)
class Situation:
    """All that the search for causes looks at."""

    bullet: Bullet
    place: Placement
    impacts: Sequence[Impact]
    wanted: Wanted | None
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


def find_candidates(s: Situation) -> list[Candidate]:
    """Everything that may matter here, likeliest first."""
    return [c for look in _LOOKS for c in look(s)]


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


def _restitution(s: Situation) -> Iterator[Candidate]:
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
    aim = None if s.wanted is not None else math.prod(set_ones) if set_ones else _BOUNCY
    if told:
        yield Candidate(
            "foreign-restitution",
            "The file has its restitution in a tag that PyBullet does not read.",
            ", ".join(f"<{tag}> {value:g} of {side.name!r}" for side, tag, value in told),
            f'<contact><restitution value="{told[0][2]:g}"/></contact> in the <link>, or '
            + "; ".join(_call(side, restitution=value) for side, _, value in told),
            partial(_both, links=[_link(side) for side, _, _ in told], values=[v for *_, v in told]),
            static=True,
            aim=aim,
        )
    if not set_ones:
        e = _goal(s)
        yield Candidate(
            "no-restitution",
            "Neither of the two has a restitution: an unset one is 0.",
            "restitution 0 and 0",
            f"{_call(sides[0], restitution=e)}; {_call(sides[1], restitution=1)}",
            partial(_both, links=[_link(side) for side in sides], values=(e, 1.0)),
            static=True,
            aim=aim,
        )
    elif len(set_ones) == 1:
        unset, other = sides if values[0] == 0.0 else sides[::-1]
        yield Candidate(
            "other-body",
            f"The restitution of {unset.name!r} is not set: the two multiply, so the pair has e = 0.",
            f"restitution {set_ones[0]:g} on {other.name!r}, 0 on {unset.name!r}",
            _call(unset, restitution=1),
            partial(_set_links, sides=[_link(unset)], restitution=1.0),
            static=True,
            aim=aim,
        )


def _goal(s: Situation) -> float:
    if s.wanted is None:
        return _BOUNCY
    speeds = [i.launch.speed for i in s.impacts]
    return float(np.clip(s.wanted.restitution(np.array([min(speeds), max(speeds)])).mean(), 0, 1))


def _both(bullet: Bullet, links: Sequence[tuple[int, int]], values: Sequence[float]) -> None:
    for (body, link), value in zip(links, values, strict=True):
        bullet.changeDynamics(body, link, restitution=value)


def _product(s: Situation) -> Iterator[Candidate]:
    """Set, but not to what is wanted."""
    first, second = s.restitutions
    if s.wanted is None or not first * second > 0.0:
        return
    e = _goal(s)
    if abs(first * second - e) > 0.005:
        sides = (s.place.first, s.place.second)
        yield Candidate(
            "product",
            "The restitutions of the two multiply to another e than the one wanted.",
            f"{first:g} x {second:g} = {first * second:.4g}, wanted {e:.4g}",
            f"{_call(sides[0], restitution=e)}; {_call(sides[1], restitution=1)}",
            partial(_both, links=[_link(side) for side in sides], values=(e, 1.0)),
        )


def _engine(s: Situation) -> Iterator[Candidate]:
    """What Bullet does to a bounce unless told otherwise; none of it can be read back, so it is tried."""
    links = [_link(s.place.first), _link(s.place.second)]
    if s.slowest <= _THRESHOLD:
        yield Candidate(
            "velocity-threshold",
            "Below restitutionVelocityThreshold Bullet does not bounce at all.",
            f"impacts from {s.slowest:.3g} m/s, threshold {_THRESHOLD:g} m/s unless set",
            "p.setPhysicsEngineParameter(restitutionVelocityThreshold=0)",
            partial(_set_world, restitutionVelocityThreshold=0.0),
        )
    yield Candidate(
        "predictive-contact",
        "Bullet acts on contacts before they touch: the body is stopped short and restitution is lost.",
        f"contacts up to {0.02:g} m away are solved for, at {s.slowest * s.timestep:.3g} m a step",
        f"{_call(s.place.first, contactProcessingThreshold=0)} "
        f"and p.setPhysicsEngineParameter(contactBreakingThreshold=0.02)",
        partial(_set_links, sides=links[:1], contactProcessingThreshold=0.0),
    )
    deepest = max((i.penetration_max for i in s.impacts if np.isfinite(i.penetration_max)), default=0.0)
    yield Candidate(
        "slop",
        "contactSlop lets bodies overlap by as much as a hard contact's whole depth before anything acts.",
        f"contactSlop {_SLOP:g} m unless set, deepest penetration seen {deepest:.3g} m",
        "p.setPhysicsEngineParameter(contactSlop=0)",
        partial(_set_world, contactSlop=0.0),
    )
    yield Candidate(
        "erp",
        "Error reduction (ERP) pushes an overlap apart and adds its own speed to the rebound.",
        "contactERP and erp are 0.2 unless set",
        "p.setPhysicsEngineParameter(contactERP=0, erp=0)",
        partial(_set_world, contactERP=0.0, erp=0.0),
    )
    yield Candidate(
        "damping",
        "Bullet damps all motion: linearDamping and angularDamping are not 0 by themselves.",
        f"linearDamping 0.04 /s unless set, {0.04 * s.timestep:.2g} of the speed a step",
        _call(s.place.first, linearDamping=0, angularDamping=0),
        partial(_set_links, sides=[(s.place.mover.body, -1)], linearDamping=0.0, angularDamping=0.0),
    )


def _compliance(s: Situation) -> Iterator[Candidate]:
    """Contact stiffness and damping, which take restitution's place."""
    parted = [i for i in s.impacts if i.status is Status.PARTED]
    samples = min((i.samples for i in parted), default=0)
    gained = max((i.restitution for i in parted), default=0.0)
    finer = s.timestep * max(samples, 1) / 60
    step = partial(_set_world, fixedTimeStep=finer)
    first, second = s.restitutions
    if first * second > 1:
        sides = (s.place.first, s.place.second)
        yield Candidate(
            "energy-gain",
            "The restitutions of the two multiply to more than 1: every bounce makes energy from nothing.",
            f"{first:g} x {second:g} = {first * second:.4g}",
            "; ".join(_call(side, restitution=1) for side in sides),
            partial(_both, links=[_link(side) for side in sides], values=(1.0, 1.0)),
        )
    elif gained > 1 + NOTABLE_GAIN and s.compliant:
        yield Candidate(
            "energy-gain",
            "The bounce makes energy from nothing.",
            f"e up to {gained:.4g} with {samples} steps in contact",
            f"p.setTimeStep({finer:.6g})",
            step,
        )
    elif s.compliant and samples and samples <= _FEW_STEPS:
        yield Candidate(
            "few-steps",
            "Too few steps in contact: where in a step the touch falls decides about e.",
            f"{samples} steps in contact at {s.timestep:g} s; 20 or more are needed",
            f"p.setTimeStep({finer:.6g}) or a lower contactStiffness",
            step,
        )


def _gravity(s: Situation) -> Iterator[Candidate]:
    """Gravity in a step."""
    g = float(np.linalg.norm(s.gravity))
    if g == 0 or s.slowest == 0 or g * s.timestep < _GRAVITY_SHARE * s.slowest:
        return
    yield Candidate(
        "gravity",
        "Gravity changes the speed in a step by a large share of it: the rebound is from v + g h.",
        f"g h = {g * s.timestep:.3g} m/s a step against {s.slowest:.3g} m/s",
        f"p.setTimeStep({_GRAVITY_SHARE * s.slowest / g / 5:.2g}), or loadURDF with useMaximalCoordinates",
        _no_gravity,
    )


def _no_gravity(bullet: Bullet) -> None:
    bullet.setGravity(0.0, 0.0, 0.0)


def _motor(s: Situation) -> Iterator[Candidate]:
    """Joints are loaded with a motor that brakes them."""
    mover = s.place.mover
    if mover.joint is None:
        return
    yield Candidate(
        "joint-motor",
        "PyBullet loads every joint with a velocity motor on, which brakes it.",
        mover.words,
        f"p.setJointMotorControl2({mover.body}, {mover.joint}, p.VELOCITY_CONTROL, force=0)",
        partial(_release, body=mover.body, joint=mover.joint),
    )


def _release(bullet: Bullet, body: int, joint: int) -> None:
    bullet.setJointMotorControl2(body, joint, bullet.module.VELOCITY_CONTROL, force=0)


_LOOKS: tuple[Any, ...] = (_restitution, _product, _engine, _compliance, _gravity, _motor)
