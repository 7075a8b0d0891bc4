"""Fits contacts of Bullet's own that start at staggered depths to eq. (16), by a model of Bullet's steps.

A contact with contactStiffness k and contactDamping c' whose depth x is above 0 at a step's start pushes
with F = max(0, k (x + h v) + c' v), v the approach rate at the step's end; several add up. So with
c' = c - k h it is a spring on the depth at the start and a damper c on the rate at the end: near touch the
law asks for c' below 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares, nnls

from hcbench.laws import closed_form
from hcbench.tune.search import Search, map_result

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.impact import Floats
    from hcbench.laws.force import HuntCrossley
    from hcbench.tune.target import Target

_FIRST = 0.03  # the second start, over the largest penetration
_STEPS_MOST = 250.0  # of the shortest contact: finer ones are fitted at so many
_LAUNCHES, _PHASES_MOST = 160.0, 8
_SPEEDS, _LOOPS, _POINTS = 18, 10, 24
_RESTITUTION_SCALE, _FORCE_SCALE = 1e-4, 4e-3  # one unit of misfit: of e; of a loop's force, over its largest
_EVALUATIONS = 40
_NUDGE = 1e-6  # relative, of a parameter, for derivatives
_ACTIVE_ROUNDS = 3  # until it is known which contacts push; more change nothing


@dataclass(frozen=True, slots=True)
class Contacts:
    """Contacts from depths `onset` (m) on with k (N/m) and c (N s/m) of the law; shape (n,) or (b, n)."""

    onset: Floats
    stiffness: Floats
    damping: Floats


@dataclass(frozen=True, slots=True)
class Impacts:
    """Impacts at speeds (m/s) and phases of a step, shape (n,); `steps` are enough for all to part.

    mass: kg. h: s. g: gravity, m/s².
    """

    speeds: Floats
    phases: Floats
    mass: float
    h: float
    g: float
    steps: int

    @classmethod
    def of(cls, target: Target, law: HuntCrossley) -> Impacts:
        """Those that a fit looks at, over the target's band of speeds."""
        shortest, longest = (
            float(closed_form.duration(law, target.mass, v)) for v in (target.speed_max, target.speed_min)
        )
        h = max(target.timestep, shortest / _STEPS_MOST)
        phases = int(np.clip(round(_LAUNCHES * h / shortest), 2, _PHASES_MOST))
        share = np.linspace(0.0, 1.0, _SPEEDS) ** 1.5  # slow impacts are the hard ones
        speeds = target.speed_min + (target.speed_max - target.speed_min) * share
        grid = np.meshgrid(speeds, (np.arange(phases) + 0.5) / phases, indexing="ij")
        speed, phase = (axis.ravel() for axis in grid)
        return cls(speed, phase, target.mass, h, target.gravity, int(1.25 * longest / h) + 6)

    def restitution(self, contacts: Contacts) -> Floats:
        """e as Bullet delivers it, shape (b, n), of contacts of shape (b, rows)."""
        h, fall = self.h, self.h * self.g
        k, c = ((h / self.mass) * of[:, None] for of in (contacts.stiffness, contacts.damping))
        x = np.tile(-self.phases * h * self.speeds, (len(k), 1))
        v = np.tile(self.speeds - self.phases * fall, (len(k), 1))
        before = (v + fall / 2) ** 2 - 2 * self.g * x
        for _ in range(self.steps):
            depth = x[..., None] - contacts.onset
            spring, damper = k * np.maximum(depth, 0.0), np.where(depth > 0, c, 0.0)
            parted = (x <= 0) & (v < 0)
            v = np.where(parted, v, _rate_after(v + fall, spring, damper))
            x = np.where(parted, x, x + h * v)
            if parted.all():
                break
        after = (v + fall / 2) ** 2 - 2 * self.g * x
        return np.asarray(np.sqrt(np.maximum(after, 0.0) / before))


def _rate_after(free: Floats, spring: Floats, damper: Floats) -> Floats:
    """v = free - sum of max(0, spring + damper v), shape (b, n); spring, damper: (b, n, rows)."""
    v = (free - spring.sum(-1)) / (1 + damper.sum(-1))
    for _ in range(_ACTIVE_ROUNDS):
        pushes = spring + damper * v[..., None] > 0
        v = (free - (spring * pushes).sum(-1)) / (1 + (damper * pushes).sum(-1))
    return np.asarray(v)


@dataclass(frozen=True, slots=True)
class _Loops:
    """The law's own loops, (n,), SI. v: rate at a step's end. scale: from a force to units of misfit."""

    x: Floats
    v: Floats
    force: Floats
    scale: Floats

    @classmethod
    def of(cls, law: HuntCrossley, mass: float, speeds: Floats, h: float) -> _Loops:
        angle = (np.arange(_POINTS) + 0.5) / _POINTS * np.pi / 2
        columns = []
        for speed in speeds.tolist():
            x = float(closed_form.penetration_max(law, mass, speed)) * np.sin(angle)
            largest = float(closed_form.force_max(law, mass, speed))
            scale = np.sqrt(np.cos(angle) * np.pi / 4 / _POINTS / len(speeds)) / largest / _FORCE_SCALE
            for branch in ("approach", "rebound"):
                v = closed_form.rate_at(law, mass, speed, x, branch)
                force = law.force(x, v)
                columns.append((x, v - h * force / mass, force, scale))
        return cls(*(np.concatenate(column) for column in zip(*columns, strict=True)))

    def misfit(self, contacts: Contacts) -> Floats:
        """Shape (b, n), of contacts of shape (b, rows)."""
        depth = self.x[:, None] - contacts.onset
        each = contacts.stiffness[:, None] * depth + contacts.damping[:, None] * self.v[:, None]
        return np.asarray((np.where(depth > 0, np.maximum(0.0, each), 0.0).sum(-1) - self.force) * self.scale)

    def first_guess(self, onset: Floats) -> Contacts:
        """A linear fit, again and again without the contacts that would pull."""
        depth = np.maximum(0.0, self.x[:, None] - onset)
        rate = np.where(depth > 0, self.v[:, None], 0.0)
        pushes = depth > 0
        for _ in range(8):
            columns = np.concatenate([depth * pushes, rate * pushes], axis=1) * self.scale[:, None]
            unit = np.linalg.norm(columns, axis=0) + 1e-300
            found = nnls(columns / unit, self.force * self.scale, maxiter=10_000)[0] / unit
            k, c = found[: len(onset)], found[len(onset) :]
            pushes = (depth > 0) & (k * depth + c * rate > 0)
        return Contacts(onset, k, c)


def fit_contacts(
    target: Target, law: HuntCrossley, count: int, result: Callable[[Contacts], Any]
) -> Contacts:
    """So many contacts that follow `law` in e, and in force nearly, over the target's speeds.

    result: what an interrupt of the search hands out, of the best contacts until then.
    """
    launches = Impacts.of(target, law)
    loops = _Loops.of(law, target.mass, np.geomspace(target.speed_min, target.speed_max, _LOOPS), launches.h)
    wanted = closed_form.restitution(law.alpha, launches.speeds)
    top = float(closed_form.penetration_max(replace(law, alpha=0.0), target.mass, target.speed_max))
    onset = np.concatenate([[0.0], np.geomspace(_FIRST * top, top, count)[:-1]])
    search = Search(_EVALUATIONS)

    def contacts(parameters: Floats) -> Contacts:
        return Contacts(onset, *np.split(np.exp(parameters), 2, axis=-1))

    def misfits(parameters: Floats) -> Floats:
        """Shape (b, misfits), of parameters (b, 2 count)."""
        off = launches.restitution(contacts(parameters)) - wanted
        share = _RESTITUTION_SCALE * np.sqrt(wanted.size)
        return np.concatenate([off / share, loops.misfit(contacts(parameters))], axis=1)

    def misfit(parameters: Floats) -> Floats:
        found = misfits(parameters[None])
        search.record(parameters[None], np.abs(found[:, : wanted.size]).max(axis=1))
        return np.asarray(found[0])

    def jacobian(parameters: Floats) -> Floats:
        nudged = misfits(parameters + _NUDGE * np.eye(len(parameters) + 1, len(parameters), -1))
        return np.asarray((nudged[1:] - nudged[0]).T / _NUDGE)

    guess = loops.first_guess(onset)
    k = np.maximum(guess.stiffness, 1e-3 * guess.stiffness.max())
    least = np.maximum(
        1e-2 * np.median(guess.damping), 1e-3 * launches.h * k
    )  # a damper of 0 has no logarithm
    start = np.log(np.concatenate([k, np.maximum(guess.damping, least)]))
    with map_result(lambda best: result(contacts(best))), search.return_best_on_interrupt():
        fit = least_squares(misfit, start, jacobian, xtol=1e-6, ftol=1e-6, max_nfev=_EVALUATIONS)
    search.add(_EVALUATIONS)
    return contacts(fit.x)
