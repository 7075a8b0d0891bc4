"""Where time steps are too coarse for the law's own contact: a softer spring with the same restitution.

e of (16) depends on α v_i alone, so k is free where only e is wanted. At a given speed the contact lasts
T ∝ k^(-1/(n+1)).
"""

from dataclasses import replace

import numpy as np

from hcbench.errors import SettingError
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target

FEWEST_STEPS = 10.0  # with fewer the law's own loop is lost anyway
SOFTENED_STEPS = 24.0
MOST_STEPS = 1e6  # of a contact: a hundred launches of more take hours


def require_end(target: Target) -> None:
    """Raise SettingError for a step so short that an evaluation would not end."""
    steps = steps_per_contact(target)
    if steps > MOST_STEPS:
        got = f"{target.timestep:g} s, of which {steps:.2g} are the law's shortest contact"
        nearest = target.timestep * steps / MOST_STEPS
        raise SettingError("timestep", got, f"up to {MOST_STEPS:g} steps", f"Use {nearest:.2g} s or more")


def steps_per_contact(target: Target) -> float:
    """Time steps in the law's own contact at the highest speed of the band."""
    return float(closed_form.duration(target.law, target.mass, target.speed_max)) / target.timestep


def resolvable_law(target: Target, softened_steps: float = SOFTENED_STEPS) -> HuntCrossley:
    """The target's law; where it lasts under FEWEST_STEPS, one softened to so many at the shortest."""
    ends = np.array([target.speed_min, target.speed_max])
    steps = float(closed_form.duration(target.law, target.mass, ends).min()) / target.timestep
    if steps >= FEWEST_STEPS:
        return target.law
    softer = (steps / softened_steps) ** (target.law.exponent + 1.0)
    return replace(target.law, stiffness=target.law.stiffness * softer)
