"""The law itself, and the Kelvin-Voigt contrast of Fig. 1, as settings of the reference."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from hcbench.laws import closed_form
from hcbench.setting import Setting
from hcbench.tune.constant import minimax_constant

if TYPE_CHECKING:
    from hcbench.tune.target import Target


@dataclass(frozen=True)
class HuntCrossleyLaw:
    """Eq. (16)."""

    engine: ClassVar[str] = "reference"
    name: ClassVar[str] = "hunt-crossley"
    summary: ClassVar[str] = "Eq. (16) itself, in closed form: restitution falls with impact speed."
    holds: ClassVar[tuple[str, ...]] = ("The step only says how densely the loop is sampled.",)

    def __call__(self, target: Target) -> Setting:
        """The law of the target."""
        law = target.law
        options = {"alpha": law.alpha, "stiffness": law.stiffness, "exponent": law.exponent}
        return Setting(self.engine, self.name, target.timestep, options)


@dataclass(frozen=True)
class KelvinVoigtContrast:
    """Eq. (4) with the best constant restitution of the band and the law's contact time in its middle."""

    engine: ClassVar[str] = "reference"
    name: ClassVar[str] = "kelvin-voigt"
    summary: ClassVar[str] = (
        "Eq. (4), a linear spring and damper: one e for all speeds, a shock at touch, tension at the end."
    )
    holds: ClassVar[tuple[str, ...]] = ("Matches the law's restitution and contact time at one speed only.",)

    def __call__(self, target: Target) -> Setting:
        """k and c from e = exp(-β t) and t = π/ω, contact ending at x = 0."""
        e, _ = minimax_constant(target)
        duration = float(
            closed_form.duration(target.law, target.mass, math.sqrt(target.speed_min * target.speed_max))
        )
        decay = -math.log(e) / duration
        stiffness = target.mass * ((math.pi / duration) ** 2 + decay**2)
        options = {"stiffness": stiffness, "damping": 2 * target.mass * decay}
        return Setting(self.engine, self.name, target.timestep, options)


HUNT_CROSSLEY = HuntCrossleyLaw()
KELVIN_VOIGT = KelvinVoigtContrast()
