"""The laws that came after 1975 as settings: asked for the best constant restitution of the band."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING

from hcbench.laws.published import LAWS, PrescribedRestitutionLaw, TouchSpeedLaw
from hcbench.setting import Setting
from hcbench.tune.constant import minimax_constant
from hcbench.tune.plugin import force_setting, require_resolved

if TYPE_CHECKING:
    from hcbench.tune.target import Target


@dataclass(frozen=True)
class LaterLaw:
    """F = k x^n (1 + χ(e) v/v_i), v_i the speed of each impact: one restitution for all speeds.

    engine: "reference", or one whose plug-in runs it. family: the law.
    """

    engine: str
    family: type[PrescribedRestitutionLaw]

    @property
    def name(self) -> str:
        """The law's slug."""
        return self.family.slug

    @property
    def summary(self) -> str:
        """One sentence."""
        return f"{self.family.name}, χ = {self.family.formula}: asked for the best constant e of the band."

    @property
    def holds(self) -> tuple[str, ...]:
        """Sentences."""
        way = (
            "The step only says how densely the loop is sampled."
            if self.engine == "reference"
            else "A plug-in of hcbench.contact for steps that resolve the contact: no native setting."
        )
        return (
            "v_i is the speed at touch of each impact: one e for all speeds; the paper's falls with speed.",
            "What it delivers follows from χ and is not what it was asked for, but for `exact`.",
            way,
        )

    def __call__(self, target: Target) -> Setting:
        """The setting; UserError where the law has no χ for this e, SettingError for a step too coarse."""
        e, _ = minimax_constant(target)
        law = TouchSpeedLaw(self.family, target.law.stiffness, e, target.law.exponent)
        options = {"restitution": e, "stiffness": law.stiffness, "exponent": law.exponent}
        if self.engine == "reference":
            return Setting(self.engine, self.name, target.timestep, options)
        instead = "impulse" if self.engine == "mujoco" else "restitution"
        todo = f"Use `{instead}`, which has one restitution at any step"
        require_resolved(target, law.at(target.speed_max).hunt_crossley, todo)
        return force_setting(self.engine, self.name, target.timestep, {"law": self.name, **options})


def _of(engine: str) -> SimpleNamespace:
    """Recipes by slug, with _ for -: what entry points can name."""
    return SimpleNamespace(**{law.slug.replace("-", "_"): LaterLaw(engine, law) for law in LAWS.values()})


REFERENCE = _of("reference")
MUJOCO = _of("mujoco")
PYBULLET = _of("pybullet")
