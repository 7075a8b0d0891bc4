"""One contact as Newton writes it, for `hcbench convert`."""

from __future__ import annotations

from hcbench.laws.conventions import OneContact, SystemValue, Words

_TRAPS = ("Newton's SolverXPBD drops restitutions without enable_restitution, and averages the two shapes'.",)


def words(contact: OneContact) -> Words:
    """Its restitution."""
    e, note = contact.restitution, "on both shapes, with enable_restitution"
    rows = (SystemValue("Newton", "restitution", (e,), "", f"{contact.at}; {note}"),) if e else ()
    return Words(rows, traps=_TRAPS)
