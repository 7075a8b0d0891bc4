"""One contact as MuJoCo writes it: solref, for `hcbench convert`."""

from __future__ import annotations

from hcbench.laws import kelvin_voigt as kv
from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary

_CAVEATS = (
    "These numbers need a constant solimp, 0.9999 0.9999 0.001. MuJoCo's default varies with penetration.",
    "MuJoCo mixes solref and solimp of the two geoms: set both, or a <pair>.",
)


def vocabulary(contact: OneContact) -> Vocabulary:
    """The bounce in one step, and the spring and damper."""
    rows: list[SystemValue] = []
    missing: list[str] = []
    if contact.restitution is not None:
        rows += _one_step(contact.restitution, contact.timestep, missing)
        rows += _spring_damper(contact.restitution, contact.contact_time, contact.timestep, missing)
    return Vocabulary(tuple(rows), tuple(missing), _CAVEATS)


def _one_step(e: float, timestep: float | None, missing: list[str]) -> list[SystemValue]:
    """solref of a bounce in one step of `timestep`, s, with this e.

    missing: gets a sentence for what cannot be written.
    """
    if timestep is None:
        missing.append("MuJoCo's one-step bounce: it needs the timestep.")
        return []
    note = (
        "without friction, bounces in one step, Euler or implicitfast; solimp 0.9999 0.9999 0.001"
    )
    return [SystemValue("MuJoCo", "solref", (0.0, -(1.0 + e) / timestep), "", note)]


def _spring_damper(
    e: float, contact_time: float | None, timestep: float | None, missing: list[str]
) -> list[SystemValue]:
    """solref of a spring and damper with this e and contact time (s), in both of its forms.

    missing: gets a sentence for what cannot be written.
    """
    if contact_time is None:
        missing.append("MuJoCo's spring and damper: it needs the contact time.")
        return []
    law = kv.matched(e, contact_time, 1.0, kv.Ending.FORCE)
    zeta = kv.damping_ratio(law, 1.0)
    note = "spring and damper per unit effective mass; constant solimp, at least 20 steps a contact"
    direct = SystemValue("MuJoCo", "solref", (-law.stiffness, -law.damping), "1/s², 1/s", note)
    if zeta == 0.0:
        missing.append("MuJoCo's timeconst: without damping it is infinite.")
        return [direct]
    timeconst = 2.0 / law.damping
    note = "the same as timeconst, dampratio"
    if timestep is not None and timeconst < 2.0 * timestep:
        note += "; refsafe would raise timeconst to twice the step and change e"
    return [direct, SystemValue("MuJoCo", "solref", (timeconst, zeta), "s, 1", note)]
