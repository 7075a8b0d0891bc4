"""MuJoCo: a linear spring and damper with the law's contact time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from hcbench.engines.mujoco.rows import MAX_IMPEDANCE, STIFF_SOLIMP, ConstraintRow
from hcbench.setting import Setting
from hcbench.tune.constant import contact_time, minimax_constant, require_integrator, spring_damper

if TYPE_CHECKING:
    from hcbench.tune.target import Target


@dataclass(frozen=True)
class SpringDamper:
    """Kelvin-Voigt contact, eq. (4), by solref in its direct form.

    Of impedance d throughout, the contact is a = S x / d + D v. S and D are those whose discrete orbit
    x+ = x + h v+, v+ = v - h (S/d x + D v) has the poles exp((-β ± i ω) h) of the wanted motion exactly,
    so the step does not shift e or the contact time to first order.
    """

    integrator: str = "Euler"
    engine: ClassVar[str] = "mujoco"
    name: ClassVar[str] = "spring-damper"
    integrators: ClassVar[tuple[str, ...]] = ("Euler", "implicit", "implicitfast", "RK4")
    summary: ClassVar[str] = (
        "One contact as a linear spring and damper: the best constant e and the law's contact time mid-band."
    )
    holds: ClassVar[tuple[str, ...]] = (
        "Euler, implicit, implicitfast and RK4; discrete takes away up to .2 of e and is refused.",
        "Stiffness and damping are per unit effective mass: the same numbers give the same e for any mass.",
        "At least 20 steps a contact: the spring is softer where the law has fewer.",
        "e does not depend on speed, and the force jumps at touch: it is not the law's loop.",
        "Set solref and solimp on both geoms or in a <pair>: MuJoCo mixes those of the two geoms.",
    )

    def __call__(self, target: Target) -> Setting:
        """The setting with the best constant e of the band."""
        require_integrator(self.name, self.integrator, self.integrators, "its damping is off by the step")
        e, _ = minimax_constant(target)
        beta, omega = spring_damper(e, contact_time(target))
        h = target.timestep
        if self.integrator == "RK4":
            spring, damping = omega**2 + beta**2, 2 * beta
        else:
            decay = math.exp(-beta * h)
            damping = (1 - decay**2) / h
            spring = (1 + decay**2 - 2 * decay * math.cos(omega * h)) / h**2
        row = ConstraintRow.direct(spring * MAX_IMPEDANCE, damping, STIFF_SOLIMP)
        return Setting(self.engine, self.name, h, {"integrator": self.integrator, "rows": [row.option()]})


MUJOCO = SpringDamper()
