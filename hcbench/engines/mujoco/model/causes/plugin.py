"""Causes that keep a pair with the plug-in hcbench.restitution from the e of its config."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from hcbench.engines.mujoco.model.causes import fixes
from hcbench.measuring.measurement import TOLERANCE
from hcbench.sim.model_under_test import Suspect
from hcbench.system.text import time_step

if TYPE_CHECKING:
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.terms.impact import Impact

# Gravity gives a resting body g h in a step. The plug-in cannot tell an impact of about that speed
# from rest. In units of g h: impacts slower than this are suspected.
_SLOW = 3.0
# In units of g h: speed of the slowest impact with the step that is advised.
_CURED = 4.0


def slow_for_plugin(
    model: Any, impacts: Sequence[Impact], law: RestitutionCurve, gravity: float
) -> Iterator[Suspect]:
    """Yield the step, where it is so long that the plug-in takes the
    slowest impacts for bodies at rest.

    gravity: m/s², along the normal.
    """
    timestep = float(model.opt.timestep)
    gained = abs(gravity) * timestep

    def asked(speed: float) -> float:
        return float(law.at(speed)) - TOLERANCE

    dead = []
    for impact in impacts:
        speed = impact.speed_in
        if speed < _SLOW * gained and impact.restitution < asked(speed):
            dead.append(speed)
    if not dead:
        return
    shorter = float(f"{min(dead) / (_CURED * abs(gravity)):.2g}")
    yield Suspect(
        "slow-for-step",
        "The step is too long for the slowest impacts: the plug-in takes them for a body at rest.",
        f"{min(dead):.3g} m/s, and gravity gives {gained:.3g} m/s in a step of {time_step(timestep)} s",
        f'<option timestep="{shorter:g}"/>, or speeds above {_CURED * gained:.2g} m/s',
        partial(fixes.set_options, timestep=shorter),
    )
