"""One contact as PhysX writes it, for `hcbench convert`."""

from __future__ import annotations

from hcbench.laws.conventions import OneContact, SystemValue, Words

_TRAPS = ("PhysX averages the restitutions of both materials; SAPIEN's threshold of 2 m/s must be 0.",)


def words(contact: OneContact) -> Words:
    """Its restitution."""
    if contact.restitution is None:
        return Words(traps=_TRAPS)
    note = f"{contact.at}; on both materials"
    return Words((SystemValue("PhysX", "restitution", (contact.restitution,), "", note),), traps=_TRAPS)
