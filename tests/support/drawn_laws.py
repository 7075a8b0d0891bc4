"""Laws of the random scenes, the same for both plug-ins."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.contact.mujoco import ConstantRestitution, HuntCrossley, Restitution

if TYPE_CHECKING:
    from hcbench.laws.contact_law import Law

_OF_RESTITUTION: dict[str, Law] = {
    "e 0": ConstantRestitution(0.0),
    "e 0.5": ConstantRestitution(0.5),
    "e 0.9": ConstantRestitution(0.9),
    "e 1": ConstantRestitution(1.0),
    "alpha 0.3 s/m": Restitution(0.3),
    "alpha 3 s/m": Restitution(3.0),
}
LAWS = (*_OF_RESTITUTION, "force")
_STEPS_A_CONTACT = 30


def law_of(row: dict[str, Any]) -> Law:
    """Return the law that a row of a design names."""
    if row["law"] != "force":
        return _OF_RESTITUTION[row["law"]]
    # The contact of 1 kg at 1 m/s lasts 30 steps: T = 2.94 (m/k)^0.4 v^-0.2 of
    # Hertz's theory, with its 5/4.
    duration = _STEPS_A_CONTACT * row["step"]
    return HuntCrossley(stiffness=1.25 * (2.94 / duration) ** 2.5, alpha=0.3)
