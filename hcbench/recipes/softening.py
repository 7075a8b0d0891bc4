"""Softer springs with the same restitution, for time steps that are too coarse for the law's own
contact.

e of (16) depends on α v_i alone, so k is free where only e is wanted. At a given speed the contact lasts
T ∝ k^(-1/(n+1)).
"""

from dataclasses import replace

import numpy as np

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.system.errors import SettingError
from hcbench.terms.resolution import STEPS_MOST, STEPS_OF_A_LOOP, STEPS_OF_A_SOFTENED


def require_end(target: Target) -> None:
    """Raise SettingError for a step so short that an evaluation would not end."""
    steps = steps_per_contact(target)
    if steps > STEPS_MOST:
        got = f"{target.timestep:g} s, of which {steps:.2g} are the law's shortest contact"
        nearest = target.timestep * steps / STEPS_MOST
        raise SettingError("timestep", got, f"up to {STEPS_MOST:g} steps", f"Use {nearest:.2g} s or more")


def steps_per_contact(target: Target) -> float:
    """Time steps in the law's own contact at the highest speed of the band."""
    return float(closed_form.duration(target.law, target.mass, target.speed_max)) / target.timestep


def resolvable_law(target: Target, softened_steps: float = STEPS_OF_A_SOFTENED) -> HuntCrossley:
    """Return the target's law, softened if its shortest contact lasts less than STEPS_OF_A_LOOP.

    A softened contact lasts `softened_steps` time steps at the speed at which it is shortest.
    """
    ends = np.array([target.speed_min, target.speed_max])
    steps = float(closed_form.duration(target.law, target.mass, ends).min()) / target.timestep
    if steps >= STEPS_OF_A_LOOP:
        return target.law
    softer = (steps / softened_steps) ** (target.law.exponent + 1.0)
    return replace(target.law, stiffness=target.law.stiffness * softer)
