"""The plug-ins of hcbench.contact as settings: the law itself where no native setting reaches it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from hcbench.errors import SettingError
from hcbench.laws import closed_form
from hcbench.laws.contact_law import STEPS_PER_CONTACT
from hcbench.setting import Setting
from hcbench.tune.target_kind import require_kind

if TYPE_CHECKING:
    from hcbench.laws.force import HuntCrossley
    from hcbench.tune.target import Target


@dataclass(frozen=True)
class ForceLaw:
    """Eq. (16) as a contact force, advanced exactly over each step."""

    engine: str
    name: ClassVar[str] = "hunt-crossley"
    summary: ClassVar[str] = "Plug-in: eq. (16) as contact force, for steps that resolve the contact."
    holds: ClassVar[tuple[str, ...]] = (
        "A plug-in of hcbench.contact, to attach in your own simulation: no native setting.",
        "Steps of a quarter of the shortest contact or less; for longer ones take `restitution-law`.",
    )

    def __call__(self, target: Target) -> Setting:
        """The setting; SettingError for a target or a step that the force law does not have."""
        require_kind(target, self.name, ("law",), _instead(self.engine))
        require_resolved(target, target.law, "Use `restitution-law`, which needs no resolved contact")
        law = target.law
        options = {"alpha": law.alpha, "stiffness": law.stiffness, "exponent": law.exponent}
        return force_setting(self.engine, self.name, target.timestep, options)


@dataclass(frozen=True)
class RestitutionLaw:
    """Each impact gets e(v) of its own approach speed, in the step in which it happens."""

    engine: str
    name: ClassVar[str] = "restitution-law"
    summary: ClassVar[str] = "Plug-in: each impact gets the law's e of its own speed, in one step."
    holds: ClassVar[tuple[str, ...]] = (
        "A plug-in of hcbench.contact, to attach in your own simulation: no native setting.",
        "Any step; the force is one impulse: forces and contact times mean nothing.",
    )

    def __call__(self, target: Target) -> Setting:
        """The setting; SettingError for a target given as points."""
        require_kind(target, self.name, ("law", "linear"), _instead(self.engine))
        options = {"kind": "restitution", "alpha": target.law.alpha, "reading": target.reading}
        return _setting(self.engine, self.name, target.timestep, options)


def require_resolved(target: Target, law: HuntCrossley, todo: str) -> None:
    """Refuse a step that does not resolve the shortest contact of the band: SettingError."""
    steps = float(closed_form.duration(law, target.mass, target.speed_max)) / target.timestep
    if steps < STEPS_PER_CONTACT:
        raise SettingError(
            "timestep",
            f"{target.timestep:g} s, {steps:.2g} of which are the law's shortest contact",
            f"{target.timestep * steps / STEPS_PER_CONTACT:.2g} s or less",
            todo,
        )


def _instead(engine: str) -> str:
    """Recipes for any restitution, as a refusal names them."""
    return "`two-pair`, `soft` or `impulse`" if engine == "mujoco" else "`restitution`"


def force_setting(engine: str, name: str, timestep: float, law: dict[str, Any]) -> Setting:
    """A force law's setting."""
    return _setting(engine, name, timestep, {"kind": "force", **law})


def _setting(engine: str, name: str, timestep: float, law: dict[str, Any]) -> Setting:
    # Bullet slows every body in flight; the law is about contact alone.
    flight = {"ball": {"linearDamping": 0.0, "angularDamping": 0.0}} if engine == "pybullet" else {}
    return Setting(engine, name, timestep, {"law": law, **flight})


MUJOCO_FORCE = ForceLaw("mujoco")
MUJOCO_RESTITUTION = RestitutionLaw("mujoco")
PYBULLET_FORCE = ForceLaw("pybullet")
PYBULLET_RESTITUTION = RestitutionLaw("pybullet")
