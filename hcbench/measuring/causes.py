"""Suspects that need no engine: what may keep any pair from bouncing as
expected, read from its impacts.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from hcbench.laws.restitution import RestitutionCurve
from hcbench.measuring.measurement import NOTABLE_GAIN, TOLERANCE
from hcbench.sim.model_under_test import Suspect
from hcbench.system.text import time_step
from hcbench.terms.impact import Impact, Status
from hcbench.terms.resolution import STEPS_BY_CHANCE

# A speed gained in a step or a contact, as a share of the impact speed, shifts e by as much.
NOTABLE_GRAVITY = TOLERANCE
# Only the user's own model has this cause, not a copy with fixes.
ENERGY_GAIN = "energy-gain"
# A contact that begins but exerts no force.
NO_PUSH = "no-push"
# The e that a fix is written for where no target is given.
BOUNCY = 0.9


@dataclass(frozen=True, slots=True)
class StepFix:
    """Means to set an engine's time step, for fixes.

    timestep: s, the model's own. text: what to write, with {} for the step. apply: called with a model and
        `timestep`, sets it there.
    """

    timestep: float
    text: str
    apply: Callable[..., None]

    def to(self, timestep: float) -> tuple[str, Callable[[Any], None]]:
        """(text, apply) of the fix that sets this step, s."""
        return self.text.format(f"{timestep:.6g}"), partial(self.apply, timestep=timestep)


def speeds_of(impacts: Sequence[Impact]) -> list[float]:
    """Launch speeds, m/s; at touch of bodies that fall from a height."""
    speeds = []
    for impact in impacts:
        falls = impact.launch.height is not None and math.isfinite(impact.speed_in)
        speeds.append(impact.speed_in if falls else impact.launch.speed)
    return speeds


def constant_e(impacts: Sequence[Impact], wanted: RestitutionCurve | None) -> float | None:
    """The one e for a fix that is constant in speed; None without a target.

    It is the mean of the target at the lowest and at the highest speed, m/s, within 0 ... 1.
    """
    if wanted is None:
        return None
    speeds = speeds_of(impacts)
    ends = wanted.at(np.array([min(speeds), max(speeds)]))
    return float(np.clip(ends.mean(), 0.0, 1.0))


def energy_gain(impacts: Sequence[Impact], step: StepFix) -> Iterator[Suspect]:
    """The body leaves faster than it came."""
    gain, samples = _gain(impacts)
    if gain <= 1 + NOTABLE_GAIN:
        return
    text, apply = step.to(step.timestep * min(0.05, max(samples, 1) / 200))
    yield Suspect(
        ENERGY_GAIN,
        "The contact adds energy: the step does not resolve it.",
        f"e up to {gain:.4g} with {samples} steps in contact",
        text,
        apply,
    )


def few_steps(impacts: Sequence[Impact], step: StepFix, softer: str) -> Iterator[Suspect]:
    """Too few steps in contact, without a gain of energy.

    softer: what else would help.
    """
    gain, samples = _gain(impacts)
    if gain > 1 + NOTABLE_GAIN or not 0 < samples <= STEPS_BY_CHANCE:
        return
    text, apply = step.to(step.timestep * samples / 60)
    yield Suspect(
        "few-steps",
        "Too few steps in contact: e depends on where in a step the contact starts, by chance.",
        f"{samples} steps in contact at {time_step(step.timestep)} s; 20 or more are needed",
        f"{text} or {softer}",
        apply,
    )


def _gain(impacts: Sequence[Impact]) -> tuple[float, int]:
    """(largest e, fewest steps in contact) of the impacts that parted; of a body that slides or
    spins, e that would change the energy as much.
    """
    parted = [impact for impact in impacts if impact.status is Status.PARTED]
    largest = 0.0
    for impact in parted:
        if not math.isnan(impact.energy_lost):
            # A normal impact keeps the share e² of its energy.
            kept = max(0.0, 1.0 - impact.energy_lost)
            largest = max(largest, math.sqrt(kept))
    fewest = min((impact.samples for impact in parted), default=0)
    return largest, fewest


def gravity(
    impacts: Sequence[Impact],
    acceleration: Sequence[float],
    timestep: float,
    fix: Callable[[float], str],
    apply: Callable[[Any], None],
) -> Iterator[Suspect]:
    """Gravity does more than its part during a step or a contact.

    acceleration: vector, m/s^2.
    fix: what to write, of the longest contact (s) that gravity leaves alone.
    apply: takes gravity away.
    """
    g = float(np.linalg.norm(acceleration))
    slowest = min((i.speed_in for i in impacts if math.isfinite(i.speed_in)), default=0.0)
    longest = max([timestep, *(i.duration for i in impacts if math.isfinite(i.duration))])
    if g == 0 or slowest == 0 or g * longest < NOTABLE_GRAVITY * slowest:
        return
    yield Suspect(
        "gravity",
        "Gravity changes the speed during a step or a contact by a large share of the impact speed.",
        f"g h = {g * timestep:.3g} m/s a step, {g * longest:.3g} m/s a contact, against {slowest:.3g} m/s",
        fix(NOTABLE_GRAVITY * slowest / g),
        apply,
    )


def other_contacts(names: Iterable[str]) -> Iterator[Suspect]:
    """Other things touch the pair during the impact.

    names: theirs.
    """
    if others := ", ".join(names):
        yield Suspect(
            "other-contacts",
            "Other things touch the two at the same time: e is not that of the pair alone.",
            others,
            "a pair that meets before anything else, or a model of the two alone",
            always_reported=True,
        )
